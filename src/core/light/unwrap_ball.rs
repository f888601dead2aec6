//! A photograph of a mirror ball to radiance samples, by tracing each pixel's corner rays to the calibrated sphere
//! (section 3 of the project's formulas; never the angular-map formula). Twin of `shaders/light/unwrap_ball.wgsl`:
//! the twins share [`BallView::prepare`] (rays), [`reflect_corner`] and [`cell`] (the kernel), and
//! [`BallUnwrapper::finish`] (what the ball does not show).

use super::{clipped::ClippedLights, fill, surface::SurfaceFit};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    estimate::LightFlags,
    image::{FILLED, HdrImage, LOWER_BOUND, NOT_FINITE},
    light::RadianceSamples,
    rig::MirrorBall,
};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Pixels beyond this share of the silhouette's radius are left out: the picture there is squeezed without bound.
pub const RIM: f64 = 0.98;
/// What an infinite radiance is replaced by (just below what half floats hold).
pub const LARGEST_RADIANCE: f32 = 64_000.0;
/// Directions of the fixed grid from which unseen parts are filled, on the whole sphere.
pub const FILL_DIRECTIONS: usize = 4096;

/// Why a ball gives no light.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnwrapError {
    /// Radius or reflectance make no sense.
    #[error("mirror ball: {what} = {value}: must be {allowed}")]
    BadBall {
        /// Which number.
        what: &'static str,
        /// What stood there.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The picture is not the lens's, or its parts differ in size.
    #[error("picture of {got_width} x {got_height} pixels for a lens of {want_width} x {want_height}")]
    WrongSize {
        /// Columns of the picture.
        got_width: usize,
        /// Rows of the picture.
        got_height: usize,
        /// Columns of the lens.
        want_width: usize,
        /// Rows of the lens.
        want_height: usize,
    },
    /// The camera is inside the ball.
    #[error("the camera is {distance_m:.4} m from the ball's centre, inside its radius of {radius_m} m")]
    Inside {
        /// Distance of the camera from the centre, metres.
        distance_m: f64,
        /// Radius, metres.
        radius_m: f64,
    },
    /// No pixel shows enough of the ball.
    #[error("the mirror ball at {centre_world:?} m is not in the picture (or smaller than two pixels)")]
    NotVisible {
        /// Centre, world frame, metres.
        centre_world: [f64; 3],
    },
}

/// Where the ball is in a picture, and the rays of its pixels' corners: all that the kernel needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BallView {
    /// First column of the region that holds the ball.
    pub x: usize,
    /// First row of the region.
    pub y: usize,
    /// Columns of the region.
    pub width: usize,
    /// Rows of the region.
    pub height: usize,
    /// (width + 1) x (height + 1) unit rays in the world frame through the pixel corners, row by row; w = 1, or 0
    /// where the lens has no ray.
    pub corner_rays: Vec<[f32; 4]>,
    /// The sphere as the kernel takes it.
    pub sphere: KernelSphere,
    /// Whether the whole silhouette is in the picture.
    pub whole: bool,
}

/// The ball seen from the camera, in the world frame's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelSphere {
    /// From the ball's centre to the camera, metres.
    pub eye_from_centre: [f32; 3],
    /// Metres.
    pub radius: f32,
    /// Square of the largest distance between ray and centre that still counts (the rim), square metres.
    pub rim_squared: f32,
}

/// Checks a ball and a picture against each other.
pub fn check(picture: &HdrImage, lens: &Lens, eye: DVec3, ball: &MirrorBall) -> Result<(), UnwrapError> {
    let (got_width, got_height) = (picture.radiance.width(), picture.radiance.height());
    let (want_width, want_height) = (lens.width as usize, lens.height as usize);
    let flags_fit = (picture.flags.width(), picture.flags.height()) == (got_width, got_height);
    if (got_width, got_height) != (want_width, want_height) || !flags_fit {
        return Err(UnwrapError::WrongSize { got_width, got_height, want_width, want_height });
    }
    if !(ball.radius_m.is_finite() && ball.radius_m > 0.0) {
        return Err(UnwrapError::BadBall {
            what: "radius_m",
            value: ball.radius_m,
            allowed: "positive, in metres",
        });
    }
    for reflectance in ball.reflectance_rgb {
        if !(reflectance > 0.0 && reflectance <= 1.0) {
            return Err(UnwrapError::BadBall {
                what: "reflectance_rgb",
                value: f64::from(reflectance),
                allowed: "within (0, 1] for each channel",
            });
        }
    }
    let distance_m = eye.distance(ball.centre_world);
    if distance_m.is_nan() || distance_m <= ball.radius_m {
        return Err(UnwrapError::Inside { distance_m, radius_m: ball.radius_m });
    }
    Ok(())
}

