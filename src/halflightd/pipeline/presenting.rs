//! From estimates to the shown picture: plan, then draw.

use super::Options;
use crate::animate::posed::Posed;
use crate::device::bracket::MOST_EXPOSURES;
use crate::engine::{Engine, EngineError, RelightInput};
use crate::light::prefilter::WantedEnvironment;
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    environment::EnvironmentPicture,
    frame::{Exposure, RawFrame},
    image::HdrImage,
    light::{Lights, RadianceSh},
    picture::Picture,
    response::Response,
    scene::Scene,
    time::Timestamp,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{
    FramePlan,
    effects::{self, Occasion},
};
use crate::present::{
    hud::Hud,
    room_light::LightInRoom,
    views::{CameraFrame, Subject, Views},
};
use glam::Vec3;
use std::sync::Arc;

/// Gray of a picture before the first frame.
const BEFORE_THE_FIRST: [u8; 3] = [72; 3];

/// What a picture is drawn from, besides its pose.
#[derive(Clone, Copy)]
pub struct PictureParts<'a> {
    /// The camera's picture, linear.
    pub background: &'a HdrImage,
    /// Intrinsics and distortion, pixels.
    pub lens: &'a Lens,
    /// The way back to 8 bits.
    pub response: &'a Response,
    /// The light, where it is known; in a known room it is not asked for.
    pub light: Option<&'a Lights>,
    /// What mirrors and sharp gloss see, where the light was measured.
    pub environment: Option<&'a EnvironmentPicture>,
    /// Time of the frame.
    pub t: Timestamp,
    /// What of the frame matters to the picture.
    pub of_frame: CameraFrame<'a>,
}

/// Plans and draws.
pub struct Presenting {
    scene: Arc<Scene>,
    posed: Posed,
    /// The scene's time 0: the first picture's.
    start: Option<Timestamp>,
    nothing: Scene,
    plan: FramePlan,
    picture: Picture,
    shown_exposure: ShownExposure,
    views: Views,
    /// Text over the picture, where it is wanted.
    hud: Hud,
    /// The last picture with a text over it, for the time that no frame comes.
    held: Picture,
    held_text: Hud,
    /// The room that the scene stands in, which the engine was given.
    room: Option<LightInRoom>,
}

impl Presenting {
    /// Takes the scene that the engine was given, to plan with.
    pub fn new(scene: Arc<Scene>, options: &Options) -> Self {
        Self {
            posed: Posed::new(&scene),
            scene,
            start: None,
            nothing: Scene::default(),
            plan: FramePlan::default(),
            picture: Picture::default(),
            shown_exposure: ShownExposure::new(options),
            views: Views::keeping(),
            hud: Hud::default(),
            held: Picture::default(),
            held_text: Hud::default(),
            room: None,
        }
    }

    /// The known room that the scene stands in.
    pub fn take_room(&mut self, room: Arc<KnownRoom>) {
        self.room = Some(LightInRoom::new(room));
    }

    /// The known room that the scene stands in.
    pub fn room(&self) -> Option<&Arc<KnownRoom>> {
        self.room.as_ref().map(LightInRoom::known)
    }

    /// Whether the scene's light comes from a known room.
    pub fn has_room(&self) -> bool {
        self.room.is_some()
    }

    /// Chooses the exposure of shown pictures anew, where another one is asked for.
    pub fn choose_exposure(&mut self, options: &Options) {
        if self.shown_exposure.asked != options.shown_exposure {
            self.shown_exposure = ShownExposure::new(options);
        }
    }

    /// Draws another scene from now on, which the engine has to be given; time in it goes on.
    pub fn change_scene(&mut self, scene: Arc<Scene>) {
        self.scene = scene;
        self.posed = Posed::new(&self.scene);
        // Views that have a scene of their own make it from the new one.
        self.views = Views::keeping();
    }

