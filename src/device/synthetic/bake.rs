//! Irradiance of the room's surfaces, computed once at the start: the lamp on a fine grid with its true
//! shadows, and the window with three bounces between all surfaces on a coarse one.

use super::{
    random::uniform_pair,
    room::{SyntheticBallView, SyntheticRoom},
};
use crate::math::spiral;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Irradiance on a grid over a face, texel centres at (i + 0.5) / n.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    columns: usize,
    rows: usize,
    irradiance: Vec<[f32; 3]>,
}

impl Grid {
    fn compute(columns: usize, rows: usize, at: impl Fn(usize, DVec2) -> DVec3 + Sync) -> Self {
        let irradiance = (0..columns * rows)
            .into_par_iter()
            .map(|i| {
                let uv = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
                at(i, uv / DVec2::new(columns as f64, rows as f64)).as_vec3().to_array()
            })
            .collect();
        Self { columns, rows, irradiance }
    }

    /// Irradiance at uv, linear between texels.
    pub fn sample(&self, uv: DVec2) -> DVec3 {
        if self.irradiance.is_empty() {
            return DVec3::ZERO;
        }
        let place = |x: f64, n: usize| {
            let x = (x * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            let low = (x as usize).min(n.saturating_sub(2));
            (low, (low + 1).min(n - 1), (x - low as f64) as f32)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(uv.x, self.columns), place(uv.y, self.rows));
        let at = |x: usize, y: usize| glam::Vec3::from(self.irradiance[y * self.columns + x]);
        let top = at(x0, y0).lerp(at(x1, y0), fx);
        top.lerp(at(x0, y1).lerp(at(x1, y1), fx), fy).as_dvec3()
    }
}

/// The light that arrives at one face.
#[derive(Clone, Debug, Default)]
pub struct FaceLight {
    lamp: Grid,
    soft: Grid,
}

impl FaceLight {
    /// Irradiance at uv.
    pub fn sample(&self, uv: DVec2) -> DVec3 {
        self.lamp.sample(uv) + self.soft.sample(uv)
    }
}

/// How finely to bake.
#[derive(Clone, Copy, Debug)]
pub struct Fineness {
    /// Texel of the table's lamp shadows, metres; everything else scales with it.
    pub table_texel_m: f64,
    /// Of the random numbers.
    pub seed: u64,
}

/// Bakes all faces of the room, and the table's top once more without the ball.
pub fn bake(room: &mut SyntheticRoom, fineness: Fineness) {
    let faces: Vec<(usize, usize)> = room
        .solids
        .iter()
        .enumerate()
        .filter(|(_, s)| !s.shines && !s.mirror)
        .flat_map(|(i, s)| (0..s.shape.faces()).map(move |f| (i, f)))
        .collect();
    for (solid, face) in &faces {
        let light = direct(room, *solid, *face, SyntheticBallView::Present, fineness);
        room.solids[*solid].light[*face] = light;
    }
    let windows: Vec<Grid> = faces.iter().map(|(s, f)| room.solids[*s].light[*f].soft.clone()).collect();
    // Three bounces: each pass gathers what the pass before left on the surfaces.
    for (pass, side) in [(0u64, 4usize), (1, 4), (2, FINAL_SIDE)] {
        let soft: Vec<Grid> = faces
            .iter()
            .zip(&windows)
            .map(|((s, f), w)| {
                gather(room, *s, *f, SyntheticBallView::Present, w, side, fineness.seed + 100 + pass, &|_| {
                    true
                })
            })
            .collect();
        for ((s, f), grid) in faces.iter().zip(soft) {
            room.solids[*s].light[*f].soft = grid;
        }
    }
    room.bare_table = bare_table(room, fineness);
}

/// The table's top without the ball: what it changes is computed anew, all else is kept.
fn bare_table(room: &SyntheticRoom, fineness: Fineness) -> FaceLight {
    let (table, top) = room.table_top;
    let shape = &room.solids[table].shape;
    let lit = &room.solids[table].light[top];
    let ball = room.ball();
    let key = fineness.seed ^ 0xba11;
    let lamp = Grid::compute(lit.lamp.columns, lit.lamp.rows, |i, uv| {
        let (p, n) = shape.face_point(top, uv);
        if room.ball_near_segment(p, room.lamp.centre, room.lamp.radius) {
            lamp_irradiance(room, p, n, SyntheticBallView::Absent, [key, i as u64])
        } else {
            glam::Vec3::from(lit.lamp.irradiance[i]).as_dvec3()
        }
    });
    let near = |p: DVec3| p.distance(ball.centre_world) < NEAR_BALL_RADII * ball.radius_m;
    let window = Grid::compute(lit.soft.columns, lit.soft.rows, |i, uv| {
        let (p, n) = shape.face_point(top, uv);
        if near(p) {
            window_irradiance(room, p, n, SyntheticBallView::Absent, [key ^ 0xa5a5, i as u64])
        } else {
            DVec3::ZERO
        }
    });
    let anew = gather(room, table, top, SyntheticBallView::Absent, &window, FINAL_SIDE, key, &near);
    let soft = Grid::compute(lit.soft.columns, lit.soft.rows, |i, uv| {
        let source = if near(shape.face_point(top, uv).0) { &anew } else { &lit.soft };
        glam::Vec3::from(source.irradiance[i]).as_dvec3()
    });
    FaceLight { lamp, soft }
}

/// Farther from the ball than so many of its radii its presence changes the soft light by less than 1 %.
const NEAR_BALL_RADII: f64 = 7.0;
/// Rays along each side of the last gathering.
const FINAL_SIDE: usize = 10;

/// Texels along a face of this size, about `texel` metres each.
fn counts(size: DVec2, texel: f64) -> (usize, usize) {
    let along = |length: f64| ((length / texel).round() as usize).clamp(3, 4096);
    (along(size.x), along(size.y))
}

/// Light of the lamp and (coarsely) of the window, both with their shadows.
fn direct(
    room: &SyntheticRoom,
    solid: usize,
    face: usize,
    ball: SyntheticBallView,
    fineness: Fineness,
) -> FaceLight {
    let shape = &room.solids[solid].shape;
    let size = shape.face_size(face);
    let scale = fineness.table_texel_m;
    let (lamp_texel, soft_texel) = match room.role(solid, face) {
        super::room::Role::TableTop => (scale, 10.0 * scale),
        super::room::Role::OnTable => (2.0 * scale, 10.0 * scale),
        super::room::Role::Far => (20.0 * scale, 120.0 * scale),
    };
    let key = fineness.seed ^ ((solid as u64) << 40) ^ ((face as u64) << 36) ^ 0x51;
    let (columns, rows) = counts(size, lamp_texel);
    let lamp = Grid::compute(columns, rows, |i, uv| {
        let (p, n) = shape.face_point(face, uv);
        lamp_irradiance(room, p, n, ball, [key, i as u64])
    });
    let (columns, rows) = counts(size, soft_texel);
    let soft = Grid::compute(columns, rows, |i, uv| {
        let (p, n) = shape.face_point(face, uv);
        window_irradiance(room, p, n, ball, [key ^ 0xa5a5, i as u64])
    });
    FaceLight { lamp, soft }
}

/// Irradiance from the lamp's globe: exact where nothing can stand in the way, else the visible share of
/// stratified rays times the unshadowed value.
fn lamp_irradiance(
    room: &SyntheticRoom,
    p: DVec3,
    n: DVec3,
    ball: SyntheticBallView,
    key: [u64; 2],
) -> DVec3 {
    let to = room.lamp.centre - p;
    let distance = to.length();
    let axis = to / distance;
    let sine = room.lamp.radius / distance;
    let cosine_limit = (1.0 - sine * sine).max(0.0).sqrt();
    let facing = n.dot(axis);
    if facing <= -sine {
        return DVec3::ZERO;
    }
    let blockers = room.near_segment(p, room.lamp.centre, room.lamp.radius, ball);
    let high = facing >= sine;
    if high && blockers.is_empty() {
        return room.lamp.radiance(-axis) * (PI * sine * sine * facing);
    }
    let (side_x, side_y) = axis.any_orthonormal_pair();
    let turn = DVec2::from_angle(TAU * uniform_pair([key[0], key[1], 0]).0);
    let cast = |disc: &[DVec2]| {
        let (mut seen, mut all) = (0.0, 0.0);
        for q in disc {
            // The disc's area maps to the cone's solid angle.
            let u = q.length_squared();
            let cosine = 1.0 - u * (1.0 - cosine_limit);
            let around = turn.rotate(*q) * ((1.0 + cosine) * (1.0 - cosine_limit)).sqrt();
            let d = axis * cosine + side_x * around.x + side_y * around.y;
            let weight = n.dot(d).max(0.0);
            all += weight;
            if weight > 0.0 && !room.blocked(p + n * 1e-5, d, distance, &blockers) {
                seen += weight;
            }
        }
        (seen, all / disc.len() as f64)
    };
    let (few, many) = discs();
    let mut rays = few.len();
    let (mut seen, mut mean) = cast(few);
    if seen > 0.0 && seen < mean * (rays as f64 - 1e-6) {
        rays = many.len();
        (seen, mean) = cast(many);
    }
    if mean <= 0.0 {
        return DVec3::ZERO;
    }
    // Above the horizon the cosine's mean over the cap is known exactly; the rays only give the share.
    let unshadowed = if high { PI * sine * sine * facing } else { TAU * (1.0 - cosine_limit) * mean };
    room.lamp.radiance(-axis) * (unshadowed * (seen / (mean * rays as f64)).min(1.0))
}

/// Points spread evenly over the unit disc, on a spiral of the golden angle: a few, and many.
fn discs() -> (&'static [DVec2], &'static [DVec2]) {
    static POINTS: std::sync::OnceLock<(Vec<DVec2>, Vec<DVec2>)> = std::sync::OnceLock::new();
    let spread = |n: usize| (0..n).map(|k| spiral::turn(k) * ((k as f64 + 0.5) / n as f64).sqrt()).collect();
    let points = POINTS.get_or_init(|| (spread(14), spread(64)));
    (&points.0, &points.1)
}

/// Irradiance from the window, by stratified rays over its opening.
fn window_irradiance(
    room: &SyntheticRoom,
    p: DVec3,
    n: DVec3,
    ball: SyntheticBallView,
    key: [u64; 2],
) -> DVec3 {
    let w = &room.window;
    if (w.middle() - p).dot(n) <= -w.reach() {
        return DVec3::ZERO;
    }
    const SIDE: usize = 7;
    let mut sum = DVec3::ZERO;
    for k in 0..SIDE * SIDE {
        let (a, b) = uniform_pair([key[0], key[1], k as u64]);
        let q = w.point(DVec2::new((k % SIDE) as f64 + a, (k / SIDE) as f64 + b) / SIDE as f64);
        let to = q - p;
        let distance = to.length();
        let d = to / distance;
        let weight = n.dot(d).max(0.0) * (-d.x).max(0.0) / (distance * distance);
        if weight > 0.0 && !room.occluded(p + n * 1e-5, d, distance - 1e-4, ball) {
            sum += w.radiance(d) * weight;
        }
    }
    sum * (w.area() / (SIDE * SIDE) as f64)
}

/// `window` plus what the surfaces send to this one, over side x side cosine-distributed rays.
#[allow(clippy::too_many_arguments, reason = "one face of one pass; a struct would be built and read once")]
fn gather(
    room: &SyntheticRoom,
    solid: usize,
    face: usize,
    ball: SyntheticBallView,
    window: &Grid,
    side: usize,
    seed: u64,
    wanted: &(impl Fn(DVec3) -> bool + Sync),
) -> Grid {
    let shape = &room.solids[solid].shape;
    let key = seed ^ ((solid as u64) << 40) ^ ((face as u64) << 36);
    let bounced = Grid::compute(window.columns, window.rows, |i, uv| {
        let (p, n) = shape.face_point(face, uv);
        let mut sum = DVec3::ZERO;
        if !wanted(p) {
            return sum;
        }
        let (side_x, side_y) = n.any_orthonormal_pair();
        for k in 0..side * side {
            let (a, b) = uniform_pair([key, i as u64, k as u64]);
            let u = ((k % side) as f64 + a) / side as f64;
            let v = ((k / side) as f64 + b) / side as f64;
            let around = DVec2::from_angle(TAU * v) * u.sqrt();
            let d = side_x * around.x + side_y * around.y + n * (1.0 - u).sqrt();
            sum += room.bounced(p + n * 1e-5, d, ball);
        }
        sum * (PI / (side * side) as f64)
    });
    let soft = bounced.smoothed();
    Grid {
        irradiance: soft
            .irradiance
            .iter()
            .zip(&window.irradiance)
            .map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]])
            .collect(),
        ..soft
    }
}

impl Grid {
    /// A 3 x 3 binomial blur, to calm the noise of the rays; edges repeat.
    fn smoothed(&self) -> Self {
        let (w, h) = (self.columns, self.rows);
        let pass = |source: &[[f32; 3]], dx: usize, dy: usize| -> Vec<[f32; 3]> {
            (0..w * h)
                .map(|i| {
                    let (x, y) = (i % w, i / w);
                    let before = source[y.saturating_sub(dy) * w + x.saturating_sub(dx)];
                    let after = source[(y + dy).min(h - 1) * w + (x + dx).min(w - 1)];
                    std::array::from_fn(|c| 0.25 * before[c] + 0.5 * source[i][c] + 0.25 * after[c])
                })
                .collect()
        };
        Self { irradiance: pass(&pass(&self.irradiance, 1, 0), 0, 1), ..*self }
    }
}
