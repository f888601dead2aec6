//! Light onto virtual objects: E_d f+ from the directional half, the zonal lobe of the same f+ over the soft
//! half (Eq. 16, 19 of [Now11] as corrected in Section 5 of the spec: one convention for both).
//! Twin: `shaders/compose/shade_object.wgsl`.

use super::geometry::{MIRROR_EXPONENT, MaterialTerms};
use crate::math::sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, zonal};
use crate::model::light::{HardLight, HardLights, Lights};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};

/// The light of a frame, ready to shade with. One uniform block on the GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightTerms {
    /// The hard lights that shine: unit directions, finite irradiance.
    pub hard: HardLights,
    /// Order n of the tables below.
    pub order: usize,
    /// What a white matt surface of normal n radiates under the soft half: sum of `soft_rgb[i] * y_i(n)`
    /// = irradiance / pi; row i = sqrt(4 pi / (2 l + 1)) z_l L_g,i with z of Lambert.
    pub soft_rgb: [[f32; 3]; MAX_COEFFICIENTS],
    /// L_g itself, for glossy lobes.
    pub global_rgb: [[f32; 3]; MAX_COEFFICIENTS],
    /// L = L_g + sum of E_k y(w_k) over the hard lights, for mirrors.
    pub total_rgb: [[f32; 3]; MAX_COEFFICIENTS],
}

impl LightTerms {
    /// Of light in its two halves. Coefficients and irradiance that are not finite count as 0; hard lights without
    /// power or direction are left out.
    pub fn of(light: &Lights) -> Self {
        let order = light.global.order.clamp(1, MAX_ORDER);
        let count = order * order;
        let mut lambert = [0.0f64; MAX_ORDER];
        zonal::lambert(order, &mut lambert);
        let mut terms = Self {
            hard: HardLights::none(),
            order,
            soft_rgb: [[0.0; 3]; MAX_COEFFICIENTS],
            global_rgb: [[0.0; 3]; MAX_COEFFICIENTS],
            total_rgb: [[0.0; 3]; MAX_COEFFICIENTS],
        };
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        for i in 0..count {
            let l = i.isqrt();
            let factor = ((4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt() * lambert[l]) as f32;
            terms.global_rgb[i] = light.global.rgb[i].map(finite);
            terms.soft_rgb[i] = terms.global_rgb[i].map(|c| factor * c);
        }
        terms.total_rgb = terms.global_rgb;
        for hard in light.hard.as_slice() {
            let direction = Vec3::from(hard.to_light_world).normalize_or_zero();
            let irradiance_rgb = hard.irradiance_rgb.map(|e| finite(e).max(0.0));
            if direction == Vec3::ZERO || irradiance_rgb == [0.0; 3] {
                continue;
            }
            let to_light_world = direction.to_array();
            let extent_rad = finite(hard.extent_rad).max(0.0);
            terms.hard.push(HardLight { to_light_world, irradiance_rgb, extent_rad });
            let mut y = [0.0f32; MAX_COEFFICIENTS];
            basis::evaluate(order, to_light_world, &mut y);
            for (row, y) in terms.total_rgb.iter_mut().zip(y).take(count) {
                for (c, e) in row.iter_mut().zip(irradiance_rgb) {
                    *c += e * y;
                }
            }
        }
        terms
    }

    /// The hard lights.
    pub fn hard(&self) -> &[HardLight] {
        self.hard.as_slice()
    }
}

/// A point to shade.
#[derive(Clone, Copy, Debug)]
pub struct ObjectPoint {
    /// Unit shading normal on the seen side, world frame.
    pub normal: Vec3,
    /// Unit vector towards the camera, world frame.
    pub to_eye: Vec3,
    /// Tint (r, g, b) of the albedo and openness (a), interpolated.
    pub tint_openness: [f32; 4],
}

/// Sum of rows * y(direction), bands weighted by `bands`.
fn lobe_sum(
    order: usize,
    rows: &[[f32; 3]; MAX_COEFFICIENTS],
    bands: &[f32; MAX_ORDER],
    direction: Vec3,
) -> [f32; 3] {
    let mut y = [0.0f32; MAX_COEFFICIENTS];
    basis::evaluate(order, direction.to_array(), &mut y);
    let mut sum = [0.0f32; 3];
    for (l, band) in bands.iter().enumerate().take(order) {
        for i in l * l..(l + 1) * (l + 1) {
            for (s, c) in sum.iter_mut().zip(rows[i]) {
                *s += band * c * y[i];
            }
        }
    }
    sum
}

/// Irradiance of all hard lights on normal n where nothing is in their way.
pub fn unshadowed(light: &LightTerms, normal: Vec3) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    for hard in light.hard() {
        let cosine = normal.dot(Vec3::from(hard.to_light_world)).max(0.0);
        for (s, e) in sum.iter_mut().zip(hard.irradiance_rgb) {
            *s += e * cosine;
        }
    }
    sum
}

