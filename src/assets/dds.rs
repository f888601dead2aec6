//! Cube maps: DDS files with floating-point texels, and six pictures.

use super::{
    error::{AssetError, read_file},
    pictures::MAX_SIDE,
};
use crate::model::{
    image::RadianceImage,
    light::{EnvironmentMap, MapLayout},
};
use ddsfile::{Caps2, D3D10ResourceDimension, DxgiFormat, FourCC, Header, Header10, MiscFlag};
use half::f16;
use std::path::{Path, PathBuf};

/// Bytes before the texels; a DX10 header adds [`DX10_BYTES`].
const HEADER_BYTES: usize = 128;
const DX10_BYTES: usize = 20;
/// Longest side of a face: six of them make one picture.
const MAX_FACE: usize = MAX_SIDE / 6;

/// Names of the faces in the order in which they are stored.
pub const FACES: [&str; 6] = ["+x", "-x", "+y", "-y", "+z", "-z"];

/// How a colour of a texel is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TexelFloat {
    Half,
    Single,
}

impl TexelFloat {
    /// Bytes of an RGBA texel.
    fn texel_bytes(self) -> usize {
        match self {
            Self::Half => 8,
            Self::Single => 16,
        }
    }

    fn texel(self, bytes: &[u8]) -> [f32; 3] {
        std::array::from_fn(|c| match self {
            Self::Half => f16::from_le_bytes([bytes[2 * c], bytes[2 * c + 1]]).to_f32(),
            Self::Single => {
                f32::from_le_bytes([bytes[4 * c], bytes[4 * c + 1], bytes[4 * c + 2], bytes[4 * c + 3]])
            }
        })
    }
}

/// Loads a cube map from a DDS file: RGBA in half floats (FourCC 113) or single floats (116), or the same with a
/// DX10 header; all six faces; of mip levels the largest, alpha dropped.
///
/// The texels are as the file holds them, also where they are no radiance: `light::maps::samples_of_map` replaces
/// and counts those. The faces stand one under the other in the order [`FACES`].
///
/// # Errors
/// The file cannot be read; its header names another kind of texture, other texels or a size out of bounds; its
/// length is not what the header asks for.
pub fn load_cube(file: &Path) -> Result<EnvironmentMap, AssetError> {
    decode_cube(file, &read_file(file)?)
}

/// [`load_cube`] from bytes; `file` only names them in errors.
///
/// # Errors
/// As [`load_cube`].
pub fn decode_cube(file: &Path, bytes: &[u8]) -> Result<EnvironmentMap, AssetError> {
    let wrong = |what: &str, value: &dyn std::fmt::Display, allowed: &str| {
        Err(AssetError::new(file, what).value(value).allowed(allowed))
    };
    if !bytes.starts_with(b"DDS ") {
        let first: Vec<String> = bytes.iter().take(4).map(|b| format!("{b:02x}")).collect();
        return wrong("first bytes", &first.join(" "), "44 44 53 20 (a DDS file)");
    }
    if bytes.len() < HEADER_BYTES {
        return wrong("length in bytes", &bytes.len(), "at least 128, the header of a DDS file");
    }
    let Ok(header) = Header::read(&bytes[4..]) else {
        return wrong("header sizes", &format!("{} and {}", word(bytes, 4), word(bytes, 76)), "124 and 32");
    };
    let (texel, texels_at) = match header.spf.fourcc.as_ref().map(|code| code.0) {
        Some(FourCC::R16G16B16A16_FLOAT) => (TexelFloat::Half, HEADER_BYTES),
        Some(FourCC::R32G32B32A32_FLOAT) => (TexelFloat::Single, HEADER_BYTES),
        Some(FourCC::DX10) => (dx10_texel(file, bytes)?, HEADER_BYTES + DX10_BYTES),
        code => {
            let name = code.map_or_else(|| "none".to_owned(), four_cc_name);
            return wrong("FourCC", &name, "113 (RGBA half floats), 116 (RGBA floats) or DX10");
        }
    };
    let is_dx10 = texels_at != HEADER_BYTES;
    // With a DX10 header its own flag counts, and some writers leave caps2 empty.
    if !header.caps2.contains(Caps2::CUBEMAP | Caps2::CUBEMAP_ALLFACES) && !is_dx10 {
        let caps2 = format!("{:#x}", word(bytes, 112));
        return wrong("caps2", &caps2, "a cube map with all six faces (0xfe00)");
    }
    let (height, width) = (header.height as usize, header.width as usize);
    if width != height || !(1..=MAX_FACE).contains(&width) {
        let allowed = format!("square, 1 to {MAX_FACE} texels a side");
        return wrong("face size", &format!("{width} x {height}"), &allowed);
    }
    // Writers put 0 or 1 where there is only the largest level, and some forget the flag of those that have more.
    let levels = word(bytes, 28).max(1);
    if levels > width.ilog2() + 1 {
        let allowed = format!("at most {} for faces of {width} texels", width.ilog2() + 1);
        return wrong("mip levels", &levels, &allowed);
    }
    let face_texels: usize = (0..levels).map(|level| (width >> level).max(1).pow(2)).sum();
    let face_bytes = face_texels * texel.texel_bytes();
    let expected = texels_at + 6 * face_bytes;
    if bytes.len() != expected {
        let allowed = format!("{expected} (6 faces of {width} x {width}, {levels} mip levels)");
        return wrong("length in bytes", &bytes.len(), &allowed);
    }
    let mut pixels = Vec::with_capacity(6 * width * width);
    for face in bytes[texels_at..].chunks_exact(face_bytes) {
        let largest = &face[..width * width * texel.texel_bytes()];
        pixels.extend(largest.chunks_exact(texel.texel_bytes()).map(|bytes| texel.texel(bytes)));
    }
    stacked(file, width, pixels)
}

