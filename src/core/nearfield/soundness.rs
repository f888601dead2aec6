//! What may be wrong with the geometry of a room: open edges, faces without area, faces that look outwards.

use crate::{
    math::{bvh::Bvh, spiral},
    model::room::{Face, Room},
};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Faces whose area is below this share of the squared diagonal have none.
const NO_AREA: f64 = 1e-12;
/// Corners nearer than this share of the room's diagonal are one.
const SAME_CORNER: f64 = 1e-6;
/// Rays start this share of the room's diagonal away from their face.
const LIFT: f32 = 1e-4;
/// Rays to each side of a face.
const RAYS: usize = 12;

/// What was looked at and found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Soundness {
    /// Faces of the room.
    pub faces: usize,
    /// Those without area, or with a corner that is not finite or that there is not.
    pub without_area: usize,
    /// Edges that belong to one face only. Edges that meet another's middle count, and so does the rim of a lone lamp.
    pub open_edges: usize,
    /// Length of the open edges together, metres.
    pub open_m: f32,
    /// Share of the area whose front sees nothing of the room while its back does: 1 for a room whose faces are turned over,
    /// and for a box seen from outside.
    pub outward_share: f32,
    /// Surfaces with such faces, ascending.
    pub outward: Vec<u32>,
}

struct FlatFace {
    corners: Vec<DVec3>,
    surface: u32,
    area: f64,
    normal: Vec3,
    centre: Vec3,
}

/// Looks at a room. The result does not depend on threads.
pub fn examine(room: &Room) -> Soundness {
    let mut found =
        Soundness { faces: room.surfaces.iter().map(|s| s.faces.len()).sum(), ..Default::default() };
    let corners = room.surfaces.iter().flat_map(|s| &s.corners_world).filter(|p| p.is_finite());
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let diagonal = if low.is_finite() { low.as_dvec3().distance(high.as_dvec3()) } else { 0.0 };
    let mut flats = Vec::new();
    for (index, surface) in room.surfaces.iter().enumerate() {
        for face in &surface.faces {
            match flat(&surface.corners_world, face, index as u32, diagonal) {
                Some(flat) => flats.push(flat),
                None => found.without_area += 1,
            }
        }
    }
    (found.open_edges, found.open_m) = open_edges(&flats, diagonal);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for flat in &flats {
        let base = positions.len() as u32;
        positions.extend(flat.corners.iter().map(|p| p.as_vec3()));
        triangles.extend((1..flat.corners.len() as u32 - 1).map(|k| [base, base + k, base + k + 1]));
    }
    let bvh = Bvh::build(&positions, &triangles);
    let (mut outward, mut all) = (0.0, 0.0);
    for flat in &flats {
        all += flat.area;
        let seen = |side: f32| {
            let origin = flat.centre + flat.normal * (side * LIFT * diagonal as f32);
            let rays = (0..RAYS).map(|k| about(flat.normal * side, k));
            rays.filter(|d| bvh.occluded(origin, *d, 0.0, f32::INFINITY)).count()
        };
        if seen(1.0) == 0 && seen(-1.0) == RAYS {
            outward += flat.area;
            found.outward.push(flat.surface);
        }
    }
    found.outward.dedup();
    found.outward_share = if all > 0.0 { (outward / all) as f32 } else { 0.0 };
    found
}

fn flat(corners_world: &[Vec3], face: &Face, surface: u32, diagonal: f64) -> Option<FlatFace> {
    let corner = |i: &u32| corners_world.get(*i as usize).filter(|p| p.is_finite()).map(|p| p.as_dvec3());
    let corners: Vec<DVec3> = face.corners().iter().map(corner).collect::<Option<_>>()?;
    let twice: DVec3 =
        (1..corners.len() - 1).map(|k| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0])).sum();
    let area = 0.5 * twice.length();
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let normal = twice.as_vec3().normalize_or_zero();
    (area > NO_AREA * diagonal * diagonal).then(|| FlatFace {
        corners,
        surface,
        area,
        normal,
        centre: centre.as_vec3(),
    })
}

