//! `compose/shade_object` on the device. Twin: `compose::shade_object`, over `compose::raster`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    compose::{geometry::MIRROR_EXPONENT, shade_object::Surroundings},
    gpu::{
        context::GpuContext,
        exchange::{Exchange, OBJECT_LAYER_FORMAT},
        kernel::{Binding, BindingKind, BoundGroup, Built, Drawing, KernelRow, Resource, source},
        params::{self, ObjectVertex, SurfaceVertex},
        recorder::{Targets, cleared},
        scene::MATERIAL_STRIDE,
        surroundings::SurroundingsBuffers,
        textures::KeptTexture,
    },
    plan::Pass,
};

/// `compose/shade_object`: real surfaces and objects into the depth, then objects, four samples a pixel.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::ShadeObject,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/soft_light"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/facet"),
        source!("shared/surroundings"),
        source!("compose/shade_object"),
    ],
    entries: &["vertex", "fragment", "depth_vertex", "surface_vertex", "depth_fragment"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("light", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("material", BindingKind::UniformAtOffset),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("surroundings", BindingKind::Uniform),
        Binding::new("environment", BindingKind::Floats),
    ],
    structs: &[
        params::View::LAYOUT,
        params::LightTerms::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
        params::MaterialTerms::LAYOUT,
        params::Surroundings::LAYOUT,
    ],
};

const PASS: Pass = Pass::ShadeObject;

/// What a material is; the shader's constants in their order.
#[derive(Clone, Copy, PartialEq, Eq)]
enum MaterialKind {
    Matt,
    Glossy,
    Sharp,
    Mirror,
    BlurredMirror,
}

impl MaterialKind {
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
enum ObjectDraw {
    /// Depth of real surfaces.
    SurfaceDepth,
    /// Depth of objects.
    Depth,
    /// Objects of a kind, under light with or without bands 4 and 5.
    Objects(MaterialKind, bool),
}

/// The pipelines made so far, with their samples a pixel.
#[derive(Default)]
struct ObjectPipelines(Vec<(u32, ObjectDraw, wgpu::RenderPipeline)>);

impl ObjectPipelines {
    fn get(&self, samples: u32, draws: ObjectDraw) -> Option<&wgpu::RenderPipeline> {
        self.0.iter().find(|made| (made.0, made.1) == (samples, draws)).map(|made| &made.2)
    }

    fn make(
        &mut self,
        context: &GpuContext,
        built: &Built,
        samples: u32,
        draws: ObjectDraw,
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
    pipelines: ObjectPipelines,
    /// Of each material in a frame.
    kinds: Vec<MaterialKind>,
    surroundings: SurroundingsBuffers,
    group: BoundGroup,
    depth: KeptTexture,
    samples: KeptTexture,
}

impl ShadeObject {
    /// Compiles the shader; pipelines follow when they are first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &KERNEL)?,
            pipelines: ObjectPipelines::default(),
            kinds: Vec::new(),
            surroundings: SurroundingsBuffers::new(),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("object depth", wgpu::TextureFormat::Depth32Float),
            samples: KeptTexture::scratch("object samples", OBJECT_LAYER_FORMAT),
        })
    }
}

impl DevicePass for ShadeObject {
    /// Draws the scene's objects into the layer, which becomes a part of the picture that holds all of them.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, state, scene, .. } = frame;
        let (context, lens) = (recorder.context, job.input.lens);
        let surroundings = &job.surroundings(&state.reflected);
        let samples = if job.quality.coverage_samples == 1 { 1 } else { 4 };
        let has_high_bands = job.light.order > 4;
        self.kinds.clear();
        let kind = |(specular_rgb, exponent): &([f32; 3], f32)| {
            MaterialKind::of(surroundings, *specular_rgb, *exponent)
        };
        self.kinds.extend(scene.meshes.shine().iter().map(kind));
        let objects = self.kinds.iter().map(|kind| ObjectDraw::Objects(*kind, has_high_bands));
        for draws in [ObjectDraw::SurfaceDepth, ObjectDraw::Depth].into_iter().chain(objects) {
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
            scene.terms.view.bind(context, 0),
            scene.terms.light.bind(context, 0),
            scene.terms.shadow_cameras.bind(context, 0),
            Resource::Window(scene.meshes.materials(context), size_of::<params::MaterialTerms>() as u64),
            exchange.bind_shadow_maps(context)?,
            seen,
            environment,
        ];
        let group = self.group.of(context, &self.built, &resources);
        let seen = scene.meshes.extents().objects_seen(lens, &job.camera);
        let part = seen.kept_from(exchange.object_layer.size().into(), [lens.width, lens.height]);
        exchange.object_origin = part.origin;
        let [width, height] = part.size;
        let depth = self.depth.sized(context, width, height, samples);
        let layer = exchange.object_layer.sized(context, width, height, 1);
        let nothing = wgpu::Color::TRANSPARENT;
        let color = if samples == 1 {
            cleared(layer, None, nothing)
        } else {
            cleared(self.samples.sized(context, width, height, samples), Some(layer), nothing)
        };
        let meshes = &mut scene.meshes;
        recorder.draw(PASS, Targets { color, depth: Some((depth, 0.0)) }, |pass| {
            // The whole picture's, as it lies around the part.
            let [x, y] = part.origin.map(|first| -(first as f32));
            pass.set_viewport(x, y, lens.width as f32, lens.height as f32, 0.0, 1.0);
            set(pass, ObjectDraw::SurfaceDepth);
            pass.set_bind_group(0, group, &[0]);
            meshes.draw_surfaces(context, pass);
            set(pass, ObjectDraw::Depth);
            meshes.draw_objects(context, pass, |_, _| {});
            meshes.draw_objects(context, pass, |pass, material| {
                let kind = kinds.get(material as usize).copied().unwrap_or(MaterialKind::Matt);
                set(pass, ObjectDraw::Objects(kind, has_high_bands));
                pass.set_bind_group(0, group, &[material * MATERIAL_STRIDE as u32]);
            });
        })
    }
}

fn pipeline(
    context: &GpuContext,
    built: &Built,
    samples: u32,
    draws: ObjectDraw,
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
        ObjectDraw::Depth => built.drawing(context, &depth),
        ObjectDraw::SurfaceDepth => built.drawing(
            context,
            &Drawing {
                vertex: "surface_vertex",
                stride: size_of::<SurfaceVertex>() as u64,
                attributes: &wgpu::vertex_attr_array![0 => Float32x4],
                ..depth
            },
        ),
        ObjectDraw::Objects(kind, has_high_bands) => built.drawing(
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
