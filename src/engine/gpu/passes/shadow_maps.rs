//! `visibility/shadow_maps` on the device. Twin: `visibility::shadow_maps`.

use crate::{
    engine::{
        EngineError,
        gpu::{
            buffers::GrowingBuffer,
            context::GpuContext,
            exchange::SHADOW_MAP_FORMAT,
            kernel::{BoundGroup, Built, Drawing},
            kernels, params,
            recorder::{Recorder, Targets, cleared},
            scene::SceneBuffers,
            textures::KeptTexture,
        },
    },
    plan::Pass,
    visibility::shadow_maps::EMPTY_DEPTH,
};

const PASS: Pass = Pass::ShadowMaps;

/// The kernel.
pub struct ShadowMaps {
    built: Built,
    pipeline: wgpu::RenderPipeline,
    camera: GrowingBuffer,
    group: BoundGroup,
    depth: KeptTexture,
}

impl ShadowMaps {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::SHADOW_MAPS)?;
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
            },
        )?;
        Ok(Self {
            built,
            pipeline,
            camera: GrowingBuffer::uniform("shadow camera"),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("shadow depth", wgpu::TextureFormat::Depth32Float),
        })
    }

    /// Draws all objects of the scene into the map, which gets the camera's size.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        camera: &params::ShadowCamera,
        map: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let side = camera.texels_taps[0];
        let resources = [self.camera.write(context, bytemuck::bytes_of(camera))];
        let group = self.group.of(context, &self.built, &resources);
        let depth = self.depth.sized(context, side, side, 1);
        let map = map.sized(context, side, side, 1);
        let empty = wgpu::Color { r: f64::from(EMPTY_DEPTH.to_bits()), ..wgpu::Color::TRANSPARENT };
        let targets = Targets { color: cleared(map, None, empty), depth: Some((depth, EMPTY_DEPTH)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            scene.draw_casters(context, pass);
        })
    }
}
