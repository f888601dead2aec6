//! The loop around the scheduler on a simulated driver.

mod finding;
mod fitting;
mod measuring;
mod stated;

use super::*;
use crate::Clock;
use crate::clock::ManualClock;
use crate::hdr::develop::SensorOptions;
use crate::math::dice::Dice;
use crate::model::{frame::CapturedFrame, image::Rgb8Image};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// A driver whose writes are in force `delay` frames after the next, or one more; its clock tells starts of exposures.
struct SlowCamera {
    delay: usize,
    may_be_late: bool,
    has_control: bool,
    dice: Dice,
    written: VecDeque<(Exposure, usize)>,
    in_force: Exposure,
    told: Exposure,
    clock: ManualClock,
    made: u64,
    truth: Vec<Exposure>,
    response: Response,
    /// Light of the scene against the usual; changes by this factor with each frame.
    light: f64,
    light_changes: f64,
    /// The picture moves by so many columns a frame.
    moves: usize,
    name: String,
}

impl SlowCamera {
    fn new(delay: usize, may_be_late: bool) -> Self {
        let first = Exposure { time_s: 0.01, gain: 1.0 };
        Self {
            delay,
            may_be_late,
            has_control: true,
            dice: Dice::new(delay as u64 + 11),
            written: VecDeque::new(),
            in_force: first,
            told: first,
            clock: ManualClock::default(),
            made: 0,
            truth: Vec::new(),
            response: Response::srgb(),
            light: 1.0,
            light_changes: 1.0,
            moves: 0,
            name: String::new(),
        }
    }

    fn picture(&mut self) -> Rgb8Image {
        self.light *= self.light_changes;
        let exposure = self.light * self.in_force.effective_s();
        let shift = self.moves * self.made as usize;
        let mut picture = Rgb8Image::default();
        picture.reshape(WIDTH, HEIGHT, [0; 3]);
        for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
            let (x, y) = ((i + shift) % WIDTH, i / WIDTH);
            let radiance = 3.0 * (((x / 8 * 7 + y / 8 * 5) % 23) as f64 / 5.0 + (x % 8) as f64 / 40.0).exp();
            *pixel = std::array::from_fn(|c| {
                let tint = [1.0, 0.9, 0.7][c];
                let noisy = tint * radiance * exposure * (1.0 + 0.01 * self.dice.normal());
                self.response.value_of(c, noisy as f32).round().clamp(0.0, 255.0) as u8
            });
        }
        picture
    }
}

impl CaptureSource for SlowCamera {
    fn next(&mut self, _deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
        for (_, left) in &mut self.written {
            *left = left.saturating_sub(1);
        }
        while self.written.front().is_some_and(|(_, left)| *left == 0) {
            self.in_force = self.written.pop_front().unwrap().0;
        }
        let pixels = self.picture().into();
        self.truth.push(self.in_force);
        let sequence = self.made;
        self.made += 1;
        self.clock.wait_until(Timestamp(33_333_333 * self.made as i64));
        let t_mid = Timestamp(self.clock.now().0 + (0.5e9 * self.told.time_s) as i64);
        Ok(CapturedFrame { sequence, t_mid, exposure: self.told, pixels })
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        Ok(if self.has_control { exposures.to_vec() } else { vec![self.told] })
    }

    fn rig(&self) -> Option<Rig> {
        None
    }

    fn identity(&self) -> String {
        self.name.clone()
    }
}

impl ExposureControl for SlowCamera {
    fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError> {
        let late = usize::from(self.may_be_late && self.dice.unit() < 0.1);
        self.written.push_back((wish, 1 + self.delay + late));
        self.told = wish;
        Ok(wish)
    }

    fn can_be_written(&self) -> bool {
        self.has_control
    }

    fn times_are_starts(&self) -> bool {
        true
    }

    fn exposure_limits(&self) -> Option<Limits> {
        self.has_control.then_some(Limits {
            least_s: 1e-4,
            most_s: 0.5,
            step_s: 1e-4,
            frame_interval_s: 1.0 / 30.0,
            gain: 1.0,
            mains: None,
        })
    }
}

