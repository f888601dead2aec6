//! The camera's controls and its streaming parameters, as UVC asks for them.

use super::descriptors::{INTERVALS, PROCESSING, SIZES, TERMINAL};

const SET_CURRENT: u8 = 0x01;
const GET_CURRENT: u8 = 0x81;
const GET_LEAST: u8 = 0x82;
const GET_MOST: u8 = 0x83;
const GET_STEP: u8 = 0x84;
const GET_LENGTH: u8 = 0x85;
const GET_INFO: u8 = 0x86;
const GET_DEFAULT: u8 = 0x87;
/// Can be read and written.
const READ_AND_WRITE: u8 = 3;

/// Values of the mode of exposure.
pub const MANUAL: i64 = 1;
const APERTURE_PRIORITY: i64 = 8;
/// Exposure time that the automatic chooses, whatever it sees; 100 us.
const AUTOMATIC_EXPOSURE: i64 = 250;

/// One control: where it is, and what it takes.
struct Control {
    name: &'static str,
    entity: u8,
    selector: u8,
    bytes: usize,
    least: i64,
    most: i64,
    /// For the mode of exposure: the modes there are.
    step: i64,
    default: i64,
}

const CONTROLS: [Control; 4] = [
    Control {
        name: "mode",
        entity: TERMINAL,
        selector: 2,
        bytes: 1,
        least: 1,
        most: 8,
        step: MANUAL | APERTURE_PRIORITY,
        default: APERTURE_PRIORITY,
    },
    // 100 us to 1 s.
    Control {
        name: "exposure",
        entity: TERMINAL,
        selector: 4,
        bytes: 4,
        least: 1,
        most: 10_000,
        step: 1,
        default: 156,
    },
    Control {
        name: "brightness",
        entity: PROCESSING,
        selector: 2,
        bytes: 2,
        least: -64,
        most: 64,
        step: 1,
        default: 0,
    },
    Control {
        name: "gain",
        entity: PROCESSING,
        selector: 4,
        bytes: 2,
        least: 0,
        most: 255,
        step: 1,
        default: 16,
    },
];

/// What a frame is made with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Exposure time, 100 us.
    pub exposure: u16,
    /// 16 = none.
    pub gain: u16,
    /// Added to every value.
    pub brightness: i16,
}

/// What came of a request.
pub enum Answer {
    /// Bytes to send.
    Bytes(Vec<u8>),
    /// A control has this value now.
    Written(&'static str, i64),
    /// Streaming starts.
    Started,
    Done,
    Stall,
}

/// The camera's state, as its controls show it.
pub struct Controls {
    values: [i64; CONTROLS.len()],
    /// Number of the size, and the time between frames.
    probe: (u8, u32),
    committed: (u8, u32),
}

impl Default for Controls {
    fn default() -> Self {
        let format = (2, INTERVALS[0]);
        Self { values: CONTROLS.map(|control| control.default), probe: format, committed: format }
    }
}

impl Controls {
    /// What is set now.
    pub fn settings(&self) -> Settings {
        let [mode, exposure, brightness, gain] = self.values;
        let exposure = if mode == MANUAL { exposure } else { AUTOMATIC_EXPOSURE };
        Settings { exposure: exposure as u16, gain: gain as u16, brightness: brightness as i16 }
    }

    /// The size that streaming was started with.
    pub fn size(&self) -> (usize, usize) {
        SIZES[usize::from(self.committed.0.max(1) - 1).min(SIZES.len() - 1)]
    }

    /// Answers a request of UVC: `index` has the entity and the interface, `value` the selector.
    pub fn answer(&mut self, request: u8, value: u16, index: u16, bytes: &[u8]) -> Answer {
        let [interface, entity] = index.to_le_bytes();
        let selector = value.to_le_bytes()[1];
        if (interface, entity) == (1, 0) {
            return self.streaming(request, selector, bytes);
        }
        let place = CONTROLS
            .iter()
            .position(|control| interface == 0 && control.entity == entity && control.selector == selector);
        let Some(place) = place else { return Answer::Stall };
        let control = &CONTROLS[place];
        let value = match request {
            SET_CURRENT => {
                let Some(value) = number(bytes, control.bytes) else { return Answer::Stall };
                if control.name == "mode" && value != MANUAL && value != APERTURE_PRIORITY {
                    return Answer::Stall;
                }
                self.values[place] = value.clamp(control.least, control.most);
                return Answer::Written(control.name, self.values[place]);
            }
            GET_CURRENT => self.values[place],
            GET_LEAST => control.least,
            GET_MOST => control.most,
            GET_STEP => control.step,
            GET_DEFAULT => control.default,
            GET_INFO => return Answer::Bytes(vec![READ_AND_WRITE]),
            GET_LENGTH => return Answer::Bytes((control.bytes as u16).to_le_bytes().to_vec()),
            _ => return Answer::Stall,
        };
        Answer::Bytes(value.to_le_bytes()[..control.bytes].to_vec())
    }

