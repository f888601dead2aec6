//! What the passes of a frame hand on to each other. Each product may have been made on the device or, where its kernel
//! runs on the twin, on the host; whoever reads it gets it where it needs it.

use half::f16;

use super::{
    buffers::{GrowingBuffer, Readback, whole_words},
    context::GpuContext,
    kernel::Resource,
    point_pages::PointPages,
    recorder::GpuRecorder,
    textures::{KeptLayers, KeptTexture},
};
use crate::{
    EngineError,
    frame::{FrameJob, FrameState},
    model::{image::RadianceImage, picture::Picture},
    plan::{Pass, PassSet, Product},
};

/// The depth's bits as an integer: drawn to, read and copied alike on every backend.
pub const SHADOW_MAP_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Premultiplied radiance in units of the camera's white, and coverage.
pub const OBJECT_LAYER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// The bits of three floats.
pub const RATIOS_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Largest number that goes into the object layer.
const BRIGHTEST: f32 = 6e4;

/// Who holds the newest result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Holder {
    /// It was not made in this frame.
    #[default]
    Nobody,
    /// The twins' memory (or the caller's picture).
    Host,
    /// Held by the GPU alone.
    Device,
    /// Held by the GPU and by the host.
    Both,
}

/// The results on the device, and who holds each.
pub struct Exchange {
    holders: [Holder; Product::ALL.len()],
    /// Depth along each hard light.
    pub shadow_maps: KeptLayers,
    /// Depths from the near lights of a known room.
    pub point_maps: PointPages,
    /// Objects over nothing, in a part of the picture that holds them.
    pub object_layer: KeptTexture,
    /// That part's first column and row.
    pub object_origin: [u32; 2],
    /// What is left of the light on real surfaces.
    pub ratios: KeptTexture,
    /// What is taken of the soft light on real surfaces, and their inverse depth.
    pub soft: KeptTexture,
    /// The composed picture: three floats a pixel.
    pub radiance: GrowingBuffer,
    /// The composed picture: three bytes a pixel.
    pub display: GrowingBuffer,
}

impl Exchange {
    /// Empty.
    pub fn new() -> Self {
        Self {
            holders: [Holder::Nobody; Product::ALL.len()],
            shadow_maps: KeptLayers::result("shadow maps", SHADOW_MAP_FORMAT),
            point_maps: PointPages::new(),
            object_layer: KeptTexture::result("object layer", OBJECT_LAYER_FORMAT),
            object_origin: [0, 0],
            ratios: KeptTexture::result("ratios", RATIOS_FORMAT),
            soft: KeptTexture::result("soft shadows", RATIOS_FORMAT),
            radiance: GrowingBuffer::storage("composed radiance"),
            display: GrowingBuffer::storage("display"),
        }
    }

    /// A new frame begins: nothing is made yet but what is kept.
    pub fn begin(&mut self, kept: PassSet) {
        for product in Product::ALL.into_iter().filter(|product| !kept.make(*product)) {
            self.holders[product as usize] = Holder::Nobody;
        }
    }

    /// Who holds a product.
    pub fn holder(&self, product: Product) -> Holder {
        self.holders[product as usize]
    }

    /// Whether a product is there at all.
    pub fn has(&self, product: Product) -> bool {
        self.holder(product) != Holder::Nobody
    }

    /// Whether the host has a product.
    pub fn is_on_host(&self, product: Product) -> bool {
        matches!(self.holder(product), Holder::Host | Holder::Both)
    }

    /// Notes that the host has made a product, or made it once more.
    pub fn made_on_host(&mut self, product: Product) {
        let holder = &mut self.holders[product as usize];
        *holder = if matches!(holder, Holder::Device | Holder::Both) { Holder::Both } else { Holder::Host };
    }

    /// Notes that the device has made a product, or made it once more.
    pub fn made_on_device(&mut self, product: Product) {
        let holder = &mut self.holders[product as usize];
        *holder = if matches!(holder, Holder::Host | Holder::Both) { Holder::Both } else { Holder::Device };
    }