/// Edges of one face alone, and their length.
fn open_edges(flats: &[FlatFace], diagonal: f64) -> (usize, f32) {
    type CornerKey = [i64; 3];
    let step = (diagonal * SAME_CORNER).max(f64::MIN_POSITIVE);
    let place = |p: DVec3| -> CornerKey { (p / step).round().to_array().map(|c| c as i64) };
    let mut edges: HashMap<(CornerKey, CornerKey), (u32, f64)> = HashMap::new();
    for flat in flats {
        for (k, &p) in flat.corners.iter().enumerate() {
            let q = flat.corners[(k + 1) % flat.corners.len()];
            let (a, b) = (place(p), place(q));
            if a != b {
                edges.entry((a.min(b), a.max(b))).or_insert((0, p.distance(q))).0 += 1;
            }
        }
    }
    let open: Vec<f64> = edges.values().filter(|e| e.0 == 1).map(|e| e.1).collect();
    let mut lengths = open;
    // The map's order is not fixed; sums of floats are where the order is.
    lengths.sort_unstable_by(f64::total_cmp);
    (lengths.len(), lengths.iter().sum::<f64>() as f32)
}

/// The k-th of `RAYS` directions spread by the cosine about a unit vector.
fn about(normal: Vec3, k: usize) -> Vec3 {
    let turn = spiral::turn_f32(k);
    let radius = ((k as f32 + 0.5) / RAYS as f32).sqrt();
    let (across, along) = normal.any_orthonormal_pair();
    across * (radius * turn.x) + along * (radius * turn.y) + normal * (1.0 - radius * radius).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use crate::model::room::RoomSurface;

    fn turned(room: &Room) -> Room {
        let turn = |surface: &RoomSurface| {
            let faces = surface.faces.iter().map(|f| match *f {
                Face::Quad([a, b, c, d]) => Face::Quad([d, c, b, a]),
                Face::Triangle([a, b, c]) => Face::Triangle([c, b, a]),
            });
            RoomSurface { faces: faces.collect(), ..surface.clone() }
        };
        Room { surfaces: room.surfaces.iter().map(turn).collect() }
    }

    #[test]
    fn a_sound_room_is_closed_but_for_its_lamp() {
        let found = examine(&fixture::room());
        // The lamp is one quadrilateral of 0.6 m a side.
        assert_eq!((found.faces, found.without_area, found.open_edges), (13, 0, 4));
        assert!((found.open_m - 2.4).abs() < 1e-5, "{found:?}");
        assert_eq!((found.outward_share, found.outward.len()), (0.0, 0));
    }

    #[test]
    fn a_room_turned_over_is_told() {
        let walls = Room { surfaces: vec![fixture::walls(0.0)] };
        let found = examine(&turned(&walls));
        assert_eq!((found.outward_share, &found.outward[..], found.open_edges), (1.0, &[0][..], 0));
        // The table's faces look into the table then, which hides all of the room; walls are 59 of 61 m2.
        let found = examine(&turned(&fixture::room()));
        assert!(found.outward_share > 0.9, "{found:?}");
    }

    #[test]
    fn a_missing_wall_leaves_four_edges_open() {
        let mut walls = fixture::walls(0.0);
        walls.faces.pop();
        let found = examine(&Room { surfaces: vec![walls] });
        // The ceiling of 4 x 3 m.
        assert_eq!(found.open_edges, 4);
        assert!((found.open_m - 14.0).abs() < 1e-4 && found.outward_share == 0.0, "{found:?}");
    }

    #[test]
    fn broken_faces_are_counted() {
        let mut walls = fixture::walls(0.0);
        walls.corners_world.push(Vec3::NAN);
        walls.faces.extend([
            Face::Triangle([0, 0, 1]),
            Face::Triangle([0, 1, 8]),
            Face::Triangle([0, 1, 99]),
        ]);
        let found = examine(&Room { surfaces: vec![walls] });
        assert_eq!((found.faces, found.without_area, found.open_edges), (9, 3, 0));
        assert_eq!(examine(&Room::default()), Soundness::default());
    }
}