impl BallView {
    /// Finds the ball in a picture of this lens and pose, and makes the corner rays; keeps its memory.
    pub fn prepare(
        &mut self,
        lens: &Lens,
        world_from_camera: &Pose,
        ball: &MirrorBall,
    ) -> Result<(), UnwrapError> {
        let eye = world_from_camera.translation;
        let to_eye = eye - ball.centre_world;
        let distance = to_eye.length();
        if distance.is_nan() || distance <= ball.radius_m {
            return Err(UnwrapError::Inside { distance_m: distance, radius_m: ball.radius_m });
        }
        let hidden = || UnwrapError::NotVisible { centre_world: ball.centre_world.to_array() };
        let (low, high, in_front) = silhouette_box(lens, world_from_camera, ball).ok_or_else(hidden)?;
        // Two pixels of margin: the box is that of a polygon on the silhouette.
        let inside = |v: f64, size: u32| (v.clamp(0.0, f64::from(size))) as usize;
        let (x0, y0) = (inside(low.x - 2.0, lens.width), inside(low.y - 2.0, lens.height));
        let (x1, y1) = (inside(high.x + 3.0, lens.width), inside(high.y + 3.0, lens.height));
        if x1 < x0 + 2 || y1 < y0 + 2 {
            return Err(hidden());
        }
        self.whole = in_front
            && low.x >= 0.0
            && low.y >= 0.0
            && high.x <= f64::from(lens.width)
            && high.y <= f64::from(lens.height);
        (self.x, self.y, self.width, self.height) = (x0, y0, x1 - x0, y1 - y0);
        // r = tan psi / tan asin q <= RIM, as a bound on the distance D sin psi between ray and centre.
        let q = ball.radius_m / distance;
        let tangent = RIM * q / (1.0 - q * q).sqrt();
        let rim = distance * tangent / (1.0 + tangent * tangent).sqrt();
        self.sphere = KernelSphere {
            eye_from_centre: to_eye.as_vec3().to_array(),
            radius: ball.radius_m as f32,
            rim_squared: (rim * rim) as f32,
        };
        let columns = self.width + 1;
        self.corner_rays.resize(columns * (self.height + 1), [0.0; 4]);
        self.corner_rays.par_chunks_mut(columns).enumerate().for_each(|(row, rays)| {
            for (column, ray) in rays.iter_mut().enumerate() {
                let pixel = DVec2::new((x0 + column) as f64, (y0 + row) as f64);
                *ray = match lens.unproject(pixel) {
                    Some(d) => world_from_camera.rotate(d).as_vec3().extend(1.0).to_array(),
                    None => [0.0; 4],
                };
            }
        });
        Ok(())
    }
}

/// Box of the silhouette in continuous pixels (not clipped to the picture), and whether all of it projects.
fn silhouette_box(lens: &Lens, world_from_camera: &Pose, ball: &MirrorBall) -> Option<(DVec2, DVec2, bool)> {
    const POINTS: usize = 64;
    let camera_from_world = world_from_camera.inverse();
    let to_eye = world_from_camera.translation - ball.centre_world;
    let axis = to_eye.normalize();
    let q = ball.radius_m / to_eye.length();
    let (right, up) = axis.any_orthonormal_pair();
    let (mut low, mut high, mut all) = (DVec2::INFINITY, DVec2::NEG_INFINITY, true);
    for k in 0..POINTS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
        // The circle in which the cone of view touches the ball.
        let around = (right * cos + up * sin) * (1.0 - q * q).sqrt();
        let point = ball.centre_world + (axis * q + around) * ball.radius_m;
        match lens.project(camera_from_world.transform(point)) {
            Some(pixel) => (low, high) = (low.min(pixel), high.max(pixel)),
            None => all = false,
        }
    }
    (low.is_finite() && high.is_finite()).then_some((low, high, all))
}

