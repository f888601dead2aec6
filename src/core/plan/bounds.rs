//! Bounds on what effects can change in a picture, from the light and the scene alone. Each holds for every pixel; where
//! nothing can be said it is infinite.
//!
//! All rest on |sum over m of c_lm y_lm(w)| <= sqrt((2l+1)/(4 pi)) |c_l| for each band l and any direction w (the addition
//! theorem with Cauchy and Schwarz).

use crate::math::sh::{MAX_ORDER, zonal};
use crate::model::{
    blocker::{BlockerSphere, Rung},
    light::{Lights, RadianceSh},
    scene::{Material, Scene},
};
use glam::Vec3;
use std::f32::consts::PI;

/// Spheres times triangles that are looked at in a frame; of more nothing is said.
const MOST_PAIRS: usize = 50_000;

/// Length of band `l` of one channel, times sqrt((2l+1)/(4 pi)).
fn band(light: &RadianceSh, l: usize, channel: usize) -> f32 {
    let rows = light.rgb.get(l * l..(l + 1) * (l + 1)).unwrap_or(&[]);
    let square: f32 = rows.iter().map(|row| row[channel] * row[channel]).sum();
    ((2 * l + 1) as f32 / (4.0 * PI) * square).sqrt()
}

/// The least irradiance of soft light on any normal, each channel; may be negative.
pub fn least_soft_irradiance(light: &RadianceSh) -> [f32; 3] {
    let order = light.order.clamp(1, MAX_ORDER);
    let mut lambert = [0.0f64; MAX_ORDER];
    zonal::lambert(order, &mut lambert);
    std::array::from_fn(|c| {
        let mut least = 0.0;
        for (l, z) in lambert.iter().enumerate().take(order) {
            let factor = ((4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt() * z).abs() as f32;
            let size = factor * band(light, l, c);
            // Band 0 is a constant, with its sign.
            least += if l == 0 { size * light.rgb[0][c].signum() } else { -size };
        }
        PI * least
    })
}

/// The largest radiance of soft light from any direction, without its sign, each channel.
pub fn most_soft_radiance(light: &RadianceSh) -> [f32; 3] {
    std::array::from_fn(|c| (0..light.order.min(MAX_ORDER)).map(|l| band(light, l, c)).sum())
}

fn shining(light: &Lights) -> impl Iterator<Item = (Vec3, [f32; 3])> {
    let finite = |e: f32| if e.is_finite() { e.max(0.0) } else { 0.0 };
    light
        .hard
        .as_slice()
        .iter()
        .map(move |h| (Vec3::from(h.to_light_world).normalize_or_zero(), h.irradiance_rgb.map(finite)))
}

/// What all hard shadows together can take: the hard lights' share of the least light that any normal gets with nothing in
/// the way. A glossy object may show a hard light many times brighter than a matt one: no bound.
pub fn hard_share(scene: &Scene, light: &Lights) -> f32 {
    let mut hard = [0.0f32; 3];
    for (_, e) in shining(light) {
        hard.iter_mut().zip(e).for_each(|(sum, e)| *sum += e);
    }
    if hard == [0.0; 3] {
        return 0.0;
    }
    let is_glossy =
        |m: &Material| matches!(m, Material::Phong { specular_rgb, .. } if *specular_rgb != [0.0; 3]);
    if scene.objects.iter().any(|o| is_glossy(&o.material)) {
        return f32::INFINITY;
    }
    let soft = least_soft_irradiance(&light.global);
    let mut share = 0.0f32;
    for (hard, soft) in hard.into_iter().zip(soft).filter(|(hard, _)| *hard > 0.0) {
        share = share.max(if soft > 0.0 { hard / (hard + soft) } else { 1.0 });
    }
    share
}

/// What all soft shadows of spheres together can take of the light on real surfaces: by the solid angle that the spheres
/// subtend anywhere on them, or by the soft light's share there, whichever is less; at most 1.
///
/// A sphere of radius r whose centre is d away blocks at most sin^2 = r^2/d^2 of what falls on a surface from everywhere
/// alike, and the brightest soft light stands for all of it. `spheres`: where they are; `None`: anywhere. The rung `directions` widens every sphere by half the distance of
/// its directions, so that it has no such bound.
pub fn soft_share(scene: &Scene, light: &Lights, rung: Rung, spheres: Option<&[BlockerSphere]>) -> f32 {
    // Products of truncated series overshoot the product of their bounds: at order 6 by less than this.
    const OVERSHOOT: f32 = 4.0;
    let most = most_soft_radiance(&light.global);
    if most == [0.0; 3] {
        return 0.0;
    }
    let solid = match spheres {
        Some(spheres) if rung != Rung::Directions => solid_angle_share(scene, spheres).min(1.0),
        _ => 1.0,
    };
    // Irradiance of the brightest soft light from everywhere, over the light that there is.
    let share = |whole: [f32; 3]| {
        let mut contrast = 0.0f32;
        for (most, whole) in most.into_iter().zip(whole).filter(|(most, _)| *most > 0.0) {
            contrast = contrast.max(if whole > 0.0 { PI * most / whole } else { f32::INFINITY });
        }
        (OVERSHOOT * solid * contrast).min(1.0)
    };
    // If not even all hard light together makes it faint there is no need to look at every surface.
    let mut brightest = most.map(|most| PI * most);
    for (_, e) in shining(light) {
        brightest.iter_mut().zip(e).for_each(|(sum, e)| *sum += e);
    }
    if share(brightest) > super::LARGEST_ERROR {
        return 1.0;
    }
    share(least_whole_irradiance(scene, light))
}

/// The least irradiance, with nothing in the way, on the surfaces that receive shadows, seen from their front.
fn least_whole_irradiance(scene: &Scene, light: &Lights) -> [f32; 3] {
    let mut least = least_soft_irradiance(&light.global);
    let receivers = || scene.surfaces.iter().filter(|s| s.receives_shadow).map(|s| &s.mesh);
    if receivers().any(|mesh| mesh.normals.len() < mesh.positions.len()) {
        return least;
    }
    for (to_light, e) in shining(light) {
        // Between the corners of a triangle the cosine is no less than at the least of them.
        let cosines = receivers().flat_map(|mesh| &mesh.normals).map(|n| n.dot(to_light));
        let cosine = cosines.fold(1.0, f32::min).max(0.0);
        least.iter_mut().zip(e).for_each(|(sum, e)| *sum += cosine * e);
    }
    least
}

/// Sum over all spheres of r^2/d^2, d the least distance of the centre to the plane of any receiving triangle.
fn solid_angle_share(scene: &Scene, spheres: &[BlockerSphere]) -> f32 {
    let triangles: usize =
        scene.surfaces.iter().filter(|s| s.receives_shadow).map(|s| s.mesh.triangles.len()).sum();
    if spheres.len() * triangles > MOST_PAIRS {
        return f32::INFINITY;
    }
    let mut share = 0.0;
    for sphere in spheres {
        let mut nearest_m = f32::INFINITY;
        for mesh in scene.surfaces.iter().filter(|s| s.receives_shadow).map(|s| &s.mesh) {
            for t in &mesh.triangles {
                let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.positions.get(i as usize)) else { continue };
                let normal = (*b - *a).cross(*c - *a).normalize_or_zero();
                nearest_m = nearest_m.min(normal.dot(sphere.centre_world - *a).abs());
            }
        }
        share += (sphere.radius_m / nearest_m).powi(2);
    }
    if share.is_finite() { share } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh::{MAX_COEFFICIENTS, basis};

    /// Some light of an order, with numbers that follow no pattern.
    fn light(order: usize, seed: u32) -> RadianceSh {
        let mut light = RadianceSh::zero(order);
        let mut dice = crate::math::dice::Dice::new(u64::from(seed));
        for row in light.rgb.iter_mut().take(order * order) {
            *row = [(); 3].map(|()| 2.0 * dice.unit_f32() - 1.0);
        }
        light
    }

    #[test]
    fn no_direction_is_beyond_the_bounds() {
        let mut nearest = f32::INFINITY;
        for (order, seed) in [(1, 1), (2, 2), (3, 3), (4, 4), (6, 5)] {
            let light = light(order, seed);
            let (least, most) = (least_soft_irradiance(&light), most_soft_radiance(&light));
            let mut lambert = [0.0f64; MAX_ORDER];
            zonal::lambert(order, &mut lambert);
            for k in 0..2000 {
                let z = 1.0 - 2.0 * (k as f32 + 0.5) / 2000.0;
                let (s, c) = (2.4 * k as f32).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let mut y = [0.0f32; MAX_COEFFICIENTS];
                basis::evaluate(order, [across * c, across * s, z], &mut y);
                let (mut radiance, mut irradiance) = ([0.0f32; 3], [0.0f32; 3]);
                for (i, (row, y)) in light.rows().iter().zip(y).enumerate() {
                    let l = i.isqrt();
                    let of_band =
                        (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt() as f32 * lambert[l] as f32;
                    for c in 0..3 {
                        radiance[c] += row[c] * y;
                        irradiance[c] += PI * of_band * row[c] * y;
                    }
                }
                for c in 0..3 {
                    assert!(radiance[c].abs() <= most[c] * 1.0001, "{order} {k}");
                    assert!(irradiance[c] >= least[c] - 1e-4, "{order} {k}");
                    if order == 2 {
                        nearest = nearest.min(irradiance[c] - least[c]);
                    }
                }
            }
        }
        // With two bands the bound is met in one direction: no looser than it has to be.
        assert!(nearest < 0.01, "{nearest}");
    }

    #[test]
    fn shares_follow_the_light() {
        let scene = Scene::default();
        let with = |e: f32| {
            let mut lights = Lights::soft(RadianceSh::zero(4));
            lights.global.rgb[0] = [(4.0 * PI).sqrt() / PI; 3];
            let to_light_world = [0.0, 0.0, 1.0];
            lights.hard.push(crate::model::light::HardLight {
                to_light_world,
                irradiance_rgb: [e; 3],
                extent_rad: 0.0,
            });
            lights
        };
        // Soft irradiance 1 on every normal.
        for e in [0.0f32, 1e-3, 1.0, 99.0] {
            let share = hard_share(&scene, &with(e));
            assert!((share - e / (1.0 + e)).abs() < 1e-5, "{e}: {share}");
        }
        let mut dark = with(1.0);
        dark.global.rgb[0] = [0.0; 3];
        assert_eq!((hard_share(&scene, &dark), soft_share(&scene, &dark, Rung::Chain, None)), (1.0, 0.0));
        let nan = with(f32::NAN);
        assert_eq!(hard_share(&scene, &nan), 0.0);
        assert_eq!(soft_share(&scene, &with(1.0), Rung::Directions, None), 1.0);
    }
}
