//! The emitters of a case, made ready: what the receivers get of them where no object is, and where a ray sees them.

use super::{Case, CaseEmitter, EmitterKind};
use crate::error::LabError;
use crate::light::maps;
use crate::math::bvh::Bvh;
use crate::model::light::{EnvironmentMap, MapLayout, RadianceSamples};
use crate::open_exr::load_radiance;
use glam::DVec3;
use std::f64::consts::PI;

/// Samples a side of a polygon or disc.
const PATCH_SIDE: usize = 8;
/// Rays a pixel, which share the samples among them.
pub const RAYS: usize = 4;

/// An emitter made ready.
pub enum ReadyEmitter {
    /// Directions with radiance, and the picture they come from.
    Environment(RadianceSamples, EnvironmentMap),
    /// A light at infinity.
    Directional {
        /// Unit, towards the light.
        to_light: DVec3,
        /// Irradiance of a surface that faces it.
        irradiance_rgb: [f64; 3],
    },
    /// The same radiance from everywhere.
    Constant([f64; 3]),
    /// A flat emitter: points with the same area each.
    Patch {
        /// Centre, and the two half sides (or radii).
        centre: DVec3,
        /// Half side or radius along one axis.
        half_u: DVec3,
        /// Half side or radius along the other.
        half_v: DVec3,
        /// Whether it is a disc.
        disc: bool,
        /// Unit vector away from its front.
        normal: DVec3,
        points: Vec<DVec3>,
        /// Area of each, square metres.
        area_m2: f64,
        radiance_rgb: [f64; 3],
    },
}

impl ReadyEmitter {
    /// Adds a flat emitter as it is seen from a place to weighted directions; others add nothing.
    pub fn seen_from(&self, place: DVec3, samples: &mut RadianceSamples) {
        let Self::Patch { points, normal, area_m2, radiance_rgb, .. } = self else { return };
        for point in points {
            let to = *point - place;
            let direction = to.normalize_or_zero();
            let weight_sr = area_m2 * -normal.dot(direction) / to.length_squared();
            if weight_sr > 0.0 {
                samples.directions.push(direction.as_vec3().extend(weight_sr as f32).to_array());
                let [r, g, b] = radiance_rgb.map(|c| c as f32);
                samples.radiance.push([r, g, b, 0.0]);
            }
        }
    }
}

/// Makes a picture's emitters ready.
pub fn ready(case: &Case, emitters: &[&CaseEmitter]) -> Result<Vec<ReadyEmitter>, LabError> {
    let directional = emitters.iter().filter(|e| matches!(e.kind, EmitterKind::Directional { .. })).count();
    if directional > 1 {
        return Err(LabError::Asked(format!(
            "{}: emitters: {directional} directional lights: at most 1 can be drawn",
            case.file.display()
        )));
    }
    emitters.iter().map(|e| ready_emitter(&e.kind)).collect()
}

fn ready_emitter(kind: &EmitterKind) -> Result<ReadyEmitter, LabError> {
    Ok(match kind {
        EmitterKind::Environment { file } => {
            let radiance = load_radiance(file)?.hdr.radiance;
            let map = EnvironmentMap { layout: MapLayout::Equirect, radiance };
            let mut samples = RadianceSamples::default();
            maps::samples_of_map(&map, &mut samples);
            ReadyEmitter::Environment(samples, map)
        }
        EmitterKind::Directional { to_light_world, irradiance_rgb } => {
            ReadyEmitter::Directional { to_light: *to_light_world, irradiance_rgb: *irradiance_rgb }
        }
        EmitterKind::Constant { radiance_rgb } => ReadyEmitter::Constant(*radiance_rgb),
        EmitterKind::Quad { vertices: [a, b, _, d], radiance_rgb } => {
            let (half_u, half_v) = (0.5 * (*b - *a), 0.5 * (*d - *a));
            patch(*a + half_u + half_v, half_u, half_v, false, *radiance_rgb)
        }
        EmitterKind::Disc { centre, normal, radius, radiance_rgb } => {
            let side = normal.any_orthonormal_vector();
            patch(*centre, side * *radius, normal.cross(side) * *radius, true, *radiance_rgb)
        }
    })
}

