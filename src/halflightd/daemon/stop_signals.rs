//! SIGINT and SIGTERM end the loop after the turn it is in; a second one ends the process.

use crate::pipeline::{event::Command, inbox::Inbox};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::{Handle, Signals};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Follows the signals until it is dropped.
pub struct StopSignals {
    handle: Handle,
    thread: Option<JoinHandle<()>>,
}

impl StopSignals {
    /// Puts a stop into the inbox with the first signal.
    ///
    /// # Errors
    /// The system gives no handler or no thread.
    pub fn follow(inbox: Arc<Inbox>) -> std::io::Result<Self> {
        let mut signals = Signals::new([SIGINT, SIGTERM])?;
        let handle = signals.handle();
        let wait = move || {
            for (count, signal) in signals.forever().enumerate() {
                if count > 0 {
                    // As a shell reports a process that the signal has ended.
                    std::process::exit(128 + signal);
                }
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
