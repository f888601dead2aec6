//! Reference cases: JSON files that hold every number of a rendered picture (geometry, materials, emitters, camera)
//! beside the picture itself.
//!
//! Conventions are the crate's own: world z up in metres, camera as OpenCV's, pixel centres at +0.5. File names in a
//! case are relative to the folder above the case's own.

mod compare;
mod emitters;
mod file;
mod place;
mod room;
mod stills;
mod trace;

pub use compare::{Comparison, MaskError, ShadowError, compare};
pub use file::parse;
pub use stills::{CaseStills, default_image, is_a_mask, of_case};

use crate::{
    assets::{
        error::AssetError,
        obj,
        room::{self as room_file, LoadedRoom},
        shapes,
    },
    math::{lens::Lens, pose::Pose},
    model::{
        animation::Figure,
        response::Response,
        scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
    },
    visibility::openness,
};
use glam::{Affine3A, DVec3, Vec3};
use std::path::{Path, PathBuf};

/// Spheres that are fitted to an object that is none.
const FITTED_SPHERES: usize = 20;

/// Loads a room: a folder or a `.json` is a reference case, everything else what the product reads.
///
/// # Errors
/// The file cannot be read or is damaged; the room has no usable face or too many.
pub fn load_room(file: &Path) -> Result<LoadedRoom, AssetError> {
    if file.is_dir() || file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        return room_file::judged(file, load(file)?.room(), 0);
    }
    room_file::load_room(file)
}

/// A case as it stands in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The JSON file.
    pub file: PathBuf,
    /// Its name, such as `f4_sun45`.
    pub id: String,
    /// `F1` to `F5`.
    pub family: String,
    /// Pinhole of the pictures.
    pub lens: Lens,
    /// Pose of the camera, metres: takes points of its frame to the world.
    pub world_from_camera: Pose,
    /// Receivers and objects, in order of the file.
    pub geometry: Vec<Geometry>,
    /// In order of the file.
    pub emitters: Vec<CaseEmitter>,
    /// F4: the sun as a disc, in place of the directional one.
    pub alternative_sun: Option<CaseEmitter>,
    /// Pictures and masks, sorted by name.
    pub images: Vec<CaseImage>,
    /// F5: the ball photographed.
    pub photographs: Option<Photographs>,
    /// F5: the light's true coefficients.
    pub light_truth: Option<LightTruths>,
    /// F1: mean radiance of the plane in `without`.
    pub plane_radiance_without_spheres_rgb: Option<[f64; 3]>,
}

/// One piece of geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    /// Unique in the case.
    pub name: String,
    /// A real surface, or a virtual object.
    pub role: GeometryRole,
    /// Exact shape, world frame.
    pub shape: ExactShape,
    /// How it reflects.
    pub material: Material,
}

/// What a piece of geometry is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryRole {
    /// Real: receives shadows.
    Receiver,
    /// Virtual.
    Object,
}

/// Exact shapes, world frame, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum ExactShape {
    /// The square |x|, |y| <= half_extent in z = 0, front up.
    PlaneZ0 {
        /// Half a side.
        half_extent: f64,
    },
    /// A parallelogram; normal (v1 - v0) x (v3 - v0).
    Quad {
        /// Corners in order.
        vertices: [DVec3; 4],
    },
    /// A box turned about the vertical through its centre.
    Box {
        /// World frame, metres.
        centre: DVec3,
        /// Half sizes along its own axes.
        half_size: DVec3,
        /// Counter-clockwise seen from above.
        yaw_rad: f64,
    },
    /// Exact, not cut into triangles.
    Sphere {
        /// World frame, metres.
        centre: DVec3,
        /// Metres; above 0.
        radius: f64,
    },
    /// An OBJ file.
    Mesh {
        /// Path that it is read from.
        file: PathBuf,
        /// Places it; may scale.
        world_from_object: Affine3A,
    },
}

/// A source of light.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseEmitter {
    /// Where the file gives one.
    pub name: Option<String>,
    /// What it is.
    pub kind: EmitterKind,
}

/// Kinds of light. Radiance and irradiance are linear RGB.
#[derive(Clone, Debug, PartialEq)]
pub enum EmitterKind {
    /// An equirectangular picture at infinity, in the crate's own orientation.
    Environment {
        /// The picture.
        file: PathBuf,
    },
    /// A light at infinity.
    Directional {
        /// Unit vector towards the light.
        to_light_world: DVec3,
        /// Irradiance of a surface that faces it.
        irradiance_rgb: [f64; 3],
    },
    /// The same radiance from everywhere.
    Constant {
        /// Linear RGB; the same in all directions.
        radiance_rgb: [f64; 3],
    },
    /// A parallelogram that shines from its front; normal (v1 - v0) x (v3 - v0).
    Quad {
        /// Corners in order.
        vertices: [DVec3; 4],
        /// Linear RGB; the same in all directions.
        radiance_rgb: [f64; 3],
    },
    /// A disc that shines from its front.
    Disc {
        /// World frame, metres.
        centre: DVec3,
        /// Unit vector away from its front.
        normal: DVec3,
        /// Metres; above 0.
        radius: f64,
        /// Linear RGB; the same in all directions.
        radiance_rgb: [f64; 3],
    },
}

