//! What a camera sees of everything that hard shadows fall on: shadow maps need to be no wider than that.

use crate::math::{lens::Lens, pose::Pose};
use glam::{DVec2, DVec3, Vec3};

/// Triangles of real surfaces that are looked at one by one; of more, boxes around runs of them are.
const MOST_TRIANGLES: usize = 256;
/// Boxes that stand for more triangles than that.
const MOST_BOXES: usize = 64;
/// Sides of the cone that holds a picture.
const SIDES: usize = 8;
/// Places on each border of a picture where its rays are taken.
const BORDER_STEPS: u32 = 32;
/// Room around the picture, as a share of its half width: what its border bulges between those places (a thousandth of its
/// sagitta), and rounding.
const BORDER_ROOM: f64 = 2e-3;
/// A picture that reaches farther from its axis than this tangent (85 degrees) has no cone: all is seen.
const WIDEST_TANGENT: f64 = 11.0;
/// Corners that a triangle or the side of a box may get: the light's rectangle has four more sides than the cone.
const MOST_CORNERS: usize = 4 + SIDES + 4;

/// A virtual body that shadows fall on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowedBody {
    /// Low corner of a box around it, world frame, metres.
    pub low: Vec3,
    /// High corner.
    pub high: Vec3,
    /// It shows shadows that the camera does not see itself.
    pub is_mirror: bool,
}

/// What a camera sees of receivers, as flat convex pieces. Keeps its memory. As made by `default`, all is seen.
#[derive(Clone, Debug)]
pub struct Receivers {
    triangles: Vec<[DVec3; 3]>,
    boxes: Vec<[DVec3; 2]>,
    lens: Option<Lens>,
    cone: Option<[DVec3; SIDES]>,
    is_everywhere: bool,
    corners: Vec<DVec3>,
    pieces: Vec<ReceiverPiece>,
}

/// A flat convex piece: its corners, and on which side it is seen (`None`: a box's, which stands for all sides).
#[derive(Clone, Copy, Debug)]
struct ReceiverPiece {
    first: usize,
    end: usize,
    seen_side: Option<DVec3>,
}

impl Default for Receivers {
    fn default() -> Self {
        Self {
            triangles: Vec::new(),
            boxes: Vec::new(),
            lens: None,
            cone: None,
            is_everywhere: true,
            corners: Vec::new(),
            pieces: Vec::new(),
        }
    }
}

impl Receivers {
    /// Takes the real surfaces of a scene (world frame, metres): the triangles that `receives` marks.
    pub fn load(&mut self, positions: &[Vec3], triangles: &[[u32; 3]], receives: &[bool]) {
        let receiving = || {
            let marked = triangles.iter().zip(receives).filter(|(_, receives)| **receives);
            marked.map(|(t, _)| t.map(|i| positions.get(i as usize).map_or(DVec3::NAN, |p| p.as_dvec3())))
        };
        self.triangles.clear();
        self.boxes.clear();
        let count = receiving().count();
        if count <= MOST_TRIANGLES {
            self.triangles.extend(receiving());
        } else {
            let run = count.div_ceil(MOST_BOXES);
            for (k, triangle) in receiving().enumerate() {
                if k % run == 0 {
                    self.boxes.push([DVec3::INFINITY, DVec3::NEG_INFINITY]);
                }
                if let Some([low, high]) = self.boxes.last_mut() {
                    *low = triangle.iter().fold(*low, |low, p| low.min(*p));
                    *high = triangle.iter().fold(*high, |high, p| high.max(*p));
                }
            }
        }
        self.see_all();
        let pieces = self.triangles.len() + 6 * self.boxes.len();
        self.pieces.reserve(pieces);
        self.corners.reserve(pieces * MOST_CORNERS);
    }

    /// All receivers count, seen or not.
    pub fn see_all(&mut self) {
        self.is_everywhere = true;
    }

