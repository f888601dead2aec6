//! Radiance pictures (.hdr, .pic): a text header, then scan lines of shared-exponent pixels.
//!
//! Pixels are mantissa times 2^(exponent - 136), exponent 0 is black (the common reading, without Radiance's own
//! half step). `EXPOSURE` and `COLORCORR` lines are multipliers already applied to the pixels: they are
//! divided out. Only Y-major pictures are read; flips are undone.

use super::check_size;
use crate::{
    error::AssetError,
    model::image::{Image, RadianceImage},
};
use std::path::Path;

/// Longest header in bytes.
const MAX_HEADER_BYTES: usize = 64 << 10;

struct Header {
    width: usize,
    height: usize,
    bottom_up: bool,
    right_to_left: bool,
    /// By what decoded pixels are multiplied.
    scale_rgb: [f64; 3],
    /// Where the pixels begin.
    pixels_at: usize,
}

/// Decodes a picture; values are as stored (the caller ingests them).
pub fn decode(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    let header = header(file, bytes)?;
    let (width, height) = (header.width, header.height);
    let mut reader = Scanlines { file, bytes, at: header.pixels_at };
    // Grown row by row: a header that lies about the height runs out of bytes first.
    let mut pixels: Vec<[f32; 3]> = Vec::new();
    let mut line = vec![[0u8; 4]; width];
    let scale = header.scale_rgb.map(|s| s as f32);
    for row in 0..height {
        reader.read(row, &mut line)?;
        if header.right_to_left {
            line.reverse();
        }
        pixels.extend(line.iter().map(|&rgbe| {
            let [r, g, b] = from_rgbe(rgbe);
            [r * scale[0], g * scale[1], b * scale[2]]
        }));
    }
    if header.bottom_up {
        pixels = pixels.chunks_exact(width).rev().flatten().copied().collect();
    }
    Image::from_pixels(width, height, pixels)
        .ok_or_else(|| AssetError::new(file, "picture size").value(format!("{width} x {height}")))
}

fn from_rgbe([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    let scale = 2.0f64.powi(i32::from(e) - 136);
    [r, g, b].map(|mantissa| (f64::from(mantissa) * scale) as f32)
}

fn header(file: &Path, bytes: &[u8]) -> Result<Header, AssetError> {
    let mut at = 0;
    let mut lines = Vec::new();
    let next_line = |at: &mut usize| -> Result<String, AssetError> {
        let limit = bytes.len().min(MAX_HEADER_BYTES);
        let rest = &bytes[(*at).min(limit)..limit];
        let Some(length) = rest.iter().position(|&b| b == b'\n') else {
            return Err(AssetError::new(file, "Radiance header").allowed("ended by an empty line"));
        };
        *at += length + 1;
        if rest[..length].last() == Some(&b'\r') {
            return Err(AssetError::new(file, "Radiance header's line ends")
                .value("CR LF")
                .allowed("LF alone: the file was mangled by a transfer as text, and so were its pixels"));
        }
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    };
    loop {
        let line = next_line(&mut at)?;
        if line.is_empty() {
            break;
        }
        lines.push(line);
    }
    // Some programs write lines of their own before the identifier, so it may stand anywhere in the header.
    if !lines.iter().any(|l| l.starts_with("#?RADIANCE") || l.starts_with("#?RGBE")) {
        return Err(
            AssetError::new(file, "Radiance header").allowed("a text with a line #?RADIANCE or #?RGBE")
        );
    }
    let mut scale_rgb = [1.0f64; 3];
    // What is indented is the header of a picture that this one was made of.
    for line in lines.iter().filter(|line| !line.starts_with(char::is_whitespace)) {
        let Some((key, text)) = line.split_once('=') else { continue };
        let text = text.trim();
        let wrong = |allowed: &str| AssetError::new(file, key.trim()).value(text).allowed(allowed);
        match key.trim() {
            "FORMAT" if text != "32-bit_rle_rgbe" => return Err(wrong("32-bit_rle_rgbe")),
            "EXPOSURE" => {
                let factor = positive(text).ok_or_else(|| wrong("a positive number"))?;
                scale_rgb = scale_rgb.map(|s| s / factor);
            }
            "COLORCORR" => {
                let factors: Option<Vec<f64>> = text.split_whitespace().map(positive).collect();
                let Some(&[r, g, b]) = factors.as_deref() else {
                    return Err(wrong("three positive numbers"));
                };
                scale_rgb = [scale_rgb[0] / r, scale_rgb[1] / g, scale_rgb[2] / b];
            }
            "GAMMA" if positive(text).is_none_or(|g| (g - 1.0).abs() > 1e-6) => {
                return Err(wrong("1: the pixels must be linear"));
            }
            _ => {}
        }
    }
    let size = next_line(&mut at)?;
    let words: Vec<&str> = size.split_whitespace().collect();
    let wrong = || AssetError::new(file, "Radiance size line").value(&size).allowed("like -Y 512 +X 1024");
    let &[y, height, x, width] = words.as_slice() else { return Err(wrong()) };
    let (bottom_up, right_to_left) = match (y, x) {
        ("-Y", "+X") => (false, false),
        ("-Y", "-X") => (false, true),
        ("+Y", "+X") => (true, false),
        ("+Y", "-X") => (true, true),
        _ => return Err(wrong()),
    };
    let (Ok(width), Ok(height)) = (width.parse(), height.parse()) else { return Err(wrong()) };
    check_size(file, width, height)?;
    Ok(Header { width, height, bottom_up, right_to_left, scale_rgb, pixels_at: at })
}

fn positive(text: &str) -> Option<f64> {
    text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 1e-30 && *x < 1e30)
}

