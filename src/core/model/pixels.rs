//! A camera's picture as its driver gives it: bytes in a closed set of formats, in memory that goes back to its owner.
//!
//! All bounds are checked once, when a [`FramePixels`] is made; rows are then slices of known length.

use super::image::Rgb8Image;
#[cfg(unix)]
use std::os::fd::BorrowedFd;
use std::sync::Arc;

/// Which colour stands at the four places of a Bayer sensor's cell, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BayerOrder {
    /// Red at the upper left.
    Rggb,
    /// Green, with red to its right.
    Grbg,
    /// Green, with blue to its right.
    Gbrg,
    /// Blue at the upper left.
    Bggr,
}

impl BayerOrder {
    /// Each of them once.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Grbg, Self::Gbrg, Self::Bggr];

    /// The channel (0 red, 1 green, 2 blue) of the pixel at a column and a row.
    pub fn channel(self, x: usize, y: usize) -> usize {
        let cell = match self {
            Self::Rggb => [0, 1, 1, 2],
            Self::Grbg => [1, 0, 2, 1],
            Self::Gbrg => [1, 2, 0, 1],
            Self::Bggr => [2, 1, 1, 0],
        };
        cell[(y & 1) * 2 + (x & 1)]
    }
}

/// How a Bayer sensor's values lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BayerDepth {
    /// A byte each.
    Bits8,
    /// 10 bits in two bytes, little-endian.
    Bits10,
    /// 10 bits; four values in five bytes, the fifth with the lowest bits (MIPI RAW10).
    Bits10Packed,
    /// 12 bits in two bytes, little-endian.
    Bits12,
    /// 12 bits; two values in three bytes, the third with the lowest bits (MIPI RAW12).
    Bits12Packed,
    /// 16 bits in two bytes, little-endian.
    Bits16,
}

impl BayerDepth {
    /// Each of them once.
    pub const ALL: [Self; 6] =
        [Self::Bits8, Self::Bits10, Self::Bits10Packed, Self::Bits12, Self::Bits12Packed, Self::Bits16];

    /// The largest value.
    pub fn white(self) -> u16 {
        match self {
            Self::Bits8 => 255,
            Self::Bits10 | Self::Bits10Packed => 1023,
            Self::Bits12 | Self::Bits12Packed => 4095,
            Self::Bits16 => 65535,
        }
    }

    /// Bytes that a row of this many values takes.
    pub fn row_bytes(self, width: usize) -> usize {
        match self {
            Self::Bits8 => width,
            Self::Bits10 | Self::Bits12 | Self::Bits16 => 2 * width,
            // The last group takes all of its bytes, though not all of its values may be there.
            Self::Bits10Packed => width.div_ceil(4) * 5,
            Self::Bits12Packed => width.div_ceil(2) * 3,
        }
    }

    /// The value at a column of a row. Bits above the depth are ignored.
    pub fn value(self, row: &[u8], x: usize) -> u16 {
        match self {
            Self::Bits8 => u16::from(row[x]),
            Self::Bits10 | Self::Bits12 | Self::Bits16 => {
                u16::from_le_bytes([row[2 * x], row[2 * x + 1]]) & self.white()
            }
            Self::Bits10Packed => {
                let group = x / 4 * 5;
                let low = row[group + 4] >> (2 * (x % 4)) & 3;
                u16::from(row[group + x % 4]) << 2 | u16::from(low)
            }
            Self::Bits12Packed => {
                let group = x / 2 * 3;
                let low = row[group + 2] >> (4 * (x % 2)) & 15;
                u16::from(row[group + x % 2]) << 4 | u16::from(low)
            }
        }
    }
}

/// What the bytes of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// Red, green, blue, a byte each.
    Rgb24,
    /// Two pixels in four bytes: Y, Cb, Y, Cr.
    Yuyv,
    /// Two pixels in four bytes: Cb, Y, Cr, Y.
    Uyvy,
    /// A plane of Y, then a plane of Cb, Cr pairs of half the width and height; both planes have the same stride.
    Nv12,
    /// Y alone.
    Grey,
    /// A sensor's own values, linear in light.
    Bayer(BayerOrder, BayerDepth),
    /// One JPEG file.
    Mjpeg,
}

