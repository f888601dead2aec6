//! The camera holds its next frame until the guest asks for it: until a program has queued a buffer for it and has taken
//! the frames before it. So a slow guest loses none.

use std::collections::VecDeque;

/// What the guest's program did with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffer {
    /// Empty, handed to the driver.
    Queued(u32),
    /// Full, taken from the driver.
    Taken(u32),
}

impl Buffer {
    /// Reads a line of the guest: `q3` or `d3`.
    pub fn of_line(line: &str) -> Option<Self> {
        let index = line.get(1..)?.trim().parse().ok()?;
        match line.as_bytes()[0] {
            b'q' => Some(Self::Queued(index)),
            b'd' => Some(Self::Taken(index)),
            _ => None,
        }
    }
}

/// Buffers of the guest's program, as far as they are known.
pub struct Pacing {
    queued: VecDeque<u32>,
    /// Frames sent that no program has taken yet.
    untaken: usize,
    /// The most of them.
    pub ahead: usize,
}

impl Default for Pacing {
    fn default() -> Self {
        Self { queued: VecDeque::new(), untaken: 0, ahead: 1 }
    }
}

impl Pacing {
    pub fn note(&mut self, buffer: Buffer) {
        match buffer {
            // A line about a stream that has ended may come late: a buffer is never counted twice.
            Buffer::Queued(index) => {
                self.queued.retain(|known| *known != index);
                self.queued.push_back(index);
            }
            Buffer::Taken(_) => self.untaken = self.untaken.saturating_sub(1),
        }
    }

    pub fn may_send(&self) -> bool {
        !self.queued.is_empty() && self.untaken < self.ahead
    }

    /// A whole frame went out: it fills a buffer. One that the driver throws away does not.
    pub fn sent(&mut self) {
        self.queued.pop_front();
        self.untaken += 1;
    }

    /// A stream begins, whose buffers may be queued already: nothing was sent to it.
    pub fn forget_untaken(&mut self) {
        self.untaken = 0;
    }

    /// The stream has ended, and its buffers with it.
    pub fn ended(&mut self) {
        self.queued.clear();
        self.untaken = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_waits_for_its_buffer_and_for_the_frame_before() {
        let mut pacing = Pacing::default();
        assert!(!pacing.may_send());
        for index in [0, 1, 1] {
            pacing.note(Buffer::Queued(index));
        }
        assert!(pacing.may_send());
        pacing.sent();
        assert!(!pacing.may_send(), "the first was not taken");
        pacing.note(Buffer::Taken(0));
        assert!(pacing.may_send());
        pacing.sent();
        pacing.note(Buffer::Taken(1));
        assert!(!pacing.may_send(), "no buffer is left");
        for buffer in [Buffer::Taken(1), Buffer::Queued(3)] {
            pacing.note(buffer);
        }
        pacing.sent();
        pacing.note(Buffer::Queued(4));
        assert!(!pacing.may_send(), "a frame that its program never took");
        pacing.forget_untaken();
        assert!(pacing.may_send(), "the next program waits for its own");
        assert_eq!(Buffer::of_line("q12\r"), Some(Buffer::Queued(12)));
        assert_eq!(Buffer::of_line(""), None);
    }
}
