//! `compose/shade_object` on the device. Twin: `compose::shade_object`, over `compose::raster`.

use crate::{
    EngineError,
    compose::{geometry::MIRROR_EXPONENT, shade_object::Surroundings},
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::OBJECT_LAYER_FORMAT,
        extents::Part,
        kernel::{BoundGroup, Built, Drawing, Resource},
        kernels,
        params::{self, ObjectVertex, SurfaceVertex},
        recorder::{Recorder, Targets, cleared},
        scene::{MATERIAL_STRIDE, SceneBuffers},
        surroundings::SurroundingsBuffers,
        textures::KeptTexture,
    },
    plan::Pass,
};

const PASS: Pass = Pass::ShadeObject;

/// What a material is; the shader's constants in their order.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Matt,
    Glossy,
    Sharp,
    Mirror,
    BlurredMirror,
}

impl Kind {
    fn of(surroundings: &Surroundings<'_>, specular_rgb: [f32; 3], exponent: f32) -> Self {
        if exponent == MIRROR_EXPONENT {
            if surroundings.picture.is_some() { Self::Mirror } else { Self::BlurredMirror }
        } else if specular_rgb == [0.0; 3] {
            Self::Matt
        } else if surroundings.is_sharp(exponent) {
            Self::Sharp
        } else {
            Self::Glossy
        }
    }
}

/// What a pipeline draws.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Draws {
    /// Depth of real surfaces.
    SurfaceDepth,
    /// Depth of objects.
    Depth,
    /// Objects of a kind, under light with or without bands 4 and 5.
    Objects(Kind, bool),
}

/// The pipelines made so far, with their samples a pixel.
#[derive(Default)]
struct Pipelines(Vec<(u32, Draws, wgpu::RenderPipeline)>);

impl Pipelines {
    fn get(&self, samples: u32, draws: Draws) -> Option<&wgpu::RenderPipeline> {
        self.0.iter().find(|made| (made.0, made.1) == (samples, draws)).map(|made| &made.2)
    }

    fn make(
        &mut self,
        context: &GpuContext,
        built: &Built,
        samples: u32,
        draws: Draws,
    ) -> Result<(), EngineError> {
        if self.get(samples, draws).is_none() {
            self.0.push((samples, draws, pipeline(context, built, samples, draws)?));
        }
        Ok(())
    }
}

/// The kernel.
pub struct ShadeObject {
    built: Built,
    pipelines: Pipelines,
    /// Of each material in a frame.
    kinds: Vec<Kind>,
    view: GrowingBuffer,
    light: GrowingBuffer,
    cameras: GrowingBuffer,
    surroundings: SurroundingsBuffers,
    group: BoundGroup,
    depth: KeptTexture,
    samples: KeptTexture,
}

