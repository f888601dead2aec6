//! Corners of a dark square to a few hundredths of a pixel: where does the edge lie in *linear* light?
//!
//! The C library weighs gradients of the picture as encoded. A response such as sRGB pushes every edge towards
//! the dark side by up to 0.2 px, so a square looks 0.4 px smaller than it is and its distance wrong by that
//! share. Here each profile across an edge is put through the inverse response and its step is placed where a
//! sharp step of the same light would be: with dark and bright level D and B, at `r - integral (I - D) / (B - D)`
//! over -r..r. That is exact for any symmetric blur, the pixel's own box included.

use super::normal;
use crate::model::{image::Image, response::Response};
use glam::DVec2;

/// Profiles across one edge: from one for every pixel of length, at least and at most this many.
const PROFILES: (usize, usize) = (8, 96);
/// Samples across a profile are this far apart, pixels.
const STEP_PX: f64 = 0.5;
/// Longest reach of a profile on either side, pixels.
const REACH_PX: f64 = 3.5;
/// Shortest reach: with less the levels on either side cannot be told.
const MIN_REACH_PX: f64 = 2.0;
/// Share of an edge at either end that is left out: corners are rounded by blur.
const END_SHARE: f64 = 0.08;
/// 8-bit values from here on count as saturated.
const SATURATED: f64 = 253.0;
/// Passes: the second starts from the lines of the first.
const PASSES: usize = 2;
/// Profiles that reach this share of a blur's standard deviation and less see its levels: measured on drawn tags, where
/// wider blurs make the edges wander by more than their scatter tells.
const SEEN_WIDTH: f64 = 0.2;
/// A square whose area is less than this share of its longest side's square is seen so much from the side that the far
/// sides of its cells come into the profiles: measured on drawn tags, whose corners are then off by 0.1 to 0.3 px.
const LEAST_AREA: f64 = 0.5;
/// What even a perfect fit may be wrong by (quantisation, sampling), measured on drawn tags, pixels.
const FLOOR_PX: f64 = 0.012;
/// Samples of the longest profile.
const SLOTS: usize = 2 * (REACH_PX / STEP_PX) as usize + 1;

/// Linear light (0 to 1) of each 8-bit value by the sRGB curve.
pub fn srgb_table() -> [f32; 256] {
    let mut table = [0.0; 256];
    for (value, slot) in table.iter_mut().enumerate() {
        let v = value as f64 / 255.0;
        *slot = (if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32;
    }
    table
}

/// Linear light of each 8-bit value as a camera's response has it (green; 255 is 1).
pub fn table_of_response(response: &Response) -> [f32; 256] {
    let green = &response.log_exposure()[1];
    green.map(|g| (g - green[255]).exp())
}

/// Memory of the refinement, reused from tag to tag.
#[derive(Clone, Debug, Default)]
pub struct EdgeScratch {
    /// Position along the edge and offset across it, pixels.
    points: Vec<(f64, f64)>,
    sorted: Vec<f64>,
    /// Sum of an edge's profiles, each from 0 (dark) to 1 (bright).
    profile: [f64; SLOTS],
}

/// Corners where the fitted edges meet, and how sure each is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefinedCorners {
    /// Continuous pixels, in the order of the input.
    pub corners_px: [DVec2; 4],
    /// Standard deviation of one coordinate, from the scatter of the edges' points, pixels.
    pub sigma_px: f64,
    /// Standard deviation of the blur across the widest edge, the pixel's own box included, pixels.
    pub width_px: f64,
    /// Whether each edge was seen on either side as far as its blur reaches. Where not, `blurred` knows better.
    pub seen_whole: bool,
}

/// A line: through `middle`, along the unit vector `along`.
#[derive(Clone, Copy)]
struct Line {
    middle: DVec2,
    along: DVec2,
    /// Standard deviation of its ends across it, pixels.
    sigma_px: f64,
    /// Standard deviation of its blur, pixels.
    width_px: f64,
    /// How far its profiles reached on either side, pixels.
    reach_px: f64,
}

