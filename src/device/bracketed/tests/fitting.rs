//! Exposures follow the scene's light while the camera runs.

use super::*;

/// Shares of saturated and of dark values in the shortest and the longest exposure of the newest frames.
fn ends(camera: &mut BracketedCamera<SlowCamera>, frames: usize) -> (f64, f64) {
    let mut seen: Vec<(f64, f64, f64)> = Vec::new();
    for _ in 0..frames {
        let frame = camera.next(Timestamp::NEVER).unwrap();
        let truth = camera.camera.source_mut().truth[frame.sequence as usize];
        assert!((frame.exposure.effective_s() / truth.effective_s()).ln().abs() < 1e-3);
        let pixels = frame.pixels.pixels();
        let share = |is: &dyn Fn(u8) -> bool| {
            pixels.iter().filter(|p| is(p.iter().copied().max().unwrap_or(0))).count() as f64
                / pixels.len() as f64
        };
        seen.push((frame.exposure.effective_s(), share(&|z| z >= 250), share(&|z| z <= 12)));
    }
    let newest = &seen[seen.len() - 12..];
    let shortest = newest.iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    let longest = newest.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    (shortest.1, longest.2)
}

#[test]
fn exposures_are_fitted_to_light_that_is_bright_and_then_dim() {
    for (seed, lights) in [(3, [8.0, 0.6]), (4, [0.5, 6.0]), (5, [3.0, 20.0])] {
        let slow = SlowCamera { light: lights[0], ..SlowCamera::new(seed, false) };
        let mut camera = camera(slow).replanning(Some(Replan::default()));
        camera.set_exposures(&cycle()).unwrap();
        for light in lights {
            camera.camera.source_mut().light = light;
            let (saturated, dark) = ends(&mut camera, 400);
            assert!(saturated < 0.002 && dark < 0.02, "light {light}: {saturated} saturated, {dark} dark");
        }
        // As they were asked for they would not do.
        let mut fixed = self::camera(SlowCamera { light: lights[0], ..SlowCamera::new(seed, false) });
        fixed.set_exposures(&cycle()).unwrap();
        let misses = lights.map(|light| {
            fixed.camera.source_mut().light = light;
            ends(&mut fixed, 60)
        });
        assert!(misses.iter().any(|(saturated, dark)| *saturated > 0.002 || *dark > 0.02), "{misses:?}");
    }
}

#[test]
fn exposures_stay_where_they_are_to_stay() {
    let mut camera = camera(SlowCamera { light: 20.0, ..SlowCamera::new(2, false) });
    camera.set_exposures(&cycle()).unwrap();
    for _ in 0..200 {
        let exposure = camera.next(Timestamp::NEVER).unwrap().exposure;
        assert!(cycle().contains(&exposure));
    }
}
