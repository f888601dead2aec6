mod logs;
pub(crate) mod made;

use super::*;
use crate::imu::sample::SampleStamp;
use crate::math::dice::Dice;
use glam::DVec3;
use made::{KINDS, RATE_HZ, frame, protocol};
use proptest::prelude::*;

/// Farthest that a sample may be from the true one of its time: what sensors of this kind state as their own error.
const FARTHEST: (f64, f64, f64) = (0.5, 0.5, 0.1);

fn time(k: usize) -> Timestamp {
    Timestamp(k as i64 * 10_000_000)
}

/// All samples of frames `0..count`, with the number of their frame.
fn truth(kind: &str, count: usize, seed: u64) -> Vec<(usize, WireSample)> {
    let mut wire = Wire::new(&protocol(kind), RATE_HZ);
    let mut samples = Vec::new();
    for k in 0..count {
        wire.feed(&frame(kind, k, seed), time(k), |sample| samples.push((k, sample)));
    }
    samples
}

/// Whether a sample is one of the true stream, as far as anybody can tell.
fn is_near(sample: &WireSample, truth: &WireSample, (degrees, force, rate): (f64, f64, f64)) -> bool {
    let apart = |a: Option<[f64; 3]>, b: Option<[f64; 3]>, most: f64| match (a, b) {
        (Some(a), Some(b)) => DVec3::from(a).distance(DVec3::from(b)) <= most,
        (a, b) => a.is_none() && b.is_none(),
    };
    let turned = match (sample.orientation, truth.orientation) {
        (Some(a), Some(b)) => a.angle_between(b).to_degrees() <= degrees,
        (a, b) => a.is_none() && b.is_none(),
    };
    turned
        && apart(sample.accel_m_s2, truth.accel_m_s2, force)
        && apart(sample.gyro_rad_s, truth.gyro_rad_s, rate)
}

#[test]
fn whole_streams_are_read_whole() {
    for kind in KINDS {
        let samples = truth(kind, 300, 1);
        // The first sample has nothing to follow; groups of WitMotion are learnt from two.
        let begins = if kind == "witmotion" { 3 } else { 1 };
        assert!(samples.len() >= 298 - begins, "{kind}: {}", samples.len());
        assert_eq!(samples[0].0, begins, "{kind}");
    }
}

