//! What a request asks of a camera, and what a frame's metadata says that it had. Pure.

use crate::model::frame::Exposure;

/// The longest exposure that is asked for, microseconds.
const LONGEST_US: f64 = 60e6;
/// Gains that are asked for.
const GAINS: [f64; 2] = [0.01, 1000.0];
/// What a sensor needs beside the exposure before it can begin the next frame, as a share of it.
const BETWEEN_FRAMES: f64 = 0.02;
/// The oldest frame whose time is believed, nanoseconds: an older one's is on another clock.
const OLDEST_NS: i64 = 10_000_000_000;

/// What a request asks for. Everything automatic is off beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestControls {
    /// Microseconds.
    pub exposure_us: i32,
    /// Analogue gain, 1 = none.
    pub gain: f32,
    /// The shortest and the longest time of a frame, microseconds: a longer exposure than a frame would be cut.
    pub frame_us: [i64; 2],
}

impl RequestControls {
    /// Asks for an exposure at a rate; frames take longer than the rate says where the exposure does.
    pub fn new(exposure: Exposure, frames_per_s: f64) -> Self {
        let exposure = taken(exposure);
        let exposure_us = (1e6 * exposure.time_s).round();
        let period_us = (1e6 / frames_per_s).clamp(1.0, LONGEST_US);
        let longest_us = period_us.max(exposure_us * (1.0 + BETWEEN_FRAMES));
        Self {
            exposure_us: exposure_us as i32,
            gain: exposure.gain as f32,
            frame_us: [period_us.round() as i64, longest_us.round() as i64],
        }
    }
}

/// What can be asked of an exposure: whole microseconds. The camera's own limits are not known before its metadata states them.
pub fn taken(wish: Exposure) -> Exposure {
    let or = |number: f64, instead: f64| if number.is_nan() { instead } else { number };
    Exposure {
        time_s: or(1e6 * wish.time_s, 1e4).round().clamp(1.0, LONGEST_US) / 1e6,
        gain: or(wish.gain, 1.0).clamp(GAINS[0], GAINS[1]),
    }
}

/// Exposures for requests in turn.
#[derive(Clone, Debug)]
pub struct ExposureCycle {
    exposures: Vec<Exposure>,
    next: usize,
}

impl ExposureCycle {
    /// Begins with one for all.
    pub fn new(first: Exposure) -> Self {
        Self { exposures: vec![taken(first)], next: 0 }
    }

    /// Takes others; nothing changes where there are none.
    pub fn set(&mut self, wishes: &[Exposure]) {
        if !wishes.is_empty() {
            self.exposures.clear();
            self.exposures.extend(wishes.iter().map(|&wish| taken(wish)));
            self.next = 0;
        }
    }

    /// The exposure of the next request.
    pub fn take_next(&mut self) -> Exposure {
        let exposure = self.exposures[self.next % self.exposures.len()];
        self.next = (self.next + 1) % self.exposures.len();
        exposure
    }

    /// All, in turn.
    pub fn as_slice(&self) -> &[Exposure] {
        &self.exposures
    }
}

/// What a completed request says of its frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureMetadata {
    /// Microseconds.
    pub exposure_us: Option<i32>,
    /// 1 = none.
    pub analogue_gain: Option<f32>,
    /// 1 = none; it counts as well, since it scales the picture.
    pub digital_gain: Option<f32>,
}

impl ExposureMetadata {
    /// The frame's exposure; `None` where the metadata states none that can be. A gain that is not stated is the one that was
    /// asked for.
    pub fn exposure(&self, asked: Exposure) -> Option<Exposure> {
        let gain = |stated: Option<f32>| stated.map(f64::from).filter(|g| g.is_finite() && *g > 0.0);
        let time_us = self.exposure_us.filter(|us| *us > 0)?;
        let analogue = gain(self.analogue_gain).unwrap_or(asked.gain);
        Some(Exposure {
            time_s: f64::from(time_us) / 1e6,
            gain: analogue * gain(self.digital_gain).unwrap_or(1.0),
        })
    }
}

