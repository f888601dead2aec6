//! `--as ball`: which lens, which pose, which ball.

use super::{CliError, input};
use crate::assets::{calibration, pictures};
use crate::engine::{Engine, LightJob, MeasuredLight};
use crate::lab::{
    case::{self, Case, ExactShape},
    open_exr::load_radiance,
    still::bracket::LoadedBracket,
};
use crate::light::unwrap_ball::BallShot;
use crate::light::{place_ball, unwrap_ball::unwrap_ball};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    image::HdrImage, light::RadianceSamples, quality::Quality, rig::MirrorBall, scene::Material,
};
use glam::{DVec2, DVec3};
use std::path::PathBuf;

/// How a ball is seen.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Balls")]
pub struct BallArguments {
    /// A reference case (case.json or its folder): gives lens, pose and ball, and the picture `hdr` where no IMAGE is
    /// named. The ball stands on the case's plane.
    #[arg(long, value_name = "CASE.json", conflicts_with_all = ["camera", "focal", "ball_px", "ball_radius"])]
    pub case: Option<PathBuf>,
    /// With --case: the light from its 8-bit exposures, through its response.
    #[arg(long, requires = "case", conflicts_with_all = ["images", "times", "response"])]
    pub photographs: bool,
    /// Calibration of the camera: OpenCV YAML, ROS camera_info YAML, or lists K and D. FILE#NAME picks one of several
    /// cameras.
    #[arg(long, value_name = "FILE", conflicts_with = "focal")]
    pub camera: Option<PathBuf>,
    /// A lens without distortion, in pixels: focal lengths and principal point. Pixel (0, 0) covers 0 to 1.
    #[arg(long, value_name = "FX,FY,CX,CY", allow_hyphen_values = true)]
    pub focal: Option<String>,
    /// The circle that the ball fills in the picture: its middle and radius in pixels (of an oval, the mean).
    #[arg(long, value_name = "CX,CY,R", allow_hyphen_values = true)]
    pub ball_px: Option<String>,
    /// Radius of the ball in metres.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    pub ball_radius: Option<f64>,
    /// Height of the ball's middle above the surface in metres (default: its radius; it stands there).
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    pub ball_height: Option<f64>,
    /// Share of the light that the ball reflects, for r, g, b, each in (0, 1] (default: all).
    #[arg(long, value_name = "R,G,B", allow_hyphen_values = true)]
    pub ball_reflectance: Option<String>,
    /// Where up is, in the camera's axes: x right, y down, z forward (default: 0,-1,0, a level camera).
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub up: Option<String>,
    /// The ball is on a matt surface that the picture shows too: below its horizon the light is then the surface's where
    /// the ball does not shade it.
    #[arg(long)]
    pub on_surface: bool,
}

impl BallArguments {
    /// The first of these options that was given.
    pub fn first_given(&self) -> Option<&'static str> {
        [
            ("--case", self.case.is_some()),
            ("--photographs", self.photographs),
            ("--camera", self.camera.is_some()),
            ("--focal", self.focal.is_some()),
            ("--ball-px", self.ball_px.is_some()),
            ("--ball-radius", self.ball_radius.is_some()),
            ("--ball-height", self.ball_height.is_some()),
            ("--ball-reflectance", self.ball_reflectance.is_some()),
            ("--up", self.up.is_some()),
            ("--on-surface", self.on_surface),
        ]
        .into_iter()
        .find_map(|(name, given)| given.then_some(name))
    }
}

/// Samples of the light on a ball, world frame.
pub fn samples(
    arguments: &super::LightArguments,
    engine: &mut dyn Engine,
    notes: &mut Vec<String>,
) -> Result<(RadianceSamples, MeasuredLight), CliError> {
    let options = &arguments.ball;
    if arguments.axes != super::Axes::Ours || arguments.turn != 0.0 {
        return Err(CliError("--axes and --turn: are for maps; a ball has --up".into()));
    }
    let (picture, lens, pose, mut ball, on_surface) = match &options.case {
        Some(file) => {
            let case = case::load(file)?;
            let ball = ball_of_case(&case)?;
            let picture = case_picture(&case, arguments, engine, notes)?;
            (picture, case.lens, case.world_from_camera, ball, true)
        }
        None => {
            let picture = input::merged(
                &arguments.images,
                &arguments.times,
                arguments.response.as_deref(),
                engine,
                notes,
            )?;
            let lens = lens_of(options, &picture)?;
            let (pose, ball) = place(options, &lens)?;
            (picture, lens, pose, ball, options.on_surface)
        }
    };
    if let Some(text) = &options.ball_reflectance {
        let allowed = "three numbers R,G,B within (0, 1]";
        let reflectance = numbers::<3>("--ball-reflectance", text, allowed)?;
        if !reflectance.iter().all(|r| *r > 0.0 && *r <= 1.0) {
            return Err(CliError(format!("--ball-reflectance {text}: must be {allowed}")));
        }
        ball.reflectance_rgb = reflectance.map(|r| r as f32);
    }
    let distance_m = pose.translation.distance(ball.centre_world);
    notes.push(format!("ball of {:.4} m, {distance_m:.4} m from the camera", ball.radius_m));
    let mut samples = RadianceSamples::default();
    // Once more for the samples, which an engine keeps to itself.
    unwrap_ball(&picture, &lens, &pose, &ball, on_surface, &mut samples)?;
    let job = LightJob::Ball(BallShot {
        picture: &picture,
        lens: &lens,
        world_from_camera: &pose,
        ball: &ball,
        on_surface,
        without_ball: None,
    });
    let quality = Quality { sh_order: usize::from(arguments.order), ..Quality::default() };
    let light = engine.estimate_light(&job, &quality)?;
    Ok((samples, light))
}

