//! Tells systemd that the daemon is ready, that its loop lives, and that it ends: datagrams to `$NOTIFY_SOCKET`
//! (`sd_notify(3)`). Without that variable nothing is told.

use crate::device::{Clock, Signal, clock::MonotonicClock};
use crate::pipeline::inbox::Inbox;
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::{
    ffi::OsStrExt,
    net::{SocketAddr, UnixDatagram},
};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Period that waits are measured by where no watchdog asks for another, seconds.
pub const DEFAULT_PERIOD_S: f64 = 10.0;

/// The line to the service manager.
struct NotifyLine {
    socket: UnixDatagram,
    address: SocketAddr,
}

impl NotifyLine {
    /// To a socket named as in `$NOTIFY_SOCKET`: a path, or `@` and an abstract name.
    fn to(name: &OsStr) -> io::Result<Self> {
        let address = match name.as_bytes() {
            [b'@', rest @ ..] => SocketAddr::from_abstract_name(rest)?,
            _ => SocketAddr::from_pathname(name)?,
        };
        Ok(Self { socket: UnixDatagram::unbound()?, address })
    }

    fn tell(&self, state: &str) {
        // A manager that does not listen has its own way to find out.
        if let Err(error) = self.socket.send_to_addr(state.as_bytes(), &self.address) {
            tracing::debug!("the service manager does not hear {state}: {error}");
        }
    }
}

/// Says READY when it is made, WATCHDOG while the loop takes turns, STOPPING when it is dropped.
pub struct Watchdog {
    line: Option<Arc<NotifyLine>>,
    stop: Signal,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    /// The period that the service manager asks for, seconds (`$WATCHDOG_USEC`).
    pub fn period_s() -> Option<f64> {
        let period_us: f64 = std::env::var("WATCHDOG_USEC").ok()?.parse().ok()?;
        (period_us > 0.0).then_some(period_us * 1e-6)
    }

    /// Tells the service manager, where there is one.
    ///
    /// # Errors
    /// A socket that cannot be named, no thread.
    pub fn start(inbox: Arc<Inbox>) -> io::Result<Self> {
        let Some(name) = std::env::var_os("NOTIFY_SOCKET") else {
            return Ok(Self { line: None, stop: Signal::default(), thread: None });
        };
        Self::start_on(NotifyLine::to(&name)?, Self::period_s(), inbox)
    }

    fn start_on(line: NotifyLine, period_s: Option<f64>, inbox: Arc<Inbox>) -> io::Result<Self> {
        let (line, stop) = (Arc::new(line), Signal::default());
        line.tell("READY=1");
        let thread = match period_s {
            None => None,
            Some(period_s) => {
                let (line, stop) = (Arc::clone(&line), stop.clone());
                let watch = move || tell_while_it_turns(&line, period_s, &inbox, &stop);
                Some(std::thread::Builder::new().name("halflight-dog".into()).spawn(watch)?)
            }
        };
        Ok(Self { line: Some(line), stop, thread })
    }
}

/// Twice in a period: where the loop has taken a turn since, that it lives.
fn tell_while_it_turns(line: &NotifyLine, period_s: f64, inbox: &Inbox, stop: &Signal) {
    let clock = MonotonicClock::default();
    let mut turns = None;
    while !clock.wait_or(clock.now().plus_seconds(0.5 * period_s), stop) {
        let now = inbox.turns();
        if turns.replace(now) != Some(now) {
            line.tell("WATCHDOG=1");
        }
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        if let Some(line) = &self.line {
            line.tell("STOPPING=1");
        }
        self.stop.raise();
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::time::Timestamp;
    use crate::pipeline::event::Awaited;

    fn told(manager: &UnixDatagram) -> String {
        let mut state = [0; 64];
        let length = manager.recv(&mut state).unwrap();
        String::from_utf8_lossy(&state[..length]).into_owned()
    }

    #[test]
    fn the_manager_hears_ready_life_and_end() {
        let path = std::env::temp_dir().join(format!("halflight-notify-{}", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let manager = UnixDatagram::bind(&path).unwrap();
        let inbox = Arc::<Inbox>::default();
        let line = NotifyLine::to(path.as_os_str()).unwrap();
        let watchdog = Watchdog::start_on(line, Some(0.02), Arc::clone(&inbox)).unwrap();
        assert_eq!(told(&manager), "READY=1");
        // The first look has nothing to compare with; then only turns count.
        assert_eq!(told(&manager), "WATCHDOG=1");
        let past = Awaited { frame: true, deadline: Timestamp(0) };
        inbox.take(past, &MonotonicClock::default());
        assert_eq!(told(&manager), "WATCHDOG=1");
        drop(watchdog);
        assert_eq!(told(&manager), "STOPPING=1", "a loop that takes no turns is not called alive");
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn abstract_names_are_understood() {
        let name = format!("halflight-notify-{}", std::process::id());
        let manager = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        let line = NotifyLine::to(OsStr::new(&format!("@{name}"))).unwrap();
        let watchdog = Watchdog::start_on(line, None, Arc::default()).unwrap();
        assert_eq!(told(&manager), "READY=1");
        drop(watchdog);
        assert_eq!(told(&manager), "STOPPING=1");
    }
}
