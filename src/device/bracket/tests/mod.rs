//! The scheduler by single cases; `soak` has the many.

mod plan;
mod soak;

use super::simulator::{Faults, Metadata, SimulatedCamera};
use super::*;
use crate::hdr::sliding::SlidingMerge;
use crate::model::{frame::RawFrame, image::Rgb8Image};
use halflight_math::{dice::Dice, lens::Lens};
use proptest::prelude::*;
use soak::{exposures, run};
use std::sync::Arc;

const CYCLE_S: [f64; 3] = [0.001, 0.004, 0.016];

fn uvc() -> Faults {
    Faults { delay: (2, 4), jitter: 0.2, step_s: 1e-4, ..Faults::default() }
}

#[test]
fn three_exposures_at_30_fps_give_30_merges_a_second() {
    let mut camera = SimulatedCamera::new(11, Faults { delay: (3, 3), ..Faults::default() });
    let mut scheduler = Scheduler::new(&exposures(&CYCLE_S)).unwrap();
    let mut ring = SlidingMerge::new(3, &Lens::pinhole(8, 8, 10.0, 10.0, 4.0, 4.0), None);
    let picture = Arc::new(Rgb8Image::filled(8, 8, [90; 3]));
    let mut thumbnail = Thumbnail::default();
    let (seconds, warm_up) = (20, 90);
    let mut merges = 0;
    for k in 0..warm_up + 30 * seconds {
        let frame = camera.next(&mut thumbnail);
        let (sequence, t) = (frame.sequence, frame.t);
        scheduler.frame(FrameSeen { sequence, t, stated: None, thumbnail: &thumbnail });
        while let Some(settled) = scheduler.settled() {
            let Attribution::Sure(exposure) = settled.attribution else { continue };
            let pixels = Arc::clone(&picture);
            let frame = RawFrame {
                sequence: settled.sequence,
                t_mid: t,
                exposure,
                pixels,
                sensor: None,
                row_time_s: 0.0,
                response: None,
            };
            ring.push(&frame, None).unwrap();
            let whole = ring.registered(&crate::model::response::Response::srgb()).pictures().len() == 3;
            merges += u32::from(whole && k >= warm_up);
        }
        if let Some(asked) = scheduler.next_write(sequence) {
            let read_back = camera.write(asked);
            scheduler.written(asked, read_back, sequence);
        }
    }
    let a_second = f64::from(merges) / f64::from(seconds);
    // Three frames thrown away at each change would give 30 / (3 x 4) = 2.5.
    assert!(a_second > 29.9, "{a_second} merges a second");
}

#[test]
fn delays_are_measured_and_followed() {
    let cycle = exposures(&CYCLE_S);
    for delay in 0..=6 {
        let faults = Faults { delay: (delay, delay), ..Faults::default() };
        let (tally, report) = run(40 + delay, &faults, &cycle, 300);
        assert_eq!(tally.wrong, 0);
        assert!(report.delays[delay as usize] > 0.95, "{delay}: {:?}", report.delays);
    }
    for seed in 50..55 {
        let report = run(seed, &uvc(), &cycle, 2000).1;
        // A late write is mostly overtaken by the next one, and never seen. A write of the same exposure, three later, is now and
        // then taken for it; that changes no attribution.
        let [at_once, one, two, three, four, others @ ..] = report.delays;
        let impossible = at_once + one + others.iter().sum::<f64>();
        assert!(two > 0.8 && three + four > 0.01 && impossible < 0.05, "{:?}", report.delays);
    }
}

#[test]
fn what_a_driver_does_wrong_is_reported() {
    let cycle = exposures(&CYCLE_S);
    let of = |faults| run(60, &faults, &cycle, 3000).1;
    assert_eq!(of(uvc()).metadata, Belief::Unproven);
    assert_eq!(of(Faults { metadata: Metadata::Honest, ..uvc() }).metadata, Belief::Believed);
    for metadata in
        [Metadata::LastWritten, Metadata::LateAfterAWhile, Metadata::SometimesWrong, Metadata::Frozen]
    {
        assert_eq!(of(Faults { metadata, ..uvc() }).metadata, Belief::Lies, "{metadata:?}");
    }
    let cut = of(Faults { most_s: 0.01, ..uvc() });
    assert!((900..1100).contains(&cut.altered_writes), "every third: {}", cut.altered_writes);
    let hidden = of(Faults { most_s: 0.01, hides_changes: true, ..uvc() });
    assert!(hidden.altered_writes == 0 && hidden.not_explained > 1000, "{hidden:?}");
    let rounded = of(Faults { step_s: 3e-4, hides_changes: true, ..uvc() });
    assert!(rounded.worst_offset > 0.025, "{}", rounded.worst_offset);
    let lossy = of(Faults { lost: 0.05, twice: 0.05, reordered: 0.05, ..uvc() });
    assert!(lossy.lost > 100 && lossy.duplicates > 100 && lossy.late > 50, "{lossy:?}");
}

#[test]
fn one_write_a_frame_and_none_where_nothing_changes() {
    let mut scheduler = Scheduler::new(&exposures(&CYCLE_S)).unwrap();
    assert!(scheduler.next_write(7).is_some());
    assert!(scheduler.next_write(7).is_none() && scheduler.next_write(3).is_none());
    assert!(scheduler.next_write(8).is_some());
    let mut single = Scheduler::new(&exposures(&[0.01])).unwrap();
    assert_eq!(single.next_write(0), Some(exposures(&[0.01])[0]));
    assert_eq!(single.next_write(1), None);
    single.set_cycle(&exposures(&[0.02])).unwrap();
    assert_eq!(single.next_write(2), Some(exposures(&[0.02])[0]));
}

