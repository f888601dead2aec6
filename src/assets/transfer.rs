//! Precomputed transfer of a scene, kept in a folder from run to run.

use super::error::AssetError;
use crate::animate::posed::Posed;
use crate::model::{
    scene::{Material, Scene},
    transfer::{ObjectTransfer, SceneTransfer},
};
use crate::visibility::transfer::{self, Standing};
use half::f16;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Bytes of a SHA-256.
const HASH: usize = 32;

/// The transfer of all objects of a scene that never move (which also shadow each other), at an SH order, or from the folder
/// `cache` where an earlier run left it for the same geometry, order and rays. A file there that is damaged, or speaks of
/// something else, is not used and written anew; where nothing can be written, that is logged and nothing else.
///
/// `progress` is told the share done, 0 to 1, in no strict order.
pub fn of_scene(
    scene: &Scene,
    order: usize,
    rays: u32,
    cache: Option<&Path>,
    progress: &(dyn Fn(f32) + Sync),
) -> SceneTransfer {
    let posed = Posed::new(scene);
    let moves = |object: usize| {
        scene.figures.iter().any(|f| !f.is_still() && f.parts.iter().any(|part| part.object == object))
    };
    let still: Vec<usize> = (0..scene.objects.len()).filter(|&object| !moves(object)).collect();
    let standing: Vec<Standing<'_>> = still
        .iter()
        .map(|&object| Standing {
            positions_world: &posed.objects()[object].positions_world,
            normals_world: &posed.objects()[object].normals_world,
            triangles: &scene.objects[object].mesh.triangles,
            is_glossy: is_glossy(&scene.objects[object].material),
        })
        .collect();
    if standing.iter().all(|mesh| mesh.positions_world.is_empty()) {
        progress(1.0);
        return SceneTransfer { order, objects: vec![None; scene.objects.len()] };
    }
    let key = key(&standing, order, rays);
    let file = cache.map(|folder| cache_file(folder, &key));
    let known = file.as_deref().and_then(|file| read(file, &key, &standing, order));
    let baked = known.unwrap_or_else(|| {
        let baked = transfer::bake(&standing, order, rays, progress);
        if let Some(file) = &file
            && let Err(error) = write(file, &key, &baked)
        {
            tracing::warn!("precomputed transfer is not kept: {error}");
        }
        baked
    });
    progress(1.0);
    let mut out = SceneTransfer { order, objects: vec![None; scene.objects.len()] };
    for (object, baked) in still.into_iter().zip(baked) {
        out.objects[object] = Some(baked);
    }
    out
}

/// Whether a material's lobe is shaded through the visibility of its vertices.
fn is_glossy(material: &Material) -> bool {
    matches!(material, Material::Phong { specular_rgb, .. } if *specular_rgb != [0.0; 3])
}

/// SHA-256 of the algorithm's version, the settings and the geometry.
fn key(standing: &[Standing<'_>], order: usize, rays: u32) -> [u8; HASH] {
    let mut hash = Sha256::new();
    hash.update(transfer::VERSION.to_le_bytes());
    hash.update((order as u64).to_le_bytes());
    hash.update(rays.to_le_bytes());
    for mesh in standing {
        for size in [mesh.positions_world.len(), mesh.normals_world.len(), mesh.triangles.len()] {
            hash.update((size as u64).to_le_bytes());
        }
        hash.update([u8::from(mesh.is_glossy)]);
        for vector in mesh.positions_world.iter().chain(mesh.normals_world) {
            vector.to_array().iter().for_each(|x| hash.update(x.to_le_bytes()));
        }
        mesh.triangles.as_flattened().iter().for_each(|i| hash.update(i.to_le_bytes()));
    }
    hash.finalize().into()
}

/// Where a folder keeps what belongs to a key.
fn cache_file(folder: &Path, key: &[u8; HASH]) -> PathBuf {
    let name: String = key.iter().map(|b| format!("{b:02x}")).collect();
    folder.join("transfer").join(format!("{name}.bin"))
}

/// A file is the key, the 16-bit floats of all objects one after the other (little-endian), of each what is blocked after
/// its transfer, and the SHA-256 of both.
fn read(
    file: &Path,
    key: &[u8; HASH],
    standing: &[Standing<'_>],
    order: usize,
) -> Option<Vec<ObjectTransfer>> {
    let bytes = super::error::read_file(file).ok()?;
    let rows = |mesh: &Standing<'_>| mesh.positions_world.len() * order * order;
    let blocked = |mesh: &Standing<'_>| if mesh.is_glossy { rows(mesh) } else { 0 };
    let numbers: usize = standing.iter().map(|mesh| rows(mesh) + blocked(mesh)).sum();
    let (content, checksum) = bytes.split_at_checked(bytes.len().checked_sub(HASH)?)?;
    let sound = content.len() == HASH + 2 * numbers
        && content.starts_with(key)
        && <[u8; HASH]>::from(Sha256::digest(content)) == checksum;
    if !sound {
        return None;
    }
    let mut all = content[HASH..].chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]));
    let take = |mesh: &Standing<'_>| ObjectTransfer {
        rows: all.by_ref().take(rows(mesh)).collect(),
        blocked: all.by_ref().take(blocked(mesh)).collect(),
    };
    Some(standing.iter().map(take).collect())
}