/// How long ago a frame began, nanoseconds. Its time is on the monotonic clock with most drivers, since boot by libcamera's own
/// words: the first that it can be on. `None` where it is on neither.
pub fn age_ns(stamp_ns: i64, monotonic_ns: i64, since_boot_ns: i64) -> Option<i64> {
    let age = |now: i64| now.checked_sub(stamp_ns).filter(|age| (0..OLDEST_NS).contains(age));
    age(monotonic_ns).or_else(|| age(since_boot_ns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ASKED: Exposure = Exposure { time_s: 0.01, gain: 2.0 };

    #[test]
    fn a_long_exposure_makes_frames_longer_and_a_short_one_does_not() {
        let short = RequestControls::new(Exposure { time_s: 0.002_000_4, gain: 1.5 }, 30.0);
        assert_eq!(short, RequestControls { exposure_us: 2000, gain: 1.5, frame_us: [33333, 33333] });
        let long = RequestControls::new(Exposure { time_s: 0.1, gain: 1.0 }, 30.0);
        assert_eq!((long.exposure_us, long.frame_us), (100_000, [33333, 102_000]));
    }

    #[test]
    fn requests_have_the_exposures_in_turn() {
        let mut cycle = ExposureCycle::new(ASKED);
        assert_eq!([cycle.take_next(), cycle.take_next()], [ASKED, ASKED]);
        let three = [0.001, 0.004, 0.016].map(|time_s| Exposure { time_s, gain: 1.0 });
        cycle.set(&three);
        let got: Vec<Exposure> = (0..6).map(|_| cycle.take_next()).collect();
        assert_eq!((&got[..3], &got[3..]), (&three[..], &three[..]));
        cycle.set(&[]);
        assert_eq!(cycle.as_slice(), three);
    }

    #[test]
    fn metadata_says_what_a_frame_had() {
        let stated =
            ExposureMetadata { exposure_us: Some(8000), analogue_gain: Some(1.5), digital_gain: Some(2.0) };
        assert_eq!(stated.exposure(ASKED), Some(Exposure { time_s: 0.008, gain: 3.0 }));
        let time_only = ExposureMetadata { exposure_us: Some(8000), ..ExposureMetadata::default() };
        assert_eq!(time_only.exposure(ASKED), Some(Exposure { time_s: 0.008, gain: 2.0 }));
        assert_eq!(ExposureMetadata::default().exposure(ASKED), None);
        let nonsense = ExposureMetadata { exposure_us: Some(0), ..stated };
        assert_eq!(nonsense.exposure(ASKED), None);
    }

    #[test]
    fn a_time_is_on_the_clock_that_it_can_be_on() {
        let (monotonic, boot) = (5_000_000_000, 3_600_000_000_000);
        assert_eq!(age_ns(monotonic - 30, monotonic, boot), Some(30));
        assert_eq!(age_ns(boot - 30, monotonic, boot), Some(30));
        assert_eq!(age_ns(monotonic + 1, monotonic, boot), None);
        assert_eq!(age_ns(0, 50_000_000_000, boot), None);
    }

    proptest! {
        #[test]
        fn whatever_is_wished_what_is_asked_can_be(time_s in any::<f64>(), gain in any::<f64>(), rate in 1.0..1000.0f64) {
            let wish = Exposure { time_s, gain };
            let controls = RequestControls::new(wish, rate);
            prop_assert!(controls.exposure_us >= 1 && controls.gain > 0.0 && controls.gain.is_finite());
            prop_assert!(controls.frame_us[0] >= 1 && controls.frame_us[0] <= controls.frame_us[1]);
            prop_assert!(f64::from(controls.exposure_us) <= controls.frame_us[1] as f64);
            prop_assert_eq!(taken(taken(wish)), taken(wish));
        }

        #[test]
        fn whatever_is_stated_is_an_exposure_or_none(us in any::<Option<i32>>(), a in any::<Option<f32>>(), d in any::<Option<f32>>()) {
            let stated = ExposureMetadata { exposure_us: us, analogue_gain: a, digital_gain: d };
            if let Some(exposure) = stated.exposure(ASKED) {
                prop_assert!(exposure.time_s > 0.0 && exposure.gain > 0.0 && exposure.gain.is_finite());
            }
        }
    }
}
