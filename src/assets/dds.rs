//! Cube maps: DirectDraw Surface files of floating-point RGBA, or six pictures.
//!
//! # Frames
//! A DDS cube map is stored in the frame of Direct3D: left-handed, y up, faces in the order +x -x +y -y +z -z, each as
//! seen from inside. `load_cube` gives it in the crate's world: right-handed, z up, by (x, y, z) of the file to
//! (x, z, y): what is up stays up, what is right of something stays right of it, and the file's front (+z) becomes
//! +y. This moves whole texels (faces swap places and turn or flip), so nothing is resampled. The result is a `Cube`
//! map whose texel (i, j) of face f is radiance from `math::sphere::cube_direction(f, u, v)` in world axes,
//! u and v at texel centres. `CubeFrame::AsStored` leaves the file's own axes.

use super::{
    error::{AssetError, read_file},
    pictures::{self, LoadedRadiance, ingest},
};
use crate::{
    math::sphere::{cube_direction, cube_face_uv},
    model::{
        image::{Image, RadianceImage},
        light::{EnvironmentMap, MapLayout},
    },
};
use glam::DVec3;
use half::f16;
use std::path::Path;

/// Longest side of a face, texels: six of them stay within the size limit of pictures.
pub const MAX_FACE: usize = 2048;

/// The frame in which a cube map's faces are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CubeFrame {
    /// Direct3D's: left-handed, y up. Turned into the world by (x, z, y).
    #[default]
    LeftHandedYUp,
    /// Right-handed, y up, such as glTF's. Turned into the world by (x, -z, y).
    RightHandedYUp,
    /// The file's axes are taken as the world's.
    AsStored,
}

impl CubeFrame {
    /// The file's direction for one of the world.
    fn file_from_world(self, d: DVec3) -> DVec3 {
        match self {
            Self::LeftHandedYUp => DVec3::new(d.x, d.z, d.y),
            Self::RightHandedYUp => DVec3::new(d.x, d.z, -d.y),
            Self::AsStored => d,
        }
    }
}

/// A cube map as loaded, with what had to be replaced.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedCube {
    /// Layout `Cube`: six square faces one under the other.
    pub map: EnvironmentMap,
    /// Counts of bad texels.
    pub replaced: pictures::Replaced,
}

/// Loads a DDS cube map (FourCC 113 RGBA16F or 116 RGBA32F, or DX10 with the same formats) from Direct3D's frame into
/// the world's.
///
/// # Errors
/// The file cannot be read, is no cube map with six square faces, has another format, or is shorter than its header says.
pub fn load_cube(file: &Path) -> Result<LoadedCube, AssetError> {
    load_cube_in(file, CubeFrame::default())
}

/// `load_cube` with the file's frame stated.
///
/// # Errors
/// As `load_cube`.
pub fn load_cube_in(file: &Path, frame: CubeFrame) -> Result<LoadedCube, AssetError> {
    finish(decode(file, &read_file(file)?)?, frame)
}

/// Six pictures as a cube map, in the order +x -x +y -y +z -z of their frame, each as seen from inside with its
/// row 0 at the top; any format of `pictures::load_radiance`.
///
/// # Errors
/// A picture cannot be loaded, is not square, or differs in size from the first.
pub fn load_six_faces(files: &[&Path; 6], frame: CubeFrame) -> Result<LoadedCube, AssetError> {
    let mut pixels: Vec<[f32; 3]> = Vec::new();
    let mut side = 0;
    for file in files {
        let face = pictures::load_raw(file)?;
        let (width, height) = (face.width(), face.height());
        if side == 0 {
            side = width;
        }
        if width != height || width != side || side > MAX_FACE {
            let allowed =
                format!("square, at most {MAX_FACE} a side, all six alike (the first is {side} wide)");
            return Err(AssetError::new(file, "face size")
                .value(format!("{width} x {height}"))
                .allowed(allowed));
        }
        pixels.extend(face.pixels());
    }
    let stacked = Image::from_pixels(side, 6 * side, pixels);
    finish(stacked.ok_or_else(|| AssetError::new(files[0], "face size"))?, frame)
}

fn finish(stacked: RadianceImage, frame: CubeFrame) -> Result<LoadedCube, AssetError> {
    let LoadedRadiance { hdr, replaced } = ingest(stacked);
    let radiance = turned(&hdr.radiance, frame);
    Ok(LoadedCube { map: EnvironmentMap { layout: MapLayout::Cube, radiance }, replaced })
}

/// Moves texels from the stored faces to the world's. All frames differ by axis swaps, so texel centres meet.
fn turned(stacked: &RadianceImage, frame: CubeFrame) -> RadianceImage {
    if frame == CubeFrame::AsStored {
        return stacked.clone();
    }
    let side = stacked.width();
    let mut out = stacked.clone();
    let centre = |k: usize| (2 * k + 1) as f64 / side as f64 - 1.0;
    let texel = |t: f64| (((t + 1.0) * 0.5 * side as f64) as usize).min(side - 1);
    for face in 0..6 {
        for j in 0..side {
            for i in 0..side {
                let world = cube_direction(face, centre(i), centre(j));
                let (from, u, v) = cube_face_uv(frame.file_from_world(world));
                *out.at_mut(i, face * side + j) = *stacked.at(texel(u), from * side + texel(v));
            }
        }
    }
    out
}

