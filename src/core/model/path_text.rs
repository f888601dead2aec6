//! Paths in settings and in names of devices, which are text, whatever their bytes: a byte that is no UTF-8 becomes one
//! character of a private range that no name holds, and comes back as the same byte.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

/// The first of 256 private characters, one for each byte.
const FIRST: u32 = 0x10_fe00;

/// A path as text.
pub fn to_text(path: &Path) -> String {
    let mut text = String::new();
    for chunk in path.as_os_str().as_bytes().utf8_chunks() {
        text.push_str(chunk.valid());
        text.extend(chunk.invalid().iter().filter_map(|byte| char::from_u32(FIRST + u32::from(*byte))));
    }
    text
}

/// The path of a text.
pub fn to_path(text: &str) -> PathBuf {
    let mut bytes = Vec::with_capacity(text.len());
    for c in text.chars() {
        match u8::try_from(u32::from(c).wrapping_sub(FIRST)) {
            Ok(byte) => bytes.push(byte),
            Err(_) => bytes.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes()),
        }
    }
    PathBuf::from(OsString::from_vec(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;

    #[test]
    fn every_path_comes_back() {
        for seed in 0..200 {
            let mut dice = Dice::new(seed);
            let bytes: Vec<u8> = (0..24).map(|_| (256.0 * dice.unit()) as u8).collect();
            let path = PathBuf::from(OsString::from_vec(bytes));
            assert_eq!(to_path(&to_text(&path)), path);
        }
    }

    #[test]
    fn plain_names_stay_as_they_are() {
        for name in ["a,b=1.mcap", "dir/Schöne Szene.toml", ""] {
            assert_eq!((to_text(Path::new(name)).as_str(), to_path(name).as_path()), (name, Path::new(name)));
        }
    }
}