/// The kernel's first half: mirrors a corner's ray. xyz: unit reflected direction; w: 1 where the ray meets the
/// ball inside the rim, else 0.
///
/// With m = e - (e.k) k the foot of the perpendicular from the centre, the normal is (m - sqrt(r^2 - m^2) k) / r:
/// a form that keeps its digits in f32 although the camera may be many radii away.
pub fn reflect_corner(ray: [f32; 4], sphere: &KernelSphere) -> [f32; 4] {
    let k = Vec3::new(ray[0], ray[1], ray[2]);
    let eye = Vec3::from_array(sphere.eye_from_centre);
    let along = eye.dot(k);
    let foot = eye - k * along;
    let distance_squared = foot.dot(foot);
    if ray[3] == 0.0 || along >= 0.0 || distance_squared > sphere.rim_squared {
        return [0.0; 4];
    }
    let half_chord = (sphere.radius * sphere.radius - distance_squared).sqrt();
    let normal = (foot - k * half_chord) / sphere.radius;
    let reflected = k + normal * (2.0 * half_chord / sphere.radius);
    (reflected / reflected.length()).extend(1.0).to_array()
}

/// The kernel's second half: direction (xyz, unit) and solid angle (w, steradians) of one pixel from its four
/// reflected corners in order around it; w = 0 where a corner is missing (rim, partly covered pixels).
///
/// The solid angle is that of the spherical quadrilateral, the direction its centroid. With `above_horizon` only the
/// part with z > 0 counts: a pixel that straddles the horizon is clipped there.
pub fn cell(corners: [[f32; 4]; 4], above_horizon: bool) -> [f32; 4] {
    if corners.iter().any(|c| c[3] == 0.0) {
        return [0.0; 4];
    }
    let mut polygon = [Vec3::ZERO; 5];
    let mut count = 4;
    for (slot, corner) in polygon.iter_mut().zip(corners) {
        *slot = Vec3::new(corner[0], corner[1], corner[2]);
    }
    if above_horizon && corners.iter().any(|c| c[2] <= 0.0) {
        (polygon, count) = clip_at_horizon(&polygon);
    }
    let (mut total, mut moment) = (0.0, Vec3::ZERO);
    for k in 2..count {
        let (a, b, c) = (polygon[0], polygon[k - 1], polygon[k]);
        // The triple product of the differences: nearly parallel vectors keep their digits.
        let volume = a.dot((b - a).cross(c - a));
        let omega = 2.0 * volume.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        total += omega;
        moment += (a + b + c) * omega;
    }
    let length = moment.length();
    // A mirror turns the corners' order over; the sign of both sums turns with it.
    if length.is_nan() || length <= 0.0 {
        return [0.0; 4];
    }
    (moment * (total.signum() / length)).extend(total.abs()).to_array()
}

/// The part of a spherical quadrilateral with z >= 0: up to five corners. (A point of the chord with z = 0 lies on the
/// great circle through the chord's ends.)
fn clip_at_horizon(quad: &[Vec3; 5]) -> ([Vec3; 5], usize) {
    let (mut out, mut count) = ([Vec3::ZERO; 5], 0);
    for k in 0..4 {
        let (a, b) = (quad[k], quad[(k + 1) % 4]);
        if a.z > 0.0 && count < 5 {
            out[count] = a;
            count += 1;
        }
        if (a.z > 0.0) != (b.z > 0.0) && count < 5 {
            let crossing = a + (b - a) * (a.z / (a.z - b.z));
            let flat = Vec3::new(crossing.x, crossing.y, 0.0);
            let length = flat.length();
            if length > 0.0 {
                out[count] = flat / length;
                count += 1;
            }
        }
    }
    (out, if count >= 3 { count } else { 0 })
}

/// A mirror ball in a picture, and what is known of the place.
#[derive(Clone, Copy)]
pub struct BallShot<'a> {
    /// Linear picture.
    pub picture: &'a HdrImage,
    /// The same view without the ball, in the same units of radiance, where there is one: the surface's own markings
    /// and its uneven lighting then drop out of what its shadows tell.
    pub without_ball: Option<&'a HdrImage>,
    /// Lens of both.
    pub lens: &'a Lens,
    /// Pose of both.
    pub world_from_camera: &'a Pose,
    /// Where it stands and how large it is.
    pub ball: &'a MirrorBall,
    /// Whether the ball stands on (or over) the surface z = 0: directions below the horizon then show the unshadowed
    /// surface.
    pub on_surface: bool,
}

