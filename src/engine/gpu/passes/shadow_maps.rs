//! `visibility/shadow_maps` on the device. Twin: `visibility::shadow_maps`.

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
        textures::KeptTexture,
    },
    plan::Pass,
    visibility::shadow_maps::EMPTY_DEPTH,
};

/// `visibility/shadow_maps`: depth along the light, as bits in an integer target.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::ShadowMaps,
    sources: &[source!("shared/shadow_camera"), source!("visibility/shadow_maps")],
    entries: &["vertex", "fragment"],
    bindings: &[Binding::new("camera", BindingKind::UniformAtOffset)],
    structs: &[params::ShadowCamera::LAYOUT],
};

const PASS: Pass = Pass::ShadowMaps;
/// Bytes from one camera to the next: the largest alignment that a device may ask for.
const CAMERA_STRIDE: usize = 256;

/// The kernel.
pub struct ShadowMaps {
    built: Built,
    pipeline: wgpu::RenderPipeline,
    cameras: GrowingBuffer,
    bytes: Vec<u8>,
    group: BoundGroup,
    depth: KeptTexture,
}

impl ShadowMaps {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let pipeline = built.drawing(
            context,
            &Drawing {
                vertex: "vertex",
                fragment: "fragment",
                stride: size_of::<params::ObjectVertex>() as u64,
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
            cameras: GrowingBuffer::uniform("cameras of shadow maps"),
            bytes: Vec::new(),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("shadow depth", wgpu::TextureFormat::Depth32Float),
        })
    }
}

impl DevicePass for ShadowMaps {
    /// Fits the cameras.
    fn prepare(&mut self, frame: &mut DeviceFrame<'_>, _exchange: &Exchange) -> bool {
        frame.state.fit_shadow_cameras(frame.job);
        frame.state.note_shadow_maps();
        true
    }

    /// Draws all objects of the scene into a layer for each camera (those without a map are skipped); the layers get the
    /// cameras' size.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, state, scene, .. } = frame;
        let (context, maps) = (recorder.context, &mut exchange.shadow_maps);
        let count = state.shadows.cameras().len();
        let cameras = &scene.terms.cameras.cameras;
        let cameras = &cameras[..count.min(cameras.len())];
        let Some(side) = cameras.iter().map(|c| c.texels_taps[0]).find(|&side| side > 0) else {
            return Ok(());
        };
        self.bytes.clear();
        for camera in cameras {
            self.bytes.extend_from_slice(bytemuck::bytes_of(camera));
            self.bytes.resize(self.bytes.len().next_multiple_of(CAMERA_STRIDE), 0);
        }
        self.cameras.write(context, &self.bytes);
        let window = self.cameras.at_least(context, self.bytes.len()).clone();
        let resources = [Resource::Window(window, size_of::<params::ShadowCamera>() as u64)];
        let group = self.group.of(context, &self.built, &resources);
        let depth = self.depth.sized(context, side, side, 1);
        maps.sized(context, side, count as u32);
        let empty = wgpu::Color { r: f64::from(EMPTY_DEPTH.to_bits()), ..wgpu::Color::TRANSPARENT };
        for (k, camera) in cameras.iter().enumerate() {
            let Some(layer) = maps.layer(k).filter(|_| camera.texels_taps[0] > 0) else { continue };
            let targets = Targets { color: cleared(layer, None, empty), depth: Some((depth, EMPTY_DEPTH)) };
            recorder.draw(PASS, targets, |pass| {
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, group, &[(k * CAMERA_STRIDE) as u32]);
                scene.meshes.draw_casters(context, pass);
            })?;
        }
        Ok(())
    }
}
