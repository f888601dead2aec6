//! One frame on the device: exactly the plan's passes, each on the device or on its twin.

use super::{
    buffers::{Readback, whole_words},
    context::GpuContext,
    device_scene::DeviceScene,
    exchange::{Exchange, Holder},
    passes::{self, DeviceFrame, DevicePass},
    point_pages::MapSpread,
    recorder::{Gpu, GpuRecorder, SentWork},
};
use crate::{
    EngineError, NearChoice, RelightInput, door,
    frame::{FrameJob, FrameState, TwinPasses, check_frame},
    model::{image::Image, picture::Picture, quality::Quality, scene::Scene},
    nearfield::prepare::KnownRoom,
    plan::{Foresight, FramePlan, Pass, PassSet, Product},
};
use std::sync::Arc;

/// The kernel in a slot, compiled on first use.
pub fn ready<'a, K>(
    slot: &'a mut Option<K>,
    context: &GpuContext,
    new: impl FnOnce(&GpuContext) -> Result<K, EngineError>,
) -> Result<&'a mut K, EngineError> {
    match slot {
        Some(kernel) => Ok(kernel),
        None => Ok(slot.insert(new(context)?)),
    }
}

/// Scene, kernels and memory of drawing; everything is reused from frame to frame.
pub struct Relighter {
    state: FrameState,
    scene: DeviceScene,
    exchange: Exchange,
    kernels: Kernels,
    /// How near lights' maps are spread over passes.
    pub spread: MapSpread,
    /// Whether linear radiance is read back.
    pub wants_linear: bool,
    staging: Staging,
}

/// The passes of a frame: on the device, compiled when they are first called for, and on their twins.
struct Kernels {
    on_device: [Option<Box<dyn DevicePass>>; Pass::ALL.len()],
    twins: Box<dyn TwinPasses>,
}

/// Where results are copied to on their way to the host.
struct Staging {
    display: Readback,
    radiance: Readback,
    stamps: Readback,
}

/// A frame that the device works on.
struct FrameInFlight {
    work: SentWork,
    size: (usize, usize),
    reads_display: bool,
    reads_radiance: bool,
}

impl Staging {
    const fn new() -> Self {
        Self {
            display: Readback::new("display"),
            radiance: Readback::new("composed radiance"),
            stamps: Readback::new("pass times"),
        }
    }

    /// Records the copies of what is read back, and sends all that was recorded.
    fn send(
        &mut self,
        mut recorder: GpuRecorder<'_>,
        job: &FrameJob<'_>,
        exchange: &mut Exchange,
        wants_linear: bool,
        out: &mut Picture,
    ) -> FrameInFlight {
        let (context, size) = (recorder.context, job.size());
        let composed = exchange.holder(Product::Radiance) == Holder::Device;
        let reads_radiance = composed && wants_linear;
        if reads_radiance {
            context.live.serve(Pass::Composite);
            exchange.copy_radiance(&mut recorder, &mut self.radiance, size);
        } else if composed {
            out.radiance = Image::default();
        }
        let reads_display = exchange.holder(Product::Display) == Holder::Device;
        let display_bytes = 3 * size.0 * size.1;
        if reads_display {
            context.live.serve(Pass::Tonemap);
            let target = self.display.at_least(context, display_bytes).clone();
            let display = exchange.display.at_least(context, display_bytes);
            recorder.copy(display, &target, 0, whole_words(display_bytes));
        }
        context.live.serve_all();
        let work = recorder.send(&mut self.stamps);
        if reads_radiance {
            self.radiance.request(context, 4 * display_bytes);
        }
        if reads_display {
            self.display.request(context, display_bytes);
        }
        FrameInFlight { work, size, reads_display, reads_radiance }
    }
}

impl Relighter {
    /// An empty scene; nothing is compiled.
    pub fn new() -> Self {
        Self {
            state: FrameState::default(),
            scene: DeviceScene::new(),
            exchange: Exchange::new(),
            kernels: Kernels { on_device: [const { None }; Pass::ALL.len()], twins: door::twins() },
            spread: MapSpread::default(),
            wants_linear: false,
            staging: Staging::new(),
        }
    }

    /// Takes the scene; it goes to the device with the next frame.
    pub fn load(&mut self, scene: &Scene) -> Result<(), EngineError> {
        self.state.load(scene)?;
        self.scene.invalidate();
        Ok(())
    }

    /// Takes a known room, or none, for the scenes to come.
    pub fn take_room(&mut self, room: Option<Arc<KnownRoom>>) {
        self.state.room.take(room);
    }

