//! `nearfield/subtract` on the device. Twin: `nearfield::subtract`.

use super::{
    DeviceFrame, DevicePass,
    turns::{DeviceTurns, LightRound, TurnStages, drawing},
};
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{Exchange, RATIOS_FORMAT, untouched},
        kernel::{Binding, BindingKind, BoundGroup, Built, Drawing, KernelRow, source},
        params,
        point_pages::MapSpread,
        recorder::{Targets, cleared},
        room_lights::{self, RoomLights, TAKEN, TAKEN_FORMAT},
    },
    plan::{Pass, Product},
};

/// `nearfield/subtract`: the nearest triangle of the room at each pixel's centre, as a ratio. `fragment` loops over its
/// lights; the others draw one light after the other, as in [Gib03].
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::Subtract,
    sources: &[
        source!("shared/lens"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/point_camera"),
        source!("shared/point_lookup"),
        source!("nearfield/subtract"),
    ],
    entries: &["vertex", "fragment", "depth_alone", "nearest_room", "one_light", "after_all"],
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

const PASS: Pass = Pass::Subtract;
const STAGES: TurnStages = TurnStages {
    first: "nearest_room",
    writes_first: false,
    one: "one_light",
    operation: wgpu::BlendOperation::Add,
    after: "after_all",
    format: TAKEN_FORMAT,
};

/// All lights at what is nearest, made for suns or none, and for maps with a filter or none.
fn lit(
    context: &GpuContext,
    built: &Built,
    has_suns: bool,
    is_hard: bool,
) -> Result<wgpu::RenderPipeline, EngineError> {
    let constants = [("HAS_SUNS", f64::from(u8::from(has_suns))), ("IS_HARD", f64::from(u8::from(is_hard)))];
    let nearer = wgpu::CompareFunction::Equal;
    built.drawing(context, &Drawing { nearer, constants: &constants, ..drawing("fragment", RATIOS_FORMAT) })
}

/// The kernel.
pub struct Subtract {
    built: Built,
    /// Depth alone.
    nearest: wgpu::RenderPipeline,
    /// All lights at what is nearest: without suns and with them, with a filter and without.
    pipelines: [Option<wgpu::RenderPipeline>; 4],
    /// What is drawn with all lights, as corners of the room's mesh.
    chosen: GrowingBuffer,
    indices: Vec<[u32; 3]>,
    turns: Option<DeviceTurns>,
    group: BoundGroup,
}

impl Subtract {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let depth = drawing("depth_alone", RATIOS_FORMAT);
        let nearest = built.drawing(context, &Drawing { write: wgpu::ColorWrites::empty(), ..depth })?;
        Ok(Self {
            built,
            nearest,
            pipelines: [const { None }; 4],
            chosen: GrowingBuffer::new("triangles with lights", wgpu::BufferUsages::INDEX),
            indices: Vec::new(),
            turns: None,
            group: BoundGroup::default(),
        })
    }

    /// All lights in one pass: each pixel is shaded once, and only where some light may be taken.
    fn together(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let resources = room_lights::resources(frame, exchange, 0)?;
        let DeviceFrame { recorder, job, state, scene, .. } = frame;
        let (context, room, lens) = (recorder.context, &state.room, job.input.lens);
        let group = self.group.of(context, &self.built, &resources);
        let sun_is_hidden = room.frame.sun_maps().iter().any(Option::is_some);
        self.indices.clear();
        let is_chosen = |t: usize| sun_is_hidden || !room.frame.listed(t).is_empty();
        scene.room_mesh.parts_of(is_chosen, &mut self.indices);
        let corners = 3 * self.indices.len() as u32;
        if corners > 0 {
            self.chosen.write(context, bytemuck::cast_slice(&self.indices));
        }
        let chosen = self.chosen.at_least(context, 0);
        let (has_suns, is_hard) = (!room.suns.is_empty(), exchange.point_maps.places() <= 1);
        let lit = match &mut self.pipelines[usize::from(has_suns) + 2 * usize::from(is_hard)] {
            Some(pipeline) => pipeline,
            slot => slot.insert(lit(context, &self.built, has_suns, is_hard)?),
        };
        let nearest = &self.nearest;
        let depth = scene.room_lights.depth(context, (lens.width, lens.height));
        let ratios = exchange.ratios.sized(context, lens.width, lens.height, 1);
        let targets = Targets { color: cleared(ratios, None, untouched()), depth: Some((&depth, 0.0)) };
        let mesh = &mut scene.room_mesh;
        recorder.draw(PASS, targets, |pass| {
            if corners > 0 {
                pass.set_bind_group(0, group, &[0]);
                pass.set_pipeline(nearest);
                mesh.draw(context, pass);
                pass.set_pipeline(lit);
                mesh.draw_parts(context, pass, chosen, 0..corners);
            }
        })
    }

    /// A pass for each light, as in [Gib03].
    fn each(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let round = LightRound::of(frame);
        let mut resources = room_lights::resources(frame, exchange, round.lights)?;
        let context = frame.recorder.context;
        let group = self.group.of(context, &self.built, &resources);
        let turns = match &mut self.turns {
            Some(turns) => turns,
            slot => slot.insert(DeviceTurns::new(context, &self.built, PASS, &STAGES)?),
        };
        turns.draw(frame, &round, group)?;
        resources[TAKEN] = turns.taken(context);
        turns.draw_ratios(frame, exchange, &self.built, &resources)
    }
}

impl DevicePass for Subtract {
    /// Lists which lights matter where; the lists have to fit the device's textures.
    fn prepare(&mut self, frame: &mut DeviceFrame<'_>, exchange: &Exchange) -> bool {
        let is_drawn = exchange.is_on_host(Product::PointMaps);
        frame.recorder.host(PASS, || frame.state.room.list(is_drawn));
        RoomLights::fit(frame.recorder.context, &frame.state.room.frame)
    }

    /// Draws the room; the ratios get the lens' size.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        match frame.spread {
            MapSpread::Together => self.together(frame, exchange),
            MapSpread::Each => self.each(frame, exchange),
        }
    }
}
