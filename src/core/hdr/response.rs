//! Recovers the camera's response from a bracket [DM97].

use super::merge_bracket::weight;
use crate::{
    math::solve::least_squares,
    model::{frame::Exposure, image::Rgb8Image, response::Response},
};

/// Longest exposure over shortest from which the response can be seen at all (spec 10: "exposure ratio 1").
pub const LEAST_EXPOSURE_RATIO: f64 = 2.0;

/// Values outside this range tell too little to be sampled.
const USABLE: std::ops::RangeInclusive<u8> = 3..=252;
/// Fewest samples in a channel.
const FEWEST_SAMPLES: usize = 24;
/// Pixels of a channel for which lambda is stated: as many as [DM97] takes.
const USUAL_SAMPLES: f64 = 50.0;
/// Fewest distinct values among a channel's samples.
const FEWEST_VALUES: usize = 32;
/// Values that are well exposed, for judging what data a curve rests on.
const WELL_SEEN: std::ops::RangeInclusive<u8> = 12..=245;
/// A value this near counts as seen as well: the curve is smooth over as many.
const SEEN_AROUND: usize = 6;
/// Samples that a value, or one near it, must be seen in: one alone may be noise.
const FEWEST_NEAR: u32 = 2;
/// Least share of the well-exposed values that two exposures both see well. Between the values of two exposures far
/// apart the curve would be what smoothness makes of it.
pub const LEAST_SEEN_SHARE: f64 = 0.9;
/// Values by which the fit is judged: the toe of film and stray light spoil the darkest ones in honest brackets.
const JUDGED: std::ops::RangeInclusive<u8> = 40..=235;
/// Residual (rms, in units of ln exposure) above which pictures and stated exposures cannot belong together.
/// Real brackets leave 0.02 (F5) to 0.24 (`brackets/memorial` with its borders); false times leave 0.9 and more.
const WORST_RESIDUAL: f64 = 0.4;

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveOptions {
    /// Weight of smoothness against 50 pixels, above 0 (with more pixels it grows, so that the balance stays). From 20 on
    /// 3 DN of noise are survived; 1 fits closer and bends from 1 DN. Three exposures far apart leave waves in g free
    /// that only smoothness rules out: the reference's balls are read alike with 20 to 40; from 30 on the ends of the scale flatten.
    pub lambda: f64,
    /// The free scale of each channel: g(128), the ln of the exposure (radiance x seconds) that gives 128.
    pub log_exposure_at_128: [f64; 3],
    /// Equations from pixels, at most, for each channel (the time goes with it).
    pub most_equations: usize,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self { lambda: 25.0, log_exposure_at_128: [0.0; 3], most_equations: 2400 }
    }
}

/// Where a response comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum ResponseOrigin {
    /// From the pictures.
    Solved {
        /// Worst channel's rms of g(z) - ln E - ln t over the samples, weighted.
        residual_rms: f64,
    },
    /// The pictures cannot tell; the sRGB curve stands in.
    Fallback {
        /// Why, for people.
        why: String,
    },
}

/// A response and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct RecoveredResponse {
    /// Sound in any case.
    pub response: Response,
    /// Solved, or why not.
    pub origin: ResponseOrigin,
}

/// Recovers g for each channel by the least squares of Eq. 3 of [DM97]: sum over samples of
/// (w(z) (g(z) - ln E - ln t))^2 + lambda^2 (samples / 50) sum over z of (w(z) g''(z))^2, hat weights, g(128) as the
/// options say, and then made non-decreasing (pool adjacent violators).
///
/// `pictures` show one view, 1:1 with `exposures`. Samples are spread over brightness and over the picture by a
/// fixed rule. Where the exposures span less than [`LEAST_EXPOSURE_RATIO`], too few pixels are usable, the rank is
/// short, or the fit is bad, the answer is [`Response::srgb`] with the reason: a warning for the caller to hand on.
pub fn solve(pictures: &[&Rgb8Image], exposures: &[Exposure], options: &SolveOptions) -> RecoveredResponse {
    match try_solve(pictures, exposures, options) {
        Ok((response, residual_rms)) => {
            RecoveredResponse { response, origin: ResponseOrigin::Solved { residual_rms } }
        }
        Err(why) => {
            RecoveredResponse { response: Response::srgb(), origin: ResponseOrigin::Fallback { why } }
        }
    }
}