/// A picture or mask of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseImage {
    /// Its name in the case, such as `beauty` or `mask_ball`.
    pub name: String,
    /// The picture.
    pub file: PathBuf,
    /// Names of the objects present; `None` where the case does not say (all of them).
    pub objects: Option<Vec<String>>,
    /// Names of the emitters that shine; `None` where the case does not say (all but the alternative sun).
    pub emitters: Option<Vec<String>>,
}

impl CaseImage {
    /// Whether it is an 8-bit coverage mask.
    pub fn is_mask(&self) -> bool {
        self.name.starts_with("mask_")
    }
}

/// F5: three 8-bit pictures of the mirror ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Photographs {
    /// Pictures and their exposure times in seconds.
    pub exposures: Vec<(PathBuf, f64)>,
    /// X = radiance * time * exposure_scale is what the table is about.
    pub exposure_scale: f64,
    /// For each channel and 8-bit value the X that gives it.
    pub response_table: Box<[[f64; 256]; 3]>,
    /// The same as log exposure in radiance seconds: g = ln(table / exposure_scale). Value 0, whose X is 0, is taken
    /// as a quarter of a step.
    pub response: Response,
}

/// F5: what the light truly is.
#[derive(Clone, Debug, PartialEq)]
pub struct LightTruths {
    /// The whole map.
    pub environment_full_sphere: LightTruth,
    /// The map above the horizon, nothing below.
    pub environment_upper_hemisphere_only: LightTruth,
    /// The map above, the unshadowed plane's radiance below: what a ball on the plane should give.
    pub upper_hemisphere_plus_unshadowed_plane_below: LightTruth,
}

/// True light in the crate's SH convention.
#[derive(Clone, Debug, PartialEq)]
pub struct LightTruth {
    /// Radiance SH, rows l(l+1)+m, 49 of them.
    pub coefficients_rgb: Vec<[f64; 3]>,
    /// Unit vector of band 1 of grey (0.3, 0.59, 0.11).
    pub to_light_world: DVec3,
    /// d of each channel, sqrt(4 pi / 3) (-L3, -L1, L2).
    pub band1_vector_rgb: [DVec3; 3],
    /// E_d of each channel.
    pub irradiance_rgb: [f64; 3],
    /// Irradiance of a surface that faces up.
    pub irradiance_up_rgb: [f64; 3],
    /// Radiance of the plane below, where that is part of the light.
    pub plane_radiance_rgb: Option<[f64; 3]>,
}

/// Loads a case from its JSON file, or from its folder.
///
/// # Errors
/// The file cannot be read, a key is missing or of the wrong kind, a number is not allowed (not finite, a focal length
/// or radius that is not positive, a camera matrix that is not rigid), or a name points nowhere.
pub fn load(path: &Path) -> Result<Case, AssetError> {
    let path = if path.is_dir() { path.join("case.json") } else { path.to_path_buf() };
    file::parse(&path, &crate::assets::error::read_text(&path)?)
}

