//! What is held until all messages of one moment have come: their order in the file is the writer's.

use crate::recording::Message;
use std::collections::VecDeque;

/// Moments that are remembered.
const MOST_MOMENTS: usize = 64;
/// Pictures that wait for what is said of them.
const MOST_WAITING: usize = 8;
/// Bytes of them.
const MOST_WAITING_BYTES: usize = 1 << 26;

/// The newest values, by their moments.
pub(super) struct Recent<T>(VecDeque<(i64, T)>);

impl<T> Default for Recent<T> {
    fn default() -> Self {
        Self(VecDeque::new())
    }
}

impl<T> Recent<T> {
    /// Takes a value, and forgets the oldest where there are too many.
    pub(super) fn put(&mut self, t: i64, value: T) {
        if self.0.len() >= MOST_MOMENTS {
            self.0.pop_front();
        }
        self.0.push_back((t, value));
    }

    /// The newest value of a moment.
    pub(super) fn get(&self, t: i64) -> Option<&T> {
        self.0.iter().rev().find(|(of, _)| *of == t).map(|(_, value)| value)
    }
}

/// Pictures in the order of the file, not decoded.
#[derive(Default)]
pub(super) struct WaitingPictures {
    pictures: VecDeque<Message>,
    bytes: usize,
}

impl WaitingPictures {
    pub(super) fn put(&mut self, picture: Message) {
        self.bytes += picture.content.len();
        self.pictures.push_back(picture);
    }

    pub(super) fn pop(&mut self) -> Option<Message> {
        let picture = self.pictures.pop_front()?;
        self.bytes -= picture.content.len();
        Some(picture)
    }

    pub(super) fn first_time(&self) -> Option<i64> {
        self.pictures.front().map(|picture| picture.log_time)
    }

    /// Whether the first can wait no longer.
    pub(super) fn is_full(&self) -> bool {
        self.pictures.len() > MOST_WAITING || self.bytes > MOST_WAITING_BYTES
    }
}
