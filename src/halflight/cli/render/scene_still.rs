//! The still of a scene file: its pictures merged, its light measured or stated, its objects over it.

use super::still::{Quantity, Still, halve_options};
use crate::animate::posed::Posed;
use crate::assets::{
    pictures, response,
    scene::{LightSource, Pictures, SceneCamera, SceneFile},
};
use crate::cli::progress::host;
use crate::cli::{CliError, bracket::steady};
use crate::daemon::{blocker_spheres, known_room, vertex_transfer};
use crate::engine::{Bracket, Engine, LightJob};
use crate::hdr::response::{Origin, SolveOptions, solve};
use crate::light::unwrap_ball::BallShot;
use crate::light::{
    halve::{HalveOptions, halve_still, halve_still_with_rest},
    maps::MapAxes,
    prefilter::{Prefilter, Wanted},
};
use crate::math::color::gray;
use crate::math::sh::{MAX_COEFFICIENTS, rotate::Rotation};
use crate::model::{
    environment::EnvironmentPicture,
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    light::{EnvironmentMap, HardLight, Lights, MapLayout, RadianceSamples, RadianceSh},
    picture::PictureView,
    quality::Quality,
    response::Response,
    rig::MirrorBall,
};
use crate::nearfield::{faces::Faces, objects};
use crate::present::gray_place::GrayPlace;
use glam::{DVec3, Vec3};
use std::path::Path;

/// Pictures of one bracket in memory.
struct Loaded {
    pictures: Vec<Rgb8Image>,
    exposures: Vec<Exposure>,
    response: String,
}

/// The still of a scene file. Lines for people (what was measured, what had to be guessed) go to `notes`.
pub fn of_scene(
    file: &SceneFile,
    engine: &mut dyn Engine,
    quality: &Quality,
    notes: &mut Vec<String>,
) -> Result<Still, CliError> {
    let camera = file
        .camera
        .as_ref()
        .ok_or_else(|| CliError(format!("{}: camera: must be given to draw a still", file.file.display())))?;
    let mut place = load(&camera.pictures)?;
    let mut ball = match &file.light {
        LightSource::Ball(pictures) => {
            let loaded = load(pictures)?.ok_or_else(|| {
                CliError(format!("{}: light.pictures: must name pictures of the ball", file.file.display()))
            })?;
            Some(loaded)
        }
        _ => None,
    };
    let response = choose_response(place.as_ref(), ball.as_ref(), notes)?;
    let mut moved = Vec::new();
    for loaded in [&mut place, &mut ball].into_iter().flatten() {
        moved.extend(steady(&mut loaded.pictures, &loaded.exposures, &response));
    }
    let response = match moved.is_empty() {
        true => response,
        false => choose_response(place.as_ref(), ball.as_ref(), &mut Vec::new())?,
    };
    notes.extend(moved);
    let photographed = match &place {
        Some(loaded) => Some(merge(loaded, &response, engine)?),
        None => None,
    };
    let total = match &file.light {
        LightSource::Unstated if file.room.is_some() => None,
        LightSource::Unstated => {
            return Err(CliError(format!(
                "{}: light: must be measured or stated to draw a still",
                file.file.display()
            )));
        }
        LightSource::Stated { .. } => None,
        LightSource::Ball(_) => {
            let place = photographed.as_ref();
            Some(read_ball(file, camera, ball.as_ref(), place, &response, engine, quality, notes)?)
        }
        LightSource::File { file, layout, y_up, rotation_deg } => {
            Some(read_map(file, *layout, *y_up, *rotation_deg, engine, quality)?)
        }
    };
    let mut environment = None;
    let light = match (&total, &file.light) {
        (Some((total, samples)), _) => {
            let options = halve_options(quality, above_horizon(file));
            let (light, left) = halve_still_with_rest(samples, total, options);
            let wanted = Wanted::by(&file.scene, quality.sh_order);
            if wanted.picture {
                let picture = environment.insert(EnvironmentPicture::default());
                let mut work = Prefilter::default();
                work.see(samples, 1.0, picture);
                if wanted.glossy {
                    work.levels(left.as_ref(), picture);
                }
            }
            if options.dering {
                let plain = halve_still(samples, total, HalveOptions { dering: false, ..options });
                notes.push(dering_note(&plain.global, &light.global));
            }
            light
        }
        (None, LightSource::Stated { constant_rgb, direct }) => {
            let mut global = RadianceSh::zero(quality.sh_order);
            global.rgb[0] = constant_rgb.map(|c| c * (4.0 * std::f32::consts::PI).sqrt());
            let mut lights = Lights::soft(global);
            if let &Some((to_light_world, irradiance_rgb)) = direct {
                lights.hard.push(HardLight { to_light_world, irradiance_rgb, extent_rad: 0.0 });
            }
            lights
        }
        (None, _) => Lights::soft(RadianceSh::zero(quality.sh_order)),
    };
    for compact in light.compact.iter().flatten() {
        let [x, y, z] = compact.to_light_world;
        let [r, g, b] = compact.flux_rgb;
        let extent = compact.extent_rad.to_degrees();
        notes.push(format!("light from ({x:.3}, {y:.3}, {z:.3}), flux ({r:.4}, {g:.4}, {b:.4}), {extent:.1} degrees wide (rms)"));
    }
    notes.push(format!(
        "{} hard lights, the rest in SH of order {}",
        light.hard.as_slice().len(),
        light.global.order
    ));
    let mut scene = file.scene.clone();
    let room = known_room::of_scene(file, &mut scene, &host()).map_err(|e| CliError(e.to_string()))?;
    let light = match &room {
        Some(room) => objects::lights_at(room, &Faces::of_room(&room.room), middle_of(&Posed::new(&scene))),
        None => light,
    };
    blocker_spheres::fit(&mut scene, quality.spheres, host().progress);
    vertex_transfer::bake(&mut scene, quality, host().progress);
    let exposure_s = place.as_ref().and_then(|loaded| loaded.exposures.first()).map(|e| e.effective_s());
    let background = match photographed {
        Some(picture) => picture,
        None => {
            let mut gray = HdrImage::default();
            let (surfaces, pose) = (&file.scene.surfaces, &camera.world_from_camera);
            GrayPlace::default().draw(surfaces, &camera.lens, pose, &light, &mut gray);
            gray
        }
    };
    Ok(Still {
        scene,
        lens: camera.lens,
        world_from_camera: camera.world_from_camera,
        light,
        environment,
        background,
        response,
        exposure_s,
        quantity: Quantity::Radiance,
        room,
        view: PictureView::Final,
        time_s: 0.0,
        samples: total.map_or_else(RadianceSamples::default, |(_, samples)| samples),
    })
}

