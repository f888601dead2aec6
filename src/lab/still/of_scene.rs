//! The still of a scene file: its pictures merged, its light measured or stated, its objects over it.

use super::bracket::LoadedBracket;
use super::far_light::{FarLight, KnownLight};
use super::{Composition, PictureQuantity, Still};
use crate::assets::{
    response,
    scene::{LightSource, Pictures, SceneCamera, SceneFile},
};
use crate::daemon::{host::Host, known_room};
use crate::engine::{Engine, LightJob};
use crate::error::LabError;
use crate::hdr::response::{ResponseOrigin, SolveOptions, solve};
use crate::light::{maps::MapAxes, unwrap_ball::BallShot};
use crate::math::color::gray;
use crate::math::sh::{MAX_COEFFICIENTS, rotate::Rotation};
use crate::math::spiral;
use crate::model::{
    image::HdrImage,
    light::{EnvironmentMap, HardLight, Lights, RadianceSh},
    path_text,
    quality::Quality,
    response::Response,
    rig::MirrorBall,
    scene::Scene,
};
use crate::open_exr::{load_radiance, stated_axes};
use crate::present::gray_place::GrayPlace;
use glam::{DVec3, Vec3};

/// The still of a scene file. Lines for people (what was measured, what had to be guessed) go to `notes`.
///
/// # Errors
/// As of [`compose_scene`].
pub fn of_scene(
    file: &SceneFile,
    engine: &mut dyn Engine,
    quality: &Quality,
    host: &Host<'_>,
    notes: &mut Vec<String>,
) -> Result<Still, LabError> {
    let composition = compose_scene(file, engine, quality, host, notes)?;
    let still = composition.still(quality, host);
    if composition.room.is_none() {
        describe_light(&composition.far, &still.light, quality, notes);
    }
    Ok(still)
}

/// What the still of a scene file is composed of. A place of which there is no picture is gray under the light as
/// `quality` halves it.
///
/// # Errors
/// The file has no camera or no light; a picture, response or room that cannot be read; the engine fails.
pub fn compose_scene(
    file: &SceneFile,
    engine: &mut dyn Engine,
    quality: &Quality,
    host: &Host<'_>,
    notes: &mut Vec<String>,
) -> Result<Composition, LabError> {
    let missing = |what: &str| LabError::on(file.file.display(), what);
    let camera = file.camera.as_ref().ok_or_else(|| missing("camera: must be given to draw a still"))?;
    let photographs = ScenePhotographs::read(file, camera, notes)?;
    let place = match &photographs.place {
        Some(bracket) => Some(bracket.merge(&photographs.response, engine)?),
        None => None,
    };
    let mut far = match &file.light {
        LightSource::Unstated if file.room.is_some() => FarLight::dark(),
        LightSource::Unstated => return Err(missing("light: must be measured or stated to draw a still")),
        LightSource::Stated { constant_rgb, direct } => stated(*constant_rgb, *direct),
        LightSource::Ball(_) => {
            let bracket = photographs.ball.as_ref();
            let ball = bracket.map(|b| b.merge(&photographs.response, engine)).transpose()?;
            let seen = ball.as_ref().zip(file.ball.as_ref());
            let (picture, ball) =
                seen.ok_or_else(|| missing("ball: must be given to measure the light on it"))?;
            let shot = BallShot {
                picture,
                lens: &camera.lens,
                world_from_camera: &camera.world_from_camera,
                ball,
                on_surface: file.ball_on_surface,
                without_ball: place.as_ref().filter(|place| lacks_ball(place, picture, camera, ball)),
            };
            measured_on_ball(shot, engine, quality, notes)?
        }
        LightSource::File { .. } => {
            FarLight { known: read_map(&file.light, engine, quality)?, ..FarLight::dark() }
        }
    };
    far.below = file.light_below;
    far.above_horizon =
        matches!(file.light, LightSource::Ball(_)) && file.ball_on_surface || faces_up(&file.scene);
    let mut scene = file.scene.clone();
    let room = known_room::of_scene(file, &mut scene, host)?;
    let mut composition = Composition {
        scene,
        lens: camera.lens,
        world_from_camera: camera.world_from_camera,
        far,
        room,
        background: HdrImage::default(),
        response: photographs.response,
        exposure_s: photographs.place.as_ref().and_then(|b| b.exposures.first()).map(|e| e.effective_s()),
        quantity: PictureQuantity::Radiance,
        time_s: 0.0,
    };
    composition.background = match place {
        Some(picture) => picture,
        None => {
            let (mut gray, light) = (HdrImage::default(), composition.halved(quality).lights);
            let (surfaces, pose) = (&file.scene.surfaces, &camera.world_from_camera);
            GrayPlace::default().draw(surfaces, &camera.lens, pose, &light, &mut gray);
            gray
        }
    };
    Ok(composition)
}

