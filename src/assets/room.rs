//! Known rooms from glTF files (.glb, .gltf).
//!
//! # glTF
//! Frame, nodes and metres as `gltf`: (x, y, z) of the file becomes (x, -z, y). One surface for each primitive of each
//! node. The front of a face is the side from which its corners run counter-clockwise, whatever its normals and
//! `doubleSided` say: a front reflects and shines, a back only hides. Reflectance is the base colour, at most
//! `MOST_REFLECTED`; emitted radiance the emissive colour times its strength (`gltf::room`).
//!
//! Triangles that share an edge, lie in one plane and make a convex quadrilateral become one face: its patches are better
//! shaped. Triangles without area are left out and counted.
//!
//! # What is wrong with a room
//! Not an error, but said in `notes`: open edges (light through them is not known of), faces that look outwards (they stay
//! as they are: such a room is dark, and its patches receive nothing), triangles without area.

use super::{
    error::{AssetError, read_file},
    gltf::room::{RoomPart, decode_parts},
    names::UniqueNames,
};
use crate::{
    model::room::{Face, Room, RoomSurface},
    nearfield::{
        patches::MAX_PATCHES,
        soundness::{Soundness, examine},
    },
};
use glam::{DVec3, Vec3};
use std::{collections::HashMap, path::Path};

/// Largest reflectance: gathering light again and again has to end. Fresh snow and the best white paints reach it.
pub const MOST_REFLECTED: f32 = 0.98;
/// Share of the area that has to look outwards before it is told.
const LEAST_OUTWARD: f32 = 0.01;
/// Faces whose normals' cosine is less below 1 than this lie in one plane.
const ONE_PLANE: f64 = 1e-6;
/// Corners of a quadrilateral turn by at least this share of what a square's do.
const LEAST_TURN: f64 = 1e-3;

/// A room, and what is wrong with it.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedRoom {
    /// Surfaces in the order of the file.
    pub room: Room,
    /// What was looked at.
    pub soundness: Soundness,
    /// What is wrong, a sentence each; empty for a closed room of sound faces.
    pub notes: Vec<String>,
}

/// Loads a room from a glTF file.
///
/// # Errors
/// The file cannot be read or is damaged, holds no face that has an area or more than 20,000, or a number that is not
/// finite (file and node are named).
pub fn load_room(file: &Path) -> Result<LoadedRoom, AssetError> {
    decode_room(file, &read_file(file)?)
}

/// `load_room` for the bytes of a glTF file; `file` is for messages and tells where other files are.
///
/// # Errors
/// As `load_room`.
pub fn decode_room(file: &Path, bytes: &[u8]) -> Result<LoadedRoom, AssetError> {
    let parts = decode_parts(file, bytes)?;
    let without_area = parts.iter().map(|p| p.without_area).sum();
    let mut names = UniqueNames::default();
    let surfaces = parts.into_iter().filter(|p| !p.triangles.is_empty()).map(|mut part| {
        part.name = names.give(part.name);
        surface(part)
    });
    let room = Room { surfaces: surfaces.collect() };
    judged(file, room, without_area)
}

/// A room with what is wrong with it; `left_out` triangles without area have been dropped already.
///
/// # Errors
/// The room holds no face that has an area, or more than 20,000.
pub fn judged(file: &Path, room: Room, left_out: usize) -> Result<LoadedRoom, AssetError> {
    let mut soundness = examine(&room);
    soundness.without_area += left_out;
    let usable = soundness.faces.saturating_sub(soundness.without_area - left_out);
    if usable == 0 {
        let surfaces = room.surfaces.len();
        return Err(AssetError::new(file, "faces that have an area")
            .value(usable)
            .allowed("at least 1")
            .cause(format!("{surfaces} surfaces, {} faces without area", soundness.without_area)));
    }
    if usable > MAX_PATCHES {
        return Err(AssetError::new(file, "faces")
            .value(usable)
            .allowed(format!("at most {MAX_PATCHES}: rough geometry is enough")));
    }
    let notes = notes(&room, &soundness);
    Ok(LoadedRoom { room, soundness, notes })
}

fn notes(room: &Room, soundness: &Soundness) -> Vec<String> {
    let mut notes = Vec::new();
    if soundness.without_area > 0 {
        notes.push(format!("{} faces without area are left out", soundness.without_area));
    }
    if soundness.open_edges > 0 {
        notes.push(format!(
            "{} edges ({:.2} m) belong to one face only: light that comes through open places is not known of",
            soundness.open_edges, soundness.open_m
        ));
    }
    // Feet of furniture that stand on the floor are no mistake.
    if soundness.outward_share > LEAST_OUTWARD {
        let names: Vec<&str> = soundness
            .outward
            .iter()
            .take(5)
            .filter_map(|&i| room.surfaces.get(i as usize))
            .map(|s| s.name.as_str())
            .collect();
        let more = soundness.outward.len().saturating_sub(names.len());
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        notes.push(format!(
            "{:.0} % of the area looks outwards, where nothing is: turn the faces of {}{more} (a back reflects and sends out nothing)",
            100.0 * soundness.outward_share,
            names.join(", "),
        ));
    }
    notes
}