fn write(file: &Path, key: &[u8; HASH], baked: &[ObjectTransfer]) -> Result<(), AssetError> {
    let failed = |e: std::io::Error| AssetError::new(file, "cannot be written").cause(e);
    let mut bytes = key.to_vec();
    bytes.extend(baked.iter().flat_map(|o| o.rows.iter().chain(&o.blocked)).flat_map(|t| t.to_le_bytes()));
    let checksum: [u8; HASH] = Sha256::digest(&bytes).into();
    bytes.extend(checksum);
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    // A reader never sees half a file: written beside it, then moved.
    let beside = file.with_extension(format!("{}.part", std::process::id()));
    std::fs::write(&beside, bytes).map_err(failed)?;
    std::fs::rename(&beside, file).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        animation::{Figure, Playing},
        scene::VirtualObject,
    };
    use crate::shapes;
    use glam::{Affine3A, Vec3};

    fn scene() -> Scene {
        let object = |name: &str, x: f32| VirtualObject {
            name: name.into(),
            mesh: shapes::icosphere(0.1, 2),
            material: Material::Lambert { albedo_rgb: [0.5; 3] },
            world_from_object: Affine3A::from_translation(Vec3::new(x, 0.0, 0.1)),
            openness: Vec::new(),
        };
        let mut dancer = Figure::still("dancer".into(), 1, Affine3A::IDENTITY, std::iter::empty());
        dancer.playing = Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: true });
        Scene {
            objects: vec![object("a", 0.0), object("dancer", 0.5), object("b", 0.25)],
            figures: vec![dancer],
            ..Scene::default()
        }
    }

    #[test]
    fn what_is_kept_is_read_again_and_damage_is_mended() {
        let folder = std::env::temp_dir().join(format!("halflight-transfer-{}", std::process::id()));
        let scene = scene();
        let bakes = std::sync::atomic::AtomicUsize::new(0);
        let count = |share: f32| {
            if share < 1.0 {
                bakes.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            }
        };
        let run = |order, rays| {
            bakes.store(0, std::sync::atomic::Ordering::Relaxed);
            let out = of_scene(&scene, order, rays, Some(&folder), &count);
            (out, bakes.load(std::sync::atomic::Ordering::Relaxed) > 0)
        };
        let (first, baked) = run(4, 32);
        assert!(baked);
        assert!(first.objects[0].is_some() && first.objects[1].is_none() && first.objects[2].is_some());
        assert_eq!(first.rows(0).unwrap().len(), scene.objects[0].mesh.positions.len());
        assert!(first.rows(1).is_none() && first.rows(9).is_none());
        assert_eq!(run(4, 32), (first.clone(), false));
        // Something else: another order, other rays.
        assert!(run(3, 32).1 && run(4, 33).1);
        let files: Vec<_> =
            std::fs::read_dir(folder.join("transfer")).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 3);
        let key = cache_file(&folder, &[0; HASH]);
        assert!(!files.contains(&key));
        for damage in [0usize, 40, 200] {
            for file in &files {
                let mut bytes = std::fs::read(file).unwrap();
                bytes[damage] ^= 1;
                std::fs::write(file, &bytes).unwrap();
            }
            assert_eq!(run(4, 32), (first.clone(), true), "damage at {damage}");
        }
        for file in &files {
            let bytes = std::fs::read(file).unwrap();
            std::fs::write(file, &bytes[..bytes.len().min(20)]).unwrap();
        }
        assert_eq!(run(4, 32), (first, true));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
