//! Commands by lines on standard input, replies on standard output; over any reader and writer.

use crate::clock::Clock;
use crate::model::time::Timestamp;
use crate::{CommandLink, DeviceError, ErrorKind, Request};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// Lines that wait at most; the reader stops reading until one is taken.
const WAITING_LINES: usize = 16;

/// A line, or what is wrong with it.
type ReadLine = Result<String, &'static str>;

/// Reads lines on a thread of its own, since reading a pipe or a terminal has no deadline. The thread ends with its input,
/// or with the first line after the link was dropped.
pub struct LineLink<W> {
    lines: Receiver<ReadLine>,
    replies: W,
    clock: Arc<dyn Clock>,
    requests: u64,
}

impl<W: Write + Send> LineLink<W> {
    /// Takes over an input and an output. `Refused` where no thread can be made.
    pub fn new(
        input: impl Read + Send + 'static,
        replies: W,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let (give, lines) = sync_channel(WAITING_LINES);
        std::thread::Builder::new()
            .name("halflight-line".into())
            .spawn(move || read_lines(input, &give))
            .map_err(|e| DeviceError::new("stdio", "start its thread", ErrorKind::Refused).because(e))?;
        Ok(Self { lines, replies, clock, requests: 0 })
    }

    fn write(&mut self, id: u64, text: &str) -> Result<(), DeviceError> {
        let gone = |e| DeviceError::new("stdio", "reply", ErrorKind::Ended).because(e);
        writeln!(self.replies, "{id} {text}").and_then(|()| self.replies.flush()).map_err(gone)
    }
}

impl<W: Write + Send> CommandLink for LineLink<W> {
    fn next(&mut self, deadline: Timestamp) -> Result<Request, DeviceError> {
        loop {
            let left = u64::try_from(deadline.0.saturating_sub(self.clock.now().0)).unwrap_or(0);
            match self.lines.recv_timeout(Duration::from_nanos(left)) {
                Ok(Ok(text)) => {
                    self.requests += 1;
                    return Ok(Request { id: self.requests, text });
                }
                Ok(Err(why)) => {
                    self.requests += 1;
                    self.write(self.requests, &format!("error: the line {why}"))?;
                }
                Err(RecvTimeoutError::Timeout) => return Err(DeviceError::again()),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(DeviceError::new("stdio", "read: the input has ended", ErrorKind::Ended));
                }
            }
        }
    }

    fn reply(&mut self, id: u64, text: &str) -> Result<(), DeviceError> {
        self.write(id, text)
    }
}

/// Cuts bytes into lines. A line that is too long, or is not UTF-8, is named and dropped; half a line at the end is dropped.
fn read_lines(mut input: impl Read, give: &SyncSender<ReadLine>) {
    let mut line = Vec::with_capacity(Request::LONGEST);
    let (mut is_too_long, mut bytes) = (false, [0u8; 256]);
    loop {
        let count = match input.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => count,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) => return,
        };
        for &byte in &bytes[..count] {
            if byte != b'\n' {
                is_too_long |= line.len() >= Request::LONGEST;
                if !is_too_long {
                    line.push(byte);
                }
                continue;
            }
            let read = match std::str::from_utf8(&line) {
                _ if is_too_long => Err("is longer than 1024 bytes"),
                Ok(text) => Ok(text.trim_end_matches('\r').to_owned()),
                Err(_) => Err("is not UTF-8"),
            };
            line.clear();
            is_too_long = false;
            if give.send(read).is_err() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MonotonicClock;
    use proptest::prelude::*;

    fn answers(input: Vec<u8>) -> (Vec<String>, String) {
        let mut replies = Vec::new();
        let clock = Arc::new(MonotonicClock::default());
        let mut link = LineLink::new(std::io::Cursor::new(input), &mut replies, clock.clone()).unwrap();
        let mut requests = Vec::new();
        loop {
            match link.next(clock.now().plus_seconds(10.0)) {
                Ok(command) => {
                    link.reply(command.id, "ok").unwrap();
                    requests.push(command.text);
                }
                Err(error) => {
                    assert_eq!(error.kind, ErrorKind::Ended);
                    break;
                }
            }
        }
        drop(link);
        (requests, String::from_utf8(replies).unwrap())
    }

    #[test]
    fn whole_lines_are_requests_and_the_rest_is_answered() {
        let mut input = b"status\r\nget quality\n".to_vec();
        input.extend(vec![b'x'; 5000]);
        input.extend(b"\n\xff\xfe\nhelp\nhalf a line");
        let (requests, replies) = answers(input);
        assert_eq!(requests, ["status", "get quality", "help"]);
        let lines: Vec<&str> = replies.lines().collect();
        assert_eq!(lines[2], "3 error: the line is longer than 1024 bytes");
        assert_eq!((lines[3], lines[4]), ("4 error: the line is not UTF-8", "5 ok"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_one_answer_a_line(input in prop::collection::vec(any::<u8>(), 0..4000)) {
            let lines = input.iter().filter(|byte| **byte == b'\n').count();
            let (requests, replies) = answers(input);
            // A request may hold what ends a line for others.
            let answered = replies.split('\n').filter(|line| !line.is_empty()).count();
            prop_assert_eq!(answered, lines);
            prop_assert!(requests.len() <= lines);
            prop_assert!(requests.iter().all(|text| text.len() <= Request::LONGEST));
        }
    }
}
