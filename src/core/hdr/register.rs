//! An older frame as the newest camera would have seen it.

mod coded;
mod sensor;

use super::{
    linear_light::LinearLight,
    reflected_point::{MirroredPlace, point_reflecting},
};
use crate::{
    math::{
        lens::Lens,
        pose::Pose,
        sphere::{Reflection, reflect_off_sphere},
    },
    model::{
        image::{Image, Rgb8Image},
        rig::MirrorBall,
        sensor::{SensorImage, UNSEEN as UNSEEN_VALUE},
    },
};
use coded::CodedWarp;
pub(super) use coded::sample;
pub use coded::{BoundFill, SATURATED};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sensor::SensorWarp;

/// Side of a grid cell in pixels: within it the warp is interpolated.
const CELL: usize = 8;
/// The same on the ball, away from its outline.
const BALL_CELL: usize = 4;
/// Cosine between the ball's normal and the ray, above which the ball's warp is smooth: up to 0.9 of the outline.
const INTERIOR: f64 = 0.44;
/// Fraction bits of pixel coordinates.
const FRACTION: i32 = 10;
const ONE: i32 = 1 << FRACTION;
/// Marks grid nodes that the older camera cannot see.
const UNSEEN: [i32; 2] = [i32::MIN; 2];
/// A camera that moves no pixel farther than this has not moved.
const STILL_PX: f64 = 0.1;

/// A picture that is warped.
trait Warped: Sync {
    type Pixel: Send;

    /// The value at a continuous pixel position of the older picture whose four taps lie within it, not in its last row.
    fn inside(&self, at: [i32; 2]) -> Self::Pixel;

    /// The value at any position; `None` outside the picture.
    fn sample(&self, at: [i32; 2], on_ball: bool) -> Option<Self::Pixel>;

    /// What stands at a pixel of the newest picture that the older one did not see.
    fn unseen(&self, x: usize, y: usize) -> Self::Pixel;
}

/// Warps older frames into the newest frame's view: pixels of the mirror ball through its reflection, all others
/// through the surface z = 0, or through infinity where their ray misses it.
///
/// Both cameras have the same lens. What stands on the surface, other than the ball, is warped as if it lay in it.
#[derive(Clone, Debug)]
pub struct Warp {
    lens: Lens,
    ball: Option<MirrorBall>,
    columns: usize,
    /// Unit rays of the grid nodes, camera frame; NaN where the lens has none.
    rays: Vec<DVec3>,
    /// For each node: where the older camera sees the same thing, pixels in fixed point.
    nodes: Vec<[i32; 2]>,
    newest: BallCamera,
    older: BallCamera,
}

/// What a pixel position has to do with the ball.
#[derive(Clone, Copy, Debug)]
enum OnBall {
    /// It does not show the ball.
    Beside,
    /// The older camera cannot see that reflection.
    Unseen,
    /// The older camera sees it there.
    Seen {
        /// Pixels in fixed point.
        at: [i32; 2],
        /// Away from the outline in both pictures, where the warp is smooth.
        interior: bool,
    },
}

impl OnBall {
    fn interior(self) -> Option<[i32; 2]> {
        match self {
            Self::Seen { at, interior: true } => Some(at),
            _ => None,
        }
    }
}

/// Between two corners of a cell of N pixels, at the centre of its k-th pixel.
fn between<const N: usize>(from: i32, to: i32, k: i32) -> i32 {
    (from * (2 * N as i32 - 1 - 2 * k) + to * (2 * k + 1)) / (2 * N as i32)
}

/// A camera's pose, and where it sees the ball.
#[derive(Clone, Copy, Debug)]
struct BallCamera {
    world_from_camera: Pose,
    camera_from_world: Pose,
    /// Pixels that may show the ball: from (inclusive) and to (exclusive), x and y.
    ball_box: [[usize; 2]; 2],
    /// Unit direction of the ball's centre, camera frame.
    to_ball: DVec3,
    /// Cosine of the half angle of the cone around it that holds the ball and two pixels more; 2 without a ball.
    ball_cosine: f64,
    /// The same for cones a cell wider and a cell narrower: outside the one, and inside the other, a whole cell is.
    cell_cosines: [f64; 2],
}

