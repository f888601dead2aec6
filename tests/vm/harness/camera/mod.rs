//! A whole USB camera outside of the guest, plugged in through QEMU's usb-redir. It knows every control write and every
//! frame that it sent, with the exposure that the frame truly had.

mod connection;
mod controls;
mod descriptors;
mod exposures;
mod pacing;
mod pictures;

pub use exposures::Delay;
pub use pacing::Buffer;
pub use pictures::Pictures;

pub use connection::locked;

use connection::Connection;
use controls::{Controls, PAYLOAD_HEAD, Settings};
use exposures::Exposures;
use pacing::Pacing;
use std::collections::VecDeque;

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    Sent,
    /// Half of it was sent: the driver drops it, and its count has a gap.
    Short,
    /// Made and never sent: nobody outside of the camera can tell.
    Dropped,
}

/// One frame that the camera made.
#[derive(Clone, Copy, Debug)]
pub struct Made {
    pub number: u64,
    pub settings: Settings,
    pub digest: u64,
    pub fate: Fate,
}

/// What is to go wrong, counted in frames that are still to be made: 1 = after or with the next one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    pub unplug_after: Option<u64>,
    pub silent_after: Option<u64>,
    pub short: Option<u64>,
    pub drop: Option<u64>,
}

/// Takes one frame off; returns whether it was the last.
fn is_due(fault: &mut Option<u64>) -> bool {
    match fault {
        Some(left) => {
            *left = left.saturating_sub(1);
            let due = *left == 0;
            if due {
                *fault = None;
            }
            due
        }
        None => false,
    }
}

/// The frame that is on its way, in pieces as long as the guest asks for.
struct InHand {
    payload: Vec<u8>,
    at: usize,
    made: Made,
}

/// The camera, one for the whole run. What it is set to is lost when it is pulled out, as with a real one; its log is not.
pub struct Camera {
    connection: Option<Connection>,
    /// Times that it was plugged in.
    plugged: u64,
    controls: Controls,
    exposures: Exposures,
    pub pacing: Pacing,
    pub delay: Delay,
    pub faults: Faults,
    pub pictures: Pictures,
    is_streaming: bool,
    is_silent: bool,
    toggle: bool,
    /// Transfers that wait for bytes: id and length.
    waiting: VecDeque<(u64, usize)>,
    in_hand: Option<InHand>,
    made: Vec<Made>,
    writes: Vec<(u64, &'static str, i64)>,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            connection: None,
            plugged: 0,
            controls: Controls::default(),
            exposures: Exposures::default(),
            pacing: Pacing::default(),
            delay: Delay { lag: 2, jitter: 0 },
            faults: Faults::default(),
            pictures: Pictures::Pattern,
            is_streaming: false,
            is_silent: false,
            toggle: false,
            waiting: VecDeque::new(),
            in_hand: None,
            made: Vec::new(),
            writes: Vec::new(),
        }
    }
}

impl Camera {
    /// Every frame made so far.
    pub fn made(&self) -> &[Made] {
        &self.made
    }

    /// Every write to a control so far: frames made before it, the control, its value after it.
    pub fn writes(&self) -> &[(u64, &'static str, i64)] {
        &self.writes
    }

    fn stop(&mut self) {
        self.is_streaming = false;
        self.waiting.clear();
        self.in_hand = None;
        self.pacing.ended();
    }

    /// Pulls the camera out.
    pub fn unplug(&mut self) {
        self.stop();
        self.is_silent = false;
        self.connection = None;
        self.controls = Controls::default();
        self.exposures = Exposures::default();
    }

    /// A program of the guest queued or took a buffer.
    pub fn buffer(&mut self, buffer: Buffer) {
        self.pacing.note(buffer);
        self.pump();
    }

    /// Makes the next frame, with its faults.
    fn make(&mut self) -> InHand {
        let number = self.made.len() as u64;
        let settings = self.exposures.start(self.controls.settings(), self.delay, number);
        let picture = self.pictures.draw(number, settings, self.controls.size());
        let digest = halflight_vm::digest(&picture);
        let fate = if is_due(&mut self.faults.drop) {
            Fate::Dropped
        } else if is_due(&mut self.faults.short) {
            Fate::Short
        } else {
            Fate::Sent
        };
        let made = Made { number, settings, digest, fate };
        self.made.push(made);
        // The end of the frame is in this payload, which is the frame's only one.
        let head = 0x80 | 0x02 | u8::from(self.toggle);
        let mut payload = vec![PAYLOAD_HEAD as u8, head];
        let length = if fate == Fate::Short { picture.len() / 2 + 1 } else { picture.len() };
        payload.extend(&picture[..length]);
        InHand { payload, at: 0, made }
    }

    /// Sends what may be sent: as much as the guest has transfers for.
    fn pump(&mut self) {
        while self.is_streaming && !self.waiting.is_empty() {
            if self.in_hand.is_none() {
                if self.is_silent || !self.pacing.may_send() {
                    return;
                }
                let next = self.make();
                if next.made.fate == Fate::Dropped {
                    continue;
                }
                self.toggle = !self.toggle;
                self.in_hand = Some(next);
            }
            let (Some(frame), Some((id, length)), Some(connection)) =
                (&mut self.in_hand, self.waiting.pop_front(), &mut self.connection)
            else {
                return;
            };
            let end = (frame.at + length).min(frame.payload.len());
            connection.bulk(id, &frame.payload[frame.at..end]);
            frame.at = end;
            if end == frame.payload.len() {
                let fate = frame.made.fate;
                self.in_hand = None;
                self.finished(fate);
            }
        }
    }

    fn finished(&mut self, fate: Fate) {
        if fate == Fate::Sent {
            self.pacing.sent();
        }
        self.is_silent |= is_due(&mut self.faults.silent_after);
        if is_due(&mut self.faults.unplug_after) {
            self.unplug();
        }
    }
}