fn try_solve(
    pictures: &[&Rgb8Image],
    exposures: &[Exposure],
    options: &SolveOptions,
) -> Result<(Response, f64), String> {
    if pictures.len() < 2 || pictures.len() != exposures.len() {
        return Err(format!(
            "{} pictures and {} exposures: at least 2 of each, paired, are needed",
            pictures.len(),
            exposures.len()
        ));
    }
    let size = (pictures[0].width(), pictures[0].height());
    if pictures.iter().any(|p| (p.width(), p.height()) != size) {
        return Err("the pictures differ in size".into());
    }
    if !(options.lambda > 0.0 && options.lambda.is_finite()) {
        return Err(format!("lambda = {}: must be finite and above 0", options.lambda));
    }
    let times_s: Vec<f64> = exposures.iter().map(|e| e.effective_s()).collect();
    if let Some(wrong) = times_s.iter().find(|t| !(t.is_finite() && **t > 0.0)) {
        return Err(format!("exposure {wrong} s: must be finite and above 0"));
    }
    let shortest = times_s.iter().copied().fold(f64::INFINITY, f64::min);
    let longest = times_s.iter().copied().fold(0.0, f64::max);
    // A hair below 2, so that 1/30 and 1/60 s count.
    if longest / shortest < LEAST_EXPOSURE_RATIO * (1.0 - 1e-9) {
        return Err(format!(
            "longest exposure / shortest = {:.3}: at least {LEAST_EXPOSURE_RATIO} is needed to see the response",
            longest / shortest
        ));
    }
    let mut tables = [[0.0f32; 256]; 3];
    let mut worst = 0.0f64;
    for (channel, table) in tables.iter_mut().enumerate() {
        let samples = choose_samples(pictures, channel, options.most_equations / pictures.len());
        let name = ["red", "green", "blue"][channel];
        let (g, residual_rms) =
            solve_channel(&samples, &times_s, options.lambda, options.log_exposure_at_128[channel])
                .map_err(|why| format!("{name}: {why}"))?;
        worst = worst.max(residual_rms);
        for (slot, g) in table.iter_mut().zip(g) {
            *slot = g as f32;
        }
    }
    let response = Response::new(tables).ok_or("the solution is not finite")?;
    Ok((response, worst))
}

/// Values of one channel at chosen pixels, one for each picture.
fn choose_samples(pictures: &[&Rgb8Image], channel: usize, most: usize) -> Vec<Vec<u8>> {
    let (width, height) = (pictures[0].width(), pictures[0].height());
    // A grid of about 16,000 candidates over the whole picture.
    let step = (((width * height) as f64 / 16_384.0).sqrt().floor() as usize).max(1);
    // The sum over the pictures rises with radiance: a key of brightness that needs no response.
    let mut candidates: Vec<(u32, usize)> = Vec::new();
    for y in (step / 2..height).step_by(step) {
        for x in (step / 2..width).step_by(step) {
            let values = pictures.iter().map(|p| p.at(x, y)[channel]);
            if values.clone().filter(|z| USABLE.contains(z)).count() >= 2 {
                candidates.push((values.map(u32::from).sum(), y * width + x));
            }
        }
    }
    candidates.sort_unstable();
    let (Some(first), Some(last)) = (candidates.first(), candidates.last()) else { return Vec::new() };
    // Equal steps of brightness. Of each step the flatter half, where a slight shift between the pictures or a
    // blurred edge does no harm, and of those as many as are wanted, evenly, in the order of the picture: hence
    // spread over it.
    let (low, span) = (first.0, last.0 - first.0 + 1);
    let steps = (most as u32).clamp(1, 64).min(span);
    let each = (most / steps as usize).max(1);
    let mut chosen = Vec::with_capacity(most);
    for k in 0..steps {
        let from = candidates.partition_point(|c| c.0 < low + span * k / steps);
        let to = candidates.partition_point(|c| c.0 < low + span * (k + 1) / steps);
        let mut group: Vec<(u8, usize)> =
            candidates[from..to].iter().map(|c| (contrast(pictures, channel, c.1), c.1)).collect();
        group.sort_unstable();
        group.truncate((group.len() / 2).max(each));
        group.sort_unstable_by_key(|c| c.1);
        let taken = each.min(group.len());
        chosen.extend((0..taken).map(|i| group[(2 * i + 1) * group.len() / (2 * taken)].1));
    }
    chosen.into_iter().map(|i| pictures.iter().map(|p| p.pixels()[i][channel]).collect()).collect()
}