fn camera_with<S: CaptureSource + ExposureControl>(slow: S, response: CameraResponse) -> BracketedCamera<S> {
    let developed =
        DevelopedCamera::new("slow", slow, response.at_first(), SensorOptions::default()).unwrap();
    BracketedCamera::new("slow", developed, response)
}

fn camera<S: CaptureSource + ExposureControl>(slow: S) -> BracketedCamera<S> {
    camera_with(slow, CameraResponse::Stated(Box::new(Response::srgb())))
}

fn cycle() -> Vec<Exposure> {
    [0.001, 0.0037, 0.0185].map(|time_s| Exposure { time_s, gain: 1.0 }).to_vec()
}

#[test]
fn every_frame_that_is_handed_on_has_its_own_exposure() {
    for (delay, may_be_late) in [(0, false), (2, false), (3, true), (5, true)] {
        let mut camera = camera(SlowCamera::new(delay, may_be_late));
        camera.set_exposures(&cycle()).unwrap();
        let mut newest = Timestamp(-1);
        let mut seen = 0;
        for _ in 0..400 {
            let frame = camera.next(Timestamp::NEVER).unwrap();
            let source = camera.camera.source_mut();
            assert_eq!(frame.exposure, source.truth[frame.sequence as usize], "delay {delay}");
            assert!(frame.t_mid > newest);
            newest = frame.t_mid;
            let start = 33_333_333 * (frame.sequence as i64 + 1);
            assert!((frame.t_mid.0 - start - (0.5e9 * frame.exposure.time_s) as i64).abs() < 2);
            seen += 1;
        }
        let made = camera.camera.source_mut().made;
        // Nearly every frame of 30 a second is of use: nobody waits for the sensor.
        assert!(seen as f64 > 0.9 * made as f64, "delay {delay}: {seen} of {made}");
        assert_eq!(camera.counts().known, seen + camera.ready.len() as u64);
    }
}

#[test]
fn a_camera_whose_exposure_cannot_be_set_gives_every_frame() {
    let mut camera = camera(SlowCamera { has_control: false, ..SlowCamera::new(0, false) });
    assert_eq!(camera.set_exposures(&cycle()).unwrap().len(), 1);
    for k in 0..10 {
        assert_eq!(camera.next(Timestamp::NEVER).unwrap().sequence, k);
    }
    assert_eq!(camera.report(), None);
}

#[test]
fn where_nothing_can_be_told_it_goes_on_with_one_exposure() {
    // A driver that takes writes and never does them.
    let mut camera = camera(SlowCamera { delay: usize::MAX / 2, ..SlowCamera::new(0, false) });
    camera.set_exposures(&cycle()).unwrap();
    assert!(camera.next(Timestamp::NEVER).is_ok());
    assert_eq!(camera.scheduler.as_ref().unwrap().cycle().len(), 1);
}

#[test]
fn a_camera_that_is_still_being_measured_is_not_silent() {
    /// A camera that gives one frame, then nothing by the deadline.
    struct OneByOne(SlowCamera, bool);
    impl CaptureSource for OneByOne {
        fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
            self.1 = !self.1;
            if self.1 { self.0.next(deadline) } else { Err(DeviceError::again()) }
        }

        fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
            self.0.set_exposures(exposures)
        }

        fn rig(&self) -> Option<Rig> {
            None
        }
    }
    impl ExposureControl for OneByOne {
        fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError> {
            self.0.write_exposure(wish)
        }

        fn can_be_written(&self) -> bool {
            true
        }

        fn times_are_starts(&self) -> bool {
            true
        }
    }
    let mut camera = camera(OneByOne(SlowCamera::new(3, false), false));
    camera.set_exposures(&cycle()).unwrap();
    let first = camera.next(Timestamp(0)).unwrap_err();
    assert_eq!(first.kind, ErrorKind::Working);
}
