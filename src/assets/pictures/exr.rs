//! OpenEXR, through the exr crate, under our size limits.

use super::{MAX_PIXELS, check_size};
use crate::{
    assets::error::AssetError,
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
