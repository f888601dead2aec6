//! The engine that draws, and what becomes of one that fails: it is asked again with every frame, and given up for another
//! after a while where one can stand in.

use super::policy::{self, Missing};
use crate::engine::{Engine, EngineError};
use crate::model::{light::RadianceSamples, scene::Scene, time::Timestamp};
use crate::nearfield::prepare::KnownRoom;
use std::sync::Arc;

/// Opens an engine that stands in, with the room and the scene loaded.
pub type StandIn =
    Box<dyn FnMut(&Scene, Option<&Arc<KnownRoom>>) -> Result<Box<dyn Engine>, EngineError> + Send>;

/// The engine and how it fares.
pub struct EngineInUse {
    engine: Box<dyn Engine>,
    /// Opens another; used once.
    pub(super) stand_in: Option<StandIn>,
    failing_since: Option<Timestamp>,
    /// Times it has failed in a row.
    failures: u64,
    holds_scene: bool,
}

impl EngineInUse {
    /// An engine that holds the scene.
    pub fn new(engine: Box<dyn Engine>) -> Self {
        Self { engine, stand_in: None, failing_since: None, failures: 0, holds_scene: true }
    }

    /// Borrows what draws now.
    pub fn get(&mut self) -> &mut dyn Engine {
        self.engine.as_mut()
    }

    /// The directions behind the newest estimate of the light.
    pub fn measured_samples(&self) -> &RadianceSamples {
        self.engine.measured_samples()
    }

    /// The scene has changed: the engine does not hold it.
    pub fn has_another_scene(&mut self) {
        self.holds_scene = false;
    }

    /// Gives the engine the scene, where it does not hold it.
    pub fn load(&mut self, scene: &Scene) -> Result<(), EngineError> {
        if !self.holds_scene {
            self.engine.load_scene(scene)?;
            self.holds_scene = true;
        }
        Ok(())
    }

    /// A frame was drawn.
    pub fn has_drawn(&mut self) {
        if self.failing_since.take().is_some() {
            tracing::info!("the engine draws again after {} failures", std::mem::take(&mut self.failures));
        }
    }

    /// A frame could not be drawn. Returns what is said of it; an engine that has failed for as long as the policy says is
    /// given up, where another can be opened.
    pub fn failed(
        &mut self,
        error: &EngineError,
        t: Timestamp,
        scene: &Scene,
        room: Option<&Arc<KnownRoom>>,
    ) -> &'static str {
        // Once, and now and then: a lost device fails with every frame.
        if self.failures.is_multiple_of(100) {
            tracing::warn!("shown without virtual objects: {error}");
        }
        self.failures += 1;
        let since = *self.failing_since.get_or_insert(t);
        let Some(row) = policy::judge([(Missing::Engine, t.seconds_since(since))]) else {
            return "the engine could not draw";
        };
        if let Some(mut open) = self.stand_in.take_if(|_| row.stand_in) {
            match open(scene, room) {
                Ok(engine) => {
                    tracing::warn!("{}: {}", row.says, engine.description());
                    *self = Self::new(engine);
                }
                Err(error) => {
                    tracing::warn!("no other engine can be opened: {error}");
                    // Asked again when it has failed for as long again.
                    (self.stand_in, self.failing_since) = (Some(open), Some(t));
                }
            }
        }
        row.says
    }
}
