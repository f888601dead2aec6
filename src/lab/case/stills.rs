//! Stills of reference cases. A case becomes what a scene file becomes, a `Composition`; its light is then halved, and its
//! objects are drawn, by the product's own path. Of the case's own making are only the picture of the place, which the
//! product gets from a camera (`place`), and what an emitter's file means (`emitters`).

use super::{
    Case, CaseEmitter, EmitterKind, ExactShape, GeometryRole,
    emitters::{self, ReadyEmitter},
    place,
};
use crate::HOST;
use crate::assets::error::AssetError;
use crate::daemon::host::Host;
use crate::error::LabError;
use crate::light::below::{BelowHorizon, spread};
use crate::model::{
    light::{HardLight, RadianceSamples},
    quality::{Quality, SplitKind},
    response::Response,
    scene::{Material, Scene},
};
use crate::nearfield::{
    field::Preparation,
    prepare::{KnownRoom, RoomLight, RoomSettings, prepare as prepare_room},
};
use crate::still::{
    Composition, PictureQuantity, Still, faces_up,
    far_light::{FarLight, KnownLight},
};
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// The image that is drawn where none is named: the main picture of the case's family.
///
/// # Errors
/// The case has none of those.
pub fn default_image(case: &Case) -> Result<String, LabError> {
    ["beauty", "with", "obj_table", "hdr"]
        .iter()
        .find(|&&name| case.images.iter().any(|i| i.name == name))
        .map(|name| (*name).to_string())
        .ok_or_else(|| LabError::on(case.file.display(), "has no main picture: name one with --image"))
}

/// The still of one image of a case.
///
/// # Errors
/// As of [`CaseStills::new`].
pub fn of_case(case: &Case, image: &str, quality: &Quality) -> Result<Still, LabError> {
    Ok(CaseStills::new(case, image)?.still(quality, &HOST))
}

/// What all stills of one image of a case share, whatever their settings.
pub struct CaseStills {
    composition: Composition,
    /// Albedo of the plane z = 0 that everything stands on, where there is one.
    plane_albedo_rgb: Option<[f32; 3]>,
}

impl CaseStills {
    /// Of an image of a case, which must be a picture.
    ///
    /// # Errors
    /// There is no such image, or it is a mask; a file of the case that cannot be read; emitters that cannot be drawn
    /// together.
    pub fn new(case: &Case, image: &str) -> Result<Self, LabError> {
        if case.image(image)?.is_mask() {
            return Err(is_a_mask(case, image));
        }
        let mut scene = case.scene(Some(image))?;
        let emitters = case.emitters(Some(image))?;
        let shining = emitters::ready(case, &emitters)?;
        let background = place::shade(case, &scene, &shining);
        let room = known_room(case, &emitters, &mut scene)?;
        let far = match room {
            Some(_) => FarLight::dark(),
            None => FarLight { above_horizon: faces_up(&scene), ..far_light(case, &scene, shining)? },
        };
        let quantity = match image {
            "ratio" => PictureQuantity::Ratio,
            _ if image.starts_with("diff_") => PictureQuantity::Difference,
            _ => PictureQuantity::Radiance,
        };
        let composition = Composition {
            scene,
            lens: case.lens,
            world_from_camera: case.world_from_camera,
            far,
            room,
            background,
            response: Response::srgb(),
            exposure_s: None,
            quantity,
            time_s: 0.0,
        };
        Ok(Self { composition, plane_albedo_rgb: plane_albedo_rgb(case) })
    }

    /// The still with these settings. Nothing shines from below the plane of a case, and the reference has direct light
    /// alone, so that there it is dark; net flux is that through the plane, which sends light back up.
    pub fn still(&self, quality: &Quality, host: &Host<'_>) -> Still {
        let by_net_flux = matches!(quality.split, SplitKind::Paper | SplitKind::Bounded);
        let below = match self.plane_albedo_rgb {
            None => BelowHorizon::AsGiven,
            Some(albedo_rgb) if by_net_flux => BelowHorizon::Surface { albedo_rgb },
            Some(_) => BelowHorizon::Dark,
        };
        let mut composition = self.composition.clone();
        composition.far.below = below;
        composition.still(quality, host)
    }
}

