//! Divides a room into patches (Section 3 of [Gib03]): of about one size, and finer where the light is.

use super::{error::RoomError, shadow_edges::ShadowEdges, transfer::Statics};
use crate::{
    math::color,
    model::room::{Face, PatchVertex, Room, RoomPatch, RoomPatches},
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::{
    cmp::Ordering,
    collections::{BinaryHeap, HashMap},
};

/// Most patches that may be asked for.
pub const MAX_PATCHES: usize = 20_000;
/// Faces whose area is below this share of the squared diagonal have none.
const NO_AREA: f64 = 1e-12;
/// Light is gathered for a corner this share of the way towards the middle of its patches...
const INSET: f64 = 0.02;
/// ...and this share of the room's diagonal before them.
const LIFT: f64 = 1e-4;
/// Corners nearer than this share of the room's diagonal are one.
const SAME_CORNER: f64 = 1e-6;
/// Patches are not made smaller for a shadow's edge than this share of the first patches' size.
const FINEST_EDGE: f64 = 0.06;
/// How much more a difference of radiance within a patch counts than its radiance: light in the wrong place is worse
/// than light of the right place drawn as one point.
const CONTRAST: f64 = 2.0;

/// How finely a room is divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subdivision {
    /// Patches aimed at, 1 to 20,000. Never fewer than the room has faces.
    pub patches: usize,
    /// Share of them that is spent on making patches finer where they shine most or unevenly. With `edges` 0 to 0.95.
    pub refined: f32,
    /// Share of them that is spent on the edges of the room's own shadows.
    pub edges: f32,
}

impl Default for Subdivision {
    /// 1500 patches, as in [Gib03] ("between 1000 and 2000"), many of them where the light is and where shadows end.
    fn default() -> Self {
        Self { patches: 1500, refined: 0.35, edges: 0.45 }
    }
}

/// A place on a surface whose radiance is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Index into [`Room::surfaces`].
    pub surface: usize,
    /// World frame, metres.
    pub point_world: Vec3,
    /// Unit vector away from the front, world frame.
    pub normal_world: Vec3,
}

/// A patch to be.
#[derive(Clone, Copy, Debug)]
struct PatchPiece {
    corners: [DVec3; 4],
    count: usize,
    normal: DVec3,
    surface: u32,
    /// Order of making: surface, face and place.
    order: u32,
    radiance: [f32; 3],
    seen: bool,
    error: f64,
}

impl PartialEq for PatchPiece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for PatchPiece {}
impl PartialOrd for PatchPiece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for PatchPiece {
    fn cmp(&self, other: &Self) -> Ordering {
        // Of equals the earlier one.
        self.error.total_cmp(&other.error).then(other.order.cmp(&self.order))
    }
}

/// Divides `room`. `radiance` gives the measured radiance (linear RGB) that leaves a place of a surface, or `None` where it
/// was not seen; there the surface's own light stands in. It is asked at nine places of every patch.
///
/// Faces are first cut into equal parts whose size is the same all over; then the part of largest error, the square of
/// its power times its size, is halved until there are enough, with the difference of radiance within it counted twice.
/// Then those of the receivers are halved between whose corners the room's own shadows end.
/// Patches keep their face's front; vertices are shared within the plane of a surface.
///
/// # Errors
/// A setting out of range, or no face that has an area.
pub fn subdivide(
    room: &Room,
    how: &Subdivision,
    radiance: &dyn Fn(&SurfacePoint) -> Option<[f32; 3]>,
) -> Result<RoomPatches, RoomError> {
    if !(1..=MAX_PATCHES).contains(&how.patches) {
        let (value, allowed) = (how.patches.to_string(), "within 1 to 20000");
        return Err(RoomError::Setting { setting: "patches", value, allowed });
    }
    for (setting, share) in [("refined", how.refined), ("edges", how.edges)] {
        if !(share >= 0.0 && how.refined + how.edges <= 0.95) {
            let (value, allowed) = (share.to_string(), "within 0 to 0.95, with the other share");
            return Err(RoomError::Setting { setting, value, allowed });
        }
    }
    let (faces, dropped_faces, diagonal) = usable_faces(room);
    if faces.is_empty() {
        return Err(RoomError::NoFaces { surfaces: room.surfaces.len(), dropped: dropped_faces });
    }
    let sample = |piece: PatchPiece, order: u32| examine(piece, order, room, radiance);
    let total: f64 = faces.iter().map(area).sum();
    let first = how.patches as f64 * (1.0 - f64::from(how.refined) - f64::from(how.edges));
    let size = (total / first.max(1.0)).sqrt();
    let mut pieces = Vec::new();
    for face in &faces {
        cut_evenly(face, size, &mut pieces);
    }
    let mut order = 0;
    let mut next = || {
        order += 1;
        order
    };
    let mut queue: BinaryHeap<PatchPiece> = pieces.into_iter().map(|p| sample(p, next())).collect();
    let for_edges = (how.patches as f64 * f64::from(how.edges)) as usize;
    halve_worst(&mut queue, how.patches - for_edges, |half| sample(half, next()));
    if for_edges > 0 {
        let mut lit = queue.into_vec();
        lit.sort_unstable_by_key(|p| (p.surface, p.order));
        let edges = edges_of(room, &lit, diagonal);
        let judged =
            |piece: PatchPiece| PatchPiece { error: edge_error(&edges, room, &piece, size), ..piece };
        queue = lit.into_par_iter().map(judged).collect::<Vec<_>>().into();
        halve_worst(&mut queue, how.patches, |half| judged(sample(half, next())));
    }
    let mut pieces = queue.into_vec();
    pieces.sort_unstable_by_key(|p| (p.surface, p.order));
    Ok(assemble(room, &pieces, diagonal, dropped_faces))
}