    /// Looks at how well a frame is exposed (only during the first cycle of exposures).
    pub fn see(&mut self, frame: &RawFrame) {
        self.shown_exposure.see(frame);
    }

    /// Draws the virtual objects into the picture, as seen from a camera in that pose.
    pub fn relit(
        &mut self,
        engine: &mut dyn Engine,
        parts: &PictureParts<'_>,
        world_from_camera: &Pose,
        options: &Options,
    ) -> Result<(), EngineError> {
        let start = *self.start.get_or_insert(parts.t);
        self.posed.update(&self.scene, parts.t.seconds_since(start));
        let middle = self.room.as_ref().map_or(Vec3::ZERO, |_| self.middle_of_objects());
        let in_room = self.room.as_ref().map(|room| room.lights_at(middle));
        let no_light = || EngineError::Input("light not measured yet".into());
        let light = in_room.as_ref().or(parts.light).ok_or_else(no_light)?;
        let wanted = WantedEnvironment::by(&self.scene, light.global.order);
        let environment = match &mut self.room {
            Some(room) => room.picture_at(middle, wanted),
            None => parts.environment,
        };
        let input = RelightInput {
            background: parts.background,
            lens: parts.lens,
            world_from_camera,
            light,
            environment,
            posed: Some(&self.posed),
            response: parts.response,
            shown_exposure: self.shown_exposure.chosen,
            t: parts.t,
        };
        let subject = Subject {
            scene: &self.scene,
            input: &input,
            quality: &options.quality,
            samples: None,
            frame: Some(parts.of_frame),
        };
        self.views.draw(options.view, engine, &subject, &mut self.plan, &mut self.picture)
    }

