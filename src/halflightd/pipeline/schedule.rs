//! When to take a frame, and for which moment to pose what is drawn: from the display's rhythm and the measured time that
//! drawing takes. Pure: time is an argument.
//!
//! A frame that is taken late is a fresh one, and the pose at the moment of display need be predicted less far. A frame
//! that is taken too late misses its moment. Without a display frames are taken as they come.

use crate::model::time::Timestamp;

/// Added to the expected drawing time, nanoseconds.
const MARGIN_NS: i64 = 1_000_000;
/// How fast an expected time that was too long comes down, per frame.
const CALM: f64 = 0.04;

/// When a display shows pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rhythm {
    /// A moment at which it showed, or will show, a picture.
    pub at: Timestamp,
    /// Nanoseconds from one to the next, above 0.
    pub period_ns: i64,
}

impl Rhythm {
    /// The first moment of display that is not before `t`.
    pub fn first_from(&self, t: Timestamp) -> Timestamp {
        let period_ns = self.period_ns.max(1);
        let before = t.0.saturating_sub(self.at.0).rem_euclid(period_ns);
        Timestamp(if before == 0 { t.0 } else { t.0.saturating_add(period_ns - before) })
    }
}

/// One picture to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Latch {
    /// Take the newest frame then, or the first one after.
    pub take_at: Timestamp,
    /// When the picture will be seen; `None`: nobody says, and the frame's own time counts.
    pub shown_at: Option<Timestamp>,
}

/// Keeps the rhythm and the drawing time.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    rhythm: Option<Rhythm>,
    expected_ns: f64,
    /// The moment that the last picture was drawn for.
    aimed_at: Option<Timestamp>,
}

impl Schedule {
    /// What a display says of its rhythm; `None`: there is none (any more).
    pub fn follow(&mut self, rhythm: Option<Rhythm>) {
        self.rhythm = rhythm;
    }

    /// The next picture, seen from `now`. Every moment of display is aimed at once at most.
    pub fn next(&self, now: Timestamp) -> Latch {
        let Some(rhythm) = &self.rhythm else { return Latch { take_at: now, shown_at: None } };
        let lead_ns = self.expected_ns as i64 + MARGIN_NS;
        let mut earliest = now.0.saturating_add(lead_ns);
        if let Some(aimed_at) = self.aimed_at {
            // Half a period more: a rhythm that was measured anew may lie a little beside the old one.
            earliest = earliest.max(aimed_at.0.saturating_add(rhythm.period_ns / 2));
        }
        let shown_at = rhythm.first_from(Timestamp(earliest));
        Latch { take_at: Timestamp(shown_at.0 - lead_ns).max(now), shown_at: Some(shown_at) }
    }

    /// A picture was drawn for `latch`: how long that took, from taking the frame to handing the picture over. A longer
    /// time is expected at once, a shorter one little by little.
    pub fn drew(&mut self, latch: Latch, took_ns: i64) {
        let took = took_ns.max(0) as f64;
        self.expected_ns =
            if took > self.expected_ns { took } else { self.expected_ns + CALM * (took - self.expected_ns) };
        self.aimed_at = latch.shown_at.or(self.aimed_at);
    }

    /// The time that drawing is expected to take, nanoseconds.
    pub fn expected_ns(&self) -> i64 {
        self.expected_ns as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Clock, clock::ManualClock};

    const MS: i64 = 1_000_000;

    /// What a simulated run gave.
    #[derive(Debug, Default)]
    struct Simulated {
        pictures: u32,
        missed: u32,
        /// Moments of display from the first that was aimed at to the last.
        moments: u32,
        /// Longest time from the middle of a frame's wait to its display, ms.
        oldest_ms: f64,
    }