/// Whether only light from above the horizon of a scene counts as hard.
pub(in crate::cli) fn above_horizon(file: &SceneFile) -> bool {
    matches!(file.light, LightSource::Ball(_)) && file.ball_on_surface || faces_up(&file.scene)
}

/// The middle of all virtual objects.
pub(in crate::cli) fn middle_of(posed: &Posed) -> Vec3 {
    let points = posed.objects().iter().flat_map(|o| &o.positions_world).filter(|p| p.is_finite());
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = points.fold(start, |(low, high), p| (low.min(*p), high.max(*p)));
    if low.is_finite() { low.midpoint(high) } else { Vec3::ZERO }
}

/// What de-ringing cost, for people.
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

fn load(pictures: &Pictures) -> Result<Option<Loaded>, CliError> {
    if pictures.files.is_empty() {
        return Ok(None);
    }
    let files = pictures.files.iter().map(|f| pictures::load_rgb8(f).map_err(|e| CliError(e.to_string())));
    let exposures = pictures.exposures_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 });
    Ok(Some(Loaded {
        pictures: files.collect::<Result<_, _>>()?,
        exposures: exposures.collect(),
        response: pictures.response.clone(),
    }))
}

/// One camera has one response: that of the bracket with more pictures serves both.
fn choose_response(
    place: Option<&Loaded>,
    ball: Option<&Loaded>,
    notes: &mut Vec<String>,
) -> Result<Response, CliError> {
    let brackets = [ball, place];
    let Some(best) = brackets.into_iter().flatten().max_by_key(|l| l.pictures.len()) else {
        return Ok(Response::srgb());
    };
    match best.response.as_str() {
        "srgb" => Ok(Response::srgb()),
        "solve" => {
            let pictures: Vec<&Rgb8Image> = best.pictures.iter().collect();
            let solved = solve(&pictures, &best.exposures, &SolveOptions::default());
            notes.push(match solved.origin {
                Origin::Solved { residual_rms } => {
                    format!(
                        "response solved from {} pictures, rms {residual_rms:.3} in ln exposure",
                        pictures.len()
                    )
                }
                Origin::Fallback { why } => format!("response not solved ({why}); sRGB stands in"),
            });
            Ok(solved.response)
        }
        file => response::load(Path::new(file)).map_err(|e| CliError(e.to_string())),
    }
}