#[test]
fn known_frames_mean_what_the_makers_say() {
    // Yaw 90 degrees, pitch 0, roll 0, 1 g along z.
    let mut bytes = vec![0xAA, 0xAA, 7, 0x28, 0x23, 0, 0, 0, 0, 0, 0, 0, 0, 0xE8, 0x03, 0, 0, 0];
    bytes.push(resync::sum8(&bytes[2..]));
    let WireLook::Sample(19, sample) = rvc::look(&bytes, time(1)) else { panic!("no sample") };
    assert_eq!(sample.stamp, SampleStamp::Count { value: 7, modulus: 256 });
    assert!((sample.orientation.unwrap() * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
    assert!((sample.accel_m_s2.unwrap()[2] - 9.80665).abs() < 1e-12);
    // Razor's z is down: a turn to the right is positive, and pitch up lifts x.
    let WireLook::Sample(_, sample) = ypr::look(b"#YPR=90.00,0.00,0.00\r\n", time(1)) else {
        panic!("no sample")
    };
    assert!((sample.orientation.unwrap() * DVec3::X).abs_diff_eq(DVec3::NEG_Y, 1e-12));
    let WireLook::Sample(_, sample) = ypr::look(b"#YPR=0.00,30.00,0.00\n", time(1)) else {
        panic!("no sample")
    };
    assert!(((sample.orientation.unwrap() * DVec3::X).z - 0.5).abs() < 1e-12);
    for line in [
        "#YPR=1,2\n",
        "#YPR=1,2,3,4\n",
        "#YPR=1,91,0\n",
        "#YPR=1.0,2.00,3.00\n",
        "#YPR=+1,2,3\n",
        "#YPR=,,\n",
    ] {
        assert_eq!(ypr::look(line.as_bytes(), time(1)), WireLook::Nothing, "{line}");
    }
}

/// Frames `0..60` with one fault, cut into reads; returns the samples and the number of the frame after the fault.
fn faulty(kind: &str, seed: u64, at: usize, cut: usize, garbage: &[u8]) -> (Vec<WireSample>, usize) {
    let frames: Vec<Vec<u8>> = (0..60).map(|k| frame(kind, k, seed)).collect();
    let length: usize = frames.iter().map(Vec::len).sum();
    let at = at % (length / 2);
    let cut = cut.min(length / 4);
    let (mut wire, mut samples, mut begin, mut after) =
        (Wire::new(&protocol(kind), RATE_HZ), Vec::new(), 0, frames.len());
    for (k, bytes) in frames.iter().enumerate() {
        let end = begin + bytes.len();
        let kept: Vec<u8> =
            (begin..end).filter(|i| !(at..at + cut).contains(i)).map(|i| bytes[i - begin]).collect();
        let mut read = kept;
        if (begin..end).contains(&at) {
            let inside = (at - begin).min(read.len());
            read.splice(inside..inside, garbage.iter().copied());
        }
        if begin >= at + cut && begin > at {
            after = after.min(k);
        }
        wire.feed(&read, time(k), |sample| samples.push(sample));
        begin = end;
    }
    (samples, after)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_read(bytes in prop::collection::vec(any::<u8>(), 0..3000), kind in 0usize..4) {
        let mut wire = Wire::new(&protocol(KINDS[kind]), RATE_HZ);
        let mut count = 0u64;
        for (k, part) in bytes.chunks(97).enumerate() {
            wire.feed(part, time(k), |_| count += 1);
        }
        prop_assert_eq!(wire.counts().samples, count);
        prop_assert_eq!(wire.counts().bytes, bytes.len() as u64);
    }

    #[test]
    fn heads_in_any_bytes_are_read(
        parts in prop::collection::vec((0usize..4, prop::collection::vec(any::<u8>(), 0..40)), 0..60),
        kind in 0usize..4,
    ) {
        let heads: [&[u8]; 4] = [&[0xAA, 0xAA], &[0x55, 0x51], b"#YPR=", &[0xA5, 0x5A]];
        let mut wire = Wire::new(&protocol(KINDS[kind]), RATE_HZ);
        for (k, (head, part)) in parts.iter().enumerate() {
            wire.feed(heads[*head], time(k), |_| {});
            wire.feed(part, time(k), |_| {});
        }
    }

    #[test]
    fn a_stream_with_a_fault_gives_valid_samples_and_comes_back_within_two_frames(
        kind in 0usize..4, seed in 0u64..1000, at in 0usize..4000, cut in 0usize..200,
        garbage in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        let kind = KINDS[kind];
        let truth = truth(kind, 60, seed);
        let (samples, after) = faulty(kind, seed, at, cut, &garbage);
        for sample in &samples {
            // Bytes of garbage may delay a frame until the next read.
            let is_true = truth.iter().any(|(k, t)| {
                let late = sample.arrival.0 / 10_000_000 - *k as i64;
                (0..=4).contains(&late) && is_near(sample, t, FARTHEST)
            });
            prop_assert!(is_true, "{kind}: {sample:?}");
        }
        // A fault while the groups are learnt begins that anew.
        let learnt = if kind == "witmotion" { 4 + if at % 990 < 165 { after } else { 0 } } else { 1 };
        let back = time((after + 2).max(learnt + 2));
        prop_assert!(samples.iter().any(|s| s.arrival <= back && s.arrival >= time(after)), "{kind}: not back at {after} + 2");
        let rest = samples.iter().filter(|s| s.arrival > back).count();
        prop_assert!(rest + 1 >= 60usize.saturating_sub(after.max(learnt) + 3), "{kind}: {rest} after {after}");
    }
}

/// A frame with another content and a sum that is right: a burst, flipped bits, or bytes that were lost.
fn corrupted(kind: &str, k: usize, seed: u64, dice: &mut Dice) -> Vec<u8> {
    let good = frame(kind, k, seed);
    // The sum covers bytes 2 to 17 of RVC, and each 11 bytes of WitMotion.
    let part = if kind == "rvc" { 0 } else { 11 * (dice.bits() % 3) as usize };
    let (first, last) = if kind == "rvc" { (2, 18) } else { (part, part + 10) };
    loop {
        let mut bad = good.clone();
        match dice.bits() % 3 {
            0 => {
                let length = 2 + (dice.bits() % 6) as usize;
                let at = first + dice.bits() as usize % (last + 1 - first);
                (at..(at + length).min(last + 1)).for_each(|i| bad[i] = dice.bits() as u8);
            }
            1 => {
                for _ in 0..2 + dice.bits() % 5 {
                    bad[first + dice.bits() as usize % (last + 1 - first)] ^= 1 << (dice.bits() % 8);
                }
            }
            _ => {
                let at = first + dice.bits() as usize % (last - first);
                let lost = 1 + (dice.bits() % 3) as usize;
                bad.drain(at..at + lost.min(last - at));
                bad.extend(frame(kind, k + 1, seed));
                bad.truncate(good.len());
            }
        }
        if bad != good && resync::sum8(&bad[first..last]) == bad[last] {
            return bad;
        }
    }
}

#[test]
fn corruption_that_passes_the_sum_is_caught_by_index_and_physics() {
    for kind in ["rvc", "witmotion"] {
        let mut dice = Dice::new(2026);
        let (cases, mut harmful, mut different) = (10_000, 0, 0);
        for case in 0..cases {
            let seed = 1 + case / 100;
            let at = 20 + (case % 100) as usize;
            let mut wire = Wire::new(&protocol(kind), RATE_HZ);
            let mut given = Vec::new();
            for k in at - 12..at {
                wire.feed(&frame(kind, k, seed), time(k), |_| {});
            }
            wire.feed(&corrupted(kind, at, seed, &mut dice), time(at), |sample| given.push(sample));
            let good = truth_of(kind, at, seed);
            let wrong = |near: (f64, f64, f64)| given.iter().any(|sample| !is_near(sample, &good, near));
            harmful += u32::from(wrong(FARTHEST));
            different += u32::from(wrong((1e-4, 1e-4, 1e-4)));
        }
        println!(
            "{kind}: of {cases} corruptions with a right sum {harmful} gave a harmful sample, {different} any other one"
        );
        assert!(harmful * 100 <= cases as u32, "{kind}: {harmful}");
        assert!(different * 100 <= cases as u32, "{kind}: {different} differ at all");
    }
}

/// The sample of one frame.
fn truth_of(kind: &str, k: usize, seed: u64) -> WireSample {
    truth(kind, k + 1, seed).last().unwrap().1
}

#[test]
fn a_true_jump_costs_one_sample() {
    let mut wire = Wire::new(&Protocol::Ypr, RATE_HZ);
    let mut given = Vec::new();
    for k in 0..40usize {
        let yaw = if k < 20 { 10.0 } else { 90.0 };
        wire.feed(format!("#YPR={yaw:.2},0.00,0.00\r\n").as_bytes(), time(k), |_| given.push(k));
    }
    let want: Vec<usize> = (1..40).filter(|k| *k != 20).collect();
    assert_eq!(given, want);
}
