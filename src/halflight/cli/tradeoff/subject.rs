//! What is drawn: a reference case, a scene file, or a moment of a recording, each with its truth.

use super::axes::{Axis, CalledForBy, Point};
use super::{errors::Truth, truth};
use crate::assets::{
    case::{self, Case},
    scene::{self, SceneFile},
};
use crate::cli::progress::host;
use crate::cli::{
    CliError,
    moment::Moment,
    render::{CaseStills, Still, above_horizon, default_image, of_scene},
    trace::LightOf,
};
use crate::config::Settings;
use crate::daemon::known_room;
use crate::engine::Engine;
use crate::model::response::Response;
use crate::pipeline::frame::Stage;
use std::path::{Path, PathBuf};

/// Where stills come from.
enum Source {
    Case {
        case: Box<Case>,
        image: String,
    },
    /// With the still as a moment, where its light was measured: reading its pictures again for each point takes long.
    Scene {
        file: Box<SceneFile>,
        moment: Option<Box<Moment>>,
    },
    Moment {
        moment: Box<Moment>,
        settings: Box<Settings>,
        frame: u64,
    },
}

/// One thing that is drawn with many settings.
pub struct Subject {
    /// For people.
    pub name: String,
    /// What pictures are held against.
    pub truth: Truth,
    source: Source,
    in_room: bool,
    response: Response,
    exposure_s: f64,
}

/// A still, and what a frame takes besides drawing it.
pub struct Shot {
    /// To be drawn.
    pub still: Still,
    /// Stages before drawing, milliseconds; empty where no frames went through a pipeline.
    pub before: Vec<(&'static str, f32)>,
}

/// What a person asks for besides the files.
pub struct Asked<'a> {
    /// Scene files for recordings.
    pub scenes: &'a [PathBuf],
    /// The frame of a recording.
    pub frame: u64,
    /// Settings that everything starts from.
    pub settings: &'a Settings,
    /// Samples a pixel of truths that are traced here.
    pub samples: usize,
    /// Is told the share of a truth that is done.
    pub done: &'a dyn Fn(f32),
}

impl Subject {
    /// All subjects that one input stands for: a recording is one with each scene.
    pub fn of(input: &Path, asked: &Asked<'_>, engine: &mut dyn Engine) -> Result<Vec<Self>, CliError> {
        let ends_in = |e: &str| input.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
        let text = input.to_string_lossy();
        if let Some((recording, scene)) = text.split_once('@') {
            return Ok(vec![Self::of_recording(Path::new(recording), Path::new(scene), asked)?]);
        }
        if ends_in("toml") {
            return Ok(vec![Self::of_scene(input, asked, engine)?]);
        }
        if ends_in("mcap") || text.contains(':') {
            if asked.scenes.is_empty() {
                return Err(CliError::on(
                    input.display(),
                    "--scene FILE is missing: what is drawn into the recording",
                ));
            }
            return asked.scenes.iter().map(|scene| Self::of_recording(input, scene, asked)).collect();
        }
        Ok(vec![Self::of_case(input, asked)?])
    }

    fn of_case(input: &Path, asked: &Asked<'_>) -> Result<Self, CliError> {
        let case = case::load(input).map_err(|e| CliError(e.to_string()))?;
        let image = default_image(&case)?;
        let still = CaseStills::new(&case, &image)?.still(&asked.settings.quality)?;
        let truth = truth::of_case(&case, &image, &still)?;
        let name = case.id.clone();
        Ok(Self::new(name, truth, Source::Case { case: Box::new(case), image }, &still))
    }

    fn of_scene(input: &Path, asked: &Asked<'_>, engine: &mut dyn Engine) -> Result<Self, CliError> {
        let file = scene::load(input).map_err(|e| CliError(e.to_string()))?;
        let still = of_scene(&file, engine, &asked.settings.quality, &mut Vec::new())?;
        let (light, quality) = (LightOf::File(&file), &asked.settings.quality);
        let truth = truth::traced(&still, light, quality, asked.samples, asked.done)?;
        let moment = Moment::of_still(&still, above_horizon(&file), quality).map(Box::new);
        Ok(Self::new(stem(input), truth, Source::Scene { file: Box::new(file), moment }, &still))
    }

