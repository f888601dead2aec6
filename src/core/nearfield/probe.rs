//! Radiance of a room's patches read off a probe: an HDR picture of the whole sphere, taken at a known place in it.
//!
//! Every texel is a bundle of rays from that place; what a ray meets first gets its light. A patch has the mean over
//! the rays that met it, weighted by solid angle: radiance times solid angle sums to what the picture holds, however small
//! and bright a lamp is. What the probe did not see is filled in (`fill`).

use super::{
    error::RoomError,
    faces::Faces,
    fill::fill_unseen,
    patches::{Subdivision, SurfacePoint, subdivide},
    sent::what_hides,
    suns::take_suns,
};
use crate::{
    light::maps,
    math::{sphere, spiral::turn_f32},
    model::{
        image::RadianceImage,
        keep::KeptInput,
        light::{EnvironmentMap, MapLayout, RadianceSamples},
        room::{Room, RoomPatch, RoomPatches, RoomSun},
    },
};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// Directions that tell whether the probe is in the room.
const LOOKS: usize = 2048;
/// Share of the directions in which a probe sees the fronts of surfaces at least.
const LEAST_FRONTS: f32 = 0.1;
/// Rays at least; a texel of a small picture sends several.
const LEAST_RAYS: usize = 400_000;
/// Rays of a texel, a side, at most.
const MOST_SIDE: usize = 8;
/// Rays that a patch's mean needs: with fewer it is looked up in the picture, at places so many a side.
const ENOUGH_RAYS: u32 = 4;
const PLACES_SIDE: usize = 4;
/// Most rows of the picture in which patches are looked up that are smaller than a few rays.
const MOST_ROWS: usize = 1024;
/// A patch of which this share was seen counts as seen.
const SEEN_SHARE: f64 = 0.25;
/// Rows of the picture in which places are looked up while patches are made: a lamp of any size is in its texels' means.
const LOOKUP_ROWS: usize = 180;
/// Rays are dealt out in so many lots, whatever the threads.
const LOTS: usize = 64;

/// An HDR picture of the whole sphere, and where it was taken.
#[derive(Clone, Copy, Debug)]
pub struct Probe<'a> {
    /// Radiance of all directions.
    pub map: &'a EnvironmentMap,
    /// Turns the map's axes (`light::maps`) into the world's.
    pub world_from_map: DMat3,
    /// Where it was taken, world frame, metres.
    pub position_world: Vec3,
    /// Whether small strong lights become suns.
    pub factor_sun: bool,
}

/// What became of the probe's light. Flux is the integral of radiance over solid angle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProbeReport {
    /// Flux of the whole picture, linear RGB.
    pub flux_rgb: [f64; 3],
    /// That of the suns.
    pub sun_flux_rgb: [f64; 3],
    /// That of the rays that met fronts of patches.
    pub patch_flux_rgb: [f64; 3],
    /// Share of all directions that met the front of a patch...
    pub fronts: f32,
    /// ...a back, whose light is lost...
    pub backs: f32,
    /// ...and nothing: light from open places is lost, too.
    pub nothing: f32,
    /// Patches that were seen.
    pub seen_patches: usize,
    /// Patches that were filled in.
    pub filled_patches: usize,
    /// Texels of the picture that were damaged and replaced.
    pub damaged_texels: u32,
}

/// Patches with the probe's radiance, suns, and what became of the light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mapped {
    /// Divided more finely where radiance changes.
    pub patches: RoomPatches,
    /// Taken out of the picture before.
    pub suns: Vec<RoomSun>,
    /// What became of the light.
    pub report: ProbeReport,
}

/// What [`map_probe`] is given.
#[derive(Clone, Copy, Debug)]
pub struct MappedInput<'a> {
    /// The room that the probe was taken in.
    pub room: &'a Room,
    /// How it is divided.
    pub subdivision: &'a Subdivision,
    /// What is mapped onto its patches.
    pub probe: &'a Probe<'a>,
}

impl KeptInput for MappedInput<'_> {
    const KIND: &'static str = "room";
    const VERSION: u32 = 1;
    type Output = Mapped;

    fn hashed(&self) -> impl Serialize {
        let Probe { map, world_from_map, position_world, factor_sun } = self.probe;
        let light = self.room.surfaces.iter().map(|s| (s.reflectance_rgb, s.emitted_rgb));
        let layout = match map.layout {
            MapLayout::Equirect => 0u8,
            MapLayout::Angular => 1,
            MapLayout::Cube => 2,
        };
        let picture = (layout, map.radiance.width(), map.radiance.height(), map.radiance.pixels());
        let how = self.subdivision;
        (
            (what_hides(self.room), light.collect::<Vec<_>>(), how.patches, how.refined, how.edges),
            (picture, world_from_map.to_cols_array(), position_world.to_array(), *factor_sun),
        )
    }

    fn accepts(&self, mapped: &Mapped) -> bool {
        let RoomPatches { vertices, patches, .. } = &mapped.patches;
        let surfaces = self.room.surfaces.len();
        let patch_fits = |p: &RoomPatch| {
            (p.surface as usize) < surfaces && p.corners.iter().all(|&i| (i as usize) < vertices.len())
        };
        let within = |i: &u32| (*i as usize) < surfaces;
        patches.iter().all(patch_fits) && mapped.suns.iter().all(|sun| sun.apertures.iter().all(within))
    }
}

