//! A display that nobody sees: it keeps the pace of a screen and throws pictures away. For runs without a screen, and for
//! measuring what the rest costs.

use crate::clock::Clock;
use crate::model::{image::Rgb8Image, time::Timestamp};
use crate::parameters::Parameters;
use crate::{DeviceError, Display, DisplayEvent, DisplayMode};
use std::sync::Arc;

/// What the name of a null display may say.
pub const PARAMETERS: [&str; 1] = ["hz"];

/// Takes pictures of any size; each is "seen" at the next refresh.
pub struct NullDisplay {
    clock: Arc<dyn Clock>,
    period_ns: i64,
    /// Refreshes are counted from here.
    zero: Timestamp,
    mode: DisplayMode,
    /// When the picture that was handed over is seen.
    seen_at: Option<Timestamp>,
}

impl NullDisplay {
    /// Reads `hz=60` (1 to 1000) or nothing. `Refused` for anything else.
    pub fn open(name: &str, parameters: &str, clock: Arc<dyn Clock>) -> Result<Self, DeviceError> {
        let hz = Parameters::parse(name, parameters, &PARAMETERS)?.number("hz", 60.0, 1.0, 1000.0, " Hz")?;
        let mode = DisplayMode { width: 0, height: 0, period_s: Some(1.0 / hz) };
        Ok(Self { zero: clock.now(), clock, period_ns: (1e9 / hz) as i64, mode, seen_at: None })
    }
}

impl Display for NullDisplay {
    fn next(&mut self, deadline: Timestamp) -> Result<DisplayEvent, DeviceError> {
        let at = self.seen_at.unwrap_or(Timestamp::NEVER);
        if at > deadline {
            self.clock.wait_until(deadline);
            return Err(DeviceError::again());
        }
        self.clock.wait_until(at);
        self.seen_at = None;
        Ok(DisplayEvent::Shown { at })
    }

    fn show(&mut self, picture: &Rgb8Image) -> Result<(), DeviceError> {
        if self.seen_at.is_some() {
            return Err(DeviceError::again());
        }
        (self.mode.width, self.mode.height) = (picture.width(), picture.height());
        let since = self.clock.now().0.saturating_sub(self.zero.0);
        let refreshes = since.div_euclid(self.period_ns) + 1;
        self.seen_at = Some(Timestamp(self.zero.0.saturating_add(refreshes.saturating_mul(self.period_ns))));
        Ok(())
    }

    /// The size is the last picture's; 0 x 0 before the first.
    fn mode(&self) -> DisplayMode {
        self.mode
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use crate::clock::ManualClock;

    #[test]
    fn pictures_are_seen_at_refreshes_one_at_a_time() {
        let clock = ManualClock::new(Timestamp(5));
        let mut display = NullDisplay::open("null:", "hz=100", Arc::new(clock.clone())).unwrap();
        let picture = Rgb8Image::filled(4, 3, [1; 3]);
        clock.wait_until(Timestamp(12_000_005));
        display.show(&picture).unwrap();
        assert_eq!(display.show(&picture).unwrap_err().kind, ErrorKind::Again, "the first was not seen yet");
        assert_eq!(display.next(Timestamp(19_000_000)).unwrap_err().kind, ErrorKind::Again);
        let seen = display.next(Timestamp(90_000_000)).unwrap();
        assert_eq!(seen, DisplayEvent::Shown { at: Timestamp(20_000_005) });
        display.show(&picture).unwrap();
        assert_eq!((display.mode().width, display.mode().height), (4, 3));
        for wrong in ["hz=0", "hz=nan", "fps=60", "hz=2000"] {
            let refused = NullDisplay::open("null:", wrong, Arc::new(clock.clone())).err().unwrap();
            assert_eq!(refused.kind, ErrorKind::Refused, "{wrong}");
        }
    }
}
