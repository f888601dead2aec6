//! Fake devices with faults by script, for tests and for the replay harness. They live on a clock that is handed in, so
//! that nothing really sleeps; see [`crate::clock`] for those that jump and those that a test steps.
//!
//! A [`FakePort`] is what the device is plugged into: it stays when the device is lost and opened anew, so the script goes
//! on where it was.

use crate::clock::{Clock, Signal};
use crate::model::{
    frame::{Exposure, RawFrame},
    image::Rgb8Image,
    imu::ImuSample,
    rig::Rig,
    time::Timestamp,
};
use crate::synthetic::random::uniform;
use crate::{
    CommandLink, DeviceError, Display, DisplayEvent, DisplayMode, ErrorKind, FrameSource, ImuSource, Request,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a fake device does when it is asked for an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FakeStep {
    /// Gives an item, one period after the one before.
    Item,
    /// Gives an item at once, however often it is asked.
    Flood,
    /// Gives nothing and keeps its deadline.
    Silence,
    /// Has nothing to hand on yet, says that it works, and keeps its deadline.
    Work,
    /// Gives nothing and ignores its deadline, until [`FakePort::release`].
    Deafness,
    /// Is pulled out.
    Loss,
    /// Is pulled out, and cannot be opened for so many milliseconds of the clock.
    LossFor(u32),
    /// Refuses.
    Refusal,
    /// Says that there is no more.
    End,
    /// The device's own thread ends.
    Panic,
}

/// What a fake device does at each call.
#[derive(Clone, Debug)]
pub enum FakeScript {
    /// An item at each call.
    Steady,
    /// These steps, then the last one for ever. No steps: an item at each call.
    Steps(Vec<FakeStep>),
    /// Items, and with this probability a step that is not an item; after so many such steps the source ends.
    Random {
        /// Chooses when.
        seed: u64,
        /// Probability of a fault at each call.
        share: f64,
        /// What happens then.
        fault: FakeStep,
        /// How many faults there are; then comes [`FakeStep::End`].
        faults: u64,
    },
}

/// What has happened to a fake device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FakeCounts {
    /// Calls for an item.
    pub calls: u64,
    /// Items given.
    pub items: u64,
    /// Times opened.
    pub opened: u64,
    /// Devices that are open now.
    pub open_now: u64,
    /// Faults played.
    pub faults: u64,
}

struct PortState<T> {
    script: FakeScript,
    counts: FakeCounts,
    last_item: Option<Timestamp>,
    closed_until: Timestamp,
    make: Box<dyn FnMut(u64, Timestamp) -> T + Send>,
}

/// Where a fake device is plugged in. Clones share it.
pub struct FakePort<T> {
    clock: Arc<dyn Clock>,
    period_s: f64,
    release: Signal,
    state: Arc<Mutex<PortState<T>>>,
}

impl<T> Clone for FakePort<T> {
    fn clone(&self) -> Self {
        Self {
            clock: Arc::clone(&self.clock),
            period_s: self.period_s,
            release: self.release.clone(),
            state: Arc::clone(&self.state),
        }
    }
}

impl<T> FakePort<T> {
    /// A device that makes its k-th item (k from 0) for a time with `make`, `period_s` apart.
    pub fn new(
        clock: Arc<dyn Clock>,
        period_s: f64,
        script: FakeScript,
        make: impl FnMut(u64, Timestamp) -> T + Send + 'static,
    ) -> Self {
        let state = PortState {
            script,
            counts: FakeCounts::default(),
            last_item: None,
            closed_until: Timestamp(i64::MIN),
            make: Box::new(make),
        };
        Self { clock, period_s, release: Signal::default(), state: Arc::new(Mutex::new(state)) }
    }

    /// What has happened so far.
    pub fn counts(&self) -> FakeCounts {
        self.lock().counts
    }

    /// Lets calls return that ignore their deadline.
    pub fn release(&self) {
        self.release.raise();
    }

