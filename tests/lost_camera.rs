//! A camera that is lost a thousand times at random, on a simulated clock: the loop goes on, the picture says so within three
//! frames, and is whole within a second of the return. Goes through the loop, the inbox in lockstep and the whole pipeline; the
//! device's own thread is tested in `lost_devices`.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::device::{
    Clock, DeviceError, ErrorKind, FrameSource,
    clock::{ManualClock, MonotonicClock},
    open,
};
use halflight::engine::cpu::CpuEngine;
use halflight::math::dice::Dice;
use halflight::model::{
    estimate::Provenance,
    frame::{Exposure, RawFrame},
    image::Rgb8Image,
    picture::Picture,
    quality::Quality,
    response::Response,
    rig::Rig,
    scene::Scene,
    time::Timestamp,
};
use halflight::pipeline::{
    Options, Pipeline, PipelineError,
    lockstep::{Lockstep, Reopen},
    turns::{FinishedFrame, FrameSink, RunCounts, run},
};
use std::sync::{Arc, Mutex};

const PERIOD_S: f64 = 1.0 / 30.0;
const LOSSES: u64 = 1000;

/// What the world does with the camera.
struct World {
    dice: Dice,
    losses: u64,
    sequence: u64,
    frame: RawFrame,
    /// When the newest frame was there, if the camera has been lost since.
    lost_since: Option<Timestamp>,
    /// When the camera was there again, until its next picture is shown.
    back_at: Option<Timestamp>,
    /// Worst times so far, seconds.
    said_after_s: f64,
    whole_after_s: f64,
}

/// The camera: opened anew after each loss.
struct Flaky {
    clock: ManualClock,
    world: Arc<Mutex<World>>,
    next_at: Timestamp,
    /// It gives nothing more until then, and then it is lost.
    silent_until: Option<Timestamp>,
    given: u64,
}

impl FrameSource for Flaky {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let world = &mut *self.world.lock().unwrap();
        if let Some(until) = self.silent_until {
            if until > deadline {
                self.clock.wait_until(deadline);
                return Err(DeviceError::again());
            }
            self.clock.wait_until(until);
            return Err(DeviceError::new("flaky", "read", ErrorKind::Reopen));
        }
        // The second frame is the first that can be missed: its pace is known then.
        if self.given >= 2 && world.dice.unit() < 0.4 {
            world.losses += 1;
            world.lost_since = Some(Timestamp(self.next_at.0).plus_seconds(-PERIOD_S));
            // One in three says nothing for a while first.
            if world.dice.unit() < 0.33 {
                let silence_s = world.dice.unit();
                self.silent_until = Some(self.clock.now().plus_seconds(silence_s));
                return Err(DeviceError::again());
            }
            return Err(DeviceError::new("flaky", "read", ErrorKind::Reopen));
        }
        if self.next_at > deadline {
            self.clock.wait_until(deadline);
            return Err(DeviceError::again());
        }
        if world.losses >= LOSSES {
            return Err(DeviceError::new("flaky", "go on", ErrorKind::Ended));
        }
        self.clock.wait_until(self.next_at);
        self.next_at = self.next_at.plus_seconds(PERIOD_S);
        self.given += 1;
        world.sequence += 1;
        Ok(RawFrame { sequence: world.sequence, t_mid: self.clock.now(), ..world.frame.clone() })
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        Ok(exposures.to_vec())
    }

    fn rig(&self) -> Option<Rig> {
        None
    }
}

/// What the viewer sees.
struct Viewer {
    clock: ManualClock,
    world: Arc<Mutex<World>>,
    last: Rgb8Image,
    whole: u64,
    open_files: Vec<Option<[usize; 2]>>,
}

impl FrameSink for Viewer {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        let now = self.clock.now();
        let world = &mut *self.world.lock().unwrap();
        assert!(world.lost_since.is_none(), "frames come while the camera is lost");
        let is_measured = finished.outcome.pose.is_some_and(|pose| pose.provenance == Provenance::Measured);
        let is_whole =
            is_measured && finished.outcome.light.is_some() && !finished.outcome.shown.is_passed_through();
        if is_whole {
            self.whole += 1;
            if let Some(back_at) = world.back_at.take() {
                world.whole_after_s = world.whole_after_s.max(now.seconds_since(back_at));
            }
        }
        self.last.clone_from(&finished.picture.display);
        Ok(true)
    }

    fn hold(&mut self, says: &str, picture: &Picture) -> Result<bool, PipelineError> {
        let now = self.clock.now();
        let world = &mut *self.world.lock().unwrap();
        let since = world.lost_since.expect("nothing is said while frames come");
        world.said_after_s = world.said_after_s.max(now.seconds_since(since));
        assert_eq!(says, "the camera is lost: waiting for it");
        // The last picture, with text in its corner.
        assert_eq!(picture.display.pixels().len(), self.last.pixels().len());
        assert_eq!(picture.display.pixels().last(), self.last.pixels().last());
        assert!(picture.display.pixels().contains(&[255; 3]) && picture.display != self.last);
        if world.losses.is_multiple_of(100) {
            self.open_files.push(descriptors_and_threads());
        }
        Ok(true)
    }
}

