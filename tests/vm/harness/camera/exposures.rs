//! When a setting comes into force: frames later, as in a real sensor.

use super::controls::Settings;
use std::collections::VecDeque;

/// Settings that were in force at the start of the last frames. Longer delays are not made.
const LONGEST: usize = 16;

/// How late settings are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Delay {
    /// Frames between the one at whose start a setting is there and the one that has it.
    pub lag: usize,
    /// Up to so many frames more, by rule from the number of the frame.
    pub jitter: usize,
}

/// The camera's memory of settings.
#[derive(Default)]
pub struct Exposures {
    started: VecDeque<Settings>,
    /// Frames ago that the last frame's settings were taken.
    last_age: usize,
}

impl Exposures {
    /// A frame starts with these settings at hand; returns those that it is truly made with.
    pub fn start(&mut self, now: Settings, delay: Delay, number: u64) -> Settings {
        self.started.push_front(now);
        self.started.truncate(LONGEST);
        let spread = delay.jitter as u64 + 1;
        let wish = delay.lag + ((number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33) % spread) as usize;
        // Settings come into force in their order: none is older than that of the frame before.
        let age = wish.min(self.last_age + 1).min(self.started.len() - 1);
        self.last_age = age;
        self.started[age]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(exposure: u16) -> Settings {
        Settings { exposure, gain: 16, brightness: 0 }
    }

    #[test]
    fn a_setting_comes_into_force_frames_later() {
        for lag in 0..4 {
            let mut exposures = Exposures::default();
            let delay = Delay { lag, jitter: 0 };
            let made: Vec<u16> =
                (0..20).map(|n| exposures.start(settings(n), delay, u64::from(n)).exposure).collect();
            let expected: Vec<u16> = (0..20_u16).map(|n| n.saturating_sub(lag as u16)).collect();
            assert_eq!(made, expected);
        }
    }

    #[test]
    fn jitter_keeps_the_order() {
        let mut exposures = Exposures::default();
        let delay = Delay { lag: 1, jitter: 2 };
        let made: Vec<u16> =
            (0..200).map(|n| exposures.start(settings(n), delay, u64::from(n)).exposure).collect();
        let ages: Vec<u16> = (0..200).zip(&made).map(|(n, m)| n - m).skip(4).collect();
        assert!(made.is_sorted() && ages.iter().all(|age| (1..=3).contains(age)));
        assert!((1..=3).all(|age| ages.contains(&age)), "each delay is seen");
    }
}