struct Scanlines<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl Scanlines<'_> {
    fn broken(&self, row: usize, why: &str) -> AssetError {
        AssetError::new(self.file, format!("pixels of row {row}, byte {}", self.at))
            .allowed("sound run-length data")
            .cause(why)
    }

    fn take<const N: usize>(&mut self, row: usize) -> Result<[u8; N], AssetError> {
        let taken = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()).copied();
        let Some(taken) = taken else { return Err(self.broken(row, "the file ends early")) };
        self.at += N;
        Ok(taken)
    }

    fn read(&mut self, row: usize, line: &mut [[u8; 4]]) -> Result<(), AssetError> {
        let width = line.len();
        let head: [u8; 4] = self.take(row)?;
        if !(8..=0x7fff).contains(&width) || head[0] != 2 || head[1] != 2 || head[2] >= 128 {
            return self.read_flat(row, head, line);
        }
        if usize::from(head[2]) << 8 | usize::from(head[3]) != width {
            return Err(self.broken(row, "its stated length is not the picture's width"));
        }
        // The four components follow one after the other, each in runs.
        for component in 0..4 {
            let mut x = 0;
            while x < width {
                let [count] = self.take(row)?;
                let (run, length) = if count > 128 { (true, count - 128) } else { (false, count) };
                let length = usize::from(length);
                if length == 0 || x + length > width {
                    return Err(self.broken(row, "a run is empty or leaves the row"));
                }
                if run {
                    let [repeated] = self.take(row)?;
                    line[x..x + length].iter_mut().for_each(|p| p[component] = repeated);
                } else {
                    let bytes = self.bytes.get(self.at..self.at + length);
                    let Some(bytes) = bytes else { return Err(self.broken(row, "the file ends early")) };
                    line[x..x + length].iter_mut().zip(bytes).for_each(|(p, &b)| p[component] = b);
                    self.at += length;
                }
                x += length;
            }
        }
        Ok(())
    }

    /// Pixels one by one; 1 1 1 n repeats the last pixel n times (n shifted by 8 bits for each repeat in a row).
    fn read_flat(&mut self, row: usize, first: [u8; 4], line: &mut [[u8; 4]]) -> Result<(), AssetError> {
        let mut pixel = first;
        let (mut x, mut shift) = (0, 0);
        loop {
            if pixel[..3] == [1, 1, 1] {
                let count = usize::from(pixel[3]) << shift;
                if x == 0 || count == 0 || x + count > line.len() {
                    return Err(self.broken(row, "a repeat is empty, has no pixel or leaves the row"));
                }
                let repeated = line[x - 1];
                line[x..x + count].fill(repeated);
                x += count;
                // A count above 24 bits cannot fit in any row.
                shift = (shift + 8).min(24);
            } else {
                line[x] = pixel;
                x += 1;
                shift = 0;
            }
            if x == line.len() {
                return Ok(());
            }
            pixel = self.take(row)?;
        }
    }
}

/// Encodes finite radiance, rounded to the nearest mantissa, in flat pixels of 4 bytes.
pub fn encode(picture: &RadianceImage) -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n".to_vec();
    bytes.extend(format!("-Y {} +X {}\n", picture.height(), picture.width()).bytes());
    // A pixel that is not black has a mantissa of 128 or more, so none can be read as a repeat (1 1 1 n) or as
    // the mark of a run-length row (2 2 n).
    bytes.extend(picture.pixels().iter().flat_map(|&rgb| to_rgbe(rgb)));
    bytes
}

fn to_rgbe(rgb: [f32; 3]) -> [u8; 4] {
    let largest = rgb.iter().fold(0.0f32, |a, &b| a.max(b));
    if !largest.is_finite() || largest < 1e-32 {
        return [0; 4];
    }
    // exponent with largest / 2^exponent within [0.5, 1)
    let mut exponent = f64::from(largest).log2().floor() as i32 + 1;
    if (f64::from(largest) * 2.0f64.powi(8 - exponent)).round() > 255.0 {
        exponent += 1;
    }
    let scale = 2.0f64.powi(8 - exponent);
    let [r, g, b] = rgb.map(|c| (f64::from(c.max(0.0)) * scale).round().min(255.0) as u8);
    [r, g, b, (exponent + 128).clamp(1, 255) as u8]
}