/// Largest difference to a neighbour left, right, above or below, in any picture.
fn contrast(pictures: &[&Rgb8Image], channel: usize, index: usize) -> u8 {
    let (width, height) = (pictures[0].width(), pictures[0].height());
    let (x, y) = (index % width, index / width);
    let near = [(x.saturating_sub(1), y), (x + 1, y), (x, y.saturating_sub(1)), (x, y + 1)];
    let differences = pictures.iter().flat_map(|p| {
        near.iter()
            .filter(|(x, y)| *x < width && *y < height)
            .map(move |&(nx, ny)| p.at(nx, ny)[channel].abs_diff(p.at(x, y)[channel]))
    });
    differences.max().unwrap_or(0)
}

/// The linear equations for a channel's g, 255 unknowns each: those at all values but 128.
struct Equations {
    /// Row by row.
    matrix: Vec<f64>,
    right: Vec<f64>,
    /// The rows of values that the residual is judged by, and the sum of their squared weights.
    judged: Vec<usize>,
    judged_weight: f64,
}

impl Equations {
    /// The unknown of a value other than 128.
    fn column(z: usize) -> usize {
        if z < 128 { z } else { z - 1 }
    }

    fn of(samples: &[Vec<u8>], times_s: &[f64], lambda: f64) -> Self {
        // Unknowns: g at all values but 128. ln E of each sample is the weighted mean of its g(z) - ln t whatever g is,
        // so it is put in and drops out; g(128) = 0 until the end.
        let (mut matrix, mut right): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let (mut judged, mut judged_weight) = (Vec::new(), 0.0);
        for sample in samples {
            let weights: Vec<f64> = sample.iter().map(|&z| f64::from(weight(z))).collect();
            let total: f64 = weights.iter().map(|w| w * w).sum();
            let mean_log_t = weights.iter().zip(times_s).map(|(w, t)| w * w * t.ln()).sum::<f64>() / total;
            for ((&z, &w), t) in sample.iter().zip(&weights).zip(times_s) {
                if w == 0.0 {
                    continue;
                }
                let start = matrix.len();
                matrix.resize(start + 255, 0.0);
                let row = &mut matrix[start..];
                let mut add = |z: u8, factor: f64| {
                    if z != 128 {
                        row[Self::column(usize::from(z))] += factor;
                    }
                };
                add(z, w);
                for (&other, v) in sample.iter().zip(&weights) {
                    add(other, -w * v * v / total);
                }
                if JUDGED.contains(&z) {
                    judged.push(right.len());
                    judged_weight += w * w;
                }
                right.push(w * (t.ln() - mean_log_t));
            }
        }
        // The more pixels, the more their equations weigh against smoothness: lambda is meant for a usual number of them.
        let balance = (samples.len() as f64 / USUAL_SAMPLES).max(1.0).sqrt();
        for z in 1..255usize {
            let factor = lambda * balance * f64::from(weight(z as u8));
            let start = matrix.len();
            matrix.resize(start + 255, 0.0);
            for (z, factor) in [(z - 1, factor), (z, -2.0 * factor), (z + 1, factor)] {
                if z != 128 {
                    matrix[start + Self::column(z)] = factor;
                }
            }
            right.push(0.0);
        }
        Self { matrix, right, judged, judged_weight }
    }

    /// Weighted rms of what a solution leaves.
    fn residual_rms(&self, solution: &[f64]) -> f64 {
        let squares = self.judged.iter().map(|&r| {
            let row = &self.matrix[r * 255..(r + 1) * 255];
            let fit: f64 = row.iter().zip(solution).map(|(a, x)| a * x).sum();
            (fit - self.right[r]).powi(2)
        });
        (squares.sum::<f64>() / self.judged_weight).sqrt()
    }
}

