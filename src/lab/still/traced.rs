//! What is traced for a still of `halflight render`: the same camera, the same light, the same things.

use super::Still;
use crate::assets::{
    error::AssetError,
    scene::{LightSource, SceneFile},
};
use crate::light::{below::BelowHorizon, maps::MapAxes, prefilter::Prefilter};
use crate::math::sphere;
use crate::model::{
    environment::{EnvironmentPicture, OctahedralMap},
    image::{Image, RadianceImage},
    light::{EnvironmentMap, MapLayout, RadianceSamples},
    quality::Quality,
};
use crate::nearfield::prepare::KnownRoom;
use crate::open_exr::{load_radiance, stated_axes};
use crate::reference::{Emission, Environment, TraceBody, TraceScene, TraceSun};
use glam::{DMat3, Mat3, Vec3};

/// Texels a side of an environment picture that is not equirectangular, before it is made so.
const OCTAHEDRAL_SIDE: usize = 1024;
/// Rows of a picture of uniform light, where light from below the horizon differs.
const UNIFORM_ROWS: usize = 256;

/// Where a still's light comes from.
#[derive(Clone, Copy, Debug)]
pub enum LightOf<'a> {
    /// A scene file, which says it.
    File(&'a SceneFile),
    /// A moment of a recording: as it was measured, `Still::samples`.
    Samples,
}

/// The scene of a still; `still` is what `of_scene` made of the file, or a moment of a recording. Objects are where they are
/// at the still's time. Real surfaces of unknown albedo have `reference::UNKNOWN_ALBEDO`, and objects get from them what the
/// environment shows in their direction, as in the product. `quality` has the norm of Phong lobes.
///
/// # Errors
/// An environment picture that cannot be loaded.
pub fn of_still(file: LightOf<'_>, still: &Still, quality: &Quality) -> Result<TraceScene, AssetError> {
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

fn light(file: &SceneFile, samples: &RadianceSamples, scene: &mut TraceScene) -> Result<(), AssetError> {
    match &file.light {
        LightSource::Unstated => {}
        LightSource::Stated { constant_rgb, direct } => {
            scene.environment = match file.light_below {
                BelowHorizon::AsGiven => Environment::Constant(*constant_rgb),
                _ => Environment::Picture {
                    radiance: Image::filled(2 * UNIFORM_ROWS, UNIFORM_ROWS, *constant_rgb),
                    map_from_world: Mat3::IDENTITY,
                },
            };
            scene.suns.extend(direct.map(|(to_light, irradiance_rgb)| TraceSun {
                to_light_world: Vec3::from(to_light),
                irradiance_rgb,
            }));
        }
        LightSource::Ball(_) => scene.environment = measured(samples),
        LightSource::File { file, layout, y_up, rotation_deg } => {
            let radiance = load_radiance(file)?.hdr.radiance;
            let axes = stated_axes(file)?.unwrap_or(MapAxes::of_up(*y_up, *layout));
            let world_from_map: DMat3 = axes.world_from_map(rotation_deg.to_radians());
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
    put_below(file, &mut scene.environment);
    Ok(())
}

/// What the file says of light from below the horizon, put into the picture of the environment.
fn put_below(file: &SceneFile, environment: &mut Environment) {
    let Environment::Picture { radiance, map_from_world } = environment else { return };
    if file.light_below == BelowHorizon::AsGiven {
        return;
    }
    let (width, height) = (radiance.width(), radiance.height());
    let world_from_map = map_from_world.transpose();
    let directions: Vec<Vec3> = (0..width * height)
        .map(|i| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            world_from_map * sphere::equirect_direction(u / width as f64, v / height as f64).as_vec3()
        })
        .collect();
    let mut samples = RadianceSamples::default();
    let above = radiance.pixels().iter().zip(&directions).enumerate();
    for (i, (rgb, direction)) in above {
        let weight_sr = sphere::equirect_row_solid_angle(width, height, i / width) as f32;
        samples.directions.push(direction.extend(weight_sr).to_array());
        samples.radiance.push([rgb[0], rgb[1], rgb[2], 0.0]);
    }
    let Some(below_rgb) = file.light_below.put(&mut samples) else { return };
    for (pixel, direction) in radiance.pixels_mut().iter_mut().zip(&directions) {
        if direction.z < 0.0 {
            *pixel = below_rgb;
        }
    }
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
