//! OpenEXR, through the exr crate, under the size limits of all pictures. The daemon does without it.

use crate::{
    assets::{
        error::{AssetError, read_file},
        pictures::{self, LoadedRadiance, MAX_PIXELS, check_size, ingest},
        whole,
    },
    model::image::{Image, RadianceImage},
};
use exr::{
    meta::MetaData,
    prelude::{
        Encoding, FlatSamples, Image as ExrImage, Layer, LayerAttributes, ReadChannels, ReadLayers,
        SpecificChannels, WritableImage, read,
    },
};
use std::{io::Cursor, path::Path};

/// What an OpenEXR file begins with.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Loads linear radiance: what [`pictures::load_radiance`] reads, and OpenEXR (half or float, any compression that the
/// decoder knows). Texels that are not finite or negative are replaced, flagged and counted (`ingest`).
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

/// Loads floating-point RGB exactly as the file holds it, whatever the sign: for difference pictures, which are
/// no radiance.
///
/// # Errors
/// As `load_radiance`.
pub fn load_raw(file: &Path) -> Result<RadianceImage, AssetError> {
    decode_raw(file, &read_file(file)?)
}

fn decode_raw(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    if bytes.starts_with(&MAGIC) { decode(file, bytes) } else { pictures::decode_raw(file, bytes) }
}

/// Writes linear radiance as OpenEXR: channels R, G, B, 32-bit float, losslessly compressed. Reading it back
/// gives the same bits.
///
/// # Errors
/// An empty picture, or the file cannot be written.
pub fn save_exr_f32(file: &Path, picture: &RadianceImage) -> Result<(), AssetError> {
    check_size(file, picture.width(), picture.height())?;
    let bytes = encode(file, picture)?;
    whole::write(file, bytes)
}

/// Decodes the first layer's R, G, B (or Y alone as grey) over its data window; half, float or integer.
pub fn decode(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    let failed = |e: exr::error::Error| AssetError::new(file, "decode OpenEXR").cause(e);
    // The header is looked at before anything is allocated after it.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(failed)?;
    let mut samples = 0usize;
    for header in &meta.headers {
        check_size(file, header.layer_size.width(), header.layer_size.height())?;
        let pixels = header.layer_size.width() * header.layer_size.height();
        samples = samples.saturating_add(pixels.saturating_mul(header.channels.list.len()));
        if header.channels.list.iter().any(|c| c.sampling.width() != 1 || c.sampling.height() != 1) {
            return Err(AssetError::new(file, "OpenEXR channels").allowed("stored at full resolution"));
        }
    }
    if samples > 4 * MAX_PIXELS {
        return Err(AssetError::new(file, "OpenEXR samples in all layers")
            .value(samples)
            .allowed(format!("at most {}", 4 * MAX_PIXELS)));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(failed)?;
    let layer = &image.layer_data;
    let channel = |name: &str| {
        let found = layer.channel_data.list.iter().find(|c| c.name.eq_case_insensitive(name));
        found.map(|c| &c.sample_data)
    };
    let (r, g, b) = match (channel("R"), channel("G"), channel("B"), channel("Y")) {
        (Some(r), Some(g), Some(b), _) => (r, g, b),
        (None, None, None, Some(y)) => (y, y, y),
        _ => {
            let names: Vec<String> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
            return Err(AssetError::new(file, "OpenEXR channels")
                .value(names.join(", "))
                .allowed("R, G and B, or Y alone, in the first layer"));
        }
    };
    let (width, height) = (layer.size.width(), layer.size.height());
    let count = width * height;
    if [r, g, b].iter().any(|samples| samples.len() != count) {
        return Err(AssetError::new(file, "OpenEXR samples").allowed(format!("{width} x {height} a channel")));
    }
    let pixels = (0..count).map(|i| [sample(r, i), sample(g, i), sample(b, i)]).collect();
    Image::from_pixels(width, height, pixels)
        .ok_or_else(|| AssetError::new(file, "picture size").value(format!("{width} x {height}")))
}

fn sample(samples: &FlatSamples, index: usize) -> f32 {
    match samples {
        FlatSamples::F16(list) => list[index].to_f32(),
        FlatSamples::F32(list) => list[index],
        FlatSamples::U32(list) => list[index] as f32,
    }
}

/// Encodes R, G, B as 32-bit floats, ZIP-compressed scan lines.
pub fn encode(file: &Path, picture: &RadianceImage) -> Result<Vec<u8>, AssetError> {
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
        let [r, g, b] = *picture.at(at.x(), at.y());
        (r, g, b)
    });
    let layer = Layer::new(
        (picture.width(), picture.height()),
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        channels,
    );
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|e| AssetError::new(file, "write OpenEXR").cause(e))?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name() -> &'static Path {
        Path::new("picture.exr")
    }

    fn gradient(width: usize, height: usize) -> RadianceImage {
        let texel = |i: usize| [(i % width) as f32 * 0.37, (i / width) as f32, 1e4 / (1.0 + i as f32)];
        Image::from_pixels(width, height, (0..width * height).map(texel).collect()).unwrap()
    }

    #[test]
    fn a_picture_comes_back_bit_for_bit() {
        let picture = gradient(37, 19);
        let file = std::env::temp_dir().join(format!("halflight-exr-{}.exr", std::process::id()));
        save_exr_f32(&file, &picture).unwrap();
        assert_eq!(load_radiance(&file).unwrap().hdr.radiance, picture);
        // What the product reads alone is refused with the reason.
        let error = pictures::load_radiance(&file).unwrap_err().to_string();
        assert!(error.contains("OpenEXR"), "{error}");
        std::fs::remove_file(&file).unwrap();
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Whatever happens to the bytes: an error or a picture that is finite and not negative, and no panic.
        #[test]
        fn damaged_files_give_an_error_or_a_sound_picture(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
            cut in any::<prop::sample::Index>(),
            cuts in any::<bool>(),
        ) {
            let mut bytes = encode(name(), &gradient(24, 9)).unwrap();
            for (at, byte) in changes {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            if cuts {
                bytes.truncate(cut.index(bytes.len()));
            }
            if let Ok(loaded) = decode_radiance(name(), &bytes) {
                let sound = |c: &f32| c.is_finite() && *c >= 0.0;
                prop_assert!(loaded.hdr.radiance.pixels().iter().flatten().all(sound));
            }
        }
    }
}