    /// Finds what a camera sees of the surfaces of [`Self::load`] and of virtual bodies: all that is in its picture, whether
    /// or not something is in front. Through a mirror, and where the picture is wider than a cone, it may see all.
    pub fn see(&mut self, lens: &Lens, world_from_camera: &Pose, bodies: impl Iterator<Item = ShadowedBody>) {
        if self.lens.as_ref() != Some(lens) {
            self.cone = cone(lens);
            self.lens = Some(*lens);
        }
        self.corners.clear();
        self.pieces.clear();
        self.is_everywhere = true;
        let Some(cone) = self.cone else { return };
        let eye = world_from_camera.translation;
        let sides = cone.map(|side| world_from_camera.rotate(side));
        if !(eye.is_finite() && sides.iter().all(|side| side.is_finite())) {
            return;
        }
        for k in 0..self.triangles.len() {
            let [a, b, c] = self.triangles[k];
            let normal = (b - a).cross(c - a);
            let side = normal.dot(eye - a);
            if side != 0.0 {
                self.add(&[a, b, c], &sides, eye, Some(side.signum() * normal));
            }
        }
        for k in 0..self.boxes.len() {
            self.add_box(self.boxes[k], &sides, eye);
        }
        for body in bodies {
            let before = self.pieces.len();
            self.add_box([body.low.as_dvec3(), body.high.as_dvec3()], &sides, eye);
            if body.is_mirror && self.pieces.len() > before {
                return;
            }
        }
        self.is_everywhere = false;
    }

    /// What of a box is in the picture.
    fn add_box(&mut self, [low, high]: [DVec3; 2], sides: &[DVec3; SIDES], eye: DVec3) {
        if !(low.is_finite() && high.is_finite() && low.cmple(high).all()) {
            return;
        }
        if eye.cmpge(low).all() && eye.cmple(high).all() {
            let first = self.corners.len();
            self.corners.push(eye);
            self.pieces.push(ReceiverPiece { first, end: first + 1, seen_side: None });
        }
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for at in [low[axis], high[axis]] {
                let corner = |a: f64, b: f64| {
                    let mut p = DVec3::splat(at);
                    (p[u], p[v]) = (a, b);
                    p
                };
                let quad = [
                    corner(low[u], low[v]),
                    corner(high[u], low[v]),
                    corner(high[u], high[v]),
                    corner(low[u], high[v]),
                ];
                self.add(&quad, sides, eye, None);
            }
        }
    }

    /// What of a flat convex piece is in the picture.
    fn add(&mut self, piece: &[DVec3], sides: &[DVec3; SIDES], eye: DVec3, seen_side: Option<DVec3>) {
        if !piece.iter().all(|p| p.is_finite()) {
            return;
        }
        let mut seen = Corners::of(piece);
        for side in sides {
            seen.cut(|p| side.dot(*p - eye), |_| ());
        }
        if seen.count > 0 {
            let first = self.corners.len();
            self.corners.extend(seen.as_slice());
            self.pieces.push(ReceiverPiece { first, end: self.corners.len(), seen_side });
        }
    }

    /// Low and high corner, in a light's plane, of what of a rectangle (low and high corner) is seen on the side that the light
    /// shines on, or is the nearest to what is seen at most `beside` outside of it; `right` and `up` are the plane's axes,
    /// `light` points towards the light, world frame. `None`: nothing. Where all of the rectangle's sides are reached, the
    /// rectangle to the last bit.
    pub(super) fn within(
        &self,
        [right, up, light]: [DVec3; 3],
        [low, high]: [DVec2; 2],
        beside: f64,
    ) -> Option<[DVec2; 2]> {
        if self.is_everywhere {
            return Some([low, high]);
        }
        let (least, most) = (low - beside, high + beside);
        let (mut from, mut to) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for piece in &self.pieces {
            if piece.seen_side.is_some_and(|side| side.dot(light) <= 0.0) {
                continue;
            }
            let corners = &self.corners[piece.first..piece.end];
            let mut flat = Corners { count: corners.len(), at: [DVec2::ZERO; MOST_CORNERS] };
            let (mut first, mut last) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            for (flat, p) in flat.at.iter_mut().zip(corners) {
                *flat = DVec2::new(right.dot(*p), up.dot(*p));
                (first, last) = (first.min(*flat), last.max(*flat));
            }
            let is_beside = first.cmpgt(most).any() || last.cmplt(least).any();
            if is_beside || (first.cmpge(from).all() && last.cmple(to).all()) {
                continue;
            }
            for axis in 0..2 {
                flat.cut(|p| p[axis] - least[axis], |p| p[axis] = least[axis]);
                flat.cut(|p| most[axis] - p[axis], |p| p[axis] = most[axis]);
            }
            for p in flat.as_slice() {
                (from, to) = (from.min(*p), to.max(*p));
            }
        }
        from.cmple(to).all().then(|| [from.clamp(low, high), to.clamp(low, high)])
    }
}