impl BallCamera {
    fn new(world_from_camera: &Pose, lens: &Lens, ball: Option<&MirrorBall>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let ball_box = ball.map_or([[0; 2]; 2], |ball| ball_box(&camera_from_world, lens, ball));
        let mut camera = Self {
            world_from_camera: *world_from_camera,
            camera_from_world,
            ball_box,
            to_ball: DVec3::Z,
            ball_cosine: 2.0,
            cell_cosines: [2.0; 2],
        };
        if let Some(ball) = ball {
            let centre = camera_from_world.transform(ball.centre_world);
            let half_angle = (ball.radius_m / centre.length()).min(1.0).asin() + 2.0 / lens.fx.min(lens.fy);
            camera.to_ball = centre.normalize_or(DVec3::Z);
            let cosine = |half_angle: f64| half_angle.min(std::f64::consts::FRAC_PI_2).cos();
            camera.ball_cosine = cosine(half_angle);
            let cell = CELL as f64 / lens.fx.min(lens.fy);
            let narrower = if half_angle > cell { cosine(half_angle - cell) } else { 2.0 };
            camera.cell_cosines = [cosine(half_angle + cell), narrower];
        }
        camera
    }

    fn eye(&self) -> DVec3 {
        self.world_from_camera.translation
    }
}

/// Pixels that may show the ball: around its outline, three pixels wider; everything where the outline leaves the lens.
fn ball_box(camera_from_world: &Pose, lens: &Lens, ball: &MirrorBall) -> [[usize; 2]; 2] {
    let size = DVec2::new(f64::from(lens.width), f64::from(lens.height));
    let all = [[0, 0], [lens.width as usize, lens.height as usize]];
    let centre = camera_from_world.transform(ball.centre_world);
    let (distance, radius) = (centre.length(), ball.radius_m);
    if distance <= radius {
        return all;
    }
    // The outline is the circle where the cone from the eye touches the ball.
    let axis = centre / distance;
    let (side, up) = axis.any_orthonormal_pair();
    let sine = radius / distance;
    let (middle, reach) = (centre - axis * radius * sine, radius * (1.0 - sine * sine).sqrt());
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for k in 0..64 {
        let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 64.0).sin_cos();
        let Some(pixel) = lens.project(middle + reach * (side * cos + up * sin)) else {
            return if centre.z + radius > 0.0 { all } else { [[0; 2]; 2] };
        };
        (low, high) = (low.min(pixel), high.max(pixel));
    }
    let from = (low - 3.0).clamp(DVec2::ZERO, size);
    let to = (high + 4.0).clamp(DVec2::ZERO, size);
    [[from.x as usize, from.y as usize], [to.x as usize, to.y as usize]]
}

impl Warp {
    /// For pictures of this lens; the ball, if there is one, must be known in the world frame.
    pub fn new(lens: &Lens, ball: Option<MirrorBall>) -> Self {
        let columns = (lens.width as usize).div_ceil(CELL) + 1;
        let rows = (lens.height as usize).div_ceil(CELL) + 1;
        let rays: Vec<DVec3> = (0..columns * rows)
            .map(|node| {
                let pixel = DVec2::new((node % columns * CELL) as f64, (node / columns * CELL) as f64);
                lens.unproject(pixel).unwrap_or(DVec3::NAN)
            })
            .collect();
        let camera = BallCamera::new(&Pose::IDENTITY, lens, ball.as_ref());
        let nodes = vec![UNSEEN; rays.len()];
        Self { lens: *lens, ball, columns, rays, nodes, newest: camera, older: camera }
    }