fn merge(loaded: &Loaded, response: &Response, engine: &mut dyn Engine) -> Result<HdrImage, CliError> {
    let pictures: Vec<&Rgb8Image> = loaded.pictures.iter().collect();
    let bracket = Bracket { pictures: &pictures, exposures: &loaded.exposures };
    let mut out = HdrImage::default();
    engine.merge_bracket(&bracket, response, &mut out).map_err(|e| CliError(e.to_string()))?;
    Ok(out)
}

#[expect(clippy::too_many_arguments, reason = "the parts of one measurement, all needed")]
fn read_ball(
    file: &SceneFile,
    camera: &SceneCamera,
    loaded: Option<&Loaded>,
    place: Option<&HdrImage>,
    response: &Response,
    engine: &mut dyn Engine,
    quality: &Quality,
    notes: &mut Vec<String>,
) -> Result<(RadianceSh, RadianceSamples), CliError> {
    let (Some(ball), Some(loaded)) = (&file.ball, loaded) else {
        return Err(CliError(format!(
            "{}: ball: must be given to measure the light on it",
            file.file.display()
        )));
    };
    let picture = merge(loaded, response, engine)?;
    let without_ball = place.filter(|place| lacks_ball(place, &picture, camera, ball));
    if without_ball.is_some() {
        notes.push(
            "the camera's own pictures show the place without the ball: its shadows are read against them"
                .into(),
        );
    }
    let job = LightJob::Ball(BallShot {
        picture: &picture,
        lens: &camera.lens,
        world_from_camera: &camera.world_from_camera,
        ball,
        on_surface: file.ball_on_surface,
        without_ball,
    });
    let measured = engine.estimate_light(&job, quality).map_err(|e| CliError(e.to_string()))?;
    let flags = measured.flags;
    notes.push(format!(
        "light read from the ball: {} samples, {} saturated, {:.1} % of the sphere filled",
        flags.texels,
        flags.saturated_texels,
        100.0 * flags.filled_share
    ));
    Ok((measured.total, engine.measured_samples().clone()))
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
        let (radius, turn) = (0.9 * ball.radius_m * (f64::from(k) / 400.0).sqrt(), 2.399_963 * f64::from(k));
        let (right, down) = centre.normalize_or(DVec3::Z).any_orthonormal_pair();
        let at = centre + (right * turn.cos() + down * turn.sin()) * radius;
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

fn read_map(
    file: &Path,
    layout: MapLayout,
    y_up: bool,
    rotation_deg: f64,
    engine: &mut dyn Engine,
    quality: &Quality,
) -> Result<(RadianceSh, RadianceSamples), CliError> {
    let radiance = pictures::load_radiance(file).map_err(|e| CliError(e.to_string()))?.hdr.radiance;
    let job = EnvironmentMap { layout, radiance };
    let measured =
        engine.estimate_light(&LightJob::Map(&job), quality).map_err(|e| CliError(e.to_string()))?;
    let world_from_map = MapAxes::of_up(y_up, layout).world_from_map(rotation_deg.to_radians());
    let order = measured.total.order;
    let rows = world_from_map.transpose().as_mat3().to_cols_array_2d();
    let mut turned = [[0.0f32; 3]; MAX_COEFFICIENTS];
    let count = order * order;
    Rotation::new(order, rows).apply_rows(&measured.total.rgb[..count], &mut turned[..count]);
    let mut samples = engine.measured_samples().clone();
    for d in &mut samples.directions {
        let world = world_from_map.as_mat3() * Vec3::new(d[0], d[1], d[2]);
        *d = world.extend(d[3]).to_array();
    }
    Ok((RadianceSh { order, rgb: turned }, samples))
}

/// Whether every surface that receives shadows faces up: then no light from below the horizon draws one.
fn faces_up(scene: &crate::model::scene::Scene) -> bool {
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
