//! The emitters of a case: as the objects' light, and as irradiance on its receivers.

use super::still::halve_options;
use crate::assets::{
    case::{Case, Emitter, EmitterKind, Role, Shape},
    pictures,
};
use crate::cli::CliError;
use crate::light::{
    halve::halve_still_with_rest,
    maps,
    prefilter::{Prefilter, Wanted},
    project_sh,
};
use crate::math::{bvh::Bvh, octahedral};
use crate::model::{
    environment::EnvironmentPicture,
    light::{EnvironmentMap, HardLight, Lights, MapLayout, RadianceSamples, RadianceSh},
    quality::{Quality, SplitKind},
    scene::{Material, Scene},
};
use glam::DVec3;
use std::f64::consts::PI;

/// Samples a side of a polygon or disc.
const PATCH_SIDE: usize = 8;
/// Rays a pixel, which share the samples among them.
pub const RAYS: usize = 4;

/// An emitter made ready.
pub enum Source {
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
        /// Points on it.
        points: Vec<DVec3>,
        /// Area of each, square metres.
        area_m2: f64,
        /// Its radiance.
        radiance_rgb: [f64; 3],
    },
}

/// Makes a picture's emitters ready.
pub fn sources(case: &Case, emitters: &[&Emitter]) -> Result<Vec<Source>, CliError> {
    let directional = emitters.iter().filter(|e| matches!(e.kind, EmitterKind::Directional { .. })).count();
    if directional > 1 {
        return Err(CliError(format!(
            "{}: emitters: {directional} directional lights: at most 1 can be drawn",
            case.file.display()
        )));
    }
    emitters.iter().map(|e| source(&e.kind)).collect()
}

