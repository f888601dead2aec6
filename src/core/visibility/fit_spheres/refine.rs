//! Moving spheres to better places.

use super::voxels::Voxels;
use glam::DVec3;

/// A sphere in cubes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundSphere {
    /// In units of cubes.
    pub centre: DVec3,
    /// Above 0.
    pub radius: f64,
}

/// An inner cube that is covered counts this much against an outer one: a little more, for a body with holes in it
/// lets light through where there is none.
const COVERED: f64 = 1.25;
/// A cube that is covered once more costs this much: overlapping spheres darken twice where the light is soft.
const OVERLAP: f64 = 0.12;
/// First and last step of a search, cubes.
const STEPS: [f64; 5] = [3.0, 1.5, 0.75, 0.4, 0.2];
/// Most rounds over all spheres at one step.
const ROUNDS: usize = 24;
/// Smallest radius, cubes.
const SMALLEST: f64 = 0.75;
/// So many spheres are moved elsewhere in vain before it ends.
const MOST_VAIN: usize = 8;
/// How many uncovered cubes are tried as a sphere's new place.
const PLACES: usize = 160;
/// Radii that are tried there, cubes.
const RADII: [f64; 7] = [1.2, 1.8, 2.6, 3.7, 5.2, 7.3, 10.0];

fn gain(voxels: &Voxels, sphere: &FoundSphere) -> f64 {
    voxels.gain(sphere, COVERED, OVERLAP)
}

/// Moves and resizes one sphere after the other, by smaller and smaller steps, for as long as it helps. All are counted
/// in before and after.
pub fn refine(voxels: &mut Voxels, spheres: &mut [FoundSphere]) {
    for step in STEPS {
        let mut settled = vec![false; spheres.len()];
        for _ in 0..ROUNDS {
            for k in 0..spheres.len() {
                if settled[k] {
                    continue;
                }
                let before = spheres[k];
                voxels.add(&before, -1);
                let after = better(voxels, before, step);
                voxels.add(&after, 1);
                spheres[k] = after;
                if after == before {
                    settled[k] = true;
                } else {
                    // Whoever touches it may now have more room or less.
                    for j in 0..spheres.len() {
                        let reach = spheres[j].radius + before.radius.max(after.radius) + 2.0 * step;
                        if j != k && spheres[j].centre.distance(after.centre) < reach {
                            settled[j] = false;
                        }
                    }
                }
            }
            if settled.iter().all(|&s| s) {
                break;
            }
        }
    }
}

/// The best of a sphere's neighbours at one step, or itself.
fn better(voxels: &Voxels, sphere: FoundSphere, step: f64) -> FoundSphere {
    let mut best = (gain(voxels, &sphere), sphere);
    let mut consider = |centre: DVec3, radius: f64| {
        let candidate = FoundSphere { centre, radius };
        if radius >= SMALLEST {
            let value = gain(voxels, &candidate);
            if value > best.0 + 1e-9 {
                best = (value, candidate);
            }
        }
    };
    for grown in [0.0, 0.6 * step, -0.6 * step] {
        let radius = sphere.radius + grown;
        if grown != 0.0 {
            consider(sphere.centre, radius);
        }
        for axis in 0..3 {
            for sign in [step, -step] {
                let mut centre = sphere.centre;
                centre[axis] += sign;
                consider(centre, radius);
            }
        }
    }
    best.1
}

/// Takes the sphere that brings least and puts it where a new one brings most, for as long as the whole gains.
pub fn relocate(voxels: &mut Voxels, spheres: &mut Vec<FoundSphere>, progress: &mut dyn FnMut(f32)) {
    let tries = 3 * spheres.len() + MOST_VAIN;
    let mut banned: Vec<FoundSphere> = Vec::new();
    for attempt in 0..tries {
        progress(attempt as f32 / tries as f32);
        let Some(least) = least(voxels, spheres, &banned) else { break };
        let before = spheres.clone();
        let worth = total(voxels, spheres);
        voxels.add(&spheres[least], -1);
        let Some(place) = vacancy(voxels) else {
            voxels.add(&spheres[least], 1);
            break;
        };
        spheres[least] = place;
        voxels.add(&place, 1);
        refine(voxels, spheres);
        if total(voxels, spheres) <= worth * (1.0 + 1e-4) {
            // No better: back to where it was, and the next one is tried.
            spheres.iter().for_each(|sphere| voxels.add(sphere, -1));
            *spheres = before;
            spheres.iter().for_each(|sphere| voxels.add(sphere, 1));
            banned.push(spheres[least]);
        } else {
            banned.clear();
        }
        // So many in a row could not be placed better: neither can the others.
        if banned.len() >= MOST_VAIN {
            break;
        }
    }
}

/// The index of the sphere whose loss costs least, of those that were not tried in vain.
fn least(voxels: &mut Voxels, spheres: &[FoundSphere], banned: &[FoundSphere]) -> Option<usize> {
    let mut least: Option<(f64, usize)> = None;
    for (k, sphere) in spheres.iter().enumerate() {
        if banned.contains(sphere) {
            continue;
        }
        voxels.add(sphere, -1);
        let value = gain(voxels, sphere);
        voxels.add(sphere, 1);
        if least.is_none_or(|(lowest, _)| value < lowest) {
            least = Some((value, k));
        }
    }
    least.map(|(_, k)| k)
}

/// Where a further sphere would bring most.
fn vacancy(voxels: &Voxels) -> Option<FoundSphere> {
    let free = voxels.uncovered_points();
    let stride = free.len().div_ceil(PLACES).max(1);
    let mut best: Option<(f64, FoundSphere)> = None;
    for centre in free.into_iter().step_by(stride) {
        for radius in RADII {
            let candidate = FoundSphere { centre, radius };
            let value = gain(voxels, &candidate);
            if best.is_none_or(|(highest, _)| value > highest) {
                best = Some((value, candidate));
            }
        }
    }
    best.map(|(_, sphere)| sphere)
}

/// What all spheres bring together; they are counted in.
fn total(voxels: &mut Voxels, spheres: &[FoundSphere]) -> f64 {
    spheres.iter().for_each(|sphere| voxels.add(sphere, -1));
    spheres
        .iter()
        .map(|sphere| {
            let value = gain(voxels, sphere);
            voxels.add(sphere, 1);
            value
        })
        .sum()
}
