//! Precomputed transfer of a scene, kept in a folder from run to run.

use super::kept::Cache;
use crate::animate::posed::Posed;
use crate::model::{
    keep::{Keeper, KeptInput},
    scene::{Material, Scene},
    transfer::{ObjectTransfer, SceneTransfer},
};
use crate::visibility::transfer::{self, Standing};
use half::f16;
use serde::{Deserialize, Serialize};
use std::{convert::Infallible, path::Path};

/// What transfer is baked of.
struct BakeInput<'a> {
    standing: &'a [Standing<'a>],
    order: usize,
    rays: u32,
}

/// Of one object, as bits of 16-bit floats.
#[derive(Serialize, Deserialize)]
struct BakedObject {
    rows: Vec<u16>,
    blocked: Vec<u16>,
}

impl KeptInput for BakeInput<'_> {
    const KIND: &'static str = "transfer";
    const VERSION: u32 = transfer::VERSION;
    type Output = Vec<BakedObject>;

    fn hashed(&self) -> impl Serialize {
        let meshes = self.standing.iter();
        let meshes = meshes.map(|m| (m.positions_world, m.normals_world, m.triangles, m.is_glossy));
        (self.order, self.rays, meshes.collect::<Vec<_>>())
    }

    fn accepts(&self, baked: &Vec<BakedObject>) -> bool {
        let fits = |(mesh, baked): (&Standing<'_>, &BakedObject)| {
            let rows = mesh.positions_world.len() * self.order * self.order;
            baked.rows.len() == rows && baked.blocked.len() == if mesh.is_glossy { rows } else { 0 }
        };
        baked.len() == self.standing.len() && self.standing.iter().zip(baked).all(fits)
    }
}

impl From<ObjectTransfer> for BakedObject {
    fn from(of: ObjectTransfer) -> Self {
        let bits = |list: Vec<f16>| list.into_iter().map(f16::to_bits).collect();
        Self { rows: bits(of.rows), blocked: bits(of.blocked) }
    }
}

impl From<BakedObject> for ObjectTransfer {
    fn from(of: BakedObject) -> Self {
        let numbers = |list: Vec<u16>| list.into_iter().map(f16::from_bits).collect();
        Self { rows: numbers(of.rows), blocked: numbers(of.blocked) }
    }
}

/// The transfer of all objects of a scene that never move (which also shadow each other), at an SH order, or from the folder
/// `cache` where an earlier run left it for the same geometry, order and rays (`kept`).
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
    let input = BakeInput { standing: &standing, order, rays };
    let Ok(baked) = Cache::new(cache).keep(&input, || {
        let baked = transfer::bake(&standing, order, rays, progress);
        Ok::<_, Infallible>(baked.into_iter().map(BakedObject::from).collect())
    });
    progress(1.0);
    let mut out = SceneTransfer { order, objects: vec![None; scene.objects.len()] };
    for (object, baked) in still.into_iter().zip(baked) {
        out.objects[object] = Some(baked.into());
    }
    out
}

/// Whether a material's lobe is shaded through the visibility of its vertices.
fn is_glossy(material: &Material) -> bool {
    matches!(material, Material::Phong { specular_rgb, .. } if *specular_rgb != [0.0; 3])
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