/// A number of the header as it stands there; 0 beyond the end.
fn word(bytes: &[u8], offset: usize) -> u32 {
    bytes.get(offset..offset + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

/// What the DX10 header says, which stands behind the header.
fn dx10_texel(file: &Path, bytes: &[u8]) -> Result<TexelFloat, AssetError> {
    let wrong = |what: &str, value: u32, allowed: &str| {
        Err(AssetError::new(file, what).value(value).allowed(allowed))
    };
    let formats = "10 (R16G16B16A16_FLOAT) or 2 (R32G32B32A32_FLOAT)";
    let Some(header) = bytes.get(HEADER_BYTES..HEADER_BYTES + DX10_BYTES) else {
        return wrong("length in bytes", bytes.len() as u32, "at least 148, the header of a DX10 DDS file");
    };
    let number = |at: usize| word(header, at);
    let Ok(dx10) = Header10::read(header) else {
        // It refuses formats, dimensions and kinds of alpha that it does not know.
        return match (number(4), number(16)) {
            (3, alpha @ 5..) => wrong("DX10 misc flag 2", alpha, "0 to 4 (the kind of alpha)"),
            (3, _) => wrong("DXGI format", number(0), formats),
            (dimension, _) => wrong("DX10 resource dimension", dimension, "3 (a two-dimensional texture)"),
        };
    };
    if dx10.resource_dimension != D3D10ResourceDimension::Texture2D {
        return wrong("DX10 resource dimension", number(4), "3 (a two-dimensional texture)");
    }
    if !dx10.misc_flag.contains(MiscFlag::TEXTURECUBE) {
        return wrong("DX10 misc flag", number(8), "4 (a cube map)");
    }
    // The number of cubes. Some writers put the number of faces; then there must be as much data as one cube has.
    if ![1, 6].contains(&dx10.array_size) {
        return wrong("DX10 array size", dx10.array_size, "1 (one cube map), or 6 (its faces)");
    }
    match dx10.dxgi_format {
        DxgiFormat::R16G16B16A16_Float => Ok(TexelFloat::Half),
        DxgiFormat::R32G32B32A32_Float => Ok(TexelFloat::Single),
        _ => wrong("DXGI format", number(0), formats),
    }
}

/// A FourCC as people write it: its letters, or the number.
fn four_cc_name(code: u32) -> String {
    let letters = code.to_le_bytes();
    if letters.iter().all(u8::is_ascii_graphic) {
        letters.map(char::from).iter().collect()
    } else {
        code.to_string()
    }
}

fn stacked(file: &Path, width: usize, pixels: Vec<[f32; 3]>) -> Result<EnvironmentMap, AssetError> {
    let radiance = RadianceImage::from_pixels(width, 6 * width, pixels)
        .ok_or_else(|| AssetError::new(file, "texels").allowed("as many as six faces hold"))?;
    Ok(EnvironmentMap { layout: MapLayout::Cube, radiance })
}

/// Loads a cube map from six square pictures of one size, in the order [`FACES`], each read by `load`: Radiance, or PNG and
/// JPEG taken as sRGB. Texels are as the files hold them, as with [`load_cube`].
///
/// # Errors
/// One of the files cannot be loaded, is not square, too large, or of another size than the first.
pub fn load_cube_faces(
    files: &[PathBuf; 6],
    load: fn(&Path) -> Result<RadianceImage, AssetError>,
) -> Result<EnvironmentMap, AssetError> {
    let mut pixels = Vec::new();
    let mut side = None;
    for (file, face) in files.iter().zip(FACES) {
        let picture = load(file)?;
        let (width, height) = (picture.width(), picture.height());
        let wanted = side.unwrap_or(width);
        if width != height || width != wanted || width > MAX_FACE {
            let allowed = match side {
                Some(side) => format!("{side} x {side} as face {} is", FACES[0]),
                None => format!("square, 1 to {MAX_FACE} texels a side"),
            };
            return Err(AssetError::new(file, format!("size of face {face}"))
                .value(format!("{width} x {height}"))
                .allowed(allowed));
        }
        side = Some(width);
        pixels.extend_from_slice(picture.pixels());
    }
    stacked(&files[0], side.unwrap_or(0), pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A sound file whose texel k of face f has red 10 f + k, with as many mip levels as asked for.
    fn file_of(width: usize, levels: u32, channel: TexelFloat, dx10: bool) -> Vec<u8> {
        let mut bytes = vec![0u8; HEADER_BYTES];
        bytes[..4].copy_from_slice(b"DDS ");
        let mut put =
            |offset: usize, value: u32| bytes[offset..offset + 4].copy_from_slice(&value.to_le_bytes());
        put(4, 124);
        put(8, 0x1007);
        put(12, width as u32);
        put(16, width as u32);
        put(28, levels);
        put(76, 32);
        put(80, 0x4);
        put(112, 0xfe00);
        let code = match (dx10, channel) {
            (true, _) => u32::from_le_bytes(*b"DX10"),
            (false, TexelFloat::Half) => 113,
            (false, TexelFloat::Single) => 116,
        };
        put(84, code);
        if dx10 {
            let format = if channel == TexelFloat::Half { 10 } else { 2 };
            for value in [format, 3u32, 4, 1, 0] {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
        }
        for face in 0..6 {
            for level in 0..levels.max(1) {
                for k in 0..(width >> level).max(1).pow(2) {
                    let red = if level == 0 { (10 * face + k) as f32 } else { -1.0 };
                    for value in [red, 0.5, -2.0, 1.0] {
                        match channel {
                            TexelFloat::Half => bytes.extend_from_slice(&f16::from_f32(value).to_le_bytes()),
                            TexelFloat::Single => bytes.extend_from_slice(&value.to_le_bytes()),
                        }
                    }
                }
            }
        }
        bytes
    }

    fn decode(bytes: &[u8]) -> Result<EnvironmentMap, String> {
        decode_cube(Path::new("sky.dds"), bytes).map_err(|e| e.to_string())
    }

    #[test]
    fn all_kinds_load_the_largest_level() {
        for channel in [TexelFloat::Half, TexelFloat::Single] {
            for dx10 in [false, true] {
                for levels in [0, 1, 2] {
                    let map = decode(&file_of(2, levels, channel, dx10)).unwrap();
                    assert_eq!(
                        (map.layout, map.radiance.width(), map.radiance.height()),
                        (MapLayout::Cube, 2, 12)
                    );
                    for (k, texel) in map.radiance.pixels().iter().enumerate() {
                        assert_eq!(*texel, [(10 * (k / 4) + k % 4) as f32, 0.5, -2.0]);
                    }
                }
            }
        }
    }

    #[test]
    fn lies_of_the_header_are_named() {
        let said = |offset: usize, value: u32, want: &str| {
            let mut bytes = file_of(4, 1, TexelFloat::Half, false);
            bytes[offset..offset + 4].copy_from_slice(&value.to_le_bytes());
            let error = decode(&bytes).unwrap_err();
            assert!(error.starts_with("sky.dds: ") && error.contains(want), "{error}");
        };
        said(0, 0, "first bytes = 00 00 00 00");
        said(4, 100, "header sizes = 100 and 32");
        said(84, u32::from_le_bytes(*b"DXT5"), "FourCC = DXT5: must be 113");
        said(84, 36, "FourCC = 36");
        said(80, 0x41, "FourCC = none");
        said(112, 0, "caps2 = 0x0: must be a cube map");
        said(112, 0x600, "caps2 = 0x600");
        said(12, 8, "face size = 4 x 8: must be square");
        said(28, 9, "mip levels = 9: must be at most 3");
        said(28, 2, "length in bytes = 896: must be");
        let mut huge = file_of(4, 1, TexelFloat::Half, false);
        for offset in [12, 16] {
            huge[offset..offset + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        }
        assert!(decode(&huge).unwrap_err().contains("face size = 4294967295 x 4294967295"));
        for (offset, value, want) in [
            (128, 28, "DXGI format = 28"),
            (128, 999, "DXGI format = 999"),
            (132, 4, "dimension = 4"),
            (132, 9, "dimension = 9"),
            (136, 0, "misc flag"),
            (140, 2, "array size = 2: must be 1 (one cube map), or 6"),
            (144, 7, "misc flag 2 = 7"),
        ] {
            let mut bytes = file_of(4, 1, TexelFloat::Single, true);
            bytes[offset..offset + 4].copy_from_slice(&u32::to_le_bytes(value));
            let error = decode(&bytes).unwrap_err();
            assert!(error.contains(want), "{error}");
        }
    }

    /// As some writers count: faces in place of cubes. Six cubes are longer than what is read, and refused.
    #[test]
    fn an_array_of_six_with_the_data_of_one_cube_is_that_cube() {
        let one = file_of(4, 1, TexelFloat::Half, true);
        let mut six = one.clone();
        six[140] = 6;
        assert_eq!(decode(&six).unwrap(), decode(&one).unwrap());
        let texels_at = HEADER_BYTES + DX10_BYTES;
        for _ in 0..5 {
            six.extend_from_slice(&one[texels_at..]);
        }
        assert!(decode(&six).unwrap_err().contains("length in bytes = 4756"));
    }

    #[test]
    fn six_pictures_make_a_cube_and_unequal_ones_do_not() {
        let folder = std::env::temp_dir().join(format!("halflight-faces-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files: [PathBuf; 6] = std::array::from_fn(|face| {
            let file = folder.join(format!("{face}.hdr"));
            let picture = RadianceImage::filled(3, 3, [face as f32, 0.25, 1.0]);
            crate::pictures::save_hdr(&file, &picture).unwrap();
            file
        });
        let map = load_cube_faces(&files, crate::pictures::load_raw).unwrap();
        for (k, texel) in map.radiance.pixels().iter().enumerate() {
            assert_eq!(*texel, [(k / 9) as f32, 0.25, 1.0]);
        }
        crate::pictures::save_hdr(&files[4], &RadianceImage::filled(2, 2, [1.0; 3])).unwrap();
        let error = load_cube_faces(&files, crate::pictures::load_raw).unwrap_err().to_string();
        assert!(error.contains("size of face +z = 2 x 2: must be 3 x 3 as face +x is"), "{error}");
        crate::pictures::save_hdr(&files[0], &RadianceImage::filled(2, 3, [1.0; 3])).unwrap();
        let error = load_cube_faces(&files, crate::pictures::load_raw).unwrap_err().to_string();
        assert!(error.contains("size of face +x = 2 x 3: must be square"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    proptest! {
        #[test]
        fn cut_files_are_refused(keep in 0usize..500, dx10: bool) {
            let bytes = file_of(2, 2, TexelFloat::Half, dx10);
            prop_assume!(keep < bytes.len());
            prop_assert!(decode(&bytes[..keep]).is_err());
        }

        #[test]
        fn changed_headers_never_panic(
            changes in prop::collection::vec((0usize..148, any::<u8>()), 1..6),
            dx10: bool,
        ) {
            // What is taken must still agree with the length, so memory is bounded by it.
            let mut bytes = file_of(4, 3, TexelFloat::Single, dx10);
            for (offset, value) in changes {
                bytes[offset] = value;
            }
            if let Ok(map) = decode(&bytes) {
                prop_assert!(map.radiance.pixels().len() * 8 <= bytes.len());
            }
        }

        #[test]
        fn noise_is_refused(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            if bytes.len() >= 4 {
                bytes[..4].copy_from_slice(b"DDS ");
            }
            prop_assert!(decode(&bytes).is_err());
        }
    }
}