/// `None` where there is no such thing.
fn descriptors_and_threads() -> Option<[usize; 2]> {
    let entries = |of: &str| Some(std::fs::read_dir(format!("/proc/self/{of}")).ok()?.count());
    Some([entries("fd")?, entries("task")?])
}

/// A frame of the virtual room, with its rig.
fn a_frame() -> (RawFrame, Rig) {
    let mut source = open::open("synthetic:frames=2,size=192x144,texel_mm=8").unwrap().frames;
    source.set_exposures(&[Exposure { time_s: 0.002, gain: 1.0 }]).unwrap();
    let rig = source.rig().unwrap();
    (source.next(Timestamp::NEVER).unwrap(), rig)
}

#[test]
fn a_camera_that_is_lost_a_thousand_times_never_ends_the_loop() {
    let (frame, rig) = a_frame();
    let clock = ManualClock::default();
    let world = Arc::new(Mutex::new(World {
        dice: Dice::new(9),
        losses: 0,
        sequence: 0,
        frame,
        lost_since: None,
        back_at: None,
        said_after_s: 0.0,
        whole_after_s: 0.0,
    }));
    let (theirs, its_clock) = (Arc::clone(&world), clock.clone());
    let open = move || -> Result<Box<dyn FrameSource>, DeviceError> {
        let state = &mut *theirs.lock().unwrap();
        // It stays away for a while, now and then.
        if state.dice.unit() < 0.3 {
            return Err(DeviceError::new("flaky", "open", ErrorKind::Reopen));
        }
        state.lost_since = None;
        state.back_at = Some(its_clock.now());
        let (clock, world) = (its_clock.clone(), Arc::clone(&theirs));
        let next_at = clock.now().plus_seconds(PERIOD_S);
        Ok(Box::new(Flaky { clock, world, next_at, silent_until: None, given: 0 }))
    };
    let mut open: Reopen = Box::new(open);
    let first = loop {
        if let Ok(camera) = open() {
            break camera;
        }
    };
    // Merging and light by themselves are not what is tested: one frame a bracket, the light now and then.
    let quality = Quality { brackets: 1, light_every: 8, ..Quality::default() };
    let options = Options { quality, decimate: 1.0, ..Options::default() };
    let engine = Box::new(CpuEngine::new(Some(1)).unwrap());
    let watch = Box::new(MonotonicClock::default());
    let mut pipeline =
        Pipeline::new(engine, watch, rig, Response::srgb(), Scene::default(), options).unwrap();
    let mut viewer = Viewer {
        clock: clock.clone(),
        world: Arc::clone(&world),
        last: Rgb8Image::default(),
        whole: 0,
        open_files: Vec::new(),
    };
    let mut events = Lockstep::new(Arc::default(), first, None, clock).reopening(open);
    let RunCounts { frames, devices_lost, held, .. } =
        run(&mut events, &mut pipeline, &mut viewer, 0).expect("nothing of this ends the loop");
    let world = world.lock().unwrap();
    println!(
        "{frames} frames, {devices_lost} losses, said within {:.3} s, whole within {:.3} s",
        world.said_after_s, world.whole_after_s
    );
    assert!(devices_lost >= LOSSES && held >= LOSSES, "{devices_lost} {held}");
    assert!(world.said_after_s <= 3.0 * PERIOD_S + 1e-6, "{}", world.said_after_s);
    assert!(world.whole_after_s <= 1.0, "{}", world.whole_after_s);
    assert!(viewer.whole > frames * 9 / 10, "{} of {frames}", viewer.whole);
    // No descriptor and no thread stays behind.
    assert!(viewer.open_files.len() > 3, "{:?}", viewer.open_files);
    assert!(viewer.open_files.windows(2).all(|w| w[0] == w[1]), "{:?}", viewer.open_files);
}