    fn middle_of_objects(&self) -> Vec3 {
        let points = self.posed.objects().iter().flat_map(|o| &o.positions_world).filter(|p| p.is_finite());
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) = points.fold(start, |(low, high), p| (low.min(*p), high.max(*p)));
        if low.is_finite() { low.midpoint(high) } else { Vec3::ZERO }
    }

    /// The camera picture alone at the shown exposure; if even that fails, the frame as it came.
    pub fn passed_through(
        &mut self,
        engine: &mut dyn Engine,
        parts: &PictureParts<'_>,
        frame: &RawFrame,
        options: &Options,
    ) {
        let dark = Lights::soft(RadianceSh::zero(options.quality.sh_order));
        let occasion = Occasion {
            merge: true,
            ball: parts.of_frame.reads_ball,
            project: parts.of_frame.reads_ball,
            camera: Some((parts.lens, &Pose::IDENTITY)),
            camera_picture: parts.of_frame.shown_as_it_is.is_some(),
            ..Occasion::SHOW
        };
        effects::plan(&occasion, &self.nothing, &dark, &options.quality, &mut self.plan);
        let input = RelightInput {
            background: parts.background,
            lens: parts.lens,
            world_from_camera: &Pose::IDENTITY,
            light: &dark,
            environment: None,
            posed: None,
            response: parts.response,
            shown_exposure: self.shown_exposure.chosen,
            t: frame.t_mid,
        };
        let drawn = engine.relight(&self.plan, &input, &mut self.picture);
        if let Err(error) = &drawn {
            tracing::warn!("shown as it came: {error}");
        }
        if drawn.is_err() || self.plan.passes_through {
            self.copy(frame);
        }
    }

    /// The last picture with a text over it; plain gray, as large as the lens says, before the first.
    pub fn hold(&mut self, says: &str, lens: &Lens) -> &Picture {
        let (shown, held) = (&self.picture.display, &mut self.held);
        held.t = self.picture.t;
        if shown.pixels().is_empty() {
            let (width, height) = (lens.width as usize, lens.height as usize);
            held.display.reshape(width, height, BEFORE_THE_FIRST);
            held.display.pixels_mut().fill(BEFORE_THE_FIRST);
        } else {
            held.display.reshape(shown.width(), shown.height(), [0; 3]);
            held.display.pixels_mut().copy_from_slice(shown.pixels());
        }
        self.held_text.note(format_args!("{says}"));
        self.held_text.draw(&FramePlan::default(), &mut held.display);
        held
    }

    /// A line of text for the next picture that has text over it.
    pub fn note(&mut self, line: std::fmt::Arguments<'_>) {
        self.hud.note(line);
    }

    /// Lays the text over the picture, where it is wanted.
    pub fn lay_text_over(&mut self, is_wanted: bool) {
        if is_wanted {
            self.hud.draw(&self.plan, &mut self.picture.display);
        }
    }

    /// Whether the scene has no object, and a frame is exposed as pictures are shown.
    pub fn shows_nothing_virtual(&self, frame: &RawFrame) -> bool {
        let has_objects = self.scene.objects.iter().any(|o| !o.mesh.triangles.is_empty());
        !has_objects && frame.exposure == self.shown_exposure.chosen
    }

    /// The frame's own pixels, and nothing else.
    pub fn show_as_it_is(&mut self, lens: &Lens, frame: &RawFrame, options: &Options) {
        let dark = Lights::soft(RadianceSh::zero(options.quality.sh_order));
        let occasion =
            Occasion { camera: Some((lens, &Pose::IDENTITY)), camera_picture: true, ..Occasion::SHOW };
        effects::plan(&occasion, &self.nothing, &dark, &options.quality, &mut self.plan);
        self.copy(frame);
    }

    fn copy(&mut self, frame: &RawFrame) {
        self.picture.t = frame.t_mid;
        self.picture.display.reshape(frame.pixels.width(), frame.pixels.height(), [0; 3]);
        self.picture.display.pixels_mut().copy_from_slice(frame.pixels.pixels());
    }

    /// What is drawn.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The passes of the last picture.
    pub fn plan(&self) -> &FramePlan {
        &self.plan
    }

    /// What of a frame matters to the picture; `is_alone`: its pixels alone were merged.
    pub fn frame_of<'a>(&self, frame: &'a RawFrame, is_alone: bool, reads_ball: bool) -> CameraFrame<'a> {
        let is_shown = is_alone && frame.exposure == self.shown_exposure.chosen;
        CameraFrame { shown_as_it_is: is_shown.then_some(&*frame.pixels), reads_ball }
    }

    /// Exposure of the shown pictures.
    pub fn shown_exposure(&self) -> Exposure {
        self.shown_exposure.chosen
    }

    /// The last picture.
    pub fn picture(&self) -> &Picture {
        &self.picture
    }
}

/// Mean 8-bit value of a well exposed picture.
const WELL_EXPOSED: f64 = 110.0;

/// Which exposure the shown picture has: the one that was asked for, else the longest of the cycle (never black) until one cycle has been seen, then
/// the best exposed one. Where a camera goes over to other exposures the choice is made anew, and is gone over to slowly.
struct ShownExposure {
    asked: Option<Exposure>,
    chosen: Exposure,
    /// Where `chosen` goes.
    goal: Exposure,
    best: Exposure,
    /// Frames still to be looked at before the choice is made.
    frames_left: usize,
    /// How far the best exposure's picture was from well exposed.
    miss: f64,
    /// ln of the exposures that the choice was made from.
    known: [f64; MOST_EXPOSURES],
    in_cycle: usize,
    /// A choice was made before.
    has_chosen: bool,
}

/// Exposures nearer than this, ln, are one.
const SAME_EXPOSURE: f64 = 0.02;
/// Share of the way to another exposure that is gone with each frame.
const GOES_OVER: f64 = 0.1;

