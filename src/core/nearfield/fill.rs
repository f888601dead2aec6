//! Radiance of the patches that a probe did not see: from the light that the others send there.

use super::{
    faces::Faces,
    suns::sunlight,
    transfer::{SourceOutline, Statics},
};
use crate::{
    math::color,
    model::room::{Room, RoomPatch, RoomPatches, RoomSun},
};
use rayon::prelude::*;

/// Light is gathered so many times: what is unseen also lights what is unseen.
const GATHERINGS: usize = 3;
/// Seen patches of a surface that tell how it reflects, at most...
const MOST_TELLING: usize = 48;
/// ...and at least.
const LEAST_TELLING: usize = 3;
/// Largest reflectance, so that gathering ends.
const MOST_REFLECTED: f32 = 0.95;
/// Patches that an unseen part of something that shines of itself is like.
const NEIGHBOURS: usize = 4;
/// Light is gathered this share of the room's diagonal before a patch.
const LIFT: f32 = 1e-4;

/// How a surface makes light of what it gathers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Makes {
    /// Reflects this share of it.
    Reflects([f32; 3]),
    /// Shines of itself: unseen parts are like the nearest seen ones.
    Shines,
}

/// Fills in the radiance of patches that are not `seen`. Their light is gathered from all patches and suns three times
/// over, each time with what was found before, and reflected by the surface's effective reflectance: the median of
/// radiance over gathered light at its seen patches (so that the surface is as bright as where it was seen), or, where
/// fewer than three were seen, its own, together with what it emits. A surface whose seen patches send out more than they can
/// reflect shines of itself: its unseen patches are the mean of the four nearest seen ones that face the same way.
///
/// Gives how many were filled.
pub fn fill_unseen(room: &Room, patches: &mut RoomPatches, suns: &[RoomSun]) -> usize {
    let unseen: Vec<u32> = indices(&patches.patches, |p| !p.seen);
    if unseen.is_empty() {
        return 0;
    }
    for &i in &unseen {
        patches.patches[i as usize].radiance_rgb = [0.0; 3];
    }
    let mut targets = unseen.clone();
    for surface in 0..room.surfaces.len() as u32 {
        if unseen.iter().any(|&i| patches.patches[i as usize].surface == surface) {
            let seen = indices(&patches.patches, |p| p.seen && p.surface == surface);
            let step = seen.len().div_ceil(MOST_TELLING).max(1);
            targets.extend(seen.into_iter().step_by(step));
        }
    }
    let (rows, from_suns) = gather_rows(room, patches, &targets, suns);
    for _ in 0..GATHERINGS {
        let gathered: Vec<[f32; 3]> = rows
            .iter()
            .zip(&from_suns)
            .map(|(row, sun)| {
                row.iter().fold(*sun, |sum, &(source, transfer)| {
                    let radiance = patches.patches[source as usize].radiance_rgb;
                    std::array::from_fn(|c| sum[c] + radiance[c] * transfer)
                })
            })
            .collect();
        let makes: Vec<Makes> = (0..room.surfaces.len() as u32)
            .map(|surface| {
                makes(room, &patches.patches, surface, &targets[unseen.len()..], &gathered[unseen.len()..])
            })
            .collect();
        let filled: Vec<[f32; 3]> = unseen
            .iter()
            .zip(&gathered)
            .map(|(&i, gathered)| {
                let patch = &patches.patches[i as usize];
                match makes.get(patch.surface as usize) {
                    Some(Makes::Shines) => like_neighbours(&patches.patches, patch),
                    Some(Makes::Reflects(share)) => {
                        let emitted = room.surfaces[patch.surface as usize].emitted_rgb;
                        std::array::from_fn(|c| emitted[c].max(0.0) + share[c] * gathered[c])
                    }
                    None => [0.0; 3],
                }
            })
            .collect();
        for (&i, radiance) in unseen.iter().zip(filled) {
            patches.patches[i as usize].radiance_rgb = radiance;
        }
    }
    unseen.len()
}

fn indices(patches: &[RoomPatch], keep: impl Fn(&RoomPatch) -> bool) -> Vec<u32> {
    (0..patches.len() as u32).filter(|&i| keep(&patches[i as usize])).collect()
}

/// For each target what it gets of each patch (L times it sums to irradiance over pi), and of the suns.
#[allow(clippy::type_complexity, reason = "two lists, named in the line above")]
fn gather_rows(
    room: &Room,
    patches: &RoomPatches,
    targets: &[u32],
    suns: &[RoomSun],
) -> (Vec<Vec<(u32, f32)>>, Vec<[f32; 3]>) {
    let (statics, faces) = (Statics::new(room), Faces::of_room(room));
    let lift = LIFT * faces.diagonal();
    let outlines: Vec<SourceOutline> = (patches.patches.iter().enumerate())
        .map(|(i, patch)| SourceOutline::new(patches, patch, i as u32))
        .collect();
    let row = |&target: &u32| {
        let patch = &patches.patches[target as usize];
        let (at, normal) = (patch.centre_world + patch.normal_world * lift, patch.normal_world);
        let each = outlines.iter().enumerate();
        let row = each.filter_map(|(i, outline)| {
            let transfer = outline.transfer(&statics, at, normal, target, 1);
            (transfer > 0.0).then_some((i as u32, transfer))
        });
        (row.collect(), sunlight(suns, &faces, patch.centre_world, normal))
    };
    targets.par_iter().map(row).unzip()
}

