//! `halflight room`: a known room as pictures: what its patches send out and reflect, and what the probe saw of it.

mod panorama;

use super::output::{say, say_digest, write_file};
use super::progress::{Bar, host};
use super::render::is_scene_file;
use super::{CliError, GlobalOptions, run_folder};
use crate::assets::{
    known_room::{ReadyRoom, make_ready_with},
    pictures,
    scene::{self, RoomLightSource, RoomSource},
};
use crate::daemon::{
    cache_folder::{self, cache_folder},
    host::Task,
};
use crate::lab::digest::PixelDigest;
use crate::lab::{case, open_exr::load_radiance};
use crate::model::{image::RadianceImage, light::MapLayout};
use crate::nearfield::{
    faces::Faces,
    prepare::{CameraPicture, KnownRoom, RoomSettings},
};
use glam::Vec3;
use panorama::Panorama;
use serde_json::{Value, json};
use std::{path::PathBuf, time::Instant};

const AFTER_HELP: &str = "\
FILE is a scene file with a [room] section (.toml), a glTF of the room (.glb, .gltf), or a reference case (folder or
case.json). For the last two, options take the place of the section.

The pictures are panoramas of the whole sphere as a visitor sees it from the probe's place (or --from): the middle looks
to +x, left of it is +y. Patch edges are drawn.
  radiance.png     what patches send out, brightest parts compressed
  gathered.png     the light that arrives (irradiance over pi), as the model has it; suns included
  reflectance.png  diffuse reflectance
  known.png        bright: radiance seen by the probe or given; red: filled in; with a blue tint where the camera did not
                   measure reflectance (if there is its picture)
  room.json        patches, sources, what is left out at most, memory, time, suns

Example: halflight room room.glb --probe room.hdr --at 0,0,0.4 --patch 0.2 --out room/";

/// What a run leaves in its folder.
const LEFT: [&str; 5] = ["radiance.png", "gathered.png", "reflectance.png", "known.png", "room.json"];

/// Arguments of `halflight room`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct RoomArguments {
    /// Scene file, glTF, or reference case.
    pub file: PathBuf,
    /// Folder for pictures and report; made if need be.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// An environment picture taken in the room: its light.
    #[arg(long, value_name = "FILE", requires = "at")]
    pub probe: Option<PathBuf>,
    /// Where the probe was taken, metres.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "probe")]
    pub at: Option<String>,
    /// How the probe's picture covers the sphere.
    #[arg(long, value_enum, default_value = "equirect")]
    pub layout: LayoutChoice,
    /// The probe's up is +y, not +z.
    #[arg(long)]
    pub y_up: bool,
    /// Keep small strong lights in the patches that they are seen through.
    #[arg(long)]
    pub no_sun: bool,
    /// Mean size of a patch, metres (default: 1500 patches).
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    pub patch: Option<f32>,
    /// Share of the power of all patches that the sources of shadows have (default 0.7).
    #[arg(long, value_name = "SHARE", allow_hyphen_values = true)]
    pub power_share: Option<f32>,
    /// Rays from each corner to each source: 1, 4, 9, .. 64 (default 1).
    #[arg(long, value_name = "N")]
    pub rays: Option<u32>,
    /// Picture of a reference case from which reflectance is measured, e.g. noobj.
    #[arg(long, value_name = "NAME")]
    pub picture: Option<String>,
    /// Where the panoramas are seen from, metres (default: the probe's place, else the middle of the room).
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<String>,
    /// Find everything anew although the user's cache folder ($XDG_CACHE_HOME/halflight or ~/.cache/halflight) knows the room,
    /// and keep nothing.
    #[arg(long)]
    pub fresh: bool,
    /// Rows of the panoramas, 64 to 4096.
    #[arg(long, value_name = "PIXELS", default_value_t = 512)]
    pub rows: usize,
}

/// How an environment picture covers the sphere.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutChoice {
    /// 2:1, z up.
    Equirect,
    /// Debevec's.
    Angular,
    /// Six faces one under the other.
    Cube,
}

