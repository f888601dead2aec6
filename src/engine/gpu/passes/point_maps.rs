//! `visibility/point_maps` on the device. Twin: `visibility::point_maps`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{Exchange, SHADOW_MAP_FORMAT},
        kernel::{Binding, BindingKind, BoundGroup, Built, Drawing, KernelRow, Resource, source},
        params,
        recorder::{Targets, cleared},
        scene::DeviceMesh,
        textures::KeptTexture,
    },
    nearfield::frame::MOST_LIGHTS,
    plan::{Pass, Product},
    visibility::shadow_maps::EMPTY_DEPTH,
};

/// `visibility/point_maps`: depths of the stand-ins from many lights at once, an instance and a tile each.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::PointMaps,
    sources: &[source!("shared/point_camera"), source!("visibility/point_maps")],
    entries: &["vertex", "fragment"],
    bindings: &[
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("page", BindingKind::UniformAtOffset),
        Binding::new("lights", BindingKind::Uniform),
    ],
    structs: &[
        params::PointCamera::LAYOUT,
        params::PointCameras::LAYOUT,
        params::PointPage::LAYOUT,
        params::PointLights::LAYOUT,
    ],
};

const PASS: Pass = Pass::PointMaps;
/// Bytes from one page to the next: the largest alignment that a device may ask for.
const PAGE_STRIDE: usize = 256;

/// The kernel.
pub struct PointMaps {
    built: Built,
    pipeline: wgpu::RenderPipeline,
    pages: GrowingBuffer,
    bytes: Vec<u8>,
    group: BoundGroup,
    casters: DeviceMesh,
    depth: KeptTexture,
}

impl PointMaps {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
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
            pages: GrowingBuffer::uniform("pages of near maps"),
            bytes: Vec::new(),
            group: BoundGroup::default(),
            casters: DeviceMesh::new(),
            depth: KeptTexture::scratch("near depth", wgpu::TextureFormat::Depth32Float),
        })
    }
}

impl DevicePass for PointMaps {
    /// Finds the lights, where the host has not drawn their maps for its own use.
    fn prepare(&mut self, frame: &mut DeviceFrame<'_>, exchange: &Exchange) -> bool {
        if !exchange.is_on_host(Product::PointMaps) {
            frame.recorder.host(PASS, || frame.state.find_room_lights(frame.job));
        }
        frame.state.note_point_maps();
        true
    }

    /// Draws the stand-ins into all views of every light's map: all in one pass, or in as many as `spread` and the device's
    /// largest texture ask for.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, state, spread, .. } = frame;
        let (context, pages) = (recorder.context, &mut exchange.point_maps);
        let (near, triangles) = (&state.room.frame, state.room.casters());
        let cameras = near.maps().cameras();
        pages.lay(context, cameras, *spread);
        let [near_cameras, near_lights] = pages.write_terms(context, near);
        let places = pages.places();
        let count = cameras.len().min(MOST_LIGHTS);
        self.casters.write(context, near.casters(), triangles);
        self.bytes.clear();
        for first in (0..count).step_by(pages.maps_a_page()) {
            let (tiles, texels) = (pages.tiles(), pages.texels());
            let page = params::PointPage { first_tiles_texels: [first as u32, tiles, texels, 0] };
            self.bytes.extend_from_slice(bytemuck::bytes_of(&page));
            self.bytes.resize(self.bytes.len().next_multiple_of(PAGE_STRIDE), 0);
        }
        self.pages.write(context, &self.bytes);
        let window = self.pages.at_least(context, self.bytes.len()).clone();
        let resources =
            [near_cameras, Resource::Window(window, size_of::<params::PointPage>() as u64), near_lights];
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
