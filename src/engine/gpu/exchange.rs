//! What the passes of a frame hand on to each other. Each may have been made on the device or, where its kernel
//! runs on the twin, on the host; whoever reads it gets it where it needs it.

use half::f16;

use super::{
    buffers::{GrowingBuffer, Readback, whole_words},
    context::GpuContext,
    kernel::Resource,
    point_pages::PointPages,
    recorder::Recorder,
    textures::{KeptLayers, KeptTexture},
};
use crate::{
    EngineError,
    cpu::Work,
    model::image::RadianceImage,
    plan::{Pass, PassSet},
};

/// The depth's bits as an integer: drawn to, read and copied alike on every backend.
pub const SHADOW_MAP_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Premultiplied radiance in units of the camera's white, and coverage.
pub const OBJECT_LAYER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// The bits of three floats.
pub const RATIOS_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Largest number that goes into the object layer.
const BRIGHTEST: f32 = 6e4;

/// Where the newest result is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// Not made in this frame.
    #[default]
    Nowhere,
    /// In the twins' memory (or the caller's picture).
    Host,
    /// On the device.
    Device,
    /// On both.
    Both,
}

impl Place {
    /// Whether there is a result.
    pub fn is_somewhere(self) -> bool {
        self != Self::Nowhere
    }
}

/// The results on the device, and where each is.
pub struct Exchange {
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
    readback: Readback,
    /// Where the shadow maps are.
    pub shadow_place: Place,
    /// Where the near lights' maps are.
    pub point_place: Place,
    /// Where the soft shadows are.
    pub soft_place: Place,
    /// Where the object layer is.
    pub object_place: Place,
    /// Where the ratios are.
    pub ratio_place: Place,
    /// Where the composed picture is.
    pub radiance_place: Place,
}

