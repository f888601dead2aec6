//! Spheres of figures: fitted, bound to nodes, kept in a folder from run to run, and as JSON.

use super::error::AssetError;
use crate::animate::bind::bind;
use crate::model::{
    animation::{BoundSphere, Figure},
    scene::{Scene, VirtualObject},
};
use crate::visibility::fit_spheres::{self, FittedSphere, SphereFit};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// A figure's mesh at rest in its own frame: positions and triangles of all its parts.
pub fn geometry(figure: &Figure, objects: &[VirtualObject]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for mesh in figure.parts.iter().filter_map(|part| objects.get(part.object)).map(|object| &object.mesh) {
        let base = positions.len() as u32;
        positions.extend(&mesh.positions);
        triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
    }
    (positions, triangles)
}

/// Fits `count` spheres to a figure at rest, in its own frame, or takes them from the folder `cache` where an earlier
/// run left them for the same geometry. A file there that is damaged, or speaks of something else, is not used and
/// written anew; where nothing can be written, that is logged and nothing else.
///
/// `progress` is told the share done, 0 to 1. `None` where no triangle has an area.
pub fn fit(
    figure: &Figure,
    objects: &[VirtualObject],
    count: usize,
    cache: Option<&Path>,
    progress: &mut dyn FnMut(f32),
) -> Option<SphereFit> {
    let (positions, triangles) = geometry(figure, objects);
    let key = key(&positions, &triangles, count);
    let file = cache.map(|folder| cache_file(folder, &key));
    if let Some(known) = file.as_deref().and_then(|file| read(file, &key)) {
        progress(1.0);
        return Some(known);
    }
    let fit = fit_spheres::fit(&positions, &triangles, count, progress)?;
    if let Some(file) = file
        && let Err(error) = write(&file, &key, &fit)
    {
        tracing::warn!("spheres are not kept: {error}");
    }
    Some(fit)
}

/// Spheres in a figure's own frame, bound to its nodes.
pub fn bound(fit: &SphereFit, figure: &Figure, objects: &[VirtualObject]) -> Vec<BoundSphere> {
    let spheres: Vec<(Vec3, f32)> = fit.spheres.iter().map(|s| (s.centre, s.radius)).collect();
    bind(&spheres, figure, objects)
}

/// Gives every figure of a scene the number of spheres that it asks for (figures that have some already keep them);
/// one whose geometry has no area stays without. Everything else as `fit`.
pub fn fit_scene(scene: &mut Scene, cache: Option<&Path>, progress: &mut dyn FnMut(f32)) {
    let total = scene.figures.len().max(1) as f32;
    let Scene { objects, figures, .. } = scene;
    for (index, figure) in figures.iter_mut().enumerate().filter(|(_, figure)| figure.spheres.is_empty()) {
        let mut within = |share: f32| progress((index as f32 + share) / total);
        if let Some(fit) = fit(figure, objects, figure.sphere_count, cache, &mut within) {
            figure.spheres = bound(&fit, figure, objects);
        }
    }
    progress(1.0);
}

/// SHA-256 of the algorithm's version, the count and the geometry, in hexadecimal.
fn key(positions: &[Vec3], triangles: &[[u32; 3]], count: usize) -> String {
    let mut hash = Sha256::new();
    hash.update(fit_spheres::VERSION.to_le_bytes());
    for size in [count, positions.len(), triangles.len()] {
        hash.update((size as u64).to_le_bytes());
    }
    positions.iter().flat_map(|p| p.to_array()).for_each(|x| hash.update(x.to_le_bytes()));
    triangles.as_flattened().iter().for_each(|i| hash.update(i.to_le_bytes()));
    hex(hash)
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Where a folder keeps what belongs to a key.
fn cache_file(folder: &Path, key: &str) -> PathBuf {
    folder.join("spheres").join(format!("{key}.json"))
}

/// As kept in the folder. Numbers are written so that they read back as the same bits.
#[derive(Serialize, Deserialize)]
struct Kept {
    key: String,
    fit: KeptFit,
    /// SHA-256 of the key and of `fit` as JSON.
    checksum: String,
}

#[derive(Serialize, Deserialize)]
struct KeptFit {
    /// x, y, z, radius.
    spheres: Vec<[f32; 4]>,
    outside_share: f32,
    uncovered_share: f32,
    volume: f64,
}

fn checksum(key: &str, fit: &KeptFit) -> Option<String> {
    let mut hash = Sha256::new();
    hash.update(key.as_bytes());
    hash.update(serde_json::to_vec(fit).ok()?);
    Some(hex(hash))
}

/// What is kept for a key; `None` where nothing is, or not whole.
fn read(file: &Path, key: &str) -> Option<SphereFit> {
    let kept: Kept = serde_json::from_slice(&super::error::read_file(file).ok()?).ok()?;
    let fit = kept.fit;
    let sound = kept.key == key
        && checksum(key, &fit)? == kept.checksum
        && fit.spheres.iter().all(|s| s.iter().all(|x| x.is_finite()) && s[3] > 0.0);
    sound.then(|| SphereFit {
        spheres: fit
            .spheres
            .iter()
            .map(|&[x, y, z, radius]| FittedSphere { centre: Vec3::new(x, y, z), radius })
            .collect(),
        outside_share: fit.outside_share,
        uncovered_share: fit.uncovered_share,
        volume: fit.volume,
    })
}

fn write(file: &Path, key: &str, fit: &SphereFit) -> Result<(), AssetError> {
    let failed = |e: std::io::Error| AssetError::new(file, "cannot be written").cause(e);
    let fit = KeptFit {
        spheres: fit.spheres.iter().map(|s| s.centre.extend(s.radius).to_array()).collect(),
        outside_share: fit.outside_share,
        uncovered_share: fit.uncovered_share,
        volume: fit.volume,
    };
    let Some(checksum) = checksum(key, &fit) else { return Ok(()) };
    let text = serde_json::to_vec(&Kept { key: key.to_owned(), fit, checksum })
        .map_err(|e| AssetError::new(file, "spheres as JSON").cause(e))?;
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    // A reader never sees half a file: written beside it, then moved.
    let beside = file.with_extension(format!("{}.part", std::process::id()));
    std::fs::write(&beside, text).map_err(failed)?;
    std::fs::rename(&beside, file).map_err(failed)
}

/// Spheres of a figure for other programs: for each its node's index and name, centre and radius in that node's frame,
/// and centre and radius in the figure's frame (z up) at rest; with the shares of `SphereFit`.
pub fn to_json(figure: &Figure, fit: &SphereFit, spheres: &[BoundSphere]) -> serde_json::Value {
    let nodes = &figure.skeleton.nodes;
    let row = |(fitted, bound): (&FittedSphere, &BoundSphere)| {
        serde_json::json!({
            "node": bound.node,
            "node_name": nodes.get(bound.node as usize).map_or("", |node| node.name.as_str()),
            "centre_node": bound.centre_node.to_array(),
            "radius_node": bound.radius_node,
            "centre_rest": fitted.centre.to_array(),
            "radius_rest": fitted.radius,
        })
    };
    serde_json::json!({
        "figure": figure.name,
        "count": spheres.len(),
        "outside_share": fit.outside_share,
        "uncovered_share": fit.uncovered_share,
        "mesh_volume": fit.volume,
        "spheres": fit.spheres.iter().zip(spheres).map(row).collect::<Vec<_>>(),
    })
}