    /// Opens the device. `Reopen` while it is pulled out.
    pub fn open(&self) -> Result<FakeDevice<T>, DeviceError> {
        let now = self.clock.now();
        let mut state = self.lock();
        if now < state.closed_until {
            return Err(DeviceError::new("fake", "open: it is pulled out", ErrorKind::Reopen));
        }
        state.counts.opened += 1;
        state.counts.open_now += 1;
        Ok(FakeDevice { port: self.clone() })
    }

    fn lock(&self) -> MutexGuard<'_, PortState<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> PortState<T> {
    fn step(&mut self) -> FakeStep {
        let call = self.counts.calls;
        self.counts.calls += 1;
        let step = match &self.script {
            FakeScript::Steady => FakeStep::Item,
            FakeScript::Steps(steps) => {
                let at = usize::try_from(call).unwrap_or(usize::MAX);
                steps.get(at).or(steps.last()).copied().unwrap_or(FakeStep::Item)
            }
            FakeScript::Random { faults, .. } if self.counts.faults >= *faults => FakeStep::End,
            FakeScript::Random { seed, share, fault, .. } if uniform([*seed, 0xfa6e, call]) < *share => {
                *fault
            }
            FakeScript::Random { .. } => FakeStep::Item,
        };
        self.counts.faults += u64::from(!matches!(step, FakeStep::Item | FakeStep::Flood | FakeStep::End));
        step
    }

    fn item(&mut self, t: Timestamp) -> T {
        let k = self.counts.items;
        self.counts.items += 1;
        self.last_item = Some(t);
        (self.make)(k, t)
    }
}

/// An open fake device. Dropping it closes it.
pub struct FakeDevice<T> {
    port: FakePort<T>,
}

impl<T> FakeDevice<T> {
    /// Plays the next step of the script.
    pub fn next(&mut self, deadline: Timestamp) -> Result<T, DeviceError> {
        let clock = Arc::clone(&self.port.clock);
        let fail = |action: &str, kind| Err(DeviceError::new("fake", action, kind));
        let step = self.port.lock().step();
        match step {
            FakeStep::Item => {
                let last = self.port.lock().last_item;
                let due =
                    last.map_or(clock.now(), |last| last.plus_seconds(self.port.period_s)).max(clock.now());
                clock.wait_until(due.min(deadline));
                if due > deadline {
                    return Err(DeviceError::again());
                }
                Ok(self.port.lock().item(due))
            }
            FakeStep::Flood => {
                let mut state = self.port.lock();
                // Times of items rise although no time passes.
                let after = state.last_item.map_or(i64::MIN, |t| t.0.saturating_add(1));
                let t = Timestamp(clock.now().0.max(after));
                Ok(state.item(t))
            }
            FakeStep::Silence => {
                clock.wait_until(deadline);
                Err(DeviceError::again())
            }
            FakeStep::Work => {
                clock.wait_until(deadline);
                Err(DeviceError::working())
            }
            FakeStep::Deafness => {
                self.port.release.wait();
                Err(DeviceError::again())
            }
            FakeStep::Loss => fail("it was pulled out", ErrorKind::Reopen),
            FakeStep::LossFor(milliseconds) => {
                let until = clock.now().plus_seconds(f64::from(milliseconds) * 1e-3);
                self.port.lock().closed_until = until;
                fail("it was pulled out for a while", ErrorKind::Reopen)
            }
            FakeStep::Refusal => fail("the script refuses", ErrorKind::Refused),
            FakeStep::End => fail("the script ends", ErrorKind::Ended),
            FakeStep::Panic => panic!("the script panics"),
        }
    }
}

impl<T> Drop for FakeDevice<T> {
    fn drop(&mut self) {
        self.port.lock().counts.open_now -= 1;
    }
}

/// Gives frames by a script, for tests.
pub struct FakeCamera {
    device: FakeDevice<RawFrame>,
    rig: Option<Rig>,
    exposures: Vec<Exposure>,
}

