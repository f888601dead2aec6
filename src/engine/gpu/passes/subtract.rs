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
            point_pages::PointPages,
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

/// What the frame is drawn from.
pub struct Subtraction<'a> {
    /// Camera and lens.
    pub view: &'a params::View,
    /// The room's lights, listed.
    pub frame: &'a NearFrame,
    /// Corners of the room's triangles as vertices of the room.
    pub triangles: &'a [[u32; 3]],
    /// Its suns.
    pub suns: &'a SunShadows,
    /// The objects under each.
    pub sun_cameras: &'a params::ShadowCameras,
    /// Their maps.
    pub sun_maps: Resource,
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
        let attributes = wgpu::vertex_attr_array![
            0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x2, 4 => Uint32
        ];
        let pipeline = built.drawing(
            context,
            &Drawing {
                vertex: "vertex",
                fragment: "fragment",
                stride: size_of::<RoomVertex>() as u64,
                attributes: &attributes,
                color: RATIOS_FORMAT,
                write: wgpu::ColorWrites::ALL,
                nearer: wgpu::CompareFunction::Greater,
                samples: 1,
                constants: &[],
            },
        )?;
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
        let missing = |pass: Pass| EngineError::Gpu { pass: pass.name(), reason: "no texture".into() };
        let resources = [
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
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (with.view.frame[0] as u32, with.view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let ratios = ratios.sized(context, width, height, 1);
        let one = f64::from(1.0f32.to_bits());
        let untouched = wgpu::Color { r: one, g: one, b: one, a: 0.0 };
        let targets = Targets { color: cleared(ratios, None, untouched), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            mesh.draw(context, pass);
        })
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
        if std::mem::replace(&mut self.has_room_maps, true) {
            return;
        }
        let maps = || (0..suns.len()).filter_map(|k| suns.get(k)).map(|(_, maps)| maps);
        let side = maps().flat_map(|maps| maps.cameras()).flatten().map(|c| c.texels).max();
        self.room_maps.sized(context, side.unwrap_or(1), suns.len() as u32);
        for (k, maps) in (0..).zip(maps()) {
            if maps.cameras().first().is_some_and(|camera| camera.map(|c| c.texels) == side) {
                self.room_maps.upload(context, k, bytemuck::cast_slice(maps.depth(0)));
            }
        }
    }
}
