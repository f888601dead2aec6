//! What `measured` tells of a simulated camera, through the trait alone.

use super::finding::response;
use super::*;
use crate::Signal;
use crate::measured::{Patience, latency_of, response_of};

fn waiting<T>(of: impl FnOnce(&Patience<'_>) -> T) -> T {
    let (clock, stop) = (ManualClock::default(), Signal::default());
    of(&Patience { device: "slow", clock: &clock, stop: &stop })
}

#[test]
fn a_response_is_found_and_its_accuracy_told() {
    for seed in 0..3 {
        let slow = SlowCamera { response: response(seed), ..SlowCamera::new(2, false) };
        let mut frames: Box<dyn FrameSource> = Box::new(camera_with(slow, CameraResponse::default()));
        let found = waiting(|w| response_of(frames.as_mut(), &cycle(), w)).unwrap().unwrap();
        let worst = found.worst().unwrap();
        println!("seed {seed}: worst exposure {:.1} % off, after {} frames", 100.0 * worst, found.frames);
        assert_eq!(found.checked.len(), 3);
        assert!(worst < 0.06, "{found:?}");
    }
}

#[test]
fn a_camera_that_tells_no_response_is_refused_with_what_to_do() {
    let fixed = SlowCamera { has_control: false, ..SlowCamera::new(2, false) };
    let of = |slow| {
        let mut camera = camera_with(slow, CameraResponse::default());
        waiting(|w| response_of(&mut camera, &cycle(), w)).unwrap_err().to_string()
    };
    assert!(of(fixed).contains("cannot be set"));
    let fading = SlowCamera { light_changes: 1.03, ..SlowCamera::new(2, false) };
    assert!(of(SlowCamera { response: response(30), ..fading }).contains("at rest"));
}

#[test]
fn the_delay_of_the_control_is_told() {
    for delay in [0usize, 3] {
        let mut camera = camera(SlowCamera::new(delay, false));
        let mut count = 0;
        let report = waiting(|w| latency_of(&mut camera, &cycle(), 200, w, || count += 1)).unwrap().unwrap();
        assert_eq!(count, 200);
        assert!(report.delays[delay] > 0.95, "{report:?}");
        assert!(report.lost == 0 && report.altered_writes == 0 && report.sure >= 200, "{report:?}");
    }
    let fixed = SlowCamera { has_control: false, ..SlowCamera::new(2, false) };
    let error = waiting(|w| latency_of(&mut camera(fixed), &cycle(), 20, w, || {})).unwrap_err().to_string();
    assert!(error.contains("no delay to measure"), "{error}");
    let (clock, stop) = (ManualClock::default(), Signal::default());
    stop.raise();
    let stopped = Patience { device: "slow", clock: &clock, stop: &stop };
    let mut camera = camera(SlowCamera::new(1, false));
    assert_eq!(latency_of(&mut camera, &cycle(), 9, &stopped, || {}).unwrap(), None);
}