impl FakeCamera {
    /// A port whose frames all show one picture, exposed in turn as this cycle says.
    pub fn port(
        clock: Arc<dyn Clock>,
        period_s: f64,
        script: FakeScript,
        picture: Rgb8Image,
        cycle: Vec<Exposure>,
    ) -> FakePort<RawFrame> {
        let pixels = Arc::new(picture);
        FakePort::new(clock, period_s, script, move |k, t_mid| RawFrame {
            sequence: k,
            t_mid,
            exposure: cycle
                .get(k as usize % cycle.len().max(1))
                .copied()
                .unwrap_or(Exposure { time_s: 0.01, gain: 1.0 }),
            pixels: Arc::clone(&pixels),
            sensor: None,
            row_time_s: 0.0,
            response: None,
        })
    }

    /// Opens the camera in this port. It accepts all exposures; its frames stay as the port makes them.
    pub fn open(port: &FakePort<RawFrame>, rig: Option<Rig>) -> Result<Self, DeviceError> {
        Ok(Self { device: port.open()?, rig, exposures: Vec::new() })
    }
}

impl FrameSource for FakeCamera {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        self.device.next(deadline)
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        self.exposures = exposures.to_vec();
        Ok(self.exposures.clone())
    }

    fn rig(&self) -> Option<Rig> {
        self.rig.clone()
    }
}

impl ImuSource for FakeDevice<ImuSample> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        FakeDevice::next(self, deadline)
    }
}

/// A fake display: its events come from a port; it keeps what it was shown.
pub struct FakeDisplay {
    device: FakeDevice<DisplayEvent>,
    mode: DisplayMode,
    pending: bool,
    /// The pictures shown so far are counted here, and the last one kept.
    pub shown: Arc<Mutex<FakeScreen>>,
}

/// What is seen on a fake display.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FakeScreen {
    /// Pictures taken so far.
    pub pictures: u64,
    /// The last one.
    pub last: Rgb8Image,
}

impl FakeDisplay {
    /// A port that refreshes every `period_s`.
    pub fn port(clock: Arc<dyn Clock>, period_s: f64, script: FakeScript) -> FakePort<DisplayEvent> {
        FakePort::new(clock, period_s, script, |_, at| DisplayEvent::Shown { at })
    }

    /// Opens the display in this port.
    pub fn open(port: &FakePort<DisplayEvent>, width: usize, height: usize) -> Result<Self, DeviceError> {
        let mode = DisplayMode { width, height, period_s: Some(port.period_s) };
        Ok(Self { device: port.open()?, mode, pending: false, shown: Arc::default() })
    }
}

impl Display for FakeDisplay {
    /// `Shown` only where a picture is pending.
    fn next(&mut self, deadline: Timestamp) -> Result<DisplayEvent, DeviceError> {
        let event = self.device.next(deadline)?;
        match event {
            DisplayEvent::Shown { .. } if !std::mem::take(&mut self.pending) => {
                return Err(DeviceError::again());
            }
            DisplayEvent::Shown { .. } => {}
            DisplayEvent::ModeChanged(mode) => self.mode = mode,
        }
        Ok(event)
    }

    fn show(&mut self, picture: &Rgb8Image) -> Result<(), DeviceError> {
        let (width, height) = (picture.width(), picture.height());
        if (width, height) != (self.mode.width, self.mode.height) {
            let action = format!(
                "show a picture of {width} x {height}: must be {} x {}",
                self.mode.width, self.mode.height
            );
            return Err(DeviceError::new("fake display", action, ErrorKind::Refused));
        }
        if self.pending {
            return Err(DeviceError::again());
        }
        self.pending = true;
        let mut screen = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        screen.pictures += 1;
        screen.last.clone_from(picture);
        Ok(())
    }

    fn mode(&self) -> DisplayMode {
        self.mode
    }
}

/// A fake command link: requests come from a port; replies are kept.
pub struct FakeCommandLink {
    device: FakeDevice<Request>,
    /// Replies so far: number of the request, text.
    pub replies: Arc<Mutex<Vec<(u64, String)>>>,
}

impl FakeCommandLink {
    /// A port that sends these lines in turn, again and again, `period_s` apart.
    pub fn port(
        clock: Arc<dyn Clock>,
        period_s: f64,
        script: FakeScript,
        lines: Vec<String>,
    ) -> FakePort<Request> {
        FakePort::new(clock, period_s, script, move |id, _| Request {
            id,
            text: lines.get(id as usize % lines.len().max(1)).cloned().unwrap_or_default(),
        })
    }

