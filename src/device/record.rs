//! `record`: a tee on any door. What passes through is written; what cannot be written still passes.

use super::recording::{RecordingWriter, Written};
use super::{DeviceError, FrameSource, ImuSource, ImuTruth};
use crate::asked_source::ask_source;
use crate::model::{
    frame::RawFrame,
    imu::{ImuOrientation, ImuSample},
    time::Timestamp,
};
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// The file behind a frame tee and an IMU tee.
pub struct Tape<W: Write + Seek = BufWriter<File>>(Arc<Mutex<TapeState<W>>>);

struct TapeState<W: Write + Seek> {
    writer: Option<RecordingWriter<W>>,
    failure: Option<DeviceError>,
}

impl<W: Write + Seek> Clone for Tape<W> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<W: Write + Seek> Tape<W> {
    /// Takes a writer.
    pub fn new(writer: RecordingWriter<W>) -> Self {
        Self(Arc::new(Mutex::new(TapeState { writer: Some(writer), failure: None })))
    }

    /// Writes unless something failed before; the first failure is kept for `finish`.
    fn write(&self, action: impl FnOnce(&mut RecordingWriter<W>) -> Result<(), DeviceError>) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let TapeState { writer, failure } = &mut *state;
        if failure.is_none()
            && let Some(Err(error)) = writer.as_mut().map(action)
        {
            tracing::warn!("recording stops: {error}");
            *failure = Some(error);
        }
    }

    /// Closes the file: what was written, or the first failure. Later frames pass unwritten.
    pub fn finish(&self) -> Result<(Written, Option<W>), DeviceError> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let writer = state.writer.take();
        if let Some(failure) = state.failure.take() {
            return Err(failure);
        }
        match writer {
            Some(writer) => writer.finish().map(|(written, target)| (written, Some(target))),
            None => Ok((Written::default(), None)),
        }
    }
}

/// A camera whose frames are written as they pass.
pub struct Recorder<S: FrameSource, W: Write + Seek = BufWriter<File>> {
    source: S,
    tape: Tape<W>,
}

impl<S: FrameSource, W: Write + Seek> Recorder<S, W> {
    /// Puts a tape on a source.
    pub fn new(source: S, tape: Tape<W>) -> Self {
        Self { source, tape }
    }
}

impl<S: FrameSource, W: Write + Seek + Send> FrameSource for Recorder<S, W> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let frame = self.source.next(deadline)?;
        let truth = self.source.truth();
        self.tape.write(|writer| writer.write_frame(&frame, truth.as_ref()));
        Ok(frame)
    }

    ask_source!(set_exposures rig response frames_left truth scene delivers_at_once pixel_format bracket_report);
}

/// An IMU whose samples are written as they pass.
pub struct ImuRecorder<I: ImuSource, W: Write + Seek = BufWriter<File>> {
    source: I,
    tape: Tape<W>,
}

impl<I: ImuSource, W: Write + Seek> ImuRecorder<I, W> {
    /// Puts a tape on a source.
    pub fn new(source: I, tape: Tape<W>) -> Self {
        Self { source, tape }
    }
}

impl<I: ImuSource, W: Write + Seek + Send> ImuSource for ImuRecorder<I, W> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let sample = self.source.next(deadline)?;
        self.tape.write(|writer| writer.write_imu(&[sample]));
        Ok(sample)
    }

    fn orientation(&self) -> Option<ImuOrientation> {
        self.source.orientation()
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        self.source.imu_truth()
    }

    fn delivers_at_once(&self) -> bool {
        self.source.delivers_at_once()
    }
}
