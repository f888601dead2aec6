//! Plans for scenes whose light is known.

use crate::bracket::plan::{BadLimits, Limits, Mains, Planner};
use crate::bracket::simulator::{Faults, SimulatedCamera};
use crate::bracket::*;
use crate::model::response::Response;
use proptest::prelude::*;

const UVC: Limits =
    Limits { least_s: 1e-4, most_s: 1.0, step_s: 1e-4, frame_interval_s: 1.0 / 30.0, gain: 1.0, mains: None };

/// A gray ramp whose radiance runs from `dark` to `bright`, seen with this exposure.
fn ramp(dark: f64, bright: f64, exposure: Exposure) -> Thumbnail {
    let response = Response::srgb();
    let values: Vec<u8> = (0..240 * 160)
        .map(|i| {
            let radiance = dark * (bright / dark).powf(f64::from(i % 240) / 239.0);
            response.value_of(1, (radiance * exposure.effective_s()) as f32).round() as u8
        })
        .collect();
    let mut thumbnail = Thumbnail::default();
    ThumbnailReader::new(&response).read_luminance(240, &values, &mut thumbnail);
    thumbnail
}

/// Shows the planner the scene for so many cycles; how often the plan changed.
fn watch(planner: &mut Planner, dark: f64, bright: f64, cycles: usize) -> u32 {
    let mut changes = 0;
    for _ in 0..cycles {
        let mut plan = [Exposure { time_s: 1.0, gain: 1.0 }; MOST_EXPOSURES];
        let count = planner.plan().len();
        plan[..count].copy_from_slice(planner.plan());
        for exposure in &plan[..count] {
            changes += u32::from(planner.observe(*exposure, &ramp(dark, bright, *exposure)));
        }
    }
    changes
}

#[test]
fn shadows_are_lifted_and_the_reflection_is_held() {
    let mut planner = Planner::new(3, UVC, &Response::srgb()).unwrap();
    watch(&mut planner, 1.0, 400.0, 100);
    let plan = planner.plan();
    let (short, long) = (ramp(1.0, 400.0, plan[0]), ramp(1.0, 400.0, plan[2]));
    let share = |counts: &[u32]| f64::from(counts.iter().sum::<u32>()) / 38400.0;
    assert!(share(&short.counts()[250..]) < 0.001, "{plan:?}");
    assert!(share(&long.counts()[..12]) < 0.01, "{plan:?}");
    assert!(planner.coverage().is_whole(), "{:?}", planner.coverage());
}

#[test]
fn a_plan_does_not_flutter_and_follows_what_lasts() {
    let mut planner = Planner::new(3, UVC, &Response::srgb()).unwrap();
    watch(&mut planner, 1.0, 400.0, 100);
    let plan = planner.plan().to_vec();
    for k in 0..100 {
        let light = if k % 5 == 0 { 1.3 } else { 0.95 };
        assert_eq!(watch(&mut planner, light, 400.0 * light, 1), 0);
    }
    // A flash of a few frames changes nothing either; light that stays does.
    assert_eq!(watch(&mut planner, 3.0, 1200.0, 3), 0);
    assert!(watch(&mut planner, 3.0, 1200.0, 60) > 0);
    assert!(planner.plan()[0].time_s < 0.6 * plan[0].time_s, "{plan:?} {:?}", planner.plan());
}

#[test]
fn what_the_control_cannot_cover_is_said() {
    let mut planner = Planner::new(3, UVC, &Response::srgb()).unwrap();
    watch(&mut planner, 0.01, 400.0, 100);
    let coverage = planner.coverage();
    // Value 32 of sRGB is 0.0144: 1.44 s for a radiance of 0.01, of which 1/30 s can be had.
    assert!(coverage.too_short > 3.0 && !coverage.is_whole(), "{coverage:?}");
    watch(&mut planner, 1.0, 1e6, 100);
    assert!(planner.coverage().too_long > 3.0);
    let mut two = Planner::new(2, UVC, &Response::srgb()).unwrap();
    watch(&mut two, 0.5, 5000.0, 100);
    assert!(two.coverage().too_far_apart > 3.0, "{:?} {:?}", two.plan(), two.coverage());
}

