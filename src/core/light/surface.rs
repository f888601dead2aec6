//! The surface that a mirror ball stands on, as a second light meter: its unshadowed radiance, and the true strength
//! of lights that are saturated on the ball, read from the depth of their shadows.

mod sharpen;

use super::{
    clipped::{ClippedLights, MOST_LIGHTS},
    fill::bin_of,
    split::GRAY_PAPER,
    unwrap_ball::{BallShot, block_mean},
};
use crate::math::solve::solve_positive;
use crate::model::light::RadianceSamples;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// The picture is read in square blocks, about this many in all.
const BLOCKS: f64 = 5400.0;
/// The surface is read up to this many radii from the point below the ball's centre where nobody says how far it
/// goes: wide, since a narrow part of it (a sheet of paper, a stain) would stand for all of it.
const REACH_RADII: f64 = 12.0;
/// Fewer blocks than this are no surface.
const FEWEST_POINTS: usize = 32;
/// Parts of the upper half sphere: rows of the whole sphere, and columns.
const BIN_ROWS: usize = 32;
const BIN_COLUMNS: usize = 32;
/// Unknowns: the surface's reflection, and one for each saturated light.
const UNKNOWNS: usize = 1 + MOST_LIGHTS;
/// Relative noise of a block from which weights are reckoned; only its ratio to 1 (the doubt in a half shadow) matters.
const RELATIVE_NOISE: f64 = 0.02;
/// A saturated light counts when its shadow stands out by this many standard deviations: more than the usual three,
/// since what is left after a fit is not only noise.
const SIGNIFICANCE: f64 = 10.0;
/// The same where a picture without the ball has taken the surface's own markings out.
const SIGNIFICANCE_BARE: f64 = 5.0;
/// Least share of the unshadowed surface's radiance that a saturated light's missing part must be: a fainter shadow
/// cannot be told from what the ball hides of the rest, which is known to a percent or so.
const LEAST_SHARE: f64 = 0.01;
/// Largest ratio of a lamp's channels, also where the channels' scales are not those of white light.
const MOST_COLOURFUL: f64 = 10.0;
/// Most rounds of reweighting; about six until the solution stands still to 1e-5.
const ROUNDS: usize = 12;

/// One block of surface pixels.
#[derive(Clone, Copy, Debug)]
struct SurfaceBlock {
    /// Unit vector to the ball's centre.
    to_ball: Vec3,
    /// Sine and cosine of the ball's angular radius.
    ball_sin: f32,
    ball_cos: f32,
    /// Mean of the block.
    radiance: [f64; 3],
}

impl SurfaceBlock {
    /// Share of a small disc of light that the ball leaves visible: a ramp as wide as the disc, in the cosine.
    fn visible(&self, direction: Vec3, radius_rad: f32) -> f32 {
        let width = 2.0 * radius_rad.max(1e-3);
        let ramp = width * self.ball_sin.max(0.5 * width);
        ((self.ball_cos - direction.dot(self.to_ball)) / ramp + 0.5).clamp(0.0, 1.0)
    }
}

/// Part of the upper half sphere.
#[derive(Clone, Copy, Debug, Default)]
struct SphereBin {
    moment: Vec3,
    weight: f32,
    irradiance: Vec3,
}

/// What one channel says.
#[derive(Clone, Copy, Debug, Default)]
struct Solution {
    /// Surface radiance over irradiance.
    reflection: f64,
    /// Surface radiance that each light would add if nothing were in its way and it had its missing part.
    missing: [f64; MOST_LIGHTS],
    /// Noise relative to [`RELATIVE_NOISE`].
    noise: f64,
}

