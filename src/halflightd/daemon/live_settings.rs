//! Follows the settings file while the daemon runs: what is typed there takes effect on the next frame.

use super::{blocker_spheres, governing::governor_of, host::Silent, run::options_of, vertex_transfer};
use crate::config::{live::take_over, settings::Settings};
use crate::model::{frame::Exposure, quality::Quality, scene::Scene};
use crate::pipeline::{Change, event::Event, feed::Feed};
use std::path::PathBuf;
use std::time::SystemTime;

/// Keys that change what a scene's bodies carry with them: made anew, or taken from the cache folder.
const OF_THE_SCENE: [&str; 3] = ["light.order", "quality.self_shadow", "quality.spheres"];

/// A settings file that is looked at before each frame. A file that is missing, or has a mistake, changes nothing: the
/// mistake is logged once.
pub struct LiveSettings {
    path: PathBuf,
    read: Box<dyn Fn() -> Result<Settings, String>>,
    /// Time of its last change, and its length.
    seen: Option<(SystemTime, u64)>,
    current: Settings,
}

impl LiveSettings {
    /// Follows `path`; `read` gives all settings as that file and whatever wins over it say, `current` what the
    /// program was started with.
    pub fn new(
        path: PathBuf,
        read: impl Fn() -> Result<Settings, String> + 'static,
        current: &Settings,
    ) -> Self {
        let mut live = Self { path, read: Box::new(read), seen: None, current: current.clone() };
        live.seen = live.stamp();
        live
    }

    fn stamp(&self) -> Option<(SystemTime, u64)> {
        let about = std::fs::metadata(&self.path).ok()?;
        Some((about.modified().ok()?, about.len()))
    }

    /// What changed since the last call, if anything.
    fn change(&mut self, cycle: &[Exposure]) -> Option<Change> {
        // A file that is just being replaced is looked for again.
        let stamp = self.stamp()?;
        if self.seen.replace(stamp) == Some(stamp) {
            return None;
        }
        let typed = match (self.read)() {
            Ok(typed) => typed,
            Err(mistakes) => {
                tracing::warn!("settings stay as they are: {mistakes}");
                return None;
            }
        };
        let taken = take_over(&mut self.current, &typed);
        for key in &taken.waiting {
            tracing::warn!("{key} has changed: it takes effect at the next start");
        }
        for key in &taken.live {
            tracing::info!("{key} has changed");
        }
        let of_the_scene = taken.live.iter().any(|key| OF_THE_SCENE.contains(key));
        // Other settings of accuracy are another ground for the front.
        let governed = taken.live.iter().any(|key| key.starts_with("quality.") || key.starts_with("light."));
        let govern = governed.then(|| governor_of(&self.current)).transpose().unwrap_or_else(|mistake| {
            tracing::warn!("the governor stays as it is: {mistake}");
            None
        });
        (!taken.live.is_empty()).then(|| Change {
            options: options_of(&self.current, cycle),
            dress: of_the_scene.then_some(dress as fn(&mut Scene, &Quality)),
            govern,
        })
    }
}

/// Gives the bodies of a scene their spheres and their transfer, in place of those that they have.
fn dress(scene: &mut Scene, quality: &Quality) {
    for figure in &mut scene.figures {
        figure.spheres.clear();
    }
    scene.transfer = None;
    blocker_spheres::fit(scene, quality.spheres, &Silent);
    vertex_transfer::bake(scene, quality, &Silent);
}

/// A feed that also tells of changed settings.
pub struct Watched<'a> {
    /// Where everything else comes from.
    pub feed: &'a mut dyn Feed,
    /// The settings.
    pub live: Option<&'a mut LiveSettings>,
    /// Exposures that the camera goes through.
    pub cycle: &'a [Exposure],
}

impl Feed for Watched<'_> {
    fn next_event(&mut self) -> Event {
        match self.live.as_mut().and_then(|live| live.change(self.cycle)) {
            Some(change) => Event::Changed(Box::new(change)),
            None => self.feed.next_event(),
        }
    }
}