/// Share of the well-exposed values that samples hold, or one near them, at pixels which two pictures both see well.
fn seen_share(samples: &[Vec<u8>]) -> f64 {
    let mut counts = [0u32; 256];
    for sample in samples {
        let well = sample.iter().filter(|z| WELL_SEEN.contains(z));
        if well.clone().count() >= 2 {
            well.for_each(|&z| counts[usize::from(z)] += 1);
        }
    }
    let range = usize::from(*WELL_SEEN.start())..usize::from(*WELL_SEEN.end()) + 1;
    let near =
        |z: usize| counts[z.saturating_sub(SEEN_AROUND)..(z + SEEN_AROUND + 1).min(256)].iter().sum::<u32>();
    range.clone().filter(|&z| near(z) >= FEWEST_NEAR).count() as f64 / range.len() as f64
}

/// g of one channel, and the weighted rms of the residual. `samples`: for each pixel one value a picture.
fn solve_channel(
    samples: &[Vec<u8>],
    times_s: &[f64],
    lambda: f64,
    log_exposure_at_128: f64,
) -> Result<([f64; 256], f64), String> {
    let mut seen = [false; 256];
    samples.iter().flatten().filter(|z| USABLE.contains(z)).for_each(|&z| seen[usize::from(z)] = true);
    let values = seen.iter().filter(|s| **s).count();
    if samples.len() < FEWEST_SAMPLES || values < FEWEST_VALUES {
        return Err(format!(
            "{} usable pixels with {values} different values: at least {FEWEST_SAMPLES} pixels neither black nor saturated in two pictures, and {FEWEST_VALUES} values, are needed",
            samples.len()
        ));
    }
    let share = seen_share(samples);
    if share < LEAST_SEEN_SHARE {
        return Err(format!(
            "two exposures both see only {:.0} % of the values well: at least {:.0} % are needed",
            100.0 * share,
            100.0 * LEAST_SEEN_SHARE
        ));
    }
    let equations = Equations::of(samples, times_s, lambda);
    let Equations { matrix, right, .. } = &equations;
    let found = least_squares(right.len(), 255, matrix, right).ok_or("the equations are not finite")?;
    if found.rank < 255 {
        return Err(format!(
            "the equations have rank {} of 255: the pictures do not tell the response",
            found.rank
        ));
    }
    let residual_rms = equations.residual_rms(&found.solution);
    let mut g: [f64; 256] =
        std::array::from_fn(|z| if z == 128 { 0.0 } else { found.solution[Equations::column(z)] });
    pool_adjacent_violators(&mut g);
    if !(residual_rms <= WORST_RESIDUAL) {
        return Err(format!(
            "the pictures contradict the stated exposures (residual {residual_rms:.2} in ln exposure, at most {WORST_RESIDUAL} is allowed)"
        ));
    }
    let shift = log_exposure_at_128 - g[128];
    g.iter_mut().for_each(|g| *g += shift);
    Ok((g, residual_rms))
}

