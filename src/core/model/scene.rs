//! What is in the place: real surfaces and virtual objects, in the world frame.

use super::{animation::Figure, room::Room, transfer::SceneTransfer};
use glam::{Affine3A, Vec3};
use std::sync::Arc;

/// How a surface reflects. Albedo and reflectance are linear RGB within [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// Matt.
    Lambert {
        /// Diffuse albedo.
        albedo_rgb: [f32; 3],
    },
    /// Matt plus a glossy lobe.
    Phong {
        /// Diffuse albedo.
        albedo_rgb: [f32; 3],
        /// Reflectance of the lobe.
        specular_rgb: [f32; 3],
        /// Exponent s, not negative.
        exponent: f32,
    },
    /// Perfect mirror.
    Mirror {
        /// Share of each channel that is thrown back, 0 to 1.
        reflectance_rgb: [f32; 3],
    },
}

/// Triangles in their own frame. All per-vertex lists have one entry a vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Multiplies the material's albedo (white where the file has none): vertex colours and textures, linear RGB.
    pub tints_rgb: Vec<[f32; 3]>,
    /// Indices into the lists, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh with one material, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualObject {
    /// Unique in its scene.
    pub name: String,
    /// Geometry.
    pub mesh: Mesh,
    /// One for the whole object (a file with several materials becomes several objects).
    pub material: Material,
    /// Places it; may scale.
    pub world_from_object: Affine3A,
    /// For each vertex: cosine-weighted share of the hemisphere that the object itself leaves open, 0 to 1.
    pub openness: Vec<f32>,
}

/// A real surface of known geometry: receives virtual shadows and hides what lies behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct RealSurface {
    /// Unique in its scene.
    pub name: String,
    /// Geometry in the world frame.
    pub mesh: Mesh,
    /// Whether virtual shadows fall on it (else it only hides).
    pub receives_shadow: bool,
    /// Lambert's albedo where it is known, linear RGB: what virtual mirrors show of it. `None`: they show the picture of
    /// the environment there.
    pub albedo_rgb: Option<[f32; 3]>,
}

/// Everything to draw, and what it stands on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// In order of the file.
    pub objects: Vec<VirtualObject>,
    /// In order of the file.
    pub surfaces: Vec<RealSurface>,
    /// Bodies: which objects move together, how, and the spheres that stand for them. Objects without one stay.
    pub figures: Vec<Figure>,
    /// How what never moves answers to soft light, where that was computed.
    pub transfer: Option<Arc<SceneTransfer>>,
    /// The real place, where its geometry and its own light are known: then its near light is what shadows are drawn from.
    pub room: Option<Arc<Room>>,
}