/// Halves the piece of largest error until there are `count`, or no error is left.
fn halve_worst(
    queue: &mut BinaryHeap<PatchPiece>,
    count: usize,
    mut examined: impl FnMut(PatchPiece) -> PatchPiece,
) {
    while queue.len() < count {
        if queue.peek().is_none_or(|worst| !(worst.error > 0.0)) {
            break;
        }
        let Some(worst) = queue.pop() else { break };
        for half in halves(&worst) {
            queue.push(examined(half));
        }
    }
}

/// The judge of shadow edges, from what shines.
fn edges_of(room: &Room, pieces: &[PatchPiece], diagonal: f64) -> ShadowEdges {
    let shine = |p: &PatchPiece| {
        let luminance = f64::from(color::luminance(p.radiance));
        (centroid(p), p.normal, area(p) * luminance, luminance)
    };
    let shining: Vec<_> = pieces.iter().map(shine).filter(|s| s.2 > 0.0).collect();
    let mut edges = ShadowEdges::new(Statics::new(room), &shining, LIFT * diagonal);
    let receivers: Vec<_> =
        pieces.iter().filter(|p| reflects(room, p)).map(|p| (centroid(p), p.normal)).collect();
    edges.set_mean(&receivers);
    edges
}

fn reflects(room: &Room, piece: &PatchPiece) -> bool {
    room.surfaces[piece.surface as usize].reflectance_rgb.iter().any(|c| *c > 0.0)
}

/// 0 where nothing is reflected, and where the piece is small enough for any edge.
fn edge_error(edges: &ShadowEdges, room: &Room, piece: &PatchPiece, size: f64) -> f64 {
    let area = area(piece);
    if !reflects(room, piece) || area < (FINEST_EDGE * size).powi(2) {
        return 0.0;
    }
    edges.error(&piece.corners[..piece.count], centroid(piece), piece.normal, area)
}

/// Faces with an area, as pieces; how many were left out; the room's diagonal.
fn usable_faces(room: &Room) -> (Vec<PatchPiece>, usize, f64) {
    let corners = room.surfaces.iter().flat_map(|s| &s.corners_world).filter(|p| p.is_finite());
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let diagonal = if low.is_finite() { low.as_dvec3().distance(high.as_dvec3()) } else { 0.0 };
    let (mut faces, mut dropped) = (Vec::new(), 0);
    for (index, surface) in room.surfaces.iter().enumerate() {
        for face in &surface.faces {
            let corner = |i: &u32| surface.corners_world.get(*i as usize).filter(|p| p.is_finite());
            let found: Vec<DVec3> = face.corners().iter().filter_map(corner).map(|p| p.as_dvec3()).collect();
            let before = faces.len();
            if found.len() == face.corners().len() {
                let piece = |corners: [DVec3; 4], count| PatchPiece {
                    corners,
                    count,
                    normal: DVec3::ZERO,
                    surface: index as u32,
                    order: 0,
                    radiance: [0.0; 3],
                    seen: false,
                    error: 0.0,
                };
                let triangle =
                    |i: usize, j: usize, k: usize| piece([found[i], found[j], found[k], found[k]], 3);
                match face {
                    Face::Triangle(_) => faces.push(triangle(0, 1, 2)),
                    Face::Quad(_) if is_flat_and_convex(&found) => {
                        faces.push(piece([found[0], found[1], found[2], found[3]], 4));
                    }
                    Face::Quad(_) => faces.extend([triangle(0, 1, 2), triangle(0, 2, 3)]),
                }
            }
            // A bent quadrilateral with one empty half is the other half.
            let mut at = before;
            while at < faces.len() {
                let twice = double_area_vector(&faces[at]);
                if twice.length() > 2.0 * NO_AREA * diagonal * diagonal {
                    faces[at].normal = twice.normalize();
                    at += 1;
                } else {
                    faces.remove(at);
                }
            }
            dropped += usize::from(faces.len() == before);
        }
    }
    (faces, dropped, diagonal)
}