/// Refines the outer corners of a black tag36h11 square (its border one eighth of the side wide, its rim as wide).
/// `None` where an edge shows no clear step, leaves the picture, or a corner would move more than
/// `max_move_px`.
pub fn refine_corners(
    gray: &Image<u8>,
    linear_of_value: &[f32; 256],
    corners_px: &[DVec2; 4],
    max_move_px: f64,
    scratch: &mut EdgeScratch,
) -> Option<RefinedCorners> {
    let mut corners = *corners_px;
    let mut sigma_px = 0.0f64;
    let (mut width_px, mut seen_whole) = (0.0, false);
    for _ in 0..PASSES {
        let middle = corners.iter().sum::<DVec2>() / 4.0;
        let nowhere = Line { middle, along: DVec2::X, sigma_px: 0.0, width_px: 0.0, reach_px: 0.0 };
        let mut lines = [nowhere; 4];
        for (edge, line) in lines.iter_mut().enumerate() {
            let ends = [corners[edge], corners[(edge + 1) % 4]];
            // The cell across this edge is as deep as the square is, over eight.
            let across =
                (corners[(edge + 2) % 4] + corners[(edge + 3) % 4]) / 2.0 - (ends[0] + ends[1]) / 2.0;
            *line = edge_line(gray, linear_of_value, ends, middle, across.length() / 8.0, scratch)?;
        }
        sigma_px = 0.0;
        for i in 0..4 {
            let (before, after) = (lines[(i + 3) % 4], lines[i]);
            let corner = intersection(before, after)?;
            if corner.distance(corners_px[i]) > max_move_px {
                return None;
            }
            corners[i] = corner;
            sigma_px += (before.sigma_px.powi(2) + after.sigma_px.powi(2)) / 8.0;
        }
        sigma_px = sigma_px.sqrt();
        width_px = lines.iter().fold(0.0, |m: f64, line| m.max(line.width_px));
        let whole = |line: &Line| line.width_px <= SEEN_WIDTH * line.reach_px;
        seen_whole = lines.iter().all(whole) && area_share(&corners) >= LEAST_AREA;
    }
    let sigma_px = sigma_px.hypot(FLOOR_PX);
    Some(RefinedCorners { corners_px: corners, sigma_px, width_px, seen_whole })
}

/// Area of a square as seen, over the square of its longest side.
pub fn area_share(corners: &[DVec2; 4]) -> f64 {
    let area = 0.5 * (corners[2] - corners[0]).perp_dot(corners[3] - corners[1]).abs();
    let longest = (0..4).map(|i| corners[i].distance_squared(corners[(i + 1) % 4])).fold(0.0, f64::max);
    area / longest
}

fn intersection(a: Line, b: Line) -> Option<DVec2> {
    let sine = a.along.perp_dot(b.along);
    // Below 5 degrees the lines of two neighbouring edges mean nothing.
    (sine.abs() > 0.087).then(|| a.middle + a.along * ((b.middle - a.middle).perp_dot(b.along) / sine))
}

/// Fits one edge of a square. `cell_px` is the depth of its border.
fn edge_line(
    gray: &Image<u8>,
    linear_of_value: &[f32; 256],
    ends: [DVec2; 2],
    middle_of_square: DVec2,
    cell_px: f64,
    scratch: &mut EdgeScratch,
) -> Option<Line> {
    let length = ends[0].distance(ends[1]);
    // The profile must stay within the black border and the white rim, whose far sides are blurred as well (by
    // the pixel and by interpolation, a pixel in all); the same pixel is needed on either side of this edge.
    let reach = (cell_px - 1.0).min(REACH_PX);
    if !(length > 8.0 && reach >= MIN_REACH_PX) {
        return None;
    }
    let along = (ends[1] - ends[0]) / length;
    let middle = (ends[0] + ends[1]) / 2.0;
    let mut outward = along.perp();
    if outward.dot(middle - middle_of_square) < 0.0 {
        outward = -outward;
    }
    let half = (reach / STEP_PX).floor() as i32;
    let count = (length as usize).clamp(PROFILES.0, PROFILES.1);
    let mut saturated = 0usize;
    scratch.points.clear();
    scratch.profile = [0.0; SLOTS];
    for k in 0..count {
        let share = END_SHARE + (1.0 - 2.0 * END_SHARE) * (k as f64 + 0.5) / count as f64;
        let along_px = (share - 0.5) * length;
        let Some((offset, clipped)) = step_position(
            gray,
            linear_of_value,
            [middle + along * along_px, outward],
            half,
            &mut scratch.profile,
        ) else {
            continue;
        };
        saturated += usize::from(clipped);
        scratch.points.push((along_px, offset));
    }
    if scratch.points.len() * 2 < count {
        return None;
    }
    let fit = robust_line(scratch)?;
    let (slope, offset) = (fit.slope, fit.offset);
    let mut sigma_px = fit.sigma_px;
    if saturated * 4 > scratch.points.len() {
        // A clipped bright side hides how the pixel was shared: the edge wanders into the dark by up to this.
        sigma_px = sigma_px.hypot(0.2);
    }
    let width_px = width_of(&scratch.profile[..(2 * half + 1) as usize], scratch.points.len());
    let (middle, along) = (middle + outward * offset, (along + outward * slope).normalize());
    Some(Line { middle, along, sigma_px, width_px, reach_px: reach })
}

