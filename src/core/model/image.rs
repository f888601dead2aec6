//! Row-major images.

/// A row-major image, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image<P> {
    width: usize,
    height: usize,
    pixels: Vec<P>,
}

impl<P: Clone> Image<P> {
    /// An image of one value.
    pub fn filled(width: usize, height: usize, pixel: P) -> Self {
        Self { width, height, pixels: vec![pixel; width * height] }
    }

    /// Takes pixels; `None` unless there are width x height of them.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<P>) -> Option<Self> {
        (pixels.len() == width * height).then_some(Self { width, height, pixels })
    }

    /// Makes this image width x height, keeping its memory where it suffices; pixels keep old values.
    pub fn reshape(&mut self, width: usize, height: usize, fill: P) {
        self.pixels.resize(width * height, fill);
        self.width = width;
        self.height = height;
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> &[P] {
        &self.pixels
    }

    /// All pixels, row by row.
    pub fn pixels_mut(&mut self) -> &mut [P] {
        &mut self.pixels
    }

    /// One row.
    pub fn row(&self, y: usize) -> &[P] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// The pixel at column x, row y. Panics outside.
    pub fn at(&self, x: usize, y: usize) -> &P {
        &self.pixels[y * self.width + x]
    }

    /// The pixel at column x, row y. Panics outside.
    pub fn at_mut(&mut self, x: usize, y: usize) -> &mut P {
        &mut self.pixels[y * self.width + x]
    }
}

/// 8-bit RGB as a camera gives it (through its response).
pub type Rgb8Image = Image<[u8; 3]>;
/// Linear RGB radiance.
pub type RadianceImage = Image<[f32; 3]>;

/// The channel's radiance is only known to be at least this (saturated in the shortest exposure).
pub const LOWER_BOUND: u8 = 1;
/// The channel's radiance is only known to be at most this (black in the longest exposure). Merged at a sensor's own fineness it
/// is the best estimate of what is not told from none.
pub const UPPER_BOUND: u8 = 2;
/// The value was not finite and has been replaced.
pub const NOT_FINITE: u8 = 4;
/// The value was filled from elsewhere, not measured.
pub const FILLED: u8 = 8;

/// A merged picture: linear radiance, and for each pixel the flags of its worst channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HdrImage {
    /// Linear RGB radiance, finite and not negative.
    pub radiance: RadianceImage,
    /// Bits `LOWER_BOUND`, `UPPER_BOUND`, `NOT_FINITE`, `FILLED`; same size.
    pub flags: Image<u8>,
}
