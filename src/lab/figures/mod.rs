//! How a picture comes about, as [Now11] shows it in its Figures 3, 4 and 5, from a moment of a recording: the light in its
//! halves, every part of a picture, materials, numbers of shadow maps, and rungs of the ladder with their errors.

mod sheet;

pub use sheet::FigureSheet;

use crate::daemon::host::Host;
use crate::engine::{Engine, EngineError};
use crate::model::{
    blocker::Rung,
    image::{Image, RadianceImage, Rgb8Image},
    light::Lights,
    picture::PictureView,
    quality::{Quality, SplitKind},
};
use crate::still::{Composition, Drawn, Still};

/// All figures of what a moment is composed of, each with its name.
///
/// # Errors
/// The engine fails.
pub fn figures(
    composition: &Composition,
    engine: &mut dyn Engine,
    host: &Host<'_>,
) -> Result<Vec<(&'static str, FigureSheet)>, EngineError> {
    // Figures need not hurry.
    let quality = Quality { soft_step_px: 2, directions: 256, shadow_maps: 16, ..Quality::default() };
    let still = composition.still(&quality, host);
    let mut artist = Artist { engine, crop: Crop::default(), composition, still, quality };
    artist.crop = artist.find_crop()?;
    Ok(vec![
        ("light", artist.light()?),
        ("parts", artist.parts()?),
        ("materials", artist.materials()?),
        ("maps", artist.maps()?),
        ("ladder", artist.ladder()?),
    ])
}

/// The part of the picture that figures show.
#[derive(Clone, Copy, Debug, Default)]
struct Crop {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Crop {
    fn of(self, picture: &Rgb8Image) -> Rgb8Image {
        let mut out = Image::filled(self.width, self.height, [0; 3]);
        for y in 0..self.height {
            for x in 0..self.width {
                *out.at_mut(x, y) = *picture.at(self.left + x, self.top + y);
            }
        }
        out
    }
}

/// Draws the figures of one moment.
struct Artist<'a> {
    engine: &'a mut dyn Engine,
    crop: Crop,
    composition: &'a Composition,
    /// With the bodies that `quality` asks for.
    still: Still,
    quality: Quality,
}

/// Ratios above are not counted in errors of shadows, as spec 4b has it.
const SHADOW_BELOW: f64 = 0.93;