    /// A camera and a display on one simulated clock; `drawing_ms` of the picture's number.
    fn simulate(camera_ns: i64, display_ns: i64, drawing_ms: impl Fn(u32) -> f64) -> Simulated {
        let (clock, mut schedule) = (ManualClock::default(), Schedule::default());
        schedule.follow(Some(Rhythm { at: Timestamp(3 * MS), period_ns: display_ns }));
        let mut run = Simulated::default();
        let (mut last_frame, mut last_aim, mut first_aim) = (-1, Timestamp(i64::MIN), None);
        while clock.now() < Timestamp(4_000 * MS) {
            let latch = schedule.next(clock.now());
            clock.wait_until(latch.take_at);
            // The newest frame, or the next one to come.
            let newest = clock.now().0 / camera_ns;
            let frame = newest.max(last_frame + 1);
            clock.wait_until(Timestamp(frame * camera_ns));
            last_frame = frame;
            // The wait for a frame may have cost the moment that was aimed at.
            let latch = schedule.next(clock.now());
            clock.wait_until(latch.take_at);
            let took = (drawing_ms(run.pictures) * MS as f64) as i64;
            let (began, shown_at) = (clock.now(), latch.shown_at.unwrap());
            assert!(shown_at > last_aim, "a moment is aimed at once");
            last_aim = shown_at;
            let from = *first_aim.get_or_insert(shown_at);
            run.moments = ((shown_at.0 - from.0) / display_ns) as u32 + 1;
            clock.wait_until(Timestamp(began.0 + took));
            schedule.drew(latch, took);
            run.pictures += 1;
            run.missed += u32::from(clock.now() > shown_at);
            run.oldest_ms = run.oldest_ms.max((shown_at.0 - frame * camera_ns) as f64 / MS as f64);
        }
        run
    }

    #[test]
    fn pictures_are_ready_in_time_and_fresh() {
        let noisy = |k: u32| 6.0 + 2.0 * (f64::from(k) * 2.399).sin();
        let run = simulate(33_333_333, 16_666_667, noisy);
        assert!((119..=121).contains(&run.pictures), "each of 30 frames a second is drawn: {run:?}");
        assert!(run.missed <= 3, "{run:?}");
        // The longest drawing with its margin, and a moment of display that is waited for.
        assert!(run.oldest_ms < 8.1 + 1.0 + 16.7 + 0.1, "{run:?}");
        let fast_camera = simulate(5_000_000, 16_666_667, noisy);
        assert!(fast_camera.moments >= 240, "{fast_camera:?}");
        assert_eq!(fast_camera.pictures, fast_camera.moments, "each moment has a picture: {fast_camera:?}");
        // Of many frames the newest at the latest time to begin: never older than one more period of the camera.
        assert!(fast_camera.oldest_ms < 8.1 + 1.0 + 5.1, "{fast_camera:?}");
        assert!(fast_camera.missed <= 3, "{fast_camera:?}");
    }

    #[test]
    fn drawing_that_takes_longer_than_a_period_skips_moments_and_comes_back() {
        let step = |k: u32| if (20..60).contains(&k) { 25.0 } else { 5.0 };
        let run = simulate(8_333_333, 16_666_667, step);
        // Two times cannot be known in advance: the first of all, and the one that grew.
        assert_eq!(run.missed, 2, "{run:?}");
        assert!(run.pictures > 160, "{run:?}");
    }

    #[test]
    fn without_a_display_frames_are_taken_as_they_come() {
        let mut schedule = Schedule::default();
        let now = Timestamp(17);
        assert_eq!(schedule.next(now), Latch { take_at: now, shown_at: None });
        schedule.drew(schedule.next(now), 5 * MS);
        assert_eq!(schedule.next(now), Latch { take_at: now, shown_at: None });
        assert_eq!(schedule.expected_ns(), 5 * MS);
    }

    #[test]
    fn moments_of_display_lie_on_the_rhythm() {
        let rhythm = Rhythm { at: Timestamp(100), period_ns: 30 };
        for (t, first) in [(100, 100), (101, 130), (130, 130), (71, 100), (70, 70), (-19, 10)] {
            assert_eq!(rhythm.first_from(Timestamp(t)), Timestamp(first), "{t}");
        }
        assert_eq!(Rhythm { at: Timestamp(0), period_ns: 0 }.first_from(Timestamp(9)), Timestamp(9));
    }
}
