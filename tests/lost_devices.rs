//! A device that is lost a thousand times (ten thousand in `make soak`) leaves no thread and no descriptor behind. Alone in its process, since it counts
//! those of the whole process. Goes through `device::supervise` and a fake device; not through the pipeline.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::device::clock::ManualClock;
use halflight::device::fake::{FakeDevice, FakePort, FakeScript, FakeStep};
use halflight::device::supervise::{Budget, Delivery, Stopped, Supervision, supervise};
use halflight::device::{DeviceError, ErrorKind};
use std::fs::File;
use std::sync::Arc;

/// Entries of a folder of `/proc/self`; `None` where there is no such thing.
fn entries(folder: &str) -> Option<usize> {
    Some(std::fs::read_dir(format!("/proc/self/{folder}")).ok()?.count())
}

/// Runs a device that is lost so often, on a clock that jumps; returns how often it was opened.
fn lose(faults: u64, fault: FakeStep) -> u64 {
    let clock = ManualClock::default();
    let script = FakeScript::Random { seed: 5, share: 0.3, fault, faults };
    let port = FakePort::new(Arc::new(clock.clone()), 0.01, script, |k, _| k);
    let theirs = port.clone();
    let how = Supervision {
        name: "fake".into(),
        clock: Arc::new(clock),
        budget: Budget::of_watchdog(2.0).unwrap(),
        silence_s: Some(1.0),
    };
    let supervisor = supervise(
        how,
        move |_| {
            let file = File::open("/dev/null")
                .map_err(|e| DeviceError::new("/dev/null", "open", ErrorKind::Reopen).because(e))?;
            Ok((theirs.open()?, file))
        },
        |device: &mut (FakeDevice<u64>, File), deadline| device.0.next(deadline),
        |_: Delivery<u64>| true,
    )
    .unwrap();
    supervisor.wait_over();
    assert_eq!(supervisor.stop(), Stopped::Ended);
    assert_eq!((port.counts().open_now, port.counts().faults), (0, faults));
    port.counts().opened
}

#[test]
fn losses_leave_no_thread_and_no_descriptor() {
    // The first run makes what the process makes once.
    lose(3, FakeStep::Loss);
    let before = (entries("task"), entries("fd"));
    if before.0.is_none() {
        println!("SKIPPED losses_leave_no_thread_and_no_descriptor: there is no /proc/self");
        return;
    }
    let soak = std::env::var_os("HALFLIGHT_SOAK").is_some_and(|value| value == "1");
    let losses = if soak { 10_000 } else { 1000 };
    // A panic is the costliest loss; its message is noise here.
    std::panic::set_hook(Box::new(|_| {}));
    for fault in [FakeStep::Loss, FakeStep::LossFor(150), FakeStep::Panic, FakeStep::Silence] {
        let opened = lose(losses, fault);
        assert!(fault == FakeStep::Silence || 10 * opened > 6 * losses, "{fault:?}: opened {opened} times");
        assert_eq!((entries("task"), entries("fd")), before, "{fault:?}");
    }
}
