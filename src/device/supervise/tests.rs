//! A device's thread on simulated clocks: nothing here sleeps.

use super::*;
use crate::clock::{ManualClock, SteppedClock};
use crate::fake::{FakeDevice, FakePort, FakeScript, FakeStep};
use std::sync::{Mutex, PoisonError};

/// Tests that count abandoned threads, which are counted for the whole process, run one at a time.
static ALONE: Mutex<()> = Mutex::new(());

type SaidLines = Arc<Mutex<Vec<String>>>;

fn budget() -> Budget {
    Budget::of_watchdog(2.0).unwrap()
}

fn how(clock: Arc<dyn Clock>, silence_s: Option<f64>) -> Supervision {
    Supervision { name: "fake".into(), clock, budget: budget(), silence_s }
}

/// Notes what is said, in one word each with the time; goes on for ever.
fn noting(
    clock: impl Clock + 'static,
    said: &SaidLines,
) -> impl FnMut(Delivery<u64>) -> bool + Send + 'static {
    let said = Arc::clone(said);
    move |delivery| {
        let word = match delivery {
            Delivery::Item(k) => format!("item {k}"),
            Delivery::Lost(_) => "lost".into(),
            Delivery::Back => "back".into(),
            Delivery::Refused(error) => format!("refused: {error}"),
            Delivery::Ended => "ended".into(),
        };
        let at = format!("{:.2} {word}", clock.now().seconds());
        said.lock().unwrap_or_else(PoisonError::into_inner).push(at);
        true
    }
}