fn makes(room: &Room, patches: &[RoomPatch], surface: u32, telling: &[u32], gathered: &[[f32; 3]]) -> Makes {
    let own = room.surfaces[surface as usize].reflectance_rgb.map(|c| c.clamp(0.0, MOST_REFLECTED));
    let told: Vec<([f32; 3], [f32; 3])> = telling
        .iter()
        .zip(gathered)
        .map(|(&i, gathered)| (&patches[i as usize], gathered))
        .filter(|(patch, _)| patch.surface == surface)
        .map(|(patch, gathered)| (patch.radiance_rgb, *gathered))
        .collect();
    if told.len() < LEAST_TELLING {
        return Makes::Reflects(own);
    }
    let share = |of: &dyn Fn([f32; 3]) -> f32| {
        let lit = told.iter().filter(|(_, g)| of(*g) > 0.0);
        let mut ratios: Vec<f32> = lit.map(|(l, g)| of(*l) / of(*g)).collect();
        ratios.sort_unstable_by(f32::total_cmp);
        ratios.get(ratios.len() / 2).copied()
    };
    if share(&color::luminance::<f32>).is_none_or(|s| s > 1.0) {
        return Makes::Shines;
    }
    Makes::Reflects(std::array::from_fn(|c| {
        share(&|rgb| rgb[c]).map_or(own[c], |s| s.clamp(0.0, MOST_REFLECTED))
    }))
}

/// The mean of the nearest seen patches of the same surface that face the same way, or just of the same surface.
fn like_neighbours(patches: &[RoomPatch], patch: &RoomPatch) -> [f32; 3] {
    let mut near: Vec<(bool, f32, [f32; 3])> = patches
        .iter()
        .filter(|p| p.seen && p.surface == patch.surface)
        .map(|p| {
            let turned = p.normal_world.dot(patch.normal_world) < 0.5;
            (turned, p.centre_world.distance_squared(patch.centre_world), p.radiance_rgb)
        })
        .collect();
    near.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    near.truncate(NEIGHBOURS);
    let count = near.len().max(1) as f32;
    std::array::from_fn(|c| near.iter().map(|n| n.2[c]).sum::<f32>() / count)
}

#[cfg(test)]
mod tests {
    use super::super::{
        fixture,
        patches::{Subdivision, subdivide},
    };
    use super::*;
    use glam::Vec3;

    fn is_before(patch: &RoomPatch, at: Vec3) -> bool {
        patch.normal_world.dot(at - patch.centre_world) > 0.0
    }

    /// The fixture's room under its lamp, as light settles in it: radiance of all patches.
    fn settled(room: &Room, patches: &mut RoomPatches, times: usize) {
        let all: Vec<u32> = (0..patches.patches.len() as u32).collect();
        let (rows, _) = gather_rows(room, patches, &all, &[]);
        for _ in 0..times {
            let radiance: Vec<[f32; 3]> = patches.patches.iter().map(|p| p.radiance_rgb).collect();
            for (patch, row) in patches.patches.iter_mut().zip(&rows) {
                let surface = &room.surfaces[patch.surface as usize];
                for c in 0..3 {
                    let gathered: f32 = row.iter().map(|&(i, t)| radiance[i as usize][c] * t).sum();
                    patch.radiance_rgb[c] = surface.emitted_rgb[c] + surface.reflectance_rgb[c] * gathered;
                }
            }
        }
    }

    #[test]
    fn hidden_patches_are_as_bright_as_light_makes_them() {
        let room = fixture::room();
        let how = Subdivision { patches: 500, ..Subdivision::default() };
        let mut patches = subdivide(&room, &how, &|_| None).unwrap();
        settled(&room, &mut patches, 12);
        let truth = patches.clone();
        // A probe on the table sees none of what is below it.
        for patch in &mut patches.patches {
            patch.seen = patch.centre_world.z > -0.01 && is_before(patch, Vec3::new(0.0, 0.0, 0.4));
        }
        let hidden = indices(&patches.patches, |p| !p.seen);
        assert!(hidden.len() > 100 && hidden.len() < 400, "{}", hidden.len());
        assert_eq!(fill_unseen(&room, &mut patches, &[]), hidden.len());
        let (mut squares, mut all) = (0.0f64, 0.0f64);
        for &i in &hidden {
            let (got, want) = (&patches.patches[i as usize], &truth.patches[i as usize]);
            assert!(!got.seen);
            if want.surface != 2 {
                squares += f64::from(got.radiance_rgb[0] - want.radiance_rgb[0]).powi(2);
                all += f64::from(want.radiance_rgb[0]).powi(2);
            }
        }
        let off = (squares / all).sqrt();
        println!("relative RMSE of {} hidden patches: {off:.4}", hidden.len());
        assert!(off < 0.1, "{off}");
    }

    #[test]
    fn the_hidden_half_of_a_lamp_is_like_the_seen_one() {
        let room = fixture::room();
        let how = Subdivision { patches: 500, ..Subdivision::default() };
        let mut patches = subdivide(&room, &how, &|_| None).unwrap();
        let lamp = indices(&patches.patches, |p| p.surface == 2);
        assert!(lamp.len() >= 8, "{}", lamp.len());
        for patch in &mut patches.patches {
            patch.seen = patch.surface == 2 && patch.centre_world.x < 0.6;
        }
        let mut dark = room.clone();
        dark.surfaces[2].emitted_rgb = [0.0; 3];
        fill_unseen(&dark, &mut patches, &[]);
        for &i in &lamp {
            assert_eq!(patches.patches[i as usize].radiance_rgb, room.surfaces[2].emitted_rgb);
        }
        // The floor was not seen anywhere: lit by the lamp through its own reflectance.
        let floor = patches.patches.iter().find(|p| p.normal_world.z > 0.9 && p.centre_world.z < -0.7);
        assert!(floor.is_some_and(|p| p.radiance_rgb[0] > 0.1));
    }
}