fn source(kind: &EmitterKind) -> Result<Source, CliError> {
    Ok(match kind {
        EmitterKind::Environment { file } => {
            let radiance = pictures::load_radiance(file).map_err(|e| CliError(e.to_string()))?.hdr.radiance;
            let map = EnvironmentMap { layout: MapLayout::Equirect, radiance };
            let mut samples = RadianceSamples::default();
            maps::samples_of_map(&map, &mut samples);
            Source::Environment(samples, map)
        }
        EmitterKind::Directional { to_light_world, irradiance_rgb } => {
            Source::Directional { to_light: *to_light_world, irradiance_rgb: *irradiance_rgb }
        }
        EmitterKind::Constant { radiance_rgb } => Source::Constant(*radiance_rgb),
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

fn patch(centre: DVec3, half_u: DVec3, half_v: DVec3, disc: bool, radiance_rgb: [f64; 3]) -> Source {
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
    Source::Patch {
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

/// Texels a side of the picture that mirrors see: about those of the reference's maps.
const PICTURE_SIDE: usize = 512;

/// What mirrors and sharp gloss see, if the scene has any and a distant picture is all of the light. Where a plane hides
/// the lower half of the picture it is black there; mirrors see the plane.
pub fn picture_for_objects(
    case: &Case,
    scene: &Scene,
    sources: &[Source],
    left: Option<&RadianceSamples>,
    order: usize,
) -> Option<EnvironmentPicture> {
    let wanted = Wanted::by(scene, order);
    let [Source::Environment(_, map)] = sources else { return None };
    if !wanted.picture {
        return None;
    }
    let mut picture = EnvironmentPicture::default();
    let mut work = Prefilter::default();
    work.look_at_map(map, glam::DMat3::IDENTITY, PICTURE_SIDE, &mut picture);
    if on_plane(case) {
        let side = picture.all.side();
        for (i, texel) in picture.all.texels_mut().iter_mut().enumerate() {
            let at = octahedral::centre(i % side, i / side, side);
            if octahedral::direction(at).z < 0.0 {
                *texel = [0.0; 3];
            }
        }
    }
    if wanted.glossy {
        work.levels(left, &mut picture);
    }
    Some(picture)
}

/// Whether a plane z = 0 hides what is below.
fn on_plane(case: &Case) -> bool {
    case.geometry.iter().any(|g| g.role == Role::Receiver && matches!(g.shape, Shape::PlaneZ0 { .. }))
}

/// The light that objects get, ready split (see the verb's own text), and what hard lights leave of the picture.
/// Near emitters are taken as seen from the centre of the objects' vertices.
pub fn split_for_objects(
    case: &Case,
    scene: &Scene,
    sources: &[Source],
    quality: &Quality,
) -> Result<(Lights, Option<RadianceSamples>), CliError> {
    let on_plane = on_plane(case);
    let centre = centre_of(scene);
    let mut samples = RadianceSamples::default();
    let mut add = |direction: DVec3, weight_sr: f64, radiance: [f64; 3]| {
        if !(on_plane && direction.z < 0.0) && weight_sr > 0.0 {
            let d = direction.as_vec3();
            samples.directions.push([d.x, d.y, d.z, weight_sr as f32]);
            let [r, g, b] = radiance.map(|c| c as f32);
            samples.radiance.push([r, g, b, 0.0]);
        }
    };
    let mut hard = Vec::new();
    for source in sources {
        match source {
            Source::Environment(map, _) => {
                for (d, r) in map.directions.iter().zip(&map.radiance) {
                    let direction = glam::Vec3::new(d[0], d[1], d[2]).as_dvec3();
                    add(direction, f64::from(d[3]), [r[0], r[1], r[2]].map(f64::from));
                }
            }
            Source::Directional { to_light, irradiance_rgb } => {
                hard.push(HardLight {
                    to_light_world: to_light.as_vec3().to_array(),
                    irradiance_rgb: irradiance_rgb.map(|e| e as f32),
                    extent_rad: 0.0,
                });
            }
            Source::Constant(radiance) => {
                // Rings of equal solid angle; midpoints in z integrate the polynomials of SH well.
                let (rings, sectors) = (256, 32);
                let weight = 4.0 * PI / f64::from(rings * sectors);
                for j in 0..rings {
                    let z = 1.0 - 2.0 * (f64::from(j) + 0.5) / f64::from(rings);
                    let r = (1.0 - z * z).sqrt();
                    for i in 0..sectors {
                        let phi = 2.0 * PI * (f64::from(i) + 0.5) / f64::from(sectors);
                        add(DVec3::new(r * phi.cos(), r * phi.sin(), z), weight, *radiance);
                    }
                }
            }
            Source::Patch { points, normal, area_m2, radiance_rgb, .. } => {
                for p in points {
                    let to = *p - centre;
                    let direction = to.normalize_or_zero();
                    let cosine = -normal.dot(direction);
                    add(direction, area_m2 * cosine / to.length_squared(), *radiance_rgb);
                }
            }
        }
    }
    if sources.iter().any(|s| matches!(s, Source::Patch { .. })) {
        fill(&mut samples, |_| Some([0.0; 3]));
    }
    // Net flux is that through the plane, which sends light back up; the objects of the reference get none of it.
    if on_plane && matches!(quality.split, SplitKind::Paper | SplitKind::Bounded) {
        let plane = plane_radiance(case, &samples);
        fill(&mut samples, |z| (z < 0.0).then_some(plane));
    }
    let total = if samples.directions.is_empty() {
        RadianceSh::zero(quality.sh_order)
    } else {
        project_sh::project_sh(&samples, quality.sh_order)
    };
    // A constant sky is soft as it is; only light that has a direct part hidden in it is split.
    let mixed = |s: &Source| matches!(s, Source::Environment(..) | Source::Patch { .. });
    let (mut lights, left) = if sources.iter().any(mixed) {
        halve_still_with_rest(&samples, &total, halve_options(quality, on_plane))
    } else {
        (Lights::soft(total), None)
    };
    for light in hard {
        lights.hard.push(light);
    }
    Ok((lights, left))
}

/// Radiance of the plane z = 0 under the samples, nothing in their way: albedo / pi times the irradiance.
fn plane_radiance(case: &Case, samples: &RadianceSamples) -> [f32; 3] {
    let plane = case.geometry.iter().find(|g| matches!(g.shape, Shape::PlaneZ0 { .. }));
    let albedo_rgb = match plane.map(|p| p.material) {
        Some(Material::Lambert { albedo_rgb } | Material::Phong { albedo_rgb, .. }) => albedo_rgb,
        _ => [0.0; 3],
    };
    let mut sum = [0.0f64; 3];
    for (d, r) in samples.directions.iter().zip(&samples.radiance) {
        for (sum, c) in sum.iter_mut().zip(r) {
            *sum += f64::from(*c) * f64::from(d[2].max(0.0)) * f64::from(d[3]);
        }
    }
    std::array::from_fn(|c| (f64::from(albedo_rgb[c]) / PI * sum[c]) as f32)
}

/// Adds radiance from directions all over the sphere, as a function of their height; `None` adds nothing there.
fn fill(samples: &mut RadianceSamples, radiance_rgb: impl Fn(f64) -> Option<[f32; 3]>) {
    const DIRECTIONS: usize = 4096;
    for j in 0..DIRECTIONS {
        let z = 1.0 - 2.0 * (j as f64 + 0.5) / DIRECTIONS as f64;
        let phi = PI * (1.0 + 5f64.sqrt()) * (j as f64 + 0.5);
        let r = (1.0 - z * z).sqrt();
        let weight_sr = 4.0 * PI / DIRECTIONS as f64;
        if let Some([red, green, blue]) = radiance_rgb(z) {
            samples.directions.push([r * phi.cos(), r * phi.sin(), z, weight_sr].map(|x| x as f32));
            samples.radiance.push([red, green, blue, 0.0]);
        }
    }
}

/// Mean of the objects' vertices; 10 cm above the origin where there are none.
fn centre_of(scene: &Scene) -> DVec3 {
    let mut sum = DVec3::ZERO;
    let mut count = 0.0;
    for object in &scene.objects {
        for &p in &object.mesh.positions {
            sum += object.world_from_object.transform_point3(p).as_dvec3();
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { DVec3::new(0.0, 0.0, 0.1) }
}

/// Irradiance on a surface from a distant source, without any blocker: depends on the normal alone. Zero for
/// the others.
pub fn distant_irradiance(source: &Source, normal: DVec3) -> [f64; 3] {
    match source {
        Source::Environment(samples, _) => {
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
        Source::Constant(radiance) => radiance.map(|c| PI * c),
        Source::Directional { .. } | Source::Patch { .. } => [0.0; 3],
    }
}

/// Irradiance on a point of a receiver from the sources that receivers can hide; `ray` of 0..RAYS takes its own
/// quarter of a flat emitter's points.
pub fn near_irradiance(
    source: &Source,
    receivers: &Bvh,
    point: DVec3,
    normal: DVec3,
    ray: usize,
) -> [f64; 3] {
    // Off the surface by more than the rounding of a ray's end.
    let start = (point + 1e-4 * normal).as_vec3();
    match source {
        Source::Directional { to_light, irradiance_rgb } => {
            let cosine = normal.dot(*to_light);
            if cosine <= 0.0 || receivers.occluded(start, to_light.as_vec3(), 0.0, f32::INFINITY) {
                return [0.0; 3];
            }
            irradiance_rgb.map(|e| e * cosine)
        }
        Source::Patch { points, normal: front, area_m2, radiance_rgb, .. } => {
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
        Source::Environment(..) | Source::Constant(_) => [0.0; 3],
    }
}

/// Distance to a flat emitter's front along a ray, and its radiance.
pub fn seen_directly(source: &Source, origin: DVec3, ray: DVec3) -> Option<(f64, [f64; 3])> {
    let Source::Patch { centre, half_u, half_v, disc, normal, radiance_rgb, .. } = source else {
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