/// Divides a room and maps a probe onto it. `progress` is told the share done, 0 to 1.
///
/// # Errors
/// A picture of the wrong shape; a probe that sees more backs than fronts, or hardly any front; what `subdivide` refuses.
pub fn map_probe(
    room: &Room,
    how: &Subdivision,
    probe: &Probe<'_>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Mapped, RoomError> {
    let (map, at) = (probe.map, probe.position_world);
    let mut samples = RadianceSamples::default();
    let flags = maps::samples_of_map(map, &mut samples);
    if !maps::fits(map) || samples.directions.is_empty() {
        let (width, height) = (map.radiance.width(), map.radiance.height());
        return Err(RoomError::ProbePicture { width, height, layout: map.layout });
    }
    maps::turn(&mut samples, probe.world_from_map);
    let faces = Faces::of_room(room);
    stands_inside(&faces, at)?;
    let mut report = ProbeReport { damaged_texels: flags.not_finite_texels, ..ProbeReport::default() };
    report.flux_rgb = flux(&samples);
    let suns = if probe.factor_sun { take_suns(&mut samples, &faces, at) } else { Vec::new() };
    for sun in &suns {
        (0..3).for_each(|c| report.sun_flux_rgb[c] += f64::from(sun.irradiance_rgb[c]));
    }
    progress(0.1);
    let picture = maps::equirect_of_samples(&samples, LOOKUP_ROWS).unwrap_or_default();
    let look = |point: &SurfacePoint| {
        is_visible(&faces, at, point.point_world, point.normal_world)
            .then(|| look(&picture, point.point_world - at))
    };
    let mut patches = subdivide(room, how, &look)?;
    progress(0.4);
    let lots = shower(&samples, &Faces::of_patches(&patches), at, patches.patches.len());
    progress(0.8);
    let fine = maps::equirect_of_samples(&samples, native_rows(map)).unwrap_or_default();
    for (index, lot) in lots.met.iter().enumerate() {
        let (corners, count) = patches.outline_world(&patches.patches[index]);
        let whole = solid_angle(&corners[..count], at);
        let patch = &mut patches.patches[index];
        if lot.rays >= ENOUGH_RAYS {
            patch.seen = lot.solid_angle_sr >= SEEN_SHARE * whole;
            patch.radiance_rgb = lot.flux_rgb.map(|c| (c / lot.solid_angle_sr) as f32);
        } else if patch.seen {
            patch.radiance_rgb = mean_of(&fine, &corners, at);
        }
        report.seen_patches += usize::from(patch.seen);
        (0..3).for_each(|c| report.patch_flux_rgb[c] += lot.flux_rgb[c]);
    }
    let share = |solid_angle_sr: f64| (solid_angle_sr / (4.0 * f64::from(PI))) as f32;
    report.fronts = share(lots.met.iter().map(|m| m.solid_angle_sr).sum());
    (report.backs, report.nothing) = (share(lots.backs_sr), share(lots.nothing_sr));
    report.filled_patches = fill_unseen(room, &mut patches, &suns);
    progress(1.0);
    Ok(Mapped { patches, suns, report })
}

/// The probe's rays meet fronts, and not mostly backs.
fn stands_inside(faces: &Faces, at: Vec3) -> Result<(), RoomError> {
    let (mut fronts, mut backs) = (0, 0);
    for k in 0..LOOKS {
        match faces.first(at, spiral(k, LOOKS)) {
            Some(met) if met.is_front => fronts += 1,
            Some(_) => backs += 1,
            None => {}
        }
    }
    let per_cent = |n: usize| 100.0 * n as f32 / LOOKS as f32;
    if !at.is_finite() || backs > fronts || (fronts as f32) < LEAST_FRONTS * LOOKS as f32 {
        return Err(RoomError::ProbeOutside {
            at: at.to_array(),
            fronts: per_cent(fronts),
            backs: per_cent(backs),
            nothing: per_cent(LOOKS - fronts - backs),
        });
    }
    Ok(())
}

/// The k-th of `count` directions spread evenly over the sphere.
fn spiral(k: usize, count: usize) -> Vec3 {
    let z = 1.0 - (2 * k + 1) as f32 / count as f32;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    (radius * turn_f32(k)).extend(z)
}

fn flux(samples: &RadianceSamples) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (d, radiance) in samples.directions.iter().zip(&samples.radiance) {
        (0..3).for_each(|c| sum[c] += f64::from(radiance[c]) * f64::from(d[3]));
    }
    sum
}

