//! `compose/tonemap` on the device. Twin: `compose::tonemap`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    compose::tonemap::{CELLS, ToneTable},
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::Exchange,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, source},
        params::TonemapParams,
        textures::KeptTexture,
    },
    plan::{Pass, Product},
};

/// `compose/tonemap`: one invocation for four pixels.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::Tonemap,
    sources: &[source!("compose/tonemap")],
    entries: &["tonemap"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("thresholds", BindingKind::Floats),
        Binding::new("starts", BindingKind::Uints),
        Binding::new("radiance", BindingKind::Read),
        Binding::new("display", BindingKind::Write),
    ],
    structs: &[TonemapParams::LAYOUT],
};

const PASS: Pass = Pass::Tonemap;
/// Invocations of a workgroup; each makes four pixels.
const LANES: u32 = 64;
/// Workgroups in one row of a dispatch.
const ROW_GROUPS: u32 = 1024;
/// Cells in a row of `starts`.
const CELLS_A_ROW: u32 = 256;

/// The kernel with its buffers.
pub struct Tonemap {
    built: Built,
    pipeline: wgpu::ComputePipeline,
    params: GrowingBuffer,
    thresholds: KeptTexture,
    starts: KeptTexture,
    group: BoundGroup,
    table: Option<ToneTable>,
}

impl Tonemap {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let pipeline = built.compute(context, "tonemap")?;
        Ok(Self {
            built,
            pipeline,
            params: GrowingBuffer::uniform("tonemap params"),
            thresholds: KeptTexture::uploaded("thresholds", wgpu::TextureFormat::R32Float),
            starts: KeptTexture::uploaded("starts of values", wgpu::TextureFormat::R32Uint),
            group: BoundGroup::default(),
            table: None,
        })
    }
}

impl DevicePass for Tonemap {
    /// A plan without a composed picture encodes what the caller's picture holds: that is on the host.
    fn prepare(&mut self, _frame: &mut DeviceFrame<'_>, exchange: &Exchange) -> bool {
        exchange.has(Product::Radiance)
    }

    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, .. } = frame;
        let (response, exposure_s) = (job.input.response, job.input.shown_exposure.effective_s() as f32);
        let pixels = job.size().0 * job.size().1;
        let context = recorder.context;
        let table = self.table.get_or_insert_with(|| ToneTable::of(response));
        if table.update(response) || !(self.thresholds.is_live() && self.starts.is_live()) {
            self.thresholds.upload(context, 256, 3, bytemuck::cast_slice(&table.thresholds));
            let rows = CELLS as u32 / CELLS_A_ROW;
            self.starts.upload(context, CELLS_A_ROW, rows, bytemuck::cast_slice(&table.starts));
        }
        let quads = pixels.div_ceil(4) as u32;
        let params =
            TonemapParams { quads, first_cell: table.first_cell, exposure_s, floats: 3 * pixels as u32 };
        let resources = [
            self.params.write(context, bytemuck::bytes_of(&params)),
            self.thresholds.bind(context),
            self.starts.bind(context),
            exchange.radiance.bind(context, 0),
            exchange.display.bind(context, 12 * quads as usize),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let groups = quads.div_ceil(LANES);
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(groups.min(ROW_GROUPS), groups.div_ceil(ROW_GROUPS), 1);
        })
    }
}
