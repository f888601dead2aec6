//! The loop: one event after the other, live and in lockstep.

use super::event::{ArrivedFrame, Awaited, Command, DeviceRole, Event, EventSource};
use super::policy::{self, Absences, Shows};
use super::schedule::{Latch, Rhythm, Schedule};
use super::{Pipeline, PipelineError, frame::FrameOutcome};
use crate::device::{DeviceError, Truth};
use crate::model::{frame::RawFrame, picture::Picture, time::Timestamp};
use crate::plan::PassTiming;

/// The loop looks around at least so often, seconds.
const LONGEST_WAIT_S: f64 = 0.25;

/// A frame that is done.
#[derive(Clone, Copy)]
pub struct FinishedFrame<'a> {
    /// As it came.
    pub raw: &'a RawFrame,
    /// What the source knows of it.
    pub truth: Option<&'a Truth>,
    /// What became of it.
    pub outcome: &'a FrameOutcome,
    /// Times of the engine's passes, in order.
    pub passes: &'a [PassTiming],
    /// What is shown.
    pub picture: &'a Picture,
}

/// Takes finished pictures, on the pipeline's thread.
pub trait FrameSink {
    /// One picture with what is known of its frame. `false` asks to stop.
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError>;

    /// A picture for the time that no frame comes, and what it says. `false` asks to stop.
    fn hold(&mut self, _says: &str, _picture: &Picture) -> Result<bool, PipelineError> {
        Ok(true)
    }

    /// When pictures are seen, where a display says so through which the eye sees the place itself. A display that shows
    /// the camera's picture has none: objects must stand where that picture has them, at the frame's own time.
    fn rhythm(&self) -> Option<Rhythm> {
        None
    }
}

/// What one run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunCounts {
    /// Frames that went through.
    pub frames: u64,
    /// Frames that were passed over for newer ones.
    pub passed_over: u64,
    /// Frames that are missing in the source's count.
    pub lost_by_source: u64,
    /// Frames shown without virtual objects.
    pub passed_through: u64,
    /// Pictures shown while no frame came.
    pub held: u64,
    /// Times that a device was lost.
    pub devices_lost: u64,
}

/// Feeds events to the pipeline until the source ends, `frames` (0 = no limit) have gone through, or the sink or a command
/// asks to stop.
///
/// # Errors
/// A camera that fails for good, a sink that cannot go on. What can come back is waited for.
pub fn run(
    events: &mut dyn EventSource,
    pipeline: &mut Pipeline,
    sink: &mut dyn FrameSink,
    frames: u64,
) -> Result<RunCounts, PipelineError> {
    let mut turns = Turns {
        pipeline,
        sink,
        frames,
        counts: RunCounts::default(),
        absences: Absences::default(),
        schedule: Schedule::default(),
        last_sequence: None,
        held: None,
    };
    while turns.take(events)? {}
    Ok(turns.counts)
}

/// The state of the loop.
struct Turns<'a> {
    pipeline: &'a mut Pipeline,
    sink: &'a mut dyn FrameSink,
    /// Frames at most; 0 = no limit.
    frames: u64,
    counts: RunCounts,
    absences: Absences,
    schedule: Schedule,
    last_sequence: Option<u64>,
    /// What the picture says that is shown while no frame comes.
    held: Option<&'static str>,
}

impl Turns<'_> {
    /// One event. Returns whether to go on.
    fn take(&mut self, events: &mut dyn EventSource) -> Result<bool, PipelineError> {
        let now = events.now();
        self.schedule.follow(self.sink.rhythm());
        let latch = self.schedule.next(now);
        match events.next_event(self.awaited(latch, now)) {
            Event::Frame(arrived) => return self.frame(&arrived, latch, events),
            Event::Imu(sample) => self.pipeline.sense(&sample),
            Event::Command(Command::Change(change)) => self.pipeline.change(*change),
            Event::Command(Command::Stop) => return Ok(false),
            Event::Due => self.absences.look_at_the_clock(events.now()),
            Event::Lost(role, error) => self.lose(role, &error, events.now()),
            Event::Back(role) => {
                if let Some(lost_s) = self.absences.find(role, events.now()) {
                    tracing::info!("{} is back after {lost_s:.2} s", role.name());
                }
            }
            Event::Ended(how) => return how.map(|()| false).map_err(PipelineError::Device),
        }
        self.hold(events.now())
    }

    fn awaited(&self, latch: Latch, now: Timestamp) -> Awaited {
        let mut deadline = now.plus_seconds(LONGEST_WAIT_S);
        if latch.take_at > now {
            deadline = deadline.min(latch.take_at);
        }
        let is_there = !self.absences.lacks(DeviceRole::Camera);
        if let Some(silent_at) = self.absences.silent_at().filter(|_| is_there) {
            deadline = deadline.min(silent_at);
        }
        Awaited { frame: latch.take_at <= now, deadline }
    }

    fn lose(&mut self, role: DeviceRole, error: &DeviceError, now: Timestamp) {
        tracing::warn!("{} is lost, and is waited for: {error}", role.name());
        self.counts.devices_lost += 1;
        self.absences.lose(role, now);
    }

    /// Draws a frame and hands the picture on.
    fn frame(
        &mut self,
        arrived: &ArrivedFrame,
        latch: Latch,
        events: &mut dyn EventSource,
    ) -> Result<bool, PipelineError> {
        let ArrivedFrame { frame, passed_over, truth } = arrived;
        let began = events.now();
        if let Some(lost_s) = self.absences.frame_came(began) {
            tracing::info!("frames come again after {lost_s:.2} s");
        }
        self.held = None;
        self.counts.passed_over += passed_over;
        if let Some(last) = self.last_sequence.replace(frame.sequence) {
            // A camera that was opened anew counts from 0 again.
            let missing = frame.sequence.saturating_sub(last.saturating_add(1));
            self.counts.lost_by_source += missing.saturating_sub(*passed_over);
        }
        if let Some(row) = policy::judge(self.absences.missing(began)) {
            self.pipeline.note(format_args!("{}", row.says));
        }
        let outcome = self.pipeline.frame_for(frame, latch.shown_at, events.frame_ahead())?;
        self.schedule.drew(latch, events.now().0.saturating_sub(began.0));
        self.counts.frames += 1;
        self.counts.passed_through += u64::from(outcome.shown.is_passed_through());
        let finished = FinishedFrame {
            raw: frame,
            truth: truth.as_deref(),
            outcome: &outcome,
            passes: self.pipeline.passes(),
            picture: self.pipeline.picture(),
        };
        let goes_on = self.sink.accept(&finished)?;
        Ok(goes_on && (self.frames == 0 || self.counts.frames < self.frames))
    }

    /// Shows the last picture with what is missing, once for each thing that is said.
    fn hold(&mut self, now: Timestamp) -> Result<bool, PipelineError> {
        let row = policy::judge(self.absences.missing(now));
        let says = row.filter(|row| row.shows == Shows::LastPicture).map(|row| row.says);
        if says == self.held {
            return Ok(true);
        }
        // The picture stays marked until the next frame comes.
        let Some(says) = says else { return Ok(true) };
        self.held = Some(says);
        self.counts.held += 1;
        self.sink.hold(says, self.pipeline.hold(says))
    }
}