/// Pictures of the place and of the ball, each bracket in one view, and the response of the camera that took both.
struct ScenePhotographs {
    place: Option<LoadedBracket>,
    ball: Option<LoadedBracket>,
    response: Response,
}

impl ScenePhotographs {
    fn read(file: &SceneFile, camera: &SceneCamera, notes: &mut Vec<String>) -> Result<Self, LabError> {
        let mut place = load(&camera.pictures)?;
        let (mut ball, named) = match &file.light {
            LightSource::Ball(pictures) => (load(pictures)?, Some(pictures)),
            _ => (None, None),
        };
        if named.is_some() && ball.is_none() {
            return Err(LabError::on(file.file.display(), "light.pictures: must name pictures of the ball"));
        }
        // One camera has one response: that of the bracket with more pictures serves both.
        let count = |bracket: &Option<LoadedBracket>| bracket.as_ref().map_or(0, |b| b.pictures.len());
        let by_place = count(&place) >= count(&ball);
        let name = if by_place { &camera.pictures } else { named.unwrap_or(&camera.pictures) };
        let best = |place: &Option<LoadedBracket>, ball: &Option<LoadedBracket>, notes: &mut Vec<String>| {
            match if by_place { place } else { ball } {
                Some(bracket) => choose_response(&name.response, bracket, notes),
                None => Ok(Response::srgb()),
            }
        };
        let response = best(&place, &ball, notes)?;
        let mut moved = Vec::new();
        for bracket in [&mut place, &mut ball].into_iter().flatten() {
            moved.extend(bracket.steady(&response));
        }
        let response = match moved.is_empty() {
            true => response,
            false => best(&place, &ball, &mut Vec::new())?,
        };
        notes.extend(moved);
        Ok(Self { place, ball, response })
    }
}

fn load(pictures: &Pictures) -> Result<Option<LoadedBracket>, LabError> {
    if pictures.files.is_empty() {
        return Ok(None);
    }
    let loaded = pictures.files.iter().map(|file| crate::assets::pictures::load_rgb8(file));
    Ok(Some(LoadedBracket::new(loaded.collect::<Result<_, _>>()?, &pictures.exposures_s)))
}

fn choose_response(
    name: &str,
    bracket: &LoadedBracket,
    notes: &mut Vec<String>,
) -> Result<Response, LabError> {
    match name {
        "srgb" => Ok(Response::srgb()),
        "solve" => {
            let solved = solve(&bracket.refs(), &bracket.exposures, &SolveOptions::default());
            notes.push(match solved.origin {
                ResponseOrigin::Solved { residual_rms } => format!(
                    "response solved from {} pictures, rms {residual_rms:.3} in ln exposure",
                    bracket.pictures.len()
                ),
                ResponseOrigin::Fallback { why } => format!("response not solved ({why}); sRGB stands in"),
            });
            Ok(solved.response)
        }
        file => Ok(response::load(&path_text::to_path(file))?),
    }
}

/// Uniform light, and a light that is stated by direction and irradiance.
fn stated(constant_rgb: [f32; 3], direct: Option<([f32; 3], [f32; 3])>) -> FarLight {
    let direct = direct.map(|(to_light_world, irradiance_rgb)| HardLight {
        to_light_world,
        irradiance_rgb,
        extent_rad: 0.0,
    });
    FarLight {
        known: KnownLight::Uniform(constant_rgb),
        direct: direct.into_iter().collect(),
        ..FarLight::dark()
    }
}

fn measured_on_ball(
    shot: BallShot<'_>,
    engine: &mut dyn Engine,
    quality: &Quality,
    notes: &mut Vec<String>,
) -> Result<FarLight, LabError> {
    if shot.without_ball.is_some() {
        notes.push(
            "the camera's own pictures show the place without the ball: its shadows are read against them"
                .into(),
        );
    }
    let measured = engine.estimate_light(&LightJob::Ball(shot), quality)?;
    let flags = measured.flags;
    notes.push(format!(
        "light read from the ball: {} samples, {} saturated, {:.1} % of the sphere filled",
        flags.texels,
        flags.saturated_texels,
        100.0 * flags.filled_share
    ));
    let samples = engine.measured_samples().clone();
    let known = KnownLight::Picture { samples, total: Some(measured.total), map: None };
    Ok(FarLight { known, ..FarLight::dark() })
}