impl BallShot<'_> {
    /// Refuses balls, lenses and pictures that do not fit each other.
    pub fn check(&self) -> Result<(), UnwrapError> {
        let eye = self.world_from_camera.translation;
        check(self.picture, self.lens, eye, self.ball)?;
        self.without_ball.map_or(Ok(()), |without| check(without, self.lens, eye, self.ball))
    }
}

/// One frame's ball, unwrapped again and again without new memory.
#[derive(Debug, Default)]
pub struct BallUnwrapper {
    view: BallView,
    corners: Vec<[f32; 4]>,
    cells: Vec<[f32; 4]>,
    pixel_of_sample: Vec<u32>,
    fill: fill::BallFill,
    surface: SurfaceFit,
    clipped: ClippedLights,
}

impl BallUnwrapper {
    /// With empty buffers.
    pub fn new() -> Self {
        Self::default()
    }

    /// See [`unwrap_ball`].
    pub fn unwrap(
        &mut self,
        shot: &BallShot<'_>,
        out: &mut RadianceSamples,
    ) -> Result<LightFlags, UnwrapError> {
        shot.check()?;
        // Taken out for the time of the call, since both are read while `self` works.
        let mut view = std::mem::take(&mut self.view);
        let mut cells = std::mem::take(&mut self.cells);
        let result = view.prepare(shot.lens, shot.world_from_camera, shot.ball).and_then(|()| {
            self.trace(&view, shot.on_surface, &mut cells);
            self.finish(&view, &cells, shot, out)
        });
        (self.view, self.cells) = (view, cells);
        result
    }

    /// The kernel over all pixels of the region: `cells` gets width x height directions with solid angles.
    pub fn trace(&mut self, view: &BallView, on_surface: bool, cells: &mut Vec<[f32; 4]>) {
        let columns = view.width + 1;
        self.corners.resize(view.corner_rays.len(), [0.0; 4]);
        cells.resize(view.width * view.height, [0.0; 4]);
        self.corners.par_chunks_mut(columns).zip(view.corner_rays.par_chunks(columns)).for_each(
            |(out, rays)| {
                for (out, ray) in out.iter_mut().zip(rays) {
                    *out = reflect_corner(*ray, &view.sphere);
                }
            },
        );
        let corners = &self.corners;
        cells.par_chunks_mut(view.width.max(1)).enumerate().for_each(|(row, out)| {
            let (top, bottom) = (&corners[row * columns..], &corners[(row + 1) * columns..]);
            for (i, out) in out.iter_mut().enumerate() {
                *out = cell([top[i], top[i + 1], bottom[i + 1], bottom[i]], on_surface);
            }
        });
    }

    /// From traced cells to samples of the whole sphere: takes the radiance, puts bad texels right, fills what the
    /// ball does not show, and (`on_surface`) replaces all below the horizon by the unshadowed surface. Both engines
    /// end here. `cells`: width x height of the view, as from [`BallUnwrapper::trace`].
    pub fn finish(
        &mut self,
        view: &BallView,
        cells: &[[f32; 4]],
        shot: &BallShot<'_>,
        out: &mut RadianceSamples,
    ) -> Result<LightFlags, UnwrapError> {
        shot.check()?;
        let &BallShot { picture, lens, world_from_camera, ball, on_surface, .. } = shot;
        out.directions.clear();
        out.radiance.clear();
        self.pixel_of_sample.clear();
        let mut flags = LightFlags::default();
        for (index, cell) in cells.iter().enumerate() {
            if cell[3] <= 0.0 {
                continue;
            }
            let (x, y) = (view.x + index % view.width, view.y + index / view.width);
            let (radiance, bits) = sane_radiance(picture, x, y);
            flags.saturated_texels += u32::from(bits & LOWER_BOUND != 0);
            flags.not_finite_texels += u32::from(bits & NOT_FINITE != 0);
            out.directions.push(*cell);
            let light: [f32; 3] = std::array::from_fn(|c| radiance[c] / ball.reflectance_rgb[c]);
            out.radiance.push([light[0], light[1], light[2], f32::from(bits)]);
            self.pixel_of_sample.push(index as u32);
        }
        let seen = out.directions.len();
        if seen == 0 {
            return Err(UnwrapError::NotVisible { centre_world: ball.centre_world.to_array() });
        }
        let past = fill::PastTheBall { picture, lens, world_from_camera, ball };
        let mut filled_sr = self.fill.append(view, cells, &past, on_surface, out);
        if on_surface {
            self.surface.gather(shot);
            self.clipped.find(view.width, &self.pixel_of_sample, out);
            let (surface_rgb, bits) = match self.surface.solve(&mut self.clipped, out) {
                Some(surface_rgb) => (surface_rgb, 0),
                None => {
                    // No usable surface in the picture: what the ball itself shows of it, shadow and all.
                    filled_sr += std::f64::consts::TAU;
                    (fill::below_horizon_on_ball(view, picture, ball), FILLED)
                }
            };
            fill::unmix_horizon(view, &self.pixel_of_sample, surface_rgb, out);
            fill::append_lower_half(surface_rgb, bits, out);
        }
        flags.texels = out.directions.len() as u32;
        flags.filled_share = (filled_sr / (4.0 * std::f64::consts::PI)) as f32;
        Ok(flags)
    }
}

