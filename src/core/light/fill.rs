//! What a mirror ball does not show: the cone behind it, parts outside the picture, and what is below the horizon.
//! Shared by both engines.

use super::unwrap_ball::{BallView, FILL_DIRECTIONS, cell, reflect_corner, sane_radiance};
use crate::math::{
    charts::ball_polar_angle, lens::Lens, pose::Pose, solve::solve_positive, sphere::sphere_point_reflecting,
    spiral,
};
use crate::model::{
    image::{FILLED, HdrImage, LOWER_BOUND, NOT_FINITE},
    light::RadianceSamples,
    rig::MirrorBall,
};
use glam::{DVec2, DVec3, Vec3};

/// Rows of equal height in z of the coarse grid that is extrapolated from.
const BIN_ROWS: usize = 16;
/// Bins of a row, equal in azimuth.
const BIN_COLUMNS: usize = 32;

/// The camera's own view of what lies behind the ball.
pub struct PastTheBall<'a> {
    /// Linear picture.
    pub picture: &'a HdrImage,
    /// Intrinsics and distortion, pixels.
    pub lens: &'a Lens,
    /// Takes points of the camera's frame to the world, metres.
    pub world_from_camera: &'a Pose,
    /// What is in the way.
    pub ball: &'a MirrorBall,
}

impl PastTheBall<'_> {
    /// Mean radiance, over one cell of the fill grid, of what the camera sees in a far direction; `None` where
    /// the ball is in the way or most of the cell is outside the picture.
    fn radiance(&self, direction: DVec3) -> Option<[f32; 3]> {
        const TAPS: usize = 4;
        let to_ball = self.ball.centre_world - self.world_from_camera.translation;
        // Side of a cell, in radians.
        let side = (4.0 * std::f64::consts::PI / FILL_DIRECTIONS as f64).sqrt();
        let distance = to_ball.length();
        let silhouette = (self.ball.radius_m / distance).min(1.0).asin();
        if to_ball.angle_between(direction) < silhouette + 0.75 * side {
            return None;
        }
        let centre = self.lens.project(self.world_from_camera.rotation.conjugate() * direction)?;
        let step = DVec2::new(self.lens.fx, self.lens.fy) * (side / TAPS as f64);
        let (mut sum, mut count) = ([0.0_f64; 3], 0_u32);
        for tap in 0..TAPS * TAPS {
            let offset =
                DVec2::new((tap % TAPS) as f64, (tap / TAPS) as f64) - DVec2::splat((TAPS - 1) as f64 / 2.0);
            let pixel = centre + offset * step;
            let inside = pixel.x >= 0.0
                && pixel.y >= 0.0
                && pixel.x < f64::from(self.lens.width)
                && pixel.y < f64::from(self.lens.height);
            if !inside {
                continue;
            }
            let (radiance, bits) = sane_radiance(self.picture, pixel.x as usize, pixel.y as usize);
            if bits & NOT_FINITE == 0 {
                for (sum, c) in sum.iter_mut().zip(radiance) {
                    *sum += f64::from(c);
                }
                count += 1;
            }
        }
        (2 * count as usize > TAPS * TAPS).then(|| sum.map(|c| (c / f64::from(count)) as f32))
    }
}

/// A part of the sphere of known light.
#[derive(Clone, Copy, Debug, Default)]
struct FillBin {
    omega: f32,
    moment: Vec3,
    log_radiance: Vec3,
}

/// The same, as it is extrapolated from.
#[derive(Clone, Copy, Debug)]
struct Known {
    direction: Vec3,
    radiance: Vec3,
    omega: f32,
}

/// Fills what is not seen; keeps its memory.
#[derive(Debug, Default)]
pub struct BallFill {
    bins: Vec<FillBin>,
    known: Vec<Known>,
    unseen: Vec<Vec3>,
}

