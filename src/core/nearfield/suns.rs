//! The sun in the room, the limit that [Gib03] names: a small strong light in the probe is no light of the window that it
//! is seen through. It is taken out of the probe's picture before that is mapped onto patches, and becomes a light at
//! infinity that shines in.

use super::faces::Faces;
use crate::{
    math::color,
    model::{
        light::{MAX_LIGHTS, RadianceSamples},
        room::{RoomPatches, RoomSun},
    },
};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Half angle of the cap that holds a sun with the glare around it, degrees...
const CAP_DEG: f32 = 2.5;
/// ...and in widths of a texel at least. The ring around it reaches twice as far.
const CAP_TEXELS: f32 = 2.5;
/// A sun has at least this share of the luminous flux of the whole sphere: lamps in a room, whose walls they light, have
/// less or are wider.
pub const LEAST_SHARE: f32 = 0.05;
/// And is this many times as bright as what is around it.
const LEAST_CONTRAST: f32 = 20.0;
/// Root mean square angle to its centre at most, degrees; in widths of a texel where those are larger.
const MOST_EXTENT_DEG: f32 = 1.5;
/// An aperture is at most this share of the room's area: walls whose windows are no surfaces of their own do not count, for
/// then the sun would shine through all of them.
const MOST_APERTURE: f32 = 0.2;
/// Rays start this share of the room's diagonal before their vertex.
const LIFT: f32 = 1e-4;

/// Finds up to four suns, takes them out of the samples (directions from `position_world`, world frame), and puts what is
/// around them in their place. The flux that a sun has as its irradiance is what its samples lose: per channel the sums
/// over all samples and all suns are what they were.
///
/// A sun stands above the horizon; its aperture is the surface whose front the ray from the probe to it meets first, none
/// where that meets nothing. One that is seen on a back, or on a surface that is a large part of the room, is left as it is.
pub fn take_suns(samples: &mut RadianceSamples, faces: &Faces, position_world: Vec3) -> Vec<RoomSun> {
    let flux = |d: &[f32; 4], c: &[f32; 4]| f64::from(color::luminance([c[0], c[1], c[2]]) * d[3]);
    let whole: f64 = samples.directions.iter().zip(&samples.radiance).map(|(d, c)| flux(d, c)).sum();
    let texel_rad = (4.0 * PI / samples.directions.len().max(1) as f32).sqrt();
    let mut suns = Vec::new();
    let mut refused: Vec<Vec3> = Vec::new();
    while suns.len() < MAX_LIGHTS && refused.len() < MAX_LIGHTS && whole > 0.0 {
        let Some(found) = brightest(samples, texel_rad, &refused) else { break };
        let share = f64::from(color::luminance(found.sun.irradiance_rgb)) / whole;
        let most_rad = MOST_EXTENT_DEG.to_radians().max(texel_rad);
        let towards = Vec3::from(found.sun.to_light_world);
        let aperture = faces.first(position_world, towards);
        let is_sun = share >= f64::from(LEAST_SHARE)
            && found.contrast >= LEAST_CONTRAST
            && found.sun.extent_rad <= most_rad
            && towards.z > 0.0
            && aperture.is_none_or(|met| met.is_front && faces.area_share(met.index) <= MOST_APERTURE);
        if !is_sun {
            refused.push(found.seed);
            continue;
        }
        for (index, left_rgb) in found.left {
            samples.radiance[index][..3].copy_from_slice(&left_rgb);
        }
        suns.push(RoomSun { apertures: aperture.iter().map(|met| met.index).collect(), ..found.sun });
    }
    suns
}

struct FoundSun {
    sun: RoomSun,
    seed: Vec3,
    contrast: f32,
    /// What its samples keep.
    left: Vec<(usize, [f32; 3])>,
}