    /// Which results would come out the same.
    pub fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
        time: &mut dyn FnMut(Pass, &mut (dyn FnMut() + Send)),
    ) {
        self.state.foresee(&FrameJob::looked_at(quality, input), out, time);
    }

    /// The near lights of the last frame.
    pub fn near_choice(&self) -> Option<NearChoice> {
        self.state.near_choice()
    }

    /// The passes of the last frame.
    pub fn dispatched(&self) -> &[Pass] {
        self.state.held.dispatched()
    }

    /// Draws one frame and waits for it; `on_host` says which passes run on their twins.
    pub fn relight(
        &mut self,
        gpu: &mut Gpu,
        on_host: PassSet,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        let in_flight = self.begin(gpu, on_host, plan, input, out)?;
        self.collect(gpu, in_flight, out)
    }

    /// Sends one frame to the device. A frame that fails leaves nothing to be kept.
    fn begin(
        &mut self,
        gpu: &mut Gpu,
        on_host: PassSet,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<FrameInFlight, EngineError> {
        let begun = self.draw(gpu, on_host, plan, input, out);
        if begun.is_err() {
            Pass::ALL.into_iter().for_each(|pass| self.state.held.forget(pass));
        }
        begun
    }

    fn draw(
        &mut self,
        gpu: &mut Gpu,
        on_host: PassSet,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<FrameInFlight, EngineError> {
        check_frame(&plan.quality, input)?;
        let job = FrameJob::planned(plan, input);
        let Self { state, scene, exchange, kernels, staging, wants_linear, .. } = self;
        state.begin(plan, &job);
        kernels.twins.begin(job.uses);
        state.held.take_moved(|vertices| scene.meshes.note_moved(vertices));
        let kept = state.kept(plan, job.uses);
        let runs = PassSet::where_true(|pass| job.uses.has(pass) && !pass.is_measuring() && !kept.has(pass));
        let context = &gpu.context;
        context.live.free_all_but(job.uses);
        exchange.begin(kept);
        out.t = input.t;
        let recorder = GpuRecorder::new(context, &mut gpu.timer);
        let mut frame = DeviceFrame { recorder, job: &job, state, scene, spread: self.spread };
        if runs.has(Pass::ShadeObject) && !on_host.has(Pass::ShadeObject) {
            light_objects(&mut frame, exchange);
        }
        if runs.iter().any(|pass| pass.draws_scene() && !on_host.has(pass)) {
            frame.scene.update(context, &job, frame.state);
        }
        for pass in runs.iter() {
            kernels.run(pass, on_host.has(pass), &mut frame, exchange, out)?;
        }
        Ok(staging.send(frame.recorder, &job, exchange, *wants_linear, out))
    }

    /// Waits for a frame and reads what is asked for of it.
    fn collect(&mut self, gpu: &mut Gpu, frame: FrameInFlight, out: &mut Picture) -> Result<(), EngineError> {
        let from = &mut self.staging;
        let (width, height) = frame.size;
        gpu.context.wait_for(Pass::Composite.name(), Some(&frame.work.index))?;
        gpu.timer.collect(&gpu.context, frame.work, &mut from.stamps)?;
        if frame.reads_radiance {
            out.radiance.reshape(width, height, [0.0; 3]);
            let target: &mut [u8] = bytemuck::cast_slice_mut(out.radiance.pixels_mut());
            from.radiance
                .take(Pass::Composite.name(), target.len(), |bytes| target.copy_from_slice(bytes))?;
        }
        if frame.reads_display {
            out.display.reshape(width, height, [0; 3]);
            let target: &mut [u8] = bytemuck::cast_slice_mut(out.display.pixels_mut());
            from.display.take(Pass::Tonemap.name(), target.len(), |bytes| target.copy_from_slice(bytes))?;
        }
        Ok(())
    }
}

/// Lights the vertices of objects, on the host: in a known room through the maps of its lights, which are drawn here for that.
fn light_objects(frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) {
    let DeviceFrame { recorder, job, state, scene, .. } = frame;
    if job.uses.has(Pass::PointMaps) && !exchange.is_on_host(Product::PointMaps) {
        recorder.host(Pass::PointMaps, || state.draw_point_maps(job));
        exchange.made_on_host(Product::PointMaps);
    }
    state.light_vertices(job);
    for vertices in state.transferred.changed() {
        scene.meshes.note_moved(vertices);
    }
}

impl Kernels {
    /// Runs one pass: on the device, or on its twin where that is asked for or the device cannot hold it.
    fn run(
        &mut self,
        pass: Pass,
        on_host: bool,
        frame: &mut DeviceFrame<'_>,
        exchange: &mut Exchange,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        let (context, facts) = (frame.recorder.context, pass.facts());
        frame.state.held.mark_made(pass, frame.job.uses);
        context.live.serve(pass);
        if !on_host {
            let kernel =
                ready(&mut self.on_device[pass as usize], context, |context| passes::compile(pass, context))?;
            if kernel.prepare(frame, exchange) {
                for product in facts.reads {
                    bring_to_device(*product, frame, exchange, out);
                }
                context.live.serve(pass);
                if pass.draws_scene() {
                    frame.scene.update_shadow_cameras(context, frame.job, frame.state);
                }
                kernel.run(frame, exchange)?;
                exchange.made_on_device(facts.writes);
                return Ok(());
            }
        }
        let DeviceFrame { recorder, job, state, .. } = frame;
        for product in facts.reads {
            exchange.bring_to_host(*product, recorder, job, state, out)?;
        }
        // The maps of near lights may have been drawn for the vertices of objects.
        if !exchange.is_on_host(facts.writes) {
            recorder.host(pass, || self.twins.run(pass, job, state, out));
            exchange.made_on_host(facts.writes);
        }
        Ok(())
    }
}

/// Brings a product to the device; its memory there belongs to the pass that made it.
fn bring_to_device(product: Product, frame: &DeviceFrame<'_>, exchange: &mut Exchange, out: &Picture) {
    let (context, job) = (frame.recorder.context, frame.job);
    if let Some(maker) = job.uses.meet(product.makers()).iter().next() {
        context.live.serve(maker);
    }
    exchange.bring_to_device(product, context, job, frame.state, out);
}
