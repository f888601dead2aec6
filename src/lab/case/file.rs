//! The JSON of a case, as written.

use super::{
    Case, CaseEmitter, CaseImage, EmitterKind, ExactShape, Geometry, GeometryRole, LightTruth, LightTruths,
    Photographs,
};
use crate::{
    assets::error::AssetError,
    math::{lens::Lens, pose::Pose},
    model::{
        limits::{MAX_LENS_PX, MAX_PLACE_M, MIN_FOCAL_PX, check_camera_size},
        response::Response,
        scene::Material,
    },
};
use glam::{Affine3A, DVec3, Mat4};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

type Rows = [[f64; 4]; 4];
type FileRgb = [f64; 3];

#[derive(Deserialize)]
struct CaseFile {
    id: String,
    family: String,
    camera: CameraFile,
    geometry: Vec<GeometryFile>,
    materials: BTreeMap<String, MaterialFile>,
    emitters: Vec<EmitterFile>,
    alternative_sun: Option<EmitterFile>,
    images: BTreeMap<String, ImageFile>,
    photographs: Option<PhotographsFile>,
    light_truth: Option<TruthsFile>,
    plane_radiance_without_spheres: Option<PlaneFile>,
}

#[derive(Deserialize)]
struct CameraFile {
    model: String,
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    pixel_centre_offset: Option<f64>,
    world_from_camera: Rows,
}

#[derive(Deserialize)]
struct GeometryFile {
    name: String,
    role: RoleFile,
    material: String,
    #[serde(flatten)]
    shape: ShapeFile,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RoleFile {
    Receiver,
    Object,
}

#[derive(Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
enum ShapeFile {
    PlaneZ0 {
        half_extent: f64,
    },
    Quad {
        vertices: [FileRgb; 4],
    },
    Box {
        center: FileRgb,
        half_size: FileRgb,
        #[serde(default)]
        yaw_deg: f64,
    },
    Sphere {
        center: FileRgb,
        radius: f64,
    },
    Mesh {
        file: PathBuf,
        world_from_object: Rows,
    },
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum MaterialFile {
    Lambert { albedo: [f32; 3] },
    Mirror { reflectance: [f32; 3] },
}

#[derive(Deserialize)]
struct EmitterFile {
    name: Option<String>,
    #[serde(flatten)]
    kind: EmitterKindFile,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum EmitterKindFile {
    Environment { file: PathBuf },
    Directional { to_light: FileRgb, irradiance_perpendicular: FileRgb },
    Constant { radiance: FileRgb },
    Quad { vertices: [FileRgb; 4], radiance: FileRgb },
    Disc { center: FileRgb, normal: FileRgb, radius: f64, radiance: FileRgb },
}

#[derive(Deserialize)]
struct ImageFile {
    file: PathBuf,
    objects: Option<Vec<String>>,
    emitters: Option<Vec<String>>,
}

#[derive(Deserialize)]
struct PhotographsFile {
    exposures: Vec<ExposureFile>,
    exposure_scale: f64,
    response_table: [Vec<f64>; 3],
}

#[derive(Deserialize)]
struct ExposureFile {
    file: PathBuf,
    exposure_time_s: f64,
}

#[derive(Deserialize)]
struct TruthsFile {
    environment_full_sphere: TruthFile,
    environment_upper_hemisphere_only: TruthFile,
    upper_hemisphere_plus_unshadowed_plane_below: TruthFile,
}

#[derive(Deserialize)]
struct TruthFile {
    coefficients_rgb: Vec<FileRgb>,
    dominant_direction: FileRgb,
    band1_vector_rgb: [FileRgb; 3],
    #[serde(rename = "E_d_rgb")]
    e_d_rgb: FileRgb,
    irradiance_up_z_rgb: FileRgb,
    plane_radiance_rgb: Option<FileRgb>,
}

#[derive(Deserialize)]
struct PlaneFile {
    mean_of_image: FileRgb,
}

/// Collects what is wrong, so that all of it is said at once.
struct Check<'a> {
    file: &'a Path,
    errors: Vec<AssetError>,
}

impl Check<'_> {
    fn require(&mut self, sound: bool, key: impl Into<Box<str>>, value: impl std::fmt::Debug, allowed: &str) {
        if !sound {
            let error = AssetError::new(self.file, key).value(format!("{value:?}")).allowed(allowed);
            self.errors.push(error);
        }
    }