    /// Brings a product to the host where only the device has it; waits for it.
    pub fn bring_to_host(
        &mut self,
        product: Product,
        recorder: &mut GpuRecorder<'_>,
        job: &FrameJob<'_>,
        state: &mut FrameState,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        if self.holder(product) != Holder::Device {
            return Ok(());
        }
        recorder.submit();
        let context = recorder.context;
        match product {
            Product::ShadowMaps => self.shadow_maps_to_host(context, state)?,
            Product::SoftShadows => self.soft_to_host(context, job, state)?,
            Product::PointMaps => self.point_maps.download(context, state.room.frame.maps_mut())?,
            Product::Ratios => self.ratios_to_host(context, job, state)?,
            Product::ObjectLayer => self.object_layer_to_host(context, job, state)?,
            Product::Radiance => {
                let mut readback = Readback::new("composed radiance");
                self.copy_radiance(recorder, &mut readback, job.size());
                recorder.submit();
                read_radiance(context, &mut readback, job.size(), &mut out.radiance)?;
            }
            // Nothing reads them from here.
            Product::LinearPicture | Product::LightSamples | Product::MeasuredLight | Product::Display => {}
        }
        self.holders[product as usize] = Holder::Both;
        Ok(())
    }

    /// Brings a product to the device where only the host has it.
    pub fn bring_to_device(
        &mut self,
        product: Product,
        context: &GpuContext,
        job: &FrameJob<'_>,
        state: &FrameState,
        out: &Picture,
    ) {
        if self.holder(product) != Holder::Host {
            return;
        }
        match product {
            Product::ShadowMaps => self.shadow_maps_to_device(context, state),
            Product::SoftShadows => {
                let soft = &state.results.soft;
                let (width, height) = (soft.width() as u32, soft.height() as u32);
                self.soft.upload(context, width, height, bytemuck::cast_slice(soft.pixels()));
            }
            Product::PointMaps => self.point_maps.upload(context, state.room.frame.maps()),
            Product::Ratios => {
                let ratios = &state.results.ratios;
                let texels: Vec<[f32; 4]> = ratios.pixels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
                let (width, height) = (ratios.width() as u32, ratios.height() as u32);
                self.ratios.upload(context, width, height, bytemuck::cast_slice(&texels));
            }
            Product::ObjectLayer => self.object_layer_to_device(context, job, state),
            Product::Radiance => {
                self.radiance.write(context, bytemuck::cast_slice(out.radiance.pixels()));
            }
            Product::LinearPicture | Product::LightSamples | Product::MeasuredLight | Product::Display => {}
        }
        self.holders[product as usize] = Holder::Both;
    }

    /// The shadow maps, to bind; stand-ins where there are none.
    pub fn bind_shadow_maps(&mut self, context: &GpuContext) -> Result<Resource, EngineError> {
        let missing = || EngineError::Gpu { pass: Pass::ShadowMaps.name(), reason: "no texture".into() };
        self.shadow_maps.bind(context).ok_or_else(missing)
    }

    fn shadow_maps_to_host(
        &mut self,
        context: &GpuContext,
        state: &mut FrameState,
    ) -> Result<(), EngineError> {
        for k in 0..state.shadows.cameras().len() {
            if state.shadows.cameras()[k].is_some() {
                let texels = self.shadow_maps.download(context, k as u32, Pass::ShadowMaps.name())?;
                state.shadows.set_depth(k, bytemuck::pod_collect_to_vec(&texels));
            }
        }
        Ok(())
    }

    fn shadow_maps_to_device(&mut self, context: &GpuContext, state: &FrameState) {
        let cameras = state.shadows.cameras();
        if let Some(side) = cameras.iter().flatten().map(|c| c.texels).next() {
            self.shadow_maps.sized(context, side, cameras.len() as u32);
        }
        for k in (0..cameras.len()).filter(|&k| cameras[k].is_some()) {
            self.shadow_maps.upload(context, k as u32, bytemuck::cast_slice(state.shadows.depth(k)));
        }
    }