impl Exchange {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            shadow_maps: KeptLayers::result("shadow maps", SHADOW_MAP_FORMAT),
            point_maps: PointPages::new(),
            object_layer: KeptTexture::result("object layer", OBJECT_LAYER_FORMAT),
            object_origin: [0, 0],
            ratios: KeptTexture::result("ratios", RATIOS_FORMAT),
            soft: KeptTexture::result("soft shadows", RATIOS_FORMAT),
            radiance: GrowingBuffer::storage("composed radiance"),
            readback: Readback::new("composed radiance"),
            shadow_place: Place::Nowhere,
            point_place: Place::Nowhere,
            soft_place: Place::Nowhere,
            object_place: Place::Nowhere,
            ratio_place: Place::Nowhere,
            radiance_place: Place::Nowhere,
        }
    }

    /// A new frame: nothing is made yet but what is kept.
    pub fn begin(&mut self, kept: PassSet) {
        for (place, passes) in [
            (&mut self.shadow_place, &[Pass::ShadowMaps][..]),
            (&mut self.point_place, &[Pass::PointMaps]),
            (&mut self.soft_place, &[Pass::SoftShadow]),
            (&mut self.object_place, &[Pass::ShadeObject]),
            (&mut self.ratio_place, &[Pass::Subtract, Pass::SubtractDisplayed, Pass::ShadeSurface]),
            (&mut self.radiance_place, &[]),
        ] {
            if !passes.iter().any(|pass| kept.has(*pass)) {
                *place = Place::Nowhere;
            }
        }
    }

    /// Brings the shadow maps to the twins.
    pub fn shadow_to_host(
        &mut self,
        recorder: &mut Recorder<'_>,
        twins: &mut Work,
    ) -> Result<(), EngineError> {
        if self.shadow_place == Place::Device {
            recorder.submit();
            for k in 0..twins.shadows.cameras().len() {
                if twins.shadows.cameras()[k].is_some() {
                    let pass = Pass::ShadowMaps.name();
                    let texels = self.shadow_maps.download(recorder.context, k as u32, pass)?;
                    twins.shadows.set_depth(k, bytemuck::pod_collect_to_vec(&texels));
                }
            }
            self.shadow_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the shadow maps to the device, and binds them.
    pub fn shadow_to_device(
        &mut self,
        recorder: &Recorder<'_>,
        twins: &Work,
    ) -> Result<Resource, EngineError> {
        let context = recorder.context;
        if self.shadow_place == Place::Host {
            let cameras = twins.shadows.cameras();
            if let Some(side) = cameras.iter().flatten().map(|c| c.texels).next() {
                self.shadow_maps.sized(context, side, cameras.len() as u32);
            }
            for k in (0..cameras.len()).filter(|&k| cameras[k].is_some()) {
                self.shadow_maps.upload(context, k as u32, bytemuck::cast_slice(twins.shadows.depth(k)));
            }
            self.shadow_place = Place::Both;
        }
        let missing = || EngineError::Gpu { pass: "visibility/shadow_maps", reason: "no texture".into() };
        self.shadow_maps.bind(context).ok_or_else(missing)
    }

    /// Brings the near lights' maps to the twins.
    pub fn points_to_host(
        &mut self,
        recorder: &mut Recorder<'_>,
        twins: &mut Work,
    ) -> Result<(), EngineError> {
        if self.point_place == Place::Device {
            recorder.submit();
            self.point_maps.download(recorder.context, twins.room.frame.maps_mut())?;
            self.point_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the near lights' maps to the device.
    pub fn points_to_device(&mut self, recorder: &Recorder<'_>, twins: &Work) {
        if self.point_place == Place::Host {
            self.point_maps.upload(recorder.context, twins.room.frame.maps());
            self.point_place = Place::Both;
        }
    }

    /// Brings the soft shadows to the twins.
    pub fn soft_to_host(
        &mut self,
        recorder: &mut Recorder<'_>,
        twins: &mut Work,
        size: (usize, usize),
    ) -> Result<(), EngineError> {
        if self.soft_place == Place::Device {
            recorder.submit();
            let texels = self.soft.download(recorder.context, Pass::SoftShadow.name())?;
            let texels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&texels);
            twins.soft.reshape(size.0, size.1, [0.0; 4]);
            for (pixel, texel) in twins.soft.pixels_mut().iter_mut().zip(texels) {
                *pixel = texel;
            }
            self.soft_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the soft shadows to the device, and binds them.
    pub fn soft_to_device(&mut self, recorder: &Recorder<'_>, twins: &Work) -> Resource {
        if self.soft_place == Place::Host {
            let (width, height) = (twins.soft.width() as u32, twins.soft.height() as u32);
            self.soft.upload(recorder.context, width, height, bytemuck::cast_slice(twins.soft.pixels()));
            self.soft_place = Place::Both;
        }
        self.soft.bind(recorder.context)
    }

    /// Brings the object layer to the twins; the device's is radiance times `exposure`.
    pub fn objects_to_host(
        &mut self,
        recorder: &mut Recorder<'_>,
        twins: &mut Work,
        size: (usize, usize),
        exposure: f32,
    ) -> Result<(), EngineError> {
        if self.object_place == Place::Device {
            recorder.submit();
            let texels = self.object_layer.download(recorder.context, Pass::ShadeObject.name())?;
            let texels: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(&texels);
            let scale = [exposure, exposure, exposure, 1.0];
            twins.object_layer.reshape(size.0, size.1, [0.0; 4]);
            let [x, y] = self.object_origin.map(|first| first as usize);
            let columns = (self.object_layer.size().0 as usize).min(size.0.saturating_sub(x));
            let rows = twins.object_layer.pixels_mut().chunks_exact_mut(size.0.max(1)).skip(y);
            for (row, texels) in rows.zip(texels.chunks_exact(columns.max(1))) {
                for (pixel, texel) in row[x..x + columns].iter_mut().zip(texels) {
                    *pixel = std::array::from_fn(|i| f16::from_bits(texel[i]).to_f32() / scale[i]);
                }
            }
            self.object_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the object layer to the device, and binds it.
    pub fn objects_to_device(&mut self, recorder: &Recorder<'_>, twins: &Work, exposure: f32) -> Resource {
        if self.object_place == Place::Host {
            let layer = &twins.object_layer;
            let scale = [exposure, exposure, exposure, 1.0];
            let half = |pixel: &[f32; 4]| -> [u16; 4] {
                std::array::from_fn(|i| f16::from_f32((pixel[i] * scale[i]).min(BRIGHTEST)).to_bits())
            };
            let texels: Vec<[u16; 4]> = layer.pixels().iter().map(half).collect();
            let (width, height) = (layer.width() as u32, layer.height() as u32);
            self.object_layer.upload(recorder.context, width, height, bytemuck::cast_slice(&texels));
            self.object_origin = [0, 0];
            self.object_place = Place::Both;
        }
        self.object_layer.bind(recorder.context)
    }

    /// Brings the ratios to the twins.
    pub fn ratios_to_host(
        &mut self,
        recorder: &mut Recorder<'_>,
        twins: &mut Work,
        size: (usize, usize),
    ) -> Result<(), EngineError> {
        if self.ratio_place == Place::Device {
            recorder.submit();
            let texels = self.ratios.download(recorder.context, Pass::ShadeSurface.name())?;
            let texels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&texels);
            twins.ratio.reshape(size.0, size.1, [1.0; 3]);
            for (pixel, &[r, g, b, _]) in twins.ratio.pixels_mut().iter_mut().zip(&texels) {
                *pixel = [r, g, b];
            }
            self.ratio_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the ratios to the device, and binds them.
    pub fn ratios_to_device(&mut self, recorder: &Recorder<'_>, twins: &Work) -> Resource {
        if self.ratio_place == Place::Host {
            let ratio = &twins.ratio;
            let texels: Vec<[f32; 4]> = ratio.pixels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
            let (width, height) = (ratio.width() as u32, ratio.height() as u32);
            self.ratios.upload(recorder.context, width, height, bytemuck::cast_slice(&texels));
            self.ratio_place = Place::Both;
        }
        self.ratios.bind(recorder.context)
    }

    /// Records the copy of the composed picture that `radiance_to_host` reads.
    pub fn copy_radiance(&mut self, recorder: &mut Recorder<'_>, bytes: usize) {
        let context = recorder.context;
        let target = self.readback.at_least(context, bytes).clone();
        recorder.copy(self.radiance.at_least(context, bytes), &target, 0, whole_words(bytes));
    }

    /// Reads what was copied last, after it was submitted.
    pub fn radiance_to_host(
        &mut self,
        context: &GpuContext,
        size: (usize, usize),
        out: &mut RadianceImage,
    ) -> Result<(), EngineError> {
        if self.radiance_place == Place::Device {
            out.reshape(size.0, size.1, [0.0; 3]);
            let target: &mut [u8] = bytemuck::cast_slice_mut(out.pixels_mut());
            self.readback.read(context, Pass::Composite.name(), target.len(), |bytes| {
                target.copy_from_slice(bytes);
            })?;
            self.radiance_place = Place::Both;
        }
        Ok(())
    }

    /// Brings the composed picture to the device, and binds it.
    pub fn radiance_to_device(&mut self, recorder: &Recorder<'_>, radiance: &RadianceImage) -> Resource {
        let bytes = bytemuck::cast_slice(radiance.pixels());
        if self.radiance_place == Place::Host {
            self.radiance_place = Place::Both;
            return self.radiance.write(recorder.context, bytes);
        }
        self.radiance.bind(recorder.context, 0)
    }
}
