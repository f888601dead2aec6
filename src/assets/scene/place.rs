//! Real surfaces and virtual objects of a scene file.

use super::{
    figure::{movement, static_figure},
    resolved,
    walk::{Mistakes, Section, is_place, numbers, place as corner},
};
use crate::animate::walk::{towards_x, world_from_start};
use crate::model::animation::Figure;
use crate::model::scene::{Material, Mesh, RealSurface, VirtualObject};
use crate::visibility::openness;
use crate::{error::read_text, gltf, obj, shapes};
use glam::{Affine3A, DVec3, Quat, Vec3};
use std::path::Path;

const SURFACE_SHAPES: [&str; 5] = ["plane", "box", "sphere", "cylinder", "quad"];
const OBJECT_SHAPES: [&str; 9] =
    ["pawn", "pawn_with_ring", "vase", "sphere", "box", "cylinder", "capsule", "torus", "torus_knot"];
/// Largest length in a scene, metres.
const FAR_M: f64 = 1000.0;
/// Subdivisions of a sphere: 5120 triangles.
const SPHERE_SUBDIVISIONS: u32 = 4;
/// Segments around shapes of revolution.
const SEGMENTS: u32 = 64;

/// `[[surface]]`
pub fn surface(
    section: &Section<'_>,
    index: usize,
    folder: &Path,
    mistakes: &Mistakes<'_>,
) -> Option<RealSurface> {
    let name = section.text("name").map_or_else(|| format!("surface {index}"), str::to_owned);
    let receives_shadow = section.switch("receives_shadow", true);
    let mesh = match section.text("file") {
        Some(file) => {
            let path = resolved(folder, file);
            let read = if is_gltf(&path) {
                gltf::load_with(&path, 0, &|_| ()).map(|parts| merged(&parts))
            } else {
                read_text(&path).and_then(|text| obj::parse(&path, &text))
            };
            read.map_err(|error| mistakes.add(error)).ok()
        }
        None => shape(section, &SURFACE_SHAPES),
    };
    let placed = place(section);
    section.finish();
    let (mesh, place) = (mesh?, placed);
    // Real surfaces are measured where they are: position is their origin, not their lowest point.
    let transform = Affine3A::from_rotation_translation(place.rotation, place.position);
    let mesh = shapes::transformed(&mesh, &transform);
    if !mesh.positions.iter().all(|p| is_place(p.as_dvec3())) {
        let key = if section.has("file") { "file" } else { "shape" };
        section.refuse(key, "such that all corners lie within 10000 m of the origin");
        return None;
    }
    Some(RealSurface { name, mesh, receives_shadow, albedo_rgb: None })
}

/// `[[object]]`; a file with several materials gives several objects. They are the parts of one figure, which counts
/// them from 0.
pub fn objects(
    section: &Section<'_>,
    index: usize,
    folder: &Path,
    mistakes: &Mistakes<'_>,
) -> Option<(Vec<VirtualObject>, Figure)> {
    let name = section.text("name").map_or_else(|| format!("object {index}"), str::to_owned);
    let material = section.table("material").and_then(|s| material(&s));
    let movement = movement(section);
    let loaded = match (section.text("file"), &movement.animation) {
        (Some(file), None) => gltf::load(&resolved(folder, file))
            .map_err(|error| mistakes.add(error))
            .ok()
            .map(|parts| (static_figure(parts.len()), parts)),
        (Some(file), Some(_)) => gltf::load_figure(&resolved(folder, file), openness::DEFAULT_RAYS, &|_| ())
            .map_err(|error| mistakes.add(error))
            .ok()
            .map(|loaded| (loaded.figure, loaded.objects)),
        (None, _) => shape(section, &OBJECT_SHAPES).map(|mesh| {
            let openness = openness::of_mesh(&mesh, openness::DEFAULT_RAYS, &|_| ());
            let material = Material::Lambert { albedo_rgb: [0.7; 3] };
            let (name, world_from_object) = (name.clone(), Affine3A::IDENTITY);
            let object = VirtualObject { name, mesh, material, world_from_object, openness };
            (static_figure(1), vec![object])
        }),
    };
    let scale = section.number("scale", 1e-4, 1e4);
    let height_m = if section.has("file") { section.number("height_m", 1e-4, FAR_M) } else { None };
    let keeps_origin = section.read("origin", "\"lowest\" (default) or \"file\"", |v| match v.as_str()? {
        "lowest" => Some(false),
        "file" => Some(true),
        _ => None,
    });
    let place = place(section);
    section.finish();
    let (figure, mut parts) = loaded?;
    let (low, high) = bounds(&parts)?;
    let height = high.z - low.z;
    let scale = match height_m {
        Some(wanted) if height > 0.0 => wanted as f32 / height,
        _ => scale.unwrap_or(1.0) as f32,
    };
    // Stands with its middle above `position` and its lowest point at its height.
    let origin = if keeps_origin == Some(true) {
        Vec3::ZERO
    } else {
        Vec3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, low.z)
    };
    let reach = [low, high].map(|corner| (corner - origin) * scale).map(|p| p.as_dvec3());
    if !reach.into_iter().all(|p| p.is_finite() && is_place(p)) {
        let key = if section.has("height_m") { "height_m" } else { "file" };
        section.refuse(key, "such that the object's corners lie within 10000 m of its position");
        return None;
    }
    // A walk is put in front of this, beginning along +x.
    let rotation = if movement.walk.is_some() { towards_x() * place.rotation } else { place.rotation };
    let world_from_figure =
        Affine3A::from_scale_rotation_translation(Vec3::splat(scale), rotation, place.position)
            * Affine3A::from_translation(-origin);
    let stand = match &movement.walk {
        Some(walk) => world_from_start(walk, 0.0) * world_from_figure,
        None => world_from_figure,
    };
    let figure = movement.figure(section, figure, name.clone(), world_from_figure);
    let several = parts.len() > 1;
    for part in &mut parts {
        part.world_from_object = stand * part.world_from_object;
        if let Some(material) = material {
            part.material = material;
        }
        part.name = if several { format!("{name}/{}", part.name) } else { name.clone() };
    }
    Some((parts, figure))
}

