//! Finds tag36h11 AprilTags [Ols11] through the C library, in the whole picture or only in regions.

use super::blurred::{BlurredScratch, refine_blurred};
use super::edges::{self, EdgeScratch, RefinedCorners};
use super::region::MIN_SIDE_PX;
pub use super::region::Region;

mod sys;

use crate::model::image::Image;
use apriltag::{Detector, Family};
use glam::DVec2;

/// Pictures outside these sizes are refused: the C library keeps twice the pixel's coordinate in 16 bits.
const MAX_SIDE_PX: usize = 16_384;
/// Regions up to this area are searched at full resolution: their tag is too small to be reduced, and the time is
/// small anyway.
const FULL_RESOLUTION_AREA_PX: usize = 100 * 100;
/// Scratch pictures are allocated in steps of this, so that regions of nearly the same size share one.
const SCRATCH_STEP_PX: usize = 32;
/// Blur of a tag of which no edge could be followed, pixels.
const USUAL_BLUR_PX: f64 = 2.0;
/// Scratch pictures kept.
const SCRATCH_PICTURES: usize = 8;

/// How tags are looked for.
#[derive(Clone, Debug, PartialEq)]
pub struct TagOptions {
    /// Quads are looked for in a picture reduced by this whole factor, 1 or more (decoding uses all pixels).
    pub decimate: u32,
    /// Standard deviation of the blur before quads are looked for, pixels of the reduced picture; 0 = none.
    pub quad_sigma_px: f32,
    /// Whether corners are refined on the picture's edges in linear light (`track::edges`).
    pub refine: bool,
    /// Wrong bits that may be mended, 0 to 2.
    pub mended_bits: u32,
    /// Detections whose decision margin is below this are dropped.
    pub min_decision_margin: f32,
    /// Cells of the black border, 1 or 2. Kalibr's boards have two.
    pub border_cells: u32,
    /// Linear light for each 8-bit value: what the camera's response undoes. Only its shape matters.
    pub linear_of_value: Box<[f32; 256]>,
}

impl Default for TagOptions {
    /// Decimation 2 and a blur of 0.8 (a third of the time of decimation 1), sRGB.
    fn default() -> Self {
        Self {
            decimate: 2,
            quad_sigma_px: 0.8,
            refine: true,
            mended_bits: 1,
            min_decision_margin: 20.0,
            border_cells: 1,
            linear_of_value: Box::new(edges::srgb_table()),
        }
    }
}

impl TagOptions {
    /// For photographs with small tags: every pixel, no blur, and every bit right.
    pub fn thorough() -> Self {
        Self { decimate: 1, quad_sigma_px: 0.0, mended_bits: 0, min_decision_margin: 0.0, ..Self::default() }
    }
}

/// One tag in one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagDetection {
    /// Its number.
    pub id: u32,
    /// Wrong bits that were mended.
    pub hamming: u32,
    /// How clearly the bits were told apart; larger is better.
    pub decision_margin: f32,
    /// Outer corners of the black square in continuous pixels, in the library's order: in the tag's upright
    /// picture lower left, lower right, upper right, upper left (counter-clockwise as seen).
    pub corners_px: [DVec2; 4],
    /// Standard deviation of one coordinate of a corner as its edges show it, pixels.
    pub corner_sigma_px: f64,
}

impl TagDetection {
    /// Mean of the corners, pixels.
    pub fn middle_px(&self) -> DVec2 {
        self.corners_px.iter().sum::<DVec2>() / 4.0
    }
}

