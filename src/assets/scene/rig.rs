//! Camera, light, ball and tags of a scene file.

use super::{
    LightSource, Pictures, SceneCamera, pictures, resolved,
    walk::{Mistakes, PLACES, Section, is_place, numbers, place},
};
use crate::calibration;
use crate::light::below::BelowHorizon;
use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
};
use crate::model::limits::{MAX_CAMERA_PIXELS, MAX_LENS_PX, MIN_FOCAL_PX, check_camera_size};
use crate::model::{
    light::MapLayout,
    rig::{MirrorBall, TagPlacement},
};
use glam::{DMat3, DQuat, DVec3};
use std::path::Path;

/// `[camera]`
pub fn camera(section: &Section<'_>, folder: &Path, mistakes: &Mistakes<'_>) -> Option<SceneCamera> {
    let from_file =
        section.text("calibration").and_then(|name| match calibration::load(&resolved(folder, name)) {
            Ok(lens) => Some(lens),
            Err(error) => {
                mistakes.add(error);
                None
            }
        });
    let inline = section.table("lens").and_then(|s| lens(&s));
    if !section.has("calibration") && !section.has("lens") {
        section.refuse("lens", "given (or calibration)");
    }
    let rows = section.read("world_from_camera", RIGID, rigid_rows);
    let position = section.point("position");
    let look_at = section.point("look_at");
    let up = section.direction("up").unwrap_or(DVec3::Z);
    if let (Some(eye), Some(target)) = (position, look_at)
        && eye.distance(target) < LEAST_VIEW_M
    {
        section.refuse("look_at", format!("another place than position, at least {LEAST_VIEW_M} m from it"));
    }
    let pose = match (rows, position, look_at) {
        (Some(pose), ..) => pose,
        (None, Some(eye), Some(target)) => Pose::look_at(eye, target, up),
        _ => Pose::IDENTITY,
    };
    let stated = section.has("world_from_camera") || (section.has("position") && section.has("look_at"));
    if !stated && section.has("pictures") {
        section.refuse("position", "given with look_at, or world_from_camera in their place");
    }
    let pictures = pictures(section, folder);
    section.finish();
    let lens = from_file.or(inline)?;
    Some(SceneCamera { lens, world_from_camera: pose, pictures })
}

/// Largest coefficient of a distortion.
const MAX_COEFFICIENT: f64 = 1e6;

fn lens(section: &Section<'_>) -> Option<Lens> {
    let size = |key| {
        section
            .need(key, "an integer within 1..=16384", |v| v.as_integer().filter(|n| (1..=16384).contains(n)))
    };
    let focal = |key| {
        let allowed = format!("a number within {MIN_FOCAL_PX}..={MAX_LENS_PX}, in pixels");
        section.need(key, &allowed, |v| super::number(v).filter(|f| (MIN_FOCAL_PX..=MAX_LENS_PX).contains(f)))
    };
    let centre = |key| {
        let allowed = format!("a number within {MAX_LENS_PX} pixels of 0");
        section.need(key, &allowed, |v| super::number(v).filter(|c| c.abs() <= MAX_LENS_PX))
    };
    let coefficients = |v: &toml::Value| numbers(v).filter(|l| l.iter().all(|k| k.abs() <= MAX_COEFFICIENT));
    let width = size("width");
    let height = size("height");
    let fx = focal("fx");
    let fy = focal("fy");
    let (cx, cy) = (centre("cx"), centre("cy"));
    if let (Some(width), Some(height)) = (width, height)
        && check_camera_size(width as usize, height as usize).is_err()
    {
        let allowed =
            format!("such that, with height = {height}, there are at most {MAX_CAMERA_PIXELS} pixels");
        section.refuse("width", allowed);
    }
    let radial = section.read("distortion", "4 to 8 numbers: k1, k2, p1, p2, k3, k4, k5, k6", |v| {
        let list = coefficients(v).filter(|l| (4..=8).contains(&l.len()))?;
        let mut all = [0.0; 8];
        all[..list.len()].copy_from_slice(&list);
        Some(Distortion::RadialTangential(all))
    });
    let fisheye = section.read("fisheye", "4 numbers: k1, k2, k3, k4", |v| {
        <[f64; 4]>::try_from(coefficients(v)?).ok().map(Distortion::Equidistant)
    });
    section.finish();
    let distortion = fisheye.or(radial).unwrap_or(Distortion::None);
    Some(Lens {
        width: u32::try_from(width?).ok()?,
        height: u32::try_from(height?).ok()?,
        fx: fx?,
        fy: fy?,
        cx: cx?,
        cy: cy?,
        distortion,
    })
}

