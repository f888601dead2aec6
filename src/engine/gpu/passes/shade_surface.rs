//! `compose/shade_surface` on the device. Twin: `compose::shade_surface`.

use super::shade_object::Frame;
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::RATIOS_FORMAT,
        kernel::{BoundGroup, Built, Drawing, Resource},
        kernels,
        params::{self, SurfaceVertex},
        recorder::{Recorder, Targets, cleared},
        scene::SceneBuffers,
        textures::KeptTexture,
    },
    plan::Pass,
};

const PASS: Pass = Pass::ShadeSurface;

/// The kernel.
pub struct ShadeSurface {
    built: Built,
    /// Without and with bands 4 and 5 of the light.
    pipelines: [Option<wgpu::RenderPipeline>; 2],
    view: GrowingBuffer,
    light: GrowingBuffer,
    cameras: GrowingBuffer,
    soft: GrowingBuffer,
    group: BoundGroup,
    depth: KeptTexture,
}

impl ShadeSurface {
    /// Compiles the shader; pipelines follow when they are first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &kernels::SHADE_SURFACE)?,
            pipelines: [const { None }; 2],
            view: GrowingBuffer::uniform("view"),
            light: GrowingBuffer::uniform("light"),
            cameras: GrowingBuffer::uniform("shadow cameras"),
            soft: GrowingBuffer::uniform("soft picture"),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("surface depth", wgpu::TextureFormat::Depth32Float),
        })
    }

    /// Draws the scene's real surfaces; the ratios get the lens' size. `soft`: where soft shadows are, and their picture.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        frame: &Frame<'_>,
        soft: (&params::SoftPicture, Resource),
        ratios: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let has_high_bands = frame.light.order_hard[0] > 4;
        let slot = &mut self.pipelines[usize::from(has_high_bands)];
        let pipeline = match slot {
            Some(pipeline) => pipeline,
            None => slot.insert(pipeline(context, &self.built, has_high_bands)?),
        };
        let resources = [
            self.view.write(context, bytemuck::bytes_of(frame.view)),
            self.light.write(context, bytemuck::bytes_of(frame.light)),
            self.cameras.write(context, bytemuck::bytes_of(frame.cameras)),
            frame.shadow_maps.clone(),
            self.soft.write(context, bytemuck::bytes_of(soft.0)),
            soft.1,
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (frame.view.frame[0] as u32, frame.view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let ratios = ratios.sized(context, width, height, 1);
        let one = f64::from(1.0f32.to_bits());
        let untouched = wgpu::Color { r: one, g: one, b: one, a: 0.0 };
        let targets = Targets { color: cleared(ratios, None, untouched), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            scene.draw_surfaces(context, pass);
        })
    }
}

fn pipeline(
    context: &GpuContext,
    built: &Built,
    has_high_bands: bool,
) -> Result<wgpu::RenderPipeline, EngineError> {
    let drawing = Drawing {
        vertex: "vertex",
        fragment: "fragment",
        stride: size_of::<SurfaceVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x3],
        color: RATIOS_FORMAT,
        write: wgpu::ColorWrites::ALL,
        nearer: wgpu::CompareFunction::Greater,
        samples: 1,
        constants: &[("HIGH_BANDS", f64::from(u8::from(has_high_bands)))],
    };
    built.drawing(context, &drawing)
}