/// Runs `halflight room`.
///
/// # Errors
/// A mistake in the arguments; a room that cannot be read or prepared; a file that cannot be written.
pub fn run(arguments: RoomArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if !(64..=4096).contains(&arguments.rows) {
        return Err(CliError::on("--rows", format!("must be within 64..=4096, was {}", arguments.rows)));
    }
    let source = source_of(&arguments)?;
    run_folder::check(&arguments.out, &LEFT)?;
    let photograph = photograph_of(&arguments)?;
    let camera = photograph.as_ref().map(|(radiance, lens, pose)| CameraPicture {
        radiance,
        lens: *lens,
        world_from_camera: *pose,
    });
    let begun = Instant::now();
    let bar = Bar::of_share("the room");
    let cache = if arguments.fresh { None } else { cache_folder() };
    let progress = |share: f32| bar.reach(share);
    let ready = make_ready_with(&source, camera.as_ref(), cache.as_deref(), host().readers, &progress)?;
    drop(bar);
    cache_folder::tidy();
    let seconds = begun.elapsed().as_secs_f64();
    let from = match (&arguments.from, &source.light) {
        (Some(text), _) => point(text, "--from")?,
        (None, RoomLightSource::Probe { position_world, .. }) => *position_world,
        (None, RoomLightSource::Given) => middle(&ready.known),
    };
    run_folder::begin(&arguments.out, "room", &LEFT)?;
    let digest = draw(&arguments, &ready.known, from, camera.is_some())?;
    let text = serde_json::to_string_pretty(&report(&ready, seconds))?;
    write_file(&arguments.out.join("room.json"), &text)?;
    say(&if global.json { text } else { table(&ready, seconds) })?;
    if global.digest {
        say_digest(&digest, global.json)?;
    }
    Ok(())
}

/// Writes the panoramas; returns the digest of all.
fn draw(
    arguments: &RoomArguments,
    known: &KnownRoom,
    from: Vec3,
    has_camera: bool,
) -> Result<String, CliError> {
    let bar = Bar::of_count(Some(4), "pictures");
    let view = Panorama::new(known, from, arguments.rows);
    let mut digest = PixelDigest::default();
    let names = ["radiance", "gathered", "reflectance", "known"];
    for (name, drawn) in names.into_iter().zip(view.draw(known, has_camera)) {
        pictures::save_png(&arguments.out.join(format!("{name}.png")), &drawn)?;
        digest.add_bytes(drawn.pixels());
        bar.add_one();
    }
    Ok(digest.hex())
}

fn source_of(arguments: &RoomArguments) -> Result<RoomSource, CliError> {
    if is_scene_file(&arguments.file) {
        let scene = scene::load(&arguments.file)?;
        return scene
            .room
            .ok_or_else(|| CliError::on(arguments.file.display(), "room: must be given ([room] with file)"));
    }
    let mut settings = RoomSettings { patch_m: arguments.patch, ..RoomSettings::default() };
    if let Some(share) = arguments.power_share {
        settings.preparation.power_share = share;
    }
    if let Some(rays) = arguments.rays {
        let side = (1..=8u32).find(|side| side * side == rays);
        let why = || CliError::on("--rays", format!("must be 1, 4, 9, 16, 25, 36, 49 or 64, was {rays}"));
        settings.preparation.rays_side = side.ok_or_else(why)?;
    }
    let light = match (&arguments.probe, &arguments.at) {
        (Some(file), Some(at)) => RoomLightSource::Probe {
            file: file.clone(),
            layout: match arguments.layout {
                LayoutChoice::Equirect => MapLayout::Equirect,
                LayoutChoice::Angular => MapLayout::Angular,
                LayoutChoice::Cube => MapLayout::Cube,
            },
            y_up: arguments.y_up,
            rotation_deg: 0.0,
            position_world: point(at, "--at")?,
            factor_sun: !arguments.no_sun,
            rows: None,
        },
        _ => RoomLightSource::Given,
    };
    Ok(RoomSource { file: arguments.file.clone(), light, settings })
}

type Photograph = (RadianceImage, crate::math::lens::Lens, crate::math::pose::Pose);

/// The picture that reflectance is measured from: a scene camera's only picture where that is HDR, or a case's.
fn photograph_of(arguments: &RoomArguments) -> Result<Option<Photograph>, CliError> {
    if is_scene_file(&arguments.file) {
        let scene = scene::load(&arguments.file)?;
        let Some(camera) = scene.camera else { return Ok(None) };
        let is_hdr = |file: &PathBuf| file.extension().is_some_and(|e| e == "hdr" || e == "exr");
        return match &camera.pictures.files[..] {
            [file] if is_hdr(file) => {
                let radiance = load_radiance(file)?.hdr.radiance;
                Ok(Some((radiance, camera.lens, camera.world_from_camera)))
            }
            _ => Ok(None),
        };
    }
    let Some(name) = &arguments.picture else { return Ok(None) };
    let case = case::load(&arguments.file)?;
    let file = &case.image(name)?.file;
    let radiance = load_radiance(file)?.hdr.radiance;
    Ok(Some((radiance, case.lens, case.world_from_camera)))
}

fn point(text: &str, option: &str) -> Result<Vec3, CliError> {
    let numbers: Vec<f32> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 && x.is_finite() && y.is_finite() && z.is_finite() => {
            Ok(Vec3::new(x, y, z))
        }
        _ => Err(CliError::on(option, format!("must be three numbers in metres: X,Y,Z, was {text:?}"))),
    }
}

