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
/// Lambert and the matt part of Phong: `albedo (E_d max(0, n.w_d) / pi V + openness irradiance(n) / pi)`.
/// Glossy lobe around r, the reflection of the view: `specular (E_d (s+1)/(2 pi) max(0, r.w_d)^s V [n.w_d > 0]
/// + openness sum_lm lobe_l L_g,lm y_lm(r))`. Mirror: `reflectance max(0, sum_lm L_lm y_lm(r))`, a smooth stand-in
/// until mirrors see the picture of the environment. Only the final shade is clamped at 0, never L_g.
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