/// Nearer places give no direction to look in.
const LEAST_VIEW_M: f64 = 1e-6;
/// What `rigid_rows` takes.
const RIGID: &str = "four rows of four numbers, a rigid transform to a place within -10000..=10000, metres";

fn rigid_rows(value: &toml::Value) -> Option<Pose> {
    let rows: Vec<Vec<f64>> = value.as_array()?.iter().map(numbers).collect::<Option<_>>()?;
    let rows: Vec<[f64; 4]> =
        rows.into_iter().map(|r| <[f64; 4]>::try_from(r).ok()).collect::<Option<_>>()?;
    let rows = <[[f64; 4]; 4]>::try_from(rows).ok()?;
    let axis = |i: usize| DVec3::new(rows[i][0], rows[i][1], rows[i][2]);
    let rotation = DMat3::from_cols(axis(0), axis(1), axis(2));
    // Numbers typed with six digits still count as a rotation.
    let is_rotation =
        (rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-4) && rotation.determinant() > 0.0;
    let is_near = is_place(DVec3::new(rows[0][3], rows[1][3], rows[2][3]));
    (is_rotation && is_near && rows[3] == [0.0, 0.0, 0.0, 1.0]).then(|| Pose::from_rows(rows))
}

/// `[light]`, and what comes from below the horizon.
pub fn light(section: &Section<'_>, folder: &Path) -> (LightSource, BelowHorizon) {
    let ways = ["measure", "file", "constant", "to_light"].iter().filter(|key| section.has(key)).count();
    let measure = section.read("measure", "\"ball\"", |v| (v.as_str() == Some("ball")).then_some(()));
    let file = section.text("file").map(|name| resolved(folder, name));
    let (layout, y_up, rotation_deg) = map_keys(section);
    let constant_rgb = section.color("constant", 1e6);
    let to_light = section.read("to_light", "a vector of three numbers that is not zero", |v| {
        let list = numbers(v).filter(|l| l.len() == 3 && l.iter().all(|x| x.abs() <= 1e6))?;
        DVec3::new(list[0], list[1], list[2]).try_normalize().map(|d| d.as_vec3().to_array())
    });
    let irradiance_rgb = section.color("irradiance_rgb", 1e6);
    let below = below(section, measure.is_some());
    let bracket = if measure.is_some() { pictures(section, folder) } else { Pictures::default() };
    if ways == 0 {
        section.refuse("measure", "given, or one of file, constant, to_light");
    } else if to_light.is_some() != irradiance_rgb.is_some() {
        section.refuse("irradiance_rgb", "given together with to_light");
    }
    section.finish();
    let source = match (measure, file) {
        (Some(()), _) => LightSource::Ball(bracket),
        (None, Some(file)) => LightSource::File { file, layout, y_up, rotation_deg },
        (None, None) => LightSource::Stated {
            constant_rgb: constant_rgb.unwrap_or_default(),
            direct: to_light.zip(irradiance_rgb),
        },
    };
    (source, below)
}

/// Albedo of the surface below the horizon where the file does not say.
const UNSTATED_ALBEDO: f32 = 0.5;

