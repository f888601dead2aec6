//! What a still is drawn from, and the drawing of it.

use super::{background, case_light, case_room};
use crate::animate::posed::Posed;
use crate::assets::case::Case;
use crate::cli::progress::host;
use crate::cli::{CliError, common::PixelDigest};
use crate::daemon::{blocker_spheres, vertex_transfer};
use crate::engine::{Engine, RelightInput};
use crate::light::{halve::HalveOptions, split::SplitOptions};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    environment::EnvironmentPicture,
    frame::Exposure,
    image::{HdrImage, RadianceImage, Rgb8Image},
    light::{Lights, RadianceSamples},
    picture::{Picture, PictureView},
    quality::Quality,
    response::Response,
    scene::Scene,
    time::Timestamp,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{FramePlan, PassTiming};
use crate::present::views::{Subject, Views};
use std::sync::Arc;

/// How a still's light is halved.
pub(in crate::cli) fn halve_options(quality: &Quality, above_horizon: bool) -> HalveOptions {
    HalveOptions {
        kind: quality.split,
        lights: quality.lights,
        shadow_maps: quality.shadow_maps,
        net_flux: SplitOptions::default(),
        above_horizon,
        dering: quality.dering,
    }
}

/// What of the picture is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The picture.
    Radiance,
    /// The picture over the one without objects.
    Ratio,
    /// The picture without objects less the picture.
    Difference,
}

/// Everything that one still is drawn from.
#[derive(Clone, Debug)]
pub struct Still {
    /// What stands where.
    pub scene: Scene,
    /// The lens.
    pub lens: Lens,
    /// Camera to world.
    pub world_from_camera: Pose,
    /// The light of the objects.
    pub light: Lights,
    /// What mirrors and sharp gloss see.
    pub environment: Option<EnvironmentPicture>,
    /// The place without the objects.
    pub background: HdrImage,
    /// For the 8-bit picture.
    pub response: Response,
    /// Exposure of the 8-bit picture where the still itself has one.
    pub exposure_s: Option<f64>,
    /// What of the picture is wanted.
    pub quantity: Quantity,
    /// The known room that the scene stands in.
    pub room: Option<Arc<KnownRoom>>,
    /// Which part of the work is shown.
    pub view: PictureView,
    /// The light as it was measured, world frame; empty where it was not.
    pub samples: RadianceSamples,
    /// Time in the scene: where what moves is, seconds.
    pub time_s: f64,
}

/// A still.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Linear radiance (or ratio, or difference).
    pub radiance: RadianceImage,
    /// The same through the response, exposed as asked.
    pub display: Rgb8Image,
    /// The list of passes that was run.
    pub plan: FramePlan,
    /// How long they took.
    pub timings: Vec<PassTiming>,
}

impl Drawn {
    /// SHA-256 over the linear and then the 8-bit pixels.
    pub fn digest(&self) -> String {
        let mut digest = PixelDigest::default();
        digest.add_floats(self.radiance.pixels());
        digest.add_bytes(self.display.pixels());
        digest.hex()
    }
}

/// The image that is drawn where none is named: the main picture of the case's family.
pub fn default_image(case: &Case) -> Result<String, CliError> {
    ["beauty", "with", "obj_table", "hdr"]
        .iter()
        .find(|&&name| case.images.iter().any(|i| i.name == name))
        .map(|name| (*name).to_string())
        .ok_or_else(|| CliError::on(case.file.display(), "has no main picture: name one with --image"))
}

/// The still of one image of a case.
pub fn of_case(case: &Case, image: &str, quality: &Quality) -> Result<Still, CliError> {
    CaseStills::new(case, image)?.still(quality)
}

/// What all stills of one image of a case share, whatever their settings.
pub struct CaseStills<'a> {
    case: &'a Case,
    sources: Vec<case_light::Source>,
    scene: Scene,
    background: HdrImage,
    room: Option<Arc<KnownRoom>>,
    quantity: Quantity,
}

impl<'a> CaseStills<'a> {
    /// Of an image of a case, which must be a picture.
    pub fn new(case: &'a Case, image: &str) -> Result<Self, CliError> {
        let file = |e: crate::assets::error::AssetError| CliError(e.to_string());
        if case.image(image).map_err(file)?.is_mask() {
            return Err(CliError(format!(
                "--image = {image}: is a mask; must be one of the pictures of {}",
                case.file.display()
            )));
        }
        let mut scene = case.scene(Some(image)).map_err(file)?;
        let emitters = case.emitters(Some(image)).map_err(file)?;
        let sources = case_light::sources(case, &emitters)?;
        let background = background::shade(case, &scene, &sources);
        let room = case_room::prepare(case, &emitters, &mut scene)?;
        let quantity = if image == "ratio" {
            Quantity::Ratio
        } else if image.starts_with("diff_") {
            Quantity::Difference
        } else {
            Quantity::Radiance
        };
        Ok(Self { case, sources, scene, background, room, quantity })
    }

