//! Light onto virtual objects: E_d f+ from the directional half, the zonal lobe of the same f+ over the soft
//! half (Eq. 16, 19 of [Now11] as corrected in Section 5 of the spec: one convention for both).
//! Twin: `shaders/compose/shade_object.wgsl`.

use super::geometry::{MIRROR_EXPONENT, MaterialTerms};
use crate::math::sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, zonal};
use crate::model::light::SplitLight;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};

/// The light of a frame, ready to shade with. One uniform block on the GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightTerms {
    /// Unit vector towards the directional light (world frame); zero where there is none.
    pub to_light_world: [f32; 3],
    /// E_d, not negative; zero where there is no directional light.
    pub direct_rgb: [f32; 3],
    /// Order n of the tables below.
    pub order: usize,
    /// What a white matt surface of normal n radiates under the soft half: sum of `soft_rgb[i] * y_i(n)`
    /// = irradiance / pi; row i = sqrt(4 pi / (2 l + 1)) z_l L_g,i with z of Lambert.
    pub soft_rgb: [[f32; 3]; MAX_COEFFICIENTS],
    /// L_g itself, for glossy lobes.
    pub global_rgb: [[f32; 3]; MAX_COEFFICIENTS],
    /// L = L_g + E_d y(w_d), for mirrors.
    pub total_rgb: [[f32; 3]; MAX_COEFFICIENTS],
}

