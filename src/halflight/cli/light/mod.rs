//! `halflight light`: the light of a place, from a picture of it.

mod ball;
mod formats;
mod input;
mod report;

use super::output::PictureFormat;
use super::{CliError, GlobalOptions, run_folder::need_folder_of};
use crate::assets::dds;
use crate::engine::{Engine, MeasuredLight};
use crate::lab::open_exr::load_raw;
use crate::light::{
    cone::cone_of_samples,
    exported::{compact_lights, split_of},
    maps::{self, MapAxes, TexelPoint},
    project_sh::project_sh,
    split::{GRAY_PAPER, GRAY_REC709, SplitOptions, split},
};
use crate::model::{
    estimate::LightFlags,
    light::{
        DirectionalLight, EnvironmentMap, MAX_LIGHTS, MapLayout, RadianceSamples, RadianceSh, SplitLight,
    },
    quality::SplitKind,
};
use std::path::{Path, PathBuf};

const AFTER_HELP: &str = "\
WORLD FRAME: right-handed, z up.
  equirect  the top row is +z, the middle +x, u = 0.75 is +y (--axes mirrored where +y should be left of the middle)
  angular   Debevec's probe: the middle is +x, the top +z, the right -y
  cube      faces where their names say, +x -x +y -y +z -z as D3D lays them out; for files that take y for up (most
            do) give --axes y-up: y and z change places
  ball      a reference case has its own world; else z is --up, x leads away from the camera, y to the left

PICTURES: linear ones (.hdr .exr, cubes also .dds) as they are; PNG and JPEG through --response, several of them
with --times as one bracket.

--json prints: order; sh_rgb, order^2 rows of r, g, b: radiance, orthonormal, Condon-Shortley sign, row l(l+1)+m;
to_light, a unit vector or null; irradiance_rgb, of a surface that faces the light; residual_sh_rgb, what is left
without it; cone95_rad, half angle of the cone that should hold the true direction (pi: unknown), from what had to be
guessed; flags.
--format prints JSON for other programs, bands 0 to 2, y up (x, z, -y of ours), all coefficients of radiance
(docs/light-export.md). The split is that of --split: compact lights by default, and where none helps the main light is
dark.
  android-xr  the structures of XR_ANDROID_light_estimation: SH with and without the main light, ambient light,
              direction towards the main light, intensity (irradiance of a surface that faces it); Condon-Shortley sign,
              as in the shaders published for ARCore; lastUpdatedTime is 0 for a still
  webxr       an XRLightEstimate: 27 numbers without the main light, and that; no Condon-Shortley sign (the
              specification leaves it open; this is what three.js takes it for)
  babylon     the same with Chromium's own sign, the one of android-xr, which Babylon.js takes
  threejs     what ObjectLoader reads: a group of a LightProbe (without the lights) and up to four DirectionalLights

Examples:
  halflight light sky.hdr --as equirect --order 4 --out sky.png
  halflight light probe.dds --as cube --axes y-up --json
  halflight light sky.hdr --as equirect --format threejs > sky.json
  halflight light px.exr nx.exr py.exr ny.exr pz.exr nz.exr --as cube
  halflight light --as ball --case reference/f5_sun_beach
  halflight light a.jpg b.jpg c.jpg --times 1/10,1/40,1/160 --as ball --response solve \\
      --focal 1264,1264,750,500 --ball-px 741,402,58 --ball-radius 0.04 --on-surface";

/// Arguments of `halflight light`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct LightArguments {
    /// One picture, the exposures of one bracket (with --times), or six faces of a cube. May be left out with --case.
    #[arg(value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// What the picture shows.
    #[arg(long = "as", value_enum, value_name = "KIND")]
    pub kind: PictureKind,
    /// Order of the spherical harmonics, 1 to 6: bands 0 to N-1. Order 1 has no direction.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=6))]
    pub order: u8,
    /// Which gray gives the direction.
    #[arg(long, value_enum, default_value_t = GrayChoice::Rec601)]
    pub gray: GrayChoice,
    /// Write the light as an equirectangular picture in the world frame, made from the samples: .exr (32-bit float),
    /// .hdr, or .png (8 bits through sRGB, nine tenths of the pixels below 0.8).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Print the light as JSON in this shape.
    #[arg(long, value_enum, value_name = "SHAPE")]
    pub format: Option<formats::LightFormat>,
    /// How the light is split into directional lights and the rest: compact (lights found in the picture), paper or bounded
    /// (one light by net flux), or sh (none) [default: compact with --format for other programs, else paper].
    #[arg(long, value_name = "KIND")]
    pub split: Option<String>,
    /// Rows of that picture; it has twice as many columns.
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub out_height: u16,

    /// Exposure time of each picture in seconds (times gain where gains differ), joined by commas: 0.1,0.025 or
    /// 1/10,1/40.
    #[arg(long, value_name = "S,S,..", value_delimiter = ',', help_heading = "Exposures")]
    pub times: Vec<String>,
    /// The camera's response for PNG and JPEG: srgb, solve (from the bracket; sRGB where it cannot tell, with a
    /// warning), or a JSON file as `halflight hdr --save-response` writes it.
    #[arg(long, value_name = "srgb|solve|FILE.json", help_heading = "Exposures")]
    pub response: Option<String>,

    /// Axes for which the map was made.
    #[arg(long, value_enum, default_value_t = Axes::Ours, help_heading = "Maps")]
    pub axes: Axes,
    /// Turn the map about z by this many degrees (from +x towards +y), after --axes.
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        help_heading = "Maps"
    )]
    pub turn: f64,

    /// Which point of an angular map's texels is looked at: corner repeats the published coefficients of Debevec's
    /// probes, which are half a texel off.
    #[arg(long, value_enum, default_value_t = Texels::Centre, help_heading = "Maps")]
    pub texels: Texels,

    /// How a ball is seen.
    #[command(flatten)]
    pub ball: ball::BallArguments,
}

