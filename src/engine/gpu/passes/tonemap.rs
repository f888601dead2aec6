//! `compose/tonemap` on the device. Twin: `compose::tonemap`.

use crate::{
    EngineError,
    compose::tonemap::{CELLS, ToneTable},
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        kernel::{BoundGroup, Built, Resource},
        kernels,
        params::TonemapParams,
        recorder::Recorder,
        textures::KeptTexture,
    },
    model::response::Response,
    plan::Pass,
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
    display: GrowingBuffer,
    group: BoundGroup,
    table: Option<ToneTable>,
}

impl Tonemap {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::TONEMAP)?;
        let pipeline = built.compute(context, "tonemap")?;
        Ok(Self {
            built,
            pipeline,
            params: GrowingBuffer::uniform("tonemap params"),
            thresholds: KeptTexture::uploaded("thresholds", wgpu::TextureFormat::R32Float),
            starts: KeptTexture::uploaded("starts of values", wgpu::TextureFormat::R32Uint),
            display: GrowingBuffer::storage("display"),
            group: BoundGroup::default(),
            table: None,
        })
    }

    /// Encodes `pixels` pixels of radiance.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        radiance: Resource,
        pixels: usize,
        response: &Response,
        exposure_s: f32,
    ) -> Result<(), EngineError> {
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
            radiance,
            self.display.bind(context, 12 * quads as usize),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let groups = quads.div_ceil(LANES);
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(groups.min(ROW_GROUPS), groups.div_ceil(ROW_GROUPS), 1);
        })
    }

    /// The 8-bit picture: three bytes a pixel.
    pub fn display(&mut self, context: &GpuContext) -> wgpu::Buffer {
        self.display.at_least(context, 0).clone()
    }
}
