//! `nearfield/subtract_displayed` on the device: an 8-bit target, from which each light is subtracted by blending, in a pass of
//! its own. Twin: `nearfield::subtract_displayed`.

use super::{
    DeviceFrame, DevicePass,
    turns::{DeviceTurns, LightRound, TurnStages},
};
use crate::{
    EngineError,
    frame::FrameJob,
    gpu::{
        context::GpuContext,
        exchange::Exchange,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, Resource, source},
        params,
        room_lights::{self, LISTED_A_ROW, LISTED_TEXELS, ROWS, RoomLights, TAKEN},
        textures::KeptTexture,
    },
    nearfield::subtract_displayed::{DisplayCurve, DisplayedLights},
    plan::{Pass, Product},
};

/// `nearfield/subtract_displayed`: what the display shows of the room, one light after the other subtracted from it, and what
/// is left as a ratio; with the functions of `nearfield/subtract`, whose own fragment stages are not used.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::SubtractDisplayed,
    sources: &[
        source!("shared/lens"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/point_camera"),
        source!("shared/point_lookup"),
        source!("nearfield/subtract"),
        source!("nearfield/subtract_displayed"),
    ],
    entries: &[
        "vertex",
        "fragment",
        "depth_alone",
        "nearest_room",
        "one_light",
        "after_all",
        "shown_room",
        "one_displayed",
        "after_displayed",
    ],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("cameras_near", BindingKind::Uniform),
        Binding::new("lights", BindingKind::Uniform),
        Binding::new("point_maps", BindingKind::UintLayers),
        Binding::new("ranges", BindingKind::Uints),
        Binding::new("listed", BindingKind::Floats),
        Binding::new("suns", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("room_cameras", BindingKind::Uniform),
        Binding::new("room_maps", BindingKind::UintLayers),
        Binding::new("turn", BindingKind::UniformAtOffset),
        Binding::new("taken", BindingKind::Floats),
        Binding::new("before", BindingKind::Floats),
        Binding::new("exposures", BindingKind::Floats),
        Binding::new("display", BindingKind::Floats),
    ],
    structs: &[
        params::View::LAYOUT,
        params::PointCamera::LAYOUT,
        params::PointCameras::LAYOUT,
        params::PointLights::LAYOUT,
        params::SunTerms::LAYOUT,
        params::Turn::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
    ],
};

const PASS: Pass = Pass::SubtractDisplayed;
const STAGES: TurnStages = TurnStages {
    first: "shown_room",
    writes_first: true,
    one: "one_displayed",
    operation: wgpu::BlendOperation::ReverseSubtract,
    after: "after_displayed",
    format: wgpu::TextureFormat::Rgba8Unorm,
};

/// The kernel.
pub struct SubtractDisplayed {
    built: Built,
    turns: DeviceTurns,
    group: BoundGroup,
    before: KeptTexture,
    exposures: KeptTexture,
    display: KeptTexture,
    texels: Vec<[f32; 4]>,
    /// The lights in their sets.
    lights: DisplayedLights,
    curve: Option<DisplayCurve>,
}

impl SubtractDisplayed {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let turns = DeviceTurns::new(context, &built, PASS, &STAGES)?;
        Ok(Self {
            built,
            turns,
            group: BoundGroup::default(),
            before: KeptTexture::uploaded("lights before", wgpu::TextureFormat::Rgba32Float),
            exposures: KeptTexture::uploaded("exposures", wgpu::TextureFormat::Rgba32Float),
            display: KeptTexture::uploaded("display curve", wgpu::TextureFormat::R32Float),
            texels: Vec::new(),
            lights: DisplayedLights::default(),
            curve: None,
        })
    }

    /// Uploads what a frame adds to the resources of `nearfield/subtract`, in the order of the kernel's bindings.
    fn upload(&mut self, frame: &DeviceFrame<'_>) -> [Resource; 3] {
        let (context, room) = (frame.recorder.context, &frame.state.room);
        let ((ranges, listed), (_, triangles)) = (room.frame.lists(), room.triangles());
        self.texels.clear();
        for ([begin, end], corners) in ranges.iter().zip(triangles) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                let light = usize::from(k);
                let set = if self.lights.is_second(light) { 1.0 } else { 0.0 };
                let before = corners.map(|v| self.lights.before(light, v));
                self.texels.extend(before.map(|[r, g, b]| [r, g, b, set]));
                self.texels.resize(self.texels.len().next_multiple_of(LISTED_TEXELS), [0.0; 4]);
            }
        }
        let rows = listed.len().div_ceil(LISTED_A_ROW).max(1).next_multiple_of(ROWS);
        self.texels.resize(rows * LISTED_A_ROW * LISTED_TEXELS, [0.0; 4]);
        let width = (LISTED_TEXELS * LISTED_A_ROW) as u32;
        self.before.upload(context, width, rows as u32, bytemuck::cast_slice(&self.texels));
        self.upload_exposures(context, frame.job);
        let curve = self.curve.get_or_insert_with(|| DisplayCurve::of(frame.job.input.response));
        self.display.upload(context, 256, 6, bytemuck::bytes_of(&curve.rows()));
        [self.before.bind(context), self.exposures.bind(context), self.display.bind(context)]
    }

    /// The camera's picture at the shown exposure.
    fn upload_exposures(&mut self, context: &GpuContext, job: &FrameJob<'_>) {
        let background = &job.input.background.radiance;
        let exposure_s = job.input.shown_exposure.effective_s() as f32;
        let exposures = background.pixels().iter().map(|rgb| rgb.map(|c| c * exposure_s));
        self.texels.clear();
        self.texels.extend(exposures.map(|[r, g, b]| [r, g, b, 0.0]));
        let (width, height) = (background.width() as u32, background.height() as u32);
        self.exposures.upload(context, width, height, bytemuck::cast_slice(&self.texels));
    }
}

impl DevicePass for SubtractDisplayed {
    /// Lists which lights matter where, and deals them out to their sets.
    fn prepare(&mut self, frame: &mut DeviceFrame<'_>, exchange: &Exchange) -> bool {
        let is_drawn = exchange.is_on_host(Product::PointMaps);
        let (lights, curve, response) = (&mut self.lights, &mut self.curve, frame.job.input.response);
        frame.recorder.host(PASS, || {
            frame.state.room.list(is_drawn);
            lights.update(&frame.state.room.frame);
            curve.get_or_insert_with(|| DisplayCurve::of(response)).update(response);
        });
        RoomLights::fit(frame.recorder.context, &frame.state.room.frame)
    }

    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let round = LightRound::of(frame);
        let mut resources = room_lights::resources(frame, exchange, round.lights)?;
        resources.extend(self.upload(frame));
        let context = frame.recorder.context;
        let group = self.group.of(context, &self.built, &resources);
        self.turns.draw(frame, &round, group)?;
        resources[TAKEN] = self.turns.taken(context);
        self.turns.draw_ratios(frame, exchange, &self.built, &resources)
    }
}