/// What a picture shows.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// A photograph with a mirror ball in it.
    Ball,
    /// Debevec's angular map, square.
    Angular,
    /// A cube map: a DDS file, six faces, or one picture with the faces one under the other.
    Cube,
    /// An equirectangular map, twice as wide as high.
    Equirect,
}

/// Axes for which a map was made.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// As described below.
    #[value(name = "z-up")]
    Ours,
    /// y up and left-handed, as D3D and GL read cube maps: y and z change places.
    YUp,
    /// y up and right-handed: (x, y, z) becomes (x, -z, y).
    YUpRightHanded,
    /// Left-right reversed: y changes its sign.
    Mirrored,
}

impl Axes {
    fn map_axes(self) -> MapAxes {
        match self {
            Self::Ours => MapAxes::World,
            Self::YUp => MapAxes::YUp,
            Self::YUpRightHanded => MapAxes::YUpRightHanded,
            Self::Mirrored => MapAxes::Mirrored,
        }
    }
}

/// Which point stands for an angular map's texel.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texels {
    /// In the middle of each texel.
    Centre,
    /// Its upper left corner.
    Corner,
}

/// GrayChoice weights.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrayChoice {
    /// 0.3, 0.59, 0.11 [Now11].
    Rec601,
    /// 0.2126, 0.7152, 0.0722.
    Rec709,
}

/// Light as measured, and all that is told about it.
pub struct MeasuredPlace {
    total: RadianceSh,
    split: SplitLight,
    /// Directional lights, the brightest first; the split has the first of them.
    lights: Vec<DirectionalLight>,
    cone95_rad: f64,
    anisotropy: f32,
    flags: LightFlags,
    samples: RadianceSamples,
    /// For people.
    notes: Vec<String>,
}

/// Runs `halflight light`.
pub fn run(arguments: LightArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let allowed = [PictureFormat::Exr, PictureFormat::Hdr, PictureFormat::Png];
    let format = arguments.out.as_deref().map(|out| PictureFormat::of(out, &allowed)).transpose()?;
    if let Some(out) = &arguments.out {
        need_folder_of(out)?;
    }
    let shape = arguments.format.or(global.json.then_some(formats::LightFormat::Json));
    let kind = split_kind(&arguments, shape)?;
    if !arguments.turn.is_finite() {
        return Err(CliError(format!("--turn = {}: must be finite, in degrees", arguments.turn)));
    }
    let mut notes = Vec::new();
    let mut engine = global.open_engine()?;
    let (samples, MeasuredLight { total, flags }) = match arguments.kind {
        PictureKind::Ball => ball::samples(&arguments, engine.as_mut(), &mut notes)?,
        PictureKind::Angular | PictureKind::Cube | PictureKind::Equirect => {
            // Maps may have other axes than an engine takes: they are projected here, on the CPU.
            let (samples, flags) = map_samples(&arguments, engine.as_mut(), &mut notes)?;
            let total = project_sh(&samples, usize::from(arguments.order));
            (samples, MeasuredLight { total, flags })
        }
    };
    let gray_weights = match arguments.gray {
        GrayChoice::Rec601 => GRAY_PAPER,
        GrayChoice::Rec709 => GRAY_REC709,
    };
    let options = SplitOptions { gray_weights, ..SplitOptions::default() };
    let lights = match kind {
        SplitKind::Compact => compact_lights(&samples, shape.map_or(MAX_LIGHTS, |shape| shape.most_lights())),
        SplitKind::Sh => Vec::new(),
        SplitKind::Paper | SplitKind::Bounded => {
            let bounded = kind == SplitKind::Bounded;
            split(&total, &SplitOptions { bounded, ..options }).direct.into_iter().collect()
        }
    };
    let measured = MeasuredPlace {
        total,
        split: match kind {
            SplitKind::Paper => split(&total, &options),
            _ => split_of(&total, &lights),
        },
        lights,
        cone95_rad: cone_of_samples(&samples, &total, &options),
        anisotropy: crate::light::split::dominant(total.rows(), gray_weights, options.least_anisotropy)
            .anisotropy,
        flags,
        samples,
        notes,
    };
    let digest = report::picture(&arguments, global, format, &measured.samples)?;
    match shape {
        Some(shape) => report::json(&measured, shape),
        None => report::text(&arguments, &measured),
    }
    match digest {
        // JSON on standard output stays alone there.
        Some(digest) if shape.is_some() => eprintln!("digest    {digest}"),
        Some(digest) => println!("digest    {digest}"),
        None => {}
    }
    Ok(())
}

