//! `compose/soft_shadow` on the device. Twin: `compose::soft_shadow`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    compose::soft_shadow::{Planes, Transfer},
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{Exchange, RATIOS_FORMAT},
        kernel::{Binding, BindingKind, BoundGroup, Built, Drawing, KernelRow, source},
        params::{self, SurfaceVertex},
        recorder::{Targets, cleared},
        textures::KeptTexture,
    },
    math::sh::MAX_ORDER,
    model::{blocker::Rung, quality::SoftAt},
    plan::Pass,
    visibility::blockers::{BlockerTables, BlockerTerms, Blockers},
};

/// `compose/soft_shadow`: the nearest real surface at the centres of a coarse picture; `fragment` is the rung `directions`.
/// At vertices the vertex stages evaluate, and `interpolated` hands on.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::SoftShadow,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/facet"),
        source!("shared/sh_product"),
        source!("shared/blockers"),
        source!("compose/soft_shadow"),
    ],
    entries: &["vertex", "fragment", "ladder", "vertex_directions", "vertex_ladder", "interpolated"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("soft", BindingKind::Uniform),
        Binding::new("blockers", BindingKind::Uniform),
        Binding::new("tables", BindingKind::Uniform),
        Binding::new("planes", BindingKind::Uniform),
    ],
    structs: &[
        params::View::LAYOUT,
        params::SoftTerms::LAYOUT,
        params::BLOCKER_TERMS,
        params::BLOCKER_TABLES,
        params::PlaneTerms::LAYOUT,
    ],
};

const PASS: Pass = Pass::SoftShadow;

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
            built: Built::new(context, &KERNEL)?,
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

impl DevicePass for SoftShadow {
    /// The twin does any number of spheres and any order; the shader as many as fit.
    fn prepare(&mut self, frame: &mut DeviceFrame<'_>, _exchange: &Exchange) -> bool {
        frame.state.prepare_blockers(frame.job);
        frame.state.blockers.fit_shader()
    }

    /// Draws the scene's real surfaces, or its grid, into a coarse picture.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, state, scene, .. } = frame;
        let context = recorder.context;
        let at_vertices = job.quality.soft_at == SoftAt::Vertex;
        if at_vertices {
            state.lay_grid(job);
            scene.update_grid(context, job, state);
        }
        let blockers = &state.blockers;
        self.fill(blockers, &state.transfer);
        self.fill_planes(&state.planes);
        let coarse_view = &scene.coarse_camera(job);
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
        let picture = exchange.soft.sized(context, width, height, 1);
        let targets =
            Targets { color: cleared(picture, None, wgpu::Color::TRANSPARENT), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            if at_vertices {
                scene.meshes.draw_grid(context, pass);
            } else {
                scene.meshes.draw_surfaces(context, pass);
            }
        })
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