/// `below` and `surface_albedo_rgb` of `[light]`.
fn below(section: &Section<'_>, is_measured: bool) -> BelowHorizon {
    let albedo_rgb = section.color("surface_albedo_rgb", 1.0);
    let below = section.read("below", "one of \"given\", \"dark\", \"surface\"", |v| match v.as_str()? {
        "given" => Some(BelowHorizon::AsGiven),
        "dark" => Some(BelowHorizon::Dark),
        "surface" => Some(BelowHorizon::Surface { albedo_rgb: albedo_rgb.unwrap_or([UNSTATED_ALBEDO; 3]) }),
        _ => None,
    });
    if is_measured && below.is_some() {
        section.refuse("below", "left out where light is measured: ball.on_surface says it");
    }
    if albedo_rgb.is_some() && !matches!(below, Some(BelowHorizon::Surface { .. })) {
        section.refuse("surface_albedo_rgb", "left out where below is not \"surface\"");
    }
    below.unwrap_or_default()
}

/// How an environment picture lies: its layout, whether its up is +y, and its turn about the world's z axis in degrees.
pub fn map_keys(section: &Section<'_>) -> (MapLayout, bool, f64) {
    let layout = section
        .read("layout", "one of \"equirect\", \"angular\", \"cube\"", |v| match v.as_str()? {
            "equirect" => Some(MapLayout::Equirect),
            "angular" => Some(MapLayout::Angular),
            "cube" => Some(MapLayout::Cube),
            _ => None,
        })
        .unwrap_or(MapLayout::Equirect);
    let y_up = section
        .read("up", "\"z\" or \"y\"", |v| match v.as_str()? {
            "z" => Some(false),
            "y" => Some(true),
            _ => None,
        })
        .unwrap_or(false);
    let rotation_deg = section.number("rotation_deg", -360.0, 360.0).unwrap_or(0.0);
    (layout, y_up, rotation_deg)
}

/// `[ball]`, and whether it stands on the surface.
pub fn ball(section: &Section<'_>) -> (Option<MirrorBall>, bool) {
    let centre = section.need("centre", &format!("three numbers within {PLACES}, metres"), place);
    let radius = section.need("radius_m", "a number within 0.001..=10", |v| {
        super::number(v).filter(|r| (0.001..=10.0).contains(r))
    });
    let reflectance = section.color("reflectance_rgb", 1.0).unwrap_or([1.0; 3]);
    if reflectance.iter().any(|&r| r <= 0.0) {
        section.refuse("reflectance_rgb", "three numbers above 0, at most 1");
    }
    let surface_radius_m = section.number("surface_radius_m", 0.001, 100.0);
    let on_surface = section.switch("on_surface", true);
    section.finish();
    let ball = centre.zip(radius).map(|(centre_world, radius_m)| MirrorBall {
        surface_radius_m,
        centre_world,
        radius_m,
        reflectance_rgb: reflectance,
    });
    (ball, on_surface)
}

/// `[[tag]]`
pub fn tag(section: &Section<'_>) -> Option<TagPlacement> {
    let id =
        section.need("id", "an integer within 0..=586", |v| v.as_integer().filter(|n| (0..=586).contains(n)));
    let side = section.need("side_m", "a number within 0.001..=10", |v| {
        super::number(v).filter(|s| (0.001..=10.0).contains(s))
    });
    let rows = section.read("world_from_tag", RIGID, rigid_rows);
    let position = section.point("position").unwrap_or(DVec3::ZERO);
    let yaw_deg = section.number("yaw_deg", -360.0, 360.0).unwrap_or(0.0);
    section.finish();
    // Lying flat: x right stays x, y down in the tag's picture is -y of the world, z into the tag is -z.
    let flat = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z));
    let lying = Pose::new(DQuat::from_rotation_z(yaw_deg.to_radians()) * flat, position);
    Some(TagPlacement { id: u32::try_from(id?).ok()?, side_m: side?, world_from_tag: rows.unwrap_or(lying) })
}