#[test]
fn the_start_has_no_period() {
    let mut scheduler = Scheduler::new(&exposures(&CYCLE_S)).unwrap();
    let writes: Vec<_> = (0..START).map(|k| scheduler.next_write(k).unwrap().time_s).collect();
    for period in 1..=8 {
        let same = writes.iter().zip(&writes[period..]).filter(|(a, b)| a == b).count();
        let share = same as f64 / (writes.len() - period) as f64;
        assert!(share < 0.75, "period {period}: {share}");
    }
    for time_s in CYCLE_S {
        assert!(writes.contains(&time_s));
    }
}

#[test]
fn one_exposure_alone_is_sure_once_it_is_in_force() {
    let (tally, _) = run(70, &uvc(), &exposures(&[0.004]), 300);
    assert_eq!(tally.wrong, 0);
    assert!(tally.share() > 0.9, "{}", tally.share());
}

#[test]
fn one_exposure_alone_is_known_in_the_dark_too() {
    let mut scheduler = Scheduler::new(&exposures(&[0.004])).unwrap();
    let mut reader = ThumbnailReader::new(&crate::model::response::Response::srgb());
    let mut thumbnail = Thumbnail::default();
    reader.read_luminance(24, &[2; 24 * 16], &mut thumbnail);
    let mut sure = 0;
    for sequence in 0..60 {
        let t = Timestamp(33_333_333 * sequence as i64);
        scheduler.frame(FrameSeen { sequence, t, stated: None, thumbnail: &thumbnail });
        while let Some(settled) = scheduler.settled() {
            let is_sure = matches!(settled.attribution, Attribution::Sure(e) if e.time_s == 0.004);
            // Before the first write is in force nobody knows what the camera does.
            assert!(!is_sure || settled.sequence > 4, "{settled:?}");
            sure += u32::from(is_sure);
        }
        if let Some(asked) = scheduler.next_write(sequence) {
            scheduler.written(asked, asked, sequence);
        }
    }
    assert!(sure > 40, "{sure} of 60");
}

#[test]
fn a_camera_that_counts_from_the_beginning_again_is_followed() {
    let mut scheduler = Scheduler::new(&exposures(&CYCLE_S)).unwrap();
    let mut thumbnail = Thumbnail::default();
    let mut sure_at_last = 0;
    for start in 0..2u64 {
        let mut camera = SimulatedCamera::new(80 + start, uvc());
        for k in 0..400 {
            let frame = camera.next(&mut thumbnail);
            let (sequence, t) = (frame.sequence, frame.t);
            scheduler.frame(FrameSeen { sequence, t, stated: None, thumbnail: &thumbnail });
            while let Some(settled) = scheduler.settled() {
                let sure = matches!(settled.attribution, Attribution::Sure(_));
                sure_at_last += u32::from(start == 1 && k >= 300 && sure);
            }
            if let Some(asked) = scheduler.next_write(sequence) {
                let read_back = camera.write(asked);
                scheduler.written(asked, read_back, sequence);
            }
        }
    }
    assert!(sure_at_last > 80, "{sure_at_last} of 100");
}

#[test]
fn bad_cycles_are_refused_with_what_is_wrong() {
    assert_eq!(Scheduler::new(&[]).unwrap_err(), BadCycle::Count(0));
    assert_eq!(Scheduler::new(&exposures(&[0.1; 10])).unwrap_err(), BadCycle::Count(10));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE * 1e-9] {
        let cycle = [Exposure { time_s: 0.1, gain: 1.0 }, Exposure { time_s: bad, gain: 1e-300 }];
        assert!(matches!(Scheduler::new(&cycle), Err(BadCycle::Exposure { index: 1, .. })), "{bad}");
    }
}

/// Any number at all.
fn odd() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(0.0),
        Just(-1.0),
        Just(1e300),
        Just(1e-320),
        1e-4..1.0f64
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_numbers_make_it_panic(
        steps in prop::collection::vec((0..4u8, odd(), odd(), any::<u64>(), any::<i64>()), 1..80),
        near in any::<bool>(),
    ) {
        let mut scheduler = Scheduler::new(&exposures(&CYCLE_S)).unwrap();
        let mut reader = ThumbnailReader::new(&crate::model::response::Response::srgb());
        let mut thumbnail = Thumbnail::default();
        let mut dice = Dice::new(3);
        let (mut out, mut given) = (0, 0);
        for (k, (what, a, b, sequence, t)) in steps.into_iter().enumerate() {
            let sequence = if near { k as u64 } else { sequence };
            let exposure = Exposure { time_s: a, gain: b };
            match what {
                0 => scheduler.written(exposure, Exposure { time_s: b, gain: a }, sequence),
                1 => drop((scheduler.next_write(sequence), scheduler.set_cycle(&[exposure]))),
                _ => {
                    let values: Vec<u8> = (0..24 * 16).map(|_| (dice.bits() >> 56) as u8).collect();
                    reader.read_luminance(24, &values, &mut thumbnail);
                    let (t, stated) = (Timestamp(t), Some(exposure));
                    scheduler.frame(FrameSeen { sequence, t, stated, thumbnail: &thumbnail });
                    given += 1;
                }
            }
            if what == 2 {
                out += std::iter::from_fn(|| scheduler.settled()).count();
            }
        }
        prop_assert!(out <= given && scheduler.report().settled == out as u64);
    }
}
