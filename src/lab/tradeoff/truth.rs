//! What pictures are held against: a case's own picture, or one traced here.

use super::errors::{PictureTruth, SHADOW_BELOW};
use crate::assets::{error::AssetError, pictures::load_gray8};
use crate::case::Case;
use crate::error::LabError;
use crate::math::color::gray;
use crate::model::{image::RadianceImage, quality::Quality};
use crate::open_exr::load_raw;
use crate::reference::{TraceSettings, Traced, Tracer};
use crate::still::{
    Still,
    traced::{LightOf, of_still},
};

/// Names of a case's pictures without objects.
const WITHOUT_OBJECTS: [&str; 2] = ["without", "noobj"];

/// The case's own picture. Its objects are where its masks have any coverage. What they take is told from the case's own
/// picture without them; a case that has none is held against ours.
///
/// # Errors
/// A picture or mask cannot be read, or has another size than the still.
pub fn of_case(case: &Case, image: &str, still: &Still) -> Result<PictureTruth, AssetError> {
    let size = (still.background.radiance.width(), still.background.radiance.height());
    let fits = |what: &str, found: (usize, usize)| match found == size {
        true => Ok(()),
        false => Err(AssetError::new(&case.file, format!("size of {what}"))
            .value(format!("{} x {}", found.0, found.1))
            .allowed(format!("{} x {}", size.0, size.1))),
    };
    let read = |name: &str| {
        let picture = load_raw(&case.image(name)?.file)?;
        fits(name, (picture.width(), picture.height()))?;
        Ok::<_, AssetError>(picture)
    };
    let radiance = read(image)?;
    let own = WITHOUT_OBJECTS.into_iter().find(|&name| case.images.iter().any(|i| i.name == name));
    let (without, beside) = match own {
        Some(name) => (read(name)?, format!("the case's own {name}")),
        None => (still.background.radiance.clone(), "our picture without objects".to_owned()),
    };
    let mut place = vec![1.0f32; size.0 * size.1];
    for mask in case.images.iter().filter(|m| m.is_mask()) {
        let coverage = load_gray8(&mask.file)?;
        fits(&mask.name, (coverage.width(), coverage.height()))?;
        let filled = coverage.pixels().iter().map(|&c| 1.0 - f32::from(c) / 255.0);
        place.iter_mut().zip(filled).for_each(|(p, left)| *p = p.min(left));
    }
    let made_by = format!("the case's own {image}, beside {beside}");
    Ok(PictureTruth { radiance, without, place, noise: None, difference_noise: 0.0, made_by })
}

/// A truth that is traced here: the objects over the still's own background, whose surfaces are dimmed by what is left of
/// their light. It can be traced on.
pub struct TruthTrace {
    tracer: Tracer,
    /// The still's background.
    without: RadianceImage,
}

impl TruthTrace {
    /// Makes a still ready for so many rays a pixel; nothing is traced yet.
    ///
    /// # Errors
    /// An environment picture that cannot be read; a scene that cannot be traced.
    pub fn begin(
        still: &Still,
        light: LightOf<'_>,
        quality: &Quality,
        samples: usize,
    ) -> Result<Self, LabError> {
        let scene = of_still(light, still, quality)?;
        let samples = u32::try_from(samples).unwrap_or(u32::MAX);
        let settings = TraceSettings {
            samples,
            samples_a_pass: (samples / 8).next_power_of_two().clamp(1, 64),
            ..TraceSettings::default()
        };
        let tracer = Tracer::new(&scene, &settings).map_err(|e| LabError::on("truth", e))?;
        Ok(Self { tracer, without: still.background.radiance.clone() })
    }

    /// Rays a pixel so far.
    pub fn samples(&self) -> usize {
        self.tracer.samples() as usize
    }

    /// Traces until there are so many rays a pixel. `done` is told the share that it has of them.
    ///
    /// # Errors
    /// A number of rays out of range; a still whose pictures have different sizes.
    pub fn trace_to(&mut self, samples: usize, done: &dyn Fn(f32)) -> Result<PictureTruth, LabError> {
        let aim = u32::try_from(samples).unwrap_or(u32::MAX);
        self.tracer.aim_at(aim).map_err(|e| LabError::on("truth", e))?;
        while !self.tracer.is_done() {
            self.tracer.pass();
            done((self.samples() as f32 / samples as f32).min(1.0));
        }
        let traced = self.tracer.so_far();
        let radiance = traced.over(&self.without).ok_or_else(|| {
            LabError::on("truth", "the picture of the place has another size than the camera's")
        })?;
        let place: Vec<f32> = traced.coverage().pixels().iter().map(|c| 1.0 - c).collect();
        let (noise, difference_noise) = noise(&traced, &place).unzip();
        let made_by = format!("traced here with {} rays a pixel, direct light", traced.samples);
        Ok(PictureTruth {
            radiance,
            without: self.without.clone(),
            place,
            noise,
            difference_noise: difference_noise.unwrap_or(0.0),
            made_by,
        })
    }
}

/// Standard error of the share of light left, summed over the place and over the mean share taken in shadow, as
/// `PictureErrors::shadow` is; and what it can make of the difference of two such errors.
///
/// Two pictures a and b are held against one truth, whose noise t they share: the squares of their errors differ by the mean of
/// 2 (b - a) t beside what they should. Over k pixels that are independent its standard error is 2 noise rms(b - a) / sqrt(k), and
/// rms(b - a) is at most the sum of both errors. The errors themselves then differ by at most 2 noise / sqrt(k) beside what
/// they should; twice that is given.
fn noise(traced: &Traced, place: &[f32]) -> Option<(f64, f64)> {
    let (ratio, error) = (traced.ratio(), traced.ratio_error());
    let (mut squares, mut depth, mut count) = (0.0, 0.0, 0.0);
    for ((ratio, error), place) in ratio.pixels().iter().zip(error.pixels()).zip(place) {
        let left = gray(ratio.map(f64::from));
        let off = gray(error.map(f64::from)).powi(2);
        if *place >= 1.0 && off.is_finite() {
            squares += off;
            if left < SHADOW_BELOW {
                depth += 1.0 - left;
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| {
        let noise = f64::sqrt(squares / count) / (depth / count);
        (noise, 4.0 * noise / f64::sqrt(count))
    })
}
