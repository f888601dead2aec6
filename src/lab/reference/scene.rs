//! What is traced: bodies, light and camera, all in the world frame.

use crate::math::{lens::Lens, pose::Pose, sh::zonal::PhongNorm};
use crate::model::{
    image::RadianceImage,
    room::{RoomPatch, RoomPatches, RoomSurface},
    scene::{Material, Mesh, RealSurface, VirtualObject},
};
use glam::{Mat3, Vec3};
use sha2::{Digest, Sha256};

/// Albedo of real surfaces that nothing is known of: as `present::gray_place` draws them. Shadows as a ratio do not
/// depend on it while nothing reflects twice.
pub const UNKNOWN_ALBEDO: f32 = 0.5;

/// Geometry, world frame, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum TraceShape {
    /// Triangles; normals are interpolated where there is one for each vertex, tints too.
    Mesh(Mesh),
    /// An exact sphere.
    Sphere {
        /// World frame, metres.
        centre: Vec3,
        /// Metres; above 0.
        radius_m: f32,
    },
}

/// Light that a body sends out of its front, the same in all directions. Spheres send none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Emission {
    /// Nothing is sent out.
    #[default]
    None,
    /// Of its own, radiance: what it reflects is added.
    Own([f32; 3]),
    /// All that leaves it, radiance, as measured: what others receive from it. Seen by the camera it is shaded by the light
    /// that falls on it, so that shadows show.
    Measured([f32; 3]),
    /// As `Measured`, where only a picture of all that surrounds the scene is known: what others receive from it is what the
    /// environment shows in the same direction (below the horizon of a ball on a surface that is the surface itself).
    Surroundings,
}

/// One thing.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceBody {
    /// For messages.
    pub name: String,
    /// Where it is.
    pub shape: TraceShape,
    /// How it reflects.
    pub material: Material,
    /// Reflects from its back, too; else a back is black, and hides all the same.
    pub two_sided: bool,
    /// What it sends out.
    pub emission: Emission,
    /// A window: where a ray towards a sun meets it first, nothing behind it hides the sun.
    pub is_aperture: bool,
}

impl TraceBody {
    /// A virtual object where it stands: its vertices in the world frame, as many as its mesh has.
    pub fn of_object(object: &VirtualObject, positions_world: &[Vec3], normals_world: &[Vec3]) -> Self {
        let mesh = Mesh {
            positions: positions_world.to_vec(),
            normals: normals_world.to_vec(),
            tints_rgb: object.mesh.tints_rgb.clone(),
            triangles: object.mesh.triangles.clone(),
        };
        Self {
            name: object.name.clone(),
            shape: TraceShape::Mesh(mesh),
            material: object.material,
            two_sided: true,
            emission: Emission::None,
            is_aperture: false,
        }
    }

    /// A real surface: matt, lit on both sides, of [`UNKNOWN_ALBEDO`] where its own is not known, flat.
    pub fn of_surface(surface: &RealSurface) -> Self {
        let albedo_rgb = surface.albedo_rgb.unwrap_or([UNKNOWN_ALBEDO; 3]);
        let mesh = Mesh { normals: Vec::new(), ..surface.mesh.clone() };
        Self {
            name: surface.name.clone(),
            shape: TraceShape::Mesh(mesh),
            material: Material::Lambert { albedo_rgb },
            two_sided: true,
            emission: Emission::None,
            is_aperture: false,
        }
    }

    /// A surface of a known room: one-sided, with the light that its file says it sends out.
    pub fn of_room_surface(surface: &RoomSurface) -> Self {
        let triangles = surface.faces.iter().flat_map(|face| {
            let c = face.corners();
            let second = (c.len() == 4).then(|| [c[0], c[2], c[3]]);
            std::iter::once([c[0], c[1], c[2]]).chain(second)
        });
        let mesh = Mesh {
            positions: surface.corners_world.clone(),
            triangles: triangles.collect(),
            ..Mesh::default()
        };
        Self {
            name: surface.name.clone(),
            shape: TraceShape::Mesh(mesh),
            material: Material::Lambert { albedo_rgb: surface.reflectance_rgb },
            two_sided: false,
            emission: match surface.emitted_rgb {
                [0.0, 0.0, 0.0] => Emission::None,
                rgb => Emission::Own(rgb),
            },
            is_aperture: false,
        }
    }

