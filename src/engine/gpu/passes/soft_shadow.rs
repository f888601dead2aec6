//! `compose/soft_shadow` on the device. Twin: `compose::soft_shadow`.

use crate::{
    compose::soft_shadow::Transfer,
    engine::{
        EngineError,
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
    },
    math::sh::{MAX_COEFFICIENTS, basis, soft_directions},
    plan::Pass,
    visibility::blockers::Blockers,
};

const PASS: Pass = Pass::SoftShadow;
/// Spheres that the shader takes.
pub const MOST_SPHERES: usize = 64;

/// The kernel.
pub struct SoftShadow {
    built: Built,
    pipeline: wgpu::RenderPipeline,
    view: GrowingBuffer,
    soft: GrowingBuffer,
    group: BoundGroup,
    depth: KeptTexture,
    terms: Box<params::SoftTerms>,
    /// Directions and order that the terms hold.
    directions: (usize, usize),
}

impl SoftShadow {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::SOFT_SHADOW)?;
        let pipeline = built.drawing(
            context,
            &Drawing {
                vertex: "vertex",
                fragment: "fragment",
                stride: size_of::<SurfaceVertex>() as u64,
                attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x3],
                color: RATIOS_FORMAT,
                write: wgpu::ColorWrites::ALL,
                nearer: wgpu::CompareFunction::Greater,
                samples: 1,
            },
        )?;
        Ok(Self {
            built,
            pipeline,
            view: GrowingBuffer::uniform("coarse view"),
            soft: GrowingBuffer::uniform("soft terms"),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("coarse depth", wgpu::TextureFormat::Depth32Float),
            terms: bytemuck::zeroed_box(),
            directions: (0, 0),
        })
    }

    /// Draws the scene's real surfaces into a coarse picture of the view's size, `directions` of them.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        coarse_view: &params::View,
        blockers: &Blockers,
        transfer: &Transfer,
        directions: usize,
        picture: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        self.fill(blockers, transfer, directions);
        let resources = [
            self.view.write(context, bytemuck::bytes_of(coarse_view)),
            self.soft.write(context, bytemuck::bytes_of(&*self.terms)),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (coarse_view.frame[0] as u32, coarse_view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, 1);
        let picture = picture.sized(context, width, height, 1);
        let targets =
            Targets { color: cleared(picture, None, wgpu::Color::TRANSPARENT), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            scene.draw_surfaces(context, pass);
        })
    }

    fn fill(&mut self, blockers: &Blockers, transfer: &Transfer, directions: usize) {
        let terms = &mut *self.terms;
        let order = transfer.order();
        let spheres = &blockers.spheres()[..blockers.spheres().len().min(MOST_SPHERES)];
        terms.counts = [order as u32, spheres.len() as u32, directions as u32, 0];
        for (slot, sphere) in terms.spheres.iter_mut().zip(spheres) {
            *slot = sphere.centre_world.extend(sphere.radius_m).to_array();
        }
        let bands = transfer.bands();
        terms.bands_low = [bands[0], bands[1], bands[2], bands[3]];
        terms.bands_high = [bands[4], bands[5], 0.0, 0.0];
        let count = order * order;
        let matrix = transfer.matrix_rgb();
        let pairs = (0..count).flat_map(|i| (0..=i).map(move |k| (i, k)));
        for (slot, (i, k)) in terms.matrix.iter_mut().zip(pairs) {
            let [r, g, b] = matrix[i * count + k];
            *slot = [r, g, b, 0.0];
        }
        if self.directions == (directions, order) {
            return;
        }
        self.directions = (directions, order);
        let h = soft_directions::softness(directions);
        let solid_angle = 4.0 * std::f64::consts::PI / directions as f64;
        terms.softness = [h as f32, (0.5 * h).sin() as f32, solid_angle as f32, 0.0];
        let mut means = [0.0f64; MAX_COEFFICIENTS];
        for (j, slot) in terms.directions.iter_mut().enumerate().take(directions) {
            let w = soft_directions::direction(j, directions);
            *slot = [w[0] as f32, w[1] as f32, w[2] as f32, 0.0];
            let mut y = [0.0f64; MAX_COEFFICIENTS];
            basis::evaluate(order, w, &mut y);
            for (mean, y) in means.iter_mut().zip(y).skip(1) {
                *mean += y / directions as f64;
            }
        }
        for (i, mean) in means.iter().enumerate() {
            terms.means[i / 4][i % 4] = *mean as f32;
        }
    }
}
