//! `nearfield/subtract` on the device. Twin: `nearfield::subtract`.

use crate::{
    engine::{
        EngineError,
        gpu::{
            buffers::GrowingBuffer,
            context::GpuContext,
            exchange::{RATIOS_FORMAT, SHADOW_MAP_FORMAT},
            kernel::{BoundGroup, Built, Drawing, Resource},
            kernels,
            params::{self, RoomVertex},
            point_pages::{PointPages, Spread},
            recorder::{Recorder, Targets, cleared},
            room_mesh::RoomMesh,
            textures::{KeptLayers, KeptTexture},
            view,
        },
    },
    nearfield::{frame::NearFrame, sun_shadows::SunShadows},
    plan::Pass,
};

const PASS: Pass = Pass::Subtract;
/// Triangles in a row of `ranges`.
const RANGES_A_ROW: usize = 1024;
/// Lights of triangles in a row of `listed`, three texels each.
const LISTED_A_ROW: usize = 682;
/// Rows of `listed` come and go so many at a time.
const ROWS: usize = 16;

/// Bytes from one light's turn to the next: the largest alignment that a device may ask for.
const TURN_STRIDE: usize = 256;
/// The turn of the suns.
const SUNS: u32 = 0xffff;
/// What is taken of the light, where each light has a pass of its own: shares of all light, each sum rounded to a 2048th of
/// itself, or cut off there.
const TAKEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

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
    /// The objects under each.
    pub sun_cameras: &'a params::ShadowCameras,
    /// Their maps.
    pub sun_maps: Resource,
    /// One pass for all lights or one for each.
    pub spread: Spread,
}

/// Where each light has a pass of its own.
struct Turns {
    nearest: wgpu::RenderPipeline,
    one: wgpu::RenderPipeline,
    after: wgpu::RenderPipeline,
    taken: KeptTexture,
    group: BoundGroup,
    /// Triangles by light, as corners of the room's mesh, and where each light's begin.
    chosen: GrowingBuffer,
    indices: Vec<[u32; 3]>,
    begins: Vec<u32>,
}