fn ball_of_case(case: &Case) -> Result<MirrorBall, CliError> {
    case.geometry
        .iter()
        .find_map(|geometry| match (&geometry.shape, geometry.material) {
            (ExactShape::Sphere { centre, radius }, Material::Mirror { reflectance_rgb }) => {
                Some(MirrorBall {
                    surface_radius_m: None,
                    centre_world: *centre,
                    radius_m: *radius,
                    reflectance_rgb,
                })
            }
            _ => None,
        })
        .ok_or_else(|| CliError(format!("{}: geometry: must have a mirror sphere", case.file.display())))
}

fn case_picture(
    case: &Case,
    arguments: &super::LightArguments,
    engine: &mut dyn Engine,
    notes: &mut Vec<String>,
) -> Result<HdrImage, CliError> {
    if arguments.ball.photographs {
        let photographs = case.photographs.as_ref().ok_or_else(|| {
            CliError(format!("{}: photographs: must be there for --photographs", case.file.display()))
        })?;
        let files = photographs.exposures.iter().map(|(file, _)| pictures::load_rgb8(file));
        let times_s: Vec<f64> = photographs.exposures.iter().map(|(_, time_s)| *time_s).collect();
        let bracket = LoadedBracket::new(files.collect::<Result<_, _>>()?, &times_s);
        return Ok(bracket.merge(&photographs.response, engine)?);
    }
    if arguments.images.is_empty() {
        let file = &case.image("hdr")?.file;
        return Ok(load_radiance(file)?.hdr);
    }
    input::merged(&arguments.images, &arguments.times, arguments.response.as_deref(), engine, notes)
}

fn lens_of(options: &BallArguments, picture: &HdrImage) -> Result<Lens, CliError> {
    let (width, height) = (picture.radiance.width(), picture.radiance.height());
    if let Some(file) = &options.camera {
        let lens = calibration::load(file)?;
        return Ok(calibration::for_picture(lens, width, height, file)?);
    }
    let Some(text) = &options.focal else {
        return Err(CliError("--as ball: must have --case, --camera or --focal".into()));
    };
    let allowed = "four numbers FX,FY,CX,CY in pixels, FX and FY above 0, e.g. 535,535,320,240";
    let [fx, fy, cx, cy] = numbers::<4>("--focal", text, allowed)?;
    if !(fx > 0.0 && fy > 0.0) {
        return Err(CliError(format!("--focal {text}: must be {allowed}")));
    }
    Ok(Lens::pinhole(width as u32, height as u32, fx, fy, cx, cy))
}

/// World and ball from the ball's outline.
fn place(options: &BallArguments, lens: &Lens) -> Result<(Pose, MirrorBall), CliError> {
    let positive = |name: &str, metres: f64| match metres > 0.0 && metres.is_finite() {
        true => Ok(metres),
        false => Err(CliError(format!("{name} {metres}: must be above 0 metres"))),
    };
    let Some(text) = &options.ball_px else {
        return Err(CliError("--as ball: must have --ball-px CX,CY,R (or --case)".into()));
    };
    let radius_m = positive(
        "--ball-radius",
        options.ball_radius.ok_or_else(|| CliError("--as ball: must have --ball-radius METRES".into()))?,
    )?;
    let height_m = positive("--ball-height", options.ball_height.unwrap_or(radius_m))?;
    let allowed = "three numbers CX,CY,R in pixels, R above 0, where the lens can see";
    let [x, y, radius_px] = numbers::<3>("--ball-px", text, allowed)?;
    let centre_camera = place_ball::centre_from_outline(lens, DVec2::new(x, y), radius_px, radius_m)
        .ok_or_else(|| CliError(format!("--ball-px {text}: must be {allowed}")))?;
    let up_text = options.up.as_deref().unwrap_or("0,-1,0");
    let allowed = "three numbers X,Y,Z in the camera's axes, not all 0";
    let up = DVec3::from(numbers::<3>("--up", up_text, allowed)?);
    let pose = place_ball::world_about_ball(centre_camera, up, height_m)
        .ok_or_else(|| CliError(format!("--up {up_text}: must be {allowed}")))?;
    let centre_world = DVec3::new(0.0, 0.0, height_m);
    Ok((pose, MirrorBall { surface_radius_m: None, centre_world, radius_m, reflectance_rgb: [1.0; 3] }))
}

/// N finite numbers joined by commas.
fn numbers<const N: usize>(name: &str, text: &str, allowed: &str) -> Result<[f64; N], CliError> {
    let parsed: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    parsed
        .and_then(|list| list.try_into().ok())
        .ok_or_else(|| CliError(format!("{name} {text}: must be {allowed}")))
}
