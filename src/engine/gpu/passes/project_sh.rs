//! `light/project_sh` on the device. Twin: `light::project_sh`.

use crate::{
    EngineError,
    gpu::{
        buffers::{GrowingBuffer, Readback},
        context::GpuContext,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, source},
        params::ProjectParams,
        recorder::{Gpu, GpuRecorder},
    },
    light::project_sh::LEAF_SAMPLES,
    math::sh::{MAX_COEFFICIENTS, MAX_ORDER},
    model::light::{RadianceSamples, RadianceSh},
    plan::Pass,
};

/// `light/project_sh`: partial sums of 256 samples each, then one workgroup for each coefficient.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::ProjectSh,
    sources: &[source!("shared/sh_basis"), source!("light/project_sh")],
    entries: &["partial_sums", "total"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("directions", BindingKind::Read),
        Binding::new("radiance", BindingKind::Read),
        Binding::new("partials", BindingKind::Write),
        Binding::new("coefficients", BindingKind::Write),
    ],
    structs: &[ProjectParams::LAYOUT],
};

const PASS: Pass = Pass::ProjectSh;
/// Samples of one workgroup: a leaf of the twin's tree.
const GROUP_SAMPLES: usize = LEAF_SAMPLES;
/// Invocations of a workgroup.
const LANES: usize = 64;
/// Samples that are on the device at a time: 32 MiB.
const PART_SAMPLES: usize = 1 << 20;
const ROW_BYTES: usize = MAX_COEFFICIENTS * 16;

/// The kernel with its buffers.
pub struct ProjectSh {
    built: Built,
    partial_sums: wgpu::ComputePipeline,
    total: wgpu::ComputePipeline,
    params: GrowingBuffer,
    directions: GrowingBuffer,
    radiance: GrowingBuffer,
    partials: GrowingBuffer,
    coefficients: GrowingBuffer,
    group: BoundGroup,
    readback: Readback,
    stamps: Readback,
}

impl ProjectSh {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let (partial_sums, total) =
            (built.compute(context, "partial_sums")?, built.compute(context, "total")?);
        Ok(Self {
            built,
            partial_sums,
            total,
            params: GrowingBuffer::uniform("projection params"),
            directions: GrowingBuffer::storage("sample directions"),
            radiance: GrowingBuffer::storage("sample radiance"),
            partials: GrowingBuffer::storage("partial sums"),
            coefficients: GrowingBuffer::storage("coefficients"),
            group: BoundGroup::default(),
            readback: Readback::new("coefficients"),
            stamps: Readback::new("pass times"),
        })
    }

    /// Projects; the order is taken into 1..=6.
    pub fn run(
        &mut self,
        gpu: &mut Gpu,
        samples: &RadianceSamples,
        order: usize,
    ) -> Result<RadianceSh, EngineError> {
        let context = &gpu.context;
        let order = order.clamp(1, MAX_ORDER);
        let count = samples.directions.len().min(samples.radiance.len());
        let partials = count.div_ceil(GROUP_SAMPLES);
        let bytes = MAX_COEFFICIENTS * 16;
        // All parts use the same buffers, made for the largest.
        let part_bytes = count.min(PART_SAMPLES) * 16;
        let resources = [
            self.params.bind(context, size_of::<ProjectParams>()),
            self.directions.bind(context, part_bytes),
            self.radiance.bind(context, part_bytes),
            self.partials.bind(context, partials * ROW_BYTES),
            self.coefficients.bind(context, bytes),
        ];
        let group = self.group.of(context, &self.built, &resources);

        let mut recorder = GpuRecorder::new(context, &mut gpu.timer);
        for start in (0..count).step_by(PART_SAMPLES) {
            let part = start..(start + PART_SAMPLES).min(count);
            let params = ProjectParams {
                samples: part.len() as u32,
                order: order as u32,
                first_partial: (start / GROUP_SAMPLES) as u32,
                partials: partials as u32,
                rounds: (GROUP_SAMPLES / LANES) as u32,
                groups: (LANES / 4) as u32,
                unused: [0; 2],
            };
            // An upload comes before everything that is submitted later, so parts are submitted one by one.
            recorder.submit();
            self.params.write(context, bytemuck::bytes_of(&params));
            self.directions.write(context, bytemuck::cast_slice(&samples.directions[part.clone()]));
            self.radiance.write(context, bytemuck::cast_slice(&samples.radiance[part.clone()]));
            recorder.compute(PASS, |pass| {
                pass.set_bind_group(0, group, &[]);
                pass.set_pipeline(&self.partial_sums);
                pass.dispatch_workgroups(part.len().div_ceil(GROUP_SAMPLES) as u32, 1, 1);
                if part.end == count {
                    pass.set_pipeline(&self.total);
                    pass.dispatch_workgroups((order * order) as u32, 1, 1);
                }
            })?;
        }
        let mut sh = RadianceSh::zero(order);
        if count == 0 {
            return Ok(sh);
        }
        let target = self.readback.at_least(context, bytes).clone();
        recorder.copy(self.coefficients.at_least(context, 0), &target, 0, bytes as u64);
        let work = recorder.send(&mut self.stamps);
        gpu.finish(work, &mut self.stamps, PASS)?;
        self.readback.read(&gpu.context, PASS.name(), bytes, |bytes| {
            let rows = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(bytes);
            for (row, sum) in sh.rgb.iter_mut().zip(rows).take(order * order) {
                *row = [sum[0], sum[1], sum[2]];
            }
        })?;
        Ok(sh)
    }
}
