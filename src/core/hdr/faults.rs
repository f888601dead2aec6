//! Pictures of a bracket that cannot be what they are stated to be: black, far too bright, frozen, of another white balance,
//! brighter or darker than stated. Told before anything is made of them, by a guessed response: what is named here is gross.

use super::attribute::measured_ratio_of;
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};

/// Values up to this are black, whatever the noise.
const BLACK: u8 = 12;
/// Values from this on are saturated.
const WHITE: u8 = 250;
/// Below this, film's fog and stray light stand for light.
const CLEAR_OF_FOG: u8 = 24;
/// Pixels looked at, about.
const PIXELS_LOOKED_AT: usize = 20_000;
/// Values (pixels x channels) that must speak against a picture, at least.
const FEWEST: u32 = 200;
/// Share of the values that another picture speaks of which must contradict it.
const MOST: f64 = 0.5;
/// What a guessed response may be wrong by, as a factor of light for each factor of the stated ratio (its power).
const GUESS_POWER: f64 = 0.5;
/// Pictures that differ by less than this in the mean, 8-bit values, though their exposures do by more than
/// [`FROZEN_RATIO`], are one picture twice.
const FROZEN_DIFFERENCE: f64 = 1.5;
/// See above.
const FROZEN_RATIO: f64 = 1.3;
/// ln of how far one channel's ratio of exposures may lie from the others', and that for each unit of ln of the ratio.
const WHITE_BALANCE: (f64, f64) = (0.16, 0.04);
/// ln of how far a picture's brightness may lie off the line through the others.
const OFF_LINE: f64 = 0.15;
/// A picture farther off has another time than stated: the check of exposures says so.
const MOST_OFF_LINE: f64 = 0.9;
/// ln of how far the others may lie off their own line.
const ON_LINE: f64 = 0.08;
/// Slopes of that line (contrast of the camera's curve against sRGB's) that are possible.
const SLOPES: std::ops::RangeInclusive<f64> = 0.6..=1.7;

/// What is wrong with a picture of a bracket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// It is black where another shows light that it would have shown.
    Black {
        /// The other.
        against: usize,
    },
    /// It is saturated where another shows little light.
    TooBright {
        /// The other.
        against: usize,
    },
    /// It is another picture once more, though their exposures differ.
    Frozen {
        /// The other.
        against: usize,
    },
    /// Its colours are those of another white balance than the others'.
    WhiteBalance {
        /// Red, green and blue against the others, green being 1.
        factors: [f64; 3],
    },
    /// All of it is brighter, or darker, than stated, by this factor of light.
    Brightness {
        /// Above 1 for brighter.
        factor: f64,
    },
}

impl Fault {
    /// Whether the picture says nothing that could be merged. The others are merged, put right.
    pub fn leaves_out(&self) -> bool {
        !matches!(self, Self::Brightness { .. })
    }
}

/// Examines the pictures of a bracket (one view, 1:1 with `exposures`): what is wrong with each, if anything. Where two
/// contradict each other and no third tells which is right, white balance and brightness are left alone.
pub fn examine(pictures: &[&Rgb8Image], exposures: &[Exposure]) -> Vec<Option<Fault>> {
    let mut faults = vec![None; pictures.len()];
    if pictures.len() != exposures.len() || pictures.len() < 2 {
        return faults;
    }
    let times_s: Vec<f64> = exposures.iter().map(|e| e.effective_s()).collect();
    let sound = times_s.iter().all(|t| t.is_finite() && *t > 0.0);
    let size = (pictures[0].width(), pictures[0].height());
    if !sound || pictures.iter().any(|p| (p.width(), p.height()) != size) {
        return faults;
    }
    let response = Response::srgb();
    for k in 1..pictures.len() {
        for j in 0..k {
            let ratio = (times_s[k] / times_s[j]).max(times_s[j] / times_s[k]);
            let open = faults[j].is_none() && faults[k].is_none();
            if !(open && ratio >= FROZEN_RATIO && repeats(pictures[k], pictures[j])) {
                continue;
            }
            // Without a third picture nobody knows which of the two is the false one.
            let off = |k: usize| off_others(pictures, &times_s, k, &response);
            if let (Some(of_k), Some(of_j)) = (off(k), off(j)) {
                let (late, against) = if of_k < of_j { (j, k) } else { (k, j) };
                faults[late] = Some(Fault::Frozen { against });
            }
        }
    }
    for k in 0..pictures.len() {
        if faults[k].is_some() {
            continue;
        }
        faults[k] = (0..pictures.len())
            .filter(|&j| j != k && !matches!(faults[j], Some(Fault::Frozen { .. })))
            .find_map(|j| bounded(pictures[k], pictures[j], times_s[k] / times_s[j], j, &response));
    }
    let left: Vec<usize> = (0..pictures.len()).filter(|&k| faults[k].is_none()).collect();
    if let Some((k, fault)) = odd_one(pictures, &times_s, &left, &response) {
        faults[k] = Some(fault);
    }
    faults
}