/// Standard deviation of the blur of an edge from the sum of `count` of its profiles: by how much the steepest two pixels
/// rise. Too small where the profiles end within the blur, but then too large to have been seen whole as well.
fn width_of(profile: &[f64], count: usize) -> f64 {
    let window = (2.0 / STEP_PX) as usize;
    let rise = profile.windows(window + 1).map(|w| w[window] - w[0]).fold(0.0, f64::max) / count as f64;
    // The share of a normal distribution within one pixel of its middle, turned round by halving.
    let (mut low, mut high) = (0.05, 20.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if normal::within(1.0 / middle) > rise { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Where the step from dark to bright lies along a profile (pixels from its middle, positive outwards) and
/// whether the bright side is saturated. `None` outside the picture or without a clear step.
fn step_position(
    gray: &Image<u8>,
    linear_of_value: &[f32; 256],
    [at, outward]: [DVec2; 2],
    half: i32,
    sum: &mut [f64; SLOTS],
) -> Option<(f64, bool)> {
    let mut profile = [0.0f64; SLOTS];
    let count = (2 * half + 1) as usize;
    for (k, slot) in profile[..count].iter_mut().enumerate() {
        *slot = sample(gray, linear_of_value, at + outward * (f64::from(k as i32 - half) * STEP_PX))?;
    }
    let profile = &profile[..count];
    // The levels are read from the outermost quarter on either side.
    let outer = (count / 4).max(1);
    let dark = profile[..outer].iter().sum::<f64>() / outer as f64;
    let bright = profile[count - outer..].iter().sum::<f64>() / outer as f64;
    let white = f64::from(linear_of_value[255]) - f64::from(linear_of_value[0]);
    // A step of 1.5 % of the full range (8 % of it where the curve is sRGB's) is the least to be trusted.
    if bright - dark < 0.004 * white.abs() {
        return None;
    }
    let mut integral = 0.0;
    for (k, &level) in profile.iter().enumerate() {
        let weight = if k == 0 || k + 1 == count { 0.5 } else { 1.0 };
        integral += weight * (level - dark) / (bright - dark);
    }
    let reach = f64::from(half) * STEP_PX;
    let offset = reach - integral * STEP_PX;
    let clipped = bright >= f64::from(linear_of_value[SATURATED as usize]);
    if offset.abs() >= reach * 0.8 {
        return None;
    }
    for (sum, level) in sum.iter_mut().zip(profile) {
        *sum += (level - dark) / (bright - dark);
    }
    Some((offset, clipped))
}

/// Linear light at a continuous pixel, bilinear between pixel centres; `None` outside.
fn sample(gray: &Image<u8>, linear_of_value: &[f32; 256], at: DVec2) -> Option<f64> {
    let p = at - 0.5;
    let low = p.floor();
    let (x, y) = (low.x as usize, low.y as usize);
    if low.x < 0.0 || low.y < 0.0 || x + 1 >= gray.width() || y + 1 >= gray.height() {
        return None;
    }
    let t = p - low;
    let value = |i, j| f64::from(linear_of_value[usize::from(*gray.at(i, j))]);
    let top = value(x, y) * (1.0 - t.x) + value(x + 1, y) * t.x;
    let bottom = value(x, y + 1) * (1.0 - t.x) + value(x + 1, y + 1) * t.x;
    Some(top * (1.0 - t.y) + bottom * t.y)
}

struct LineFit {
    slope: f64,
    offset: f64,
    sigma_px: f64,
}

/// Least squares `offset = a + b along`, twice: the second time without points further than three robust
/// standard deviations from the first.
fn robust_line(scratch: &mut EdgeScratch) -> Option<LineFit> {
    let mut limit = f64::INFINITY;
    let (mut slope, mut offset) = (0.0, median(scratch.points.iter().map(|p| p.1), &mut scratch.sorted)?);
    let mut sigma_px = 0.0;
    for pass in 0..3 {
        if pass > 0 {
            let spread = median(
                scratch.points.iter().map(|p| (p.1 - offset - slope * p.0).abs()),
                &mut scratch.sorted,
            )?;
            // 1.4826 turns a median of absolute deviations into a standard deviation.
            limit = (3.0 * 1.4826 * spread).max(0.06);
        }
        let (mut n, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for &(x, y) in &scratch.points {
            if (y - offset - slope * x).abs() <= limit {
                n += 1.0;
                sx += x;
                sy += y;
                sxx += x * x;
                sxy += x * y;
            }
        }
        let spread_x = sxx - sx * sx / n;
        if !(n >= 4.0 && spread_x > 1.0) {
            return None;
        }
        let new_slope = (sxy - sx * sy / n) / spread_x;
        let new_offset = (sy - new_slope * sx) / n;
        let (mut squares, mut end) = (0.0, 0.0f64);
        for &(x, y) in &scratch.points {
            if (y - offset - slope * x).abs() <= limit {
                squares += (y - new_offset - new_slope * x).powi(2);
                end = end.max(x.abs());
            }
        }
        (slope, offset) = (new_slope, new_offset);
        let variance = squares / (n - 2.0);
        // Of the line at its ends, for points independent every other profile.
        sigma_px = (2.0 * variance * (1.0 / n + end * end / spread_x)).sqrt();
    }
    Some(LineFit { slope, offset, sigma_px })
}

fn median(values: impl Iterator<Item = f64>, sorted: &mut Vec<f64>) -> Option<f64> {
    sorted.clear();
    sorted.extend(values);
    if sorted.is_empty() {
        return None;
    }
    let half = sorted.len() / 2;
    Some(*sorted.select_nth_unstable_by(half, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::super::drawing::{corners_of, draw};
    use super::*;

    fn encode(linear: f64) -> f64 {
        if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
    }

    #[test]
    fn corners_of_drawn_tags_come_back_to_a_few_hundredths() {
        let table = srgb_table();
        let mut worst = 0.0f64;
        for (k, side) in [32.0, 63.7, 110.3].into_iter().enumerate() {
            for turn in 0..6 {
                let angle = 0.13 + 0.7 * f64::from(turn);
                let mut truth = corners_of(DVec2::new(100.3 + k as f64 * 0.31, 99.6), side, angle);
                // A little perspective.
                truth[2] += DVec2::new(-0.06, 0.05) * side;
                let gray = draw(200, 200, turn as usize % 3, &truth, encode);
                let start = truth.map(|c| c + DVec2::new(0.4, -0.5));
                let got = refine_corners(&gray, &table, &start, 2.0, &mut EdgeScratch::default()).unwrap();
                for (a, b) in got.corners_px.iter().zip(&truth) {
                    worst = worst.max(a.distance(*b));
                }
            }
        }
        // Measured: 0.035 px (at 32 px).
        assert!(worst < 0.05, "{worst}");
    }

    #[test]
    fn the_srgb_response_gives_the_srgb_table() {
        let (from_response, table) = (table_of_response(&Response::srgb()), srgb_table());
        // The response takes 0 as a quarter.
        assert!((from_response[0] - table[1] * 0.25).abs() < 1e-6);
        for z in 1..256 {
            assert!((from_response[z] - table[z]).abs() < 1e-6, "{z}");
        }
    }

    #[test]
    fn a_flat_picture_and_the_border_are_refused() {
        let table = srgb_table();
        let flat = Image::filled(100, 100, 90u8);
        let mut scratch = EdgeScratch::default();
        let inside = corners_of(DVec2::new(50.0, 50.0), 40.0, 0.1);
        assert_eq!(refine_corners(&flat, &table, &inside, 2.0, &mut scratch), None);
        let outside = corners_of(DVec2::new(5.0, 50.0), 40.0, 0.1);
        let drawn = draw(100, 100, 0, &outside, encode);
        assert_eq!(refine_corners(&drawn, &table, &outside, 2.0, &mut scratch), None);
        let nan = [DVec2::NAN; 4];
        assert_eq!(refine_corners(&drawn, &table, &nan, 2.0, &mut scratch), None);
        let point = [DVec2::splat(50.0); 4];
        assert_eq!(refine_corners(&drawn, &table, &point, 2.0, &mut scratch), None);
    }
}