impl LightTerms {
    /// Of split light. Coefficients and irradiance that are not finite count as 0.
    pub fn of(light: &SplitLight) -> Self {
        let order = light.global.order.clamp(1, MAX_ORDER);
        let count = order * order;
        let mut lambert = [0.0f64; MAX_ORDER];
        zonal::lambert(order, &mut lambert);
        let mut terms = Self {
            to_light_world: [0.0; 3],
            direct_rgb: [0.0; 3],
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
        let direction = light.direct.map_or(Vec3::ZERO, |d| Vec3::from(d.to_light_world).normalize_or_zero());
        if let Some(direct) = light.direct
            && direction != Vec3::ZERO
        {
            terms.to_light_world = direction.to_array();
            terms.direct_rgb = direct.irradiance_rgb.map(|e| finite(e).max(0.0));
            let mut y = [0.0f32; MAX_COEFFICIENTS];
            basis::evaluate(order, terms.to_light_world, &mut y);
            for (row, y) in terms.total_rgb.iter_mut().zip(y).take(count) {
                for (c, e) in row.iter_mut().zip(terms.direct_rgb) {
                    *c += e * y;
                }
            }
        }
        terms
    }

    /// Whether a directional light shines at all.
    pub fn has_direct(&self) -> bool {
        self.direct_rgb.iter().any(|&e| e > 0.0)
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
    /// Share of the directional light that reaches it, 0 to 1.
    pub visibility: f32,
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

/// irradiance / pi of the soft half on normal n: what a white matt surface radiates. May be negative.
pub fn soft_over_pi(light: &LightTerms, normal: Vec3) -> [f32; 3] {
    lobe_sum(light.order, &light.soft_rgb, &[1.0; MAX_ORDER], normal)
}

/// Radiance, linear RGB, finite and not negative, that leaves a point towards the camera.
///
/// * Lambert and the matt part of Phong: albedo (E_d max(0, n.w_d) / pi V + openness irradiance(n) / pi).
/// * Glossy lobe around r, the view reflected at n: specular (E_d (s+1)/(2 pi) max(0, r.w_d)^s V where
///   n.w_d > 0, and openness times the sum of lobe_l L_g,lm y_lm(r)).
/// * Mirror: reflectance times the sum of L_lm y_lm(r), a smooth stand-in until mirrors see the picture of
///   the environment.
///
/// Only the final shade is clamped at 0, never L_g.
pub fn shade(light: &LightTerms, material: &MaterialTerms, point: &ObjectPoint) -> [f32; 3] {
    let n = point.normal;
    let r = 2.0 * n.dot(point.to_eye) * n - point.to_eye;
    if material.exponent == MIRROR_EXPONENT {
        let seen = lobe_sum(light.order, &light.total_rgb, &material.lobe, r);
        return std::array::from_fn(|c| (material.specular_rgb[c] * seen[c]).max(0.0));
    }
    let w = Vec3::from(light.to_light_world);
    let cosine = n.dot(w).max(0.0);
    let openness = point.tint_openness[3];
    let soft = soft_over_pi(light, n);
    let mut out: [f32; 3] = std::array::from_fn(|c| {
        let albedo = material.albedo_rgb[c] * point.tint_openness[c];
        albedo * (light.direct_rgb[c] * cosine * FRAC_1_PI * point.visibility + openness * soft[c])
    });
    if material.specular_rgb != [0.0; 3] {
        let glossy = lobe_sum(light.order, &light.global_rgb, &material.lobe, r);
        // 0^0 is 1: the cosine decides before the power.
        let along = r.dot(w);
        let direct = if along > 0.0 && cosine > 0.0 {
            (material.exponent + 1.0) / TAU * along.min(1.0).powf(material.exponent) * point.visibility
        } else {
            0.0
        };
        for c in 0..3 {
            out[c] += material.specular_rgb[c] * (light.direct_rgb[c] * direct + openness * glossy[c]);
        }
    }
    out.map(|c| c.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::light::{DirectionalLight, RadianceSh};
    use crate::model::scene::Material;
    use proptest::prelude::*;

    const MATERIALS: [Material; 4] = [
        Material::Lambert { albedo_rgb: [1.0, 0.5, 0.25] },
        Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0, 0.5, 0.25], exponent: 12.0 },
        Material::Phong { albedo_rgb: [0.3; 3], specular_rgb: [0.4; 3], exponent: 0.0 },
        Material::Mirror { reflectance_rgb: [1.0, 0.5, 0.25] },
    ];

    fn point(normal: Vec3, to_eye: Vec3, visibility: f32) -> ObjectPoint {
        ObjectPoint { normal, to_eye, tint_openness: [1.0; 4], visibility }
    }

    #[test]
    fn a_white_furnace_stays_white() {
        for order in 1..=6 {
            let mut global = RadianceSh::zero(order);
            global.rgb[0] = [2.0 * (4.0 * std::f32::consts::PI).sqrt(); 3];
            let light = LightTerms::of(&SplitLight { direct: None, global });
            for material in [&MATERIALS[0], &MATERIALS[1], &MATERIALS[3]] {
                let out = shade(&light, &MaterialTerms::of(material), &point(Vec3::Y, Vec3::Y, 1.0));
                for (c, expected) in out.iter().zip([2.0, 1.0, 0.5]) {
                    assert!((c - expected).abs() < 1e-5, "order {order}, {material:?}: {out:?}");
                }
            }
        }
    }

    #[test]
    fn the_sun_alone_follows_the_closed_forms() {
        let w = Vec3::new(0.48, 0.6, 0.64);
        let direct =
            DirectionalLight { to_light_world: w.to_array(), irradiance_rgb: [3.0, 2.0, 1.0], fade: 1.0 };
        let light = LightTerms::of(&SplitLight { direct: Some(direct), global: RadianceSh::zero(4) });
        let n = Vec3::new(0.0, 0.6, 0.8);
        let cosine = n.dot(w);
        let half = shade(&light, &MaterialTerms::of(&MATERIALS[0]), &point(n, n, 0.5));
        for (c, e) in half.iter().zip([3.0, 1.0, 0.25]) {
            assert!((c - e * cosine * FRAC_1_PI * 0.5).abs() < 1e-6, "{half:?}");
        }
        // Phong: the view mirrored at n.
        let eye = Vec3::new(0.1, -0.2, 0.9).normalize();
        let r = 2.0 * n.dot(eye) * n - eye;
        let glossy = shade(&light, &MaterialTerms::of(&MATERIALS[1]), &point(n, eye, 1.0));
        let lobe = 13.0 / TAU * r.dot(w).powi(12);
        for (c, e) in glossy.iter().zip([3.0, 1.0, 0.25]) {
            assert!((c - e * lobe).abs() < 1e-5 * e, "{glossy:?}, {lobe}");
        }
        // Turned away from the sun: nothing, whatever the reflection sees.
        let away = shade(&light, &MaterialTerms::of(&MATERIALS[1]), &point(-w, -w, 1.0));
        assert_eq!(away, [0.0; 3]);
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
        let light = LightTerms::of(&SplitLight { direct: None, global });
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
            let direct = DirectionalLight { to_light_world: w, irradiance_rgb: [3.0, f32::INFINITY, -1.0], fade: 1.0 };
            let light = LightTerms::of(&SplitLight { direct: Some(direct), global });
            let n = Vec3::from(n).normalize_or(Vec3::Z);
            let eye = Vec3::from(eye).normalize_or(Vec3::Z);
            let glossy = Material::Phong { albedo_rgb: [0.4; 3], specular_rgb: [0.5; 3], exponent };
            for material in MATERIALS.iter().chain([&glossy]) {
                let out = shade(&light, &MaterialTerms::of(material), &point(n, eye, visibility));
                prop_assert!(out.iter().all(|c| c.is_finite() && *c >= 0.0), "{:?}: {:?}", material, out);
            }
            let ratio = super::super::shade_surface::ratio(&light, n, visibility);
            prop_assert!(ratio.iter().all(|c| (0.0..=1.0).contains(c)), "{:?}", ratio);
            prop_assert_eq!(super::super::shade_surface::ratio(&light, n, 1.0), [1.0; 3]);
        }
    }
}
