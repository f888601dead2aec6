//! What is kept of the samples, and what it says about pictures and their noise.

use super::path::RadiancePair;
use crate::math::color::gray;
use crate::model::image::{Image, RadianceImage};
use glam::Vec3;

/// A pixel counts as shadowed where the gray ratio is below this (as `halflight render --compare` has it).
pub const SHADOW_BELOW: f64 = 0.93;
/// Channels: red, green, blue, gray.
const CHANNELS: usize = 4;
/// Numbers of a pixel.
pub(super) const NUMBERS: usize = 5 * CHANNELS + 3 + 1;

/// Sums over the passes of one pixel; each pass counts by its mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PixelSums {
    with: [f64; CHANNELS],
    without: [f64; CHANNELS],
    with_squared: [f64; CHANNELS],
    without_squared: [f64; CHANNELS],
    product: [f64; CHANNELS],
    /// Light that comes from virtual bodies, part of `with`.
    objects: [f64; 3],
    /// Share of the samples that met a virtual body.
    covered: f64,
}

/// Sums over the samples of one pass.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassSums {
    light: RadiancePair,
    objects: Vec3,
    covered: u32,
    /// Samples that were not finite, left out.
    pub dropped: u32,
}

impl PassSums {
    /// Counts what one path saw.
    #[inline]
    pub fn add(&mut self, seen: &super::path::RaySample) {
        let RadiancePair { with, without } = seen.light;
        if !(with.is_finite() && without.is_finite()) {
            self.dropped += 1;
            return;
        }
        self.light.with += with;
        self.light.without += without;
        if seen.covered {
            self.objects += with;
            self.covered += 1;
        }
    }
}

impl PixelSums {
    /// Adds a pass of so many samples.
    pub fn add(&mut self, pass: &PassSums, samples: u32) {
        let count = f64::from(samples.saturating_sub(pass.dropped).max(1));
        let four = |rgb: Vec3| {
            let [r, g, b] = rgb.to_array().map(|c| f64::from(c) / count);
            [r, g, b, gray([r, g, b])]
        };
        let (with, without) = (four(pass.light.with), four(pass.light.without));
        for c in 0..CHANNELS {
            self.with[c] += with[c];
            self.without[c] += without[c];
            self.with_squared[c] += with[c] * with[c];
            self.without_squared[c] += without[c] * without[c];
            self.product[c] += with[c] * without[c];
        }
        for (sum, c) in self.objects.iter_mut().zip(pass.objects.to_array()) {
            *sum += f64::from(c) / count;
        }
        self.covered += f64::from(pass.covered) / count;
    }

    /// Means, variances of the means and their covariance, of one channel after so many passes.
    fn moments(&self, channel: usize, passes: u32) -> Moments {
        let n = f64::from(passes);
        let (with, without) = (self.with[channel] / n, self.without[channel] / n);
        let spread = |square: f64, a: f64, b: f64| {
            if passes > 1 { (square / n - a * b) / (n - 1.0) } else { f64::NAN }
        };
        Moments {
            with,
            without,
            with_variance: spread(self.with_squared[channel], with, with).max(0.0),
            without_variance: spread(self.without_squared[channel], without, without).max(0.0),
            covariance: spread(self.product[channel], with, without),
        }
    }
}

/// Of one channel of one pixel.
#[derive(Clone, Copy, Debug)]
struct Moments {
    with: f64,
    without: f64,
    with_variance: f64,
    without_variance: f64,
    covariance: f64,
}

impl Moments {
    /// with / without; 1 where there is no light at all.
    fn ratio(&self) -> f64 {
        if self.without > 0.0 { self.with / self.without } else { 1.0 }
    }

    /// Of the ratio, to first order.
    fn ratio_variance(&self) -> f64 {
        if !(self.without > 0.0) {
            return 0.0;
        }
        let ratio = self.ratio();
        let sum = self.with_variance - 2.0 * ratio * self.covariance + ratio * ratio * self.without_variance;
        sum.max(0.0) / (self.without * self.without)
    }

    fn difference_variance(&self) -> f64 {
        (self.with_variance - 2.0 * self.covariance + self.without_variance).max(0.0)
    }
}

/// How noisy a pair of pictures is. Standard errors are estimated from the spread of the passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TraceNoise {
    /// Root mean square standard error of the picture with the objects over its mean, all channels. Not a number after a
    /// single pass, like the others.
    pub with_relative: f64,
    /// The same of the picture without.
    pub without_relative: f64,
    /// Pixels in shadow: no object covers them, and the gray ratio is below [`SHADOW_BELOW`].
    pub shadow_pixels: usize,
    /// What noise adds to a relative RMSE of the gray ratio over them (root mean square standard error over the mean ratio);
    /// 0 where nothing is in shadow.
    pub shadow_relative: f64,
    /// Samples that were not finite and were left out.
    pub dropped: u64,
}

/// The two pictures. Pixels are in rows; where only every k-th was traced (`TraceSettings::step_px`) the pictures are so
/// much smaller.
#[derive(Clone, Debug, PartialEq)]
pub struct Traced {
    width: usize,
    step_px: u32,
    passes: u32,
    /// Samples of each pixel.
    pub samples: u32,
    sums: Vec<PixelSums>,
    /// How noisy they are.
    pub noise: TraceNoise,
}

impl Traced {
    pub(super) fn new(
        [width, step_px]: [u32; 2],
        sums: Vec<PixelSums>,
        passes: u32,
        samples: u32,
        dropped: u64,
    ) -> Self {
        let noise = noise(&sums, passes, dropped);
        Self { width: width as usize, step_px, passes, samples, sums, noise }
    }