/// Fit of the surface's pixels to the measured light. For a matt surface of one reflectance, seen at x,
///
/// radiance(x) = a sum over samples of V(x, w) L(w) z omega + sum over lights k of b_k V_k(x),
///
/// where V is what the ball lets through. a is the reflection (albedo / pi), b_k = a x the irradiance that saturated
/// light k lacks; a full shadow shows a alone and the lit surface a and b together. Least squares with Cauchy weights
/// on relative residuals (texture, markings and things on the surface are outliers); half shadows count little, since
/// they hang on how a light spreads over its pixels. Then that spread is sharpened from the half shadows
/// (Richardson-Lucy, until the misfit is noise) and the fit is repeated.
#[derive(Debug, Default)]
pub struct SurfaceFit {
    points: Vec<SurfaceBlock>,
    /// Whether the surface's own look was divided out of the points.
    bare: bool,
    /// Irradiance on the unshadowed surface, without what saturated lights lack.
    total: [f64; 3],
    bins: Vec<SphereBin>,
    known: Vec<(Vec3, f32, Vec3)>,
    /// For each point and channel: irradiance of all samples as they are, the ball in the way.
    irradiance: Vec<[f64; 3]>,
    /// For each point: what the ball hides of each cell of the saturated lights.
    hidden: Vec<f32>,
    /// For each point: V_k in one channel.
    lit: Vec<[f64; MOST_LIGHTS]>,
    weights: Vec<f64>,
    order: Vec<f64>,
    in_shadow: Vec<u32>,
    shade: Vec<f64>,
    share: Vec<f64>,
    share_before: Vec<f64>,
    next_share: Vec<f64>,
    reach: Vec<f64>,
}

impl SurfaceFit {
    /// Reads the surface z = 0 around the ball from the picture, without the ball itself. Where a picture without the
    /// ball is given, each block is divided by what that shows there, times the mean of that over the surface: what
    /// is left is the ball's doing.
    pub(super) fn gather(&mut self, shot: &BallShot<'_>) {
        let &BallShot { picture, without_ball, lens, world_from_camera, ball, .. } = shot;
        self.points.clear();
        let mut bare = [0.0; 3];
        let (width, height) = (picture.radiance.width(), picture.radiance.height());
        let side = (((width * height) as f64 / BLOCKS).sqrt().round() as usize).max(1);
        let eye = world_from_camera.translation;
        let to_ball = ball.centre_world - eye;
        // Half a block's diagonal, seen at the ball's distance, keeps blocks off the silhouette.
        let margin = side as f64 * std::f64::consts::FRAC_1_SQRT_2 / lens.fx.min(lens.fy);
        let clear = 1.03 * ball.radius_m + margin * to_ball.length();
        let reach_m = ball.surface_radius_m.unwrap_or(REACH_RADII * ball.radius_m);
        for y in (0..height - height % side).step_by(side) {
            for x in (0..width - width % side).step_by(side) {
                let half = side as f64 / 2.0;
                let Some(ray) = lens.unproject(DVec2::new(x as f64 + half, y as f64 + half)) else {
                    continue;
                };
                let ray = world_from_camera.rotate(ray);
                let distance = -eye.z / ray.z;
                if !(distance > 0.0 && distance.is_finite()) || ray.cross(to_ball).length() < clear {
                    continue;
                }
                let offset = ball.centre_world - (eye + ray * distance);
                let length = offset.length();
                if offset.truncate().length() > reach_m || length <= ball.radius_m {
                    continue;
                }
                let Some(mut radiance) = block_mean(picture, x, y, side) else { continue };
                if let Some(without) = without_ball {
                    let Some(plain) = block_mean(without, x, y, side) else { continue };
                    if plain.iter().any(|c| *c <= 0.0) {
                        continue;
                    }
                    for (c, (radiance, plain)) in radiance.iter_mut().zip(plain).enumerate() {
                        *radiance /= plain;
                        bare[c] += plain;
                    }
                }
                let sine = ball.radius_m / length;
                self.points.push(SurfaceBlock {
                    to_ball: (offset / length).as_vec3(),
                    ball_sin: sine as f32,
                    ball_cos: (1.0 - sine * sine).sqrt() as f32,
                    radiance,
                });
            }
        }
        self.bare = without_ball.is_some();
        if self.bare {
            let mean = bare.map(|sum| sum / self.points.len().max(1) as f64);
            for point in &mut self.points {
                point.radiance.iter_mut().zip(mean).for_each(|(c, mean)| *c *= mean);
            }
        }
    }

