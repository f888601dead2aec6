//! OpenEXR out.

use super::colors;
use crate::{
    assets::{error::AssetError, pictures::check_size, whole},
    model::image::RadianceImage,
};
use exr::{
    image::write::WritableImage,
    math::Vec2,
    prelude::{
        Encoding, Image as ExrImage, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels,
    },
};
use std::{io::Cursor, path::Path};

/// What a file says of its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExrNote<'a> {
    /// What a value means, as its `comments`.
    pub meaning: &'a str,
    /// Exposure time in seconds that the numbers are for; 1 for radiance.
    pub exposure_s: f32,
}

impl Default for ExrNote<'_> {
    fn default() -> Self {
        Self {
            meaning: "Linear radiance, scene-referred, in the scene's own unit (from a camera: 1 gives its value 255 in 1 s at gain 1); R, G, B with Rec. 709 primaries and D65 white, no tone curve",
            exposure_s: 1.0,
        }
    }
}

/// Writes linear radiance as OpenEXR: channels R, G, B, 32-bit float, losslessly compressed. Reading it back
/// gives the same bits.
///
/// # Errors
/// An empty picture, or the file cannot be written.
pub fn save_exr_f32(file: &Path, picture: &RadianceImage) -> Result<(), AssetError> {
    check_size(file, picture.width(), picture.height())?;
    let bytes = encode(file, picture, ExrNote::default())?;
    whole::write(file, bytes)
}

/// Encodes R, G, B as 32-bit floats, ZIP-compressed scan lines, with what they are.
///
/// # Errors
/// The crate refuses the picture.
pub fn encode(file: &Path, picture: &RadianceImage, note: ExrNote<'_>) -> Result<Vec<u8>, AssetError> {
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let [r, g, b] = *picture.at(at.x(), at.y());
        (r, g, b)
    });
    let size = Vec2(picture.width(), picture.height());
    let mut layer = LayerAttributes::default();
    layer.software_name = Some(concat!("half-light ", env!("CARGO_PKG_VERSION")).into());
    layer.comments = Some(note.meaning.into());
    layer.exposure = Some(note.exposure_s);
    let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    attributes.chromaticities = Some(colors::rec709());
    let layer = Layer::new(size, layer, Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::new(attributes, layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|e| AssetError::new(file, "write OpenEXR").cause(e))?;
    Ok(bytes.into_inner())
}
