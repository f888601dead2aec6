//! OpenEXR, through the exr crate, under the size limits of all pictures. The daemon does without it.
//!
//! The picture is the display window: what the data window lacks of it is 0, what it has beyond is left out. Colours come out in
//! our space, Rec. 709 primaries and D65 white, whatever the file's `chromaticities` say. Of several parts the first that has
//! R, G and B (or Y alone) is read.
#![allow(
    clippy::field_reassign_with_default,
    reason = "attributes have dozens of fields, of which few are stated"
)]

use crate::{
    assets::{
        error::{AssetError, read_file},
        pictures::{self, LoadedRadiance, MAX_PIXELS, check_size, ingest},
    },
    light::maps::MapAxes,
    model::image::RadianceImage,
};
use exr::{
    image::read::specific_channels::ReadSpecificChannel,
    math::Vec2,
    meta::{
        MetaData,
        attribute::{EnvironmentMap, Text},
        header::Header,
    },
    prelude::{ReadChannels, ReadLayers, read},
};
use std::{io::Cursor, path::Path};

mod colors;
mod write;

pub use write::{ExrNote, encode, save_exr_f32};

/// What an OpenEXR file begins with.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Loads linear radiance: what [`pictures::load_radiance`] reads, and OpenEXR (half or float, any compression that the
/// decoder knows). Texels that are not finite or negative are replaced, flagged and counted (`ingest`); colours that Rec. 709
/// does not hold lose what is negative in it. A cube map in OpenEXR's own layout comes out as ours, for the axes of [`stated_axes`].
///
/// # Errors
/// The file cannot be read, is of another kind, is damaged, or exceeds the size limits.
pub fn load_radiance(file: &Path) -> Result<LoadedRadiance, AssetError> {
    decode_radiance(file, &read_file(file)?)
}

/// `load_radiance` from bytes; `file` only names them in errors.
///
/// # Errors
/// As `load_radiance`.
pub fn decode_radiance(file: &Path, bytes: &[u8]) -> Result<LoadedRadiance, AssetError> {
    decode_raw(file, bytes).map(ingest)
}

/// Loads floating-point RGB as the file holds it, whatever the sign: for difference pictures, which are no radiance. Primaries
/// and cube maps are brought into ours as with `load_radiance`.
///
/// # Errors
/// As `load_radiance`.
pub fn load_raw(file: &Path) -> Result<RadianceImage, AssetError> {
    decode_raw(file, &read_file(file)?)
}

fn decode_raw(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    if !bytes.starts_with(&MAGIC) {
        return pictures::decode_raw(file, bytes);
    }
    let part = ExrPart::find(file, bytes)?;
    let mut picture = part.pixels(file, bytes)?;
    if let Some(matrix) = part.to_rec709(file)? {
        picture.pixels_mut().iter_mut().for_each(|texel| *texel = colors::within(matrix, *texel));
    }
    if part.is_cube() {
        exchange_front_and_back(&mut picture);
    }
    Ok(picture)
}

/// The axes that an OpenEXR cube map has by its own layout (attribute `envmap`), as [`load_radiance`] gives it; `None` for all
/// other pictures, whose axes nobody knows but their user.
///
/// # Errors
/// As `load_radiance`.
pub fn stated_axes(file: &Path) -> Result<Option<MapAxes>, AssetError> {
    let bytes = read_file(file)?;
    if !bytes.starts_with(&MAGIC) {
        return Ok(None);
    }
    Ok(ExrPart::find(file, &bytes)?.is_cube().then_some(MapAxes::YUp))
}

/// OpenEXR's cube is right-handed, y up: on +x, columns grow with z and rows fall with y. That is the layout of D3D and GL with z
/// turned round, and so with the faces +z and -z exchanged (`sphere::cube_direction`).
fn exchange_front_and_back(picture: &mut RadianceImage) {
    let face = picture.width() * picture.width();
    if let Some((front, back)) = picture.pixels_mut()[4 * face..].split_at_mut_checked(face) {
        front.swap_with_slice(back);
    }
}

/// The part of a file that is read.
struct ExrPart {
    header: Header,
    /// Columns and rows of the display window.
    size: (usize, usize),
    channels: [Text; 3],
}

impl ExrPart {
    /// The first part that has R, G and B, or Y without chroma. Sizes are checked before anything is allocated after them.
    fn find(file: &Path, bytes: &[u8]) -> Result<Self, AssetError> {
        let failed = |e: exr::error::Error| AssetError::new(file, "decode OpenEXR").cause(e);
        let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(failed)?;
        let found = meta.headers.iter().filter(|h| !h.deep).find_map(|h| Some((h, rgb_of(h)?)));
        let Some((header, channels)) = found else {
            return Err(AssetError::new(file, "OpenEXR channels").value(names(&meta.headers)).allowed(
                "R, G and B, or Y without RY and BY, at full resolution and not deep, in one part, without a layer's name",
            ));
        };
        let display = header.shared_attributes.display_window.size;
        let size = (display.width(), display.height());
        check_size(file, size.0, size.1).map_err(|e| e.inside("display window"))?;
        let (width, height) = (header.layer_size.width(), header.layer_size.height());
        check_size(file, width, height).map_err(|e| e.inside("data window"))?;
        let samples = (width * height).saturating_mul(header.channels.list.len());
        if samples > 4 * MAX_PIXELS {
            return Err(AssetError::new(file, "OpenEXR samples in all channels")
                .value(samples)
                .allowed(format!("at most {}", 4 * MAX_PIXELS)));
        }
        Ok(Self { header: header.clone(), size, channels })
    }