/// What value a Y, Cb or Cr byte stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum YuvRange {
    /// 0 to 255.
    Full,
    /// Y 16 to 235, Cb and Cr 16 to 240.
    Limited,
}

/// How Y, Cb, Cr are made of red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum YuvMatrix {
    /// ITU-R BT.601: webcams, JPEG.
    Bt601,
    /// ITU-R BT.709: high definition.
    Bt709,
}

impl YuvMatrix {
    /// Weights of red and blue in Y.
    pub fn red_and_blue(self) -> (f64, f64) {
        match self {
            Self::Bt601 => (0.299, 0.114),
            Self::Bt709 => (0.2126, 0.0722),
        }
    }
}

/// Format and shape of a picture in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelLayout {
    /// What the bytes mean.
    pub format: PixelFormat,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes from one row to the next. Not used for MJPEG.
    pub stride: usize,
    /// Of Y, Cb, Cr formats and `Grey`.
    pub range: YuvRange,
    /// Of Y, Cb, Cr formats.
    pub matrix: YuvMatrix,
    /// Time from reading one row to reading the next, seconds; 0 where all rows are read at once.
    pub row_time_s: f64,
}

/// Why bytes are no picture of a layout.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PixelError {
    /// No picture, or one that no camera makes.
    #[error("a picture of {width} x {height} pixels: each must be within 1..={}", PixelLayout::LARGEST_SIDE)]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Rows would overlap.
    #[error("{format:?}, {width} pixels wide: the stride is {stride} bytes, must be at least {least}")]
    Stride {
        /// What the bytes are said to be.
        format: PixelFormat,
        /// Columns.
        width: usize,
        /// As given.
        stride: usize,
        /// A row's bytes.
        least: usize,
    },
    /// Not enough bytes.
    #[error("{format:?}, {width} x {height}: {length} bytes were given, must be at least {least}")]
    Length {
        /// What the bytes are said to be.
        format: PixelFormat,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// As given.
        length: usize,
        /// Needed.
        least: usize,
    },
    /// The buffer's owner says that more was filled than there is.
    #[error("{used} bytes were filled of a buffer of {length}")]
    Used {
        /// Filled.
        used: usize,
        /// Length of the buffer.
        length: usize,
    },
    /// A time that no camera has.
    #[error("row_time_s = {0}: must be within 0..=0.001 s")]
    RowTime(f64),
}

impl PixelLayout {
    /// The longest side of a picture, pixels.
    pub const LARGEST_SIDE: usize = super::limits::MAX_SIDE;

    /// Rows that follow each other without a gap; full range, BT.601, all rows read at once.
    pub fn packed(format: PixelFormat, width: usize, height: usize) -> Self {
        let mut layout = Self {
            format,
            width,
            height,
            stride: 0,
            range: YuvRange::Full,
            matrix: YuvMatrix::Bt601,
            row_time_s: 0.0,
        };
        layout.stride = layout.row_bytes();
        layout
    }

    /// Bytes of a row that count; 0 for MJPEG.
    pub fn row_bytes(&self) -> usize {
        match self.format {
            PixelFormat::Rgb24 => 3 * self.width,
            // An odd last pixel has its chroma with it.
            PixelFormat::Yuyv | PixelFormat::Uyvy => self.width.div_ceil(2) * 4,
            PixelFormat::Nv12 => self.width.div_ceil(2) * 2,
            PixelFormat::Grey => self.width,
            PixelFormat::Bayer(_, depth) => depth.row_bytes(self.width),
            PixelFormat::Mjpeg => 0,
        }
    }