impl ShownExposure {
    fn new(options: &Options) -> Self {
        let chosen = options.shown_exposure.unwrap_or(options.longest_exposure);
        let in_cycle = options.exposures_in_cycle.clamp(1, MOST_EXPOSURES);
        let frames_left = if options.shown_exposure.is_some() { 0 } else { in_cycle };
        Self {
            asked: options.shown_exposure,
            chosen,
            goal: chosen,
            best: chosen,
            frames_left,
            miss: f64::INFINITY,
            known: [f64::NAN; MOST_EXPOSURES],
            in_cycle,
            has_chosen: frames_left == 0,
        }
    }

    fn see(&mut self, frame: &RawFrame) {
        let log = frame.exposure.effective_s().ln();
        let is_known = self.known.iter().any(|known| (known - log).abs() <= SAME_EXPOSURE);
        if self.frames_left == 0 && self.asked.is_none() && self.in_cycle > 1 && !is_known {
            (self.frames_left, self.miss) = (self.in_cycle, f64::INFINITY);
            self.known = [f64::NAN; MOST_EXPOSURES];
        }
        if self.frames_left > 0 {
            self.frames_left -= 1;
            self.known[self.frames_left] = log;
            self.judge(frame);
            if self.frames_left == 0 {
                self.goal = self.best;
            }
        }
        self.go_over(self.has_chosen);
        self.has_chosen |= self.frames_left == 0;
    }

    fn judge(&mut self, frame: &RawFrame) {
        let pixels = frame.pixels.pixels();
        // Every 61st pixel says enough about the mean.
        let (mut sum, mut count) = (0.0, 0.0);
        for pixel in pixels.iter().step_by(61) {
            sum += pixel.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0;
            count += 1.0;
        }
        let miss = (sum / f64::max(count, 1.0) - WELL_EXPOSED).abs();
        if miss < self.miss {
            self.miss = miss;
            self.best = frame.exposure;
        }
    }

    /// The first choice is taken at once.
    fn go_over(&mut self, slowly: bool) {
        let left = (self.goal.effective_s() / self.chosen.effective_s()).ln();
        if !slowly || !(left.abs() > SAME_EXPOSURE) {
            self.chosen = self.goal;
        } else {
            self.chosen = Exposure { time_s: self.chosen.time_s * (GOES_OVER * left).exp(), ..self.chosen };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::image::Rgb8Image;
    use std::sync::Arc;

    fn frame(time_s: f64, light: f64) -> RawFrame {
        let value = (255.0 * (light * time_s).powf(1.0 / 2.2)).clamp(0.0, 255.0) as u8;
        RawFrame {
            sequence: 0,
            t_mid: Timestamp(0),
            exposure: Exposure { time_s, gain: 1.0 },
            pixels: Arc::new(Rgb8Image::filled(64, 8, [value; 3])),
            row_time_s: 0.0,
            sensor: None,
            response: None,
        }
    }

    #[test]
    fn the_shown_exposure_follows_a_camera_that_goes_over_to_others() {
        let options = Options { exposures_in_cycle: 3, ..Options::default() };
        let mut shown = ShownExposure::new(&options);
        let mut see = |times: [f64; 3], light: f64, rounds: usize| {
            let mut largest = 0.0f64;
            for k in 0..3 * rounds {
                let before = shown.chosen.effective_s();
                shown.see(&frame(times[k % 3], light));
                if k >= 3 {
                    largest = largest.max((shown.chosen.effective_s() / before).ln().abs());
                }
            }
            (shown.chosen.effective_s(), largest)
        };
        // 0.16 of white is well exposed: value 110.
        let bright = [0.0005, 0.002, 0.008];
        assert_eq!(see(bright, 80.0, 40).0, 0.002);
        let (chosen, step) = see([0.004, 0.015, 0.06], 11.0, 40);
        assert!((chosen - 0.015).abs() < 0.0005, "{chosen}");
        assert!(step < 0.25, "it jumps by {step}");
        // The same exposures in other light: the camera has not gone over, and neither has the picture.
        assert!((see([0.004, 0.015, 0.06], 60.0, 40).0 - 0.015).abs() < 0.0005);
    }
}