/// What is said where a picture is asked for and a mask is named.
pub fn is_a_mask(case: &Case, image: &str) -> LabError {
    let file = case.file.display();
    LabError::Asked(format!("--image = {image}: is a mask; must be one of the pictures of {file}"))
}

fn plane_albedo_rgb(case: &Case) -> Option<[f32; 3]> {
    let is_plane = |shape: &ExactShape| matches!(shape, ExactShape::PlaneZ0 { .. });
    let plane = case.geometry.iter().find(|g| g.role == GeometryRole::Receiver && is_plane(&g.shape))?;
    Some(match plane.material {
        Material::Lambert { albedo_rgb } | Material::Phong { albedo_rgb, .. } => albedo_rgb,
        Material::Mirror { .. } => [0.0; 3],
    })
}

/// The light of a case's objects as distant light. Flat emitters are taken as seen from the middle of the objects'
/// vertices.
fn far_light(case: &Case, scene: &Scene, shining: Vec<ReadyEmitter>) -> Result<FarLight, AssetError> {
    let mut far = FarLight::dark();
    let (mut around, mut near) = (Vec::new(), RadianceSamples::default());
    let centre = centre_of(scene);
    for emitter in shining {
        match emitter {
            ReadyEmitter::Environment(samples, map) => {
                around.push(KnownLight::Picture { samples, total: None, map: Some((map, DMat3::IDENTITY)) })
            }
            ReadyEmitter::Constant(radiance_rgb) => {
                around.push(KnownLight::Uniform(radiance_rgb.map(|c| c as f32)));
            }
            ReadyEmitter::Directional { to_light, irradiance_rgb } => far.direct.push(HardLight {
                to_light_world: to_light.as_vec3().to_array(),
                irradiance_rgb: irradiance_rgb.map(|e| e as f32),
                extent_rad: 0.0,
            }),
            flat @ ReadyEmitter::Patch { .. } => flat.seen_from(centre, &mut near),
        }
    }
    if !near.directions.is_empty() {
        // It is dark beside them.
        spread(&mut near, |_| Some([0.0; 3]));
        around.push(KnownLight::Picture { samples: near, total: None, map: None });
    }
    if around.len() > 1 {
        return Err(AssetError::new(&case.file, "emitters")
            .allowed("one environment, one constant sky, or flat emitters; not several of these together"));
    }
    if let Some(known) = around.pop() {
        far.known = known;
    }
    Ok(far)
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

/// The room of a case, where all its emitters are quadrilaterals; the scene then stands in it, and what the room has of the
/// real surfaces is taken out of them.
fn known_room(
    case: &Case,
    emitters: &[&CaseEmitter],
    scene: &mut Scene,
) -> Result<Option<Arc<KnownRoom>>, LabError> {
    let is_room = !emitters.is_empty() && emitters.iter().all(|e| matches!(e.kind, EmitterKind::Quad { .. }));
    if !is_room {
        return Ok(None);
    }
    // Truth has all the light: nothing is left out for speed.
    let preparation = Preparation { power_share: 1.0, ..Preparation::default() };
    let how = RoomSettings { preparation, ..RoomSettings::default() };
    let known = prepare_room(case.room(), &how, RoomLight::Given, None, &|_| ())
        .map_err(|e| LabError::on(case.file.display(), e))?;
    let in_room = |name: &str| {
        case.geometry.iter().any(|g| {
            g.role == GeometryRole::Receiver
                && g.name == name
                && matches!(
                    g.shape,
                    ExactShape::PlaneZ0 { .. } | ExactShape::Quad { .. } | ExactShape::Box { .. }
                )
        })
    };
    scene.surfaces.retain(|surface| !in_room(&surface.name));
    scene.room = Some(Arc::new(known.room.clone()));
    Ok(Some(Arc::new(known)))
}
