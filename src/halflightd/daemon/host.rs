//! What the program around the pipeline lends it: more file formats, and a place to show how far long work is.

use crate::assets::known_room::Readers;

/// Shows how far long work is. The daemon shows nothing; the tool draws bars.
pub trait Progress: Sync {
    /// Work of this name begins: `of the room`, `of the transfer`.
    fn begin(&self, what: &'static str) -> Box<dyn Task>;
}

/// One piece of long work. Dropping it says that the work is over.
pub trait Task: Sync {
    /// The share that is done, 0 to 1; may be told from several threads.
    fn reach(&self, share: f32);
}

/// Shows nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _what: &'static str) -> Box<dyn Task> {
        Box::new(Self)
    }
}

impl Task for Silent {
    fn reach(&self, _share: f32) {}
}

/// What a program lends to the wiring of the pipeline.
#[derive(Clone, Copy)]
pub struct Host<'a> {
    /// How files become radiance and rooms.
    pub readers: Readers,
    /// Where long work shows how far it is.
    pub progress: &'a dyn Progress,
}

impl Default for Host<'_> {
    /// The formats of the product, and no progress shown: the daemon's.
    fn default() -> Self {
        Self { readers: Readers::default(), progress: &Silent }
    }
}
