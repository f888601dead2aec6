//! What pictures are held against: a case's own picture, or one traced here.

use super::errors::{SHADOW_BELOW, Truth};
use crate::assets::{case::Case, error::AssetError, pictures};
use crate::cli::{
    CliError,
    render::Still,
    trace::{LightOf, of_still},
};
use crate::math::color::gray;
use crate::model::quality::Quality;
use crate::reference::{TraceSettings, Traced, trace};

/// The case's own picture. Its objects are where its masks have any coverage.
pub fn of_case(case: &Case, image: &str, still: &Still) -> Result<Truth, CliError> {
    let file = |e: AssetError| CliError(e.to_string());
    let about = case.image(image).map_err(file)?;
    let radiance = pictures::load_raw(&about.file).map_err(file)?;
    let (width, height) = (still.background.radiance.width(), still.background.radiance.height());
    let mut place = vec![1.0f32; width * height];
    let fits = |what: &str, w: usize, h: usize| match (w, h) == (width, height) {
        true => Ok(()),
        false => {
            Err(CliError(format!("{what} of {}: {w} x {h}: must be {width} x {height}", case.file.display())))
        }
    };
    fits(image, radiance.width(), radiance.height())?;
    for mask in case.images.iter().filter(|m| m.is_mask()) {
        let coverage = pictures::load_gray8(&mask.file).map_err(file)?;
        fits(&mask.name, coverage.width(), coverage.height())?;
        let filled = coverage.pixels().iter().map(|&c| 1.0 - f32::from(c) / 255.0);
        place.iter_mut().zip(filled).for_each(|(p, left)| *p = p.min(left));
    }
    let without = still.background.radiance.clone();
    Ok(Truth { radiance, without, place, noise: None, made_by: format!("the case's own {image}") })
}

/// One that is traced here, with so many rays a pixel: the objects over the still's own background, whose surfaces are
/// dimmed by what is left of their light. `done` is told the share done.
pub fn traced(
    still: &Still,
    light: LightOf<'_>,
    quality: &Quality,
    samples: usize,
    done: &dyn Fn(f32),
) -> Result<Truth, CliError> {
    let scene = of_still(light, still, quality)?;
    let samples = u32::try_from(samples).unwrap_or(u32::MAX);
    let settings = TraceSettings {
        samples,
        samples_a_pass: (samples / 8).next_power_of_two().clamp(1, 64),
        ..TraceSettings::default()
    };
    let traced = trace(&scene, &settings, done).map_err(|e| CliError(format!("truth: {e}")))?;
    let radiance = traced.over(&still.background.radiance).ok_or_else(|| {
        CliError("truth: the picture of the place has another size than the camera's".into())
    })?;
    let place: Vec<f32> = traced.coverage().pixels().iter().map(|c| 1.0 - c).collect();
    let noise = noise(&traced, &place);
    let made_by = format!("traced here with {} rays a pixel, direct light", traced.samples);
    let without = still.background.radiance.clone();
    Ok(Truth { radiance, without, place, noise, made_by })
}

/// Standard error of the share of light left, summed over the place and over the mean share taken in shadow, as
/// `Errors::shadow` is.
fn noise(traced: &Traced, place: &[f32]) -> Option<f64> {
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
    (count > 0.0).then(|| f64::sqrt(squares / count) / (depth / count))
}