    fn soft_to_host(
        &mut self,
        context: &GpuContext,
        job: &FrameJob<'_>,
        state: &mut FrameState,
    ) -> Result<(), EngineError> {
        let texels = self.soft.download(context, Pass::SoftShadow.name())?;
        let texels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&texels);
        let (lens, soft) = (job.coarse_lens(), &mut state.results.soft);
        soft.reshape(lens.width as usize, lens.height as usize, [0.0; 4]);
        for (pixel, texel) in soft.pixels_mut().iter_mut().zip(texels) {
            *pixel = texel;
        }
        Ok(())
    }

    fn ratios_to_host(
        &mut self,
        context: &GpuContext,
        job: &FrameJob<'_>,
        state: &mut FrameState,
    ) -> Result<(), EngineError> {
        let texels = self.ratios.download(context, Pass::ShadeSurface.name())?;
        let texels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&texels);
        let (width, height) = job.size();
        state.results.ratios.reshape(width, height, [1.0; 3]);
        for (pixel, &[r, g, b, _]) in state.results.ratios.pixels_mut().iter_mut().zip(&texels) {
            *pixel = [r, g, b];
        }
        Ok(())
    }

    /// The device's layer is radiance times the exposure of white.
    fn object_layer_to_host(
        &mut self,
        context: &GpuContext,
        job: &FrameJob<'_>,
        state: &mut FrameState,
    ) -> Result<(), EngineError> {
        let texels = self.object_layer.download(context, Pass::ShadeObject.name())?;
        let texels: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(&texels);
        let scale = scale_of_layer(job);
        let (width, height) = job.size();
        let layer = &mut state.results.object_layer;
        layer.reshape(width, height, [0.0; 4]);
        let [x, y] = self.object_origin.map(|first| first as usize);
        let columns = (self.object_layer.size().0 as usize).min(width.saturating_sub(x));
        let rows = layer.pixels_mut().chunks_exact_mut(width.max(1)).skip(y);
        for (row, texels) in rows.zip(texels.chunks_exact(columns.max(1))) {
            for (pixel, texel) in row[x..x + columns].iter_mut().zip(texels) {
                *pixel = std::array::from_fn(|i| f16::from_bits(texel[i]).to_f32() / scale[i]);
            }
        }
        Ok(())
    }

    fn object_layer_to_device(&mut self, context: &GpuContext, job: &FrameJob<'_>, state: &FrameState) {
        let (layer, scale) = (&state.results.object_layer, scale_of_layer(job));
        let half = |pixel: &[f32; 4]| -> [u16; 4] {
            std::array::from_fn(|i| f16::from_f32((pixel[i] * scale[i]).min(BRIGHTEST)).to_bits())
        };
        let texels: Vec<[u16; 4]> = layer.pixels().iter().map(half).collect();
        let (width, height) = (layer.width() as u32, layer.height() as u32);
        self.object_layer.upload(context, width, height, bytemuck::cast_slice(&texels));
        self.object_origin = [0, 0];
    }

    /// Records a copy of the composed picture to where [`read_radiance`] reads it.
    pub fn copy_radiance(
        &mut self,
        recorder: &mut GpuRecorder<'_>,
        readback: &mut Readback,
        (width, height): (usize, usize),
    ) {
        let (context, bytes) = (recorder.context, 12 * width * height);
        let target = readback.at_least(context, bytes).clone();
        recorder.copy(self.radiance.at_least(context, bytes), &target, 0, whole_words(bytes));
    }
}

/// Reads a composed picture that was copied and submitted; waits for it.
fn read_radiance(
    context: &GpuContext,
    readback: &mut Readback,
    (width, height): (usize, usize),
    out: &mut RadianceImage,
) -> Result<(), EngineError> {
    out.reshape(width, height, [0.0; 3]);
    let target: &mut [u8] = bytemuck::cast_slice_mut(out.pixels_mut());
    readback.read(context, Pass::Composite.name(), target.len(), |bytes| target.copy_from_slice(bytes))
}

/// Ratios where no virtual object takes anything.
pub fn untouched() -> wgpu::Color {
    let one = f64::from(1.0f32.to_bits());
    wgpu::Color { r: one, g: one, b: one, a: 0.0 }
}

fn scale_of_layer(job: &FrameJob<'_>) -> [f32; 4] {
    let exposure = job.exposure_of_white();
    [exposure, exposure, exposure, 1.0]
}
