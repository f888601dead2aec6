//! `compose/composite` on the device. Twin: `compose::composite`.

use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        kernel::{BoundGroup, Built, Resource},
        kernels,
        params::CompositeParams,
        recorder::Recorder,
    },
    model::image::RadianceImage,
    plan::Pass,
};

const PASS: Pass = Pass::Composite;
/// Side of a workgroup.
const TILE: u32 = 8;

/// The kernel with its buffers.
pub struct Composite {
    built: Built,
    pipeline: wgpu::ComputePipeline,
    params: GrowingBuffer,
    background: GrowingBuffer,
    group: BoundGroup,
}

impl Composite {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::COMPOSITE)?;
        let pipeline = built.compute(context, "composite")?;
        Ok(Self {
            built,
            pipeline,
            params: GrowingBuffer::uniform("composite params"),
            background: GrowingBuffer::storage("background"),
            group: BoundGroup::default(),
        })
    }

    /// Lays the layer over the background; `radiance` gets three floats a pixel.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        background: &RadianceImage,
        layers: &Layers,
        radiance: &mut GrowingBuffer,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let (width, height) = (background.width() as u32, background.height() as u32);
        let params = CompositeParams {
            size_origin: [width, height, layers.origin[0], layers.origin[1]],
            layer_scale: layers.layer_scale,
            present: u32::from(layers.has_objects) | u32::from(layers.has_ratios) << 1,
            unused: [0; 2],
        };
        let bytes = bytemuck::cast_slice(background.pixels());
        let resources = [
            self.params.write(context, bytemuck::bytes_of(&params)),
            self.background.write(context, bytes),
            layers.objects.clone(),
            layers.ratios.clone(),
            radiance.bind(context, bytes.len()),
        ];
        let group = self.group.of(context, &self.built, &resources);
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(width.div_ceil(TILE), height.div_ceil(TILE), 1);
        })
    }
}

/// What is laid over the background.
pub struct Layers {
    /// Object layer, a part of the picture; any texture where there is none.
    pub objects: Resource,
    /// That part's first column and row.
    pub origin: [u32; 2],
    /// Ratios; any texture where there are none.
    pub ratios: Resource,
    /// Whether there is an object layer.
    pub has_objects: bool,
    /// Whether there are ratios.
    pub has_ratios: bool,
    /// Multiplies the object layer's colours.
    pub layer_scale: f32,
}
