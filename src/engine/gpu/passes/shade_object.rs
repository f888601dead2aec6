//! `compose/shade_object` on the device. Twin: `compose::shade_object`, over `compose::raster`.

use crate::{
    compose::shade_object::Surroundings,
    engine::{
        EngineError,
        gpu::{
            buffers::GrowingBuffer,
            context::GpuContext,
            exchange::OBJECT_LAYER_FORMAT,
            kernel::{BoundGroup, Built, Drawing, Resource},
            kernels,
            params::{self, ObjectVertex, SurfaceVertex},
            recorder::{Recorder, Targets, cleared},
            scene::{MATERIAL_STRIDE, SceneBuffers},
            surroundings::SurroundingsBuffers,
            textures::KeptTexture,
        },
    },
    plan::Pass,
};

const PASS: Pass = Pass::ShadeObject;

struct Pipelines {
    objects: wgpu::RenderPipeline,
    surfaces: wgpu::RenderPipeline,
}

/// The kernel.
pub struct ShadeObject {
    built: Built,
    /// With one and with four samples a pixel.
    one: Option<Pipelines>,
    four: Option<Pipelines>,
    view: GrowingBuffer,
    light: GrowingBuffer,
    cameras: GrowingBuffer,
    surroundings: SurroundingsBuffers,
    group: BoundGroup,
    depth: KeptTexture,
    samples: KeptTexture,
}

impl ShadeObject {
    /// Compiles the shader; pipelines follow when a number of samples is first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &kernels::SHADE_OBJECT)?,
            one: None,
            four: None,
            view: GrowingBuffer::uniform("view"),
            light: GrowingBuffer::uniform("light"),
            cameras: GrowingBuffer::uniform("shadow cameras"),
            surroundings: SurroundingsBuffers::new(),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("object depth", wgpu::TextureFormat::Depth32Float),
            samples: KeptTexture::scratch("object samples", OBJECT_LAYER_FORMAT),
        })
    }

    /// Draws the scene's objects into the layer, which gets the lens' size; `coverage_samples` is 1 or 4.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &mut SceneBuffers,
        frame: &Frame<'_>,
        surroundings: &Surroundings<'_>,
        coverage_samples: u32,
        layer: &mut KeptTexture,
    ) -> Result<(), EngineError> {
        let context = recorder.context;
        let samples = if coverage_samples == 1 { 1 } else { 4 };
        let slot = if samples == 1 { &mut self.one } else { &mut self.four };
        if slot.is_none() {
            *slot = Some(pipelines(context, &self.built, samples)?);
        }
        let Some(pipelines) = slot else { return Ok(()) };
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
        let (width, height) = (frame.view.frame[0] as u32, frame.view.frame[1] as u32);
        let depth = self.depth.sized(context, width, height, samples);
        let layer = layer.sized(context, width, height, 1);
        let nothing = wgpu::Color::TRANSPARENT;
        let color = if samples == 1 {
            cleared(layer, None, nothing)
        } else {
            cleared(self.samples.sized(context, width, height, samples), Some(layer), nothing)
        };
        recorder.draw(PASS, Targets { color, depth: Some((depth, 0.0)) }, |pass| {
            pass.set_pipeline(&pipelines.surfaces);
            pass.set_bind_group(0, group, &[0]);
            scene.draw_surfaces(context, pass);
            pass.set_pipeline(&pipelines.objects);
            scene.draw_objects(context, pass, |pass, material| {
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

fn pipelines(context: &GpuContext, built: &Built, samples: u32) -> Result<Pipelines, EngineError> {
    let objects = Drawing {
        vertex: "vertex",
        fragment: "fragment",
        stride: size_of::<ObjectVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![
            0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32x4, 4 => Float32x3
        ],
        color: OBJECT_LAYER_FORMAT,
        write: wgpu::ColorWrites::ALL,
        nearer: wgpu::CompareFunction::Greater,
        samples,
        constants: &[],
    };
    let surfaces = Drawing {
        vertex: "surface_vertex",
        fragment: "surface_fragment",
        stride: size_of::<SurfaceVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4],
        write: wgpu::ColorWrites::empty(),
        ..objects
    };
    Ok(Pipelines { objects: built.drawing(context, &objects)?, surfaces: built.drawing(context, &surfaces)? })
}
