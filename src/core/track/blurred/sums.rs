//! Sums of one step of Gauss and Newton, and what follows from them.

use super::super::{normal, tag_pose::homography_from_square, template::MASKS};
use crate::math::solve::solve_positive;
use glam::{DMat3, DVec2};

/// Unknowns: eight coordinates, the logarithm of the blur, three of white and three of black (level and slopes along
/// the tag), one beyond each side of the rim.
pub const UNKNOWNS: usize = 19;
/// Where the levels begin among them.
pub const LEVELS: usize = 9;
/// How many they are: three of white, three of black, four beyond the rim.
pub const LEVEL_COUNT: usize = UNKNOWNS - LEVELS;
/// Numbers that are added up at once.
const LANES: usize = 4;
/// A row of the equations: derivatives by all unknowns, then the residual.
const ROW: usize = UNKNOWNS + 1;
/// Rows are added in single precision, so many at a time.
const RUN: usize = 256;
/// Corners move by this for a difference, pixels.
const NUDGE_PX: f64 = 0.01;

/// What each level weighs in a pixel's light.
pub fn weights(shares: &[f32; MASKS], [u, v]: [f32; 2]) -> [f32; LEVEL_COUNT] {
    let [white, a, b, c, d] = *shares;
    let black = 1.0 - white - (a + b + c + d);
    [white, white * u, white * v, black, black * u, black * v, a, b, c, d]
}

/// Products of rows, added up.
pub struct FitSums {
    run: [[[f32; LANES]; ROW / LANES]; ROW],
    in_run: usize,
    total: [[f64; ROW]; ROW],
}

impl FitSums {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { run: [[[0.0; LANES]; ROW / LANES]; ROW], in_run: 0, total: [[0.0; ROW]; ROW] }
    }

    /// Adds a pixel: derivatives of its value by the corners and the blur, by the levels, the residual, and how far it is trusted.
    pub fn add(&mut self, place: &[f32; LEVELS], levels: &[f32; LEVEL_COUNT], residual: f32, trust: f32) {
        let mut row = [[0.0f32; LANES]; ROW / LANES];
        let flat = row.as_flattened_mut();
        flat[..LEVELS].copy_from_slice(place);
        flat[LEVELS..UNKNOWNS].copy_from_slice(levels);
        flat[UNKNOWNS] = residual;
        for i in 0..ROW {
            let weighted = trust * row[i / LANES][i % LANES];
            for (sum, part) in self.run[i].iter_mut().zip(&row).take(i / LANES + 1) {
                for lane in 0..LANES {
                    sum[lane] += weighted * part[lane];
                }
            }
        }
        self.in_run += 1;
        if self.in_run == RUN {
            self.flush();
        }
    }

    fn flush(&mut self) {
        for (total, run) in self.total.iter_mut().zip(&mut self.run) {
            for (total, run) in total.iter_mut().zip(run.as_flattened_mut()) {
                *total += f64::from(*run);
                *run = 0.0;
            }
        }
        self.in_run = 0;
    }

    /// The normal equations.
    pub fn normal(mut self) -> Option<Normal> {
        self.flush();
        let mut normal = Normal { matrix: [[0.0; UNKNOWNS]; UNKNOWNS], right: [0.0; UNKNOWNS], cost: 0.0 };
        for i in 0..UNKNOWNS {
            for j in 0..=i {
                normal.matrix[i][j] = self.total[i][j];
                normal.matrix[j][i] = self.total[i][j];
            }
            normal.right[i] = self.total[UNKNOWNS][i];
        }
        normal.cost = self.total[UNKNOWNS][UNKNOWNS];
        normal.cost.is_finite().then_some(normal)
    }
}

/// Normal equations.
pub struct Normal {
    /// Products of derivatives.
    pub matrix: [[f64; UNKNOWNS]; UNKNOWNS],
    /// Products of derivatives and residuals.
    pub right: [f64; UNKNOWNS],
    /// Sum of the residuals' costs, squared 8-bit values.
    pub cost: f64,
}

impl Normal {
    /// The damped step.
    pub fn step(&self, damping: f64) -> Option<[f64; UNKNOWNS]> {
        solve_positive(&self.damped(damping), self.right)
    }

