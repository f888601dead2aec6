//! `light/unwrap_ball` on the device. Twin: `light::unwrap_ball`, which also makes the rays and the rest.

use crate::{
    EngineError,
    gpu::{
        buffers::{GrowingBuffer, Readback},
        context::GpuContext,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, source},
        params::UnwrapParams,
        recorder::{Gpu, GpuRecorder},
    },
    light::unwrap_ball::BallView,
    plan::Pass,
};

/// `light/unwrap_ball`: one invocation a pixel of the ball's region.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::UnwrapBall,
    sources: &[source!("light/unwrap_ball")],
    entries: &["unwrap"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("corner_rays", BindingKind::Read),
        Binding::new("cells", BindingKind::Write),
    ],
    structs: &[UnwrapParams::LAYOUT],
};

const PASS: Pass = Pass::UnwrapBall;
/// Side of a workgroup.
const TILE: u32 = 8;

/// The kernel with its buffers.
pub struct UnwrapBall {
    built: Built,
    pipeline: wgpu::ComputePipeline,
    params: GrowingBuffer,
    corner_rays: GrowingBuffer,
    cells: GrowingBuffer,
    group: BoundGroup,
    readback: Readback,
    stamps: Readback,
}

impl UnwrapBall {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let pipeline = built.compute(context, "unwrap")?;
        Ok(Self {
            built,
            pipeline,
            params: GrowingBuffer::uniform("unwrap params"),
            corner_rays: GrowingBuffer::storage("corner rays"),
            cells: GrowingBuffer::storage("cells"),
            group: BoundGroup::default(),
            readback: Readback::new("cells"),
            stamps: Readback::new("pass times"),
        })
    }

    /// Direction and solid angle of each pixel of the view's region, as from the twin's `trace`.
    pub fn run(
        &mut self,
        gpu: &mut Gpu,
        view: &BallView,
        above_horizon: bool,
        out: &mut Vec<[f32; 4]>,
    ) -> Result<(), EngineError> {
        let context = &gpu.context;
        let (width, height) = (view.width as u32, view.height as u32);
        let params = UnwrapParams {
            eye_from_centre: view.sphere.eye_from_centre,
            radius: view.sphere.radius,
            rim_squared: view.sphere.rim_squared,
            width,
            height,
            above_horizon: u32::from(above_horizon),
        };
        let bytes = view.width * view.height * size_of::<[f32; 4]>();
        let resources = [
            self.params.write(context, bytemuck::bytes_of(&params)),
            self.corner_rays.write(context, bytemuck::cast_slice(&view.corner_rays)),
            self.cells.bind(context, bytes),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let mut recorder = GpuRecorder::new(context, &mut gpu.timer);
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(width.div_ceil(TILE), height.div_ceil(TILE), 1);
        })?;
        let target = self.readback.at_least(context, bytes).clone();
        recorder.copy(self.cells.at_least(context, bytes), &target, 0, bytes as u64);
        let work = recorder.send(&mut self.stamps);
        gpu.finish(work, &mut self.stamps, PASS)?;
        out.resize(view.width * view.height, [0.0; 4]);
        self.readback.read(&gpu.context, PASS.name(), bytes, |bytes| {
            bytemuck::cast_slice_mut(out.as_mut_slice()).copy_from_slice(bytes);
        })
    }
}