fn port(clock: &(impl Clock + Clone + 'static), script: FakeScript) -> FakePort<u64> {
    FakePort::new(Arc::new(clock.clone()), 0.01, script, |k, _| k)
}

fn start(
    clock: &(impl Clock + Clone + 'static),
    port: &FakePort<u64>,
    silence_s: Option<f64>,
) -> (Supervisor, SaidLines) {
    let said = SaidLines::default();
    let opened = port.clone();
    let supervisor = supervise(
        how(Arc::new(clock.clone()), silence_s),
        move |_| opened.open(),
        |device: &mut FakeDevice<u64>, deadline| device.next(deadline),
        noting(clock.clone(), &said),
    );
    (supervisor.unwrap(), said)
}

/// Runs a script to its end on a clock that jumps.
fn played(script: FakeScript, silence_s: Option<f64>) -> (Vec<String>, SupervisionCounts, FakePort<u64>) {
    let clock = ManualClock::default();
    let port = port(&clock, script);
    let (supervisor, said) = start(&clock, &port, silence_s);
    supervisor.wait_over();
    let counts = supervisor.counts();
    assert_eq!(supervisor.stop(), Stopped::Ended);
    let said = said.lock().unwrap().clone();
    (said, counts, port)
}

#[test]
fn losses_and_returns_are_said_once_and_the_end_ends() {
    use FakeStep::{End, Item, LossFor, Silence};
    let steps = vec![Item, LossFor(500), Item, Silence, Item, End];
    let (said, counts, port) = played(FakeScript::Steps(steps), None);
    // Opened again after 0.1, 0.3 and 0.7 s: the first two find nothing. Silence keeps its deadline of 0.1 s.
    assert_eq!(said, ["0.00 item 0", "0.00 lost", "0.70 back", "0.70 item 1", "0.80 item 2", "0.80 ended"]);
    assert_eq!(counts, SupervisionCounts { items: 3, opened: 2, lost: 1, panics: 0 });
    assert_eq!(port.counts().open_now, 0);
}

#[test]
fn a_refusal_is_said_and_ends() {
    let (said, counts, _) = played(FakeScript::Steps(vec![FakeStep::Item, FakeStep::Refusal]), None);
    assert_eq!(said, ["0.00 item 0", "0.00 refused: fake: the script refuses"]);
    assert_eq!(counts.opened, 1);
}

#[test]
fn a_panic_is_a_loss() {
    use FakeStep::{End, Item, Panic};
    let (said, counts, port) = played(FakeScript::Steps(vec![Item, Panic, Item, End]), None);
    assert_eq!(said, ["0.00 item 0", "0.00 lost", "0.10 back", "0.10 item 1", "0.10 ended"]);
    assert_eq!((counts.panics, counts.opened, port.counts().open_now), (1, 2, 0));
}

#[test]
fn a_device_that_falls_silent_is_opened_again_where_silence_is_no_virtue() {
    use FakeStep::{End, Item, Silence};
    let steps = vec![Item, Silence, Silence, Silence, Item, End];
    let (said, counts, _) = played(FakeScript::Steps(steps.clone()), Some(0.25));
    assert_eq!(said, ["0.00 item 0", "0.30 lost", "0.40 back", "0.40 item 1", "0.40 ended"]);
    assert_eq!(counts.lost, 1);
    assert_eq!(played(FakeScript::Steps(steps), None).1.lost, 0);
    // A device that says that it works is not silent.
    let works =
        vec![Item, FakeStep::Work, FakeStep::Work, FakeStep::Work, FakeStep::Work, Silence, Item, End];
    assert_eq!(played(FakeScript::Steps(works), Some(0.25)).1.lost, 0);
}

#[test]
fn the_wait_before_opening_again_doubles_and_an_item_resets_it() {
    let mut backoff = Backoff::default();
    let waits: Vec<f64> = (0..7).map(|_| backoff.advance()).collect();
    assert_eq!(waits, [0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0]);
    backoff.reset();
    assert_eq!(backoff.advance(), 0.1);
    // The same as the thread waits: a device that opens and is lost at once, six times, then gives an item and is lost.
    use FakeStep::{End, Item, Loss};
    let steps = vec![Loss, Loss, Loss, Loss, Loss, Loss, Item, Loss, End];
    let clock = ManualClock::default();
    let port = port(&clock, FakeScript::Steps(steps));
    let times = Arc::new(Mutex::new(Vec::new()));
    let (opened, noted, theirs) = (port.clone(), Arc::clone(&times), clock.clone());
    let supervisor = supervise(
        how(Arc::new(clock.clone()), None),
        move |_| {
            noted.lock().unwrap().push(theirs.now());
            opened.open()
        },
        |device: &mut FakeDevice<u64>, deadline| device.next(deadline),
        |_| true,
    )
    .unwrap();
    supervisor.wait_over();
    let times = times.lock().unwrap();
    let waits: Vec<f64> = times.windows(2).map(|t| (t[1].seconds_since(t[0]) * 1e6).round() * 1e-6).collect();
    for (wait, expected) in waits.iter().zip([0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 0.1]) {
        assert!((wait - expected).abs() < 1e-9, "{waits:?}");
    }
    assert_eq!(waits.len(), 7);
}

#[test]
fn a_silent_device_that_keeps_its_deadline_stops_at_it() {
    let clock = SteppedClock::default();
    let port = port(&clock, FakeScript::Steps(vec![FakeStep::Silence]));
    let (supervisor, said) = start(&clock, &port, None);
    // It waits for its deadline, and for that alone.
    assert_eq!(clock.next_wake(), Timestamp::from_seconds(budget().seconds(Wait::Item)));
    supervisor.request_stop();
    clock.advance_to(clock.next_wake());
    assert_eq!(supervisor.stop(), Stopped::Ended);
    assert_eq!((port.counts().open_now, said.lock().unwrap().len()), (0, 0));
}

#[test]
fn a_device_that_ignores_its_deadline_is_abandoned_and_says_nothing_more() {
    let clock = SteppedClock::default();
    let port = port(&clock, FakeScript::Steps(vec![FakeStep::Item, FakeStep::Deafness, FakeStep::Item]));
    let (supervisor, said) = start(&clock, &port, None);
    while port.counts().calls < 2 {
        std::thread::yield_now();
    }
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let before = abandoned_threads();
    let stopping = std::thread::spawn(move || {
        let overdue_s = supervisor.overdue_s();
        (supervisor.done.clone(), supervisor.stop(), overdue_s)
    });
    // Only the one who stops waits, and not longer than the budget says.
    assert_eq!(clock.next_wake(), Timestamp::from_seconds(budget().seconds(Wait::Stop)));
    clock.advance_to(clock.next_wake());
    let (done, stopped, overdue_s) = stopping.join().unwrap();
    assert_eq!((stopped, overdue_s), (Stopped::Abandoned, 0.0));
    assert_eq!(abandoned_threads(), before + 1);
    // When the call comes back after all, the thread ends and the device is closed.
    port.release();
    done.wait();
    assert_eq!((abandoned_threads(), port.counts().open_now), (before, 0));
    assert_eq!(said.lock().unwrap().as_slice(), ["0.00 item 0"]);
}

#[test]
fn a_thousand_losses_leave_nothing_behind() {
    for seed in 0..3 {
        let script = FakeScript::Random { seed, share: 0.2, fault: FakeStep::LossFor(150), faults: 1000 };
        let (said, counts, port) = played(script, Some(1.0));
        let of = |word: &str| said.iter().filter(|line| line.ends_with(word)).count() as u64;
        assert_eq!((of("ended"), port.counts().open_now, port.counts().faults), (1, 0, 1000));
        // Each loss is said once, and so is each return; the last loss is followed by the end.
        assert_eq!(of("lost"), counts.lost);
        assert!(counts.lost > 700 && counts.lost - of("back") <= 1, "{} {}", counts.lost, of("back"));
        assert_eq!(counts.opened, port.counts().opened);
        let mut is_lost = false;
        for line in &said {
            match line.split(' ').nth(1) {
                Some("lost") => assert!(!std::mem::replace(&mut is_lost, true), "lost twice: {line}"),
                Some("back") => assert!(std::mem::take(&mut is_lost), "back without a loss: {line}"),
                Some("item") => assert!(!is_lost, "an item of a lost device: {line}"),
                _ => {}
            }
        }
    }
}

#[test]
fn who_wants_no_more_is_left_alone() {
    let clock = ManualClock::default();
    let port = port(&clock, FakeScript::Steps(vec![FakeStep::Flood]));
    let opened = port.clone();
    let supervisor = supervise(
        how(Arc::new(clock), None),
        move |_| opened.open(),
        |device: &mut FakeDevice<u64>, deadline| device.next(deadline),
        |delivery| !matches!(delivery, Delivery::Item(9)),
    )
    .unwrap();
    supervisor.wait_over();
    assert_eq!((supervisor.counts().items, port.counts().open_now), (10, 0));
}

#[test]
fn budgets_that_the_watchdog_would_not_outlast_are_refused() {
    let even = [0.1; 6];
    assert!(Budget::new(1.2, even).unwrap_err().to_string().contains("must be at least 0.12"));
    let mut waits = even;
    waits[Wait::Stop as usize] = 0.13;
    assert!(Budget::new(1.26, waits).is_ok());
    assert!(Budget::new(1.25, waits).unwrap_err().to_string().contains("at most half"));
    for bad in [0.0, -0.1, f64::NAN, f64::INFINITY] {
        let mut waits = even;
        waits[Wait::Item as usize] = bad;
        assert!(Budget::new(10.0, waits).unwrap_err().to_string().contains("Item"));
    }
    for period_s in [1.0, 2.0, 5.0, 30.0] {
        let budget = Budget::of_watchdog(period_s).unwrap();
        let sum: f64 = Wait::ALL.map(|wait| budget.seconds(wait)).iter().sum();
        assert!(sum <= 0.5 * period_s * (1.0 + 1e-12), "{period_s}: {sum}");
    }
    assert!(Budget::of_watchdog(0.5).is_err());
}

#[test]
fn many_devices_are_stopped_together() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let clock = SteppedClock::default();
    let ports: Vec<_> = (0..3).map(|_| port(&clock, FakeScript::Steps(vec![FakeStep::Deafness]))).collect();
    let supervisors: Vec<_> = ports.iter().map(|port| start(&clock, port, None).0).collect();
    while ports.iter().any(|port| port.counts().calls < 1) {
        std::thread::yield_now();
    }
    let stopping = std::thread::spawn(move || stop_all(supervisors));
    clock.advance_to(clock.next_wake());
    assert_eq!(stopping.join().unwrap(), [Stopped::Abandoned; 3]);
    assert_eq!(clock.now(), Timestamp::from_seconds(budget().seconds(Wait::Stop)));
    ports.iter().for_each(FakePort::release);
    while abandoned_threads() > 0 {
        std::thread::yield_now();
    }
}
