//! A known room: rough geometry of the real place with what it reflects and what it sends out, and the patches that it is
//! divided into. Everything is in the world frame (z up, metres). Surfaces are one-sided: the front is the side from
//! which the corners run counter-clockwise; a back reflects and sends out nothing, but hides what lies behind it.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A flat face: indices into its surface's corners, counter-clockwise seen from the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Face {
    /// Three corners.
    Triangle([u32; 3]),
    /// Four corners of a convex quadrilateral. One that is bent, folded or not convex counts as its two triangles
    /// 0 1 2 and 0 2 3.
    Quad([u32; 4]),
}

impl Face {
    /// Its corners in order.
    pub fn corners(&self) -> &[u32] {
        match self {
            Self::Triangle(corners) => corners,
            Self::Quad(corners) => corners,
        }
    }
}

/// A part of the room of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomSurface {
    /// Unique in its room.
    pub name: String,
    /// Corners of the faces, world frame, metres.
    pub corners_world: Vec<Vec3>,
    /// Triangles and quads; indices into the corners.
    pub faces: Vec<Face>,
    /// Diffuse reflectance, linear RGB within [0, 1).
    pub reflectance_rgb: [f32; 3],
    /// Radiance that it sends out of itself, the same in all directions; zero for all but lamps and windows.
    pub emitted_rgb: [f32; 3],
}

/// A real place as far as it is known. Nothing asks for it to be closed: light that would come in through an open edge
/// is simply not known of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// In order of the file.
    pub surfaces: Vec<RoomSurface>,
}

/// A light at infinity that shines into a room through some of its surfaces: the sun behind a window, [Gib03]'s limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomSun {
    /// Unit vector towards it, world frame.
    pub to_light_world: [f32; 3],
    /// Irradiance on a plane that faces it, behind an aperture.
    pub irradiance_rgb: [f32; 3],
    /// Root mean square angle to its own direction, by flux, radians.
    pub extent_rad: f32,
    /// Indices into [`Room::surfaces`], ascending: where a ray towards the sun first meets one of these, it is outside, and
    /// nothing behind hides the sun (windows are often modelled before an unbroken wall). All others hide it:
    /// `nearfield::sun_blockers`.
    pub apertures: Vec<u32>,
}

/// A small flat piece of a room's surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomPatch {
    /// Indices into [`RoomPatches::vertices`], counter-clockwise seen from the front; of a triangle the last is the third
    /// again.
    pub corners: [u32; 4],
    /// Centroid, world frame, metres.
    pub centre_world: Vec3,
    /// Unit vector away from the front, world frame.
    pub normal_world: Vec3,
    /// Square metres, above zero.
    pub area_m2: f32,
    /// Radiance that leaves its front, the same in all directions: what it emits and what it reflects, linear RGB.
    pub radiance_rgb: [f32; 3],
    /// Diffuse reflectance, linear RGB.
    pub reflectance_rgb: [f32; 3],
    /// Whether its radiance was measured; else it was filled in: as its surface's own light alone, or as
    /// `nearfield::probe` says.
    pub seen: bool,
    /// Index into [`Room::surfaces`].
    pub surface: u32,
}

impl RoomPatch {
    /// Its three or four corners.
    pub fn corners(&self) -> &[u32] {
        let count = if self.corners[3] == self.corners[2] { 3 } else { 4 };
        &self.corners[..count]
    }

    /// The triangles that it is drawn as: corners 0 1 2 and, of a quadrilateral, 0 2 3.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + use<> {
        let [a, b, c, d] = self.corners;
        std::iter::once([a, b, c]).chain((d != c).then_some([a, c, d]))
    }
}

/// A corner of patches, where light is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatchVertex {
    /// World frame, metres.
    pub position_world: Vec3,
    /// Where light is gathered for it: a little into its patches and before them, so that neither an adjoining wall nor
    /// the surface itself hides the room from it.
    pub gather_world: Vec3,
    /// Unit vector away from the front, world frame.
    pub normal_world: Vec3,
}

/// A room divided into patches. Patches of one surface that lie in one plane share their vertices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RoomPatches {
    /// Corners of the patches.
    pub vertices: Vec<PatchVertex>,
    /// In order of surface, face and place.
    pub patches: Vec<RoomPatch>,
    /// Faces left out: with less than three corners that differ, no area, a corner that is not finite or that there is
    /// not.
    pub dropped_faces: usize,
}

impl RoomPatches {
    /// Corner positions of a patch and how many of them count (3 or 4); places of missing vertices are zero.
    pub fn outline_world(&self, patch: &RoomPatch) -> ([Vec3; 4], usize) {
        let corner = |i: u32| self.vertices.get(i as usize).map_or(Vec3::ZERO, |v| v.position_world);
        (patch.corners.map(corner), patch.corners().len())
    }
}