/// An environment picture in the world's axes. Of light from elsewhere: none.
fn read_map(light: &LightSource, engine: &mut dyn Engine, quality: &Quality) -> Result<KnownLight, LabError> {
    let LightSource::File { file, layout, y_up, rotation_deg } = light else {
        return Ok(KnownLight::Uniform([0.0; 3]));
    };
    let map = EnvironmentMap { layout: *layout, radiance: load_radiance(file)?.hdr.radiance };
    let measured = engine.estimate_light(&LightJob::Map(&map), quality)?;
    let axes = stated_axes(file)?.unwrap_or(MapAxes::of_up(*y_up, *layout));
    let world_from_map = axes.world_from_map(rotation_deg.to_radians());
    let order = measured.total.order;
    let rows = world_from_map.transpose().as_mat3().to_cols_array_2d();
    let mut total = RadianceSh::zero(order);
    let count = order * order;
    Rotation::new(order, rows).apply_rows(&measured.total.rgb[..count], &mut total.rgb[..count]);
    let mut samples = engine.measured_samples().clone();
    for d in &mut samples.directions {
        let world = world_from_map.as_mat3() * Vec3::new(d[0], d[1], d[2]);
        *d = world.extend(d[3]).to_array();
    }
    Ok(KnownLight::Picture { samples, total: Some(total), map: Some((map, world_from_map)) })
}

/// Lines for people about the light that objects are drawn in.
fn describe_light(far: &FarLight, light: &Lights, quality: &Quality, notes: &mut Vec<String>) {
    if quality.dering
        && let Some(plain) = far.plain_soft_half(quality)
    {
        notes.push(dering_note(&plain, &light.global));
    }
    for compact in light.compact.iter().flatten() {
        let [x, y, z] = compact.to_light_world;
        let [r, g, b] = compact.flux_rgb;
        let extent = compact.extent_rad.to_degrees();
        notes.push(format!(
            "light from ({x:.3}, {y:.3}, {z:.3}), flux ({r:.4}, {g:.4}, {b:.4}), {extent:.1} degrees wide (rms)"
        ));
    }
    notes.push(format!(
        "{} hard lights, the rest in SH of order {}",
        light.hard.as_slice().len(),
        light.global.order
    ));
}

/// What de-ringing costs, for people.
fn dering_note(plain: &RadianceSh, damped: &RadianceSh) -> String {
    let errors: [f64; 3] = std::array::from_fn(|c| {
        let sum =
            |f: &dyn Fn(usize) -> f32| (0..MAX_COEFFICIENTS).map(|i| f64::from(f(i)).powi(2)).sum::<f64>();
        let whole = sum(&|i| plain.rgb[i][c]);
        if whole > 0.0 { (sum(&|i| plain.rgb[i][c] - damped.rgb[i][c]) / whole).sqrt() } else { 0.0 }
    });
    if errors == [0.0; 3] {
        return "de-ringing: the soft half is nowhere negative on a surface, nothing is damped".into();
    }
    let [r, g, b] = errors.map(|e| 100.0 * e);
    format!("de-ringing takes {r:.2} {g:.2} {b:.2} % of the soft half (relative L2; r, g, b)")
}

/// Whether the place's picture differs from the ball's where the ball is: then it was taken without the ball. By the
/// median of |ln (brightness / brightness)| over the silhouette's inside.
fn lacks_ball(place: &HdrImage, picture: &HdrImage, camera: &SceneCamera, ball: &MirrorBall) -> bool {
    /// ln 1.2: noise and clouds stay below, a mirror in place of a room does not.
    const LEAST: f32 = 0.18;
    let (a, b) = (&place.radiance, &picture.radiance);
    if (a.width(), a.height()) != (b.width(), b.height()) {
        return false;
    }
    let camera_from_world = camera.world_from_camera.inverse();
    let centre = camera_from_world.transform(ball.centre_world);
    let mut differences = Vec::new();
    for k in 0..400 {
        // A sunflower on the disc through the centre that faces the camera, inside 0.9 of the radius.
        let radius = 0.9 * ball.radius_m * (k as f64 / 400.0).sqrt();
        let turn = spiral::turn(k);
        let (right, down) = centre.normalize_or(DVec3::Z).any_orthonormal_pair();
        let at = centre + (right * turn.x + down * turn.y) * radius;
        let Some(px) = camera.lens.project(at) else { continue };
        if px.x >= 0.0 && px.y >= 0.0 && (px.x as usize) < a.width() && (px.y as usize) < a.height() {
            let (x, y) = (px.x as usize, px.y as usize);
            let (p, q) = (gray(*a.at(x, y)), gray(*b.at(x, y)));
            if p > 0.0 && q > 0.0 {
                differences.push((p / q).ln().abs());
            }
        }
    }
    differences.sort_unstable_by(f32::total_cmp);
    differences.get(differences.len() / 2).is_some_and(|median| *median > LEAST)
}

/// Whether every surface that receives shadows faces up: then no light from below the horizon draws one.
pub(crate) fn faces_up(scene: &Scene) -> bool {
    let mut receivers = scene.surfaces.iter().filter(|s| s.receives_shadow).peekable();
    receivers.peek().is_some()
        && receivers.all(|surface| {
            surface.mesh.triangles.iter().all(|t| {
                let [Some(a), Some(b), Some(c)] = t.map(|i| surface.mesh.positions.get(i as usize)) else {
                    return true;
                };
                let normal = (*b - *a).cross(*c - *a);
                normal.z >= 0.99 * normal.length()
            })
        })
}
