//! SIGINT and SIGTERM end the loop after the turn it is in; a second one ends the process. SIGHUP has the settings read again.

use crate::assets::whole;
use crate::device::Signal;
use crate::pipeline::{event::Command, inbox::Inbox};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::{Handle, Signals};
use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};
use std::thread::JoinHandle;

/// What signals ask for.
#[derive(Clone, Default)]
pub struct Asked {
    /// The settings are to be read again. Whoever reads them takes it back.
    pub read_again: Arc<AtomicBool>,
    /// Somebody takes what is in the inbox.
    runs: Arc<AtomicBool>,
}

impl Asked {
    /// From now on a stop goes through the inbox.
    pub fn loop_begins(&self) {
        self.runs.store(true, Ordering::SeqCst);
    }
}

/// Follows the signals until it is dropped.
pub struct StopSignals {
    handle: Handle,
    thread: Option<JoinHandle<()>>,
}

impl StopSignals {
    /// Puts a stop into the inbox with the first signal. One that comes before the loop runs calls `end_at_once`, after
    /// which the process ends: what is prepared then is left.
    ///
    /// # Errors
    /// The system gives no handler or no thread.
    pub fn follow(
        inbox: Arc<Inbox>,
        asked: &Asked,
        end_at_once: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        let (handle, asked) = (signals.handle(), asked.clone());
        let wait = move || {
            let mut stops = 0;
            for signal in signals.forever() {
                if signal == SIGHUP {
                    asked.read_again.store(true, Ordering::SeqCst);
                    continue;
                }
                if stops > 0 {
                    whole::forget_unfinished();
                    // As a shell reports a process that the signal has ended.
                    std::process::exit(128 + signal);
                }
                if !asked.runs.load(Ordering::SeqCst) {
                    whole::forget_unfinished();
                    end_at_once();
                    std::process::exit(0);
                }
                stops += 1;
                // A stop is never refused.
                let _ = inbox.put_command(Command::Stop);
            }
        };
        let thread = std::thread::Builder::new().name("halflight-stop".into()).spawn(wait)?;
        Ok(Self { handle, thread: Some(thread) })
    }
}

impl Drop for StopSignals {
    fn drop(&mut self) {
        self.handle.close();
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed.
            let _ = thread.join();
        }
    }
}

/// Raises `stop` with the first SIGINT or SIGTERM, for work that then closes what it has; a second one ends the process.
///
/// # Errors
/// The system gives no handler or no thread.
pub fn raise(stop: Signal) -> std::io::Result<()> {
    follow_until_ended(move |signal, before| {
        if before > 0 {
            end(signal);
        }
        stop.raise();
    })
}

/// Ends the process with the first SIGINT or SIGTERM; nothing half written is left.
///
/// # Errors
/// The system gives no handler or no thread.
pub fn end_cleanly() -> std::io::Result<()> {
    follow_until_ended(|signal, _| end(signal))
}

fn end(signal: i32) {
    whole::forget_unfinished();
    std::process::exit(128 + signal);
}

fn follow_until_ended(mut act: impl FnMut(i32, usize) + Send + 'static) -> std::io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    let wait = move || {
        for (before, signal) in signals.forever().enumerate() {
            act(signal, before);
        }
    };
    std::thread::Builder::new().name("halflight-stop".into()).spawn(wait).map(drop)
}
