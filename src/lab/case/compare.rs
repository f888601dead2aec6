//! A still against the case's own picture.

use super::Case;
use crate::assets::{error::AssetError, pictures::load_gray8};
use crate::math::color;
use crate::model::image::{Image, RadianceImage};
use crate::open_exr::load_raw;
use crate::still::{Drawn, PictureQuantity, Still};
use std::fmt;

/// A pixel counts as shadowed where the true gray ratio is below this (spec 4b measures there, too).
const SHADOW_BELOW: f64 = 0.93;

/// Error inside one mask.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskError {
    /// The mask's name in the case.
    pub name: String,
    /// Pixels wholly covered.
    pub pixels: usize,
    /// Root of the mean squared error over the mean of the truth, all channels; over the whole picture's mean
    /// for an object that is darker than a hundredth of it.
    pub relative_rmse: f64,
    /// Mean of ours over mean of the truth.
    pub mean_ratio: f64,
}

/// Error of the gray ratio to the unshadowed receivers where it is below 0.93 in truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowError {
    /// How many were compared.
    pub pixels: usize,
    /// Root of the mean squared error, in ratio.
    pub rmse: f64,
    /// The same over the mean true ratio.
    pub relative_rmse: f64,
    /// Median of ours over the truth, where the truth is above 0.
    pub median_ratio: f64,
}

/// A still against the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The image of the case.
    pub image: String,
    /// Over all pixels and channels: root of the mean squared error over the mean of the truth.
    pub relative_rmse: f64,
    /// The same where no mask has any coverage (the receivers).
    pub receivers_relative_rmse: f64,
    /// Median over receiver pixels of our gray over the true gray.
    pub receivers_median_ratio: f64,
    /// Objects.
    pub masks: Vec<MaskError>,
    /// `None` where nothing is shadowed.
    pub shadow: Option<ShadowError>,
}

/// Compares with the case's own picture. Masks: all of the case whose objects can be in the image (`mask_table`
/// belongs to `obj_table` and `diff_table`).
///
/// # Errors
/// A picture or mask cannot be read, or has another size than the still.
pub fn compare(case: &Case, image: &str, still: &Still, drawn: &Drawn) -> Result<Comparison, AssetError> {
    let truth = load_raw(&case.image(image)?.file)?;
    let (width, height) = (drawn.radiance.width(), drawn.radiance.height());
    let fits = |what: &str, w: usize, h: usize| {
        if (w, h) == (width, height) {
            Ok(())
        } else {
            let size = format!("{w} x {h}");
            Err(AssetError::new(&case.file, format!("size of {what}"))
                .value(size)
                .allowed(format!("{width} x {height}")))
        }
    };
    fits(image, truth.width(), truth.height())?;
    let mut masks: Vec<(String, Image<u8>)> = Vec::new();
    for mask in case.images.iter().filter(|m| m.is_mask() && belongs(case, &m.name, image)) {
        let coverage = load_gray8(&mask.file)?;
        fits(&mask.name, coverage.width(), coverage.height())?;
        masks.push((mask.name.clone(), coverage));
    }
    let ours = drawn.radiance.pixels();
    let open: Vec<usize> =
        (0..ours.len()).filter(|&i| masks.iter().all(|(_, m)| m.pixels()[i] == 0)).collect();
    let inside = |mask: &Image<u8>| (0..ours.len()).filter(|&i| mask.pixels()[i] == 255).collect::<Vec<_>>();
    let errors = masks.iter().filter(|(name, _)| name != "mask_emitters").map(|(name, mask)| {
        let pixels = inside(mask);
        let (relative_rmse, mean_ratio) = relative_error(&drawn.radiance, &truth, &pixels);
        MaskError { name: name.clone(), pixels: pixels.len(), relative_rmse, mean_ratio }
    });
    let all: Vec<usize> = (0..ours.len()).collect();
    let gray = |picture: &RadianceImage, i: usize| f64::from(color::gray(picture.pixels()[i]));
    Ok(Comparison {
        image: image.to_string(),
        relative_rmse: relative_error(&drawn.radiance, &truth, &all).0,
        receivers_relative_rmse: relative_error(&drawn.radiance, &truth, &open).0,
        receivers_median_ratio: median(
            open.iter().map(|&i| gray(&drawn.radiance, i) / gray(&truth, i)).collect(),
        ),
        masks: errors.collect(),
        shadow: shadow_error(still, drawn, &truth, &open),
    })
}

/// Whether a mask can cover objects of an image.
fn belongs(case: &Case, mask: &str, image: &str) -> bool {
    let what = mask.strip_prefix("mask_").unwrap_or(mask);
    let present = case.objects(Some(image)).unwrap_or_default();
    // Masks by place (F3) serve only images of that place; masks by object only images that show it.
    let by_place = image.rsplit_once('_').filter(|(kind, _)| ["obj", "diff"].contains(kind));
    match by_place {
        Some((_, place)) => what == place || what == "emitters",
        None => {
            what == "emitters"
                || what == "spheres" && !present.is_empty()
                || present.iter().any(|g| g.name == what)
        }
    }
}