    fn of_recording(input: &Path, scene: &Path, asked: &Asked<'_>) -> Result<Self, CliError> {
        let settings = Settings {
            camera: match input.display().to_string() {
                device if device.contains(':') => device,
                file => format!("replay:{file}"),
            },
            scene_file: scene.display().to_string(),
            ..asked.settings.clone()
        };
        let moment = Box::new(Moment::of(&settings, asked.frame)?);
        let still = moment.still(&settings.quality);
        let quality = &settings.quality;
        let truth = truth::traced(&still, LightOf::Samples, quality, asked.samples, asked.done)?;
        let source = Source::Moment { moment, settings: Box::new(settings), frame: asked.frame };
        Ok(Self::new(format!("{} in {}", stem(scene), stem(input)), truth, source, &still))
    }

    fn new(name: String, truth: Truth, source: Source, still: &Still) -> Self {
        let (in_room, response) = (still.room.is_some(), still.response.clone());
        Self { name, truth, source, in_room, response, exposure_s: still.shown_exposure_s() }
    }

    /// How the truth is shown.
    pub fn response(&self) -> &Response {
        &self.response
    }

    /// Exposure of shown pictures, seconds.
    pub fn exposure_s(&self) -> f64 {
        self.exposure_s
    }

    /// Whether a setting can matter here.
    pub fn calls_for(&self, axis: &Axis) -> bool {
        match axis.called_for_by {
            CalledForBy::Any => true,
            CalledForBy::FarLight => !self.in_room,
            // A case's light is given with its geometry: nothing is left of it for settings of scene files.
            CalledForBy::Room => self.in_room && !matches!(self.source, Source::Case { .. }),
            CalledForBy::Recording => matches!(self.source, Source::Moment { .. }),
        }
    }

    /// The stills of some points, each with its point. Points whose settings leave a recording without pose or light have
    /// none. What was warned of when the subject was opened is not said again.
    pub fn shots(
        &self,
        points: &[Point],
        base: &Settings,
        engine: &mut dyn Engine,
    ) -> Result<Vec<(Point, Shot)>, CliError> {
        let quiet = tracing::subscriber::NoSubscriber::default();
        tracing::subscriber::with_default(quiet, || self.shots_of(points, base, engine))
    }

    fn shots_of(
        &self,
        points: &[Point],
        base: &Settings,
        engine: &mut dyn Engine,
    ) -> Result<Vec<(Point, Shot)>, CliError> {
        let case_stills = match &self.source {
            Source::Case { case, image } => Some(CaseStills::new(case, image)?),
            _ => None,
        };
        let mut shots = Vec::with_capacity(points.len());
        for point in points {
            let mut settings = base.clone();
            point.put_over(&mut settings)?;
            let quality = &settings.quality;
            let shot = match (&self.source, &case_stills) {
                (Source::Case { .. }, Some(stills)) => {
                    Shot { still: stills.still(quality)?, before: Vec::new() }
                }
                (Source::Case { .. }, None) => continue,
                (Source::Scene { moment: Some(moment), .. }, _) => {
                    Shot { still: moment.still(quality), before: Vec::new() }
                }
                (Source::Scene { file, .. }, _) => {
                    let mut file = file.clone();
                    if let Some(source) = &mut file.room {
                        point.put_over_room(source);
                    }
                    let still = of_scene(&file, engine, quality, &mut Vec::new())?;
                    Shot { still, before: Vec::new() }
                }
                (Source::Moment { settings: own, frame, .. }, _) if point.is_of_recording() => {
                    let mut own = (**own).clone();
                    point.put_over(&mut own)?;
                    let Ok(moment) = Moment::of(&own, *frame) else { continue };
                    Shot { still: moment.still(quality), before: before(&moment) }
                }
                (Source::Moment { moment, settings: own, .. }, _) => {
                    let mut still = moment.still(quality);
                    if point.is_of_room() {
                        let mut file =
                            scene::load(Path::new(&own.scene_file)).map_err(|e| CliError(e.to_string()))?;
                        if let Some(source) = &mut file.room {
                            point.put_over_room(source);
                        }
                        let mut place = file.scene.clone();
                        still.room = known_room::of_scene(&file, &mut place, &host())
                            .map_err(|e| CliError(e.to_string()))?;
                        still.scene.room = place.room;
                    }
                    Shot { still, before: before(moment) }
                }
            };
            shots.push((point.clone(), shot));
        }
        Ok(shots)
    }
}

/// The stages before drawing.
fn before(moment: &Moment) -> Vec<(&'static str, f32)> {
    let drawn = |s: &Stage| matches!(s, Stage::Relight | Stage::Frame);
    Stage::ALL.iter().zip(moment.stage_ms).filter(|(s, _)| !drawn(s)).map(|(s, ms)| (s.name(), ms)).collect()
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned())
}