    fn damped(&self, damping: f64) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let mut matrix = self.matrix;
        let largest = (LEVELS..UNKNOWNS).map(|i| matrix[i][i]).fold(0.0, f64::max);
        for (i, row) in matrix.iter_mut().enumerate() {
            row[i] *= 1.0 + damping;
            if i >= LEVELS {
                // What lies beyond the rim may be out of sight.
                row[i] += 1e-6 * largest;
            }
        }
        matrix[8][8] += 1e-9;
        matrix
    }

    /// The step of the levels alone.
    pub fn step_of_levels(&self) -> Option<[f64; LEVEL_COUNT]> {
        let matrix = self.damped(1e-6);
        let inner = std::array::from_fn(|i| std::array::from_fn(|j| matrix[LEVELS + i][LEVELS + j]));
        solve_positive(&inner, std::array::from_fn(|i| self.right[LEVELS + i]))
    }

    /// The half width that holds 68.27 % of the errors of the corners' coordinates, from each one's own variance.
    pub fn sigma_px(&self, deviation: f64, floor_px: f64) -> Option<f64> {
        let matrix = self.damped(0.0);
        let mut variances = [0.0; 8];
        for (i, variance) in variances.iter_mut().enumerate() {
            let mut unit = [0.0; UNKNOWNS];
            unit[i] = 1.0;
            *variance = solve_positive(&matrix, unit)?[i] * deviation * deviation + floor_px * floor_px;
        }
        Some(normal::half_width(&variances))
    }
}

/// How the light at a point of the picture changes with each coordinate of the corners.
pub struct CornerPull {
    pixel_from_tag: DMat3,
    middle: DVec2,
    /// Derivatives of the homography's nine numbers, row by row, by each coordinate.
    by_corner: [[f32; 8]; 9],
}

impl CornerPull {
    /// For a tag seen at these corners; places are counted from `middle`, which keeps numbers small.
    pub fn of(corners_px: &[DVec2; 4], middle: DVec2) -> Option<Self> {
        let here = corners_px.map(|c| c - middle);
        let pixel_from_tag = homography_from_square(&here)?;
        let mut by_corner = [[0.0; 8]; 9];
        for k in 0..8 {
            let moved = |by: f64| {
                let mut corners = here;
                corners[k / 2][k % 2] += by;
                homography_from_square(&corners)
            };
            let change = (moved(NUDGE_PX)? - moved(-NUDGE_PX)?) * (0.5 / NUDGE_PX);
            for (at, slot) in by_corner.iter_mut().enumerate() {
                slot[k] = change.col(at % 3)[at / 3] as f32;
            }
        }
        Some(Self { pixel_from_tag, middle, by_corner })
    }

    /// The change of light at the picture's point `p`, which lies on the tag at `place`, where light has this gradient.
    pub fn at(&self, p: DVec2, [u, v]: [f32; 2], gradient: [f32; 2]) -> [f32; 8] {
        let z = &self.pixel_from_tag;
        let depth = z.x_axis.z as f32 * u + z.y_axis.z as f32 * v + z.z_axis.z as f32;
        let p = p - self.middle;
        let [gx, gy] = gradient.map(|g| -g / depth);
        let pull = [gx, gy, -(gx * p.x as f32 + gy * p.y as f32)];
        let mut change = [0.0f32; 8];
        for (row, pull) in pull.into_iter().enumerate() {
            for (column, t) in [u, v, 1.0].into_iter().enumerate() {
                let weight = pull * t;
                for (slot, by) in change.iter_mut().zip(&self.by_corner[3 * row + column]) {
                    *slot += weight * by;
                }
            }
        }
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_pull_of_corners_is_the_difference_of_pictures() {
        let corners = [(20.0, 80.0), (85.0, 90.0), (95.0, 25.0), (15.0, 10.0)].map(|(x, y)| DVec2::new(x, y));
        let pull = CornerPull::of(&corners, DVec2::splat(50.0)).unwrap();
        let at = |corners: &[DVec2; 4], place: [f32; 2]| {
            let [u, v] = place.map(f64::from);
            let q = homography_from_square(corners).unwrap() * DVec3::new(u, v, 1.0);
            DVec2::new(q.x, q.y) / q.z
        };
        for place in [[0.0, 0.0], [-0.8, 0.3], [1.1, -1.2]] {
            // A ramp of light: it moves along with the tag's point.
            let gradient = [0.7f32, -0.4];
            let got = pull.at(at(&corners, place), place, gradient);
            for (k, got) in got.into_iter().enumerate() {
                let mut moved = corners;
                moved[k / 2][k % 2] += 0.001;
                let by = (at(&moved, place) - at(&corners, place)) / 0.001;
                let want = -(by.x * f64::from(gradient[0]) + by.y * f64::from(gradient[1]));
                assert!((f64::from(got) - want).abs() < 1e-3, "{place:?} {k}: {got} {want}");
            }
        }
    }
}
