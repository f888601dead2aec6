//! Follows the settings while the daemon runs: a thread of its own watches the file, makes ready what other settings need,
//! and hands the change to the pipeline when it is.

use super::{dress, governing::governor_of, host::Silent, prepare::options_of, watcher::Watcher};
use crate::config::{live::take_over, settings::Settings};
use crate::device::{Clock, Signal};
use crate::model::{frame::Exposure, scene::Scene};
use crate::pipeline::{Change, GovernorChange, inbox::Inbox};
use std::path::PathBuf;
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
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

/// Settings that others ask for while the daemon runs: a command link, say. Each wish holds all those before it.
pub struct Wishes(Mutex<Wished>);

struct Wished {
    /// As they are, or will be as soon as the thread comes round.
    settings: Settings,
    is_new: bool,
}

impl Wishes {
    /// What the program was started with.
    pub fn new(settings: &Settings) -> Self {
        Self(Mutex::new(Wished { settings: settings.clone(), is_new: false }))
    }

    fn lock(&self) -> MutexGuard<'_, Wished> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The settings, with all wishes.
    pub fn settings(&self) -> Settings {
        self.lock().settings.clone()
    }

    /// Asks for other settings: their live keys are taken over. The settings file wins when it changes later.
    pub fn wish(&self, settings: Settings) {
        *self.lock() = Wished { settings, is_new: true };
    }

    fn take(&self) -> Option<Settings> {
        let mut wished = self.lock();
        std::mem::take(&mut wished.is_new).then(|| wished.settings.clone())
    }

    /// What became of them, unless there is a newer wish.
    fn follow(&self, current: &Settings) {
        let mut wished = self.lock();
        if !wished.is_new {
            wished.settings.clone_from(current);
        }
    }
}

/// A settings file that is followed while the daemon runs.
pub struct FollowedFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its content when the settings were read.
    pub content: String,
    /// All settings as a content of the file, and whatever wins over it, say; or every mistake.
    pub read: ReadSettings,
}

/// From a file's content to settings, or every mistake in it.
pub type ReadSettings = Box<dyn Fn(&str) -> Result<Settings, String> + Send>;

/// Whoever drops the thread's handle waits for it so long, seconds: bodies that are being dressed then are left to it.
const LONGEST_STOP_S: f64 = 0.5;

/// What others ask of the thread.
pub struct Asks {
    /// Other settings.
    pub wishes: Arc<Wishes>,
    /// The file is to be read again, changed or not. The thread takes it back.
    pub read_again: Arc<AtomicBool>,
}

/// The thread that follows the settings file and grants wishes.
pub struct SettingsThread {
    clock: Arc<dyn Clock>,
    stop: Signal,
    done: Signal,
    thread: Option<JoinHandle<()>>,
}

impl SettingsThread {
    /// Follows the file, where there is one. A content with a mistake changes nothing: the mistake is logged once.
    ///
    /// # Errors
    /// The system does not give a thread.
    pub fn start(
        file: Option<FollowedFile>,
        asks: Asks,
        mut live: LiveSettings,
        inbox: Arc<Inbox>,
        clock: Arc<dyn Clock>,
    ) -> std::io::Result<Self> {
        let mut file = file.map(|file| (Watcher::new(&file.path, &file.content), file.read));
        let Asks { wishes, read_again } = asks;
        let (stop, done) = (Signal::default(), Signal::default());
        let (is_stopped, is_done, theirs) = (stop.clone(), done.clone(), Arc::clone(&clock));
        let follow = move || {
            while !theirs.wait_or(theirs.now().plus_seconds(LOOK_EVERY_S), &is_stopped) {
                let is_asked = read_again.swap(false, Ordering::SeqCst);
                let content = file.as_mut().and_then(|(watcher, read)| {
                    if is_asked {
                        tracing::info!("the settings are read again");
                        watcher.read_again();
                    }
                    let content = watcher.look(theirs.now())?;
                    read(content).inspect_err(|e| tracing::warn!("settings stay as they are: {e}")).ok()
                });
                for typed in content.into_iter().chain(wishes.take()) {
                    if let Some(change) = live.change_to(&typed) {
                        inbox.put_change(change);
                    }
                    wishes.follow(&live.current);
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