    /// Opens the link in this port; replies go on in the list handed in.
    pub fn open(
        port: &FakePort<Request>,
        replies: Arc<Mutex<Vec<(u64, String)>>>,
    ) -> Result<Self, DeviceError> {
        Ok(Self { device: port.open()?, replies })
    }
}

impl CommandLink for FakeCommandLink {
    fn next(&mut self, deadline: Timestamp) -> Result<Request, DeviceError> {
        self.device.next(deadline)
    }

    fn reply(&mut self, id: u64, text: &str) -> Result<(), DeviceError> {
        self.replies.lock().unwrap_or_else(PoisonError::into_inner).push((id, text.to_owned()));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::ManualClock;

    #[test]
    fn a_script_goes_on_where_it_was_when_the_device_is_opened_anew() {
        let clock = ManualClock::default();
        let steps = vec![FakeStep::Item, FakeStep::LossFor(300), FakeStep::Item, FakeStep::End];
        let port = FakePort::new(Arc::new(clock.clone()), 0.1, FakeScript::Steps(steps), |k, t| (k, t));
        let soon = || clock.now().plus_seconds(1.0);
        let mut device = port.open().unwrap();
        assert_eq!(device.next(soon()).unwrap(), (0, Timestamp(0)));
        assert_eq!(device.next(soon()).unwrap_err().kind, ErrorKind::Reopen);
        drop(device);
        assert_eq!(port.open().err().unwrap().kind, ErrorKind::Reopen);
        clock.wait_until(Timestamp::from_seconds(0.3));
        let mut device = port.open().unwrap();
        assert_eq!(device.next(soon()).unwrap(), (1, Timestamp::from_seconds(0.3)));
        assert_eq!(device.next(soon()).unwrap_err().kind, ErrorKind::Ended);
        assert_eq!(port.counts(), FakeCounts { calls: 4, items: 2, opened: 2, open_now: 1, faults: 1 });
    }

    #[test]
    fn a_display_shows_one_picture_at_a_time_and_only_its_own_size() {
        let clock = ManualClock::default();
        let port = FakeDisplay::port(Arc::new(clock.clone()), 0.02, FakeScript::Steady);
        let mut display = FakeDisplay::open(&port, 2, 1).unwrap();
        let picture = Rgb8Image::filled(2, 1, [7; 3]);
        assert_eq!(display.next(Timestamp::NEVER).unwrap_err().kind, ErrorKind::Again);
        display.show(&picture).unwrap();
        assert_eq!(display.show(&picture).unwrap_err().kind, ErrorKind::Again);
        let at = Timestamp::from_seconds(0.02);
        assert_eq!(display.next(Timestamp::NEVER).unwrap(), DisplayEvent::Shown { at });
        let error = display.show(&Rgb8Image::filled(1, 1, [0; 3])).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Refused);
        assert!(error.to_string().contains("1 x 1: must be 2 x 1"), "{error}");
        assert_eq!(display.shown.lock().unwrap().last, picture);
    }

    #[test]
    fn a_link_gives_lines_and_keeps_replies() {
        let clock = ManualClock::default();
        let lines = vec!["status".to_owned(), "light hold".to_owned()];
        let port = FakeCommandLink::port(Arc::new(clock.clone()), 0.5, FakeScript::Steady, lines);
        let replies = Arc::default();
        let mut link = FakeCommandLink::open(&port, Arc::clone(&replies)).unwrap();
        let first = link.next(Timestamp::from_seconds(0.1)).unwrap();
        assert_eq!(first, Request { id: 0, text: "status".into() });
        assert_eq!(link.next(Timestamp::from_seconds(0.1)).unwrap_err().kind, ErrorKind::Again);
        assert_eq!(link.next(Timestamp::NEVER).unwrap().text, "light hold");
        link.reply(0, "ok").unwrap();
        assert_eq!(replies.lock().unwrap().as_slice(), [(0, "ok".to_owned())]);
    }
}
