//! A sensor without a camera, read until somebody stops it.

use crate::clock::{Clock, Signal};
use crate::{DeviceError, ErrorKind, ImuSource};

/// Signals are looked for so often while no sample comes, seconds.
const LOOK_EVERY_S: f64 = 0.25;

/// What came of a sensor by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorRun {
    /// Samples that it gave.
    pub samples: u64,
    /// From the first to the last, on the sensor's own times, seconds.
    pub span_s: f64,
}

/// Reads a sensor until the signal, for so many seconds of the clock, or until it goes away.
///
/// # Errors
/// It goes away before its first sample, or says that it cannot go on.
pub fn run(
    imu: &mut dyn ImuSource,
    clock: &dyn Clock,
    stop: &Signal,
    seconds: Option<f64>,
) -> Result<SensorRun, DeviceError> {
    let start = clock.now();
    let mut seen = SensorRun::default();
    let mut first = None;
    while !stop.is_raised() && seconds.is_none_or(|most| clock.now().seconds_since(start) < most) {
        match imu.next(clock.now().plus_seconds(LOOK_EVERY_S)) {
            Ok(sample) => {
                seen.samples += 1;
                seen.span_s = sample.t.seconds_since(*first.get_or_insert(sample.t));
            }
            Err(error) if matches!(error.kind, ErrorKind::Again | ErrorKind::Working) => {}
            Err(error) if error.kind == ErrorKind::Ended => break,
            // What was logged before the sensor went away is worth keeping.
            Err(error) if error.kind == ErrorKind::Reopen && seen.samples > 0 => {
                tracing::warn!("the log ends here: {error}");
                break;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(seen)
}
