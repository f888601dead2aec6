//! Records passes and times each: not at all, by timestamp queries at the ends of passes where the device has them, or,
//! where it has none and the caller insists, by fenced wall time (each pass submitted and awaited on its own).

use std::time::Instant;

use super::{buffers::Readback, context::GpuContext};
use crate::{
    EngineError, Timings,
    plan::{Pass, PassTiming},
};

/// Device passes of one frame that can be timed (shadow maps take one each).
const SPANS: u32 = 128;
const STAMP_BYTES: u64 = 8;

/// A device, and how long passes took on it.
pub struct Gpu {
    /// The device.
    pub context: GpuContext,
    /// The times.
    pub timer: Timer,
}

struct TimestampQueries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
}

/// Measures passes over the life of an engine.
pub struct Timer {
    timings: Timings,
    /// Where the device has them, and they are wanted.
    queries: Option<TimestampQueries>,
    spans: Vec<Pass>,
    done: Vec<PassTiming>,
}

impl Timer {
    /// Times as asked for, as far as the device can.
    pub fn new(context: &GpuContext, timings: Timings) -> Self {
        let is_wanted = timings != Timings::Off && context.has_timestamps();
        let queries = is_wanted.then(|| TimestampQueries {
            set: context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * SPANS,
            }),
            resolved: context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("pass times"),
                size: 2 * u64::from(SPANS) * STAMP_BYTES,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
        });
        Self { timings, queries, spans: Vec::new(), done: Vec::new() }
    }

    /// Adds the time of work that is done.
    pub fn add(&mut self, pass: Pass, ms: f32) {
        match self.done.last_mut() {
            Some(last) if last.pass == pass => last.ms += ms,
            _ => self.done.push(PassTiming { pass, ms }),
        }
    }

    /// Runs a pass on the host and adds its time.
    pub fn host<R>(&mut self, pass: Pass, work: impl FnOnce() -> R) -> R {
        if self.timings == Timings::Off {
            return work();
        }
        let start = now();
        let result = work();
        self.add(pass, milliseconds_since(start));
        result
    }

    /// Moves all times so far to `out`, in order.
    pub fn take(&mut self, out: &mut Vec<PassTiming>) {
        out.append(&mut self.done);
    }

    /// Whether each pass is awaited to be timed.
    fn fences(&self) -> bool {
        self.timings == Timings::Fenced && self.queries.is_none()
    }

    /// The next span's place in the query set, while there is one.
    fn span(&mut self, pass: Pass) -> Option<(&wgpu::QuerySet, u32)> {
        let first = 2 * self.spans.len() as u32;
        let queries = self.queries.as_ref().filter(|_| self.spans.len() < SPANS as usize)?;
        self.spans.push(pass);
        Some((&queries.set, first))
    }

    /// Books the times of work that is done, in the order of the passes.
    pub fn collect(
        &mut self,
        context: &GpuContext,
        work: SentWork,
        stamps: &mut Readback,
    ) -> Result<(), EngineError> {
        if !work.spans.is_empty() && self.queries.is_some() {
            let ns = f64::from(context.queue.get_timestamp_period());
            let bytes = 2 * work.spans.len() * STAMP_BYTES as usize;
            let stamps: Vec<u64> = stamps.take("pass times", bytes, bytemuck::pod_collect_to_vec)?;
            for (pass, pair) in work.spans.iter().zip(stamps.chunks_exact(2)) {
                self.add(*pass, (pair[1].saturating_sub(pair[0]) as f64 * ns * 1e-6) as f32);
            }
        }
        // Times may have been taken away since, or those of another frame may stand between.
        if let Some(of_frame) = self.done.get_mut(work.booked..) {
            of_frame.sort_by_key(|timing| timing.pass);
        }
        let mut spans = work.spans;
        spans.clear();
        if self.spans.capacity() < spans.capacity() && self.spans.is_empty() {
            self.spans = spans;
        }
        Ok(())
    }
}

/// Work that was sent to the device.
pub struct SentWork {
    /// For [`GpuContext::wait_for`].
    pub index: wgpu::SubmissionIndex,
    spans: Vec<Pass>,
    /// Times booked before.
    booked: usize,
}

/// One batch of work for the device.
pub struct GpuRecorder<'a> {
    /// Where it runs.
    pub context: &'a GpuContext,
    timer: &'a mut Timer,
    encoder: wgpu::CommandEncoder,
    /// Times booked before this batch.
    booked: usize,
}

/// What a draw pass draws to.
pub struct Targets<'a> {
    /// Colour.
    pub color: Option<wgpu::RenderPassColorAttachment<'a>>,
    /// Depth, cleared to the given value and not kept.
    pub depth: Option<(&'a wgpu::TextureView, f32)>,
}

impl<'a> GpuRecorder<'a> {
    /// Starts a batch.
    pub fn new(context: &'a GpuContext, timer: &'a mut Timer) -> Self {
        let booked = timer.done.len();
        timer.spans.clear();
        Self { context, encoder: encoder(context), timer, booked }
    }