fn middle(known: &KnownRoom) -> Vec3 {
    let places = known.field.patches.vertices.iter().map(|v| v.position_world);
    let (low, high) = places.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let middle = low.midpoint(high);
    // Not inside of a table: up from it until fronts are met below.
    let faces = Faces::of_room(&known.room);
    let steps = (0..8).map(|k| middle.with_z(middle.z + (high.z - middle.z) * k as f32 / 8.0));
    let is_open =
        |p: &Vec3| [Vec3::NEG_Z, Vec3::Z].iter().all(|d| faces.first(*p, *d).is_none_or(|m| m.is_front));
    steps.clone().find(is_open).unwrap_or(middle)
}

fn report(ready: &ReadyRoom, seconds: f64) -> Value {
    let (known, field) = (&ready.known, ready.known.field.report());
    let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
    let suns: Vec<Value> = known
        .suns
        .iter()
        .map(|sun| {
            let names = sun.apertures.iter().filter_map(|&i| known.room.surfaces.get(i as usize));
            json!({
                "to_light_world": sun.to_light_world,
                "irradiance_rgb": sun.irradiance_rgb,
                "extent_rad": sun.extent_rad,
                "apertures": names.map(|s| s.name.as_str()).collect::<Vec<_>>(),
            })
        })
        .collect();
    let probe = known.report.probe.as_ref().map(|p| {
        json!({
            "seen_patches": p.seen_patches, "filled_patches": p.filled_patches,
            "fronts_share": p.fronts, "backs_share": p.backs, "nothing_share": p.nothing,
            "flux_rgb": p.flux_rgb, "sun_flux_rgb": p.sun_flux_rgb, "patch_flux_rgb": p.patch_flux_rgb,
            "damaged_texels": p.damaged_texels,
        })
    });
    let reflectance = known.report.reflectance.map(|r| {
        json!({
            "pixels": r.pixels, "measured_patches": r.measured, "bounded_patches": r.bounded,
            "like_their_surface": r.like_surface, "as_given": r.as_given,
        })
    });
    json!({
        "format": super::JSON_FORMAT,
        "seconds": seconds,
        "from_cache": ready.from_cache,
        "area_m2": known.report.area_m2,
        "patches": field.patches,
        "patches_wanted": known.report.patches_wanted,
        "vertices": field.vertices,
        "dropped_faces": field.dropped_faces,
        "receivers": field.receivers,
        "unlit_receivers": field.unlit_receivers,
        "sources": field.sources,
        "sources_left_out": field.sources_left_out,
        "power_share": field.power_share,
        "lost_mean": field.lost_mean,
        "lost_worst": field.lost_worst,
        "neglected_worst": field.neglected_worst,
        "shafts": field.shafts,
        "leaf_shafts": field.leaf_shafts,
        "shaft_mib": mib(field.shaft_bytes),
        "transfer_mib": mib(field.transfer_bytes),
        "open_edges": ready.soundness.open_edges,
        "open_edges_m": ready.soundness.open_m,
        "outward_share": ready.soundness.outward_share,
        "faces_without_area": ready.soundness.without_area,
        "notes": ready.notes,
        "suns": suns,
        "probe": probe,
        "reflectance": reflectance,
    })
}

fn table(ready: &ReadyRoom, seconds: f64) -> String {
    let (known, field) = (&ready.known, ready.known.field.report());
    let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
    let mut lines = format!(
        "{} patches ({} corners) of {:.1} m2, {} of them receivers\n\
         {} sources with {:.1} % of the power; {} more shine: they send {:.1} % of the light in the mean, {:.1} % at worst\n\
         shafts {:.2} MiB, transfers {:.2} MiB, ready after {seconds:.2} s{}",
        field.patches,
        field.vertices,
        known.report.area_m2,
        field.receivers,
        field.sources,
        100.0 * field.power_share,
        field.sources_left_out,
        100.0 * field.lost_mean,
        100.0 * field.lost_worst,
        mib(field.shaft_bytes),
        mib(field.transfer_bytes),
        if ready.from_cache { ", its light from the cache" } else { "" },
    );
    if let Some(probe) = &known.report.probe {
        lines += &format!(
            "\nthe probe saw {} patches; {} were filled in",
            probe.seen_patches, probe.filled_patches
        );
    }
    if let Some(r) = known.report.reflectance {
        lines += &format!(
            "\nreflectance of {} patches measured, {} like the rest of their surface, {} as given",
            r.measured, r.like_surface, r.as_given
        );
    }
    for sun in &known.suns {
        let names: Vec<&str> = sun
            .apertures
            .iter()
            .filter_map(|&i| known.room.surfaces.get(i as usize))
            .map(|s| s.name.as_str())
            .collect();
        let [x, y, z] = sun.to_light_world;
        let [r, g, b] = sun.irradiance_rgb;
        lines += &format!(
            "\na sun towards {x:.3}, {y:.3}, {z:.3}, irradiance {r:.4}, {g:.4}, {b:.4}, through {}",
            if names.is_empty() { "an opening".to_owned() } else { names.join(", ") }
        );
    }
    for note in &ready.notes {
        lines += &format!("\nnote: {note}");
    }
    lines
}
