//! The maps of near lights on the device: tiles of pages, so that many lights are drawn in one pass. Light k is tile
//! `k % maps_a_page` of page `k / maps_a_page`; its views are squares of the tile.

use super::{
    buffers::GrowingBuffer, context::GpuContext, exchange::SHADOW_MAP_FORMAT, kernel::Resource, params,
    textures::KeptLayers, view,
};
use crate::{
    EngineError,
    nearfield::frame::NearFrame,
    plan::Pass,
    visibility::point_maps::{PointCamera, PointMapSet},
};

/// A page's side never exceeds this many texels, whatever the device takes: its depth buffer is as large.
const LARGEST_SIDE: u32 = 4096;

/// How lights are spread over passes: over those that draw their maps and over those that subtract them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapSpread {
    /// As few pages of maps as the device takes: one, but for very many or very fine ones; and one pass that loops over all
    /// lights.
    #[default]
    Together,
    /// A page for each light, and a pass that adds what it loses to what the others do, as in [Gib03]; in 16-bit floats.
    Each,
}

/// The pages, and the cameras and places of the lights whose maps they hold.
pub struct PointPages {
    layers: KeptLayers,
    cameras: GrowingBuffer,
    lights: GrowingBuffer,
    camera_terms: Box<params::PointCameras>,
    light_terms: Box<params::PointLights>,
    spread: MapSpread,
    tiles: u32,
    texels: u32,
}

impl PointPages {
    /// None yet.
    pub fn new() -> Self {
        Self {
            layers: KeptLayers::result("near maps", SHADOW_MAP_FORMAT),
            cameras: GrowingBuffer::uniform("near cameras"),
            lights: GrowingBuffer::uniform("near lights"),
            camera_terms: bytemuck::zeroed_box(),
            light_terms: bytemuck::zeroed_box(),
            spread: MapSpread::Together,
            tiles: 1,
            texels: 1,
        }
    }

    /// Uploads the cameras and places of a frame's lights, to bind.
    pub fn write_terms(&mut self, context: &GpuContext, frame: &NearFrame) -> [Resource; 2] {
        view::near_cameras(frame.maps().cameras(), &mut self.camera_terms);
        let spread = [self.tiles, self.maps_a_page() as u32, self.texels];
        view::near_lights(frame, spread, &mut self.light_terms);
        [
            self.cameras.write(context, bytemuck::bytes_of(&*self.camera_terms)),
            self.lights.write(context, bytemuck::bytes_of(&*self.light_terms)),
        ]
    }

    /// Places a side of each light, as of the last [`PointPages::write_terms`].
    pub fn places(&self) -> u32 {
        self.light_terms.tiles_maps_texels_side[3]
    }

    /// Makes room for a map for each camera; what the pages held is lost where they have to grow.
    pub fn lay(&mut self, context: &GpuContext, cameras: &[Option<PointCamera>], spread: MapSpread) {
        let Some(texels) = cameras.iter().flatten().map(|c| c.texels * c.side).next() else { return };
        let most = (context.device.limits().max_texture_dimension_2d.min(LARGEST_SIDE) / texels).max(1);
        let needed = match spread {
            MapSpread::Together => (cameras.len() as f64).sqrt().ceil() as u32,
            MapSpread::Each => 1,
        };
        // Fewer lights than in the last frame leave tiles empty.
        let kept = if (self.texels, self.spread) == (texels, spread) { self.tiles } else { 1 };
        (self.texels, self.spread, self.tiles) = (texels, spread, needed.clamp(1, most).max(kept));
        let pages = cameras.len().div_ceil(self.maps_a_page());
        self.layers.sized(context, self.tiles * texels, pages as u32);
    }

    /// Tiles a side of a page.
    pub fn tiles(&self) -> u32 {
        self.tiles
    }

    /// Texels a side of a tile.
    pub fn texels(&self) -> u32 {
        self.texels
    }

    /// How many tiles one texture holds.
    pub fn maps_a_page(&self) -> usize {
        (self.tiles * self.tiles) as usize
    }

    /// A page to draw to.
    pub fn layer(&self, page: usize) -> Option<&wgpu::TextureView> {
        self.layers.layer(page)
    }

    /// All pages, to bind.
    pub fn bind(&mut self, context: &GpuContext) -> Option<Resource> {
        self.layers.bind(context)
    }

    /// Where map `k` lies: its page, and its first texel there.
    fn place(&self, k: usize) -> (usize, usize) {
        let (page, tile) = (k / self.maps_a_page(), k % self.maps_a_page());
        let (tiles, texels) = (self.tiles as usize, self.texels as usize);
        (page, tile / tiles * texels * tiles * texels + tile % tiles * texels)
    }

    /// Reads all maps; waits for the device.
    pub fn download(&mut self, context: &GpuContext, maps: &mut PointMapSet) -> Result<(), EngineError> {
        let (row, side) = ((self.tiles * self.texels) as usize, self.texels as usize);
        let mut texels: Vec<f32> = Vec::new();
        for k in 0..maps.cameras().len() {
            let (page, start) = self.place(k);
            if k % self.maps_a_page() == 0 {
                let bytes = self.layers.download(context, page as u32, Pass::PointMaps.name())?;
                texels = bytemuck::pod_collect_to_vec(&bytes);
            }
            let rows = (0..side).filter_map(|y| texels.get(start + y * row..start + y * row + side));
            let square: Vec<f32> = rows.flatten().copied().collect();
            maps.set_square(k, &square);
        }
        Ok(())
    }

    /// Brings maps that were drawn on the host.
    pub fn upload(&mut self, context: &GpuContext, maps: &PointMapSet) {
        self.lay(context, maps.cameras(), self.spread);
        let (row, side) = ((self.tiles * self.texels) as usize, self.texels as usize);
        let mut texels = vec![1.0f32; row * row];
        for k in 0..maps.cameras().len() {
            let (page, start) = self.place(k);
            if maps.get(k).is_some() {
                for (y, from) in maps.square(k).chunks_exact(side).enumerate() {
                    if let Some(to) = texels.get_mut(start + y * row..start + y * row + side) {
                        to.copy_from_slice(from);
                    }
                }
            }
            if (k + 1) % self.maps_a_page() == 0 || k + 1 == maps.cameras().len() {
                self.layers.upload(context, page as u32, bytemuck::cast_slice(&texels));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_fill_pages_row_by_row() {
        let mut pages = PointPages { tiles: 3, texels: 64, ..PointPages::new() };
        assert_eq!(pages.maps_a_page(), 9);
        assert_eq!(
            [0, 1, 4, 8].map(|k| pages.place(k)),
            [(0, 0), (0, 64), (0, 64 * 192 + 64), (0, 128 * 192 + 128)]
        );
        assert_eq!([9, 17, 18].map(|k| pages.place(k)), [(1, 0), (1, 128 * 192 + 128), (2, 0)]);
        pages.tiles = 1;
        assert_eq!([0, 5].map(|k| pages.place(k)), [(0, 0), (5, 0)]);
    }
}
