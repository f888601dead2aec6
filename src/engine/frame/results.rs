//! The results of passes that are in the host's memory.

use super::FrameState;
use crate::LiveMemory;
use crate::model::image::{Image, RadianceImage};
use crate::nearfield::frame::NearFrame;
use crate::plan::{Pass, PassSet, Product};

/// Pictures that passes hand on to each other. Empty where they were not made here.
#[derive(Default)]
pub(crate) struct HostResults {
    /// What is taken of the soft light (r, g, b) and the inverse depth (a).
    pub soft: Image<[f32; 4]>,
    /// Virtual objects over nothing.
    pub object_layer: Image<[f32; 4]>,
    /// What virtual objects leave of the light on real surfaces.
    pub ratios: RadianceImage,
}

impl FrameState {
    /// Frees the results of passes that a frame does not use.
    pub(super) fn free_all_but(&mut self, uses: PassSet) {
        for pass in Pass::ALL.into_iter().filter(|pass| !pass.is_measuring() && !uses.has(*pass)) {
            self.held.forget(pass);
        }
        if !uses.make(Product::ShadowMaps) {
            self.shadows.free();
        }
        if !uses.make(Product::SoftShadows) {
            self.results.soft = Image::default();
        }
        if !uses.make(Product::PointMaps) && self.held.forget_near_lights() {
            self.room.frame = NearFrame::default();
        }
        if !uses.make(Product::ObjectLayer) {
            self.results.object_layer = Image::default();
        }
        if !uses.make(Product::Ratios) {
            self.results.ratios = Image::default();
        }
    }

    /// Lists what passes have made.
    pub fn live(&self, out: &mut Vec<LiveMemory>) {
        fn of<P: Clone>(image: &Image<P>) -> usize {
            size_of_val(image.pixels())
        }
        let maps = |k: usize| size_of_val(self.shadows.depth(k));
        let near = self.room.frame.maps();
        let near_map = |k: usize| {
            near.get(k).map_or(0, |(_, maps)| maps.iter().map(|map| size_of_val(map.depth())).sum())
        };
        out.clear();
        for (name, bytes) in [
            ("near maps", (0..near.cameras().len()).map(near_map).sum()),
            ("object layer", of(&self.results.object_layer)),
            ("ratios", of(&self.results.ratios)),
            ("shadow maps", (0..self.shadows.cameras().len()).map(maps).sum()),
            ("soft shadows", of(&self.results.soft)),
        ] {
            if bytes > 0 {
                out.push(LiveMemory { name, bytes: bytes as u64 });
            }
        }
    }
}
