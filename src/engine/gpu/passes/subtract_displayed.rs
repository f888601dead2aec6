//! `nearfield/subtract_displayed` on the device: an 8-bit target, from which each light is subtracted by blending, in a pass of
//! its own. Twin: `nearfield::subtract_displayed`.

use super::{
    subtract::{LISTED_A_ROW, LISTED_TEXELS, ROWS, Subtraction},
    turns::{Stages, Turns},
};
use crate::{
    EngineError,
    gpu::{
        context::GpuContext,
        kernel::{BoundGroup, Built, Resource},
        kernels,
        textures::KeptTexture,
    },
    model::image::RadianceImage,
    nearfield::subtract_displayed::{DisplayCurve, DisplayedLights},
    plan::Pass,
};

const STAGES: Stages = Stages {
    first: "shown_room",
    writes_first: true,
    one: "one_displayed",
    operation: wgpu::BlendOperation::ReverseSubtract,
    after: "after_displayed",
    format: wgpu::TextureFormat::Rgba8Unorm,
};

/// What is subtracted from.
pub struct Shown<'a> {
    /// The lights in their sets.
    pub lights: &'a DisplayedLights,
    /// The display.
    pub curve: &'a DisplayCurve,
    /// The camera's picture, of the lens's size.
    pub background: &'a RadianceImage,
    /// Of the shown picture: makes exposures of radiance.
    pub exposure_s: f32,
}

/// The kernel, but for what it shares with `nearfield/subtract`.
pub struct Displayed {
    pub built: Built,
    pub turns: Turns,
    pub group: BoundGroup,
    before: KeptTexture,
    exposures: KeptTexture,
    display: KeptTexture,
    texels: Vec<[f32; 4]>,
}

impl Displayed {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &kernels::SUBTRACT_DISPLAYED)?;
        let turns = Turns::new(context, &built, Pass::SubtractDisplayed, &STAGES)?;
        Ok(Self {
            built,
            turns,
            group: BoundGroup::default(),
            before: KeptTexture::uploaded("lights before", wgpu::TextureFormat::Rgba32Float),
            exposures: KeptTexture::uploaded("exposures", wgpu::TextureFormat::Rgba32Float),
            display: KeptTexture::uploaded("display", wgpu::TextureFormat::R32Float),
            texels: Vec::new(),
        })
    }

    /// Uploads what a frame adds to the resources of `nearfield/subtract`, in the order of the kernel's bindings.
    pub fn upload(
        &mut self,
        context: &GpuContext,
        with: &Subtraction<'_>,
        shown: &Shown<'_>,
    ) -> [Resource; 3] {
        let (ranges, listed) = with.frame.lists();
        self.texels.clear();
        for ([begin, end], corners) in ranges.iter().zip(with.triangles) {
            for &k in listed.get(*begin as usize..*end as usize).unwrap_or(&[]) {
                let light = usize::from(k);
                let set = if shown.lights.is_second(light) { 1.0 } else { 0.0 };
                let before = corners.map(|v| shown.lights.before(light, v));
                self.texels.extend(before.map(|[r, g, b]| [r, g, b, set]));
                self.texels.resize(self.texels.len().next_multiple_of(LISTED_TEXELS), [0.0; 4]);
            }
        }
        let rows = listed.len().div_ceil(LISTED_A_ROW).max(1).next_multiple_of(ROWS);
        self.texels.resize(rows * LISTED_A_ROW * LISTED_TEXELS, [0.0; 4]);
        let width = (LISTED_TEXELS * LISTED_A_ROW) as u32;
        self.before.upload(context, width, rows as u32, bytemuck::cast_slice(&self.texels));

        let exposures = shown.background.pixels().iter().map(|rgb| rgb.map(|c| c * shown.exposure_s));
        self.texels.clear();
        self.texels.extend(exposures.map(|[r, g, b]| [r, g, b, 0.0]));
        let (width, height) = (shown.background.width() as u32, shown.background.height() as u32);
        self.exposures.upload(context, width, height, bytemuck::cast_slice(&self.texels));
        self.display.upload(context, 256, 6, bytemuck::bytes_of(&shown.curve.rows()));
        [self.before.bind(context), self.exposures.bind(context), self.display.bind(context)]
    }
}
