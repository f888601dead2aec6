//! Follows the settings while the daemon runs: a thread of its own watches the file, makes ready what other settings need,
//! and hands the change to the pipeline when it is.

use super::{dress, governing::governor_of, host::Silent, prepare::options_of, watcher::Watcher};
use crate::config::{live::take_over, settings::Settings};
use crate::device::{Clock, Signal};
use crate::model::{frame::Exposure, scene::Scene};
use crate::pipeline::{Change, GovernorChange, inbox::Inbox};
use std::path::Path;
use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};
use std::thread::JoinHandle;

/// The file is looked at so often, seconds.
const LOOK_EVERY_S: f64 = 0.05;

/// The settings as they are, and the scene as it is dressed for them.
pub struct LiveSettings {
    current: Settings,
    scene: Arc<Scene>,
    /// Exposures that the camera goes through.
    cycle: Vec<Exposure>,
}

impl LiveSettings {
    /// What the program was started with.
    pub fn new(current: &Settings, scene: Arc<Scene>, cycle: &[Exposure]) -> Self {
        Self { current: current.clone(), scene, cycle: cycle.to_vec() }
    }

    /// Takes over what is live of other settings, and makes ready what it needs, which may take seconds. `None` where
    /// nothing changes for the pipeline. What cannot be taken is logged and stays as it is.
    pub fn change_to(&mut self, typed: &Settings) -> Option<Change> {
        let taken = take_over(&mut self.current, typed);
        for key in &taken.waiting {
            tracing::warn!("{key} has changed: it takes effect at the next start");
        }
        for key in &taken.live {
            tracing::info!("{key} has changed");
        }
        if taken.live.is_empty() {
            return None;
        }
        let scene = taken.live.iter().any(|key| dress::depends_on(key)).then(|| {
            let quality = &self.current.quality;
            self.scene = Arc::new(dress::dressed_anew(&self.scene, quality, &Silent));
            Arc::clone(&self.scene)
        });
        // Other settings of accuracy are another ground for the front.
        let is_governed = |key: &&str| key.starts_with("quality.") || key.starts_with("light.");
        let governor =
            if taken.live.iter().any(is_governed) { self.governor() } else { GovernorChange::Keep };
        Some(Change { options: options_of(&self.current, &self.cycle), scene, governor })
    }

    fn governor(&self) -> GovernorChange {
        match governor_of(&self.current) {
            Ok(Some(governor)) => GovernorChange::Replace(Box::new(governor)),
            Ok(None) => GovernorChange::Remove,
            Err(mistake) => {
                tracing::warn!("the governor stays as it is: {mistake}");
                GovernorChange::Keep
            }
        }
    }
}

/// Whoever drops the thread's handle waits for it so long, seconds: bodies that are being dressed then are left to it.
const LONGEST_STOP_S: f64 = 0.5;

/// A settings file that is followed.
pub struct Watched<'a> {
    /// Where it is.
    pub path: &'a Path,
    /// Its content when the settings were read.
    pub known: &'a str,
    /// Raised where it is to be read again, changed or not.
    pub read_again: Arc<AtomicBool>,
}

/// The thread that follows a settings file.
pub struct SettingsThread {
    clock: Arc<dyn Clock>,
    stop: Signal,
    done: Signal,
    thread: Option<JoinHandle<()>>,
}

impl SettingsThread {
    /// Follows `path`, whose content was `known` when the settings were read. `read` gives all settings as a content of
    /// that file, and whatever wins over it, say. A content with a mistake changes nothing: the mistake is logged once.
    ///
    /// # Errors
    /// The system does not give a thread.
    pub fn start(
        path: &Path,
        known: &str,
        read: impl Fn(&str) -> Result<Settings, String> + Send + 'static,
        live: LiveSettings,
        inbox: Arc<Inbox>,
        clock: Arc<dyn Clock>,
    ) -> std::io::Result<Self> {
        let watched = Watched { path, known, read_again: Arc::default() };
        Self::start_asked(watched, read, live, inbox, clock)
    }

    /// As [`SettingsThread::start`]; where `read_again` is raised, the file is read again, changed or not.
    ///
    /// # Errors
    /// As of `start`.
    pub fn start_asked(
        watched: Watched<'_>,
        read: impl Fn(&str) -> Result<Settings, String> + Send + 'static,
        mut live: LiveSettings,
        inbox: Arc<Inbox>,
        clock: Arc<dyn Clock>,
    ) -> std::io::Result<Self> {
        let Watched { path, known, read_again } = watched;
        let mut watcher = Watcher::new(path, known);
        let (stop, done) = (Signal::default(), Signal::default());
        let (is_stopped, is_done, theirs) = (stop.clone(), done.clone(), Arc::clone(&clock));
        let follow = move || {
            while !theirs.wait_or(theirs.now().plus_seconds(LOOK_EVERY_S), &is_stopped) {
                if read_again.swap(false, Ordering::SeqCst) {
                    tracing::info!("the settings are read again");
                    watcher.read_again();
                }
                let Some(content) = watcher.look(theirs.now()) else { continue };
                match read(content) {
                    Err(mistakes) => tracing::warn!("settings stay as they are: {mistakes}"),
                    Ok(typed) => {
                        if let Some(change) = live.change_to(&typed) {
                            inbox.put_change(change);
                        }
                    }
                }
            }
            is_done.raise();
        };
        let thread = std::thread::Builder::new().name("halflight-config".into()).spawn(follow)?;
        Ok(Self { clock, stop, done, thread: Some(thread) })
    }
}

impl Drop for SettingsThread {
    fn drop(&mut self) {
        self.stop.raise();
        let until = self.clock.now().plus_seconds(LONGEST_STOP_S);
        if self.clock.wait_or(until, &self.done)
            && let Some(thread) = self.thread.take()
        {
            // A panic there has been printed.
            let _ = thread.join();
        }
    }
}
