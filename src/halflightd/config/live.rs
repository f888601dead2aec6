//! Settings that change while the program runs.

use super::{keys::KEYS, settings::Settings};

/// What became of settings that were typed anew.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// Live keys whose value is now another.
    pub live: Vec<&'static str>,
    /// Keys that were changed too, and wait for the next start.
    pub waiting: Vec<&'static str>,
}

/// Takes over into `current` every live key of `typed`; the others stay as they are.
pub fn take_over(current: &mut Settings, typed: &Settings) -> TakenOver {
    let mut taken = TakenOver::default();
    for key in KEYS {
        let value = (key.read)(typed);
        if value == (key.read)(current) {
            continue;
        }
        if key.is_live() {
            (key.write)(current, &value);
            taken.live.push(key.name);
        } else {
            taken.waiting.push(key.name);
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::picture::PictureView;

    #[test]
    fn live_keys_are_taken_and_the_others_wait() {
        let mut current = Settings::default();
        let mut typed = Settings { view: PictureView::Cast, threads: 3, ..Settings::default() };
        typed.quality.pcf_taps = 2;
        let taken = take_over(&mut current, &typed);
        assert_eq!(taken.live, ["quality.pcf_taps", "present.view"]);
        assert_eq!(taken.waiting, ["engine.threads"]);
        assert_eq!((current.view, current.quality.pcf_taps, current.threads), (PictureView::Cast, 2, 0));
        // What waits, waits; nothing else has changed.
        let again = take_over(&mut current, &typed);
        assert_eq!((again.live.len(), again.waiting), (0, vec!["engine.threads"]));
    }
}