impl Artist<'_> {
    /// One picture of the moment by a view, in the given light.
    fn draw(&mut self, view: PictureView, light: &Lights, quality: &Quality) -> Result<Drawn, EngineError> {
        let environment = self.composition.far.environment(quality);
        let still = Still { view, light: *light, environment, ..self.still.clone() };
        still.draw(self.engine, quality, None, 0)
    }

    fn halved(&self, quality: &Quality) -> Lights {
        self.composition.halved(quality).lights
    }

    fn view(&mut self, view: PictureView, quality: &Quality) -> Result<Rgb8Image, EngineError> {
        let light = self.halved(quality);
        Ok(self.crop.of(&self.draw(view, &light, quality)?.display))
    }

    /// Where objects and their shadows are, with a margin, 4:3 where it fits.
    fn find_crop(&mut self) -> Result<Crop, EngineError> {
        let quality = self.quality;
        let light = self.halved(&quality);
        let drawn = self.draw(PictureView::Final, &light, &quality)?.radiance;
        let plain = &self.still.background.radiance;
        let (width, height) = (plain.width(), plain.height());
        let (mut low, mut high) = ([width, height], [0, 0]);
        for (i, (a, b)) in drawn.pixels().iter().zip(plain.pixels()).enumerate() {
            if (0..3).any(|c| (a[c] - b[c]).abs() > 0.04 * b[c]) {
                let at = [i % width, i / width];
                low = [low[0].min(at[0]), low[1].min(at[1])];
                high = [high[0].max(at[0] + 1), high[1].max(at[1] + 1)];
            }
        }
        if low[0] >= high[0] {
            return Ok(Crop { left: 0, top: 0, width, height });
        }
        let wide =
            ((high[0] - low[0]).max((high[1] - low[1]) * 4 / 3) * 23 / 20).clamp(160.min(width), width);
        let tall = (wide * 3 / 4).min(height);
        let place = |low: usize, high: usize, size: usize, all: usize| {
            ((low + high) / 2).saturating_sub(size / 2).min(all - size)
        };
        Ok(Crop {
            left: place(low[0], high[0], wide, width),
            top: place(low[1], high[1], tall, height),
            width: wide,
            height: tall,
        })
    }

    /// The light, whole, by each split.
    fn light(&mut self) -> Result<FigureSheet, EngineError> {
        let mut sheet = FigureSheet::new(
            "light: as measured, all of it in SH / hard half, soft half (blue: negative)",
            2,
        );
        for kind in [SplitKind::Compact, SplitKind::Paper, SplitKind::Bounded, SplitKind::Sh] {
            let quality = Quality { split: kind, ..self.quality };
            let light = self.halved(&quality);
            let picture = self.draw(PictureView::Light, &light, &quality)?.display;
            sheet.add(
                format!("split {}: {} hard", kind.name(), light.hard.as_slice().len()),
                middle(&picture),
            );
        }
        Ok(sheet)
    }

    /// Every part of the picture.
    fn parts(&mut self) -> Result<FigureSheet, EngineError> {
        let quality = self.quality;
        let mut sheet = FigureSheet::new("a picture and its parts", 3);
        for (view, caption) in [
            (PictureView::Direct, "direct: the hard half"),
            (PictureView::Global, "global: the soft half"),
            (PictureView::Final, "final"),
            (PictureView::Cast, "cast shadows"),
            (PictureView::SelfShadow, "self shadows"),
            (PictureView::Blockers, "blocker spheres"),
        ] {
            sheet.add(caption, self.view(view, &quality)?);
        }
        Ok(sheet)
    }

    /// Every material.
    fn materials(&mut self) -> Result<FigureSheet, EngineError> {
        let quality = self.quality;
        let mut sheet = FigureSheet::new("materials", 3);
        for view in [PictureView::Lambert, PictureView::Phong, PictureView::Mirror] {
            sheet.add(view.name(), self.view(view, &quality)?);
        }
        Ok(sheet)
    }

    /// One light as more and more hard ones.
    fn maps(&mut self) -> Result<FigureSheet, EngineError> {
        let counts = [1, 4, 16, 64];
        let mut sheet = FigureSheet::new("shadow maps: picture, cast shadows, maps", counts.len());
        for view in [PictureView::Final, PictureView::Cast, PictureView::Maps] {
            for shadow_maps in counts {
                let quality = Quality { shadow_maps, near_width_deg: 90.0, ..self.quality };
                let picture = match view {
                    PictureView::Maps => {
                        let light = self.halved(&quality);
                        let whole = self.draw(view, &light, &quality)?.display;
                        reduced(&middle(&whole), self.crop.width)
                    }
                    _ => self.view(view, &quality)?,
                };
                let caption =
                    if view == PictureView::Final { format!("n = {shadow_maps}") } else { String::new() };
                sheet.add(caption, picture);
            }
        }
        Ok(sheet)
    }

    /// Soft cast shadows by every rung, against 256 directions; all light is soft here, so that there is much to see.
    fn ladder(&mut self) -> Result<FigureSheet, EngineError> {
        let soft = Quality { split: SplitKind::Sh, dering: true, ..self.quality };
        let exact = Quality { rung: Rung::Directions, directions: 256, ..soft };
        let light = self.halved(&exact);
        let truth = self.draw(PictureView::Cast, &light, &exact)?;
        let mut sheet = FigureSheet::new(
            format!("all light soft: cast shadows by rung, rms error of the ratio below {SHADOW_BELOW}"),
            4,
        );
        sheet.add("directions 256", self.crop.of(&truth.display));
        for rung in Rung::ALL {
            let quality = Quality { rung, directions: 64, ..exact };
            let drawn = self.draw(PictureView::Cast, &light, &quality)?;
            let error = error_in_shadow(&drawn.radiance, &truth.radiance);
            let name = if rung == Rung::Directions { "directions 64" } else { rung.name() };
            sheet.add(format!("{name}: {error:.4}"), self.crop.of(&drawn.display));
        }
        Ok(sheet)
    }
}

