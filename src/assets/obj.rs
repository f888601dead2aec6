//! Wavefront OBJ: positions, vertex colours, normals and polygons. Groups, materials, texture coordinates, lines and
//! curves are passed over. Coordinates stay in the file's own frame and unit.
//!
//! Why not `tobj` (4.0.5): a normal's index of 6148914691236517206 makes it panic, it takes numbers that are not finite, gives
//! the colours of some vertices and the normals of some corners to others, and names no line.

use super::{
    error::{AssetError, read_text},
    normals::creased,
};
use crate::model::scene::Mesh;
use glam::Vec3;
use std::{collections::HashMap, path::Path};

/// Edges flatter than this are smooth where the file has no normals, degrees.
pub const CREASE_DEG: f32 = 40.0;

/// Loads a mesh. Polygons become fans of triangles. Corners without a normal make all normals computed
/// (`normals::creased` at `CREASE_DEG`); file normals are brought to unit length.
///
/// # Errors
/// The file cannot be read, a line is malformed (it is named), an index points nowhere, or there is no polygon.
pub fn load(file: &Path) -> Result<Mesh, AssetError> {
    parse(file, &read_text(file)?)
}

/// `load` from text; `file` only names it in errors.
pub fn parse(file: &Path, text: &str) -> Result<Mesh, AssetError> {
    let mut positions: Vec<Vec3> = Vec::new();
    let mut tints: Vec<[f32; 3]> = Vec::new();
    let mut normals: Vec<Vec3> = Vec::new();
    let mut mesh = Mesh::default();
    let mut known: HashMap<(usize, Option<usize>), u32> = HashMap::new();
    let mut all_have_normals = true;
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let mut words = line.split_whitespace();
        let wrong = |allowed: &str| {
            AssetError::new(file, format!("line {}", number + 1)).value(line.trim()).allowed(allowed)
        };
        match words.next() {
            Some("v") => {
                let n = numbers(words).filter(|n| n.len() >= 3);
                let n = n.ok_or_else(|| wrong("v and 3 finite numbers, or 6 with a colour"))?;
                positions.push(Vec3::new(n[0], n[1], n[2]));
                tints.push(if n.len() >= 6 {
                    [n[3], n[4], n[5]].map(|c| c.clamp(0.0, 1.0))
                } else {
                    [1.0; 3]
                });
            }
            Some("vn") => {
                let n = numbers(words).filter(|n| n.len() == 3);
                let n = n.ok_or_else(|| wrong("vn and 3 finite numbers"))?;
                normals.push(Vec3::new(n[0], n[1], n[2]));
            }
            Some("f") => {
                let mut polygon: Vec<u32> = Vec::new();
                for word in words {
                    let corner = corner(word, positions.len(), normals.len())
                        .ok_or_else(|| wrong("f and corners like 1, 1/2/3 or 1//3 that exist above"))?;
                    all_have_normals &= corner.1.is_some();
                    let index = *known.entry(corner).or_insert_with(|| {
                        mesh.positions.push(positions[corner.0]);
                        mesh.tints_rgb.push(tints[corner.0]);
                        mesh.normals.push(corner.1.map_or(Vec3::ZERO, |n| normals[n]));
                        (mesh.positions.len() - 1) as u32
                    });
                    polygon.push(index);
                }
                if polygon.len() < 3 {
                    return Err(wrong("a face of at least 3 corners"));
                }
                mesh.triangles.extend((2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]]));
            }
            _ => {}
        }
    }
    if mesh.triangles.is_empty() {
        return Err(AssetError::new(file, "faces").value(0).allowed("at least 1"));
    }
    let unit: Option<Vec<Vec3>> = mesh.normals.iter().map(|n| n.try_normalize()).collect();
    match unit {
        Some(normals) if all_have_normals => Ok(Mesh { normals, ..mesh }),
        _ => {
            let computed = creased(&mesh, CREASE_DEG);
            if computed.triangles.is_empty() {
                return Err(AssetError::new(file, "faces with an area").value(0).allowed("at least 1"));
            }
            Ok(computed)
        }
    }
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Option<Vec<f32>> {
    words.map(|word| word.parse::<f32>().ok().filter(|x| x.is_finite())).collect()
}

/// Position and normal of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, counted from 0.
fn corner(word: &str, positions: usize, normals: usize) -> Option<(usize, Option<usize>)> {
    let mut parts = word.split('/');
    let position = index(parts.next()?, positions)?;
    let _texture = parts.next();
    let normal = match parts.next() {
        None | Some("") => None,
        Some(text) => Some(index(text, normals)?),
    };
    parts.next().is_none().then_some((position, normal))
}

/// Counted from 1, or back from the end where negative.
fn index(text: &str, count: usize) -> Option<usize> {
    let number: i64 = text.parse().ok()?;
    let at = if number > 0 { number - 1 } else { number.checked_add(count as i64)? };
    usize::try_from(at).ok().filter(|&at| number != 0 && at < count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Mesh, AssetError> {
        parse(Path::new("some.obj"), text)
    }

    #[test]
    fn polygons_negative_indices_colours_and_normals_are_read() {
        let mesh = read("v 0 0 0 1 0 0\nv 1 0 0 # x\nv 1 1 0\nv 0 1 0\nvn 0 0 2\nf 1//1 2//1 -2//-1 4//1\n")
            .unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(
            (mesh.normals[3], mesh.tints_rgb[0], mesh.tints_rgb[1]),
            (Vec3::Z, [1.0, 0.0, 0.0], [1.0; 3])
        );
        let flat = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/9 2/9 3/9").unwrap();
        assert_eq!(flat.normals, [Vec3::Z; 3]);
    }

    #[test]
    fn mistakes_name_their_line() {
        for (text, part) in [
            ("v 0 0\n", "line 1"),
            ("v 0 0 nan\n", "line 1"),
            ("v 0 0 0\nf 1 1\n", "line 2"),
            ("v 0 0 0\nf 1 2 3\n", "line 2"),
            ("v 0 0 0\nf 0 1 1\n", "line 2"),
            ("v 0 0 0\nf 1//1 1 1\n", "line 2"),
            ("v 0 0 0\nvn 0 0 1\nf 1//6148914691236517206 1 1\n", "line 3"),
            ("v 0 0 0\nf 1 1 -9223372036854775808\n", "line 2"),
            ("v 0 0 0\n", "faces"),
            ("v 0 0 0\nf 1 1 1\n", "with an area"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part) && error.contains("some.obj"), "{text:?}: {error}");
        }
    }

    proptest! {
        #[test]
        fn any_text_gives_an_error_or_a_sound_mesh(lines in prop::collection::vec(
            "(v|vn|f|o|#)( -?[0-3](\\.[05])?(/[0-2]?)?(//-?[0-3])?){0,5}", 0..30)) {
            if let Ok(mesh) = read(&lines.join("\n")) {
                let n = mesh.positions.len();
                prop_assert!(mesh.normals.len() == n && mesh.tints_rgb.len() == n);
                prop_assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
                prop_assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
            }
        }
    }
}