    /// The surface's unshadowed radiance under the samples of the upper half sphere; raises saturated samples to what
    /// their shadow says. `None` (and nothing changed) where the picture shows too little surface, or no light falls.
    pub(super) fn solve(
        &mut self,
        clipped: &mut ClippedLights,
        samples: &mut RadianceSamples,
    ) -> Option<[f32; 3]> {
        if self.points.len() < FEWEST_POINTS {
            return None;
        }
        self.gather_bins(samples);
        let total = self
            .known
            .iter()
            .fold([0.0; 3], |sum: [f64; 3], (_, _, e)| std::array::from_fn(|c| sum[c] + f64::from(e[c])));
        self.total = total;
        let widest = self.known.iter().fold(1e-3, |widest: f32, (_, radius, _)| widest.max(*radius));
        let (points, known) = (&self.points, &self.known);
        points
            .par_iter()
            .with_min_len(64)
            .map(|point| irradiance_at(point, known, widest, &total))
            .collect_into_vec(&mut self.irradiance);
        self.find_hidden(clipped);
        let mut solutions = self.fit_channels(clipped)?;
        let read = clipped.known_irradiance(samples);
        while let Some((light, channel)) = too_colourful(&solutions, &read) {
            clipped.trust(light, channel);
            solutions = self.fit_channels(clipped)?;
        }
        if solutions.iter().any(|s| s.missing.iter().any(|b| *b > 0.0)) {
            self.sharpen(&solutions, clipped);
            solutions = self.fit_channels(clipped)?;
            let mut missing = [[0.0; 3]; MOST_LIGHTS];
            for (light, missing) in missing.iter_mut().enumerate() {
                *missing = std::array::from_fn(|c| solutions[c].missing[light] / solutions[c].reflection);
            }
            clipped.add_missing(&missing, samples);
        }
        Some(std::array::from_fn(|c| {
            let solution = &solutions[c];
            (solution.reflection * total[c] + solution.missing.iter().sum::<f64>()) as f32
        }))
    }

    /// The light as some hundred discs: centroid, angular radius and irradiance on the surface.
    fn gather_bins(&mut self, samples: &RadianceSamples) {
        self.bins.clear();
        self.bins.resize(BIN_ROWS * BIN_COLUMNS, SphereBin::default());
        let gray = Vec3::from_array(GRAY_PAPER);
        for (d, c) in samples.directions.iter().zip(&samples.radiance) {
            let direction = Vec3::new(d[0], d[1], d[2]);
            let irradiance = Vec3::new(c[0], c[1], c[2]) * (d[3] * d[2].max(0.0));
            // A little weight by solid angle gives dark parts a centroid too.
            let weight = irradiance.dot(gray) + 1e-9 * d[3];
            let bin = &mut self.bins[bin_of(direction, BIN_ROWS, BIN_COLUMNS)];
            bin.moment += direction * weight;
            bin.weight += weight;
            bin.irradiance += irradiance;
        }
        self.known.clear();
        for bin in self.bins.iter().filter(|bin| bin.weight > 0.0) {
            let length = bin.moment.length();
            // The mean cosine of a disc of radius R is 1 - R^2/4.
            let radius = (4.0 * (1.0 - length / bin.weight).max(0.0)).sqrt().max(0.01);
            self.known.push((bin.moment / length.max(f32::MIN_POSITIVE), radius, bin.irradiance));
        }
    }

    fn find_hidden(&mut self, clipped: &ClippedLights) {
        let cells = clipped.cells.len();
        self.hidden.clear();
        self.hidden.resize(self.points.len() * cells, 0.0);
        if cells == 0 {
            return;
        }
        self.hidden.par_chunks_mut(cells).zip(&self.points).with_min_len(64).for_each(|(row, point)| {
            for (hidden, cell) in row.iter_mut().zip(&clipped.cells) {
                *hidden = 1.0 - point.visible(cell.direction, cell.radius_rad);
            }
        });
    }

    fn fit_channels(&mut self, clipped: &ClippedLights) -> Option<[Solution; 3]> {
        Some([self.fit_channel(0, clipped)?, self.fit_channel(1, clipped)?, self.fit_channel(2, clipped)?])
    }