    fn positive(&mut self, key: impl Into<Box<str>>, value: f64) -> f64 {
        self.require(value.is_finite() && value > 0.0, key, value, "a positive number");
        value
    }

    fn length(&mut self, key: impl Into<Box<str>>, value: f64) -> f64 {
        self.require(value > 0.0 && value <= MAX_PLACE_M, key, value, "above 0, at most 10000 m");
        value
    }

    fn place(&mut self, key: impl Into<Box<str>>, value: FileRgb) -> DVec3 {
        let is_sound = value.iter().all(|x| x.abs() <= MAX_PLACE_M);
        self.require(is_sound, key, value, "within 10000 m of the origin along each axis");
        DVec3::from(value)
    }

    fn share(&mut self, key: String, rgb: [f32; 3]) -> [f32; 3] {
        self.require(rgb.iter().all(|c| (0.0..=1.0).contains(c)), key, rgb, "within 0 to 1");
        rgb
    }

    fn light(&mut self, key: &str, rgb: FileRgb) -> FileRgb {
        let sound = rgb.iter().all(|c| (0.0..1e12).contains(c));
        self.require(sound, key, rgb, "finite and not negative");
        rgb
    }

    fn unit(&mut self, key: &str, vector: FileRgb) -> DVec3 {
        let length = DVec3::from(vector).length();
        self.require((length - 1.0).abs() < 1e-3, key, vector, "a unit vector");
        DVec3::from(vector).normalize_or(DVec3::Z)
    }
}

/// Reads a case; `path` names it and tells where its other files are.
pub fn parse(path: &Path, text: &str) -> Result<Case, AssetError> {
    let raw: CaseFile = serde_json::from_str(text).map_err(|e| AssetError::new(path, "case").cause(e))?;
    // Other files are named from the folder above the case's own.
    let root = path.parent().and_then(Path::parent).map(Path::to_path_buf).unwrap_or_default();
    let root = if root.as_os_str().is_empty() { path.parent().unwrap_or(path).join("..") } else { root };
    let mut check = Check { file: path, errors: Vec::new() };
    let (lens, world_from_camera) = camera(&mut check, &raw.camera);
    let materials = materials(&mut check, &raw.materials);
    let mut geometry: Vec<Geometry> = Vec::new();
    for piece in raw.geometry {
        let material = materials.get(&piece.material).copied();
        let unique = geometry.iter().all(|g| g.name != piece.name);
        check.require(unique, "geometry.name", &piece.name, "unique in the case");
        check.require(
            material.is_some(),
            format!("geometry {}.material", piece.name),
            &piece.material,
            "one of materials",
        );
        let shape = shape(&mut check, &piece.name, piece.shape, &root);
        let role = match piece.role {
            RoleFile::Receiver => GeometryRole::Receiver,
            RoleFile::Object => GeometryRole::Object,
        };
        let material = material.unwrap_or(Material::Lambert { albedo_rgb: [0.0; 3] });
        geometry.push(Geometry { name: piece.name, role, shape, material });
    }
    let emitters = raw.emitters.into_iter().map(|e| emitter(&mut check, e, &root)).collect();
    let alternative_sun = raw.alternative_sun.map(|e| emitter(&mut check, e, &root));
    let photographs = raw.photographs.and_then(|p| photographs(&mut check, p, &root));
    let light_truth = raw.light_truth.map(|t| LightTruths {
        environment_full_sphere: truth(&mut check, t.environment_full_sphere),
        environment_upper_hemisphere_only: truth(&mut check, t.environment_upper_hemisphere_only),
        upper_hemisphere_plus_unshadowed_plane_below: truth(
            &mut check,
            t.upper_hemisphere_plus_unshadowed_plane_below,
        ),
    });
    let images = raw.images.into_iter().map(|(name, image)| CaseImage {
        name,
        file: root.join(image.file),
        objects: image.objects,
        emitters: image.emitters,
    });
    let case = Case {
        file: path.to_path_buf(),
        id: raw.id,
        family: raw.family,
        lens,
        world_from_camera,
        geometry,
        emitters,
        alternative_sun,
        images: images.collect(),
        photographs,
        light_truth,
        plane_radiance_without_spheres_rgb: raw.plane_radiance_without_spheres.map(|p| p.mean_of_image),
    };
    for image in &case.images {
        check.errors.extend(case.objects(Some(&image.name)).err());
        check.errors.extend(case.emitters(Some(&image.name)).err());
    }
    AssetError::together(check.errors).map_or(Ok(case), Err)
}

fn camera(check: &mut Check, raw: &CameraFile) -> (Lens, Pose) {
    check.require(raw.model == "pinhole", "camera.model", &raw.model, "pinhole");
    let side = |n: u32| (1..=16_384).contains(&n);
    check.require(side(raw.width), "camera.width", raw.width, "within 1 to 16384 pixels");
    check.require(side(raw.height), "camera.height", raw.height, "within 1 to 16384 pixels");
    if side(raw.width) && side(raw.height) {
        let (width, height) = (raw.width as usize, raw.height as usize);
        let size = check_camera_size(width, height);
        let allowed = size.as_ref().err().cloned().unwrap_or_default();
        check.require(size.is_ok(), "camera.width, height", (width, height), &allowed);
    }
    for (key, focal) in [("camera.fx", raw.fx), ("camera.fy", raw.fy)] {
        let is_sound = (MIN_FOCAL_PX..=MAX_LENS_PX).contains(&focal);
        check.require(is_sound, key, focal, "within 0.001 to 1e6 pixels");
    }
    let (fx, fy) = (raw.fx, raw.fy);
    for (key, value) in [("camera.cx", raw.cx), ("camera.cy", raw.cy)] {
        check.require(value.abs() <= MAX_LENS_PX, key, value, "within 1e6 pixels of 0");
    }
    let offset = raw.pixel_centre_offset.unwrap_or(0.5);
    check.require(offset == 0.5, "camera.pixel_centre_offset", offset, "0.5");
    let pose = rigid(&raw.world_from_camera);
    check.require(
        pose.is_some(),
        "camera.world_from_camera",
        raw.world_from_camera,
        "a rigid 4x4 matrix, row by row, to a place within 10000 m",
    );
    let lens = Lens::pinhole(raw.width, raw.height, fx, fy, raw.cx, raw.cy);
    (lens, pose.unwrap_or(Pose::IDENTITY))
}

/// The pose of a matrix that is a rotation and a translation to 1e-4; its rotation is then made exact.
fn rigid(rows: &Rows) -> Option<Pose> {
    let row = |i: usize| DVec3::new(rows[i][0], rows[i][1], rows[i][2]);
    let finite = rows.as_flattened().iter().all(|x| x.abs() <= MAX_PLACE_M);
    let unit = (0..3).all(|i| (row(i).length() - 1.0).abs() < 1e-4);
    let right_handed = row(0).cross(row(1)).distance(row(2)) < 1e-4;
    let last = rows[3] == [0.0, 0.0, 0.0, 1.0];
    (finite && unit && right_handed && last).then(|| Pose::from_rows(*rows))
}

fn materials(check: &mut Check, raw: &BTreeMap<String, MaterialFile>) -> BTreeMap<String, Material> {
    let material = |(name, material): (&String, &MaterialFile)| {
        let material = match material {
            MaterialFile::Lambert { albedo } => {
                Material::Lambert { albedo_rgb: check.share(format!("materials.{name}.albedo"), *albedo) }
            }
            MaterialFile::Mirror { reflectance } => Material::Mirror {
                reflectance_rgb: check.share(format!("materials.{name}.reflectance"), *reflectance),
            },
        };
        (name.clone(), material)
    };
    raw.iter().map(material).collect()
}

fn shape(check: &mut Check, name: &str, raw: ShapeFile, root: &Path) -> ExactShape {
    let key = |k: &str| format!("geometry {name}.{k}");
    match raw {
        ShapeFile::PlaneZ0 { half_extent } => {
            ExactShape::PlaneZ0 { half_extent: check.length(key("half_extent"), half_extent) }
        }
        ShapeFile::Quad { vertices } => {
            ExactShape::Quad { vertices: vertices.map(|v| check.place(key("vertices"), v)) }
        }
        ShapeFile::Box { center, half_size, yaw_deg } => {
            half_size.iter().for_each(|&size| {
                check.length(key("half_size"), size);
            });
            ExactShape::Box {
                centre: check.place(key("center"), center),
                half_size: half_size.into(),
                yaw_rad: yaw_deg.to_radians(),
            }
        }
        ShapeFile::Sphere { center, radius } => ExactShape::Sphere {
            centre: check.place(key("center"), center),
            radius: check.length(key("radius"), radius),
        },
        ShapeFile::Mesh { file, world_from_object } => {
            let rows = world_from_object.map(|row| row.map(|x| x as f32));
            let matrix = Mat4::from_cols_array_2d(&rows).transpose();
            let sound =
                matrix.is_finite() && matrix.determinant().abs() > 1e-18 && rows[3] == [0.0, 0.0, 0.0, 1.0];
            check.require(sound, key("world_from_object"), rows, "an invertible 4x4 matrix, row by row");
            ExactShape::Mesh { file: root.join(file), world_from_object: Affine3A::from_mat4(matrix) }
        }
    }
}

fn emitter(check: &mut Check, raw: EmitterFile, root: &Path) -> CaseEmitter {
    let kind = match raw.kind {
        EmitterKindFile::Environment { file } => EmitterKind::Environment { file: root.join(file) },
        EmitterKindFile::Directional { to_light, irradiance_perpendicular } => EmitterKind::Directional {
            to_light_world: check.unit("emitters.to_light", to_light),
            irradiance_rgb: check.light("emitters.irradiance_perpendicular", irradiance_perpendicular),
        },
        EmitterKindFile::Constant { radiance } => {
            EmitterKind::Constant { radiance_rgb: check.light("emitters.radiance", radiance) }
        }
        EmitterKindFile::Quad { vertices, radiance } => EmitterKind::Quad {
            vertices: vertices.map(|v| check.place("emitters.vertices", v)),
            radiance_rgb: check.light("emitters.radiance", radiance),
        },
        EmitterKindFile::Disc { center, normal, radius, radiance } => EmitterKind::Disc {
            centre: check.place("emitters.center", center),
            normal: check.unit("emitters.normal", normal),
            radius: check.length("emitters.radius", radius),
            radiance_rgb: check.light("emitters.radiance", radiance),
        },
    };
    CaseEmitter { name: raw.name, kind }
}

fn photographs(check: &mut Check, raw: PhotographsFile, root: &Path) -> Option<Photographs> {
    let scale = check.positive("photographs.exposure_scale", raw.exposure_scale);
    check.require(!raw.exposures.is_empty(), "photographs.exposures", 0, "at least 1 picture");
    for exposure in &raw.exposures {
        check.positive("photographs.exposures.exposure_time_s", exposure.exposure_time_s);
    }
    let mut table = Box::new([[0.0f64; 256]; 3]);
    let mut log_exposure = [[0.0f32; 256]; 3];
    for (channel, values) in raw.response_table.iter().enumerate() {
        let key = format!("photographs.response_table[{channel}]");
        let bad = values.windows(2).position(|pair| !(pair[1] >= pair[0] && pair[1].is_finite()));
        if values.len() == 256
            && let Some(at) = bad
        {
            let allowed = format!("finite, at least {}, the value before it", values[at]);
            check.require(false, format!("{key}[{}]", at + 1), values[at + 1], &allowed);
            return None;
        }
        let sound = values.len() == 256 && values[0] >= 0.0 && values[1] > 0.0;
        check.require(sound, key, values.len(), "256 values that rise from 0");
        if !sound {
            return None;
        }
        table[channel].copy_from_slice(values);
        for (value, slot) in log_exposure[channel].iter_mut().enumerate() {
            let exposure = if value == 0 { 0.25 * values[1] } else { values[value] };
            *slot = (exposure / scale).ln() as f32;
        }
    }
    let response = Response::new(log_exposure);
    check.require(response.is_some(), "photographs.response_table", "", "finite and never falling");
    Some(Photographs {
        exposures: raw.exposures.into_iter().map(|e| (root.join(e.file), e.exposure_time_s)).collect(),
        exposure_scale: scale,
        response_table: table,
        response: response?,
    })
}

fn truth(check: &mut Check, raw: TruthFile) -> LightTruth {
    let rows = raw.coefficients_rgb.len();
    check.require(rows == 49, "light_truth.coefficients_rgb", rows, "49 rows");
    LightTruth {
        coefficients_rgb: raw.coefficients_rgb,
        to_light_world: check.unit("light_truth.dominant_direction", raw.dominant_direction),
        band1_vector_rgb: raw.band1_vector_rgb.map(DVec3::from),
        irradiance_rgb: raw.e_d_rgb,
        irradiance_up_rgb: raw.irradiance_up_z_rgb,
        plane_radiance_rgb: raw.plane_radiance_rgb,
    }
}