impl BallFill {
    /// Appends samples for all directions that `cells` (width x height of `view`, solid angle in w) do not show, so that
    /// the solid angles in `out` sum to 4 pi, or with `above_horizon` to the 2 pi above z = 0. Returns the solid angle,
    /// in steradians, that had to be extrapolated (and has the flag `FILLED`).
    ///
    /// The extrapolation is smooth: locally a plane through the logarithmic means of 512 parts of the sphere (so that
    /// small bright lights are not smeared).
    pub fn append(
        &mut self,
        view: &BallView,
        cells: &[[f32; 4]],
        past: &PastTheBall<'_>,
        above_horizon: bool,
        out: &mut RadianceSamples,
    ) -> f64 {
        let seen_sr: f64 = out.directions.iter().map(|d| f64::from(d[3])).sum();
        let rest_sr = std::f64::consts::TAU * if above_horizon { 1.0 } else { 2.0 } - seen_sr;
        self.find_unseen(view, cells, past, above_horizon);
        if self.unseen.is_empty() || rest_sr <= 0.0 {
            // A remainder too small for the grid: spread it over what is seen.
            let scale = ((seen_sr + rest_sr) / seen_sr) as f32;
            for direction in &mut out.directions {
                direction[3] *= scale;
            }
            return 0.0;
        }
        self.gather_known(out);
        let omega = rest_sr / self.unseen.len() as f64;
        let mut extrapolated = 0;
        for direction in &self.unseen {
            let (radiance, bits) = match past.radiance(direction.as_dvec3()) {
                Some(radiance) => (radiance, 0),
                None => {
                    extrapolated += 1;
                    (self.extrapolate(*direction), FILLED)
                }
            };
            out.directions.push([direction.x, direction.y, direction.z, omega as f32]);
            out.radiance.push([radiance[0], radiance[1], radiance[2], f32::from(bits)]);
        }
        omega * f64::from(extrapolated)
    }

    fn find_unseen(
        &mut self,
        view: &BallView,
        cells: &[[f32; 4]],
        past: &PastTheBall<'_>,
        above_horizon: bool,
    ) {
        let (ball, eye) = (past.ball, past.world_from_camera.translation);
        let camera_from_world = past.world_from_camera.inverse();
        let to_eye = (eye - ball.centre_world).normalize_or(DVec3::Z);
        let q = ball.radius_m / eye.distance(ball.centre_world);
        // Well inside the rim of a ball that is wholly in the picture all is seen: no need to look.
        let safe = ball_polar_angle(q, 0.9).filter(|_| view.whole).map_or(2.0, f64::cos);
        self.unseen.clear();
        for j in 0..FILL_DIRECTIONS {
            let direction = spiral::direction(j, FILL_DIRECTIONS);
            if above_horizon && direction.z <= 0.0 {
                // The spiral runs downwards.
                break;
            }
            if direction.dot(to_eye) > safe {
                continue;
            }
            let seen = sphere_point_reflecting(eye, ball.centre_world, ball.radius_m, direction)
                .and_then(|point| past.lens.project(camera_from_world.transform(point)))
                .is_some_and(|pixel| {
                    let (x, y) = (pixel.x - view.x as f64, pixel.y - view.y as f64);
                    let inside = x >= 0.0 && y >= 0.0 && x < view.width as f64 && y < view.height as f64;
                    inside && cells[y as usize * view.width + x as usize][3] > 0.0
                });
            if !seen {
                self.unseen.push(direction.as_vec3());
            }
        }
    }

    /// Logarithmic means over the parts of the sphere.
    fn gather_known(&mut self, samples: &RadianceSamples) {
        let (mut mean, mut total) = (Vec3::ZERO, 0.0);
        for (d, c) in samples.directions.iter().zip(&samples.radiance) {
            mean += Vec3::new(c[0], c[1], c[2]) * d[3];
            total += d[3];
        }
        // Black is a thousandth of the mean.
        let floor = (mean / total * 1e-3).max(Vec3::splat(f32::MIN_POSITIVE));
        self.bins.clear();
        self.bins.resize(BIN_ROWS * BIN_COLUMNS, FillBin::default());
        for (d, c) in samples.directions.iter().zip(&samples.radiance) {
            let bin = &mut self.bins[bin_of(Vec3::new(d[0], d[1], d[2]), BIN_ROWS, BIN_COLUMNS)];
            let light = Vec3::new(c[0], c[1], c[2]).max(floor);
            bin.omega += d[3];
            bin.moment += Vec3::new(d[0], d[1], d[2]) * d[3];
            bin.log_radiance += Vec3::new(light.x.ln(), light.y.ln(), light.z.ln()) * d[3];
        }
        self.known.clear();
        for bin in self.bins.iter().filter(|bin| bin.omega > 0.0) {
            let mean = bin.log_radiance / bin.omega;
            self.known.push(Known {
                direction: bin.moment.normalize_or_zero(),
                radiance: Vec3::new(mean.x.exp(), mean.y.exp(), mean.z.exp()),
                omega: bin.omega,
            });
        }
    }