    fn streaming(&mut self, request: u8, selector: u8, bytes: &[u8]) -> Answer {
        let is_commit = match selector {
            1 => false,
            2 => true,
            _ => return Answer::Stall,
        };
        match request {
            SET_CURRENT => {
                let Some(wish) = bytes.first_chunk::<8>() else { return Answer::Stall };
                let interval = u32::from_le_bytes([wish[4], wish[5], wish[6], wish[7]]);
                let nearest = INTERVALS.into_iter().min_by_key(|known| known.abs_diff(interval));
                self.probe = (wish[3].clamp(1, SIZES.len() as u8), nearest.unwrap_or(INTERVALS[0]));
                if is_commit {
                    self.committed = self.probe;
                    return Answer::Started;
                }
                Answer::Done
            }
            GET_CURRENT if is_commit => Answer::Bytes(parameters(self.committed)),
            GET_CURRENT | GET_LEAST | GET_MOST | GET_DEFAULT => Answer::Bytes(parameters(self.probe)),
            GET_LENGTH => Answer::Bytes(vec![26, 0]),
            GET_INFO => Answer::Bytes(vec![READ_AND_WRITE]),
            _ => Answer::Stall,
        }
    }
}

/// Bytes before a frame's own in its payload.
pub const PAYLOAD_HEAD: usize = 2;

/// Probe and commit: a payload is as long as a whole frame with its head.
fn parameters((size, interval): (u8, u32)) -> Vec<u8> {
    let (width, height) = SIZES[usize::from(size) - 1];
    let frame = (2 * width * height) as u32;
    let mut bytes = vec![0, 0, 1, size];
    bytes.extend(interval.to_le_bytes());
    bytes.extend([0; 10]);
    bytes.extend(frame.to_le_bytes());
    bytes.extend((frame + PAYLOAD_HEAD as u32).to_le_bytes());
    bytes
}

/// A signed number of 1 or 2 bytes, or an unsigned one of 4.
fn number(bytes: &[u8], length: usize) -> Option<i64> {
    let bytes = bytes.get(..length)?;
    Some(match *bytes {
        [a] => i64::from(a),
        [a, b] => i64::from(i16::from_le_bytes([a, b])),
        [a, b, c, d] => i64::from(u32::from_le_bytes([a, b, c, d])),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clamped_and_the_mode_decides() {
        let mut controls = Controls::default();
        assert_eq!(controls.settings().exposure, 250);
        let exposure = |controls: &mut Controls, value: u32| {
            controls.answer(SET_CURRENT, 0x0400, 0x0100, &value.to_le_bytes())
        };
        assert!(matches!(exposure(&mut controls, 20_000), Answer::Written("exposure", 10_000)));
        assert!(matches!(controls.answer(SET_CURRENT, 0x0200, 0x0100, &[4]), Answer::Stall));
        assert!(matches!(controls.answer(SET_CURRENT, 0x0200, 0x0100, &[1]), Answer::Written("mode", 1)));
        assert_eq!(controls.settings().exposure, 10_000);
        assert!(matches!(exposure(&mut controls, 0), Answer::Written("exposure", 1)));
        assert!(matches!(controls.answer(GET_CURRENT, 0x0900, 0x0100, &[]), Answer::Stall));
        assert!(matches!(controls.answer(GET_STEP, 0x0200, 0x0100, &[]), Answer::Bytes(b) if b == [9]));
    }

    #[test]
    fn a_commit_starts_the_size_that_was_asked_for() {
        let mut controls = Controls::default();
        let wish = [0, 0, 1, 1, 0x15, 0x16, 5, 0];
        assert!(matches!(controls.answer(SET_CURRENT, 0x0200, 1, &wish), Answer::Started));
        assert_eq!(controls.size(), (640, 480));
        let Answer::Bytes(bytes) = controls.answer(GET_CURRENT, 0x0100, 1, &[]) else { panic!("no bytes") };
        assert_eq!((bytes.len(), &bytes[22..]), (26, &614_402_u32.to_le_bytes()[..]));
    }
}
