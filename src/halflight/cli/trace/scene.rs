//! What is traced for a still of `halflight render`: the same camera, the same light, the same things.

use crate::assets::{
    pictures,
    scene::{LightSource, SceneFile},
};
use crate::cli::{CliError, render::Still};
use crate::light::{maps::MapAxes, prefilter::Prefilter};
use crate::math::sphere;
use crate::model::{
    environment::{EnvironmentPicture, OctahedralMap},
    image::RadianceImage,
    light::{EnvironmentMap, MapLayout, RadianceSamples},
};
use crate::nearfield::prepare::KnownRoom;
use crate::reference::{Emission, Environment, TraceBody, TraceScene, TraceSun};
use glam::{DMat3, Mat3, Vec3};

/// Texels a side of an environment picture that is not equirectangular, before it is made so.
const OCTAHEDRAL_SIDE: usize = 1024;

/// Where a still's light comes from.
#[derive(Clone, Copy, Debug)]
pub enum LightOf<'a> {
    /// A scene file, which says it.
    File(&'a SceneFile),
    /// A moment of a recording: as it was measured, `Still::samples`.
    Samples,
}

/// The scene of a still, `still` being what `render::of_scene` made of the file, or a moment of a recording. Objects are at time 0. What is not known
/// of real surfaces: their albedo is `reference::UNKNOWN_ALBEDO`, and objects get from them what the environment shows in
/// their direction, as in the product. `quality` has the norm of Phong lobes.
///
/// # Errors
/// An environment picture that cannot be loaded.
pub fn of_still(
    file: LightOf<'_>,
    still: &Still,
    quality: &crate::model::quality::Quality,
) -> Result<TraceScene, CliError> {
    let mut scene = TraceScene::empty(still.lens, still.world_from_camera);
    scene.phong_norm = quality.phong_norm;
    let posed = still.posed();
    for (object, posed) in still.scene.objects.iter().zip(posed.objects()) {
        scene.objects.push(TraceBody::of_object(object, &posed.positions_world, &posed.normals_world));
    }
    match file {
        LightOf::File(file) => light(file, &still.samples, &mut scene)?,
        LightOf::Samples if still.room.is_some() => {}
        LightOf::Samples => scene.environment = measured(&still.samples),
    }
    let shows_light = matches!(scene.environment, Environment::Picture { .. } | Environment::Constant(_));
    for surface in &still.scene.surfaces {
        let mut body = TraceBody::of_surface(surface);
        if surface.albedo_rgb.is_none() && shows_light {
            body.emission = Emission::Surroundings;
        }
        scene.real.push(body);
    }
    if let Some(known) = &still.room {
        room(known, &mut scene);
    }
    Ok(scene)
}

fn light(file: &SceneFile, samples: &RadianceSamples, scene: &mut TraceScene) -> Result<(), CliError> {
    match &file.light {
        LightSource::Unstated => {}
        LightSource::Stated { constant_rgb, direct } => {
            scene.environment = Environment::Constant(*constant_rgb);
            scene.suns.extend(direct.map(|(to_light, irradiance_rgb)| TraceSun {
                to_light_world: Vec3::from(to_light),
                irradiance_rgb,
            }));
        }
        LightSource::Ball(_) => scene.environment = measured(samples),
        LightSource::File { file, layout, y_up, rotation_deg } => {
            let radiance = pictures::load_radiance(file).map_err(|e| CliError(e.to_string()))?.hdr.radiance;
            let world_from_map: DMat3 =
                MapAxes::of_up(*y_up, *layout).world_from_map(rotation_deg.to_radians());
            scene.environment = if *layout == MapLayout::Equirect {
                Environment::Picture { radiance, map_from_world: world_from_map.transpose().as_mat3() }
            } else {
                let map = EnvironmentMap { layout: *layout, radiance };
                let mut picture = EnvironmentPicture::default();
                Prefilter::default().look_at_map(&map, world_from_map, OCTAHEDRAL_SIDE, &mut picture);
                equirect(&picture.all)
            };
        }
    }
    Ok(())
}

/// Light as it was measured from a ball.
fn measured(samples: &RadianceSamples) -> Environment {
    let mut picture = EnvironmentPicture::default();
    Prefilter::default().see(samples, 1.0, &mut picture);
    equirect(&picture.all)
}

/// The same in equirectangular texels, about as fine.
fn equirect(map: &OctahedralMap) -> Environment {
    let (width, height) = (2 * map.side(), map.side());
    let texels = (0..width * height).map(|i| {
        let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        map.look(sphere::equirect_direction(u / width as f64, v / height as f64).as_vec3())
    });
    let radiance = RadianceImage::from_pixels(width, height, texels.collect()).unwrap_or_default();
    Environment::Picture { radiance, map_from_world: Mat3::IDENTITY }
}

/// A room whose light is given shines by its own faces; one that was measured by its patches, which are all of its light.
fn room(known: &KnownRoom, scene: &mut TraceScene) {
    if known.report.probe.is_none() {
        scene.real.extend(known.room.surfaces.iter().map(TraceBody::of_room_surface));
        return;
    }
    let is_aperture = |surface: u32| known.suns.iter().any(|sun| sun.apertures.contains(&surface));
    let patches = &known.field.patches;
    scene.real.extend(patches.patches.iter().map(|patch| TraceBody {
        is_aperture: is_aperture(patch.surface),
        ..TraceBody::of_patch(patches, patch)
    }));
    scene.suns.extend(known.suns.iter().map(|sun| TraceSun {
        to_light_world: Vec3::from(sun.to_light_world),
        irradiance_rgb: sun.irradiance_rgb,
    }));
}