/// Which split the light is told in.
fn split_kind(
    arguments: &LightArguments,
    shape: Option<formats::LightFormat>,
) -> Result<SplitKind, CliError> {
    match &arguments.split {
        Some(name) => SplitKind::from_name(name).ok_or_else(|| {
            CliError(format!("--split = {name}: must be one of {}", SplitKind::NAMES.join(", ")))
        }),
        None if shape.is_some_and(formats::LightFormat::is_foreign) => Ok(SplitKind::Compact),
        None => Ok(SplitKind::Paper),
    }
}

/// Samples of an environment map, world frame.
fn map_samples(
    arguments: &LightArguments,
    engine: &mut dyn Engine,
    notes: &mut Vec<String>,
) -> Result<(RadianceSamples, LightFlags), CliError> {
    if let Some(name) = arguments.ball.first_given() {
        return Err(CliError(format!("{name}: is for --as ball")));
    }
    let map = load_map(arguments, engine, notes)?;
    let (width, height) = (map.radiance.width(), map.radiance.height());
    let (fits, shape) = match map.layout {
        MapLayout::Equirect => (width == 2 * height, "twice as wide as high"),
        MapLayout::Angular => (maps::fits(&map), "square"),
        MapLayout::Cube => (maps::fits(&map), "six squares one under the other (or give six files)"),
    };
    if !fits {
        let file = arguments.images.first().map_or(Path::new(""), PathBuf::as_path);
        return Err(CliError(format!("{}: size = {width} x {height}: must be {shape}", file.display())));
    }
    let mut samples = RadianceSamples::default();
    let flags = match (map.layout, arguments.texels) {
        (_, Texels::Centre) => maps::samples_of_map(&map, &mut samples),
        (MapLayout::Angular, Texels::Corner) => {
            maps::samples_of_angular_map(&map.radiance, TexelPoint::Corner, &mut samples)
        }
        (_, Texels::Corner) => return Err(CliError("--texels corner: is for --as angular".into())),
    };
    let world_from_map = arguments.axes.map_axes().world_from_map(arguments.turn.to_radians());
    if world_from_map != glam::DMat3::IDENTITY {
        maps::turn(&mut samples, world_from_map);
    }
    Ok((samples, flags))
}

fn load_map(
    arguments: &LightArguments,
    engine: &mut dyn Engine,
    notes: &mut Vec<String>,
) -> Result<EnvironmentMap, CliError> {
    let layout = match arguments.kind {
        PictureKind::Angular => MapLayout::Angular,
        PictureKind::Cube => MapLayout::Cube,
        PictureKind::Equirect | PictureKind::Ball => MapLayout::Equirect,
    };
    if arguments.kind == PictureKind::Cube && arguments.times.is_empty() {
        if let Ok(faces) = <&[PathBuf; 6]>::try_from(arguments.images.as_slice()) {
            return Ok(dds::load_cube_faces(faces, load_raw)?);
        }
        if let [file] = arguments.images.as_slice()
            && file.extension().is_some_and(|e| e.eq_ignore_ascii_case("dds"))
        {
            return Ok(dds::load_cube(file)?);
        }
        if arguments.images.len() > 1 {
            let count = arguments.images.len();
            return Err(CliError(format!(
                "--as cube: {count} pictures: must be 1 or 6, in the order {}",
                dds::FACES.join(" ")
            )));
        }
    }
    if arguments.times.is_empty()
        && arguments.response.is_none()
        && let [file] = arguments.images.as_slice()
    {
        // As the file holds it: what is no radiance is replaced and counted with the samples.
        return Ok(EnvironmentMap { layout, radiance: load_raw(file)? });
    }
    let picture =
        input::merged(&arguments.images, &arguments.times, arguments.response.as_deref(), engine, notes)?;
    Ok(EnvironmentMap { layout, radiance: picture.radiance })
}
