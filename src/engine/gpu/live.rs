//! What lives on the device: every buffer and texture with the pass that it was made for. What a frame does not call for is
//! freed before its first pass; whoever owns it finds that out and makes it anew when it is called for again.

use crate::{
    LiveMemory,
    plan::{Pass, PassSet},
};
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, AtomicUsize, Ordering},
};

/// Stand for no pass, and for all that draw the scene.
const NONE: usize = Pass::ALL.len();
const SCENE: usize = NONE + 1;

/// What can be freed.
enum Memory {
    Buffer(wgpu::Buffer),
    Texture(wgpu::Texture),
}

struct LiveResource {
    name: &'static str,
    bytes: u64,
    owner: usize,
    is_live: Arc<AtomicBool>,
    memory: Memory,
}

/// Held by the owner of a buffer or a texture.
pub struct Lease(Arc<AtomicBool>);

impl Lease {
    /// Whether it is still there.
    pub fn is_live(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// All of a device.
pub struct LiveList {
    entries: Mutex<Vec<LiveResource>>,
    owner: AtomicUsize,
}

impl Default for LiveList {
    fn default() -> Self {
        Self::new()
    }
}

impl LiveList {
    /// Nothing.
    pub fn new() -> Self {
        Self { entries: Mutex::default(), owner: AtomicUsize::new(NONE) }
    }

    /// What is made from now on is made for this pass.
    pub fn serve(&self, pass: Pass) {
        self.owner.store(pass as usize, Ordering::Relaxed);
    }

    /// What is made from now on is made for every pass that draws the scene.
    pub fn serve_the_scene(&self) {
        self.owner.store(SCENE, Ordering::Relaxed);
    }

    /// What is made from now on stays.
    pub fn serve_all(&self) {
        self.owner.store(NONE, Ordering::Relaxed);
    }

    /// Notes a buffer.
    pub fn buffer(&self, name: &'static str, buffer: &wgpu::Buffer) -> Lease {
        self.add(name, buffer.size(), Memory::Buffer(buffer.clone()))
    }

    /// Notes a texture.
    pub fn texture(&self, name: &'static str, texture: &wgpu::Texture) -> Lease {
        let texel = texture.format().block_copy_size(None).unwrap_or(4);
        let texels = texture.width() * texture.height() * texture.depth_or_array_layers();
        let bytes = u64::from(texels) * u64::from(texel * texture.sample_count());
        self.add(name, bytes, Memory::Texture(texture.clone()))
    }

    fn add(&self, name: &'static str, bytes: u64, memory: Memory) -> Lease {
        let is_live = Arc::new(AtomicBool::new(true));
        let owner = self.owner.load(Ordering::Relaxed);
        let mut entries = self.entries();
        entries.retain(|entry| entry.is_live.load(Ordering::Relaxed));
        entries.push(LiveResource { name, bytes, owner, is_live: Arc::clone(&is_live), memory });
        Lease(is_live)
    }

    /// Frees all that was made for drawing passes that a frame does not use. What was made for measuring stays.
    pub fn free_all_but(&self, uses: PassSet) {
        let draws = uses.iter().any(Pass::draws_scene);
        let is_called_for = |owner: usize| match Pass::ALL.get(owner) {
            Some(pass) => pass.is_measuring() || uses.has(*pass),
            None => owner != SCENE || draws,
        };
        self.entries().retain(|entry| {
            let is_live = entry.is_live.load(Ordering::Relaxed);
            let stays = is_live && is_called_for(entry.owner);
            if is_live && !stays {
                entry.is_live.store(false, Ordering::Relaxed);
                match &entry.memory {
                    Memory::Buffer(buffer) => buffer.destroy(),
                    Memory::Texture(texture) => texture.destroy(),
                }
            }
            stays
        });
    }

    /// Lists what lives, by name.
    pub fn list(&self, out: &mut Vec<LiveMemory>) {
        out.clear();
        let entries = self.entries();
        let live = entries.iter().filter(|entry| entry.is_live.load(Ordering::Relaxed));
        out.extend(live.map(|entry| LiveMemory { name: entry.name, bytes: entry.bytes }));
        out.sort_unstable();
    }

    fn entries(&self) -> MutexGuard<'_, Vec<LiveResource>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
