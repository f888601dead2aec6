//! A pass for each light of a known room, as in [Gib03]: the room's nearest triangles first, then those of each light over them,
//! blended, then what has come of it.

use super::DeviceFrame;
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{Exchange, RATIOS_FORMAT, untouched},
        kernel::{BoundGroup, Built, Drawing, Resource},
        params::RoomVertex,
        recorder::{Targets, cleared},
        room_lights::TURN_STRIDE,
        textures::KeptTexture,
    },
    nearfield::frame::NearFrame,
    plan::Pass,
};

/// Fragment stages, and how lights are blended.
#[derive(Clone, Copy)]
pub struct TurnStages {
    /// What the target holds where the room is seen, before any light.
    pub first: &'static str,
    /// Whether it writes colours, not depths alone.
    pub writes_first: bool,
    /// One light.
    pub one: &'static str,
    /// How it meets what the target holds.
    pub operation: wgpu::BlendOperation,
    /// What has come of it, as ratios.
    pub after: &'static str,
    /// The target's.
    pub format: wgpu::TextureFormat,
}

/// The passes, and their memory.
pub struct DeviceTurns {
    pass: Pass,
    nearest: wgpu::RenderPipeline,
    one: wgpu::RenderPipeline,
    after: wgpu::RenderPipeline,
    taken: KeptTexture,
    group: BoundGroup,
    /// Triangles by light, as corners of the room's mesh, and where each light's begin.
    chosen: GrowingBuffer,
    indices: Vec<[u32; 3]>,
    begins: Vec<u32>,
    next: Vec<u32>,
}

/// Which lights take part.
pub struct LightRound {
    /// How many lights.
    pub lights: u32,
    /// Whether objects may hide something of the suns, which have the turn after them.
    has_suns: bool,
}

impl LightRound {
    /// All of a frame.
    pub fn of(frame: &DeviceFrame<'_>) -> Self {
        let near = &frame.state.room.frame;
        Self { lights: near.lights().len() as u32, has_suns: near.sun_maps().iter().any(Option::is_some) }
    }
}

impl DeviceTurns {
    /// Of a kernel that has the stages.
    pub fn new(
        context: &GpuContext,
        built: &Built,
        pass: Pass,
        stages: &TurnStages,
    ) -> Result<Self, EngineError> {
        let whole = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: stages.operation,
        };
        let blend = wgpu::BlendState { color: whole, alpha: whole };
        let write = if stages.writes_first { wgpu::ColorWrites::ALL } else { wgpu::ColorWrites::empty() };
        let first = Drawing { write, ..drawing(stages.first, stages.format) };
        let one = Drawing { nearer: wgpu::CompareFunction::Equal, ..drawing(stages.one, stages.format) };
        Ok(Self {
            pass,
            nearest: built.drawing(context, &first)?,
            one: built.blending(context, &one, Some(blend))?,
            after: built.drawing(context, &drawing(stages.after, RATIOS_FORMAT))?,
            taken: KeptTexture::result("what lights have left", stages.format),
            group: BoundGroup::default(),
            chosen: GrowingBuffer::new("triangles by light", wgpu::BufferUsages::INDEX),
            indices: Vec::new(),
            begins: Vec::new(),
            next: Vec::new(),
        })
    }

    /// What the target holds, to bind.
    pub fn taken(&mut self, context: &GpuContext) -> Resource {
        self.taken.bind(context)
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
        self.next.clone_from(&self.begins);
        self.indices.clear();
        self.indices.resize(listed.len(), [0; 3]);
        for (t, [begin, end]) in (first..).zip(ranges) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                if let Some(place) = self.next.get_mut(usize::from(k)) {
                    if let Some(slot) = self.indices.get_mut(*place as usize) {
                        *slot = [3 * t, 3 * t + 1, 3 * t + 2];
                    }
                    *place += 1;
                }
            }
        }
    }

    /// Draws the turns.
    pub fn draw(
        &mut self,
        frame: &mut DeviceFrame<'_>,
        round: &LightRound,
        group: &wgpu::BindGroup,
    ) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, state, scene, .. } = frame;
        let (context, lights, lens) = (recorder.context, round.lights, job.input.lens);
        self.sort(&state.room.frame, state.room.triangles().0 as u32, lights);
        self.chosen.write(context, bytemuck::cast_slice(&self.indices));
        let chosen = self.chosen.at_least(context, 0).clone();
        let depth = scene.room_lights.depth(context, (lens.width, lens.height));
        let mesh = &mut scene.room_mesh;
        let taken = self.taken.sized(context, lens.width, lens.height, 1);
        let targets =
            Targets { color: cleared(taken, None, wgpu::Color::TRANSPARENT), depth: Some((&depth, 0.0)) };
        let (nearest, one, begins) = (&self.nearest, &self.one, &self.begins);
        recorder.draw(self.pass, targets, |pass| {
            pass.set_pipeline(nearest);
            pass.set_bind_group(0, group, &[0]);
            mesh.draw(context, pass);
            pass.set_pipeline(one);
            for (k, ends) in begins.windows(2).enumerate().filter(|(_, ends)| ends[0] < ends[1]) {
                pass.set_bind_group(0, group, &[(k * TURN_STRIDE) as u32]);
                mesh.draw_some(context, pass, &chosen, 3 * ends[0]..3 * ends[1]);
            }
            if round.has_suns {
                pass.set_bind_group(0, group, &[lights * TURN_STRIDE as u32]);
                mesh.draw(context, pass);
            }
        })
    }

    /// Draws what has come of it, as ratios.
    pub fn draw_ratios(
        &mut self,
        frame: &mut DeviceFrame<'_>,
        exchange: &mut Exchange,
        built: &Built,
        resources: &[Resource],
    ) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, scene, .. } = frame;
        let (context, lens) = (recorder.context, job.input.lens);
        let group = self.group.of(context, built, resources);
        let depth = scene.room_lights.depth(context, (lens.width, lens.height));
        let ratios = exchange.ratios.sized(context, lens.width, lens.height, 1);
        let targets = Targets { color: cleared(ratios, None, untouched()), depth: Some((&depth, 0.0)) };
        let (mesh, after) = (&mut scene.room_mesh, &self.after);
        recorder.draw(self.pass, targets, |pass| {
            pass.set_bind_group(0, group, &[0]);
            pass.set_pipeline(after);
            mesh.draw(context, pass);
        })
    }
}

const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
    0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x2, 4 => Uint32
];

/// The room, to a target.
pub fn drawing(fragment: &'static str, color: wgpu::TextureFormat) -> Drawing<'static> {
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
