//! A case as it is traced: exact shapes, one-sided surfaces, its own emitters.

use super::{Case, CaseEmitter, EmitterKind, ExactShape, Geometry, GeometryRole, tessellate};
use crate::assets::{error::AssetError, shapes};
use crate::math::sh::zonal::PhongNorm;
use crate::model::scene::{Material, Mesh};
use crate::reference::{Emission, Environment, TraceBody, TraceScene, TraceShape, TraceSun};
use glam::{DVec3, Mat3};
use std::f64::consts::TAU;

/// Corners of the polygon that stands for a disc; it has the disc's area, and its edge is within 0.03 % of the radius.
const DISC_CORNERS: u32 = 96;

impl Case {
    /// What a picture of the case is traced from: spheres are exact, surfaces reflect from their front alone, emitters shine
    /// from their front and reflect nothing. Where no picture is named all objects are there and all emitters shine but the
    /// alternative sun.
    ///
    /// # Errors
    /// As `objects`; a mesh or an environment picture that cannot be loaded; two environments.
    pub fn trace_scene(&self, image: Option<&str>) -> Result<TraceScene, AssetError> {
        let mut scene = TraceScene::empty(self.lens, self.world_from_camera);
        scene.phong_norm = PhongNorm::EnergySafe;
        for geometry in self.geometry.iter().filter(|g| g.role == GeometryRole::Receiver) {
            scene.real.push(body(geometry)?);
        }
        for geometry in self.objects(image)? {
            scene.objects.push(body(geometry)?);
        }
        for emitter in self.emitters(image)? {
            self.shine(emitter, &mut scene)?;
        }
        Ok(scene)
    }

    fn shine(&self, emitter: &CaseEmitter, scene: &mut TraceScene) -> Result<(), AssetError> {
        let far = match &emitter.kind {
            EmitterKind::Environment { file } => {
                let radiance = crate::open_exr::load_radiance(file)?.hdr.radiance;
                Some(Environment::Picture { radiance, map_from_world: Mat3::IDENTITY })
            }
            EmitterKind::Constant { radiance_rgb } => {
                Some(Environment::Constant(radiance_rgb.map(|c| c as f32)))
            }
            EmitterKind::Directional { to_light_world, irradiance_rgb } => {
                scene.suns.push(TraceSun {
                    to_light_world: to_light_world.as_vec3(),
                    irradiance_rgb: irradiance_rgb.map(|e| e as f32),
                });
                None
            }
            EmitterKind::Quad { vertices, radiance_rgb } => {
                scene.real.push(lamp(emitter, shapes::quad(*vertices), *radiance_rgb));
                None
            }
            EmitterKind::Disc { centre, normal, radius, radiance_rgb } => {
                scene.real.push(lamp(emitter, disc(*centre, *normal, *radius), *radiance_rgb));
                None
            }
        };
        if let Some(far) = far {
            if scene.environment != Environment::Dark {
                return Err(
                    AssetError::new(&self.file, "emitters").allowed("at most one at infinity all around")
                );
            }
            scene.environment = far;
        }
        Ok(())
    }
}

fn body(geometry: &Geometry) -> Result<TraceBody, AssetError> {
    let shape = match &geometry.shape {
        ExactShape::Sphere { centre, radius } => {
            TraceShape::Sphere { centre: centre.as_vec3(), radius_m: *radius as f32 }
        }
        other => {
            let (mesh, world_from_object, _) = tessellate(other, 0)?;
            TraceShape::Mesh(shapes::transformed(&mesh, &world_from_object))
        }
    };
    let (name, material) = (geometry.name.clone(), geometry.material);
    Ok(TraceBody { name, shape, material, two_sided: false, emission: Emission::None, is_aperture: false })
}

fn lamp(emitter: &CaseEmitter, mesh: Mesh, radiance_rgb: [f64; 3]) -> TraceBody {
    TraceBody {
        name: emitter.name.clone().unwrap_or_else(|| "emitter".into()),
        shape: TraceShape::Mesh(mesh),
        material: Material::Lambert { albedo_rgb: [0.0; 3] },
        two_sided: false,
        emission: Emission::Own(radiance_rgb.map(|c| c as f32)),
        is_aperture: false,
    }
}

fn disc(centre: DVec3, normal: DVec3, radius: f64) -> Mesh {
    let corners = f64::from(DISC_CORNERS);
    let radius = radius * (TAU / corners / (TAU / corners).sin()).sqrt();
    let (u, v) = normal.any_orthonormal_pair();
    let mut mesh = Mesh { positions: vec![centre.as_vec3()], ..Mesh::default() };
    for k in 0..DISC_CORNERS {
        let (sine, cosine) = (TAU * f64::from(k) / corners).sin_cos();
        mesh.positions.push((centre + radius * (u * cosine + v * sine)).as_vec3());
        mesh.triangles.push([0, k + 1, (k + 1) % DISC_CORNERS + 1]);
    }
    mesh
}