/// Root mean square difference of the gray ratios of two pictures of cast shadows, where the second is in shadow.
fn error_in_shadow(picture: &RadianceImage, truth: &RadianceImage) -> f64 {
    let white = truth.pixels().iter().flatten().copied().fold(0.0f32, f32::max).max(f32::MIN_POSITIVE);
    let gray = |c: &[f32; 3]| f64::from(crate::math::color::gray(*c) / white);
    let pairs = picture.pixels().iter().zip(truth.pixels()).map(|(a, b)| (gray(a), gray(b)));
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in pairs.filter(|(_, b)| *b < SHADOW_BELOW) {
        sum += (a - b).powi(2);
        count += 1.0;
    }
    if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
}

/// A picture without the empty rows above and below its panels.
fn middle(picture: &Rgb8Image) -> Rgb8Image {
    let first = picture.pixels().first().copied().unwrap_or_default();
    let filled = |y: &usize| picture.row(*y).iter().any(|p| *p != first);
    let (Some(top), Some(bottom)) =
        ((0..picture.height()).find(filled), (0..picture.height()).rev().find(filled))
    else {
        return picture.clone();
    };
    Crop { left: 0, top, width: picture.width(), height: bottom + 1 - top }.of(picture)
}

/// Reduced to a width, each pixel the mean of those under it.
fn reduced(picture: &Rgb8Image, width: usize) -> Rgb8Image {
    let width = width.clamp(1, picture.width().max(1));
    let height = (picture.height() * width / picture.width().max(1)).max(1);
    let mut out = Image::filled(width, height, [0; 3]);
    for y in 0..height {
        for x in 0..width {
            let columns = x * picture.width() / width..((x + 1) * picture.width()).div_ceil(width);
            let rows = y * picture.height() / height..((y + 1) * picture.height()).div_ceil(height);
            let (mut sum, mut count) = ([0u32; 3], 0u32);
            for row in rows {
                for column in columns.clone() {
                    let pixel = picture.at(column.min(picture.width() - 1), row.min(picture.height() - 1));
                    sum.iter_mut().zip(pixel).for_each(|(s, p)| *s += u32::from(*p));
                    count += 1;
                }
            }
            *out.at_mut(x, y) = sum.map(|s| (s / count.max(1)) as u8);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_count_in_shadow_alone() {
        let picture = |ratios: [f32; 4]| {
            RadianceImage::from_pixels(4, 1, ratios.map(|r| [0.9 * r; 3]).to_vec()).unwrap()
        };
        let truth = picture([1.0, 0.95, 0.5, 0.4]);
        let error = error_in_shadow(&picture([0.0, 0.0, 0.53, 0.36]), &truth);
        assert!((error - (0.5f64 * (0.03f64.powi(2) + 0.04f64.powi(2))).sqrt()).abs() < 1e-6, "{error}");
        assert_eq!(error_in_shadow(&truth, &picture([1.0; 4])), 0.0);
    }

    #[test]
    fn pictures_are_reduced_and_cut() {
        let pixels = (0..8 * 6).map(|i| [if i / 8 == 2 { 40 } else { 0 }, (i % 8) as u8, 0]).collect();
        let picture = Rgb8Image::from_pixels(8, 6, pixels).unwrap();
        let half = reduced(&picture, 4);
        assert_eq!((half.width(), half.height()), (4, 3));
        assert_eq!(*half.at(1, 1), [20, 2, 0]);
        let row = middle(
            &Rgb8Image::from_pixels(2, 3, vec![[0; 3], [0; 3], [0; 3], [9; 3], [0; 3], [0; 3]]).unwrap(),
        );
        assert_eq!((row.height(), *row.at(1, 0)), (1, [9; 3]));
    }
}