/// The kernel.
pub struct Subtract {
    built: Built,
    pipeline: wgpu::RenderPipeline,
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
        let pipeline = built.drawing(context, &drawing("fragment", RATIOS_FORMAT))?;
        Ok(Self {
            built,
            pipeline,
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
        self.upload_turns(context, if with.spread == Spread::Each { lights } else { 0 });
        let missing = |pass: Pass| EngineError::Gpu { pass: pass.name(), reason: "no texture".into() };
        let window = self.turn.at_least(context, self.turn_bytes.len()).clone();
        let mut resources = [
            self.view.write(context, bytemuck::bytes_of(with.view)),
            self.cameras.write(context, bytemuck::bytes_of(&*self.near_cameras)),
            self.lights.write(context, bytemuck::bytes_of(&*self.near_lights)),
            pages.bind(context).ok_or_else(|| missing(Pass::PointMaps))?,
            self.ranges.bind(context),
            self.listed.bind(context),
            self.suns.write(context, bytemuck::bytes_of(&view::suns(with.suns))),
            self.sun_cameras.write(context, bytemuck::bytes_of(with.sun_cameras)),
            with.sun_maps.clone(),
            self.room_cameras.write(context, bytemuck::bytes_of(&view::room_cameras(with.suns))),
            self.room_maps.bind(context).ok_or_else(|| missing(PASS))?,
            Resource::Window(window, size_of::<params::Turn>() as u64),
            self.no_taken.bind(context),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (with.view.frame[0] as u32, with.view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let mut pipeline = &self.pipeline;
        let mut last = group;
        if with.spread == Spread::Each {
            let turns = match &mut self.turns {
                Some(turns) => turns,
                slot => slot.insert(Turns::new(context, &self.built)?),
            };
            turns.draw(recorder, with, mesh, (group, depth), lights, (width, height))?;
            if let Some(taken) = resources.last_mut() {
                *taken = turns.taken.bind(context);
            }
            last = turns.group.of(context, &self.built, &resources);
            pipeline = &turns.after;
        }
        let ratios = ratios.sized(context, width, height, 1);
        let one = f64::from(1.0f32.to_bits());
        let untouched = wgpu::Color { r: one, g: one, b: one, a: 0.0 };
        let targets = Targets { color: cleared(ratios, None, untouched), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, last, &[0]);
            mesh.draw(context, pass);
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
                let number = [f32::from(k), 0.0, 0.0];
                self.sent.extend(sent.iter().zip(number).map(|(&[r, g, b], number)| [r, g, b, number]));
            }
        }
        self.sent.resize(rows * LISTED_A_ROW * 3, [0.0; 4]);
        let texels = bytemuck::cast_slice(&self.sent);
        self.listed.upload(context, 3 * LISTED_A_ROW as u32, rows as u32, texels);
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

impl Turns {
    fn new(context: &GpuContext, built: &Built) -> Result<Self, EngineError> {
        let whole = |operation| wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation,
        };
        let add = whole(wgpu::BlendOperation::Add);
        let blend = wgpu::BlendState { color: add, alpha: add };
        let depth_alone =
            Drawing { write: wgpu::ColorWrites::empty(), ..drawing("nearest_room", TAKEN_FORMAT) };
        let same = wgpu::CompareFunction::Equal;
        let one = Drawing { nearer: same, ..drawing("one_light", TAKEN_FORMAT) };
        Ok(Self {
            nearest: built.drawing(context, &depth_alone)?,
            one: built.blending(context, &one, Some(blend))?,
            after: built.drawing(context, &drawing("after_all", RATIOS_FORMAT))?,
            taken: KeptTexture::result("taken of the light", TAKEN_FORMAT),
            group: BoundGroup::default(),
            chosen: GrowingBuffer::new("triangles by light", wgpu::BufferUsages::INDEX),
            indices: Vec::new(),
            begins: Vec::new(),
        })
    }

    /// Sorts the lists by light.
    fn sort(&mut self, frame: &NearFrame, first: u32, lights: u32) {
        let (ranges, listed) = frame.lists();
        self.begins.clear();
        self.begins.resize(lights as usize + 1, 0);
        for &k in listed {
            if let Some(count) = self.begins.get_mut(usize::from(k) + 1) {
                *count += 1;
            }
        }
        for k in 1..self.begins.len() {
            self.begins[k] += self.begins[k - 1];
        }
        let mut next = self.begins.clone();
        self.indices.clear();
        self.indices.resize(listed.len(), [0; 3]);
        for (t, [begin, end]) in (first..).zip(ranges) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                if let Some(place) = next.get_mut(usize::from(k)) {
                    if let Some(slot) = self.indices.get_mut(*place as usize) {
                        *slot = [3 * t, 3 * t + 1, 3 * t + 2];
                    }
                    *place += 1;
                }
            }
        }
    }

    /// Adds up what is taken, light by light.
    fn draw(
        &mut self,
        recorder: &mut Recorder<'_>,
        with: &Subtraction<'_>,
        mesh: &mut RoomMesh,
        (group, depth): (&wgpu::BindGroup, &wgpu::TextureView),
        lights: u32,
        (width, height): (u32, u32),
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        self.sort(with.frame, with.first as u32, lights);
        self.chosen.write(context, bytemuck::cast_slice(&self.indices));
        let chosen = self.chosen.at_least(context, 0).clone();
        let taken = self.taken.sized(context, width, height, 1);
        let targets =
            Targets { color: cleared(taken, None, wgpu::Color::TRANSPARENT), depth: Some((depth, 0.0)) };
        let (nearest, one, begins) = (&self.nearest, &self.one, &self.begins);
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(nearest);
            pass.set_bind_group(0, group, &[0]);
            mesh.draw(context, pass);
            pass.set_pipeline(one);
            for (k, ends) in begins.windows(2).enumerate().filter(|(_, ends)| ends[0] < ends[1]) {
                pass.set_bind_group(0, group, &[(k * TURN_STRIDE) as u32]);
                mesh.draw_some(context, pass, &chosen, 3 * ends[0]..3 * ends[1]);
            }
            if !with.suns.is_empty() {
                pass.set_bind_group(0, group, &[lights * TURN_STRIDE as u32]);
                mesh.draw(context, pass);
            }
        })
    }
}

const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
    0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x2, 4 => Uint32
];

/// The room, to a target.
fn drawing(fragment: &'static str, color: wgpu::TextureFormat) -> Drawing<'static> {
    Drawing {
        vertex: "vertex",
        fragment,
        stride: size_of::<RoomVertex>() as u64,
        attributes: &ATTRIBUTES,
        color,
        write: wgpu::ColorWrites::ALL,
        nearer: wgpu::CompareFunction::Greater,
        samples: 1,
        constants: &[],
    }
}