/// Whether a place on a surface is seen from the probe, from its front.
fn is_visible(faces: &Faces, probe: Vec3, place: Vec3, normal: Vec3) -> bool {
    let to = place - probe;
    normal.dot(to) < 0.0 && faces.first(probe, to).is_none_or(|met| met.t >= 1.0 - 1e-3)
}

fn look(picture: &RadianceImage, direction: Vec3) -> [f32; 3] {
    let (width, height) = (picture.width(), picture.height());
    if width == 0 || height == 0 {
        return [0.0; 3];
    }
    let (u, v) = sphere::equirect_uv(direction.as_dvec3());
    let at = |x: f64, size: usize| ((x * size as f64) as usize).min(size - 1);
    *picture.at(at(u, width), at(v, height))
}

/// Rows of an equirectangular picture with texels of about a map's size.
fn native_rows(map: &EnvironmentMap) -> usize {
    let rows = match map.layout {
        MapLayout::Equirect => map.radiance.height(),
        MapLayout::Cube => 2 * map.radiance.width(),
        MapLayout::Angular => map.radiance.width(),
    };
    rows.clamp(1, MOST_ROWS)
}

/// Over a patch, as seen from the probe.
fn mean_of(picture: &RadianceImage, corners: &[Vec3; 4], probe: Vec3) -> [f32; 3] {
    let [a, b, c, d] = *corners;
    let mut sum = [0.0; 3];
    let share = |i: usize| (i as f32 + 0.5) / PLACES_SIDE as f32;
    for k in 0..PLACES_SIDE * PLACES_SIDE {
        let (u, v) = (share(k % PLACES_SIDE), share(k / PLACES_SIDE));
        let rgb = look(picture, a.lerp(b, u).lerp(d.lerp(c, u), v) - probe);
        (0..3).for_each(|c| sum[c] += rgb[c] / (PLACES_SIDE * PLACES_SIDE) as f32);
    }
    sum
}

/// What met a patch.
#[derive(Clone, Copy, Debug, Default)]
struct MetPatch {
    flux_rgb: [f64; 3],
    solid_angle_sr: f64,
    rays: u32,
}

#[derive(Default)]
struct Shower {
    met: Vec<MetPatch>,
    backs_sr: f64,
    nothing_sr: f64,
}

/// Sends every sample out as a square of rays of its solid angle.
fn shower(samples: &RadianceSamples, patches: &Faces, at: Vec3, count: usize) -> Shower {
    let total = samples.directions.len();
    let side = ((LEAST_RAYS as f64 / total.max(1) as f64).sqrt().ceil() as usize).clamp(1, MOST_SIDE);
    let per_lot = total.div_ceil(LOTS).max(1);
    let lots: Vec<Shower> = samples
        .directions
        .par_chunks(per_lot)
        .zip(samples.radiance.par_chunks(per_lot))
        .map(|(directions, radiance)| {
            let mut lot = Shower { met: vec![MetPatch::default(); count], ..Shower::default() };
            for (d, c) in directions.iter().zip(radiance) {
                let middle = Vec3::new(d[0], d[1], d[2]);
                let (across, along) = middle.any_orthonormal_pair();
                let (width, part_sr) = (d[3].sqrt(), f64::from(d[3]) / (side * side) as f64);
                for k in 0..side * side {
                    let place = |i: usize| width * ((i as f32 + 0.5) / side as f32 - 0.5);
                    let direction = middle + across * place(k % side) + along * place(k / side);
                    match patches.first(at, direction) {
                        Some(met) if met.is_front => {
                            let slot = &mut lot.met[met.index as usize];
                            (0..3).for_each(|i| slot.flux_rgb[i] += f64::from(c[i]) * part_sr);
                            slot.solid_angle_sr += part_sr;
                            slot.rays += 1;
                        }
                        Some(_) => lot.backs_sr += part_sr,
                        None => lot.nothing_sr += part_sr,
                    }
                }
            }
            lot
        })
        .collect();
    // In the order of the lots.
    let mut sum = Shower { met: vec![MetPatch::default(); count], ..Shower::default() };
    for lot in lots {
        for (sum, met) in sum.met.iter_mut().zip(lot.met) {
            (0..3).for_each(|c| sum.flux_rgb[c] += met.flux_rgb[c]);
            sum.solid_angle_sr += met.solid_angle_sr;
            sum.rays += met.rays;
        }
        sum.backs_sr += lot.backs_sr;
        sum.nothing_sr += lot.nothing_sr;
    }
    sum
}

/// Of a flat convex outline, steradians, whichever way it faces.
pub fn solid_angle(outline: &[Vec3], from: Vec3) -> f64 {
    let at = |p: &Vec3| -> DVec3 { (*p - from).as_dvec3().normalize_or_zero() };
    let triangle =
        |k: usize| sphere::triangle_solid_angle(at(&outline[0]), at(&outline[k]), at(&outline[k + 1]));
    (1..outline.len().saturating_sub(1)).map(triangle).sum::<f64>().abs()
}

#[cfg(test)]
mod tests;