fn is_flat_and_convex(corners: &[DVec3]) -> bool {
    let turn = |i: usize| {
        let (a, b, c) = (corners[i], corners[(i + 1) % 4], corners[(i + 2) % 4]);
        (b - a).cross(c - b)
    };
    let whole = (corners[2] - corners[0]).cross(corners[3] - corners[1]);
    let flat = (corners[1] - corners[0]).dot(whole).abs() <= 1e-4 * whole.length().powf(1.5);
    flat && (0..4).all(|i| turn(i).dot(whole) > 1e-9 * whole.length_squared())
}

fn double_area_vector(piece: &PatchPiece) -> DVec3 {
    let [a, b, c, d] = piece.corners;
    (b - a).cross(c - a) + (c - a).cross(d - a)
}

fn area(piece: &PatchPiece) -> f64 {
    0.5 * double_area_vector(piece).length()
}

/// Place within a piece: u from the side 3-0 to the side 1-2, v from the side 0-1 on.
fn place(piece: &PatchPiece, u: f64, v: f64) -> DVec3 {
    let [a, b, c, d] = piece.corners;
    a.lerp(b, u).lerp(d.lerp(c, u), v)
}

/// Equal parts of about `size` metres a side.
fn cut_evenly(face: &PatchPiece, size: f64, out: &mut Vec<PatchPiece>) {
    let parts = |length: f64| ((length / size).round() as usize).clamp(1, MAX_PATCHES);
    let [a, b, c, d] = face.corners;
    if face.count == 4 {
        let columns = parts(0.5 * (a.distance(b) + d.distance(c)));
        let rows = parts(0.5 * (b.distance(c) + a.distance(d)));
        for j in 0..rows {
            for i in 0..columns {
                let at = |i: usize, j: usize| place(face, i as f64 / columns as f64, j as f64 / rows as f64);
                let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                out.push(PatchPiece { corners, ..*face });
            }
        }
        return;
    }
    // Triangles are halved until they are small enough: equal halves of equal triangles.
    let mut open = vec![*face];
    while let Some(piece) = open.pop() {
        if area(&piece) > 1.42 * size * size && out.len() < 4 * MAX_PATCHES {
            let [first, second] = halves(&piece);
            open.extend([second, first]);
        } else {
            out.push(piece);
        }
    }
}

