//! `compose/composite` on the device. Twin: `compose::composite`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::Exchange,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, source},
        params::CompositeParams,
    },
    plan::{Pass, Product},
};

/// `compose/composite`: one invocation a pixel.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::Composite,
    sources: &[source!("compose/composite")],
    entries: &["composite"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("background", BindingKind::Read),
        Binding::new("object_layer", BindingKind::Floats),
        Binding::new("ratios", BindingKind::Uints),
        Binding::new("radiance", BindingKind::Write),
    ],
    structs: &[CompositeParams::LAYOUT],
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
        let built = Built::new(context, &KERNEL)?;
        let pipeline = built.compute(context, "composite")?;
        Ok(Self {
            built,
            pipeline,
            params: GrowingBuffer::uniform("composite params"),
            background: GrowingBuffer::storage("background"),
            group: BoundGroup::default(),
        })
    }
}

impl DevicePass for Composite {
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, .. } = frame;
        let context = recorder.context;
        let background = &job.input.background.radiance;
        let (width, height) = (background.width() as u32, background.height() as u32);
        let [x, y] = exchange.object_origin;
        let has = |product| u32::from(exchange.has(product));
        let params = CompositeParams {
            size_origin: [width, height, x, y],
            layer_scale: 1.0 / job.exposure_of_white(),
            present: has(Product::ObjectLayer) | has(Product::Ratios) << 1,
            unused: [0; 2],
        };
        let bytes = bytemuck::cast_slice(background.pixels());
        let resources = [
            self.params.write(context, bytemuck::bytes_of(&params)),
            self.background.write(context, bytes),
            exchange.object_layer.bind(context),
            exchange.ratios.bind(context),
            exchange.radiance.bind(context, bytes.len()),
        ];
        let group = self.group.of(context, &self.built, &resources);
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(width.div_ceil(TILE), height.div_ceil(TILE), 1);
        })
    }
}
