//! A camera that gives bytes of any format, as one that gives 8-bit RGB, and beside it what a sensor of more bits gave.
//!
//! The conversion runs on the camera's own thread, in one pass, into pictures that are used again; the driver's buffer goes
//! back to it as soon as that is done, before anybody looks at the picture.

use crate::hdr::develop::{Developed, Developer, SensorOptions};
use crate::model::{
    frame::{CapturedFrame, Exposure, RawFrame},
    pixels::PixelFormat,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use crate::{DeviceError, ErrorKind, FrameSource};

/// A driver's own door: a camera before its pictures are developed. It owes what [`FrameSource`] owes.
pub trait CaptureSource: Send {
    /// The next frame; its buffer goes back to the driver when the frame is dropped.
    fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError>;

    /// As [`FrameSource::set_exposures`].
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError>;

    /// As [`FrameSource::rig`].
    fn rig(&self) -> Option<Rig>;

    /// As [`FrameSource::pixel_format`].
    fn pixel_format(&self) -> Option<PixelFormat> {
        None
    }

    /// The camera as such, whatever its place today: what was found out about it holds when it comes back. Empty where
    /// nothing tells it from others.
    fn identity(&self) -> String {
        String::new()
    }
}

/// Develops what a driver captures.
pub struct DevelopedCamera<S> {
    device: String,
    source: S,
    developer: Developer,
    response: Response,
    /// The newest frame came as a sensor's own linear values, which were put through the response here.
    is_coded_here: bool,
    /// Frames in a row that could not be developed.
    broken: u32,
    broken_in_all: u64,
}

/// So many frames in a row that cannot be developed mean that the camera has lost its state.
pub const MOST_BROKEN_IN_A_ROW: u32 = 30;

impl<S: CaptureSource> DevelopedCamera<S> {
    /// `response` is what the camera's 8-bit values mean; a Bayer sensor is linear and is put through it. `Refused` where
    /// the options are no sensor's.
    pub fn new(
        device: impl Into<String>,
        source: S,
        response: Response,
        sensor: SensorOptions,
    ) -> Result<Self, DeviceError> {
        let device = device.into();
        let developer = Developer::new(&response, sensor)
            .map_err(|e| DeviceError::new(&device, "develop its pictures", ErrorKind::Refused).because(e))?;
        Ok(Self { device, source, developer, response, is_coded_here: false, broken: 0, broken_in_all: 0 })
    }

    /// Returns whether the newest frame came as linear values: its 8-bit values mean what the response says, and nothing is to be found out.
    pub fn is_coded_here(&self) -> bool {
        self.is_coded_here
    }

    /// States what the camera's own 8-bit values have been found to mean.
    pub fn state_response(&mut self, response: Response) {
        self.response = response;
    }

    /// The driver.
    pub fn source_mut(&mut self) -> &mut S {
        &mut self.source
    }

    /// Frames that could not be developed so far.
    pub fn broken_frames(&self) -> u64 {
        self.broken_in_all
    }
}

impl<S: CaptureSource> FrameSource for DevelopedCamera<S> {
    /// A frame that cannot be developed (a JPEG file that was cut) is counted and left out; too many in a row are `Reopen`.
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        loop {
            let captured = self.source.next(deadline)?;
            let error = match self.developer.develop(&captured.pixels) {
                Ok(Developed { pixels, sensor }) => {
                    self.broken = 0;
                    let row_time_s = captured.pixels.layout().row_time_s;
                    self.is_coded_here = matches!(captured.pixels.layout().format, PixelFormat::Bayer(..));
                    let CapturedFrame { sequence, t_mid, exposure, .. } = captured;
                    return Ok(RawFrame {
                        sequence,
                        t_mid,
                        exposure,
                        pixels,
                        sensor,
                        row_time_s,
                        response: None,
                    });
                }
                Err(error) => error,
            };
            self.broken += 1;
            self.broken_in_all += 1;
            if self.broken >= MOST_BROKEN_IN_A_ROW {
                self.broken = 0;
                let action = format!("{MOST_BROKEN_IN_A_ROW} frames in a row cannot be read");
                return Err(DeviceError::new(&self.device, action, ErrorKind::Reopen).because(error));
            }
            tracing::warn!("{}: frame {} is left out: {error}", self.device, captured.sequence);
        }
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        self.source.set_exposures(exposures)
    }

    fn pixel_format(&self) -> Option<PixelFormat> {
        self.source.pixel_format()
    }

    fn rig(&self) -> Option<Rig> {
        self.source.rig()
    }

    fn response(&self) -> Option<Response> {
        Some(self.response.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{Clock, ManualClock};
    use crate::fake::{FakeDevice, FakePort, FakeScript, FakeStep};
    use crate::model::pixels::{BayerDepth, BayerOrder, PixelFormat, PixelLayout, PixelPool};
    use std::sync::Arc;

    impl CaptureSource for FakeDevice<CapturedFrame> {
        fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
            FakeDevice::next(self, deadline)
        }

        fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
            Ok(exposures.to_vec())
        }

        fn rig(&self) -> Option<Rig> {
            None
        }
    }

    /// A camera with two buffers of this layout; frame k is filled with the value that `fill` gives.
    fn camera(
        layout: PixelLayout,
        steps: Vec<FakeStep>,
        mut fill: impl FnMut(u64) -> u8 + Send + 'static,
    ) -> (DevelopedCamera<FakeDevice<CapturedFrame>>, ManualClock) {
        let clock = ManualClock::default();
        let mut pool = PixelPool::new((0..2).map(|_| vec![0u8; layout.least_bytes()]));
        let make = move |sequence, t_mid| {
            let (k, memory) = pool.free().expect("the driver's buffers have come back");
            memory.fill(fill(sequence));
            let pixels = pool.lend(k, layout, layout.least_bytes()).unwrap().unwrap();
            CapturedFrame { sequence, t_mid, exposure: Exposure { time_s: 0.01, gain: 1.0 }, pixels }
        };
        let port = FakePort::new(Arc::new(clock.clone()), 0.03, FakeScript::Steps(steps), make);
        let source = port.open().unwrap();
        let camera = DevelopedCamera::new("fake", source, Response::srgb(), SensorOptions::default());
        (camera.unwrap(), clock)
    }

    #[test]
    fn buffers_are_free_again_while_pictures_are_held() {
        let layout = PixelLayout::packed(PixelFormat::Yuyv, 6, 4);
        let (mut camera, clock) = camera(layout, vec![FakeStep::Item], |_| 128);
        let mut held = Vec::new();
        for k in 0..20 {
            let frame = camera.next(clock.now().plus_seconds(1.0)).unwrap();
            assert_eq!((frame.sequence, frame.pixels.pixels()[7]), (k, [128; 3]));
            held.push(frame);
        }
    }

    #[test]
    fn a_sensor_of_more_than_8_bits_hands_on_what_it_gave() {
        let of = |depth| {
            let layout = PixelLayout::packed(PixelFormat::Bayer(BayerOrder::Rggb, depth), 6, 4);
            let (mut camera, clock) = camera(layout, vec![FakeStep::Item], |_| 3);
            camera.next(clock.now().plus_seconds(1.0)).unwrap()
        };
        let (fine, coarse) = (of(BayerDepth::Bits12), of(BayerDepth::Bits8));
        assert!(coarse.sensor.is_none());
        let sensor = fine.sensor.unwrap();
        // Bytes of 3 are values of 771, 16 of ours each.
        assert_eq!((sensor.values.pixels()[7], sensor.scale.step), ([16 * 771; 3], 16.0));
    }

    #[test]
    fn frames_that_cannot_be_read_are_left_out_and_too_many_are_a_loss() {
        let layout = PixelLayout::packed(PixelFormat::Mjpeg, 6, 4);
        let (mut camera, clock) = camera(layout, vec![FakeStep::Item], |_| 1);
        let error = camera.next(clock.now().plus_seconds(100.0)).unwrap_err();
        assert_eq!(
            (error.kind, camera.broken_frames()),
            (ErrorKind::Reopen, u64::from(MOST_BROKEN_IN_A_ROW))
        );
        assert!(error.to_string().contains("does not begin as a JPEG file"), "{error}");
    }
}