    /// A plane through the parts around a direction (least squares in the offset from it, weighted by solid angle over
    /// the fourth power of the distance), read at the direction; never beyond what is known anywhere.
    fn extrapolate(&self, direction: Vec3) -> [f32; 3] {
        let mut normal = [[0.0; 4]; 4];
        let mut right = [[0.0; 4]; 3];
        let (mut least, mut most) = (Vec3::INFINITY, Vec3::ZERO);
        for known in &self.known {
            let offset = (known.direction - direction).as_dvec3();
            // 0.01: no nearer than a tenth of a radian, about the size of a part.
            let weight = f64::from(known.omega) / (offset.length_squared() + 0.01).powi(2);
            let row = [1.0, offset.x, offset.y, offset.z];
            for i in 0..4 {
                for j in 0..4 {
                    normal[i][j] += weight * row[i] * row[j];
                }
                for (right, c) in right.iter_mut().zip(known.radiance.to_array()) {
                    right[i] += weight * row[i] * f64::from(c);
                }
            }
            (least, most) = (least.min(known.radiance), most.max(known.radiance));
        }
        let total = normal[0][0];
        // Flat where the parts do not tell a slope.
        for (i, row) in normal.iter_mut().enumerate().skip(1) {
            row[i] += 0.01 * total;
        }
        std::array::from_fn(|c| match solve_positive(&normal, right[c]) {
            Some(plane) => (plane[0] as f32).clamp(least[c], most[c]),
            None if total > 0.0 => (right[c][0] / total) as f32,
            None => 0.0,
        })
    }
}

/// Number of the part of the sphere that holds a direction: `rows` of equal height in z, times `columns` in azimuth.
pub(super) fn bin_of(direction: Vec3, rows: usize, columns: usize) -> usize {
    let row = ((direction.z * 0.5 + 0.5) * rows as f32) as usize;
    let turn = direction.y.atan2(direction.x) / std::f32::consts::TAU + 0.5;
    row.min(rows - 1) * columns + (turn * columns as f32) as usize % columns
}

/// Appends the half sphere below the horizon with one radiance.
pub(super) fn append_lower_half(surface_rgb: [f32; 3], bits: u8, out: &mut RadianceSamples) {
    let omega = (4.0 * std::f64::consts::PI / FILL_DIRECTIONS as f64) as f32;
    for j in FILL_DIRECTIONS / 2..FILL_DIRECTIONS {
        let d = spiral::direction(j, FILL_DIRECTIONS).as_vec3();
        out.directions.push([d.x, d.y, d.z, omega]);
        out.radiance.push([surface_rgb[0], surface_rgb[1], surface_rgb[2], f32::from(bits)]);
    }
}

/// Takes the surface's share out of pixels that straddle the horizon: their radiance is the mean of what is above and
/// the (far, unshadowed) surface below, by solid angle.
pub(super) fn unmix_horizon(
    view: &BallView,
    pixel_of_sample: &[u32],
    surface_rgb: [f32; 3],
    out: &mut RadianceSamples,
) {
    for (sample, pixel) in pixel_of_sample.iter().enumerate() {
        let above = out.directions[sample][3];
        // No pixel inside the rim is as wide as 0.2 rad.
        if out.directions[sample][2] > 0.2 || out.radiance[sample][3] as u8 & LOWER_BOUND != 0 {
            continue;
        }
        let quad = reflected_quad(view, *pixel as usize % view.width, *pixel as usize / view.width);
        if quad.iter().all(|c| c[2] > 0.0) {
            continue;
        }
        let below = (cell(quad, false)[3] - above).max(0.0);
        for (c, surface) in out.radiance[sample].iter_mut().zip(surface_rgb) {
            *c = ((*c * (above + below) - surface * below) / above).max(0.0);
        }
    }
}

/// The four mirrored corners of a pixel of the region, in order around it.
fn reflected_quad(view: &BallView, x: usize, y: usize) -> [[f32; 4]; 4] {
    let corner =
        |x: usize, y: usize| reflect_corner(view.corner_rays[y * (view.width + 1) + x], &view.sphere);
    [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)]
}

/// Mean radiance of the pixels in which the ball shows directions below the horizon, over solid angle; 0 without any.
pub(super) fn below_horizon_on_ball(view: &BallView, picture: &HdrImage, ball: &MirrorBall) -> [f32; 3] {
    let (mut sum, mut total) = ([0.0_f64; 3], 0.0);
    for y in 0..view.height {
        for x in 0..view.width {
            let quad = reflected_quad(view, x, y);
            if quad.iter().any(|c| c[2] >= 0.0) {
                continue;
            }
            let omega = f64::from(cell(quad, false)[3]);
            let (radiance, _) = sane_radiance(picture, view.x + x, view.y + y);
            for (sum, (c, reflectance)) in sum.iter_mut().zip(radiance.iter().zip(ball.reflectance_rgb)) {
                *sum += omega * f64::from(c / reflectance);
            }
            total += omega;
        }
    }
    if total > 0.0 { sum.map(|c| (c / total) as f32) } else { [0.0; 3] }
}