struct Standpoint {
    position: Vec3,
    rotation: Quat,
}

fn place(section: &Section<'_>) -> Standpoint {
    let position = section.point("position").unwrap_or(DVec3::ZERO).as_vec3();
    let yaw = section.number("yaw_deg", -360.0, 360.0).unwrap_or(0.0).to_radians() as f32;
    Standpoint { position, rotation: Quat::from_rotation_z(yaw) }
}

fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

fn merged(parts: &[VirtualObject]) -> Mesh {
    let meshes: Vec<Mesh> =
        parts.iter().map(|p| shapes::transformed(&p.mesh, &p.world_from_object)).collect();
    shapes::merged(&meshes)
}

fn bounds(parts: &[VirtualObject]) -> Option<(Vec3, Vec3)> {
    let mut all = parts
        .iter()
        .flat_map(|part| part.mesh.positions.iter().map(|&p| part.world_from_object.transform_point3(p)));
    let first = all.next()?;
    Some(all.fold((first, first), |(low, high), p| (low.min(p), high.max(p))))
}

/// A shape by its name with its own measures.
fn shape(section: &Section<'_>, known: &[&'static str]) -> Option<Mesh> {
    let allowed = format!("one of {} (or file = \"..\")", known.join(", "));
    let name =
        section.need("shape", &allowed, |v| known.iter().find(|k| Some(**k) == v.as_str()).copied())?;
    let length = |key: &'static str, default: f64| section.number(key, 1e-4, FAR_M).unwrap_or(default);
    Some(match name {
        "plane" => shapes::plane_z0(length("half_extent", 1.0)),
        "quad" => {
            let corners = section.need(
                "corners",
                "four points of three numbers within -10000..=10000, counter-clockwise from the front",
                |v| {
                    let points: Vec<DVec3> = v.as_array()?.iter().map(corner).collect::<Option<_>>()?;
                    <[DVec3; 4]>::try_from(points).ok()
                },
            )?;
            shapes::quad(corners)
        }
        "box" => {
            let size = section.read("size", "three numbers above 0", |v| {
                let list = numbers(v).filter(|l| l.len() == 3 && l.iter().all(|&s| s > 0.0 && s <= FAR_M))?;
                Some(DVec3::new(list[0], list[1], list[2]))
            });
            shapes::cuboid(size.unwrap_or(DVec3::splat(0.1)) / 2.0)
        }
        "sphere" => shapes::icosphere(length("radius_m", 0.05), SPHERE_SUBDIVISIONS),
        "cylinder" => shapes::cylinder(length("radius_m", 0.05), length("height_m", 0.1), SEGMENTS),
        "capsule" => shapes::capsule(length("radius_m", 0.03), length("height_m", 0.12), SEGMENTS),
        "vase" => shapes::vase(length("height_m", 0.15), SEGMENTS),
        "torus" => shapes::torus(length("radius_m", 0.04), length("wire_radius_m", 0.012), SEGMENTS, 32),
        "torus_knot" => shapes::torus_knot(length("radius_m", 0.03), length("wire_radius_m", 0.01), 192, 24),
        "pawn_with_ring" => shapes::pawn_with_ring(length("height_m", 0.12)),
        _ => shapes::pawn(length("height_m", 0.12), SEGMENTS),
    })
}

fn material(section: &Section<'_>) -> Option<Material> {
    let kinds = "one of \"lambert\", \"phong\", \"mirror\"";
    let kind = section
        .need("kind", kinds, |v| ["lambert", "phong", "mirror"].into_iter().find(|k| Some(*k) == v.as_str()));
    let albedo_rgb = section.color("albedo_rgb", 1.0);
    let made = match kind? {
        "phong" => Material::Phong {
            albedo_rgb: albedo_rgb.unwrap_or([0.5; 3]),
            specular_rgb: section.color("specular_rgb", 1.0).unwrap_or([0.2; 3]),
            exponent: section.number("exponent", 0.0, 1e5).unwrap_or(20.0) as f32,
        },
        "mirror" => {
            Material::Mirror { reflectance_rgb: section.color("reflectance_rgb", 1.0).unwrap_or([1.0; 3]) }
        }
        _ => Material::Lambert { albedo_rgb: albedo_rgb.unwrap_or([0.7; 3]) },
    };
    section.finish();
    Some(made)
}