    /// With these settings.
    pub fn still(&self, quality: &Quality) -> Result<Still, CliError> {
        let Self { case, sources, background, room, .. } = self;
        let mut scene = self.scene.clone();
        blocker_spheres::fit(&mut scene, quality.spheres, host().progress);
        vertex_transfer::bake(&mut scene, quality, host().progress);
        let (light, left) = case_light::split_for_objects(case, &scene, sources, quality)?;
        let environment =
            case_light::picture_for_objects(case, &scene, sources, left.as_ref(), quality.sh_order);
        let light = if room.is_some() { Lights::soft(light.global) } else { light };
        Ok(Still {
            scene,
            lens: case.lens,
            world_from_camera: case.world_from_camera,
            light,
            environment,
            background: background.clone(),
            response: Response::srgb(),
            exposure_s: None,
            quantity: self.quantity,
            room: room.clone(),
            view: PictureView::Final,
            samples: RadianceSamples::default(),
            time_s: 0.0,
        })
    }
}

impl Still {
    /// What moves, where it is.
    pub fn posed(&self) -> Posed {
        let mut posed = Posed::new(&self.scene);
        posed.update(&self.scene, self.time_s);
        posed
    }

    /// Exposure of its 8-bit picture where none is asked for, seconds.
    pub fn shown_exposure_s(&self) -> f64 {
        self.exposure_s.unwrap_or_else(|| pleasant_exposure_s(&self.background.radiance))
    }

    /// Draws it. Exposure in seconds for the 8-bit picture; `None` takes the still's own, else puts nine tenths
    /// of the place below 0.8.
    /// Drawn `repeat` times more, each pass is reported with its median time.
    pub fn draw(
        &self,
        engine: &mut dyn Engine,
        quality: &Quality,
        exposure_s: Option<f64>,
        repeat: usize,
    ) -> Result<Drawn, CliError> {
        let failed = |e: crate::engine::EngineError| CliError(e.to_string());
        engine.ask_for_linear(true);
        engine.load_room(self.room.clone()).map_err(failed)?;
        engine.load_scene(&self.scene).map_err(failed)?;
        let mut plan = FramePlan::default();
        let time_s = exposure_s.unwrap_or_else(|| self.shown_exposure_s());
        let posed = self.posed();
        let input = RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.world_from_camera,
            light: &self.light,
            environment: self.environment.as_ref(),
            posed: Some(&posed),
            response: &self.response,
            shown_exposure: Exposure { time_s, gain: 1.0 },
            t: Timestamp(0),
        };
        let subject =
            Subject { scene: &self.scene, input: &input, quality, samples: Some(&self.samples), frame: None };
        let (mut views, mut picture) = (Views::default(), Picture::default());
        views.draw(self.view, engine, &subject, &mut plan, &mut picture).map_err(failed)?;
        let mut timings = Vec::new();
        engine.take_timings(&mut timings);
        let mut runs = vec![Vec::with_capacity(repeat); timings.len()];
        for _ in 0..repeat {
            views.draw(self.view, engine, &subject, &mut plan, &mut picture).map_err(failed)?;
            engine.take_timings(&mut timings);
            runs.iter_mut().zip(&timings).for_each(|(run, t)| run.push(t.ms));
        }
        for (timing, run) in timings.iter_mut().zip(&mut runs) {
            run.sort_by(f32::total_cmp);
            timing.ms = run.get(run.len() / 2).copied().unwrap_or(timing.ms);
        }
        let mut radiance = picture.radiance;
        let pairs = radiance.pixels_mut().iter_mut().zip(self.background.radiance.pixels());
        for (out, without) in pairs {
            for (o, &w) in out.iter_mut().zip(without) {
                match self.quantity {
                    Quantity::Radiance => {}
                    Quantity::Ratio => *o = if w > 0.0 { *o / w } else { 1.0 },
                    Quantity::Difference => *o = w - *o,
                }
            }
        }
        Ok(Drawn { radiance, display: picture.display, plan, timings })
    }
}

/// Puts nine tenths of all channels below an exposure of 0.8.
fn pleasant_exposure_s(picture: &RadianceImage) -> f64 {
    let mut all: Vec<f32> = picture.pixels().iter().flatten().copied().filter(|c| *c > 0.0).collect();
    all.sort_by(f32::total_cmp);
    all.get(all.len() * 9 / 10).map_or(1.0, |&high| 0.8 / f64::from(high))
}
