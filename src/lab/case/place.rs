//! The receivers of a case as a camera would see them without the objects.

use super::emitters::{self, ReadyEmitter};
use super::{Case, GeometryRole};
use crate::compose::raster::SAMPLES;
use crate::math::{bvh::Bvh, sphere};
use crate::model::{
    image::{HdrImage, RadianceImage},
    scene::{Material, Scene},
};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// ShadedReceivers ready for rays.
struct ShadedReceivers {
    bvh: Bvh,
    normals: Vec<DVec3>,
    /// albedo / pi times the irradiance from distant emitters, for each triangle; and albedo / pi.
    distant_rgb: Vec<[f64; 3]>,
    reflects_rgb: Vec<[f64; 3]>,
}

/// Radiance of a case's receivers in the light of the given emitters: Lambert, on the front side only, no
/// interreflection; past them the environment, the constant sky, or black. Each pixel is the mean of four rays.
pub fn shade(case: &Case, scene: &Scene, shining: &[ReadyEmitter]) -> HdrImage {
    let receivers = gather(case, scene, shining);
    let (width, height) = (case.lens.width as usize, case.lens.height as usize);
    let mut radiance = RadianceImage::default();
    radiance.reshape(width, height, [0.0; 3]);
    radiance.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut sum = [0.0; 3];
            for (k, [dx, dy]) in SAMPLES.into_iter().enumerate() {
                let at = DVec2::new(x as f64 + f64::from(dx), y as f64 + f64::from(dy));
                if let Some(ray) = case.lens.unproject(at) {
                    let seen = trace(
                        &receivers,
                        shining,
                        case.world_from_camera.translation,
                        case.world_from_camera.rotate(ray),
                        k,
                    );
                    sum.iter_mut().zip(seen).for_each(|(s, c)| *s += 0.25 * c);
                }
            }
            *pixel = sum.map(|c| c as f32);
        }
    });
    let mut background = HdrImage { radiance, ..HdrImage::default() };
    background.flags.reshape(width, height, 0);
    background
}

fn gather(case: &Case, scene: &Scene, shining: &[ReadyEmitter]) -> ShadedReceivers {
    let pieces = case.geometry.iter().filter(|g| g.role == GeometryRole::Receiver);
    let (mut positions, mut triangles): (Vec<Vec3>, Vec<[u32; 3]>) = Default::default();
    let mut receivers = ShadedReceivers {
        bvh: Bvh::default(),
        normals: Vec::new(),
        distant_rgb: Vec::new(),
        reflects_rgb: Vec::new(),
    };
    // Flat pieces have few normals: each is integrated once.
    let mut known: Vec<(DVec3, [f64; 3])> = Vec::new();
    for (piece, surface) in pieces.zip(&scene.surfaces) {
        let albedo = match piece.material {
            Material::Lambert { albedo_rgb } | Material::Phong { albedo_rgb, .. } => albedo_rgb,
            Material::Mirror { .. } => [0.0; 3],
        };
        let reflects = albedo.map(|a| f64::from(a) / PI);
        let base = positions.len() as u32;
        positions.extend_from_slice(&surface.mesh.positions);
        for t in &surface.mesh.triangles {
            let [a, b, c] = t.map(|i| surface.mesh.positions[i as usize].as_dvec3());
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let found = known.iter().find(|(n, _)| n.distance(normal) < 1e-6).map(|(_, e)| *e);
            let irradiance = found.unwrap_or_else(|| {
                let mut sum = [0.0; 3];
                for emitter in shining {
                    let e = emitters::distant_irradiance(emitter, normal);
                    sum.iter_mut().zip(e).for_each(|(s, e)| *s += e);
                }
                known.push((normal, sum));
                sum
            });
            triangles.push(t.map(|i| base + i));
            receivers.normals.push(normal);
            receivers.distant_rgb.push(std::array::from_fn(|c| reflects[c] * irradiance[c]));
            receivers.reflects_rgb.push(reflects);
        }
    }
    receivers.bvh = Bvh::build(&positions, &triangles);
    receivers
}

fn trace(
    receivers: &ShadedReceivers,
    shining: &[ReadyEmitter],
    origin: DVec3,
    ray: DVec3,
    number: usize,
) -> [f64; 3] {
    let hit = receivers.bvh.intersect(origin.as_vec3(), ray.as_vec3(), 0.0, f32::INFINITY);
    let wall = hit.map_or(f64::INFINITY, |h| f64::from(h.t));
    let lamp = shining
        .iter()
        .filter_map(|s| emitters::seen_directly(s, origin, ray))
        .filter(|(distance, _)| *distance < wall)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((_, radiance)) = lamp {
        return radiance;
    }
    let Some(hit) = hit else {
        let mut sum = [0.0; 3];
        for emitter in shining {
            let seen = match emitter {
                ReadyEmitter::Environment(_, map) => bilinear(&map.radiance, ray),
                ReadyEmitter::Constant(radiance) => *radiance,
                ReadyEmitter::Directional { .. } | ReadyEmitter::Patch { .. } => [0.0; 3],
            };
            sum.iter_mut().zip(seen).for_each(|(s, c)| *s += c);
        }
        return sum;
    };
    let triangle = hit.triangle as usize;
    let normal = receivers.normals[triangle];
    if normal.dot(ray) >= 0.0 {
        return [0.0; 3];
    }
    let point = origin + f64::from(hit.t) * ray;
    let mut out = receivers.distant_rgb[triangle];
    for emitter in shining {
        let e = emitters::near_irradiance(emitter, &receivers.bvh, point, normal, number);
        for c in 0..3 {
            out[c] += receivers.reflects_rgb[triangle][c] * e[c];
        }
    }
    out
}

/// Radiance of an equirectangular picture in a direction: bilinear between texel centres, wrapped in u.
fn bilinear(map: &RadianceImage, direction: DVec3) -> [f64; 3] {
    let (width, height) = (map.width(), map.height());
    if width == 0 || height == 0 {
        return [0.0; 3];
    }
    let (u, v) = sphere::equirect_uv(direction);
    let (x, y) = (u * width as f64 - 0.5, (v * height as f64 - 0.5).clamp(0.0, (height - 1) as f64));
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let left = (x.floor() as i64).rem_euclid(width as i64) as usize;
    let (right, top) = ((left + 1) % width, y.floor() as usize);
    let bottom = (top + 1).min(height - 1);
    std::array::from_fn(|c| {
        let at = |x: usize, y: usize| f64::from(map.at(x, y)[c]);
        (1.0 - fy) * ((1.0 - fx) * at(left, top) + fx * at(right, top))
            + fy * ((1.0 - fx) * at(left, bottom) + fx * at(right, bottom))
    })
}
