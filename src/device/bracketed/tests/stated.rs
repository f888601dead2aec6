//! Cameras whose frames state their exposure (libcamera): the response is found, and the exposures follow the scene.

use super::finding::{distance, response};
use super::*;

/// A sensor that has what was asked for some frames later, and says so. It does nothing shorter than its shortest time.
struct StatingCamera {
    inner: SlowCamera,
    cycle: Vec<Exposure>,
    turn: usize,
    on_their_way: VecDeque<Exposure>,
    shortest_s: f64,
}

impl StatingCamera {
    fn new(inner: SlowCamera) -> Self {
        let first = inner.in_force;
        let on_their_way = std::iter::repeat_n(first, inner.delay + 1).collect();
        Self { inner, cycle: vec![first], turn: 0, on_their_way, shortest_s: 1e-4 }
    }
}

impl CaptureSource for StatingCamera {
    fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
        let asked = self.cycle[self.turn % self.cycle.len()];
        self.turn += 1;
        self.on_their_way.push_back(Exposure { time_s: asked.time_s.max(self.shortest_s), ..asked });
        self.inner.in_force = self.on_their_way.pop_front().unwrap();
        self.inner.told = self.inner.in_force;
        self.inner.next(deadline)
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        (self.cycle, self.turn) = (exposures.to_vec(), 0);
        Ok(exposures.to_vec())
    }

    fn rig(&self) -> Option<Rig> {
        None
    }
}

impl ExposureControl for StatingCamera {
    fn write_exposure(&mut self, _wish: Exposure) -> Result<Exposure, DeviceError> {
        panic!("nobody writes what requests ask for");
    }

    fn can_be_written(&self) -> bool {
        false
    }

    fn states_exposures(&self) -> bool {
        true
    }

    fn times_are_starts(&self) -> bool {
        true
    }

    fn exposure_limits(&self) -> Option<Limits> {
        self.inner.exposure_limits()
    }
}

#[test]
fn the_response_is_found_from_stated_exposures() {
    for seed in 0..12 {
        let inner = SlowCamera { response: response(seed), ..SlowCamera::new((seed % 8) as usize, false) };
        let mut camera = camera_with(StatingCamera::new(inner), CameraResponse::default());
        assert_eq!(camera.set_exposures(&cycle()).unwrap(), cycle());
        let mut exposures = Vec::new();
        let mut first = None;
        for _ in 0..30 {
            let frame = camera.next(Timestamp::NEVER).unwrap();
            let truth = camera.camera.source_mut().inner.truth[frame.sequence as usize];
            assert_eq!(frame.exposure, truth, "seed {seed}");
            let found = frame.response.as_deref().expect("a response was found");
            let (rms, worst) = distance(found, &response(seed));
            assert!(rms < 0.025, "seed {seed}: {rms:.4} rms, {worst:.3} at worst");
            exposures.push(frame.exposure);
            first.get_or_insert(frame.sequence);
        }
        // At most nine exposures, each awaited once.
        let delay = seed % 8;
        assert!(first.unwrap() <= 9 * (delay + 2) + 2, "seed {seed}: {first:?}");
        assert!(cycle().iter().all(|e| exposures[20..].contains(e)), "seed {seed}: {exposures:?}");
    }
}

#[test]
fn a_sensor_that_cannot_go_as_short_as_asked_ends_the_search_there() {
    let inner = SlowCamera { response: response(3), ..SlowCamera::new(2, false) };
    let stating = StatingCamera { shortest_s: 0.003, ..StatingCamera::new(inner) };
    let mut camera = camera_with(stating, CameraResponse::default());
    camera.set_exposures(&cycle()).unwrap();
    let frame = camera.next(Timestamp::NEVER).unwrap();
    let (rms, _) = distance(frame.response.as_deref().expect("a response was found"), &response(3));
    assert!(rms < 0.06, "{rms:.4}");
}

#[test]
fn in_the_dark_it_is_looked_for_later() {
    let inner = SlowCamera { light: 0.0, ..SlowCamera::new(1, false) };
    let mut camera = camera_with(StatingCamera::new(inner), CameraResponse::default());
    camera.set_exposures(&cycle()).unwrap();
    assert!(camera.next(Timestamp::NEVER).unwrap().response.is_none());
    camera.camera.source_mut().inner.light = 1.0;
    let comes = (0..2 * TRY_AGAIN_AFTER).any(|_| camera.next(Timestamp::NEVER).unwrap().response.is_some());
    assert!(comes);
}

#[test]
fn stated_exposures_follow_the_scene() {
    for light in [0.2, 5.0] {
        let stated = CameraResponse::Stated(Box::new(Response::srgb()));
        let camera = camera_with(StatingCamera::new(SlowCamera::new(3, false)), stated);
        let mut camera = camera.replanning(Some(Replan { mains: None }));
        camera.set_exposures(&cycle()).unwrap();
        let spread = |camera: &mut BracketedCamera<StatingCamera>| {
            let times: Vec<f64> =
                (0..200).map(|_| camera.next(Timestamp::NEVER).unwrap().exposure.time_s).collect();
            let mut newest = times[190..].to_vec();
            newest.sort_by(f64::total_cmp);
            newest[0]
        };
        let before = spread(&mut camera);
        camera.camera.source_mut().inner.light = light;
        let after = spread(&mut camera);
        // The shortest exposure keeps the lights below saturation: it goes with the light.
        let ratio = before / after / light;
        assert!((0.6..1.6).contains(&ratio), "{light}: {before} s to {after} s");
    }
}