/// Corners at one place become one, pairs of triangles quadrilaterals.
fn surface(part: RoomPart) -> RoomSurface {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut corners_world = Vec::new();
    let index_of: Vec<u32> = part
        .positions_world
        .iter()
        .map(|p| {
            // + 0.0: the two zeros are one place.
            let bits = p.to_array().map(|c| (c + 0.0).to_bits());
            *known.entry(bits).or_insert_with(|| {
                corners_world.push(*p);
                (corners_world.len() - 1) as u32
            })
        })
        .collect();
    let triangles: Vec<[u32; 3]> =
        part.triangles.iter().map(|t| t.map(|i| index_of.get(i as usize).copied().unwrap_or(0))).collect();
    let faces = paired(&corners_world, &triangles);
    RoomSurface {
        name: part.name,
        corners_world,
        faces,
        reflectance_rgb: part.reflectance_rgb.map(|c| c.min(MOST_REFLECTED)),
        emitted_rgb: part.emitted_rgb,
    }
}

/// Each triangle, in order, is joined with the free one across its longest possible edge.
fn paired(corners: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Face> {
    let mut across: HashMap<(u32, u32), Vec<usize>> = HashMap::new();
    for (index, t) in triangles.iter().enumerate() {
        (0..3).for_each(|k| across.entry((t[k], t[(k + 1) % 3])).or_default().push(index));
    }
    let mut used = vec![false; triangles.len()];
    let mut faces = Vec::new();
    for (index, t) in triangles.iter().enumerate() {
        if used[index] {
            continue;
        }
        used[index] = true;
        let mut best: Option<(f64, usize, [u32; 4])> = None;
        for k in 0..3 {
            let (p, q, r) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
            for &other in across.get(&(q, p)).map_or(&[][..], Vec::as_slice) {
                let apex = triangles[other].iter().copied().find(|&i| i != p && i != q);
                let Some(apex) = apex.filter(|_| !used[other]) else { continue };
                let quad = [p, apex, q, r];
                let length = at(corners, p).distance(at(corners, q));
                if is_flat_and_convex(quad.map(|i| at(corners, i)))
                    && best.is_none_or(|(longest, ..)| length > longest)
                {
                    best = Some((length, other, quad));
                }
            }
        }
        faces.push(match best {
            Some((_, other, quad)) => {
                used[other] = true;
                Face::Quad(quad)
            }
            None => Face::Triangle(*t),
        });
    }
    faces
}

fn at(corners: &[Vec3], index: u32) -> DVec3 {
    corners.get(index as usize).map_or(DVec3::ZERO, |p| p.as_dvec3())
}

fn is_flat_and_convex(quad: [DVec3; 4]) -> bool {
    let [a, b, c, d] = quad;
    let (first, second) = ((b - a).cross(c - a), (c - a).cross(d - a));
    let (whole, in_plane) = (first + second, first.normalize_or_zero().dot(second.normalize_or_zero()));
    let turn = |i: usize| {
        let (p, q, r) = (quad[i], quad[(i + 1) % 4], quad[(i + 2) % 4]);
        (q - p).cross(r - q).dot(whole)
    };
    in_plane >= 1.0 - ONE_PLANE && (0..4).all(|i| turn(i) > LEAST_TURN * whole.length_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn faces(corners: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<Face> {
        paired(&corners.iter().map(|p| Vec3::from(*p)).collect::<Vec<_>>(), triangles)
    }

    const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn two_triangles_of_a_square_are_one_face_of_the_same_front() {
        let found = faces(&SQUARE, &[[0, 1, 2], [2, 3, 0]]);
        assert_eq!(found.len(), 1);
        let Face::Quad(quad) = found[0] else { panic!("{found:?}") };
        let [a, b, c, d] = quad.map(|i| Vec3::from(SQUARE[i as usize]));
        let twice = (b - a).cross(c - a) + (c - a).cross(d - a);
        assert!((twice - Vec3::new(0.0, 0.0, 2.0)).length() < 1e-6, "{quad:?}");
    }

    #[test]
    fn what_is_bent_concave_or_turned_over_stays_triangles() {
        let mut bent = SQUARE;
        bent[3][2] = 0.1;
        assert_eq!(faces(&bent, &[[0, 1, 2], [2, 3, 0]]).len(), 2);
        let mut concave = SQUARE;
        concave[3] = [0.6, 0.4, 0.0];
        assert_eq!(faces(&concave, &[[0, 1, 2], [2, 3, 0]]).len(), 2);
        assert_eq!(faces(&SQUARE, &[[0, 1, 2], [0, 3, 2]]).len(), 2);
        // A corner in the middle of a side.
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        assert_eq!(faces(&triangle, &[[0, 1, 3], [1, 2, 3]]).len(), 2);
    }

    proptest! {
        #[test]
        fn every_triangle_is_in_one_face(
            triangles in prop::collection::vec(prop::array::uniform3(0u32..16), 0..40)
        ) {
            // A grid of 4 x 4 corners: many pairs, triangles without area and doubled ones.
            let corners: Vec<Vec3> =
                (0..16).map(|i| Vec3::new((i % 4) as f32, (i / 4) as f32, 0.0)).collect();
            let triangles: Vec<[u32; 3]> =
                triangles.into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect();
            let area = |t: [u32; 3]| {
                let [a, b, c] = t.map(|i| corners[i as usize]);
                (b - a).cross(c - a).z
            };
            let of_face = |face: &Face| match *face {
                Face::Triangle(t) => area(t),
                Face::Quad([a, b, c, d]) => area([a, b, c]) + area([a, c, d]),
            };
            let found = paired(&corners, &triangles);
            let count: usize = found.iter().map(|f| f.corners().len() - 2).sum();
            prop_assert_eq!(count, triangles.len());
            let (sum, want): (f32, f32) =
                (found.iter().map(of_face).sum(), triangles.iter().map(|t| area(*t)).sum());
            prop_assert!((sum - want).abs() < 1e-3);
        }
    }
}