    /// Column or row of the whole picture that a column or row of these stands for.
    pub fn full_px(&self, index: usize) -> usize {
        full_px(index, self.step_px)
    }

    fn picture<P: Clone + Default>(&self, pixel: impl Fn(&PixelSums) -> P) -> Image<P> {
        let pixels: Vec<P> = self.sums.iter().map(pixel).collect();
        let height = pixels.len().checked_div(self.width).unwrap_or(0);
        Image::from_pixels(self.width, height, pixels).unwrap_or_default()
    }

    fn of_moments(&self, number: impl Fn(&Moments) -> f64) -> RadianceImage {
        self.picture(|sums| std::array::from_fn(|c| number(&sums.moments(c, self.passes)) as f32))
    }

    /// Radiance with the virtual bodies.
    pub fn with(&self) -> RadianceImage {
        self.of_moments(|m| m.with)
    }

    /// Radiance without them.
    pub fn without(&self) -> RadianceImage {
        self.of_moments(|m| m.without)
    }

    /// With over without; 1 where nothing is lit.
    pub fn ratio(&self) -> RadianceImage {
        self.of_moments(Moments::ratio)
    }

    /// Without less with: what the objects take away; negative where they add light.
    pub fn difference(&self) -> RadianceImage {
        self.of_moments(|m| m.without - m.with)
    }

    /// Standard error of `with`.
    pub fn with_error(&self) -> RadianceImage {
        self.of_moments(|m| m.with_variance.sqrt())
    }

    /// Standard error of `without`.
    pub fn without_error(&self) -> RadianceImage {
        self.of_moments(|m| m.without_variance.sqrt())
    }

    /// Standard error of `ratio`, to first order.
    pub fn ratio_error(&self) -> RadianceImage {
        self.of_moments(|m| m.ratio_variance().sqrt())
    }

    /// Standard error of `difference`.
    pub fn difference_error(&self) -> RadianceImage {
        self.of_moments(|m| m.difference_variance().sqrt())
    }

    /// Share of each pixel that virtual bodies cover.
    pub fn coverage(&self) -> Image<f32> {
        self.picture(|sums| (sums.covered / f64::from(self.passes)) as f32)
    }

    /// Radiance of the virtual bodies times their coverage.
    pub fn objects(&self) -> RadianceImage {
        self.picture(|sums| sums.objects.map(|c| (c / f64::from(self.passes)) as f32))
    }

    /// Differential rendering: the virtual bodies over a picture of the place, whose surfaces are dimmed by the ratio of what
    /// is left of their light. The albedo that the real surfaces were traced with does not matter then. The picture is the
    /// whole one; where only every k-th pixel was traced, so much smaller a one is given. `None` where it has another size.
    pub fn over(&self, place: &RadianceImage) -> Option<RadianceImage> {
        let height = self.sums.len().checked_div(self.width)?;
        let fits = |whole: usize, traced: usize| traced == traced_px(whole as u32, self.step_px);
        if !fits(place.width(), self.width) || !fits(place.height(), height) {
            return None;
        }
        let passes = f64::from(self.passes);
        let pixels = self.sums.iter().enumerate().map(|(i, sums)| {
            let place = place.at(self.full_px(i % self.width), self.full_px(i / self.width));
            let open = 1.0 - (sums.covered / passes).min(1.0);
            std::array::from_fn(|c| {
                let surface = sums.with[c] - sums.objects[c];
                let ratio = if sums.without[c] > 0.0 { surface / sums.without[c] } else { open };
                (sums.objects[c] / passes + f64::from(place[c]) * ratio) as f32
            })
        });
        Image::from_pixels(self.width, height, pixels.collect())
    }
}

/// The first pixel is the middle one of the first step.
fn full_px(index: usize, step_px: u32) -> usize {
    step_px as usize / 2 + index * step_px as usize
}

/// How many pixels of a side are traced.
pub(super) fn traced_px(whole: u32, step_px: u32) -> usize {
    (step_px / 2..whole).step_by(step_px.max(1) as usize).count()
}

/// The noise of sums after so many passes.
pub(super) fn noise(sums: &[PixelSums], passes: u32, dropped: u64) -> TraceNoise {
    let (mut with, mut without) = ([0.0f64; 2], [0.0f64; 2]);
    let (mut shadow, mut variance, mut shadow_pixels) = (0.0, 0.0, 0usize);
    for pixel in sums {
        for c in 0..3 {
            let m = pixel.moments(c, passes);
            with[0] += m.with;
            with[1] += m.with_variance;
            without[0] += m.without;
            without[1] += m.without_variance;
        }
        let gray = pixel.moments(3, passes);
        if pixel.covered == 0.0 && gray.without > 0.0 && gray.ratio() < SHADOW_BELOW {
            shadow_pixels += 1;
            shadow += gray.ratio();
            variance += gray.ratio_variance();
        }
    }
    let count = (3 * sums.len()).max(1) as f64;
    let relative = |[sum, variance]: [f64; 2], count: f64| {
        if sum > 0.0 { (variance / count).sqrt() / (sum / count) } else { 0.0 }
    };
    TraceNoise {
        with_relative: relative(with, count),
        without_relative: relative(without, count),
        shadow_pixels,
        shadow_relative: relative([shadow, variance], (shadow_pixels.max(1)) as f64),
        dropped,
    }
}
