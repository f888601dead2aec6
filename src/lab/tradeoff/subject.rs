//! What is drawn: a reference case, a scene file, or a moment of a recording, each with its truth.

use super::axes::{AccuracyAxis, CalledForBy, TriedPoint};
use super::{
    errors::PictureTruth,
    study::Bench,
    truth::{self, TruthTrace},
};
use crate::assets::scene::{self, SceneFile};
use crate::case::{self, CaseStills, default_image};
use crate::config::Settings;
use crate::daemon::{host::Host, known_room};
use crate::error::LabError;
use crate::model::response::Response;
use crate::pipeline::frame::Stage;
use crate::still::{
    Composition, Still, compose_scene, far_light::KnownLight, moment::RecordedMoment, traced::LightOf,
};
use std::path::{Path, PathBuf};

/// Where stills come from.
enum StillsOf {
    Case(Box<CaseStills>),
    Scene {
        file: Box<SceneFile>,
        /// Kept where its light was measured: reading its pictures again for each point takes long.
        composition: Option<Box<Composition>>,
    },
    Moment {
        moment: Box<RecordedMoment>,
        settings: Box<Settings>,
        frame: u64,
    },
}

/// One thing that is drawn with many settings.
pub struct StudySubject {
    /// For people.
    pub name: String,
    /// What pictures are held against.
    pub truth: PictureTruth,
    /// What goes on tracing the truth; none where a case came with its own.
    trace: Option<TruthTrace>,
    stills: StillsOf,
    in_room: bool,
    response: Response,
    exposure_s: f64,
}

/// A still, and what a frame takes besides drawing it.
pub struct SubjectShot {
    /// To be drawn.
    pub still: Still,
    /// Stages before drawing, milliseconds; empty where no frames went through a pipeline.
    pub before: Vec<(&'static str, f32)>,
}

/// What a person asks for besides the files.
pub struct SubjectChoice<'a> {
    /// Scene files for recordings.
    pub scenes: &'a [PathBuf],
    /// The frame of a recording, counted from 0.
    pub frame: u64,
    /// Rays a pixel that truths which are traced here begin with.
    pub samples: usize,
}

impl StudySubject {
    /// All subjects that one input stands for: a recording is one with each scene.
    ///
    /// # Errors
    /// A file that cannot be read, or that no still can be made of.
    pub fn of(
        input: &Path,
        choice: &SubjectChoice<'_>,
        bench: &mut Bench<'_>,
    ) -> Result<Vec<Self>, LabError> {
        let ends_in = |e: &str| input.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
        let text = input.to_string_lossy();
        if let Some((recording, scene)) = text.split_once('@') {
            return Ok(vec![Self::of_recording(Path::new(recording), Path::new(scene), choice, bench)?]);
        }
        if ends_in("toml") {
            return Ok(vec![Self::of_scene(input, choice, bench)?]);
        }
        if ends_in("mcap") || text.contains(':') {
            if choice.scenes.is_empty() {
                let why = "--scene FILE is missing: what is drawn into the recording";
                return Err(LabError::on(input.display(), why));
            }
            return choice
                .scenes
                .iter()
                .map(|scene| Self::of_recording(input, scene, choice, bench))
                .collect();
        }
        Ok(vec![Self::of_case(input, bench)?])
    }

    fn of_case(input: &Path, bench: &Bench<'_>) -> Result<Self, LabError> {
        let case = case::load(input)?;
        let image = default_image(&case)?;
        let stills = CaseStills::new(&case, &image)?;
        let still = stills.still(&bench.base.quality, &bench.host);
        let truth = truth::of_case(&case, &image, &still)?;
        Ok(Self::new(case.id.clone(), (truth, None), StillsOf::Case(Box::new(stills)), &still))
    }

    fn of_scene(input: &Path, choice: &SubjectChoice<'_>, bench: &mut Bench<'_>) -> Result<Self, LabError> {
        let file = scene::load(input)?;
        let quality = &bench.base.quality;
        let composition = compose_scene(&file, bench.engine, quality, &bench.host, &mut Vec::new())?;
        let still = composition.still(quality, &bench.host);
        let truth = traced(&still, LightOf::File(&file), choice, bench)?;
        let was_measured =
            composition.room.is_none() && matches!(composition.far.known, KnownLight::Picture { .. });
        let composition = was_measured.then(|| Box::new(composition));
        Ok(Self::new(stem(input), truth, StillsOf::Scene { file: Box::new(file), composition }, &still))
    }

    fn of_recording(
        input: &Path,
        scene: &Path,
        choice: &SubjectChoice<'_>,
        bench: &Bench<'_>,
    ) -> Result<Self, LabError> {
        let settings = Settings {
            camera: match input.display().to_string() {
                device if device.contains(':') => device,
                file => format!("replay:{file}"),
            },
            scene_file: scene.display().to_string(),
            ..bench.base.clone()
        };
        let moment = Box::new(RecordedMoment::of(&settings, choice.frame, &bench.host)?);
        let still = moment.composition.still(&settings.quality, &bench.host);
        let truth = traced(&still, LightOf::Samples, choice, bench)?;
        let stills = StillsOf::Moment { moment, settings: Box::new(settings), frame: choice.frame };
        Ok(Self::new(format!("{} in {}", stem(scene), stem(input)), truth, stills, &still))
    }

