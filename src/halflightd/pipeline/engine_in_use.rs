//! The engine that draws, and what becomes of one that fails: it is asked again with every frame, and given up for another
//! after a while where one can stand in.

use super::policy::{self, Missing};
use crate::engine::{Engine, EngineError};
use crate::model::{light::RadianceSamples, scene::Scene, time::Timestamp};
use crate::nearfield::prepare::KnownRoom;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// Opens an engine that stands in, with the room and the scene loaded.
pub type StandIn =
    Box<dyn FnMut(&Scene, Option<&Arc<KnownRoom>>) -> Result<Box<dyn Engine>, EngineError> + Send>;

/// What comes back from the thread that opened an engine: the way to open another, and the engine for that scene.
type OpenedEngine = (StandIn, Arc<Scene>, Result<Box<dyn Engine>, EngineError>);

/// Where the engine that stands in is.
#[derive(Default)]
enum Replacement {
    /// There is none (any more).
    #[default]
    None,
    /// It can be opened, on the thread of the frames or beside it.
    CanOpen { open: StandIn, beside: bool },
    /// It is being opened on a thread of its own: that takes as long as a scene takes to load.
    Opening(Receiver<OpenedEngine>),
}

/// The engine and how it fares.
pub struct EngineInUse {
    engine: Box<dyn Engine>,
    replacement: Replacement,
    failing_since: Option<Timestamp>,
    /// Times it has failed in a row.
    failures: u64,
    holds_scene: bool,
}

impl EngineInUse {
    /// An engine that holds the scene.
    pub fn new(engine: Box<dyn Engine>) -> Self {
        Self { engine, replacement: Replacement::None, failing_since: None, failures: 0, holds_scene: true }
    }

    /// Another engine is opened by `open` where this one keeps failing: at once, so that every run is the same, or `beside`
    /// the frames, which go on meanwhile.
    pub fn replace_by(&mut self, open: StandIn, beside: bool) {
        self.replacement = Replacement::CanOpen { open, beside };
    }

    /// From now on another engine is opened beside the frames.
    pub fn open_beside(&mut self) {
        if let Replacement::CanOpen { beside, .. } = &mut self.replacement {
            *beside = true;
        }
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
        scene: &Arc<Scene>,
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
        if row.stand_in {
            self.replace(t, scene, room, row.says);
        }
        row.says
    }

    /// Goes one step towards another engine.
    fn replace(
        &mut self,
        t: Timestamp,
        scene: &Arc<Scene>,
        room: Option<&Arc<KnownRoom>>,
        says: &'static str,
    ) {
        let was_beside = !matches!(self.replacement, Replacement::CanOpen { beside: false, .. });
        let opened = match std::mem::take(&mut self.replacement) {
            Replacement::None => return,
            Replacement::CanOpen { mut open, beside: false } => {
                let engine = open(scene, room);
                (open, Arc::clone(scene), engine)
            }
            Replacement::CanOpen { open, beside: true } => {
                self.replacement = begin(open, Arc::clone(scene), room.cloned());
                return;
            }
            Replacement::Opening(receiver) => match receiver.try_recv() {
                Ok(opened) => opened,
                Err(TryRecvError::Empty) => {
                    self.replacement = Replacement::Opening(receiver);
                    return;
                }
                Err(TryRecvError::Disconnected) => {
                    tracing::error!("no other engine: the thread that opened it has panicked");
                    return;
                }
            },
        };
        match opened {
            (_, its_scene, Ok(engine)) => {
                tracing::warn!("{says}: {}", engine.description());
                *self = Self::new(engine);
                // The scene may have changed while the engine was opened.
                self.holds_scene = Arc::ptr_eq(&its_scene, scene);
            }
            (open, _, Err(error)) => {
                tracing::warn!("no other engine can be opened: {error}");
                // Asked again when it has failed for as long again.
                self.replacement = Replacement::CanOpen { open, beside: was_beside };
                self.failing_since = Some(t);
            }
        }
    }
}

/// Opens an engine on a thread of its own; at once where there is no thread to be had.
fn begin(mut open: StandIn, scene: Arc<Scene>, room: Option<Arc<KnownRoom>>) -> Replacement {
    let (give, opening) = sync_channel(1);
    let work = move || {
        let engine = open(&scene, room.as_ref());
        // Nobody takes it where the program has ended meanwhile.
        let _ = give.send((open, scene, engine));
    };
    match std::thread::Builder::new().name("halflight-stand".into()).spawn(work) {
        Ok(_) => Replacement::Opening(opening),
        Err(error) => {
            tracing::warn!("no other engine: no thread can be made: {error}");
            Replacement::None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;

    fn failing() -> EngineError {
        EngineError::Input("it fails".into())
    }

    /// An engine in use whose stand-in can be opened from the second try on, and how many tries there were.
    fn engine(beside: bool) -> (EngineInUse, Arc<std::sync::atomic::AtomicU32>) {
        let tries = Arc::new(std::sync::atomic::AtomicU32::new(0));
        let counted = Arc::clone(&tries);
        let mut engine = EngineInUse::new(Box::new(CpuEngine::new(Some(1)).unwrap()));
        let open: StandIn =
            Box::new(move |_, _| match counted.fetch_add(1, std::sync::atomic::Ordering::SeqCst) {
                0 => Err(failing()),
                _ => Ok(Box::new(CpuEngine::new(Some(2))?) as Box<dyn Engine>),
            });
        engine.replace_by(open, beside);
        (engine, tries)
    }

    #[test]
    fn an_engine_that_keeps_failing_is_replaced_at_once_or_beside_the_frames() {
        for beside in [false, true] {
            let (mut engine, tries) = engine(beside);
            let scene = Arc::new(Scene::default());
            let first = engine.get().description();
            let mut frames = 0;
            while engine.get().description() == first {
                frames += 1;
                assert!(frames < 100_000, "it is never replaced");
                // Ten frames a second; a thread gets its turn.
                engine.failed(&failing(), Timestamp::from_seconds(0.1 * f64::from(frames)), &scene, None);
                std::thread::yield_now();
            }
            assert_eq!(tries.load(std::sync::atomic::Ordering::SeqCst), 2);
            assert!(frames > 20, "each try waits for the engine's patience: {frames}");
            assert!(beside || frames < 30, "{frames}");
        }
    }
}
