//! What attribution and planning see of a frame: 96 means of linear light and a histogram.

use crate::model::{image::Rgb8Image, response::Response};

/// Columns of the grid.
pub const COLUMNS: usize = 12;
/// Rows of the grid.
pub const ROWS: usize = 8;
/// Blocks of the grid.
pub const BLOCKS: usize = COLUMNS * ROWS;

/// A sample of which one channel reaches this value counts as saturated: noise lets clipped values come out a little lower.
const SATURATED: u8 = 250;
/// A sample of which no channel exceeds this value counts as black: below, rounding hides the ratio of two exposures.
const BLACK: u8 = 12;
/// A block darker than this value on the whole is mostly noise of the sensor, cut at black.
const DARKEST_MEAN: usize = 24;
/// Samples of a picture that are looked at, about.
const SAMPLES: usize = 24_576;
/// Share of black samples up to which a block still tells its light.
const MOST_BLACK: f32 = 0.1;
/// Share of saturated samples up to which a block still tells its light.
const MOST_SATURATED: f32 = 0.01;

/// One frame in small. Reading into it allocates nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Thumbnail {
    /// For each block, row by row: ln of the mean of X (radiance times seconds at unit gain, in the response's unit). Not a
    /// number where the block holds no sample or none of finite light.
    log_mean: [f32; BLOCKS],
    saturated: [f32; BLOCKS],
    black: [f32; BLOCKS],
    /// Samples by the value of their largest channel.
    counts: [u32; 256],
}

impl Default for Thumbnail {
    fn default() -> Self {
        Self {
            log_mean: [f32::NAN; BLOCKS],
            saturated: [0.0; BLOCKS],
            black: [0.0; BLOCKS],
            counts: [0; 256],
        }
    }
}

impl Thumbnail {
    /// ln X of a block that tells its light: hardly any of its samples saturated, few black. `None` otherwise.
    pub fn well_exposed(&self, block: usize) -> Option<f64> {
        let log = *self.log_mean.get(block)?;
        let sound =
            log.is_finite() && self.saturated[block] <= MOST_SATURATED && self.black[block] <= MOST_BLACK;
        sound.then_some(f64::from(log))
    }

    /// Share of a block's samples at the upper end of the scale, 0 to 1.
    pub fn saturated(&self, block: usize) -> f64 {
        self.saturated.get(block).copied().map_or(0.0, f64::from)
    }

    /// Share of a block's samples at the lower end of the scale, 0 to 1.
    pub fn black(&self, block: usize) -> f64 {
        self.black.get(block).copied().map_or(0.0, f64::from)
    }

    /// Samples by the 8-bit value of their largest channel.
    pub fn counts(&self) -> &[u32; 256] {
        &self.counts
    }

    /// Whether two thumbnails are equal bit for bit: of a sensor with noise, the same picture twice.
    pub fn same_bits(&self, other: &Self) -> bool {
        self.counts == other.counts
            && self.log_mean.iter().zip(&other.log_mean).all(|(a, b)| a.to_bits() == b.to_bits())
    }
}

/// Makes thumbnails of pictures of one camera.
#[derive(Clone, Debug)]
pub struct ThumbnailReader {
    /// X for each channel and value.
    linear: [[f32; 256]; 3],
    /// The least mean of a block, X.
    darkest: f64,
    sums: [f64; BLOCKS],
    samples: [u32; BLOCKS],
}

impl ThumbnailReader {
    /// For a camera of this response.
    pub fn new(response: &Response) -> Self {
        let linear = response.log_exposure().map(|g| g.map(f32::exp));
        let darkest = linear.iter().map(|x| f64::from(x[DARKEST_MEAN])).sum::<f64>() / 3.0;
        Self { linear, darkest, sums: [0.0; BLOCKS], samples: [0; BLOCKS] }
    }