/// Cut through the middles of the longer sides; a triangle through the middle of its longest.
fn halves(piece: &PatchPiece) -> [PatchPiece; 2] {
    let [a, b, c, d] = piece.corners;
    let with = |corners| PatchPiece { corners, ..*piece };
    if piece.count == 4 {
        return if a.distance(b) + d.distance(c) >= b.distance(c) + a.distance(d) {
            let (low, high) = (a.midpoint(b), d.midpoint(c));
            [with([a, low, high, d]), with([low, b, c, high])]
        } else {
            let (left, right) = (a.midpoint(d), b.midpoint(c));
            [with([a, b, right, left]), with([left, right, c, d])]
        };
    }
    let lengths = [a.distance(b), b.distance(c), c.distance(a)];
    let longest = if lengths[0] >= lengths[1] && lengths[0] >= lengths[2] {
        [a, b, c]
    } else if lengths[1] >= lengths[2] {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let [p, q, r] = longest;
    let middle = p.midpoint(q);
    [with([p, middle, r, r]), with([middle, q, r, r])]
}

/// Nine places: the middle, and half way and nearly all the way to the corners.
fn examine(
    mut piece: PatchPiece,
    order: u32,
    room: &Room,
    radiance: &dyn Fn(&SurfacePoint) -> Option<[f32; 3]>,
) -> PatchPiece {
    let centre = centroid(&piece);
    let corners = &piece.corners[..piece.count];
    let places = [0.5, 0.95].into_iter().flat_map(|t| corners.iter().map(move |c| centre.lerp(*c, t)));
    let (mut sum, mut number, mut asked) = ([0.0f64; 3], 0u32, 0u32);
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for point in places.chain([centre]) {
        asked += 1;
        let (point_world, normal_world) = (point.as_vec3(), piece.normal.as_vec3());
        let at = SurfacePoint { surface: piece.surface as usize, point_world, normal_world };
        let Some(rgb) = radiance(&at) else { continue };
        // What is not a number or negative is no light; what is infinite is a very bright one.
        let rgb = rgb.map(|c| c.clamp(0.0, 64_000.0)).map(|c| if c.is_nan() { 0.0 } else { c });
        number += 1;
        sum.iter_mut().zip(rgb).for_each(|(sum, c)| *sum += f64::from(c));
        let luminance = f64::from(color::luminance(rgb));
        (least, most) = (least.min(luminance), most.max(luminance));
    }
    piece.seen = 2 * number > asked;
    piece.radiance = if piece.seen {
        sum.map(|c| (c / f64::from(number)) as f32)
    } else {
        (least, most) = (0.0, 0.0);
        room.surfaces[piece.surface as usize].emitted_rgb.map(|c| if c > 0.0 { c.min(64_000.0) } else { 0.0 })
    };
    let mean = f64::from(color::luminance(piece.radiance));
    let uneven = CONTRAST * (most - least).max(0.0);
    // Power squared times size: the penumbra drawn wrong (see `sources::cut`).
    piece.error = area(&piece).powf(2.5) * (mean * mean + uneven * uneven);
    piece.order = order;
    piece
}

fn centroid(piece: &PatchPiece) -> DVec3 {
    let [a, b, c, d] = piece.corners;
    let weight = |p: DVec3, q: DVec3| (p - a).cross(q - a).dot(piece.normal);
    let (first, second) = (weight(b, c), weight(c, d));
    let sum = first + second;
    ((a + b + c) * first + (a + c + d) * second) / (3.0 * sum)
}

/// Shares vertices and fills in what each patch says of itself.
fn assemble(room: &Room, pieces: &[PatchPiece], diagonal: f64, dropped_faces: usize) -> RoomPatches {
    let mut known: HashMap<(u32, [i64; 3], [i64; 3]), u32> = HashMap::new();
    let mut out = RoomPatches { dropped_faces, ..RoomPatches::default() };
    let mut inwards: Vec<(DVec3, f64)> = Vec::new();
    let step = (diagonal * SAME_CORNER).max(f64::MIN_POSITIVE);
    let rounded = |v: DVec3, step: f64| (v / step).round().to_array().map(|c| c as i64);
    for piece in pieces {
        let centre = centroid(piece);
        let corners = piece.corners.map(|position| {
            let key = (piece.surface, rounded(piece.normal, 1e-3), rounded(position, step));
            let index = *known.entry(key).or_insert_with(|| {
                let (position_world, normal_world) = (position.as_vec3(), piece.normal.as_vec3());
                out.vertices.push(PatchVertex { position_world, gather_world: position_world, normal_world });
                inwards.push((DVec3::ZERO, 0.0));
                (out.vertices.len() - 1) as u32
            });
            let (sum, number) = &mut inwards[index as usize];
            *sum += centre - position;
            *number += 1.0;
            index
        });
        let surface = &room.surfaces[piece.surface as usize];
        out.patches.push(RoomPatch {
            corners,
            centre_world: centre.as_vec3(),
            normal_world: piece.normal.as_vec3(),
            area_m2: area(piece) as f32,
            radiance_rgb: piece.radiance,
            reflectance_rgb: surface
                .reflectance_rgb
                .map(|c| c.clamp(0.0, 1.0))
                .map(|c| if c.is_nan() { 0.0 } else { c }),
            seen: piece.seen,
            surface: piece.surface,
        });
    }
    for (vertex, (sum, number)) in out.vertices.iter_mut().zip(inwards) {
        let lift = vertex.normal_world.as_dvec3() * (LIFT * diagonal);
        let position = vertex.position_world.as_dvec3();
        vertex.gather_world = (position + sum * (INSET / f64::max(number, 1.0)) + lift).as_vec3();
    }
    out
}

#[cfg(test)]
mod tests;