/// Black and white of video: pictures that were never spread over 0..=255.
const VIDEO: (u8, u8) = (16, 235);
/// Share of a bracket's values that must lie at one of these ends, and the most that may lie beyond them.
const AT_VIDEO_END: (f64, f64) = (0.005, 0.001);

/// Whether the pictures of a bracket hold values of 16..=235 alone, black or white among them.
pub fn is_limited_range(pictures: &[&Rgb8Image]) -> bool {
    let mut histogram = [0u64; 256];
    for pixel in pictures.iter().flat_map(|p| p.pixels()) {
        pixel.iter().for_each(|z| histogram[usize::from(*z)] += 1);
    }
    let all: u64 = histogram.iter().sum();
    let share = |from: usize, to: usize| histogram[from..=to].iter().sum::<u64>() as f64 / all.max(1) as f64;
    let (black, white) = (usize::from(VIDEO.0), usize::from(VIDEO.1));
    let beyond = share(0, black - 3) + share(white + 4, 255);
    beyond <= AT_VIDEO_END.1 && share(white - 1, white + 3).max(share(black - 2, black + 1)) >= AT_VIDEO_END.0
}

/// The same picture with 16..=235 spread over 0..=255.
pub fn full_range(picture: &Rgb8Image) -> Rgb8Image {
    let (black, white) = VIDEO;
    let spread = |z: u8| {
        let above = u32::from(z.clamp(black, white) - black);
        ((above * 255 + 109) / u32::from(white - black)) as u8
    };
    let mut full = picture.clone();
    full.pixels_mut().iter_mut().for_each(|pixel| *pixel = pixel.map(spread));
    full
}

/// Whether `picture` shows black, or white, where `other` bounds its light from below, or above. `ratio`: of its exposure.
fn bounded(
    picture: &Rgb8Image,
    other: &Rgb8Image,
    ratio: f64,
    against: usize,
    response: &Response,
) -> Option<Fault> {
    let slack = ratio.max(1.0 / ratio).powf(GUESS_POWER);
    // Bounds for each value of the other: what this one must show at least and at most.
    let g = &response.log_exposure()[1];
    let expected = |z: usize, factor: f64| response.value_of(1, (f64::from(g[z]).exp() * factor) as f32);
    let least: Vec<f32> = (0..256).map(|z| expected(z, ratio / slack)).collect();
    let most: Vec<f32> = (0..256).map(|z| expected(z, ratio * slack)).collect();
    let (mut bright, mut black, mut dim, mut white) = (0u32, 0u32, 0u32, 0u32);
    for_pixels(picture, other, |this, that| {
        if least[usize::from(that)] >= 48.0 {
            bright += 1;
            black += u32::from(this <= BLACK);
        }
        if most[usize::from(that)] <= 160.0 && that >= CLEAR_OF_FOG {
            dim += 1;
            white += u32::from(this >= WHITE);
        }
    });
    let speaks = |against: u32, of: u32| against >= FEWEST && f64::from(against) > MOST * f64::from(of);
    if speaks(black, bright) {
        return Some(Fault::Black { against });
    }
    speaks(white, dim).then_some(Fault::TooBright { against })
}

/// How far a picture's brightness is from what its exposure is against the others of another exposure, ln in the mean.
/// `None` where it shares too little with any that is not the same picture.
fn off_others(pictures: &[&Rgb8Image], times_s: &[f64], k: usize, response: &Response) -> Option<f64> {
    let others = (0..pictures.len()).filter(|&j| j != k && !repeats(pictures[k], pictures[j]));
    let off: Vec<f64> = others
        .filter_map(|j| {
            let stated = (times_s[k] / times_s[j]).ln();
            let measured = measured_ratio_of(pictures[k], pictures[j], response, 0..3)?;
            Some((measured.log_ratio - stated).abs())
        })
        .collect();
    (!off.is_empty()).then(|| off.iter().sum::<f64>() / off.len() as f64)
}

/// Whether two pictures are the same but for noise, and show something.
fn repeats(a: &Rgb8Image, b: &Rgb8Image) -> bool {
    let (mut count, mut sum) = (0u32, 0u32);
    for_pixels(a, b, |a, b| {
        let well_exposed = 24..=231;
        if well_exposed.contains(&a) || well_exposed.contains(&b) {
            count += 1;
            sum += u32::from(a.abs_diff(b));
        }
    });
    count >= FEWEST && f64::from(sum) / f64::from(count) < FROZEN_DIFFERENCE
}