    fn is_cube(&self) -> bool {
        let stated = self.header.own_attributes.environment_map == Some(EnvironmentMap::Cube);
        stated && self.size.1 == 6 * self.size.0
    }

    /// What brings the file's colours into our space; `None` where they are in it, or where the picture is gray.
    fn to_rec709(&self, file: &Path) -> Result<Option<glam::DMat3>, AssetError> {
        match self.header.shared_attributes.chromaticities {
            Some(stated) if self.channels[0] != self.channels[1] => colors::to_rec709(&stated)
                .ok_or_else(|| {
                    AssetError::new(file, "OpenEXR chromaticities")
                        .value(format!("{stated:?}"))
                        .allowed("three primaries that span a triangle, and a white within it")
                })
                .map(|matrix| matrix.filter(|m| *m != glam::DMat3::IDENTITY)),
            _ => Ok(None),
        }
    }

    /// The display window's pixels, as the file holds them.
    fn pixels(&self, file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
        let failed = |e: exr::error::Error| AssetError::new(file, "decode OpenEXR").cause(e);
        let (display, data) = (self.header.shared_attributes.display_window, &self.header.own_attributes);
        // Where the data window's first pixel lies in the display window.
        let shift = |data: i32, display: i32| i64::from(data) - i64::from(display);
        let at = [
            shift(data.layer_position.x(), display.position.x()),
            shift(data.layer_position.y(), display.position.y()),
        ];
        let (size, rows) = (self.size, self.header.layer_size.height());
        let canvas = move || Canvas {
            picture: RadianceImage::filled(size.0, size.1, [0.0; 3]),
            at,
            rows: vec![0; rows],
        };
        let [r, g, b] = self.channels.clone();
        let canvas = if r == g {
            let reader = read().no_deep_data().largest_resolution_level().specific_channels().required(r);
            let image = reader
                .collect_pixels(
                    move |_size, _channels| canvas(),
                    |canvas: &mut Canvas, at, (y,): (f32,)| canvas.put(at, [y; 3]),
                )
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(Cursor::new(bytes))
                .map_err(failed)?;
            image.layer_data.channel_data.pixels
        } else {
            let reader = read().no_deep_data().largest_resolution_level().specific_channels();
            let image = reader
                .required(r)
                .required(g)
                .required(b)
                .collect_pixels(
                    move |_size, _channels| canvas(),
                    |canvas: &mut Canvas, at, (r, g, b): (f32, f32, f32)| canvas.put(at, [r, g, b]),
                )
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(Cursor::new(bytes))
                .map_err(failed)?;
            image.layer_data.channel_data.pixels
        };
        let width = self.header.layer_size.width();
        if let Some(row) = canvas.rows.iter().position(|pixels| *pixels as usize != width) {
            return Err(AssetError::new(file, format!("row {row} of the data window"))
                .value(format!("{} pixels", canvas.rows[row]))
                .allowed(format!("{width} pixels: the file is cut or damaged")));
        }
        Ok(canvas.picture)
    }
}

/// The display window, which is filled as pixels of the data window come.
struct Canvas {
    picture: RadianceImage,
    at: [i64; 2],
    /// Pixels that came, for each row of the data window.
    rows: Vec<u32>,
}

impl Canvas {
    fn put(&mut self, at: Vec2<usize>, texel: [f32; 3]) {
        if let Some(count) = self.rows.get_mut(at.y()) {
            *count += 1;
        }
        let place = |k: usize, at: usize| usize::try_from(self.at[k] + at as i64).ok();
        let (Some(x), Some(y)) = (place(0, at.x()), place(1, at.y())) else { return };
        if x < self.picture.width() && y < self.picture.height() {
            *self.picture.at_mut(x, y) = texel;
        }
    }
}

/// Names of red, green and blue in a part, or of its luminance three times.
fn rgb_of(header: &Header) -> Option<[Text; 3]> {
    let list = &header.channels.list;
    if list.iter().any(|c| c.sampling.width() != 1 || c.sampling.height() != 1) {
        return None;
    }
    let named = |name: &str| list.iter().find(|c| c.name.eq_case_insensitive(name)).map(|c| c.name.clone());
    match (named("R"), named("G"), named("B")) {
        (Some(r), Some(g), Some(b)) => Some([r, g, b]),
        (None, None, None) if named("RY").is_none() && named("BY").is_none() => {
            let y = named("Y")?;
            Some([y.clone(), y.clone(), y])
        }
        _ => None,
    }
}

/// Channels of all parts, for messages.
fn names(headers: &[Header]) -> String {
    /// Channels that are named at most.
    const MOST: usize = 24;
    let mut all = Vec::new();
    for (index, header) in headers.iter().enumerate() {
        let part = match &header.own_attributes.layer_name {
            Some(name) => format!("{name}: "),
            None if headers.len() > 1 => format!("part {index}: "),
            None => String::new(),
        };
        let deep = if header.deep { " (deep)" } else { "" };
        for channel in &header.channels.list {
            let sampling = channel.sampling;
            let coarse = if sampling.width() > 1 || sampling.height() > 1 {
                format!(" (one for {} x {} pixels)", sampling.width(), sampling.height())
            } else {
                String::new()
            };
            all.push(format!("{part}{}{deep}{coarse}", channel.name));
        }
    }
    let more = all.len().saturating_sub(MOST);
    all.truncate(MOST);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", all.join(", "))
}

#[cfg(test)]
mod tests;
