//! A display with a thread of its own: it is handed the newest finished picture, and says when that was seen. The frame's
//! path never waits for it.

use super::event::DeviceRole;
use super::inbox::Inbox;
use super::schedule::Rhythm;
use crate::device::{
    Clock, DeviceError, Display, DisplayEvent, ErrorKind, Signal,
    supervise::{Delivery, Supervision, Supervisor, supervise},
};
use crate::model::{image::Rgb8Image, time::Timestamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What became of pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScreenCounts {
    /// Pictures that were seen.
    pub seen: u64,
    /// Pictures that newer ones took the place of.
    pub passed_over: u64,
    /// Pictures that the display did not take.
    pub refused: u64,
}

/// The newest picture and what the display has said.
#[derive(Default)]
struct Slot {
    newest: Rgb8Image,
    is_new: bool,
    seen_at: Option<Timestamp>,
    period_s: Option<f64>,
    counts: ScreenCounts,
}

#[derive(Default)]
struct SharedSlot {
    slot: Mutex<Slot>,
    has_picture: Signal,
}

impl SharedSlot {
    fn slot(&self) -> MutexGuard<'_, Slot> {
        // Every change under the lock is whole by itself.
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Where finished pictures go. Clones are the same screen.
#[derive(Clone, Default)]
pub struct Screen(Arc<SharedSlot>);

impl Screen {
    /// Starts the display's thread. `open` opens the display, and opens it anew when it was lost; the picture goes on without
    /// one that ends or refuses. What happens to it goes into the inbox.
    ///
    /// # Errors
    /// `Refused` where no thread can be made.
    pub fn start(
        supervision: Supervision,
        inbox: Arc<Inbox>,
        mut open: impl FnMut(Timestamp) -> Result<Box<dyn Display>, DeviceError> + Send + 'static,
    ) -> Result<(Self, Supervisor), DeviceError> {
        let screen = Self::default();
        let (theirs, clock) = (screen.clone(), Arc::clone(&supervision.clock));
        let open = move |deadline| {
            let display = open(deadline)?;
            // A display that has come back shows the newest picture, whether or not another comes.
            theirs.offer_again();
            Ok(Served { display, at_hand: Rgb8Image::default(), is_awaited: false, screen: theirs.clone() })
        };
        let next = move |served: &mut Served, deadline| served.serve(clock.as_ref(), deadline);
        let deliver = move |delivery| {
            match delivery {
                Delivery::Item(()) | Delivery::Ended => {}
                Delivery::Lost(error) | Delivery::Refused(error) => {
                    inbox.put_lost(DeviceRole::Display, error);
                }
                Delivery::Back => inbox.put_back(DeviceRole::Display),
            }
            true
        };
        let supervisor = supervise(Supervision { silence_s: None, ..supervision }, open, next, deliver)?;
        Ok((screen, supervisor))
    }

    /// Hands over a picture; it takes the place of one that waits. Allocates nothing while pictures keep their size.
    pub fn offer(&self, picture: &Rgb8Image) {
        let mut slot = self.0.slot();
        copy(picture, &mut slot.newest);
        if std::mem::replace(&mut slot.is_new, true) {
            slot.counts.passed_over += 1;
        }
        drop(slot);
        self.0.has_picture.raise();
    }

    /// When pictures are seen, where the display has said so.
    pub fn rhythm(&self) -> Option<Rhythm> {
        let slot = self.0.slot();
        let period_ns = (slot.period_s? * 1e9) as i64;
        Some(Rhythm { at: slot.seen_at?, period_ns }).filter(|rhythm| rhythm.period_ns > 0)
    }

    /// What has become of pictures so far.
    pub fn counts(&self) -> ScreenCounts {
        self.0.slot().counts
    }

    fn offer_again(&self) {
        let mut slot = self.0.slot();
        slot.is_new = !slot.newest.pixels().is_empty();
        drop(slot);
        self.0.has_picture.raise();
    }

    /// Copies the newest picture, where it was not taken yet.
    fn take(&self, out: &mut Rgb8Image) -> bool {
        // Before the look: one that comes after it raises the flag anew.
        self.0.has_picture.take();
        let mut slot = self.0.slot();
        if std::mem::take(&mut slot.is_new) {
            copy(&slot.newest, out);
            return true;
        }
        false
    }
}

fn copy(from: &Rgb8Image, to: &mut Rgb8Image) {
    to.reshape(from.width(), from.height(), [0; 3]);
    to.pixels_mut().copy_from_slice(from.pixels());
}

/// An open display and the picture that it was given last.
struct Served {
    display: Box<dyn Display>,
    at_hand: Rgb8Image,
    /// The picture was handed over and has not been seen yet.
    is_awaited: bool,
    screen: Screen,
}

impl Served {
    /// Shows the newest picture, or waits for the one before to be seen. An item is a picture that was seen.
    fn serve(&mut self, clock: &dyn Clock, deadline: Timestamp) -> Result<(), DeviceError> {
        if !self.is_awaited {
            // What a display says while there is nothing to show: that it is gone, that it has another mode.
            match self.display.next(clock.now()) {
                Ok(event) => self.hear(event),
                Err(error) if error.kind == ErrorKind::Again => {}
                Err(error) => return Err(error),
            }
            if !self.screen.take(&mut self.at_hand) {
                clock.wait_or(deadline, &self.screen.0.has_picture);
                if !self.screen.take(&mut self.at_hand) {
                    return Err(DeviceError::again());
                }
            }
            self.hand_over()?;
        }
        let event = self.display.next(deadline)?;
        self.hear(event);
        if self.is_awaited { Err(DeviceError::again()) } else { Ok(()) }
    }

    /// A display that refuses one picture (its size is another mode's) may take the next.
    fn hand_over(&mut self) -> Result<(), DeviceError> {
        match self.display.show(&self.at_hand) {
            Ok(()) => self.is_awaited = true,
            // It has not shown what it was given before.
            Err(error) if error.kind == ErrorKind::Again => self.is_awaited = true,
            Err(error) if error.kind == ErrorKind::Refused => {
                let counts = &mut self.screen.0.slot().counts;
                if counts.refused.is_multiple_of(1000) {
                    tracing::warn!("not shown: {error}");
                }
                counts.refused += 1;
                return Err(DeviceError::again());
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn hear(&mut self, event: DisplayEvent) {
        let mut slot = self.screen.0.slot();
        match event {
            DisplayEvent::Shown { at } => {
                self.is_awaited = false;
                slot.seen_at = Some(at);
                slot.counts.seen += 1;
                slot.period_s = self.display.mode().period_s;
            }
            DisplayEvent::ModeChanged(mode) => slot.period_s = mode.period_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{
        clock::{ManualClock, MonotonicClock},
        fake::{FakeDisplay, FakeScript, FakeStep},
        null_display::NullDisplay,
        supervise::Budget,
    };
    use crate::pipeline::event::{Awaited, Event};

    fn picture(value: u8) -> Rgb8Image {
        Rgb8Image::filled(4, 2, [value; 3])
    }

    fn served(display: impl Display + 'static) -> (Screen, Served) {
        let screen = Screen::default();
        let at_hand = Rgb8Image::default();
        let served =
            Served { display: Box::new(display), at_hand, is_awaited: false, screen: screen.clone() };
        (screen, served)
    }

    #[test]
    fn the_newest_picture_is_shown_and_its_time_is_known() {
        let clock = ManualClock::default();
        let display = NullDisplay::open("null:", "hz=50", Arc::new(clock.clone())).unwrap();
        let (screen, mut served) = served(display);
        assert_eq!(screen.rhythm(), None);
        screen.offer(&picture(1));
        screen.offer(&picture(2));
        served.serve(&clock, Timestamp(100_000_000)).unwrap();
        assert_eq!(served.at_hand, picture(2));
        assert_eq!(screen.counts(), ScreenCounts { seen: 1, passed_over: 1, refused: 0 });
        let rhythm = Rhythm { at: Timestamp(20_000_000), period_ns: 20_000_000 };
        assert_eq!(screen.rhythm(), Some(rhythm));
        // Nothing more to show.
        assert_eq!(served.serve(&clock, Timestamp(130_000_000)).unwrap_err().kind, ErrorKind::Again);
        assert_eq!(clock.now(), Timestamp(130_000_000));
    }

    #[test]
    fn a_picture_of_another_size_is_passed_over_and_the_next_is_shown() {
        let clock = ManualClock::default();
        let port = FakeDisplay::port(Arc::new(clock.clone()), 0.01, FakeScript::Steady);
        let (screen, mut served) = served(FakeDisplay::open(&port, 4, 2).unwrap());
        screen.offer(&Rgb8Image::filled(9, 9, [0; 3]));
        assert_eq!(served.serve(&clock, Timestamp(50_000_000)).unwrap_err().kind, ErrorKind::Again);
        assert_eq!(screen.counts().refused, 1);
        screen.offer(&picture(3));
        served.serve(&clock, Timestamp(200_000_000)).unwrap();
        assert_eq!(screen.counts().seen, 1);
    }

    #[test]
    fn a_display_that_comes_back_shows_the_newest_picture_again() {
        let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::default());
        let inbox = Arc::<Inbox>::default();
        // Asked while it has nothing, shows one, is pulled out, comes back.
        let steps = vec![FakeStep::Item, FakeStep::Item, FakeStep::Loss, FakeStep::Item];
        let port = FakeDisplay::port(Arc::clone(&clock), 0.001, FakeScript::Steps(steps));
        let supervision = Supervision {
            name: "fake".into(),
            clock: Arc::clone(&clock),
            budget: Budget::of_watchdog(10.0).unwrap(),
            silence_s: None,
        };
        let theirs = port.clone();
        let open = move |_| Ok(Box::new(FakeDisplay::open(&theirs, 4, 2)?) as Box<dyn Display>);
        let (screen, supervisor) = Screen::start(supervision, Arc::clone(&inbox), open).unwrap();
        screen.offer(&picture(7));
        let mut seen = Vec::new();
        while seen.len() < 2 {
            let deadline = clock.now().plus_seconds(20.0);
            match inbox.take(Awaited { frame: false, deadline }, clock.as_ref()) {
                Event::Lost(DeviceRole::Display, _) => seen.push("lost"),
                Event::Back(DeviceRole::Display) => seen.push("back"),
                other => panic!("{other:?} after {seen:?}"),
            }
        }
        assert_eq!(seen, ["lost", "back"]);
        assert_eq!(port.counts().opened, 2);
        assert!(screen.counts().seen >= 2, "{:?}", screen.counts());
        supervisor.stop();
    }
}