/// Calls with the values of both pictures at pixels of a grid, channel by channel.
fn for_pixels(a: &Rgb8Image, b: &Rgb8Image, mut look: impl FnMut(u8, u8)) {
    let (width, height) = (a.width(), a.height());
    let step = (((width * height) as f64 / PIXELS_LOOKED_AT as f64).sqrt() as usize).max(1);
    for y in (step / 2..height).step_by(step) {
        for (pa, pb) in a.row(y).iter().zip(b.row(y)).skip(step / 2).step_by(step) {
            (0..3).for_each(|c| look(pa[c], pb[c]));
        }
    }
}

/// The one picture without which the others agree with each other: by its colours, or its brightness.
fn odd_one(
    pictures: &[&Rgb8Image],
    times_s: &[f64],
    left: &[usize],
    response: &Response,
) -> Option<(usize, Fault)> {
    if left.len() < 3 {
        return None;
    }
    // ln of the ratios by channel, and as stated, of each pair that shares enough.
    let mut pairs = Vec::new();
    for (n, &i) in left.iter().enumerate() {
        for &j in &left[..n] {
            let by_channel: Option<Vec<f64>> = (0..3)
                .map(|c| measured_ratio_of(pictures[i], pictures[j], response, c..c + 1).map(|m| m.log_ratio))
                .collect();
            if let Some(logs) = by_channel {
                pairs.push((i, j, [logs[0], logs[1], logs[2]], (times_s[i] / times_s[j]).ln()));
            }
        }
    }
    coloured(&pairs, left).or_else(|| off_line(&pairs, left))
}

type PicturePair = (usize, usize, [f64; 3], f64);

/// Ratios of a picture to the others, turned so that it is the first.
fn of_picture(pairs: &[PicturePair], k: usize) -> Vec<PicturePair> {
    let turned = pairs.iter().filter(|p| p.0 == k || p.1 == k);
    turned
        .map(|&(i, j, logs, t)| if i == k { (i, j, logs, t) } else { (j, i, logs.map(|l| -l), -t) })
        .collect()
}

fn tint(logs: [f64; 3]) -> [f64; 2] {
    [logs[0] - logs[1], logs[2] - logs[1]]
}

fn coloured(pairs: &[PicturePair], left: &[usize]) -> Option<(usize, Fault)> {
    let limit = |t: f64| WHITE_BALANCE.0 + WHITE_BALANCE.1 * t.abs();
    let odd = |p: &PicturePair| tint(p.2).iter().any(|t| t.abs() > limit(p.3));
    let k = *left.iter().find(|&&k| {
        let own = of_picture(pairs, k);
        let others = pairs.iter().filter(|p| p.0 != k && p.1 != k);
        !own.is_empty() && own.iter().all(odd) && others.clone().count() > 0 && !others.clone().any(odd)
    })?;
    let own = of_picture(pairs, k);
    let mean = |c: usize| (own.iter().map(|p| tint(p.2)[c]).sum::<f64>() / own.len() as f64).exp();
    Some((k, Fault::WhiteBalance { factors: [mean(0), 1.0, mean(1)] }))
}

/// The picture off the line `measured = slope x stated` on which the others lie. Of two that could be it (of three
/// pictures) the one that leaves the camera's curve nearer to sRGB's.
fn off_line(pairs: &[PicturePair], left: &[usize]) -> Option<(usize, Fault)> {
    let measured = |p: &PicturePair| p.2.iter().sum::<f64>() / 3.0;
    let fit = |pairs: &[&PicturePair]| {
        let slope = pairs.iter().map(|p| measured(p) * p.3).sum::<f64>()
            / pairs.iter().map(|p| p.3 * p.3).sum::<f64>();
        let worst = pairs.iter().map(|p| (measured(p) - slope * p.3).abs()).fold(0.0, f64::max);
        (slope, worst)
    };
    let all: Vec<&PicturePair> = pairs.iter().collect();
    if all.len() < 2 || fit(&all).1 <= OFF_LINE / 2.0 {
        return None;
    }
    let mut best: Option<(f64, usize, f64)> = None;
    for &k in left {
        let others: Vec<&PicturePair> = pairs.iter().filter(|p| p.0 != k && p.1 != k).collect();
        let own = of_picture(pairs, k);
        if others.is_empty() || own.is_empty() {
            continue;
        }
        let (slope, worst) = fit(&others);
        let off: Vec<f64> = own.iter().map(|p| measured(p) - slope * p.3).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let alike = off.iter().all(|o| (o - mean).abs() <= ON_LINE);
        let small = (OFF_LINE..MOST_OFF_LINE).contains(&mean.abs());
        if !(worst <= ON_LINE && alike && small && SLOPES.contains(&slope)) {
            continue;
        }
        let strange = slope.ln().abs();
        if best.is_none_or(|b| strange < b.0) {
            best = Some((strange, k, (mean / slope).exp()));
        }
    }
    best.map(|(_, k, factor)| (k, Fault::Brightness { factor }))
}