const HEADER_BYTES: usize = 128;
const DX10_BYTES: usize = 20;
const CUBE: u32 = 0x200;
const ALL_FACES: u32 = 0xfc00;

/// Decodes the six faces, largest mip level, one under the other as stored; values as in the file.
fn decode(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    let word = |at: usize| -> Result<u32, AssetError> {
        let four = bytes.get(at..).and_then(|rest| rest.first_chunk::<4>());
        four.map(|b| u32::from_le_bytes(*b))
            .ok_or_else(|| AssetError::new(file, "DDS header").allowed(format!("{HEADER_BYTES} bytes long")))
    };
    if !bytes.starts_with(b"DDS ") {
        return Err(AssetError::new(file, "first bytes").allowed("a DDS file"));
    }
    if (word(4)?, word(76)?) != (124, 32) {
        return Err(AssetError::new(file, "DDS header's sizes")
            .value(format!("{}, {}", word(4)?, word(76)?))
            .allowed("124, 32"));
    }
    let (height, width, mips) = (word(12)? as usize, word(16)? as usize, word(28)?.max(1));
    let four_cc = word(84)?;
    let extended = four_cc == u32::from_le_bytes(*b"DX10");
    let caps = word(112)?;
    let format = if extended { word(HEADER_BYTES)? } else { four_cc };
    let (component_bytes, name) = match (extended, format) {
        (false, 113) | (true, 10) => (2, "RGBA16F"),
        (false, 116) | (true, 2) => (4, "RGBA32F"),
        _ => {
            let allowed = "113 (RGBA16F) or 116 (RGBA32F), or DX10 with 10 or 2";
            return Err(AssetError::new(file, "DDS format").value(format).allowed(allowed));
        }
    };
    let is_cube = caps & CUBE != 0 && caps & ALL_FACES == ALL_FACES
        || extended && word(HEADER_BYTES + 8)? & 4 != 0 && word(HEADER_BYTES + 12)? == 1;
    if !is_cube {
        return Err(AssetError::new(file, "DDS caps2")
            .value(format!("{caps:#x}"))
            .allowed("a cube map with six faces"));
    }
    if width != height || !(1..=MAX_FACE).contains(&width) {
        return Err(AssetError::new(file, "DDS face size")
            .value(format!("{width} x {height}"))
            .allowed(format!("square, 1 to {MAX_FACE} a side")));
    }
    if mips > 1 + width.ilog2() {
        let allowed = format!("at most {}", 1 + width.ilog2());
        return Err(AssetError::new(file, "DDS mip levels").value(mips).allowed(allowed));
    }
    let texel_bytes = 4 * component_bytes;
    let face_bytes: usize = (0..mips).map(|m| (width >> m).max(1).pow(2) * texel_bytes).sum();
    let start = HEADER_BYTES + if extended { DX10_BYTES } else { 0 };
    if bytes.len() < start + 6 * face_bytes {
        return Err(AssetError::new(
            file,
            format!("DDS length for {name} {width} x {width} x 6, {mips} levels"),
        )
        .value(bytes.len())
        .allowed(format!("at least {} bytes", start + 6 * face_bytes)));
    }
    let channel = |texel: &[u8], k: usize| match texel[k * component_bytes..] {
        [a, b, ..] if component_bytes == 2 => f16::from_le_bytes([a, b]).to_f32(),
        [a, b, c, d, ..] => f32::from_le_bytes([a, b, c, d]),
        _ => 0.0,
    };
    let mut pixels = Vec::with_capacity(6 * width * width);
    for face in 0..6 {
        let largest = &bytes[start + face * face_bytes..][..width * width * texel_bytes];
        pixels
            .extend(largest.chunks_exact(texel_bytes).map(|t| [channel(t, 0), channel(t, 1), channel(t, 2)]));
    }
    Image::from_pixels(width, 6 * width, pixels)
        .ok_or_else(|| AssetError::new(file, "DDS face size").value(format!("{width} x {height}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name() -> &'static Path {
        Path::new("some.dds")
    }

    /// A cube whose texel holds the direction that it is seen in, so any wrong turn shows.
    fn file(side: usize, format: u32, mips: u32) -> Vec<u8> {
        let mut words = [0u32; 32];
        words[0] = u32::from_le_bytes(*b"DDS ");
        (words[1], words[3], words[4], words[7]) = (124, side as u32, side as u32, mips);
        (words[19], words[21], words[28]) = (32, format, CUBE | ALL_FACES);
        let mut bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        for face in 0..6 {
            for level in 0..mips {
                let n = (side >> level).max(1);
                for t in 0..n * n {
                    let at = |k: usize| (2 * k + 1) as f64 / n as f64 - 1.0;
                    let d = cube_direction(face, at(t % n), at(t / n)) + 2.0;
                    for value in [d.x, d.y, d.z, 1.0] {
                        match format {
                            113 => bytes.extend(f16::from_f64(value).to_le_bytes()),
                            _ => bytes.extend((value as f32).to_le_bytes()),
                        }
                    }
                }
            }
        }
        bytes
    }

    fn check(frame: CubeFrame, world_from_file: impl Fn([f32; 3]) -> [f32; 3]) {
        let cube = finish(decode(name(), &file(8, 116, 1)).unwrap(), frame).unwrap();
        for face in 0..6 {
            for t in 0..64 {
                let at = |k: usize| (2 * k + 1) as f64 / 8.0 - 1.0;
                let direction = cube_direction(face, at(t % 8), at(t / 8)).as_vec3().to_array();
                let stored = cube.map.radiance.at(t % 8, face * 8 + t / 8).map(|c| c - 2.0);
                let seen = world_from_file(stored);
                assert!(
                    (0..3).all(|k| (seen[k] - direction[k]).abs() < 1e-6),
                    "{face} {t} {seen:?} {direction:?}"
                );
            }
        }
    }

    #[test]
    fn every_texel_is_seen_in_its_direction() {
        check(CubeFrame::LeftHandedYUp, |[x, y, z]| [x, z, y]);
        check(CubeFrame::RightHandedYUp, |[x, y, z]| [x, -z, y]);
        check(CubeFrame::AsStored, |d| d);
    }

    #[test]
    fn half_floats_and_mip_levels_are_read() {
        let full = decode(name(), &file(8, 116, 1)).unwrap();
        for (format, tolerance) in [(116, 0.0), (113, 1.5e-3)] {
            let same = decode(name(), &file(8, format, 4)).unwrap();
            for (a, b) in same.pixels().as_flattened().iter().zip(full.pixels().as_flattened()) {
                assert!((a - b).abs() <= tolerance, "{a} {b}");
            }
        }
    }

    #[test]
    fn headers_that_lie_are_refused() {
        let sound = file(4, 113, 1);
        for (at, value, part) in [
            (0, 0u32, "first bytes"),
            (4, 100, "sizes"),
            (12, 5, "face size"),
            (16, 0, "face size"),
            (28, 40, "mip levels"),
            (84, 36, "DDS format = 36"),
            (112, 0x1200, "cube map"),
        ] {
            let mut bytes = sound.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            let error = decode(name(), &bytes).unwrap_err().to_string();
            assert!(error.contains(part) && error.contains("some.dds"), "{part}: {error}");
        }
        let mut huge = sound.clone();
        huge[12..20].copy_from_slice(&[0, 8, 0, 0, 0, 8, 0, 0]);
        assert!(decode(name(), &huge).unwrap_err().to_string().contains("DDS length"));
        assert!(decode(name(), &sound[..sound.len() - 1]).is_err());
    }

    #[test]
    fn six_files_must_be_square_and_alike() {
        let folder = std::env::temp_dir().join(format!("halflight-cube-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let paths: Vec<_> = (0..6).map(|k| folder.join(format!("{k}.exr"))).collect();
        let save = |k: usize, w, h| {
            pictures::save_exr_f32(&paths[k], &Image::filled(w, h, [k as f32; 3])).unwrap();
        };
        (0..6).for_each(|k| save(k, 4, 4));
        let six: Vec<&Path> = paths.iter().map(AsRef::as_ref).collect();
        let six: &[&Path; 6] = six.as_slice().try_into().unwrap();
        let cube = load_six_faces(six, CubeFrame::LeftHandedYUp).unwrap();
        let faces: Vec<f32> = (0..6).map(|f| cube.map.radiance.at(1, 4 * f + 1)[0]).collect();
        // World +z (up) is the file's +y, world +y the file's +z.
        assert_eq!(faces, [0.0, 1.0, 4.0, 5.0, 2.0, 3.0]);
        save(3, 4, 5);
        assert!(load_six_faces(six, CubeFrame::AsStored).unwrap_err().to_string().contains("4 x 5"));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(
            keep in 0.0f64..1.2,
            flips in prop::collection::vec((0usize..160, any::<u8>()), 0..6),
        ) {
            let mut bytes = file(4, 113, 2);
            let length = ((bytes.len() as f64 * keep) as usize).min(bytes.len());
            bytes.truncate(length);
            for (at, byte) in flips {
                if let Some(slot) = bytes.get_mut(at) {
                    *slot = byte;
                }
            }
            if let Ok(cube) = decode(name(), &bytes).and_then(|c| finish(c, CubeFrame::default())) {
                prop_assert!(cube.map.radiance.pixels().as_flattened().iter().all(|c| c.is_finite() && *c >= 0.0));
            }
        }
    }
}
