//! The lights of a known room on the device, as the kernels that subtract them read them: which of them matter at each
//! triangle, the suns, the room's own maps under those, and whose turn it is.

use super::{
    buffers::GrowingBuffer,
    context::GpuContext,
    exchange::{Exchange, SHADOW_MAP_FORMAT},
    kernel::Resource,
    params,
    passes::DeviceFrame,
    textures::{KeptLayers, KeptTexture},
    view,
};
use crate::{
    EngineError,
    frame::RoomState,
    nearfield::{frame::NearFrame, sun_shadows::SunShadows},
    plan::Pass,
};

/// Triangles in a row of `ranges`.
const RANGES_A_ROW: usize = 1024;
/// Lights of triangles in a row of `listed`...
pub const LISTED_A_ROW: usize = 512;
/// ...of so many texels each.
pub const LISTED_TEXELS: usize = 4;
/// Rows of `listed` come and go so many at a time.
pub const ROWS: usize = 16;
/// Bytes from one light's turn to the next: the largest alignment that a device may ask for.
pub const TURN_STRIDE: usize = 256;
/// The turn of the suns.
const SUNS: u32 = 0xffff;
/// What is taken of the light, where each light has a pass of its own: shares of all light, each sum rounded to a 2048th of
/// itself, or cut off there.
pub const TAKEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Where it is bound.
pub const TAKEN: usize = 12;

/// Everything here is reused from frame to frame.
pub struct RoomLights {
    suns: GrowingBuffer,
    room_cameras: GrowingBuffer,
    ranges: KeptTexture,
    listed: KeptTexture,
    room_maps: KeptLayers,
    /// The room whose own maps are there.
    room_maps_of: Option<u64>,
    turn: GrowingBuffer,
    turn_bytes: Vec<u8>,
    no_taken: KeptTexture,
    depth: KeptTexture,
    begin_end: Vec<[u32; 2]>,
    sent: Vec<[f32; 4]>,
}

impl RoomLights {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self {
            suns: GrowingBuffer::uniform("suns"),
            room_cameras: GrowingBuffer::uniform("suns' cameras of the room"),
            ranges: KeptTexture::uploaded("ranges of lights", wgpu::TextureFormat::Rg32Uint),
            listed: KeptTexture::uploaded("listed lights", wgpu::TextureFormat::Rgba32Float),
            room_maps: KeptLayers::result("suns' maps of the room", SHADOW_MAP_FORMAT),
            room_maps_of: None,
            turn: GrowingBuffer::uniform("turns"),
            turn_bytes: Vec::new(),
            no_taken: KeptTexture::result("nothing taken", TAKEN_FORMAT),
            depth: KeptTexture::scratch("room depth", wgpu::TextureFormat::Depth32Float),
            begin_end: Vec::new(),
            sent: Vec::new(),
        }
    }

    /// Whether the lists of a frame fit the device's textures.
    pub fn fit(context: &GpuContext, frame: &NearFrame) -> bool {
        let largest = context.device.limits().max_texture_dimension_2d as usize;
        let (ranges, listed) = frame.lists();
        listed.len() + LISTED_A_ROW * ROWS <= LISTED_A_ROW * largest && ranges.len() <= RANGES_A_ROW * largest
    }

    /// The depth of the room's nearest triangle, to draw to.
    pub fn depth(&mut self, context: &GpuContext, (width, height): (u32, u32)) -> wgpu::TextureView {
        self.depth.sized(context, width, height, 1).clone()
    }

    /// The numbers of the lights, and of the suns after them, each where its pass finds it.
    fn upload_turns(&mut self, context: &GpuContext, lights: u32) -> Resource {
        self.turn_bytes.clear();
        for light in (0..lights).chain([SUNS]) {
            let turn = params::Turn { light: [light, 0, 0, 0] };
            self.turn_bytes.extend_from_slice(bytemuck::bytes_of(&turn));
            self.turn_bytes.resize(self.turn_bytes.len().next_multiple_of(TURN_STRIDE), 0);
        }
        self.turn.write(context, &self.turn_bytes);
        let window = self.turn.at_least(context, self.turn_bytes.len()).clone();
        Resource::Window(window, size_of::<params::Turn>() as u64)
    }

    fn upload_lists(&mut self, context: &GpuContext, room: &RoomState) {
        let (frame, (_, triangles)) = (&room.frame, room.triangles());
        let (ranges, listed) = frame.lists();
        self.begin_end.clear();
        self.begin_end.extend_from_slice(ranges);
        let rows = ranges.len().div_ceil(RANGES_A_ROW).max(1);
        self.begin_end.resize(rows * RANGES_A_ROW, [0; 2]);
        let texels = bytemuck::cast_slice(&self.begin_end);
        self.ranges.upload(context, RANGES_A_ROW as u32, rows as u32, texels);
        let rows = listed.len().div_ceil(LISTED_A_ROW).max(1).next_multiple_of(ROWS);
        self.sent.clear();
        for ([begin, end], corners) in ranges.iter().zip(triangles) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                let sent = corners.map(|v| frame.sent(k.into(), v));
                let [a, b, c] = corners.map(|v| frame.part(k.into(), v).0);
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
    fn upload_room_maps(&mut self, context: &GpuContext, room: u64, suns: &SunShadows) {
        if self.room_maps_of.replace(room) == Some(room) && self.room_maps.is_live() {
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

/// Uploads what the kernels read of a frame in a known room, listed before; the resources of `nearfield/subtract`, in the
/// order of its bindings, with nothing taken. `in_turn`: so many lights have a pass of their own.
pub fn resources(
    frame: &mut DeviceFrame<'_>,
    exchange: &mut Exchange,
    in_turn: u32,
) -> Result<Vec<Resource>, EngineError> {
    let DeviceFrame { recorder, job, state, scene, .. } = frame;
    let context = recorder.context;
    scene.update_room(context, job, state)?;
    let room = &state.room;
    let (lights, terms) = (&mut scene.room_lights, &mut scene.terms);
    lights.upload_lists(context, room);
    lights.upload_room_maps(context, room.taken, &room.suns);
    let [near_cameras, near_lights] = exchange.point_maps.write_terms(context, &room.frame);
    let missing = |pass: Pass| EngineError::Gpu { pass: pass.name(), reason: "no texture".into() };
    Ok(vec![
        terms.view.bind(context, 0),
        near_cameras,
        near_lights,
        exchange.point_maps.bind(context).ok_or_else(|| missing(Pass::PointMaps))?,
        lights.ranges.bind(context),
        lights.listed.bind(context),
        lights.suns.write(context, bytemuck::bytes_of(&view::suns(&room.suns, &room.frame))),
        terms.shadow_cameras.bind(context, 0),
        exchange.bind_shadow_maps(context)?,
        lights.room_cameras.write(context, bytemuck::bytes_of(&view::room_cameras(&room.suns))),
        lights.room_maps.bind(context).ok_or_else(|| missing(Pass::ShadowMaps))?,
        lights.upload_turns(context, in_turn),
        lights.no_taken.bind(context),
    ])
}