impl ShadeObject {
    /// Compiles the shader; pipelines follow when they are first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &kernels::SHADE_OBJECT)?,
            pipelines: Pipelines::default(),
            kinds: Vec::new(),
            view: GrowingBuffer::uniform("view"),
            light: GrowingBuffer::uniform("light"),
            cameras: GrowingBuffer::uniform("shadow cameras"),
            surroundings: SurroundingsBuffers::new(),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("object depth", wgpu::TextureFormat::Depth32Float),
            samples: KeptTexture::scratch("object samples", OBJECT_LAYER_FORMAT),
        })
    }

    /// Draws the scene's objects into the layer, which becomes `part` of the picture and has to hold all of them;
    /// `coverage_samples` is 1 or 4.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        frame: &Frame<'_>,
        surroundings: &Surroundings<'_>,
        coverage_samples: u32,
        (layer, part): (&mut KeptTexture, Part),
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let samples = if coverage_samples == 1 { 1 } else { 4 };
        let has_high_bands = frame.light.order_hard[0] > 4;
        self.kinds.clear();
        let kind =
            |(specular_rgb, exponent): &([f32; 3], f32)| Kind::of(surroundings, *specular_rgb, *exponent);
        self.kinds.extend(scene.shine().iter().map(kind));
        let objects = self.kinds.iter().map(|kind| Draws::Objects(*kind, has_high_bands));
        for draws in [Draws::SurfaceDepth, Draws::Depth].into_iter().chain(objects) {
            self.pipelines.make(context, &self.built, samples, draws)?;
        }
        let (pipelines, kinds) = (&self.pipelines, &self.kinds);
        let set = |pass: &mut wgpu::RenderPass<'_>, draws| {
            if let Some(pipeline) = pipelines.get(samples, draws) {
                pass.set_pipeline(pipeline);
            }
        };
        let [seen, environment] = self.surroundings.write(context, surroundings);
        let resources = [
            self.view.write(context, bytemuck::bytes_of(frame.view)),
            self.light.write(context, bytemuck::bytes_of(frame.light)),
            self.cameras.write(context, bytemuck::bytes_of(frame.cameras)),
            Resource::Window(scene.materials(context), size_of::<params::MaterialTerms>() as u64),
            frame.shadow_maps.clone(),
            seen,
            environment,
        ];
        let group = self.group.of(context, &self.built, &resources);
        let [width, height] = part.size;
        let depth = self.depth.sized(context, width, height, samples);
        let layer = layer.sized(context, width, height, 1);
        let nothing = wgpu::Color::TRANSPARENT;
        let color = if samples == 1 {
            cleared(layer, None, nothing)
        } else {
            cleared(self.samples.sized(context, width, height, samples), Some(layer), nothing)
        };
        recorder.draw(PASS, Targets { color, depth: Some((depth, 0.0)) }, |pass| {
            // The whole picture's, as it lies around the part.
            let [x, y] = part.origin.map(|first| -(first as f32));
            pass.set_viewport(x, y, frame.view.frame[0], frame.view.frame[1], 0.0, 1.0);
            set(pass, Draws::SurfaceDepth);
            pass.set_bind_group(0, group, &[0]);
            scene.draw_surfaces(context, pass);
            set(pass, Draws::Depth);
            scene.draw_objects(context, pass, |_, _| {});
            scene.draw_objects(context, pass, |pass, material| {
                let kind = kinds.get(material as usize).copied().unwrap_or(Kind::Matt);
                set(pass, Draws::Objects(kind, has_high_bands));
                pass.set_bind_group(0, group, &[material * MATERIAL_STRIDE as u32]);
            });
        })
    }
}

/// What shading a frame reads.
pub struct Frame<'a> {
    /// Camera and lens.
    pub view: &'a params::View,
    /// The light.
    pub light: &'a params::LightTerms,
    /// The shadow maps' cameras.
    pub cameras: &'a params::ShadowCameras,
    /// The maps.
    pub shadow_maps: &'a Resource,
}

fn pipeline(
    context: &GpuContext,
    built: &Built,
    samples: u32,
    draws: Draws,
) -> Result<wgpu::RenderPipeline, EngineError> {
    let depth = Drawing {
        vertex: "depth_vertex",
        fragment: "depth_fragment",
        stride: size_of::<ObjectVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3],
        color: OBJECT_LAYER_FORMAT,
        write: wgpu::ColorWrites::empty(),
        nearer: wgpu::CompareFunction::Greater,
        samples,
        constants: &[],
    };
    match draws {
        Draws::Depth => built.drawing(context, &depth),
        Draws::SurfaceDepth => built.drawing(
            context,
            &Drawing {
                vertex: "surface_vertex",
                stride: size_of::<SurfaceVertex>() as u64,
                attributes: &wgpu::vertex_attr_array![0 => Float32x4],
                ..depth
            },
        ),
        Draws::Objects(kind, has_high_bands) => built.drawing(
            context,
            &Drawing {
                vertex: "vertex",
                fragment: "fragment",
                attributes: &wgpu::vertex_attr_array![
                    0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32x4, 4 => Float32x3
                ],
                write: wgpu::ColorWrites::ALL,
                // The depth is there already: of what is nearest exactly this.
                nearer: wgpu::CompareFunction::GreaterEqual,
                constants: &[
                    ("MATERIAL", f64::from(kind as u8)),
                    ("HIGH_BANDS", f64::from(u8::from(has_high_bands))),
                ],
                ..depth
            },
        ),
    }
}