    /// Reads an RGB picture; about 25,000 pixels of it are looked at, evenly spread. A picture without pixels gives a thumbnail
    /// without light.
    pub fn read(&mut self, picture: &Rgb8Image, out: &mut Thumbnail) {
        let linear = self.linear;
        self.read_pixels(picture.width(), picture.height(), out, |x, y| {
            let [r, g, b] = *picture.at(x, y);
            let light = linear[0][usize::from(r)] + linear[1][usize::from(g)] + linear[2][usize::from(b)];
            (r.max(g).max(b), light / 3.0)
        });
    }

    /// Reads rows of luminance, through the response of green. Rows that are missing are not looked at.
    pub fn read_luminance(&mut self, width: usize, values: &[u8], out: &mut Thumbnail) {
        let green = self.linear[1];
        let height = values.len().checked_div(width).unwrap_or(0);
        self.read_pixels(width, height, out, |x, y| {
            let z = values[y * width + x];
            (z, green[usize::from(z)])
        });
    }

    fn read_pixels(
        &mut self,
        width: usize,
        height: usize,
        out: &mut Thumbnail,
        at: impl Fn(usize, usize) -> (u8, f32),
    ) {
        *out = Thumbnail::default();
        self.sums = [0.0; BLOCKS];
        self.samples = [0; BLOCKS];
        let step = ((width as f64 * height as f64 / SAMPLES as f64).sqrt() as usize).max(1);
        for y in (step / 2..height).step_by(step) {
            let row = y * ROWS / height * COLUMNS;
            for x in (step / 2..width).step_by(step) {
                let block = row + x * COLUMNS / width;
                let (largest, light) = at(x, y);
                out.counts[usize::from(largest)] += 1;
                self.samples[block] += 1;
                self.sums[block] += f64::from(light);
                out.saturated[block] += f32::from(u8::from(largest >= SATURATED));
                out.black[block] += f32::from(u8::from(largest <= BLACK));
            }
        }
        for block in 0..BLOCKS {
            let samples = self.samples[block];
            if samples > 0 {
                let mean = self.sums[block] / f64::from(samples);
                if mean >= self.darkest {
                    out.log_mean[block] = mean.ln() as f32;
                }
                out.saturated[block] /= samples as f32;
                out.black[block] /= samples as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_the_exposure_is_twice_the_light_in_every_block() {
        let response = Response::srgb();
        let mut reader = ThumbnailReader::new(&response);
        let see = |exposure: f32| {
            let pixels = (0..120 * 80).map(|i| {
                let light = 0.05 + 0.3 * (i % 120) as f32 / 120.0;
                std::array::from_fn(|c| response.value_of(c, light * exposure).round() as u8)
            });
            Rgb8Image::from_pixels(120, 80, pixels.collect()).unwrap()
        };
        let (mut one, mut two) = (Thumbnail::default(), Thumbnail::default());
        reader.read(&see(1.0), &mut one);
        reader.read(&see(2.0), &mut two);
        for block in 0..BLOCKS {
            let ratio = two.well_exposed(block).unwrap() - one.well_exposed(block).unwrap();
            // Rounding of 8-bit values near 60 is 1 % of light at most, and evens out over a block.
            assert!((ratio - 2.0f64.ln()).abs() < 0.01, "{block}: {ratio}");
        }
        assert_eq!(one.counts().iter().sum::<u32>(), 9600);
        assert!(!one.same_bits(&two) && one.same_bits(&one.clone()));
    }

    #[test]
    fn saturated_black_and_empty_blocks_tell_nothing() {
        let mut reader = ThumbnailReader::new(&Response::srgb());
        let mut out = Thumbnail::default();
        for z in [0, 12, 250, 255] {
            reader.read_luminance(24, &[z; 24 * 16], &mut out);
            assert!((0..BLOCKS).all(|block| out.well_exposed(block).is_none()), "{z}");
        }
        assert_eq!((out.saturated(3), out.black(3), out.saturated(BLOCKS)), (1.0, 0.0, 0.0));
        for (width, values) in [(0, 0), (0, 9), (5, 3), (3, 7)] {
            reader.read_luminance(width, &vec![128; values], &mut out);
        }
        reader.read(&Rgb8Image::default(), &mut out);
        assert!(out.well_exposed(0).is_none() && out.well_exposed(usize::MAX).is_none());
    }
}