impl Case {
    /// The picture or mask of that name.
    ///
    /// # Errors
    /// There is none; the message lists the names.
    pub fn image(&self, name: &str) -> Result<&CaseImage, AssetError> {
        self.images.iter().find(|image| image.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.images.iter().map(|image| image.name.as_str()).collect();
            AssetError::new(&self.file, "image").value(name).allowed(format!("one of {}", names.join(", ")))
        })
    }

    /// Objects present in a picture (all where no picture is named or it does not say), in order of the file.
    ///
    /// # Errors
    /// No picture of that name, or it lists an object that does not exist.
    pub fn objects(&self, image: Option<&str>) -> Result<Vec<&Geometry>, AssetError> {
        let all = self.geometry.iter().filter(|g| g.role == GeometryRole::Object);
        let Some(wanted) = image.map(|name| self.image(name)).transpose()?.and_then(|i| i.objects.as_ref())
        else {
            return Ok(all.collect());
        };
        let all: Vec<&Geometry> = all.collect();
        if let Some(unknown) = wanted.iter().find(|name| all.iter().all(|g| g.name != **name)) {
            return Err(AssetError::new(&self.file, "object of an image")
                .value(unknown)
                .allowed("an object of the case"));
        }
        Ok(all.into_iter().filter(|g| wanted.contains(&g.name)).collect())
    }

    /// Emitters that shine in a picture: all, or those it lists; the alternative sun only where it is listed.
    ///
    /// # Errors
    /// As `objects`.
    pub fn emitters(&self, image: Option<&str>) -> Result<Vec<&CaseEmitter>, AssetError> {
        let wanted = image.map(|name| self.image(name)).transpose()?.and_then(|i| i.emitters.as_ref());
        let Some(wanted) = wanted else { return Ok(self.emitters.iter().collect()) };
        let known = |name: &String| {
            let mut all = self.emitters.iter().chain(&self.alternative_sun);
            all.find(|e| e.name.as_ref() == Some(name)).ok_or_else(|| {
                AssetError::new(&self.file, "emitter of an image")
                    .value(name)
                    .allowed("an emitter of the case")
            })
        };
        wanted.iter().map(known).collect()
    }

    /// All spheres among the objects of a picture: centre and radius, for tests with exact shapes.
    ///
    /// # Errors
    /// As `objects`.
    pub fn spheres(&self, image: Option<&str>) -> Result<Vec<(DVec3, f64)>, AssetError> {
        let spheres = self.objects(image)?.into_iter().filter_map(|g| match g.shape {
            ExactShape::Sphere { centre, radius } => Some((centre, radius)),
            _ => None,
        });
        Ok(spheres.collect())
    }

    /// The scene of a picture as meshes: its objects (spheres are also bodies that block soft light; with their openness; spheres as icospheres, which lie within
    /// the true sphere by less than 0.35 % of the radius, 0.09 % where there are at most 5), and all receivers as real surfaces.
    ///
    /// # Errors
    /// As `objects`, and an OBJ file that cannot be loaded.
    pub fn scene(&self, image: Option<&str>) -> Result<Scene, AssetError> {
        let objects = self.objects(image)?;
        // About 30,000 triangles for all spheres together, at least 1280 each.
        let subdivisions = if self.spheres(image)?.len() > 5 { 3 } else { 4 };
        let mut figures = Vec::new();
        let objects = objects.into_iter().enumerate().map(|(index, geometry)| {
            let (mesh, world_from_object, convex) = tessellate(&geometry.shape, subdivisions)?;
            // A sphere stands for itself; spheres for the others are fitted when they are asked for.
            let own = match geometry.shape {
                ExactShape::Sphere { radius, .. } => Some((Vec3::ZERO, radius as f32)),
                _ => None,
            };
            let mut body = Figure::still(geometry.name.clone(), index, world_from_object, own.into_iter());
            if own.is_none() {
                body.sphere_count = FITTED_SPHERES;
            }
            figures.push(body);
            let openness = if convex {
                vec![1.0; mesh.positions.len()]
            } else {
                openness::of_mesh(&mesh, openness::DEFAULT_RAYS, &|_| ())
            };
            let (name, material) = (geometry.name.clone(), geometry.material);
            Ok(VirtualObject { name, mesh, material, world_from_object, openness })
        });
        let receivers = self.geometry.iter().filter(|g| g.role == GeometryRole::Receiver);
        let surfaces = receivers.map(|geometry| {
            let (mesh, world_from_object, _) = tessellate(&geometry.shape, 4)?;
            let mesh = shapes::transformed(&mesh, &world_from_object);
            let albedo_rgb = match geometry.material {
                Material::Lambert { albedo_rgb } => Some(albedo_rgb),
                Material::Phong { .. } | Material::Mirror { .. } => None,
            };
            Ok(RealSurface { name: geometry.name.clone(), mesh, receives_shadow: true, albedo_rgb })
        });
        let objects = objects.collect::<Result<_, AssetError>>()?;
        Ok(Scene {
            objects,
            surfaces: surfaces.collect::<Result<_, AssetError>>()?,
            figures,
            ..Scene::default()
        })
    }
}

/// Mesh in its own frame, where it stands, and whether it is convex.
fn tessellate(shape: &ExactShape, subdivisions: u32) -> Result<(Mesh, Affine3A, bool), AssetError> {
    let at = |centre: DVec3| Affine3A::from_translation(centre.as_vec3());
    Ok(match shape {
        ExactShape::PlaneZ0 { half_extent } => (shapes::plane_z0(*half_extent), Affine3A::IDENTITY, true),
        ExactShape::Quad { vertices } => (shapes::quad(*vertices), Affine3A::IDENTITY, true),
        ExactShape::Box { centre, half_size, yaw_rad } => {
            let turn = Affine3A::from_axis_angle(Vec3::Z, *yaw_rad as f32);
            (shapes::cuboid(*half_size), at(*centre) * turn, true)
        }
        ExactShape::Sphere { centre, radius } => {
            (shapes::icosphere(*radius, subdivisions), at(*centre), true)
        }
        ExactShape::Mesh { file, world_from_object } => (obj::load(file)?, *world_from_object, false),
    })
}

#[cfg(test)]
mod tests;