/// The cap about the brightest sample that is not near one that was refused.
fn brightest(samples: &RadianceSamples, texel_rad: f32, refused: &[Vec3]) -> Option<FoundSun> {
    let cap_rad = CAP_DEG.to_radians().max(CAP_TEXELS * texel_rad);
    let (cos_cap, cos_ring) = (cap_rad.cos(), (2.0 * cap_rad).cos());
    let direction = |d: &[f32; 4]| Vec3::new(d[0], d[1], d[2]);
    let rgb = |c: &[f32; 4]| [c[0], c[1], c[2]];
    let all = || samples.directions.iter().zip(&samples.radiance).enumerate();
    let free = |d: Vec3| refused.iter().all(|r| r.dot(d) < cos_ring);
    let seed = all()
        .filter(|(_, (d, _))| d[3] > 0.0 && free(direction(d)))
        .max_by(|a, b| color::luminance(rgb(a.1.1)).total_cmp(&color::luminance(rgb(b.1.1))))
        .map(|(_, (d, _))| direction(d))?;
    // The cap moves to the light's centroid once.
    let mut centre = seed;
    let mut found = None;
    for _ in 0..2 {
        let inside: Vec<usize> =
            all().filter(|(_, (d, _))| direction(d).dot(centre) >= cos_cap).map(|(i, _)| i).collect();
        let mut around: Vec<([f32; 3], f32)> = all()
            .filter(|(_, (d, _))| (cos_ring..cos_cap).contains(&direction(d).dot(centre)))
            .map(|(_, (d, c))| (rgb(c), d[3]))
            .collect();
        let background_rgb: [f32; 3] = std::array::from_fn(|c| median(&mut around, c));
        let (mut flux, mut moment, mut luminous, mut solid_angle) = ([0.0f64; 3], Vec3::ZERO, 0.0f64, 0.0f64);
        let mut left = Vec::new();
        for &index in &inside {
            let (d, radiance) = (&samples.directions[index], rgb(&samples.radiance[index]));
            let kept: [f32; 3] = std::array::from_fn(|c| radiance[c].min(background_rgb[c]));
            let beyond: [f64; 3] = std::array::from_fn(|c| f64::from(radiance[c]) - f64::from(kept[c]));
            (0..3).for_each(|c| flux[c] += beyond[c] * f64::from(d[3]));
            let power = color::luminance(beyond) * f64::from(d[3]);
            moment += direction(d) * power as f32;
            luminous += power;
            solid_angle += f64::from(d[3]);
            left.push((index, kept));
        }
        let towards = moment.normalize_or(centre);
        let square = |i: &usize| {
            let d = &samples.directions[*i];
            let beyond: [f32; 3] =
                std::array::from_fn(|c| (samples.radiance[*i][c] - background_rgb[c]).max(0.0));
            f64::from(color::luminance(beyond) * d[3] * direction(d).angle_between(towards).powi(2))
        };
        let squares: f64 = inside.iter().map(square).sum();
        let extent_rad = if luminous > 0.0 { (squares / luminous).sqrt() as f32 } else { 0.0 };
        let mean = if solid_angle > 0.0 { luminous / solid_angle } else { 0.0 };
        let contrast = (mean / f64::from(color::luminance(background_rgb)).max(1e-12)) as f32;
        let sun = RoomSun {
            to_light_world: towards.to_array(),
            irradiance_rgb: flux.map(|c| c as f32),
            extent_rad,
            apertures: Vec::new(),
        };
        found = Some(FoundSun { sun, seed, contrast, left });
        centre = towards;
    }
    found
}

/// Of a channel, weighted by solid angle; 0 of none.
fn median(list: &mut [([f32; 3], f32)], channel: usize) -> f32 {
    list.sort_unstable_by(|a, b| a.0[channel].total_cmp(&b.0[channel]).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * list.iter().map(|l| f64::from(l.1)).sum::<f64>();
    let mut sum = 0.0;
    for (rgb, weight) in list.iter() {
        sum += f64::from(*weight);
        if sum >= half {
            return rgb[channel];
        }
    }
    0.0
}

/// What the suns give a place: irradiance over pi, so that times the diffuse reflectance it is the radiance that leaves.
pub fn sunlight(suns: &[RoomSun], faces: &Faces, at_world: Vec3, normal_world: Vec3) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let origin = at_world + normal_world * (LIFT * faces.diagonal());
    for sun in suns {
        let towards = Vec3::from(sun.to_light_world);
        let cosine = normal_world.dot(towards);
        if cosine > 0.0 && faces.leaves(origin, towards, &sun.apertures) {
            (0..3).for_each(|c| sum[c] += sun.irradiance_rgb[c] * cosine / PI);
        }
    }
    sum
}

