//! `compose/shade_surface` on the device. Twin: `compose::shade_surface`.

use super::{DeviceFrame, DevicePass};
use crate::{
    EngineError,
    gpu::{
        buffers::GrowingBuffer,
        context::GpuContext,
        exchange::{Exchange, RATIOS_FORMAT, untouched},
        kernel::{Binding, BindingKind, BoundGroup, Built, Drawing, KernelRow, source},
        params::{self, SurfaceVertex},
        recorder::{Targets, cleared},
        textures::KeptTexture,
    },
    plan::{Pass, Product},
};

/// `compose/shade_surface`: the nearest real surface at each pixel's centre, as a ratio.
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::ShadeSurface,
    sources: &[
        source!("shared/lens"),
        source!("shared/sh_basis"),
        source!("shared/soft_light"),
        source!("shared/shadow_camera"),
        source!("shared/shadow_lookup"),
        source!("shared/facet"),
        source!("compose/shade_surface"),
    ],
    entries: &["vertex", "fragment"],
    bindings: &[
        Binding::new("view", BindingKind::Uniform),
        Binding::new("light", BindingKind::Uniform),
        Binding::new("cameras", BindingKind::Uniform),
        Binding::new("shadow_maps", BindingKind::UintLayers),
        Binding::new("soft", BindingKind::Uniform),
        Binding::new("soft_picture", BindingKind::Uints),
    ],
    structs: &[
        params::View::LAYOUT,
        params::LightTerms::LAYOUT,
        params::ShadowCamera::LAYOUT,
        params::ShadowCameras::LAYOUT,
        params::SoftPicture::LAYOUT,
    ],
};

const PASS: Pass = Pass::ShadeSurface;

/// The kernel.
pub struct ShadeSurface {
    built: Built,
    /// Without and with bands 4 and 5 of the light.
    pipelines: [Option<wgpu::RenderPipeline>; 2],
    soft: GrowingBuffer,
    group: BoundGroup,
    depth: KeptTexture,
}

impl ShadeSurface {
    /// Compiles the shader; pipelines follow when they are first asked for.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        Ok(Self {
            built: Built::new(context, &KERNEL)?,
            pipelines: [const { None }; 2],
            soft: GrowingBuffer::uniform("soft picture"),
            group: BoundGroup::default(),
            depth: KeptTexture::scratch("surface depth", wgpu::TextureFormat::Depth32Float),
        })
    }
}

impl DevicePass for ShadeSurface {
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError> {
        let DeviceFrame { recorder, job, scene, .. } = frame;
        let context = recorder.context;
        let has_high_bands = job.light.order > 4;
        let (coarse, present) = (job.coarse_lens(), u32::from(exchange.has(Product::SoftShadows)));
        let step = job.quality.soft_step_px;
        let soft = params::SoftPicture { size_step: [coarse.width, coarse.height, step, present] };
        let slot = &mut self.pipelines[usize::from(has_high_bands)];
        let pipeline = match slot {
            Some(pipeline) => pipeline,
            None => slot.insert(pipeline(context, &self.built, has_high_bands)?),
        };
        let resources = [
            scene.terms.view.bind(context, 0),
            scene.terms.light.bind(context, 0),
            scene.terms.shadow_cameras.bind(context, 0),
            exchange.bind_shadow_maps(context)?,
            self.soft.write(context, bytemuck::bytes_of(&soft)),
            exchange.soft.bind(context),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let (width, height) = (job.input.lens.width, job.input.lens.height);
        let depth = self.depth.sized(context, width, height, 1);
        let ratios = exchange.ratios.sized(context, width, height, 1);
        let targets = Targets { color: cleared(ratios, None, untouched()), depth: Some((depth, 0.0)) };
        recorder.draw(PASS, targets, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            scene.meshes.draw_surfaces(context, pass);
        })
    }
}

fn pipeline(
    context: &GpuContext,
    built: &Built,
    has_high_bands: bool,
) -> Result<wgpu::RenderPipeline, EngineError> {
    let drawing = Drawing {
        vertex: "vertex",
        fragment: "fragment",
        stride: size_of::<SurfaceVertex>() as u64,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x3],
        color: RATIOS_FORMAT,
        write: wgpu::ColorWrites::ALL,
        nearer: wgpu::CompareFunction::Greater,
        samples: 1,
        constants: &[("HIGH_BANDS", f64::from(u8::from(has_high_bands)))],
    };
    built.drawing(context, &drawing)
}