    /// Width and height of the pictures.
    pub fn size(&self) -> (u32, u32) {
        (self.lens.width, self.lens.height)
    }

    /// Sets the two poses. False where no pixel of the picture moves by more than a tenth of a pixel: then there is
    /// nothing to warp.
    pub fn aim(&mut self, newest: &Pose, older: &Pose) -> bool {
        self.newest = BallCamera::new(newest, &self.lens, self.ball.as_ref());
        self.older = BallCamera::new(older, &self.lens, self.ball.as_ref());
        let (newest, older, lens, columns) = (self.newest, self.older, self.lens, self.columns);
        let mut moved = false;
        for (index, (node, ray)) in self.nodes.iter_mut().zip(&self.rays).enumerate() {
            let here = DVec2::new((index % columns * CELL) as f64, (index / columns * CELL) as f64);
            let there = surface_pixel(&lens, &newest, &older, *ray);
            moved |= match there {
                Some(there) => there.distance(here) > STILL_PX,
                // Out of the lens's reach: by the movement, unless it is so from the start.
                None => !ray.is_nan() && newest.world_from_camera != older.world_from_camera,
            };
            *node = there.map_or(UNSEEN, fixed);
        }
        moved
    }

    /// Draws `older`, the older camera's picture, as the newest camera would have seen it. `newest` is the newest
    /// picture; both have the lens's size. Bilinear, on the ball in linear light; a channel of which one of the four
    /// taps is saturated comes out as 255, so that highlights are not averaged down. Pixels that the older camera did not see, or that the
    /// ball hid from it, get the `fill`.
    /// *The result does not depend on the number of threads.* No allocation once `out` has its size.
    pub fn apply(
        &self,
        older: &Rgb8Image,
        newest: &Rgb8Image,
        (fill, light): (&BoundFill, &LinearLight),
        out: &mut Rgb8Image,
    ) {
        if !(self.fits(older) && self.fits(newest)) {
            out.clone_from(older);
            return;
        }
        out.reshape(older.width(), older.height(), [0; 3]);
        self.draw(&CodedWarp { older, newest, fill, light }, out.pixels_mut());
    }

    /// The same for pictures at their sensor's fineness, in linear light: a channel of which one tap is saturated comes out as
    /// clipped, what was not seen as unseen.
    pub fn apply_to_sensor(&self, older: &SensorImage, out: &mut SensorImage) {
        if !self.fits(&older.values) {
            out.clone_from(older);
            return;
        }
        out.scale = older.scale;
        out.values.reshape(older.values.width(), older.values.height(), [UNSEEN_VALUE; 3]);
        self.draw(&SensorWarp(older), out.values.pixels_mut());
    }

    fn fits<P: Clone>(&self, picture: &Image<P>) -> bool {
        let size = (self.lens.width as usize, self.lens.height as usize);
        (picture.width(), picture.height()) == size && size.0 > 0
    }

    fn draw<W: Warped>(&self, warped: &W, out: &mut [W::Pixel]) {
        let width = self.lens.width as usize;
        out.par_chunks_mut(CELL * width).enumerate().for_each(|(band, rows)| {
            for (j, row) in rows.chunks_mut(width).enumerate() {
                self.surface_row(band * CELL + j, warped, row);
            }
            self.ball_rows(band * CELL, warped, rows);
        });
    }