/// Why a search could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TagError {
    /// The library refused; says what.
    #[error("tag detector: {0}")]
    Library(String),
    /// The picture is too large or too small.
    #[error(
        "tag detector: a picture of {width} x {height} pixels: each side must be within {MIN_SIDE_PX}..={MAX_SIDE_PX}"
    )]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// An option outside its range.
    #[error("tag detector: {option} = {given}: must be {allowed}")]
    Option {
        /// Which.
        option: &'static str,
        /// What stood there.
        given: String,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// A detector. It is not `Send` (the C library keeps state behind it): one thread makes it and owns it.
pub struct TagDetector {
    options: TagOptions,
    library: Detector,
    scratch: Vec<apriltag::Image>,
    edges: EdgeScratch,
    blurred: BlurredScratch,
}

impl TagDetector {
    /// Makes a detector of family tag36h11 that works on the calling thread alone.
    pub fn new(options: TagOptions) -> Result<Self, TagError> {
        check(&options)?;
        let mut library = match options.border_cells {
            1 => Detector::builder()
                .add_family_bits(Family::tag_36h11(), options.mended_bits as usize)
                .build()
                .map_err(|error| TagError::Library(error.to_string()))?,
            _ => sys::two_cell_border(options.mended_bits)
                .ok_or_else(|| TagError::Library("it makes no detector".into()))?,
        };
        library.set_thread_number(1);
        Ok(Self {
            options,
            library,
            scratch: Vec::new(),
            edges: EdgeScratch::default(),
            blurred: BlurredScratch::default(),
        })
    }

    /// The options that it was made with.
    pub fn options(&self) -> &TagOptions {
        &self.options
    }

    /// Takes another inverse response, as when the camera's own has become known (`TagOptions::linear_of_value`).
    pub fn set_linear_of_value(&mut self, table: &[f32; 256]) -> Result<(), TagError> {
        let before = std::mem::replace(&mut *self.options.linear_of_value, *table);
        check(&self.options).inspect_err(|_| *self.options.linear_of_value = before)
    }

    /// Finds tags in a gray picture (8 bits, through the camera's response), in all of it or only in regions.
    /// `out` is cleared first and then holds each tag once, ordered by id and then by place. Corners are in
    /// continuous pixels of the whole picture: the C library's own convention, in which pixel (i, j) covers
    /// [i, i+1) as ours does. A region smaller than a tag is skipped; a picture too small for any is an error.
    pub fn detect(
        &mut self,
        gray: &Image<u8>,
        regions: Option<&[Region]>,
        out: &mut Vec<TagDetection>,
    ) -> Result<(), TagError> {
        out.clear();
        let (width, height) = (gray.width(), gray.height());
        let allowed = MIN_SIDE_PX..=MAX_SIDE_PX;
        if !allowed.contains(&width) || !allowed.contains(&height) {
            return Err(TagError::Size { width, height });
        }
        let whole = Region { x: 0, y: 0, width: width as i32, height: height as i32 };
        match regions {
            None => self.search(gray, whole, out)?,
            Some(regions) => {
                for region in regions {
                    if let Some(region) = region.within(width, height) {
                        self.search(gray, region, out)?;
                    }
                }
            }
        }
        out.sort_unstable_by(|a, b| {
            let (ca, cb) = (a.middle_px(), b.middle_px());
            a.id.cmp(&b.id).then(ca.y.total_cmp(&cb.y)).then(ca.x.total_cmp(&cb.x))
        });
        // A tag seen in two overlapping regions counts once.
        out.dedup_by(|later, first| {
            later.id == first.id && later.middle_px().distance_squared(first.middle_px()) < 4.0
        });
        Ok(())
    }

    /// Searches a region; where the reduced picture shows nothing, every pixel, as tags that are small or seen from the side
    /// lose their border in it.
    fn search(
        &mut self,
        gray: &Image<u8>,
        region: Region,
        out: &mut Vec<TagDetection>,
    ) -> Result<(), TagError> {
        let before = out.len();
        let area = region.width as usize * region.height as usize;
        let whole = region.width as usize == gray.width() && region.height as usize == gray.height();
        let small = !whole && area <= FULL_RESOLUTION_AREA_PX;
        let decimate = if small { 1 } else { self.options.decimate };
        // The blur is meant for the reduced picture; at full resolution it only costs small tags their bits.
        let sigma = if small { 0.0 } else { self.options.quad_sigma_px };
        self.search_at(gray, region, (decimate, sigma), out)?;
        if out.len() == before && decimate > 1 {
            self.search_at(gray, region, (1, 0.0), out)?;
        }
        Ok(())
    }

    fn search_at(
        &mut self,
        gray: &Image<u8>,
        region: Region,
        (decimate, sigma): (u32, f32),
        out: &mut Vec<TagDetection>,
    ) -> Result<(), TagError> {
        let (width, height) = (region.width as usize, region.height as usize);
        let whole = width == gray.width() && height == gray.height();
        // The library reads outside its tiles of 4 x 4 where the reduced picture has none.
        let decimate = decimate.min((width.min(height) / 8) as u32).max(1);
        self.library.set_decimation(decimate as f32);
        self.library.set_sigma(sigma);
        // At full resolution the quads' own corners are better than what the library's refinement makes of them
        // (thin tags grow by 2 px); in a reduced picture it is the other way round.
        self.library.set_refine_edges(decimate > 1);
        let slot = self.scratch_for(width, height, whole)?;
        let scratch = &mut self.scratch[slot];
        fill(scratch, gray, region);
        let offset = DVec2::new(f64::from(region.x), f64::from(region.y));
        for found in self.library.detect(&self.scratch[slot]) {
            if found.decision_margin() < self.options.min_decision_margin {
                continue;
            }
            let mut corners_px = found.corners().map(|c| DVec2::from_array(c) + offset);
            if !corners_px.iter().all(|c| c.is_finite()) {
                continue;
            }
            // Measured on drawn tags of 20 to 110 px without refinement.
            let mut corner_sigma_px = 0.25;
            if self.options.refine
                && let Some(refined) = self.refined(gray, &corners_px, f64::from(decimate))
            {
                corners_px = refined.corners_px;
                corner_sigma_px = refined.sigma_px;
            }
            out.push(TagDetection {
                id: found.id() as u32,
                hamming: found.hamming() as u32,
                decision_margin: found.decision_margin(),
                corners_px,
                corner_sigma_px,
            });
        }
        Ok(())
    }

    /// Corners from the tag's edges where they are seen whole, else from the whole tag and its blur.
    fn refined(
        &mut self,
        gray: &Image<u8>,
        corners_px: &[DVec2; 4],
        max_move_px: f64,
    ) -> Option<RefinedCorners> {
        let table = &self.options.linear_of_value;
        let sharp = edges::refine_corners(gray, table, corners_px, max_move_px, &mut self.edges);
        if sharp.is_some_and(|s| s.seen_whole) {
            return sharp;
        }
        let width_px = sharp.map_or(USUAL_BLUR_PX, |s| s.width_px);
        refine_blurred(gray, table, corners_px, width_px, &mut self.blurred).or(sharp)
    }

    /// A scratch picture that holds width x height; whole pictures get their exact size.
    fn scratch_for(&mut self, width: usize, height: usize, exact: bool) -> Result<usize, TagError> {
        let round = |n: usize| if exact { n } else { n.next_multiple_of(SCRATCH_STEP_PX) };
        let (width, height) = (round(width), round(height));
        let fits = |s: &apriltag::Image| s.width() == width && s.height() == height;
        if let Some(slot) = self.scratch.iter().position(fits) {
            return Ok(slot);
        }
        // The C library reads rows in whole vectors: rows are padded as it pads its own.
        let made = apriltag::Image::zeros_with_stride(width, height, width.next_multiple_of(96))
            .map_err(|error| TagError::Library(error.to_string()))?;
        if self.scratch.len() >= SCRATCH_PICTURES {
            self.scratch.remove(0);
        }
        self.scratch.push(made);
        Ok(self.scratch.len() - 1)
    }
}

fn check(options: &TagOptions) -> Result<(), TagError> {
    let fail = |option, given: String, allowed| Err(TagError::Option { option, given, allowed });
    if !(1..=8).contains(&options.decimate) {
        return fail("decimate", options.decimate.to_string(), "a whole number within 1..=8");
    }
    if !(0.0..=5.0).contains(&options.quad_sigma_px) {
        return fail("quad_sigma_px", options.quad_sigma_px.to_string(), "within 0..=5 pixels");
    }
    if !(1..=2).contains(&options.border_cells) {
        return fail("border_cells", options.border_cells.to_string(), "1 or 2");
    }
    if options.mended_bits > 2 {
        return fail("mended_bits", options.mended_bits.to_string(), "0, 1 or 2");
    }
    if !options.linear_of_value.iter().all(|x| x.is_finite()) {
        return fail(
            "linear_of_value",
            "a table with a value that is not finite".into(),
            "256 finite values",
        );
    }
    Ok(())
}

/// Copies a region into a scratch picture at least as large; what lies beyond repeats the region's border, so
/// that it adds no edges.
fn fill(scratch: &mut apriltag::Image, gray: &Image<u8>, region: Region) {
    let (stride, columns, rows) = (scratch.stride(), scratch.width(), scratch.height());
    let (x, y) = (region.x as usize, region.y as usize);
    let (width, height) = (region.width as usize, region.height as usize);
    for (j, row) in scratch.as_slice_mut().chunks_exact_mut(stride).take(rows).enumerate() {
        let source = &gray.row(y + j.min(height - 1))[x..x + width];
        row[..width].copy_from_slice(source);
        row[width..columns].fill(source[width - 1]);
    }
}

/// Gray of an 8-bit picture, as the camera encoded it: 0.30 R + 0.59 G + 0.11 B in whole numbers.
pub fn gray_of(picture: &Image<[u8; 3]>, out: &mut Image<u8>) {
    out.reshape(picture.width(), picture.height(), 0);
    for (gray, &[r, g, b]) in out.pixels_mut().iter_mut().zip(picture.pixels()) {
        *gray = ((77 * u32::from(r) + 151 * u32::from(g) + 28 * u32::from(b) + 128) >> 8) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::super::drawing::{corners_of, draw};
    use super::*;

    fn found(options: TagOptions, gray: &Image<u8>, regions: Option<&[Region]>) -> Vec<TagDetection> {
        let mut out = Vec::new();
        TagDetector::new(options).unwrap().detect(gray, regions, &mut out).unwrap();
        out
    }

    fn worst(found: &TagDetection, truth: &[DVec2; 4]) -> f64 {
        found.corners_px.iter().zip(truth).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
    }

    fn srgb(linear: f64) -> f64 {
        if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
    }

    #[test]
    fn the_library_counts_pixels_from_their_corner_as_we_do() {
        // An upright tag of 80 px whose edges lie on pixel borders.
        let truth = corners_of(DVec2::new(160.0, 120.0), 80.0, 0.0);
        assert_eq!(truth[0], DVec2::new(120.0, 160.0));
        let gray = draw(320, 240, 0, &truth, |linear| linear);
        for (decimate, allowed_px) in [(1, 0.25), (2, 0.25)] {
            let options = TagOptions { decimate, refine: false, ..TagOptions::default() };
            let tags = found(options, &gray, None);
            assert_eq!(tags.len(), 1);
            assert_eq!(tags[0].id, 0);
            let mean = tags[0].middle_px() - DVec2::new(160.0, 120.0);
            // The other convention would be off by (0.5, 0.5), and another order of corners by 80.
            assert!(mean.abs().max_element() < 0.15, "decimate {decimate}: {mean}");
            let worst = worst(&tags[0], &truth);
            assert!(worst < allowed_px, "decimate {decimate}: {worst}");
        }
    }

    #[test]
    fn refined_corners_are_good_to_a_hundredth_of_a_pixel() {
        // Worst measured: 0.042 px at 28 px, under 0.02 px above. Through the sRGB curve the library alone is off by
        // 0.4 px, always outwards or always inwards: that would be an error of scale.
        for (side, allowed_px) in [(28.0, 0.06), (63.7, 0.02), (110.3, 0.02)] {
            for decimate in [1, 2] {
                for turn in 0..4 {
                    let middle = DVec2::new(100.3 + 0.137 * f64::from(turn), 99.6 - 0.21 * f64::from(turn));
                    let mut truth = corners_of(middle, side, 0.13 + 1.1 * f64::from(turn));
                    truth[2] += DVec2::new(-0.06, 0.05) * side;
                    let gray = draw(200, 200, turn as usize % 3, &truth, srgb);
                    let tags = found(TagOptions { decimate, ..TagOptions::default() }, &gray, None);
                    assert_eq!(tags.len(), 1, "side {side} decimate {decimate} turn {turn}");
                    assert_eq!(tags[0].id, turn as u32 % 3);
                    let worst = worst(&tags[0], &truth);
                    assert!(worst < allowed_px, "side {side} decimate {decimate} turn {turn}: {worst}");
                    assert!((0.003..0.04).contains(&tags[0].corner_sigma_px), "{}", tags[0].corner_sigma_px);
                }
            }
        }
    }

    #[test]
    fn regions_find_what_they_hold_and_nothing_else() {
        let truth = corners_of(DVec2::new(200.0, 90.0), 50.0, 0.4);
        let gray = draw(320, 240, 1, &truth, srgb);
        let options = TagOptions::default();
        let whole = found(options.clone(), &gray, None);
        let around = Region::around(&truth, 20.0).unwrap();
        let twice = Region { x: around.x + 3, ..around };
        let near = found(options.clone(), &gray, Some(&[around, twice]));
        assert_eq!((whole.len(), near.len()), (1, 1));
        // Both are refined on the same picture, from different starts.
        assert!(worst(&near[0], &whole[0].corners_px) < 0.01);
        let elsewhere = Region { x: 0, y: 0, width: 100, height: 240 };
        let outside = Region { x: -500, y: 9000, width: 300, height: 300 };
        assert!(found(options, &gray, Some(&[elsewhere, outside])).is_empty());
    }

    #[test]
    fn bad_input_is_named() {
        let mut detector = TagDetector::new(TagOptions::default()).unwrap();
        let mut out = Vec::new();
        for (width, height) in [(0, 0), (11, 480), (640, 3), (20_000, 12)] {
            let error = detector.detect(&Image::filled(width, height, 0), None, &mut out).unwrap_err();
            assert_eq!(error, TagError::Size { width, height });
        }
        for (width, height) in [(12, 12), (13, 200), (640, 12)] {
            detector.detect(&Image::filled(width, height, 128), None, &mut out).unwrap();
            assert!(out.is_empty());
        }
        // Noise of all shapes: nothing to find, nothing to trip over.
        let mut dice = crate::math::dice::Dice::new(7);
        for (decimate, width, height) in [(1, 13, 40), (2, 41, 17), (3, 64, 12), (8, 12, 300), (8, 95, 97)] {
            let mut noise = Image::filled(width, height, 0u8);
            for pixel in noise.pixels_mut() {
                *pixel = (dice.bits() >> 56) as u8;
            }
            let options = TagOptions { decimate, quad_sigma_px: 0.0, ..TagOptions::default() };
            TagDetector::new(options).unwrap().detect(&noise, None, &mut out).unwrap();
            assert!(out.is_empty(), "{decimate}: {out:?}");
        }
        let error = TagDetector::new(TagOptions { decimate: 0, ..TagOptions::default() }).err().unwrap();
        assert_eq!(error.to_string(), "tag detector: decimate = 0: must be a whole number within 1..=8");
        let nan = TagOptions { quad_sigma_px: f32::NAN, ..TagOptions::default() };
        assert!(TagDetector::new(nan).err().unwrap().to_string().contains("quad_sigma_px = NaN"));
    }
}