    /// Fits one channel; drops lights whose shadow does not stand out, the faintest first.
    fn fit_channel(&mut self, channel: usize, clipped: &ClippedLights) -> Option<Solution> {
        let cells = clipped.cells.len();
        let mut whole = [0.0; MOST_LIGHTS];
        for cell in &clipped.cells {
            whole[cell.light] += cell.density * cell.weight[channel];
        }
        self.lit.clear();
        self.lit.extend((0..self.points.len()).map(|p| {
            let mut lit = [0.0; MOST_LIGHTS];
            for (cell, hidden) in clipped.cells.iter().zip(&self.hidden[p * cells..(p + 1) * cells]) {
                lit[cell.light] += cell.density * cell.weight[channel] * (1.0 - f64::from(*hidden));
            }
            std::array::from_fn(|k| if whole[k] > 0.0 { lit[k] / whole[k] } else { 0.0 })
        }));
        let significant = if self.bare { SIGNIFICANCE_BARE } else { SIGNIFICANCE };
        let mut active: [bool; MOST_LIGHTS] = std::array::from_fn(|k| whole[k] > 0.0);
        loop {
            let fitted = self.reweighted(channel, &active);
            let sound = fitted.filter(|(solution, _)| solution.reflection > 0.0);
            let Some((solution, deviation)) = sound else {
                // Lights whose shadow is nowhere in the picture cannot be told from the rest: leave one out.
                let last = active.iter().rposition(|a| *a)?;
                active[last] = false;
                continue;
            };
            let faintest = (0..MOST_LIGHTS)
                .filter(|k| active[*k])
                .map(|k| (k, solution.missing[k] / deviation[k].max(f64::MIN_POSITIVE)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let unshadowed = solution.reflection * self.total[channel] + solution.missing.iter().sum::<f64>();
            match faintest {
                Some((k, significance))
                    if significance < significant || solution.missing[k] < LEAST_SHARE * unshadowed =>
                {
                    active[k] = false;
                }
                _ => return Some(solution),
            }
        }
    }

    /// Least squares with Cauchy weights: the solution, and the standard deviations of the lights' parts.
    fn reweighted(
        &mut self,
        channel: usize,
        active: &[bool; MOST_LIGHTS],
    ) -> Option<(Solution, [f64; MOST_LIGHTS])> {
        self.order.clear();
        self.order.extend(self.points.iter().map(|p| p.radiance[channel]));
        let typical = median(&mut self.order);
        self.weights.clear();
        self.weights.resize(self.points.len(), 1.0);
        let mut x = [0.0; UNKNOWNS];
        let mut solution = Solution::default();
        let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
        // Unknowns that are fitted; one that is left out stands for itself in the normal equations.
        let lights = active.iter().rposition(|a| *a).map_or(0, |last| last + 1);
        for round in 0..ROUNDS {
            normal = [[0.0; UNKNOWNS]; UNKNOWNS];
            let mut right = [0.0; UNKNOWNS];
            for (p, point) in self.points.iter().enumerate() {
                let row = self.row(p, channel, active);
                let (_, variance) = predict(&row, &x, lights, typical, round == 0);
                let weight = self.weights[p] / variance;
                for i in 0..=lights {
                    let weighted = weight * row[i];
                    for j in 0..=i {
                        normal[i][j] += weighted * row[j];
                    }
                    right[i] += weighted * point.radiance[channel];
                }
            }
            for i in 0..UNKNOWNS {
                for j in 0..i {
                    normal[j][i] = normal[i][j];
                }
                if i > 0 && !active[i - 1] {
                    normal[i][i] = 1.0;
                }
            }
            let before = x;
            x = solve_positive(&normal, right)?;
            self.order.clear();
            for (p, point) in self.points.iter().enumerate() {
                let row = self.row(p, channel, active);
                let (fitted, variance) = predict(&row, &x, lights, typical, false);
                let residual = (point.radiance[channel] - fitted).abs() / variance.sqrt();
                self.weights[p] = residual;
                self.order.push(residual);
            }
            // 1.4826: the median of |r| of a normal distribution is 0.6745 sigma.
            solution.noise = (1.4826 * median(&mut self.order)).max(1e-6);
            for weight in &mut self.weights {
                let outlying = *weight / (2.0 * solution.noise);
                *weight = 1.0 / (1.0 + outlying * outlying);
            }
            if (0..UNKNOWNS).all(|i| (x[i] - before[i]).abs() <= 1e-5 * x[i].abs()) {
                break;
            }
        }
        solution.reflection = x[0];
        let mut deviation = [0.0; MOST_LIGHTS];
        for k in 0..MOST_LIGHTS {
            if active[k] {
                solution.missing[k] = x[k + 1];
                let mut unit = [0.0; UNKNOWNS];
                unit[k + 1] = 1.0;
                deviation[k] = solve_positive(&normal, unit)?[k + 1].max(0.0).sqrt() * solution.noise;
            }
        }
        Some((solution, deviation))
    }

    fn row(&self, p: usize, channel: usize, active: &[bool; MOST_LIGHTS]) -> [f64; UNKNOWNS] {
        let mut row = [0.0; UNKNOWNS];
        row[0] = self.irradiance[p][channel];
        for k in 0..MOST_LIGHTS {
            if active[k] {
                row[k + 1] = self.lit[p][k];
            }
        }
        row
    }
}

/// A light that its missing part would make far stronger in one channel than in all others: something else on the
/// surface was taken for its shadow. (Each such light and channel is named once: after that it is not fitted.)
fn too_colourful(solutions: &[Solution; 3], read: &[[f64; 3]; MOST_LIGHTS]) -> Option<(usize, usize)> {
    for (light, read) in read.iter().enumerate() {
        let whole: [f64; 3] =
            std::array::from_fn(|c| read[c] + solutions[c].missing[light] / solutions[c].reflection);
        for c in 0..3 {
            let others = whole[(c + 1) % 3].max(whole[(c + 2) % 3]);
            if solutions[c].missing[light] > 0.0 && whole[c] > MOST_COLOURFUL * others {
                return Some((light, c));
            }
        }
    }
    None
}

/// A point's radiance by the fit so far, and the variance to reckon with there: relative noise, and the full doubt of a
/// half shadow. At the `start` there is no fit yet: then all is as bright as is `typical`.
fn predict(
    row: &[f64; UNKNOWNS],
    x: &[f64; UNKNOWNS],
    lights: usize,
    typical: f64,
    start: bool,
) -> (f64, f64) {
    let mut fitted = 0.0;
    let mut doubt = 0.0;
    for i in 0..=lights {
        fitted += row[i] * x[i];
        if i > 0 {
            let strength = if start { typical } else { x[i] };
            doubt += strength * strength * row[i] * (1.0 - row[i]);
        }
    }
    let level = if start { typical } else { fitted.max(0.01 * typical) };
    let noise = RELATIVE_NOISE * level;
    (fitted, (noise * noise + doubt).max(f64::MIN_POSITIVE))
}

/// Irradiance of the discs on the surface at a point, the ball in the way: all of it less what is hidden (of most
/// discs nothing is, which one comparison tells).
fn irradiance_at(
    point: &SurfaceBlock,
    known: &[(Vec3, f32, Vec3)],
    widest_rad: f32,
    total: &[f64; 3],
) -> [f64; 3] {
    let widest = 2.0 * widest_rad;
    let near = point.ball_cos - 0.5 * widest * point.ball_sin.max(0.5 * widest);
    let mut hidden = Vec3::ZERO;
    for (direction, radius, irradiance) in known {
        if direction.dot(point.to_ball) > near {
            hidden += *irradiance * (1.0 - point.visible(*direction, *radius));
        }
    }
    std::array::from_fn(|c| total[c] - f64::from(hidden[c]))
}

/// Upper median; 0 of nothing. Reorders.
fn median(numbers: &mut [f64]) -> f64 {
    let middle = numbers.len() / 2;
    if numbers.is_empty() {
        return 0.0;
    }
    *numbers.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lamp_of_one_channel_alone_is_not_believed() {
        let solution = |b| Solution { reflection: 0.5, missing: [0.0, b, 0.0, 0.0], noise: 1.0 };
        let read = [[0.0; 3], [1.0, 1.0, 0.5], [0.0; 3], [0.0; 3]];
        // Red would be 1 + 5 / 0.5 = 11 for a green of 1; then 9; then all grow alike.
        assert_eq!(too_colourful(&[5.0, 0.0, 0.0].map(solution), &read), Some((1, 0)));
        assert_eq!(too_colourful(&[4.0, 0.0, 0.0].map(solution), &read), None);
        assert_eq!(too_colourful(&[5.0, 5.0, 5.0].map(solution), &read), None);
    }
}