    /// One row as if there were no ball in front.
    fn surface_row<W: Warped>(&self, y: usize, warped: &W, out: &mut [W::Pixel]) {
        let (band, j) = (y / CELL, (y % CELL) as i32);
        let upper = &self.nodes[band * self.columns..];
        let lower = &self.nodes[(band + 1) * self.columns..];
        // Where the four taps exist, with a row to spare.
        let size = [self.lens.width as i32 - 1, self.lens.height as i32 - 2].map(|v| v * ONE);
        let [hidden_from, hidden_to] = self.older.ball_box.map(|corner| corner.map(|v| v as i32 * ONE));
        for (cell, out) in out.chunks_mut(CELL).enumerate() {
            let unseen = |k: usize| warped.unseen(cell * CELL + k, y);
            let corners = [upper[cell], upper[cell + 1], lower[cell], lower[cell + 1]];
            if corners.contains(&UNSEEN) {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = unseen(k));
                continue;
            }
            let left: [i32; 2] = std::array::from_fn(|a| between::<CELL>(corners[0][a], corners[2][a], j));
            let right: [i32; 2] = std::array::from_fn(|a| between::<CELL>(corners[1][a], corners[3][a], j));
            let at = |k: usize| std::array::from_fn(|a| between::<CELL>(left[a], right[a], k as i32));
            let inside = (0..2).all(|a| left[a].min(right[a]) >= ONE && left[a].max(right[a]) < size[a]);
            let maybe_hidden = (0..2)
                .all(|a| left[a].min(right[a]) < hidden_to[a] && left[a].max(right[a]) >= hidden_from[a]);
            let centre = std::array::from_fn(|a| (left[a] + right[a]) / 2);
            let maybe_hidden = maybe_hidden && self.within(centre, self.older.cell_cosines[0]);
            if maybe_hidden && self.within(centre, self.older.cell_cosines[1]) {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = unseen(k));
                continue;
            }
            if inside && !maybe_hidden {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = warped.inside(at(k)));
                continue;
            }
            for (k, out) in out.iter_mut().enumerate() {
                let at = at(k);
                let seen = if maybe_hidden && self.within(at, self.older.ball_cosine) {
                    None
                } else {
                    warped.sample(at, false)
                };
                *out = seen.unwrap_or_else(|| unseen(k));
            }
        }
    }

    /// Whether the older camera's ray there lies in the cone of this cosine around the ball's centre.
    fn within(&self, at: [i32; 2], cosine: f64) -> bool {
        let ray = self.ray(at.map(|v| f64::from(v) / f64::from(ONE)));
        let along = ray.dot(self.older.to_ball);
        along > 0.0 && along * along > cosine * cosine * ray.length_squared()
    }

    /// The ball's pixels in the rows of one band from row `top` on.
    fn ball_rows<W: Warped>(&self, top: usize, warped: &W, rows: &mut [W::Pixel]) {
        let [from, to] = self.newest.ball_box;
        let width = self.lens.width as usize;
        let bottom = (top + rows.len() / width).min(to[1]);
        for y0 in (top..bottom).step_by(BALL_CELL).filter(|y0| y0 + BALL_CELL > from[1]) {
            // Both corners at the left of the cell, and what the warp knows from there.
            let (mut turn, mut left) = (DVec3::ZERO, [None; 2]);
            let first = from[0] / BALL_CELL * BALL_CELL;
            for (index, x0) in (first..to[0]).step_by(BALL_CELL).enumerate() {
                let mut corners = |x: usize| {
                    [y0, y0 + BALL_CELL].map(|y| self.on_ball([x as f64, y as f64], &mut turn).interior())
                };
                if index == 0 {
                    left = corners(x0);
                }
                let right = corners(x0 + BALL_CELL);
                let smooth = match (left, right) {
                    ([Some(a), Some(c)], [Some(b), Some(d)]) => Some([a, b, c, d]),
                    _ => None,
                };
                left = right;
                for y in y0..(y0 + BALL_CELL).min(bottom) {
                    for x in x0..(x0 + BALL_CELL).min(width) {
                        let seen = match smooth {
                            Some(corners) => {
                                let (i, j) = ((x - x0) as i32, (y - y0) as i32);
                                Some(std::array::from_fn(|axis| {
                                    let [a, b, c, d] = corners.map(|corner| corner[axis]);
                                    between::<BALL_CELL>(
                                        between::<BALL_CELL>(a, b, i),
                                        between::<BALL_CELL>(c, d, i),
                                        j,
                                    )
                                }))
                            }
                            None => match self.on_ball([x as f64 + 0.5, y as f64 + 0.5], &mut turn) {
                                OnBall::Beside => continue,
                                OnBall::Unseen => None,
                                OnBall::Seen { at, .. } => Some(at),
                            },
                        };
                        rows[(y - top) * width + x] = seen
                            .and_then(|at| warped.sample(at, true))
                            .unwrap_or_else(|| warped.unseen(x, y));
                    }
                }
            }
        }
    }

    /// Where the older camera sees mirrored what the newest one sees mirrored in a pixel position. `turn` is the
    /// difference of the two normals, kept from place to place as a first guess.
    fn on_ball(&self, pixel: [f64; 2], turn: &mut DVec3) -> OnBall {
        let Some(ball) = self.ball else { return OnBall::Beside };
        let (centre, radius) = (ball.centre_world, ball.radius_m);
        let ray = self.newest.world_from_camera.rotate(self.ray(pixel));
        let Some(Reflection { point, normal, reflected, .. }) =
            reflect_off_sphere(self.newest.eye(), ray, centre, radius)
        else {
            return OnBall::Beside;
        };
        // Below the horizon of a ball above the surface, the mirrored thing is the surface itself, at hand.
        let mirrored = if reflected.z < 0.0 && point.z > 0.0 {
            MirroredPlace::At(point - reflected * (point.z / reflected.z))
        } else {
            MirroredPlace::Towards(reflected)
        };
        let Some(seen) = point_reflecting(self.older.eye(), centre, radius, mirrored, normal + *turn) else {
            return OnBall::Unseen;
        };
        let older_normal = (seen - centre) / radius;
        *turn = older_normal - normal;
        let facing = normal.dot(reflected).min(older_normal.dot((self.older.eye() - seen).normalize()));
        match self.lens.project(self.older.camera_from_world.transform(seen)) {
            Some(pixel) => OnBall::Seen { at: fixed(pixel), interior: facing > INTERIOR },
            None => OnBall::Unseen,
        }
    }

    /// The ray through a pixel, camera frame, from the grid's rays around it; any length.
    fn ray(&self, pixel: [f64; 2]) -> DVec3 {
        // At least two each: only pictures that are not empty are warped.
        let rows = self.rays.len() / self.columns;
        let cell = |v: f64, most: usize| ((v / CELL as f64).max(0.0) as usize).min(most);
        let (i, j) = (cell(pixel[0], self.columns - 2), cell(pixel[1], rows - 2));
        let (s, t) = (pixel[0] / CELL as f64 - i as f64, pixel[1] / CELL as f64 - j as f64);
        let row = |j: usize| {
            let start = j * self.columns + i;
            self.rays[start].lerp(self.rays[start + 1], s)
        };
        row(j).lerp(row(j + 1), t)
    }
}

/// Where the older camera sees what the newest one sees along a ray (camera frame), without the ball.
fn surface_pixel(lens: &Lens, newest: &BallCamera, older: &BallCamera, ray: DVec3) -> Option<DVec2> {
    let direction = newest.world_from_camera.rotate(ray);
    let eye = newest.eye();
    let along = -eye.z / direction.z;
    // Far away, a point and a direction are the same.
    let in_older = if along > 0.0 && along < 1e6 {
        older.camera_from_world.transform(eye + direction * along)
    } else {
        older.camera_from_world.rotate(direction)
    };
    lens.project(in_older)
}

/// Fixed point; far outside the picture is as good as anything far outside.
pub(super) fn fixed(pixel: DVec2) -> [i32; 2] {
    let one = |v: f64| (v.clamp(-3e4, 3e4) * f64::from(ONE)).round() as i32;
    if pixel.is_nan() { UNSEEN } else { [one(pixel.x), one(pixel.y)] }
}

#[cfg(test)]
mod tests;