    /// Records compute work of a pass.
    pub fn compute(
        &mut self,
        pass: Pass,
        work: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) -> Result<(), EngineError> {
        let start = self.fence(pass)?;
        {
            let stamps = self.timer.span(pass);
            let timestamp_writes = stamps.map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let descriptor = wgpu::ComputePassDescriptor { label: Some(pass.name()), timestamp_writes };
            work(&mut self.encoder.begin_compute_pass(&descriptor));
        }
        self.fenced(pass, start)
    }

    /// Records drawing of a pass.
    pub fn draw(
        &mut self,
        pass: Pass,
        targets: Targets<'_>,
        work: impl FnOnce(&mut wgpu::RenderPass<'_>),
    ) -> Result<(), EngineError> {
        let start = self.fence(pass)?;
        {
            let stamps = self.timer.span(pass);
            let timestamp_writes = stamps.map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let depth_stencil_attachment =
                targets.depth.map(|(view, clear)| wgpu::RenderPassDepthStencilAttachment {
                    view,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(clear),
                        store: wgpu::StoreOp::Discard,
                    }),
                    stencil_ops: None,
                });
            work(&mut self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(pass.name()),
                color_attachments: &[targets.color],
                depth_stencil_attachment,
                timestamp_writes,
                occlusion_query_set: None,
                multiview_mask: None,
            }));
        }
        self.fenced(pass, start)
    }

    /// Runs a pass on the host, now, and books its time.
    pub fn host<R>(&mut self, pass: Pass, work: impl FnOnce() -> R) -> R {
        self.timer.host(pass, work)
    }

    /// Records a copy between buffers (untimed).
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, to_offset: u64, bytes: u64) {
        self.encoder.copy_buffer_to_buffer(from, 0, to, to_offset, bytes);
    }

    /// Sends what is recorded so far; uploads that follow come after it.
    pub fn submit(&mut self) {
        let encoder = std::mem::replace(&mut self.encoder, encoder(self.context));
        self.context.queue.submit([encoder.finish()]);
    }

    /// Sends everything; `stamps` takes the times of passes on their way to the host.
    pub fn send(mut self, stamps: &mut Readback) -> SentWork {
        let spans = std::mem::take(&mut self.timer.spans);
        let bytes = 2 * spans.len() as u64 * STAMP_BYTES;
        let queries = self.timer.queries.as_ref().filter(|_| !spans.is_empty());
        if let Some(queries) = queries {
            let count = 2 * spans.len() as u32;
            self.encoder.resolve_query_set(&queries.set, 0..count, &queries.resolved, 0);
            let target = stamps.at_least(self.context, bytes as usize);
            self.encoder.copy_buffer_to_buffer(&queries.resolved, 0, target, 0, bytes);
        }
        let index = self.context.queue.submit([self.encoder.finish()]);
        if queries.is_some() {
            stamps.request(self.context, bytes as usize);
        }
        SentWork { index, spans, booked: self.booked }
    }

    /// Where passes are fenced: waits for all earlier work, and gives the time.
    fn fence(&mut self, pass: Pass) -> Result<Option<Instant>, EngineError> {
        if !self.timer.fences() {
            return Ok(None);
        }
        self.submit();
        self.context.wait(pass.name())?;
        Ok(Some(now()))
    }

    fn fenced(&mut self, pass: Pass, start: Option<Instant>) -> Result<(), EngineError> {
        let Some(start) = start else { return Ok(()) };
        self.submit();
        self.context.wait(pass.name())?;
        self.timer.add(pass, milliseconds_since(start));
        Ok(())
    }
}

impl Gpu {
    /// Opens the times of a device.
    pub fn new(context: GpuContext, timings: Timings) -> Self {
        let timer = Timer::new(&context, timings);
        Self { context, timer }
    }

    /// Waits for a batch of its own, and books its times.
    pub fn finish(&mut self, work: SentWork, stamps: &mut Readback, pass: Pass) -> Result<(), EngineError> {
        self.context.wait_for(pass.name(), Some(&work.index))?;
        self.timer.collect(&self.context, work, stamps)
    }
}

/// A colour target that starts as one value; `resolved` takes the mean of its samples.
pub fn cleared<'a>(
    view: &'a wgpu::TextureView,
    resolved: Option<&'a wgpu::TextureView>,
    value: wgpu::Color,
) -> Option<wgpu::RenderPassColorAttachment<'a>> {
    let store = if resolved.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: resolved,
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(value), store },
    })
}

fn encoder(context: &GpuContext) -> wgpu::CommandEncoder {
    context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") })
}

#[allow(clippy::disallowed_methods, reason = "measures how long a pass took; no result depends on it")]
fn now() -> Instant {
    Instant::now()
}

fn milliseconds_since(start: Instant) -> f32 {
    (now() - start).as_secs_f32() * 1e3
}