/// irradiance / pi of the soft half on normal n: what a white matt surface radiates. May be negative.
pub fn soft_over_pi(light: &LightTerms, normal: Vec3) -> [f32; 3] {
    lobe_sum(light.order, &light.soft_rgb, &[1.0; MAX_ORDER], normal)
}

/// Radiance, linear RGB, finite and not negative, that leaves a point towards the camera.
///
/// `visibility(k)` is the share of hard light k that reaches the point, 0 to 1; it is asked only for lights that the
/// normal faces. Each hard light adds its own E_k, w_k, V_k:
///
/// * Lambert and the matt part of Phong: albedo (sum of E_k max(0, n.w_k) / pi V_k + openness irradiance(n) / pi).
/// * Glossy lobe around r, the view reflected at n: specular (sum of E_k (s+1)/(2 pi) max(0, r.w_k)^s V_k where
///   n.w_k > 0, and openness times the sum of lobe_l L_g,lm y_lm(r)).
/// * Mirror: reflectance times the sum of L_lm y_lm(r), a smooth stand-in until mirrors see the picture of
///   the environment.
///
/// Only the final shade is clamped at 0, never L_g.
pub fn shade(
    light: &LightTerms,
    material: &MaterialTerms,
    point: &ObjectPoint,
    visibility: impl Fn(usize) -> f32,
) -> [f32; 3] {
    let n = point.normal;
    let r = 2.0 * n.dot(point.to_eye) * n - point.to_eye;
    if material.exponent == MIRROR_EXPONENT {
        let seen = lobe_sum(light.order, &light.total_rgb, &material.lobe, r);
        return std::array::from_fn(|c| (material.specular_rgb[c] * seen[c]).max(0.0));
    }
    let is_glossy = material.specular_rgb != [0.0; 3];
    let (mut matt, mut shine) = ([0.0f32; 3], [0.0f32; 3]);
    for (k, hard) in light.hard().iter().enumerate() {
        let w = Vec3::from(hard.to_light_world);
        let cosine = n.dot(w);
        // 0^0 is 1: the cosines decide before the power.
        if cosine <= 0.0 {
            continue;
        }
        let visible = visibility(k);
        let along = r.dot(w);
        let lobe = if is_glossy && along > 0.0 {
            (material.exponent + 1.0) / TAU * along.min(1.0).powf(material.exponent) * visible
        } else {
            0.0
        };
        for c in 0..3 {
            matt[c] += hard.irradiance_rgb[c] * cosine * FRAC_1_PI * visible;
            shine[c] += hard.irradiance_rgb[c] * lobe;
        }
    }
    let openness = point.tint_openness[3];
    let soft = soft_over_pi(light, n);
    let mut out: [f32; 3] = std::array::from_fn(|c| {
        let albedo = material.albedo_rgb[c] * point.tint_openness[c];
        albedo * (matt[c] + openness * soft[c])
    });
    if is_glossy {
        let glossy = lobe_sum(light.order, &light.global_rgb, &material.lobe, r);
        for c in 0..3 {
            out[c] += material.specular_rgb[c] * (shine[c] + openness * glossy[c]);
        }
    }
    out.map(|c| c.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::light::RadianceSh;
    use crate::model::scene::Material;
    use proptest::prelude::*;

    const MATERIALS: [Material; 4] = [
        Material::Lambert { albedo_rgb: [1.0, 0.5, 0.25] },
        Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0, 0.5, 0.25], exponent: 12.0 },
        Material::Phong { albedo_rgb: [0.3; 3], specular_rgb: [0.4; 3], exponent: 0.0 },
        Material::Mirror { reflectance_rgb: [1.0, 0.5, 0.25] },
    ];

    fn point(normal: Vec3, to_eye: Vec3) -> ObjectPoint {
        ObjectPoint { normal, to_eye, tint_openness: [1.0; 4] }
    }

    fn sun(to_light_world: Vec3, irradiance_rgb: [f32; 3], global: RadianceSh) -> LightTerms {
        let mut lights = Lights::soft(global);
        lights.hard.push(HardLight {
            to_light_world: to_light_world.to_array(),
            irradiance_rgb,
            extent_rad: 0.0,
        });
        LightTerms::of(&lights)
    }

    #[test]
    fn a_white_furnace_stays_white() {
        for order in 1..=6 {
            let mut global = RadianceSh::zero(order);
            global.rgb[0] = [2.0 * (4.0 * std::f32::consts::PI).sqrt(); 3];
            let light = LightTerms::of(&Lights::soft(global));
            for material in [&MATERIALS[0], &MATERIALS[1], &MATERIALS[3]] {
                let out = shade(&light, &MaterialTerms::of(material), &point(Vec3::Y, Vec3::Y), |_| 1.0);
                for (c, expected) in out.iter().zip([2.0, 1.0, 0.5]) {
                    assert!((c - expected).abs() < 1e-5, "order {order}, {material:?}: {out:?}");
                }
            }
        }
    }

    #[test]
    fn the_sun_alone_follows_the_closed_forms() {
        let w = Vec3::new(0.48, 0.6, 0.64);
        let light = sun(w, [3.0, 2.0, 1.0], RadianceSh::zero(4));
        let n = Vec3::new(0.0, 0.6, 0.8);
        let cosine = n.dot(w);
        let half = shade(&light, &MaterialTerms::of(&MATERIALS[0]), &point(n, n), |_| 0.5);
        for (c, e) in half.iter().zip([3.0, 1.0, 0.25]) {
            assert!((c - e * cosine * FRAC_1_PI * 0.5).abs() < 1e-6, "{half:?}");
        }
        // Phong: the view mirrored at n.
        let eye = Vec3::new(0.1, -0.2, 0.9).normalize();
        let r = 2.0 * n.dot(eye) * n - eye;
        let glossy = shade(&light, &MaterialTerms::of(&MATERIALS[1]), &point(n, eye), |_| 1.0);
        let lobe = 13.0 / TAU * r.dot(w).powi(12);
        for (c, e) in glossy.iter().zip([3.0, 1.0, 0.25]) {
            assert!((c - e * lobe).abs() < 1e-5 * e, "{glossy:?}, {lobe}");
        }
        // Turned away from the sun: nothing, whatever the reflection sees.
        let away = shade(&light, &MaterialTerms::of(&MATERIALS[1]), &point(-w, -w), |_| 1.0);
        assert_eq!(away, [0.0; 3]);
    }

    #[test]
    fn every_hard_light_adds_its_own() {
        let mut lights = Lights::soft(RadianceSh::zero(3));
        let (one, two) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.28, 0.0, 0.96));
        for (w, e) in [(one, [3.0, 0.0, 1.0]), (two, [0.0, 2.0, 1.0]), (Vec3::NEG_Z, [9.0; 3])] {
            lights.hard.push(HardLight { to_light_world: w.to_array(), irradiance_rgb: e, extent_rad: 0.0 });
        }
        let light = LightTerms::of(&lights);
        let seen = shade(&light, &MaterialTerms::of(&MATERIALS[0]), &point(Vec3::Z, Vec3::Z), |k| {
            assert!(k < 2, "asked for a light behind the surface");
            [1.0, 0.5][k]
        });
        let want = [3.0 * 0.8, 0.5 * 2.0 * 0.96 * 0.5, 0.25 * (0.8 + 0.96 * 0.5)];
        for (got, want) in seen.iter().zip(want) {
            assert!((got - want * FRAC_1_PI).abs() < 1e-6, "{seen:?}");
        }
        let all = unshadowed(&light, Vec3::Z);
        assert!((all[2] - (0.8 + 0.96)).abs() < 1e-6 && all[0] < 2.41, "{all:?}");
    }

    #[test]
    fn the_sky_over_the_ground_lights_by_the_clamped_cosine() {
        // A uniform upper hemisphere, order 6: E / pi = (1 + cos) / 2 up to the truncation of band 6 and up,
        // which the odd bands of the hemisphere do not meet: exact.
        let mut global = RadianceSh::zero(6);
        let mut sums = [0.0f64; MAX_COEFFICIENTS];
        let steps = 20_000;
        for k in 0..steps {
            let z = (f64::from(k) + 0.5) / f64::from(steps);
            let mut y = [0.0f64; MAX_COEFFICIENTS];
            basis::evaluate(6, [(1.0 - z * z).sqrt(), 0.0, z], &mut y);
            for l in 0..6 {
                let i = l * (l + 1);
                sums[i] += y[i] * 2.0 * std::f64::consts::PI / f64::from(steps);
            }
        }
        for (row, sum) in global.rgb.iter_mut().zip(sums) {
            *row = [sum as f32; 3];
        }
        let light = LightTerms::of(&Lights::soft(global));
        for k in 0..=20 {
            let z = -1.0 + 0.1 * k as f32;
            let n = Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
            let seen = soft_over_pi(&light, n)[1];
            assert!((seen - 0.5 * (1.0 + z)).abs() < 1e-6, "{z}: {seen}");
        }
    }

    proptest! {
        #[test]
        fn never_negative_never_not_a_number(
            coefficients in prop::collection::vec(-50.0f32..50.0, 108),
            order in 1usize..=6,
            n in prop::array::uniform3(-1.0f32..1.0),
            w in prop::array::uniform3(-1.0f32..1.0),
            eye in prop::array::uniform3(-1.0f32..1.0),
            exponent in 0.0f32..1e4,
            visibility in 0.0f32..=1.0,
        ) {
            let mut global = RadianceSh::zero(order);
            for (row, c) in global.rgb.iter_mut().zip(coefficients.chunks(3)).take(order * order) {
                row.copy_from_slice(c);
            }
            global.rgb[0][0] = f32::NAN;
            let light = sun(Vec3::from(w), [3.0, f32::INFINITY, -1.0], global);
            let n = Vec3::from(n).normalize_or(Vec3::Z);
            let eye = Vec3::from(eye).normalize_or(Vec3::Z);
            let glossy = Material::Phong { albedo_rgb: [0.4; 3], specular_rgb: [0.5; 3], exponent };
            for material in MATERIALS.iter().chain([&glossy]) {
                let out = shade(&light, &MaterialTerms::of(material), &point(n, eye), |_| visibility);
                prop_assert!(out.iter().all(|c| c.is_finite() && *c >= 0.0), "{:?}: {:?}", material, out);
            }
            let blocked = unshadowed(&light, n).map(|e| e * (1.0 - visibility));
            let ratio = super::super::shade_surface::ratio(&light, n, blocked);
            prop_assert!(ratio.iter().all(|c| (0.0..=1.0).contains(c)), "{:?}", ratio);
            prop_assert_eq!(super::super::shade_surface::ratio(&light, n, [0.0; 3]), [1.0; 3]);
        }
    }
}
