//! `compose/soft_shadow` on the device. Twin: `compose::soft_shadow`.

use crate::{
    EngineError,
    compose::soft_shadow::{Planes, Transfer},
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::RATIOS_FORMAT,
        kernel::{BoundGroup, Built, Drawing},
        kernels,
        params::{self, SurfaceVertex},
        recorder::{Recorder, Targets, cleared},
        scene::SceneBuffers,
        textures::KeptTexture,
    },
    math::sh::MAX_ORDER,
    model::blocker::Rung,
    plan::Pass,
    visibility::blockers::{BlockerTables, BlockerTerms, Blockers},
};

const PASS: Pass = Pass::SoftShadow;

/// What spheres take of the soft light, as the twins have prepared it.
pub struct Soft<'a> {
    /// That `fit_shader`.
    pub blockers: &'a Blockers,
    /// The light.
    pub transfer: &'a Transfer,
    /// Flat receivers.
    pub planes: &'a Planes,
    /// Whether they are found at the vertices of the scene's grid, which has been uploaded, and interpolated.
    pub at_vertices: bool,
}

/// The kernel.
pub struct SoftShadow {
    built: Built,
    /// For each order: of the rung `directions`, and of all others; at pixels, and at vertices.
    pipelines: [[Option<wgpu::RenderPipeline>; 4]; MAX_ORDER + 1],
    view: GrowingBuffer,
    soft: GrowingBuffer,
    blockers: GrowingBuffer,
    tables: GrowingBuffer,
    tables_order: Option<usize>,
    planes: GrowingBuffer,
    group: BoundGroup,
    depth: KeptTexture,
    terms: Box<params::SoftTerms>,
    blocker_terms: Box<BlockerTerms>,
    blocker_tables: Box<BlockerTables>,
    plane_terms: Box<params::PlaneTerms>,
}

impl SoftShadow {
    /// Compiles the shader; pipelines follow when a rung and an order are first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &kernels::SOFT_SHADOW)?,
            pipelines: [const { [const { None }; 4] }; MAX_ORDER + 1],
            view: GrowingBuffer::uniform("coarse view"),
            soft: GrowingBuffer::uniform("soft terms"),
            blockers: GrowingBuffer::uniform("blockers"),
            tables: GrowingBuffer::uniform("blocker tables"),
            tables_order: None,
            planes: GrowingBuffer::uniform("planes"),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("coarse depth", wgpu::TextureFormat::Depth32Float),
            terms: bytemuck::zeroed_box(),
            blocker_terms: bytemuck::zeroed_box(),
            blocker_tables: bytemuck::zeroed_box(),
            plane_terms: bytemuck::zeroed_box(),
        })
    }

    /// Draws the scene's real surfaces into a coarse picture of the view's size; for blockers that `fit_shader`.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        coarse_view: &params::View,
        spheres: &Soft<'_>,
        picture: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let blockers = spheres.blockers;
        self.fill(blockers, spheres.transfer);
        self.fill_planes(spheres.planes);
        blockers.shader_terms(&mut self.blocker_terms);
        let is_directed = blockers.rung() == Rung::Directions;
        let order = blockers.order();
        // A freed buffer comes back empty, also where the rung reads nothing of it.
        if !self.tables.is_live() {
            self.tables_order = None;
        }
        let tables = if is_directed || self.tables_order == Some(order) {
            self.tables.bind(context, size_of::<BlockerTables>())
        } else {
            blockers.shader_tables(&mut self.blocker_tables);
            self.tables_order = Some(order);
            self.tables.write(context, bytemuck::bytes_of(&*self.blocker_tables))
        };
        let at_vertices = spheres.at_vertices;
        let (number, stages) = match (is_directed, at_vertices) {
            (true, false) => (0, ["vertex", "fragment"]),
            (false, false) => (1, ["vertex", "ladder"]),
            (true, true) => (2, ["vertex_directions", "interpolated"]),
            (false, true) => (3, ["vertex_ladder", "interpolated"]),
        };
        let slot = &mut self.pipelines[order.min(MAX_ORDER)][number];
        let pipeline = match slot {
            Some(pipeline) => pipeline,
            None => slot.insert(pipeline(context, &self.built, stages, order)?),
        };
        let resources = [
            self.view.write(context, bytemuck::bytes_of(coarse_view)),
            self.soft.write(context, bytemuck::bytes_of(&*self.terms)),
            self.blockers.write(context, bytemuck::bytes_of(&*self.blocker_terms)),
            tables,
            self.planes.write(context, bytemuck::bytes_of(&*self.plane_terms)),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (coarse_view.frame[0] as u32, coarse_view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let picture = picture.sized(context, width, height, 1);
        let targets =
            Targets { color: cleared(picture, None, wgpu::Color::TRANSPARENT), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            if at_vertices {
                scene.draw_grid(context, pass);
            } else {
                scene.draw_surfaces(context, pass);
            }
        })
    }

    /// The first normals of the flat receivers; the others are evaluated as what is round.
    fn fill_planes(&mut self, planes: &Planes) {
        let terms = &mut *self.plane_terms;
        let mut count = 0;
        for plane in planes.prepared() {
            let normal = plane.normal().extend(0.0).to_array();
            if count == params::PLANES || terms.normals[..count].contains(&normal) {
                continue;
            }
            terms.normals[count] = normal;
            for (slot, [r, g, b]) in terms.weights[count].iter_mut().zip(plane.terms()) {
                *slot = [*r, *g, *b, 0.0];
            }
            count += 1;
        }
        terms.counts[0] = count as u32;
    }

    fn fill(&mut self, blockers: &Blockers, transfer: &Transfer) {
        let terms = &mut *self.terms;
        let order = transfer.order();
        let bands = transfer.bands();
        terms.bands_low = [bands[0], bands[1], bands[2], bands[3]];
        terms.bands_high = [bands[4], bands[5], 0.0, 0.0];
        let count = order * order;
        let matrix = transfer.matrix_rgb();
        terms.matrix.fill([0.0; 4]);
        let pairs = (0..count).flat_map(|i| (0..=i).map(move |k| (i, k)));
        for (slot, (i, k)) in terms.matrix.iter_mut().zip(pairs) {
            let [r, g, b] = matrix[i * count + k];
            *slot = [r, g, b, 0.0];
        }
        let (directions, [softness, least_sine], means) = blockers.directions();
        terms.counts = [directions.len() as u32, 0, 0, 0];
        let solid_angle = 4.0 * std::f32::consts::PI / directions.len().max(1) as f32;
        terms.softness = [softness, least_sine, solid_angle, 0.0];
        for (j, direction) in directions.iter().enumerate() {
            let Some(four) = terms.directions.get_mut(j / 4) else { break };
            for (row, w) in four.iter_mut().zip(direction) {
                row[j % 4] = *w;
            }
        }
        for (slot, mean) in terms.means.as_flattened_mut().iter_mut().zip(means) {
            *slot = *mean;
        }
    }
}

fn pipeline(
    context: &GpuContext,
    built: &Built,
    [vertex, fragment]: [&str; 2],
    order: usize,
) -> Result<wgpu::RenderPipeline, EngineError> {
    let drawing = Drawing {
        vertex,
        fragment,
        stride: size_of::<SurfaceVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x3],
        color: RATIOS_FORMAT,
        write: wgpu::ColorWrites::ALL,
        nearer: wgpu::CompareFunction::Greater,
        samples: 1,
        constants: &[("SH_ORDER", order as f64)],
    };
    built.drawing(context, &drawing)
}
