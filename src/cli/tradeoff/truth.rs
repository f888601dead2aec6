//! What pictures are held against: a case's own picture, or one traced here.

use super::errors::Truth;
use crate::assets::{case::Case, error::AssetError, pictures};
use crate::cli::{CliError, render::Still};

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
    Ok(Truth { radiance, place, noise: None, made_by: format!("the case's own {image}") })
}

/// One that is traced here, with so many rays a pixel.
pub fn traced(still: &Still, samples: usize) -> Result<Truth, CliError> {
    let _ = (still, samples);
    Err(CliError("not yet".into()))
}