#[test]
fn times_are_multiples_of_the_light_of_lamps() {
    for (mains, period_s) in [(Mains::Hz50, 0.01), (Mains::Hz60, 1.0 / 120.0)] {
        let limits = Limits { mains: Some(mains), step_s: 0.0, ..UVC };
        let planner = Planner::new(3, limits, &Response::srgb()).unwrap();
        let longest = planner.plan()[2].time_s / period_s;
        assert!((longest - longest.round()).abs() < 1e-9 && longest.round() >= 3.0, "{longest}");
        assert!(planner.coverage().flickers, "the shortest cannot be long enough");
    }
}

#[test]
fn no_two_pairs_of_a_plan_have_one_ratio() {
    let planner = Planner::new(4, Limits { step_s: 0.0, ..UVC }, &Response::srgb()).unwrap();
    let logs: Vec<f64> = planner.plan().iter().map(|e| e.time_s.ln()).collect();
    let mut ratios: Vec<f64> =
        (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| logs[i] - logs[j]).collect();
    ratios.sort_by(f64::total_cmp);
    assert!(ratios.windows(2).all(|pair| pair[1] - pair[0] > 0.25), "{ratios:?}");
}

#[test]
fn a_plan_for_a_simulated_camera_is_followed_without_a_wrong_frame() {
    let mut camera = SimulatedCamera::new(5, Faults { delay: (2, 4), jitter: 0.2, ..Faults::default() });
    let mut planner = Planner::new(3, UVC, &Response::srgb()).unwrap();
    let mut scheduler = Scheduler::new(planner.plan()).unwrap();
    let mut seen = VecDeque::new();
    let mut thumbnail = Thumbnail::default();
    let (mut sure, mut changes) = (0, 0);
    for _ in 0..1500 {
        let frame = camera.next(&mut thumbnail);
        let (sequence, t) = (frame.sequence, frame.t);
        scheduler.frame(FrameSeen { sequence, t, stated: None, thumbnail: &thumbnail });
        seen.push_back((frame.truth, thumbnail.clone()));
        while let Some(settled) = scheduler.settled() {
            let (truth, small) = seen.pop_front().unwrap();
            let Attribution::Sure(exposure) = settled.attribution else { continue };
            assert!((exposure.effective_s() / truth.effective_s()).ln().abs() < 0.03);
            sure += 1;
            if planner.observe(exposure, &small) {
                changes += 1;
                scheduler.set_cycle(planner.plan()).unwrap();
            }
        }
        if let Some(asked) = scheduler.next_write(sequence) {
            let read_back = camera.write(asked);
            scheduler.written(asked, read_back, sequence);
        }
    }
    assert!(sure > 1200 && (1..8).contains(&changes), "{sure} sure, {changes} changes");
    assert!(planner.coverage().is_whole(), "{:?} {:?}", planner.plan(), planner.coverage());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn plans_keep_to_the_limits_whatever_they_are(
        count in 0..12usize,
        least in prop_oneof![Just(f64::NAN), Just(0.0), Just(1e300), 1e-6..0.1f64],
        most in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), 1e-6..1.0f64],
        step in prop_oneof![Just(f64::NAN), Just(0.0), Just(1e9), Just(1e-300), 1e-6..1e-2f64],
        gain in prop_oneof![Just(1.0), Just(0.0), Just(1e300)],
        fifty in any::<bool>(),
        value in any::<u8>(),
    ) {
        let mains = Some(if fifty { Mains::Hz50 } else { Mains::Hz60 });
        let limits = Limits { least_s: least, most_s: most, step_s: step, frame_interval_s: 0.05, gain, mains };
        match Planner::new(count, limits, &Response::srgb()) {
            Err(BadLimits::Count(n)) => prop_assert!(n == 0 || n > MOST_EXPOSURES),
            Err(BadLimits::Range { .. }) => {}
            Ok(mut planner) => {
                let mut thumbnail = Thumbnail::default();
                let mut reader = ThumbnailReader::new(&Response::srgb());
                reader.read_luminance(24, &[value; 24 * 16], &mut thumbnail);
                for _ in 0..30 {
                    for k in 0..count {
                        let exposure = planner.plan()[k];
                        planner.observe(exposure, &thumbnail);
                        let fits = exposure.time_s >= least * 0.999999
                            && exposure.time_s <= most.min(0.05) * 1.000001;
                        prop_assert!(fits, "{exposure:?} {limits:?}");
                    }
                }
                planner.observe(Exposure { time_s: f64::NAN, gain: 0.0 }, &thumbnail);
                prop_assert!(planner.coverage().too_long >= 1.0);
            }
        }
    }
}