fn patch(centre: DVec3, half_u: DVec3, half_v: DVec3, disc: bool, radiance_rgb: [f64; 3]) -> ReadyEmitter {
    let n = PATCH_SIDE as f64;
    let mut cells: Vec<(usize, usize)> =
        (0..PATCH_SIDE * PATCH_SIDE).map(|k| (k % PATCH_SIDE, k / PATCH_SIDE)).collect();
    // Ray k of a pixel uses every fourth point from k on: two in each row, shifted from row to row.
    cells.sort_by_key(|&(i, j)| (j, i / RAYS, (i + 2 * j) % RAYS));
    let points = cells.into_iter().map(|(i, j)| {
        let (i, j) = (i as f64 + 0.5, j as f64 + 0.5);
        let (u, v) = if disc {
            let (radius, phi) = ((j / n).sqrt(), 2.0 * PI * i / n);
            (radius * phi.cos(), radius * phi.sin())
        } else {
            (2.0 * i / n - 1.0, 2.0 * j / n - 1.0)
        };
        centre + u * half_u + v * half_v
    });
    let cross = half_u.cross(half_v);
    let area_m2 = cross.length() * if disc { PI } else { 4.0 } / (n * n);
    ReadyEmitter::Patch {
        centre,
        half_u,
        half_v,
        disc,
        normal: cross.normalize_or_zero(),
        points: points.collect(),
        area_m2,
        radiance_rgb,
    }
}

/// Irradiance on a surface from a distant emitter, without any blocker: depends on the normal alone. Zero for
/// the others.
pub fn distant_irradiance(emitter: &ReadyEmitter, normal: DVec3) -> [f64; 3] {
    match emitter {
        ReadyEmitter::Environment(samples, _) => {
            let mut sum = [0.0; 3];
            for (d, r) in samples.directions.iter().zip(&samples.radiance) {
                let cosine =
                    f64::from(d[0]) * normal.x + f64::from(d[1]) * normal.y + f64::from(d[2]) * normal.z;
                if cosine > 0.0 {
                    let weight = cosine * f64::from(d[3]);
                    sum.iter_mut().zip(r).for_each(|(s, c)| *s += weight * f64::from(*c));
                }
            }
            sum
        }
        ReadyEmitter::Constant(radiance) => radiance.map(|c| PI * c),
        ReadyEmitter::Directional { .. } | ReadyEmitter::Patch { .. } => [0.0; 3],
    }
}

/// Irradiance on a point of a receiver from the emitters that receivers can hide; `ray` of 0..RAYS takes its own
/// quarter of a flat emitter's points.
pub fn near_irradiance(
    emitter: &ReadyEmitter,
    receivers: &Bvh,
    point: DVec3,
    normal: DVec3,
    ray: usize,
) -> [f64; 3] {
    // Off the surface by more than the rounding of a ray's end.
    let start = (point + 1e-4 * normal).as_vec3();
    match emitter {
        ReadyEmitter::Directional { to_light, irradiance_rgb } => {
            let cosine = normal.dot(*to_light);
            if cosine <= 0.0 || receivers.occluded(start, to_light.as_vec3(), 0.0, f32::INFINITY) {
                return [0.0; 3];
            }
            irradiance_rgb.map(|e| e * cosine)
        }
        ReadyEmitter::Patch { points, normal: front, area_m2, radiance_rgb, .. } => {
            let mut sum = 0.0;
            for p in points.iter().skip(ray).step_by(RAYS) {
                let to = *p - point;
                let squared = to.length_squared();
                let direction = to / squared.sqrt();
                let (here, there) = (normal.dot(direction), -front.dot(direction));
                if here > 0.0 && there > 0.0 {
                    let to = (p.as_vec3() - start) * (1.0 - 1e-4);
                    if !receivers.occluded(start, to, 0.0, 1.0) {
                        sum += here * there * area_m2 * RAYS as f64 / squared;
                    }
                }
            }
            radiance_rgb.map(|l| l * sum)
        }
        ReadyEmitter::Environment(..) | ReadyEmitter::Constant(_) => [0.0; 3],
    }
}

/// Distance to a flat emitter's front along a ray, and its radiance.
pub fn seen_directly(emitter: &ReadyEmitter, origin: DVec3, ray: DVec3) -> Option<(f64, [f64; 3])> {
    let ReadyEmitter::Patch { centre, half_u, half_v, disc, normal, radiance_rgb, .. } = emitter else {
        return None;
    };
    let facing = normal.dot(ray);
    if facing >= 0.0 {
        return None;
    }
    let distance = normal.dot(*centre - origin) / facing;
    let at = origin + distance * ray - *centre;
    let u = at.dot(*half_u) / half_u.length_squared();
    let v = at.dot(*half_v) / half_v.length_squared();
    let inside = if *disc { u * u + v * v <= 1.0 } else { u.abs() <= 1.0 && v.abs() <= 1.0 };
    (distance > 0.0 && inside).then_some((distance, *radiance_rgb))
}
