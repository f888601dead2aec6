//! `visibility/point_maps` on the device. Twin: `visibility::point_maps`.

use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::SHADOW_MAP_FORMAT,
        kernel::{BoundGroup, Built, Drawing, Resource},
        kernels, params,
        point_pages::{PointPages, Spread},
        recorder::{Recorder, Targets, cleared},
        scene::Mesh,
        textures::KeptTexture,
        view,
    },
    nearfield::frame::{MOST_LIGHTS, NearFrame},
    plan::Pass,
    visibility::shadow_maps::EMPTY_DEPTH,
};

const PASS: Pass = Pass::PointMaps;
/// Bytes from one page to the next: the largest alignment that a device may ask for.
const PAGE_STRIDE: usize = 256;

/// The kernel.
pub struct PointMaps {
    built: Built,
    pipeline: wgpu::RenderPipeline,
    cameras: GrowingBuffer,
    pages: GrowingBuffer,
    bytes: Vec<u8>,
    group: BoundGroup,
    casters: Mesh,
    depth: KeptTexture,
    near_cameras: Box<params::PointCameras>,
    lights: GrowingBuffer,
    near_lights: Box<params::PointLights>,
}

impl PointMaps {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::POINT_MAPS)?;
        let pipeline = built.drawing(
            context,
            &Drawing {
                vertex: "vertex",
                fragment: "fragment",
                stride: 12,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
                color: SHADOW_MAP_FORMAT,
                write: wgpu::ColorWrites::RED,
                nearer: wgpu::CompareFunction::Less,
                samples: 1,
                constants: &[],
            },
        )?;
        Ok(Self {
            built,
            pipeline,
            cameras: GrowingBuffer::uniform("near cameras"),
            pages: GrowingBuffer::uniform("pages of near maps"),
            bytes: Vec::new(),
            group: BoundGroup::default(),
            casters: Mesh::new(),
            depth: KeptTexture::scratch("near depth", wgpu::TextureFormat::Depth32Float),
            near_cameras: bytemuck::zeroed_box(),
            lights: GrowingBuffer::uniform("near lights"),
            near_lights: bytemuck::zeroed_box(),
        })
    }

    /// Draws the stand-ins (`triangles` of the frame's casters) into all views of every light's map: all in one pass, or in as many as
    /// `spread` and the device's largest texture ask for.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        frame: &NearFrame,
        triangles: &[[u32; 3]],
        spread: Spread,
        pages: &mut PointPages,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let cameras = frame.maps().cameras();
        pages.lay(context, cameras, spread);
        view::near_cameras(cameras, &mut self.near_cameras);
        let spread = [pages.tiles(), pages.maps_a_page() as u32, pages.texels()];
        view::near_lights(frame, spread, &mut self.near_lights);
        let [.., places] = self.near_lights.tiles_maps_texels_side;
        let count = cameras.len().min(MOST_LIGHTS);
        self.casters.write(context, frame.casters(), triangles);
        self.bytes.clear();
        for first in (0..count).step_by(pages.maps_a_page()) {
            let (tiles, texels) = (pages.tiles(), pages.texels());
            let page = params::PointPage { first_tiles_texels: [first as u32, tiles, texels, 0] };
            self.bytes.extend_from_slice(bytemuck::bytes_of(&page));
            self.bytes.resize(self.bytes.len().next_multiple_of(PAGE_STRIDE), 0);
        }
        self.pages.write(context, &self.bytes);
        let window = self.pages.at_least(context, self.bytes.len()).clone();
        let resources = [
            self.cameras.write(context, bytemuck::bytes_of(&*self.near_cameras)),
            Resource::Window(window, size_of::<params::PointPage>() as u64),
            self.lights.write(context, bytemuck::bytes_of(&*self.near_lights)),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let side = pages.tiles() * pages.texels();
        let depth = self.depth.sized(context, side, side, 1);
        let empty = wgpu::Color { r: f64::from(EMPTY_DEPTH.to_bits()), ..wgpu::Color::TRANSPARENT };
        for (k, first) in (0..count).step_by(pages.maps_a_page()).enumerate() {
            let Some(layer) = pages.layer(k) else { continue };
            let instances = (count - first).min(pages.maps_a_page()) as u32 * places * places;
            let targets = Targets { color: cleared(layer, None, empty), depth: Some((depth, EMPTY_DEPTH)) };
            recorder.draw(PASS, targets, |pass| {
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, group, &[(k * PAGE_STRIDE) as u32]);
                self.casters.draw(context, pass, instances);
            })?;
        }
        Ok(())
    }
}