/// Relative RMSE and ratio of means over pixels, all channels. Pixels that are not finite are left out.
fn relative_error(ours: &RadianceImage, truth: &RadianceImage, pixels: &[usize]) -> (f64, f64) {
    let (mut squares, mut sum, mut true_sum, mut count) = (0.0, 0.0, 0.0, 0.0);
    for &i in pixels {
        for (&a, &b) in ours.pixels()[i].iter().zip(&truth.pixels()[i]) {
            let (a, b) = (f64::from(a), f64::from(b));
            if a.is_finite() && b.is_finite() {
                squares += (a - b) * (a - b);
                sum += a;
                true_sum += b;
                count += 1.0;
            }
        }
    }
    if count == 0.0 {
        return (0.0, 1.0);
    }
    let all = truth.pixels().iter().flatten().filter(|c| c.is_finite());
    let whole_mean = all.map(|&c| f64::from(c)).sum::<f64>() / (3 * truth.pixels().len()) as f64;
    let mean = (true_sum / count).abs();
    let scale = if mean > 0.01 * whole_mean.abs() { mean } else { whole_mean.abs() };
    ((squares / count).sqrt() / scale, if true_sum == 0.0 { f64::NAN } else { sum / true_sum })
}

fn shadow_error(still: &Still, drawn: &Drawn, truth: &RadianceImage, open: &[usize]) -> Option<ShadowError> {
    let (mut squares, mut sum, mut pixels) = (0.0, 0.0, 0u32);
    let mut ratios = Vec::new();
    for &i in open {
        let without = still.background.radiance.pixels()[i].map(f64::from);
        let as_ratio = |pixel: [f32; 3]| {
            let pixel = pixel.map(f64::from);
            match still.quantity {
                PictureQuantity::Radiance => color::gray(pixel) / color::gray(without),
                PictureQuantity::Ratio => color::gray(pixel),
                PictureQuantity::Difference => 1.0 - color::gray(pixel) / color::gray(without),
            }
        };
        let (a, b) = (as_ratio(drawn.radiance.pixels()[i]), as_ratio(truth.pixels()[i]));
        if a.is_finite() && b.is_finite() && b < SHADOW_BELOW {
            squares += (a - b) * (a - b);
            sum += b;
            pixels += 1;
            if b > 0.0 {
                ratios.push(a / b);
            }
        }
    }
    let rmse = (squares / f64::from(pixels)).sqrt();
    (pixels > 0).then(|| ShadowError {
        pixels: pixels as usize,
        rmse,
        relative_rmse: rmse / (sum / f64::from(pixels)),
        median_ratio: median(ratios),
    })
}

fn median(mut all: Vec<f64>) -> f64 {
    all.retain(|x| x.is_finite());
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
}

impl Comparison {
    /// For machines.
    pub fn json(&self) -> serde_json::Value {
        let masks: Vec<_> = self
            .masks
            .iter()
            .map(|m| {
                serde_json::json!({
                    "mask": m.name, "pixels": m.pixels,
                    "relative_rmse": m.relative_rmse, "mean_ratio": m.mean_ratio,
                })
            })
            .collect();
        let shadow = self.shadow.map(|s| {
            serde_json::json!({
                "pixels": s.pixels, "rmse": s.rmse, "relative_rmse": s.relative_rmse, "median_ratio": s.median_ratio,
            })
        });
        serde_json::json!({
            "image": self.image, "relative_rmse": self.relative_rmse,
            "receivers_relative_rmse": self.receivers_relative_rmse,
            "receivers_median_ratio": self.receivers_median_ratio,
            "masks": masks, "shadow": shadow,
        })
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "against the case's {}", self.image)?;
        writeln!(f, "  {:<24}relative RMSE {:.4}", "all", self.relative_rmse)?;
        writeln!(
            f,
            "  {:<24}relative RMSE {:.4}  median ratio {:.4}",
            "receivers", self.receivers_relative_rmse, self.receivers_median_ratio
        )?;
        for m in &self.masks {
            writeln!(
                f,
                "  {:<24}relative RMSE {:.4}  mean ratio   {:.4}  ({} px)",
                m.name, m.relative_rmse, m.mean_ratio, m.pixels
            )?;
        }
        match self.shadow {
            Some(s) => writeln!(
                f,
                "  {:<24}relative RMSE {:.4}  median ratio {:.4}  ({} px, RMSE {:.4})",
                "shadow (ratio < 0.93)", s.relative_rmse, s.median_ratio, s.pixels, s.rmse
            ),
            None => writeln!(f, "  {:<24}nothing is shadowed", "shadow (ratio < 0.93)"),
        }
    }
}