/// `sunlight` at every vertex of the patches.
pub fn sun_at_vertices(suns: &[RoomSun], faces: &Faces, patches: &RoomPatches) -> Vec<[f32; 3]> {
    let at = |v: &crate::model::room::PatchVertex| sunlight(suns, faces, v.gather_world, v.normal_world);
    patches.vertices.par_iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use crate::model::room::{Face, RoomSurface};

    /// The walls with a window before the wall at x = -2, and the samples of a probe at the origin: 1 everywhere, a sun of
    /// radiance 1e4 and so many texels' solid angle.
    fn scene(towards: Vec3, half_angle: f32) -> (Faces, RadianceSamples, f64) {
        let corner = |y: f32, z: f32| Vec3::new(-1.99, y, z);
        let window = RoomSurface {
            name: "window".into(),
            corners_world: vec![corner(-0.8, 0.2), corner(0.8, 0.2), corner(0.8, 1.5), corner(-0.8, 1.5)],
            faces: vec![Face::Quad([0, 1, 2, 3])],
            ..RoomSurface::default()
        };
        let mut room = fixture::room();
        room.surfaces.push(window);
        let count = 40_000;
        let mut samples = RadianceSamples::default();
        let mut sun_flux = 0.0;
        for k in 0..count {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
            let d = ((1.0 - z * z).sqrt() * crate::math::spiral::turn_f32(k)).extend(z);
            let solid_angle = 4.0 * PI / count as f32;
            samples.directions.push(d.extend(solid_angle).to_array());
            let in_sun = d.angle_between(towards) < half_angle;
            let c = if in_sun { 1e4 } else { 1.0 };
            samples.radiance.push([c, 0.9 * c, 0.5 * c, 0.0]);
            sun_flux += if in_sun { f64::from((c - 1.0) * solid_angle) } else { 0.0 };
        }
        (Faces::of_room(&room), samples, sun_flux)
    }

    fn flux(samples: &RadianceSamples, channel: usize) -> f64 {
        let each = samples.directions.iter().zip(&samples.radiance);
        each.map(|(d, c)| f64::from(d[3]) * f64::from(c[channel])).sum()
    }

    #[test]
    fn a_sun_behind_a_window_is_found_with_all_of_its_flux() {
        let towards = Vec3::new(-1.8, 0.1, 0.8).normalize();
        let (faces, mut samples, want) = scene(towards, 0.02);
        let before: Vec<f64> = (0..3).map(|c| flux(&samples, c)).collect();
        let suns = take_suns(&mut samples, &faces, Vec3::ZERO);
        assert_eq!(suns.len(), 1, "{suns:?}");
        let sun = &suns[0];
        assert!(
            (f64::from(sun.irradiance_rgb[0]) / want - 1.0).abs() < 1e-5,
            "{} of {want}",
            sun.irradiance_rgb[0]
        );
        // Twelve samples in a disc: their centroid is off by a part of a sample's width of 1 degree.
        assert!(towards.angle_between(Vec3::from(sun.to_light_world)) < 0.005);
        assert_eq!(sun.apertures, [3]);
        for c in 0..3 {
            let after = flux(&samples, c) + f64::from(sun.irradiance_rgb[c]);
            assert!((after / before[c] - 1.0).abs() < 1e-6, "{c}: {after} of {}", before[c]);
        }
        assert!(samples.radiance.iter().all(|c| c[0] <= 1.0));
        // It shines through the window to the floor below, and to no place that the wall hides.
        let up = Vec3::Z;
        let at = |x: f32| sunlight(&suns, &faces, Vec3::new(x, 0.0, -0.75), up)[0];
        let cosine = sun.to_light_world[2];
        assert!((at(0.6) - sun.irradiance_rgb[0] * cosine / PI).abs() < 1e-6 * at(0.6), "{}", at(0.6));
        assert_eq!(at(-1.9), 0.0);
    }

    #[test]
    fn what_is_wide_weak_low_or_on_a_wall_is_no_sun() {
        let towards = Vec3::new(-1.8, 0.1, 0.8).normalize();
        let find = |towards: Vec3, half_angle: f32, radiance: f32| {
            let (faces, mut samples, _) = scene(towards, half_angle);
            samples.radiance.iter_mut().filter(|c| c[0] > 1.0).for_each(|c| *c = [radiance; 4]);
            take_suns(&mut samples, &faces, Vec3::ZERO)
        };
        assert_eq!(find(towards, 0.02, 1e4).len(), 1);
        assert_eq!(find(towards, 0.2, 1e4).len(), 0, "wide");
        assert_eq!(find(towards, 0.02, 300.0).len(), 0, "weak");
        assert_eq!(find(Vec3::new(-1.8, 0.1, -0.3).normalize(), 0.02, 1e4).len(), 0, "low");
        assert!(
            take_suns(&mut RadianceSamples::default(), &Faces::of_room(&fixture::room()), Vec3::ZERO)
                .is_empty()
        );
    }
}
