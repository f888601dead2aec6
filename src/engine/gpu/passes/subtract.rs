//! `nearfield/subtract` on the device. Twin: `nearfield::subtract`.

pub use super::subtract_displayed::Shown;
use super::{
    subtract_displayed::Displayed,
    turns::{Round, Stages, TURN_STRIDE, Turns, drawing},
};
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{RATIOS_FORMAT, SHADOW_MAP_FORMAT},
        kernel::{BoundGroup, Built, Drawing, Resource},
        kernels, params,
        point_pages::{PointPages, Spread},
        recorder::{Recorder, Targets, cleared},
        room_mesh::RoomMesh,
        textures::{KeptLayers, KeptTexture},
        view,
    },
    nearfield::{frame::NearFrame, sun_shadows::SunShadows},
    plan::Pass,
};

const PASS: Pass = Pass::Subtract;
/// Triangles in a row of `ranges`.
const RANGES_A_ROW: usize = 1024;
/// Lights of triangles in a row of `listed`...
pub(super) const LISTED_A_ROW: usize = 512;
/// ...of so many texels each.
pub(super) const LISTED_TEXELS: usize = 4;
/// Rows of `listed` come and go so many at a time.
pub(super) const ROWS: usize = 16;

/// The turn of the suns.
const SUNS: u32 = 0xffff;
/// What is taken of the light, where each light has a pass of its own: shares of all light, each sum rounded to a 2048th of
/// itself, or cut off there.
const TAKEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Where it is bound.
const TAKEN: usize = 12;
const STAGES: Stages = Stages {
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

/// What the frame is drawn from.
pub struct Subtraction<'a> {
    /// Camera and lens.
    pub view: &'a params::View,
    /// The room's lights, listed.
    pub frame: &'a NearFrame,
    /// Number of the room's first triangle among the real surfaces.
    pub first: usize,
    /// Corners of the room's triangles as vertices of the room.
    pub triangles: &'a [[u32; 3]],
    /// Its suns.
    pub suns: &'a SunShadows,
    /// The objects under those that have a map in this frame, in their order.
    pub sun_cameras: &'a params::ShadowCameras,
    /// Their maps.
    pub sun_maps: Resource,
    /// One pass for all lights or one for each.
    pub spread: Spread,
    /// The picture as a display has it, where light is subtracted from that: a pass for each light, whatever `spread` says.
    pub shown: Option<Shown<'a>>,
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
    view: GrowingBuffer,
    cameras: GrowingBuffer,
    lights: GrowingBuffer,
    suns: GrowingBuffer,
    sun_cameras: GrowingBuffer,
    room_cameras: GrowingBuffer,
    ranges: KeptTexture,
    listed: KeptTexture,
    room_maps: KeptLayers,
    /// Whether the room's own maps are there.
    has_room_maps: bool,
    turns: Option<Turns>,
    displayed: Option<Displayed>,
    turn: GrowingBuffer,
    turn_bytes: Vec<u8>,
    no_taken: KeptTexture,
    group: BoundGroup,
    depth: KeptTexture,
    near_cameras: Box<params::PointCameras>,
    near_lights: Box<params::PointLights>,
    begin_end: Vec<[u32; 2]>,
    sent: Vec<[f32; 4]>,
}