    /// Rows in memory: NV12 has those of its chroma as well.
    pub fn rows_in_memory(&self) -> usize {
        match self.format {
            PixelFormat::Nv12 => self.height + self.height.div_ceil(2),
            PixelFormat::Mjpeg => 0,
            _ => self.height,
        }
    }

    /// The least bytes of a picture: the last row needs no padding. At least 4 for MJPEG (its two markers).
    pub fn least_bytes(&self) -> usize {
        match self.rows_in_memory() {
            0 => 4,
            rows => (rows - 1) * self.stride + self.row_bytes(),
        }
    }

    /// Checks all that does not depend on the bytes.
    pub fn check(&self) -> Result<(), PixelError> {
        let sides = 1..=Self::LARGEST_SIDE;
        let (width, height) = (self.width, self.height);
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(PixelError::Size { width, height });
        }
        // The bound keeps all products far from overflow.
        let least = self.row_bytes();
        if self.format != PixelFormat::Mjpeg && !(least..=16 * Self::LARGEST_SIDE).contains(&self.stride) {
            return Err(PixelError::Stride { format: self.format, width, stride: self.stride, least });
        }
        if !(0.0..=1e-3).contains(&self.row_time_s) {
            return Err(PixelError::RowTime(self.row_time_s));
        }
        Ok(())
    }

    /// Seconds from the middle row's time to the time of row `y` (row 0 is the upper edge, rows have their middle at +0.5).
    pub fn seconds_of_row(&self, y: f64) -> f64 {
        (y + 0.5 - 0.5 * self.height as f64) * self.row_time_s
    }
}

/// Memory that holds a picture: a plain buffer, or a driver's buffer mapped into the process. The memory stays valid for as
/// long as somebody holds it.
pub trait PixelMemory: Send + Sync {
    /// All bytes.
    fn bytes(&self) -> &[u8];

    /// The same memory for other devices; `None` where it cannot be handed to them. It is theirs to read as long as this
    /// memory is held.
    #[cfg(unix)]
    fn dma_buf(&self) -> Option<BorrowedFd<'_>> {
        None
    }
}

impl PixelMemory for Vec<u8> {
    fn bytes(&self) -> &[u8] {
        self
    }
}

impl PixelMemory for Rgb8Image {
    fn bytes(&self) -> &[u8] {
        self.pixels().as_flattened()
    }
}

#[derive(Clone)]
enum HeldPixels {
    Image(Arc<Rgb8Image>),
    Lease(Arc<dyn PixelMemory>),
}

/// A picture as a camera's driver gives it. Cloning shares the memory; when the last clone goes, the memory is free for its
/// owner again ([`PixelPool`]).
#[derive(Clone)]
pub struct FramePixels {
    layout: PixelLayout,
    held: HeldPixels,
    begin: usize,
    used: usize,
}

impl FramePixels {
    /// Takes memory of which the first `used` bytes are a picture. An error unless the layout is sound and they suffice.
    pub fn new(layout: PixelLayout, memory: Arc<dyn PixelMemory>, used: usize) -> Result<Self, PixelError> {
        layout.check()?;
        let length = memory.bytes().len();
        if used > length {
            return Err(PixelError::Used { used, length });
        }
        if used < layout.least_bytes() {
            return Err(too_short(&layout, used));
        }
        Ok(Self { layout, held: HeldPixels::Lease(memory), begin: 0, used })
    }

    /// Leaves out what a driver wrote before the picture. An error where what is left is too short.
    pub fn after(self, skipped: usize) -> Result<Self, PixelError> {
        let begin = self.begin.saturating_add(skipped);
        let left = self.used.saturating_sub(begin);
        if left < self.layout.least_bytes() {
            return Err(too_short(&self.layout, left));
        }
        Ok(Self { begin, ..self })
    }

    /// Format and shape.
    pub fn layout(&self) -> &PixelLayout {
        &self.layout
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.layout.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.layout.height
    }

    /// The bytes that were filled.
    pub fn bytes(&self) -> &[u8] {
        match &self.held {
            HeldPixels::Image(image) => image.bytes(),
            HeldPixels::Lease(memory) => &memory.bytes()[self.begin..self.used],
        }
    }