/// The closest non-decreasing table, in weighted squares (weights as in the merge, one more so that both ends count).
fn pool_adjacent_violators(g: &mut [f64; 256]) {
    // Blocks of equal value: (mean, weight, entries).
    let mut blocks: Vec<(f64, f64, usize)> = Vec::with_capacity(256);
    for (z, &value) in g.iter().enumerate() {
        let mut block = (value, f64::from(weight(z as u8)) + 1.0, 1);
        while let Some(&last) = blocks.last().filter(|last| last.0 > block.0) {
            let total = last.1 + block.1;
            block = ((last.0 * last.1 + block.0 * block.1) / total, total, last.2 + block.2);
            blocks.pop();
        }
        blocks.push(block);
    }
    let pooled = blocks.iter().flat_map(|b| std::iter::repeat_n(b.0, b.2));
    g.iter_mut().zip(pooled).for_each(|(g, pooled)| *g = pooled);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pooling_gives_the_closest_table_that_never_falls() {
        let mut g: [f64; 256] = std::array::from_fn(|z| z as f64);
        let sound = g;
        pool_adjacent_violators(&mut g);
        assert_eq!(g, sound);
        g[40] = 44.0;
        pool_adjacent_violators(&mut g);
        assert!(g.windows(2).all(|pair| pair[1] >= pair[0]));
        // Weights 41, 42, 43: the mean of 44, 41 and 42 lies below 43, so that 43 stays.
        let mean = (44.0 * 41.0 + 41.0 * 42.0 + 42.0 * 43.0) / (41.0 + 42.0 + 43.0);
        assert!((40..43).all(|z| (g[z] - mean).abs() < 1e-12), "{:?} {mean}", &g[39..46]);
        assert_eq!((g[39], g[43]), (39.0, 43.0));
        let mut falling: [f64; 256] = std::array::from_fn(|z| -(z as f64));
        pool_adjacent_violators(&mut falling);
        assert!(falling.iter().all(|v| (v - falling[0]).abs() < 1e-9));
    }

    /// A ramp of radiance over e^span, seen through sRGB.
    fn ramp(times_s: &[f64], span: f64) -> (Vec<Rgb8Image>, Vec<Exposure>) {
        let response = Response::srgb();
        let pictures = times_s
            .iter()
            .map(|t| {
                let pixels = (0..64 * 64)
                    .map(|i| {
                        let radiance = (span * (i as f64 / 4096.0 - 0.5)).exp();
                        std::array::from_fn(|c| response.value_of(c, (radiance * t) as f32).round() as u8)
                    })
                    .collect();
                Rgb8Image::from_pixels(64, 64, pixels).unwrap()
            })
            .collect();
        (pictures, times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect())
    }

    fn why(times_s: &[f64], stated_s: &[f64]) -> String {
        let (pictures, _) = ramp(times_s, 6.0);
        let pictures: Vec<_> = pictures.iter().collect();
        let stated: Vec<_> = stated_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
        let recovered = solve(&pictures, &stated, &SolveOptions::default());
        match recovered.origin {
            ResponseOrigin::Fallback { why } => {
                assert_eq!(recovered.response, Response::srgb());
                why
            }
            ResponseOrigin::Solved { .. } => String::new(),
        }
    }

    #[test]
    fn gains_count_as_exposure() {
        let (pictures, exposures) = ramp(&[0.1, 0.4, 1.6], 6.0);
        let pictures: Vec<_> = pictures.iter().collect();
        let by_time = solve(&pictures, &exposures, &SolveOptions::default());
        let gains: Vec<_> =
            exposures.iter().map(|e| Exposure { time_s: 0.1, gain: e.time_s / 0.1 }).collect();
        let by_gain = solve(&pictures, &gains, &SolveOptions::default());
        assert!(matches!(by_time.origin, ResponseOrigin::Solved { .. }), "{:?}", by_time.origin);
        for (a, b) in by_time.response.log_exposure()[1].iter().zip(by_gain.response.log_exposure()[1]) {
            assert!((a - b).abs() < 1e-5);
        }
        assert!((by_time.response.log_exposure()[2][128]).abs() < 1e-6);
    }

    #[test]
    fn what_cannot_be_solved_falls_back_and_says_why() {
        assert!(why(&[0.1, 0.1], &[0.1, 0.1]).contains("longest exposure / shortest = 1.000"));
        assert!(why(&[0.1, 0.18], &[0.1, 0.18]).contains("1.800"));
        assert!(why(&[0.1], &[0.1]).contains("at least 2"));
        assert!(why(&[0.1, 0.4], &[0.1]).contains("2 pictures and 1 exposures"));
        assert!(why(&[0.1, 0.4], &[0.1, f64::NAN]).contains("NaN"));
        assert!(why(&[0.1, 0.4], &[0.1, 0.0]).contains("must be finite and above 0"));
        // All saturated, all black.
        assert!(why(&[1e3, 1e4], &[1e3, 1e4]).contains("usable pixels"));
        assert!(why(&[1e-9, 1e-8], &[1e-9, 1e-8]).contains("usable pixels"));
        // Equal pictures whose stated times differ.
        let equal = why(&[0.1, 0.1, 0.1], &[0.1, 0.4, 1.6]);
        assert!(equal.contains("contradict") || equal.contains("rank"), "{equal}");
        assert_eq!(why(&[0.1, 0.4, 1.6], &[0.1, 0.4, 1.6]), "");
    }
}