impl Subtract {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::SUBTRACT)?;
        let depth = drawing("depth_alone", RATIOS_FORMAT);
        let nearest = built.drawing(context, &Drawing { write: wgpu::ColorWrites::empty(), ..depth })?;
        Ok(Self {
            built,
            nearest,
            pipelines: [const { None }; 4],
            chosen: GrowingBuffer::new("triangles with lights", wgpu::BufferUsages::INDEX),
            indices: Vec::new(),
            view: GrowingBuffer::uniform("view"),
            cameras: GrowingBuffer::uniform("near cameras"),
            lights: GrowingBuffer::uniform("near lights"),
            suns: GrowingBuffer::uniform("suns"),
            sun_cameras: GrowingBuffer::uniform("suns' cameras"),
            room_cameras: GrowingBuffer::uniform("suns' cameras of the room"),
            ranges: KeptTexture::uploaded("ranges of lights", wgpu::TextureFormat::Rg32Uint),
            listed: KeptTexture::uploaded("listed lights", wgpu::TextureFormat::Rgba32Float),
            room_maps: KeptLayers::result("suns' maps of the room", SHADOW_MAP_FORMAT),
            has_room_maps: false,
            turns: None,
            displayed: None,
            turn: GrowingBuffer::uniform("turns"),
            turn_bytes: Vec::new(),
            no_taken: KeptTexture::result("nothing taken", TAKEN_FORMAT),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("room depth", wgpu::TextureFormat::Depth32Float),
            near_cameras: bytemuck::zeroed_box(),
            near_lights: bytemuck::zeroed_box(),
            begin_end: Vec::new(),
            sent: Vec::new(),
        })
    }

    /// Whether the lists of a frame fit the device's textures.
    pub fn holds(context: &GpuContext, frame: &NearFrame) -> bool {
        let largest = context.device.limits().max_texture_dimension_2d as usize;
        let (ranges, listed) = frame.lists();
        listed.len() + LISTED_A_ROW * ROWS <= LISTED_A_ROW * largest && ranges.len() <= RANGES_A_ROW * largest
    }

    /// Another room: its own maps go to the device with the next frame.
    pub fn invalidate(&mut self) {
        self.has_room_maps = false;
    }

    /// Draws the room; the ratios get the lens' size.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        with: &Subtraction<'_>,
        mesh: &mut RoomMesh,
        pages: &mut PointPages,
        ratios: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        self.upload_lists(context, with);
        self.upload_room_maps(context, with.suns);
        view::near_cameras(with.frame.maps().cameras(), &mut self.near_cameras);
        let spread = [pages.tiles(), pages.maps_a_page() as u32, pages.texels()];
        view::near_lights(with.frame, spread, &mut self.near_lights);
        let lights = with.frame.lights().len() as u32;
        let in_turn = with.spread == Spread::Each || with.shown.is_some();
        self.upload_turns(context, if in_turn { lights } else { 0 });
        let missing = |pass: Pass| EngineError::Gpu { pass: pass.name(), reason: "no texture".into() };
        let window = self.turn.at_least(context, self.turn_bytes.len()).clone();
        let mut resources = vec![
            self.view.write(context, bytemuck::bytes_of(with.view)),
            self.cameras.write(context, bytemuck::bytes_of(&*self.near_cameras)),
            self.lights.write(context, bytemuck::bytes_of(&*self.near_lights)),
            pages.bind(context).ok_or_else(|| missing(Pass::PointMaps))?,
            self.ranges.bind(context),
            self.listed.bind(context),
            self.suns.write(context, bytemuck::bytes_of(&view::suns(with.suns, with.frame))),
            self.sun_cameras.write(context, bytemuck::bytes_of(with.sun_cameras)),
            with.sun_maps.clone(),
            self.room_cameras.write(context, bytemuck::bytes_of(&view::room_cameras(with.suns))),
            self.room_maps.bind(context).ok_or_else(|| missing(PASS))?,
            Resource::Window(window, size_of::<params::Turn>() as u64),
            self.no_taken.bind(context),
        ];
        let (width, height) = (with.view.frame[0] as u32, with.view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let round = Round {
            frame: with.frame,
            first: with.first,
            lights,
            has_suns: with.frame.sun_maps().iter().any(Option::is_some),
            size: (width, height),
        };
        let (pass, after, last) = if let Some(shown) = &with.shown {
            let Displayed { built, turns, group, .. } = {
                let displayed = match &mut self.displayed {
                    Some(displayed) => displayed,
                    slot => slot.insert(Displayed::new(context)?),
                };
                resources.extend(displayed.upload(context, with, shown));
                displayed
            };
            let group = group.of(context, built, &resources);
            turns.draw(recorder, &round, mesh, (group, depth))?;
            resources[TAKEN] = turns.taken(context);
            let (pipeline, last) = turns.after(context, built, &resources);
            (Pass::SubtractDisplayed, Some(pipeline), last)
        } else {
            let group = self.group.of(context, &self.built, &resources);
            if with.spread == Spread::Each {
                let turns = match &mut self.turns {
                    Some(turns) => turns,
                    slot => slot.insert(Turns::new(context, &self.built, PASS, &STAGES)?),
                };
                turns.draw(recorder, &round, mesh, (group, depth))?;
                resources[TAKEN] = turns.taken(context);
                let (pipeline, last) = turns.after(context, &self.built, &resources);
                (PASS, Some(pipeline), last)
            } else {
                (PASS, None, group)
            }
        };
        let has_suns = !with.suns.is_empty();
        let sun_is_hidden = with.frame.sun_maps().iter().any(Option::is_some);
        self.indices.clear();
        if after.is_none() {
            mesh.parts_of(|t| sun_is_hidden || !with.frame.listed(t).is_empty(), &mut self.indices);
        }
        let corners = 3 * self.indices.len() as u32;
        if corners > 0 {
            self.chosen.write(context, bytemuck::cast_slice(&self.indices));
        }
        let chosen = self.chosen.at_least(context, 0);
        let is_hard = self.near_lights.tiles_maps_texels_side[3] <= 1;
        let lit = match &mut self.pipelines[usize::from(has_suns) + 2 * usize::from(is_hard)] {
            Some(pipeline) => pipeline,
            slot => slot.insert(lit(context, &self.built, has_suns, is_hard)?),
        };
        let nearest = &self.nearest;
        let ratios = ratios.sized(context, width, height, 1);
        let one = f64::from(1.0f32.to_bits());
        let untouched = wgpu::Color { r: one, g: one, b: one, a: 0.0 };
        let targets = Targets { color: cleared(ratios, None, untouched), depth: Some((depth, 0.0)) };
        recorder.draw(pass, targets, |pass| {
            pass.set_bind_group(0, last, &[0]);
            if let Some(after) = after {
                pass.set_pipeline(after);
                mesh.draw(context, pass);
            } else if corners > 0 {
                // Each pixel is shaded once, and only where some light may be taken.
                pass.set_pipeline(nearest);
                mesh.draw(context, pass);
                pass.set_pipeline(lit);
                mesh.draw_parts(context, pass, chosen, 0..corners);
            }
        })
    }

    /// The numbers of the lights, and of the suns after them, each where its pass finds it.
    fn upload_turns(&mut self, context: &GpuContext, lights: u32) {
        self.turn_bytes.clear();
        for light in (0..lights).chain([SUNS]) {
            let turn = params::Turn { light: [light, 0, 0, 0] };
            self.turn_bytes.extend_from_slice(bytemuck::bytes_of(&turn));
            self.turn_bytes.resize(self.turn_bytes.len().next_multiple_of(TURN_STRIDE), 0);
        }
        self.turn.write(context, &self.turn_bytes);
    }

    fn upload_lists(&mut self, context: &GpuContext, with: &Subtraction<'_>) {
        let (ranges, listed) = with.frame.lists();
        self.begin_end.clear();
        self.begin_end.extend_from_slice(ranges);
        let rows = ranges.len().div_ceil(RANGES_A_ROW).max(1);
        self.begin_end.resize(rows * RANGES_A_ROW, [0; 2]);
        let texels = bytemuck::cast_slice(&self.begin_end);
        self.ranges.upload(context, RANGES_A_ROW as u32, rows as u32, texels);
        let rows = listed.len().div_ceil(LISTED_A_ROW).max(1).next_multiple_of(ROWS);
        self.sent.clear();
        for ([begin, end], corners) in ranges.iter().zip(with.triangles) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                let sent = corners.map(|v| with.frame.sent(k.into(), v));
                let [a, b, c] = corners.map(|v| with.frame.part(k.into(), v).0);
                let last = [f32::from(k), a[0], a[1]];
                self.sent.extend(sent.iter().zip(last).map(|(&[r, g, b], last)| [r, g, b, last]));
                self.sent.push([b[0], b[1], c[0], c[1]]);
            }
        }
        self.sent.resize(rows * LISTED_A_ROW * LISTED_TEXELS, [0.0; 4]);
        let texels = bytemuck::cast_slice(&self.sent);
        self.listed.upload(context, (LISTED_TEXELS * LISTED_A_ROW) as u32, rows as u32, texels);
    }

    /// The room's own maps under its suns, once a room.
    fn upload_room_maps(&mut self, context: &GpuContext, suns: &SunShadows) {
        if std::mem::replace(&mut self.has_room_maps, true) && self.room_maps.is_live() {
            return;
        }
        let maps = || (0..suns.len()).filter_map(|k| suns.get(k)).map(|(_, maps)| maps);
        // All have one size; what nothing in the room hides has none.
        let side = maps().flat_map(|maps| maps.cameras()).flatten().map(|c| c.texels).max();
        self.room_maps.sized(context, side.unwrap_or(1), suns.len() as u32);
        for (k, maps) in (0..).zip(maps()) {
            if side.is_some() && maps.cameras().first().is_some_and(|camera| camera.map(|c| c.texels) == side)
            {
                self.room_maps.upload(context, k, bytemuck::cast_slice(maps.depth(0)));
            }
        }
    }
}
