//! The pipeline's own code and the kernels of the CPU engine allocate nothing per frame in steady state.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/sys.rs"]
mod sys;

use halflight::config::Settings;
use halflight::daemon::run::prepare;
use halflight::model::time::Timestamp;

const WARM_UP: usize = 24;
const MEASURED: usize = 24;

/// Allocations a frame that are not ours: the AprilTag crate makes a list for each call and wrappers for its pictures,
/// and rayon's queue grows by blocks now and then; 2 were measured.
const OF_LIBRARIES: usize = 3;

#[test]
fn a_frame_in_steady_state_allocates_only_in_libraries() {
    let settings = Settings {
        camera: "synthetic:frames=48,size=320x240,texel_mm=8".into(),
        scene_file: concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml").into(),
        exposures_s: vec![1.0 / 4500.0, 1.0 / 500.0, 1.0 / 60.0],
        threads: 1,
        ..Settings::default()
    };
    let mut prepared = prepare(&settings).unwrap();
    let frames: Vec<_> =
        (0..WARM_UP + MEASURED).map(|_| prepared.source.next_frame(Timestamp(i64::MAX)).unwrap()).collect();
    let mut relit = 0;
    for frame in &frames[..WARM_UP] {
        prepared.pipeline.frame(frame).unwrap();
    }
    let mut worst = 0;
    for frame in &frames[WARM_UP..] {
        let before = sys::allocations();
        let outcome = prepared.pipeline.frame(frame).unwrap();
        worst = worst.max(sys::allocations() - before);
        relit += usize::from(!outcome.shown.is_passed_through());
    }
    println!("at most {worst} allocations a frame, {relit} of {MEASURED} frames relit");
    assert!(relit > MEASURED / 2, "{relit}");
    assert!(worst <= OF_LIBRARIES, "{worst}");
}