    fn new(
        name: String,
        (truth, trace): (PictureTruth, Option<TruthTrace>),
        stills: StillsOf,
        still: &Still,
    ) -> Self {
        let (in_room, response) = (still.room.is_some(), still.response.clone());
        Self { name, truth, trace, stills, in_room, response, exposure_s: still.shown_exposure_s() }
    }

    /// Rays a pixel of the truth so far; none where it was not traced here.
    pub fn truth_samples(&self) -> Option<usize> {
        self.trace.as_ref().map(TruthTrace::samples)
    }

    /// Traces the truth on, until it has so many rays a pixel. Errors that were measured before are those of the older truth.
    ///
    /// # Errors
    /// A number of rays out of range.
    pub fn trace_on(&mut self, samples: usize, host: &Host<'_>) -> Result<(), LabError> {
        if let Some(trace) = &mut self.trace {
            let task = host.progress.begin("the truth");
            self.truth = trace.trace_to(samples, &|share| task.reach(share))?;
        }
        Ok(())
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
    pub fn calls_for(&self, axis: &AccuracyAxis) -> bool {
        match axis.called_for_by {
            CalledForBy::Any => true,
            CalledForBy::FarLight => !self.in_room,
            // A case's light is given with its geometry: nothing is left of it for settings of scene files.
            CalledForBy::Room => self.in_room && !matches!(self.stills, StillsOf::Case(_)),
            CalledForBy::Recording => matches!(self.stills, StillsOf::Moment { .. }),
        }
    }

    /// The stills of some points, each with its point. Points whose settings leave a recording without pose or light have
    /// none. What was warned of when the subject was opened is not said again.
    ///
    /// # Errors
    /// A file that can no longer be read; a value that the settings do not allow.
    pub fn shots(
        &self,
        points: &[TriedPoint],
        bench: &mut Bench<'_>,
    ) -> Result<Vec<(TriedPoint, SubjectShot)>, LabError> {
        let quiet = tracing::subscriber::NoSubscriber::default();
        tracing::subscriber::with_default(quiet, || {
            let mut shots = Vec::with_capacity(points.len());
            for point in points {
                shots.extend(self.shot(point, bench)?.map(|shot| (point.clone(), shot)));
            }
            Ok(shots)
        })
    }

    fn shot(&self, point: &TriedPoint, bench: &mut Bench<'_>) -> Result<Option<SubjectShot>, LabError> {
        let quality = bench.settings_of(point)?.quality;
        let host = bench.host;
        let drawn_alone = |still: Still| Some(SubjectShot { still, before: Vec::new() });
        Ok(match &self.stills {
            StillsOf::Case(stills) => drawn_alone(stills.still(&quality, &host)),
            StillsOf::Scene { composition: Some(composition), .. } => {
                drawn_alone(composition.still(&quality, &host))
            }
            StillsOf::Scene { file, .. } => {
                let mut file = file.clone();
                if let Some(source) = &mut file.room {
                    point.put_over_room(source);
                }
                let composed = compose_scene(&file, bench.engine, &quality, &host, &mut Vec::new())?;
                drawn_alone(composed.still(&quality, &host))
            }
            StillsOf::Moment { settings, frame, .. } if point.is_of_recording() => {
                let mut settings = (**settings).clone();
                point.put_over(&mut settings)?;
                let Ok(moment) = RecordedMoment::of(&settings, *frame, &host) else { return Ok(None) };
                Some(SubjectShot {
                    still: moment.composition.still(&quality, &host),
                    before: before(&moment),
                })
            }
            StillsOf::Moment { moment, settings, .. } => {
                let still = match point.is_of_room() {
                    true => {
                        let mut composition = moment.composition.clone();
                        prepare_room_again(&mut composition, settings, point, &host)?;
                        composition.still(&quality, &host)
                    }
                    false => moment.composition.still(&quality, &host),
                };
                Some(SubjectShot { still, before: before(moment) })
            }
        })
    }
}

/// Prepares a moment's room as a point says.
fn prepare_room_again(
    composition: &mut Composition,
    settings: &Settings,
    point: &TriedPoint,
    host: &Host<'_>,
) -> Result<(), LabError> {
    let mut file = scene::load(Path::new(&settings.scene_file))?;
    if let Some(source) = &mut file.room {
        point.put_over_room(source);
    }
    let mut place = file.scene.clone();
    composition.room = known_room::of_scene(&file, &mut place, host)?;
    composition.scene.room = place.room;
    Ok(())
}

/// The truth of a still, traced here.
fn traced(
    still: &Still,
    light: LightOf<'_>,
    choice: &SubjectChoice<'_>,
    bench: &Bench<'_>,
) -> Result<(PictureTruth, Option<TruthTrace>), LabError> {
    let task = bench.host.progress.begin("the truth");
    let mut trace = TruthTrace::begin(still, light, &bench.base.quality, choice.samples)?;
    let truth = trace.trace_to(choice.samples, &|share| task.reach(share))?;
    Ok((truth, Some(trace)))
}

/// The stages before drawing.
fn before(moment: &RecordedMoment) -> Vec<(&'static str, f32)> {
    let drawn = |s: &Stage| matches!(s, Stage::Relight | Stage::Frame);
    Stage::ALL.iter().zip(moment.stage_ms).filter(|(s, _)| !drawn(s)).map(|(s, ms)| (s.name(), ms)).collect()
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned())
}