    /// A row in memory, without its padding; NV12's chroma rows follow its `height` rows of Y. Panics outside, and for MJPEG.
    pub fn row(&self, y: usize) -> &[u8] {
        let start = y * self.layout.stride;
        &self.bytes()[start..start + self.layout.row_bytes()]
    }

    /// The picture's memory for a display or a GPU that takes it without a copy, where its driver exports it.
    #[cfg(unix)]
    pub fn dma_buf(&self) -> Option<BorrowedFd<'_>> {
        match &self.held {
            HeldPixels::Image(_) => None,
            HeldPixels::Lease(memory) => memory.dma_buf(),
        }
    }

    /// The picture itself, where it is an 8-bit RGB image of ours.
    pub fn as_image(&self) -> Option<&Arc<Rgb8Image>> {
        match &self.held {
            HeldPixels::Image(image) => Some(image),
            HeldPixels::Lease(_) => None,
        }
    }
}

fn too_short(layout: &PixelLayout, length: usize) -> PixelError {
    let PixelLayout { format, width, height, .. } = *layout;
    PixelError::Length { format, width, height, length, least: layout.least_bytes() }
}

impl std::fmt::Debug for FramePixels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FramePixels").field("layout", &self.layout).field("used", &self.used).finish()
    }
}

impl From<Arc<Rgb8Image>> for FramePixels {
    fn from(image: Arc<Rgb8Image>) -> Self {
        let layout = PixelLayout::packed(PixelFormat::Rgb24, image.width(), image.height());
        let used = image.bytes().len();
        Self { layout, held: HeldPixels::Image(image), begin: 0, used }
    }
}

impl From<Rgb8Image> for FramePixels {
    fn from(image: Rgb8Image) -> Self {
        Arc::new(image).into()
    }
}

/// An owner's buffers, made once. One is lent by cloning its `Arc`, and is free again when nobody else holds it: nothing is
/// allocated and nothing locked for a frame. A driver asks for [`PixelPool::take_back`] before it waits for the next frame,
/// and hands those buffers to the device again.
#[derive(Debug)]
pub struct PixelPool<M> {
    slots: Vec<Arc<M>>,
    lent: Vec<bool>,
}

impl<M: PixelMemory + 'static> PixelPool<M> {
    /// Takes the buffers.
    pub fn new(buffers: impl IntoIterator<Item = M>) -> Self {
        let slots: Vec<Arc<M>> = buffers.into_iter().map(Arc::new).collect();
        Self { lent: vec![false; slots.len()], slots }
    }

    /// Lends buffer `k` as a picture of this layout. `None` where it is lent already or there is no such buffer.
    pub fn lend(
        &mut self,
        k: usize,
        layout: PixelLayout,
        used: usize,
    ) -> Option<Result<FramePixels, PixelError>> {
        let slot = self.slots.get(k)?;
        if std::mem::replace(&mut self.lent[k], true) {
            return None;
        }
        let pixels = FramePixels::new(layout, Arc::<M>::clone(slot), used);
        // What is refused was never lent.
        self.lent[k] = pixels.is_ok();
        Some(pixels)
    }

    /// Gives the next buffer that was lent and has come back, until all are told.
    pub fn take_back(&mut self) -> Option<usize> {
        let back =
            (0..self.slots.len()).find(|&k| self.lent[k] && Arc::get_mut(&mut self.slots[k]).is_some())?;
        self.lent[back] = false;
        Some(back)
    }

    /// A buffer that nobody holds, to be filled by the program itself: its number and its memory. Buffers that have come back
    /// count as taken back.
    pub fn free(&mut self) -> Option<(usize, &mut M)> {
        while self.take_back().is_some() {}
        let k = self.lent.iter().position(|lent| !lent)?;
        Arc::get_mut(&mut self.slots[k]).map(|memory| (k, memory))
    }
}

#[cfg(test)]
mod tests;