    /// A patch of a room whose light was measured.
    pub fn of_patch(patches: &RoomPatches, patch: &RoomPatch) -> Self {
        let (corners, count) = patches.outline_world(patch);
        let mut triangles = vec![[0, 1, 2]];
        if count == 4 {
            triangles.push([0, 2, 3]);
        }
        Self {
            name: String::new(),
            shape: TraceShape::Mesh(Mesh {
                positions: corners[..count].to_vec(),
                triangles,
                ..Mesh::default()
            }),
            material: Material::Lambert { albedo_rgb: patch.reflectance_rgb },
            two_sided: false,
            emission: Emission::Measured(patch.radiance_rgb),
            is_aperture: false,
        }
    }
}

/// Light from infinity.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Environment {
    /// None.
    #[default]
    Dark,
    /// The same radiance from everywhere.
    Constant([f32; 3]),
    /// An equirectangular picture, bilinear between texel centres (wrapped in u, held in v).
    Picture {
        /// Linear radiance, finite, not negative.
        radiance: RadianceImage,
        /// Turns world directions into the picture's own axes.
        map_from_world: Mat3,
    },
}

/// A light at infinity without extent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSun {
    /// Unit vector towards it, world frame.
    pub to_light_world: Vec3,
    /// Irradiance of a surface that faces it.
    pub irradiance_rgb: [f32; 3],
}

/// Everything that a picture is traced from.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceScene {
    /// The camera's lens. A pixel is the mean over its square.
    pub lens: Lens,
    /// Where the camera is.
    pub world_from_camera: Pose,
    /// What is there in both pictures.
    pub real: Vec<TraceBody>,
    /// What is there in one of them.
    pub objects: Vec<TraceBody>,
    /// Light from infinity.
    pub environment: Environment,
    /// Lights at infinity without extent.
    pub suns: Vec<TraceSun>,
    /// How Phong lobes are scaled.
    pub phong_norm: PhongNorm,
}

impl TraceScene {
    /// Nothing but a camera.
    pub fn empty(lens: Lens, world_from_camera: Pose) -> Self {
        Self {
            lens,
            world_from_camera,
            real: Vec::new(),
            objects: Vec::new(),
            environment: Environment::Dark,
            suns: Vec::new(),
            phong_norm: PhongNorm::EnergySafe,
        }
    }

    /// A hash of all that the pictures depend on.
    pub fn digest(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(format!("{:?} {:?} {:?}", self.lens, self.world_from_camera, self.phong_norm));
        for (kind, bodies) in [("real", &self.real), ("objects", &self.objects)] {
            hash.update(format!("{kind} {}", bodies.len()));
            bodies.iter().for_each(|body| add_body(&mut hash, body));
        }
        match &self.environment {
            Environment::Picture { radiance, map_from_world } => {
                hash.update(format!("picture {} {} {map_from_world:?}", radiance.width(), radiance.height()));
                hash.update(bytemuck::cast_slice(radiance.pixels()));
            }
            other => hash.update(format!("{other:?}")),
        }
        hash.update(format!("{:?}", self.suns));
        hash.finalize().into()
    }
}

fn add_body(hash: &mut Sha256, body: &TraceBody) {
    let TraceBody { name, material, emission, two_sided, is_aperture, .. } = body;
    hash.update(format!("{name:?} {material:?} {emission:?} {two_sided} {is_aperture}"));
    match &body.shape {
        TraceShape::Sphere { centre, radius_m } => hash.update(format!("sphere {centre:?} {radius_m:?}")),
        TraceShape::Mesh(mesh) => {
            let counts = (mesh.positions.len(), mesh.normals.len(), mesh.tints_rgb.len());
            hash.update(format!("mesh {counts:?} {}", mesh.triangles.len()));
            hash.update(bytemuck::cast_slice(&mesh.positions));
            hash.update(bytemuck::cast_slice(&mesh.normals));
            hash.update(bytemuck::cast_slice(&mesh.tints_rgb));
            hash.update(bytemuck::cast_slice(&mesh.triangles));
        }
    }
}