/// The corners of a flat convex piece, in order.
struct Corners<P> {
    count: usize,
    at: [P; MOST_CORNERS],
}

impl<P> Corners<P>
where
    P: Copy
        + Default
        + std::ops::Add<Output = P>
        + std::ops::Sub<Output = P>
        + std::ops::Mul<f64, Output = P>,
{
    fn of(corners: &[P]) -> Self {
        let mut all = Self { count: corners.len().min(MOST_CORNERS), at: [P::default(); MOST_CORNERS] };
        all.at.iter_mut().zip(corners).for_each(|(slot, p)| *slot = *p);
        all
    }

    fn as_slice(&self) -> &[P] {
        &self.at[..self.count]
    }

    /// Keeps what lies where `height` is not negative; `place` moves new corners onto the cut.
    fn cut(&mut self, height: impl Fn(&P) -> f64, place: impl Fn(&mut P)) {
        let (whole, count) = (self.at, self.count);
        self.count = 0;
        let mut keep = |p: P| {
            if let Some(slot) = self.at.get_mut(self.count) {
                *slot = p;
                self.count += 1;
            }
        };
        for i in 0..count {
            let (a, b) = (whole[i], whole[(i + 1) % count]);
            let (above, next) = (height(&a), height(&b));
            if above >= 0.0 {
                keep(a);
            }
            if (above >= 0.0) != (next >= 0.0) {
                let mut p = a + (b - a) * (above / (above - next));
                place(&mut p);
                keep(p);
            }
        }
    }
}

/// Inward normals, camera frame, of planes through the eye that hold the whole picture between them; `None` where the
/// picture is too wide for that. For a pinhole four of them are its borders.
fn cone(lens: &Lens) -> Option<[DVec3; SIDES]> {
    let sides: [DVec2; SIDES] = std::array::from_fn(|k| {
        let (y, x) = (std::f64::consts::TAU * k as f64 / SIDES as f64).sin_cos();
        DVec2::new(x, y)
    });
    let mut reach = [f64::NEG_INFINITY; SIDES];
    let (width, height) = (f64::from(lens.width), f64::from(lens.height));
    let mut widest = 0.0f64;
    for k in 0..=BORDER_STEPS {
        let t = f64::from(k) / f64::from(BORDER_STEPS);
        for (x, y) in [(t * width, 0.0), (t * width, height), (0.0, t * height), (width, t * height)] {
            // The rays of the border hold those of the picture between them: the lens folds nowhere inside.
            let ray = lens.unproject(DVec2::new(x, y)).filter(|ray| ray.z > 0.0)?;
            let at = ray.truncate() / ray.z;
            widest = widest.max(at.length());
            for (reach, side) in reach.iter_mut().zip(sides) {
                *reach = reach.max(side.dot(at));
            }
        }
    }
    let room = BORDER_ROOM * widest;
    let planes = |k: usize| (-sides[k]).extend(reach[k] + room);
    (widest < WIDEST_TANGENT).then(|| std::array::from_fn(planes))
}

#[cfg(test)]
mod tests;