/// Light from a photograph of a mirror ball: radiance samples of the whole sphere, world frame.
///
/// Each pixel wholly on the ball and inside [`RIM`] becomes one sample, with the solid angle and centroid of the
/// spherical quadrilateral into which its corner rays are mirrored, and radiance / reflectance. Texels that are not
/// finite are replaced and flagged; saturated ones keep `LOWER_BOUND`. All solid angles together are 4 pi.
///
/// The cone behind the ball (and whatever lies outside the picture) is filled from the camera's own view past the
/// ball where that covers it, else smoothly from its neighbours with the flag `FILLED`; `filled_share` is the share
/// of the sphere filled in this second way.
///
/// `on_surface`: the ball stands on (or over) the matt surface z = 0, which is in the picture too. Then every
/// direction with z < 0 gets the radiance of the surface where the ball does not darken it: a robust fit of the
/// surface's pixels to the light found, each with the ball in its way (see [`SurfaceFit`]). The same fit gives the
/// true radiance of lights that are saturated in every exposure, from how deep their shadow is; their samples keep
/// `LOWER_BOUND` all the same. (With a picture of the place without the ball, [`BallShot::without_ball`], markings and
/// uneven lighting of the surface do not hide those shadows.) Without any usable surface in the picture the ball's own view of it is taken, flagged.
///
/// Keep a [`BallUnwrapper`] to unwrap frame by frame without new memory.
pub fn unwrap_ball(
    picture: &HdrImage,
    lens: &Lens,
    world_from_camera: &Pose,
    ball: &MirrorBall,
    on_surface: bool,
    out: &mut RadianceSamples,
) -> Result<LightFlags, UnwrapError> {
    let shot = BallShot { picture, without_ball: None, lens, world_from_camera, ball, on_surface };
    BallUnwrapper::new().unwrap(&shot, out)
}

/// The radiance and flags of a pixel, made finite and not negative: infinite becomes [`LARGEST_RADIANCE`], NaN the mean
/// of the sound ones among its eight neighbours (else 0).
pub(super) fn sane_radiance(picture: &HdrImage, x: usize, y: usize) -> ([f32; 3], u8) {
    let radiance = *picture.radiance.at(x, y);
    let flags = *picture.flags.at(x, y);
    if radiance.iter().all(|c| c.is_finite()) {
        return (radiance.map(|c| c.max(0.0)), flags);
    }
    let mend = |channel: usize| {
        let c = radiance[channel];
        if c.is_finite() {
            return c.max(0.0);
        }
        if c == f32::INFINITY {
            return LARGEST_RADIANCE;
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for y in y.saturating_sub(1)..(y + 2).min(picture.radiance.height()) {
            for x in x.saturating_sub(1)..(x + 2).min(picture.radiance.width()) {
                let c = picture.radiance.at(x, y)[channel];
                if c.is_finite() {
                    sum += c.max(0.0);
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    };
    (std::array::from_fn(mend), flags | NOT_FINITE)
}

/// Mean radiance of a block; `None` where a pixel of it is saturated or was not finite.
pub(super) fn block_mean(picture: &HdrImage, x: usize, y: usize, side: usize) -> Option<[f64; 3]> {
    let mut sum = [0.0; 3];
    for y in y..y + side {
        for x in x..x + side {
            let (radiance, bits) = sane_radiance(picture, x, y);
            if bits & (LOWER_BOUND | NOT_FINITE) != 0 {
                return None;
            }
            for (sum, c) in sum.iter_mut().zip(radiance) {
                *sum += f64::from(c);
            }
        }
    }
    Some(sum.map(|c| c / (side * side) as f64))
}

#[cfg(test)]
mod tests;
