//! Light onto virtual objects: E_d f+ from the directional half, the zonal lobe of the same f+ over the soft
//! half (Eq. 16, 19 of [Now11] as corrected in Section 5 of the spec: one convention for both).
//! Twin: `shaders/compose/shade_object.wgsl`.

use super::geometry::{MIRROR_EXPONENT, MaterialTerms};
use super::reflected::Reflected;
use crate::math::sh::{
    MAX_COEFFICIENTS, MAX_ORDER, basis,
    zonal::{self, PhongNorm},
};
use crate::model::environment::EnvironmentPicture;
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

    /// In the order of their maps.
    pub fn hard(&self) -> &[HardLight] {
        self.hard.as_slice()
    }
}

/// What objects are shaded with besides the light.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// What mirrors and sharp gloss see; `None`: SH stands in.
    pub picture: Option<&'a EnvironmentPicture>,
    /// What mirrors see besides.
    pub reflected: &'a Reflected,
    /// How Phong lobes are scaled.
    pub norm: PhongNorm,
    /// Lobes of a larger exponent are read from the picture's levels, where it has any.
    pub sharp_above: f32,
}

impl<'a> Surroundings<'a> {
    /// For light of an SH order.
    pub fn new(
        picture: Option<&'a EnvironmentPicture>,
        reflected: &'a Reflected,
        norm: PhongNorm,
        order: usize,
    ) -> Self {
        let picture = picture.filter(|p| !p.all.texels().is_empty());
        Self { picture, reflected, norm, sharp_above: zonal::phong_saturation(order) }
    }

    /// The picture whose levels a lobe is read from.
    fn levels(&self, exponent: f32) -> Option<&'a EnvironmentPicture> {
        self.picture.filter(|_| self.is_sharp(exponent))
    }

    /// Whether there are levels for sharp lobes.
    pub fn has_levels(&self) -> bool {
        self.picture.is_some_and(|p| !p.glossy.is_empty())
    }

    /// Whether a lobe is read from the levels.
    pub fn is_sharp(&self, exponent: f32) -> bool {
        self.has_levels() && exponent > self.sharp_above
    }
}

/// A point to shade.
#[derive(Clone, Copy, Debug)]
pub struct ObjectPoint {
    /// World frame, metres.
    pub position_world: Vec3,
    /// Unit shading normal on the seen side, world frame.
    pub normal: Vec3,
    /// Unit vector towards the camera, world frame.
    pub to_eye: Vec3,
    /// Tint (r, g, b) of the albedo and openness (a), interpolated.
    pub tint_openness: [f32; 4],
    /// Soft light on what is matt (`Transferred::soft`), interpolated: what a white surface radiates, its own shadow
    /// counted, and 1; or what is taken of openness times what it would radiate, and 0.
    pub soft: [f32; 4],
    /// Share of the soft light of the glossy lobe that is left (`Transferred::gloss`), each channel, interpolated.
    pub gloss: [f32; 3],
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
/// `visibility(k, point, cosine)` is the share of hard light k that reaches a point (world frame) of normal n, 0 to 1,
/// where n.w_k = cosine; it is asked only for lights that the normal faces. Each hard light adds its own E_k, w_k, V_k:
///
/// * Lambert and the matt part of Phong: albedo (sum of E_k max(0, n.w_k) / pi V_k + soft), soft being the point's
///   transfer or else openness irradiance(n) / pi, less what other bodies take.
/// * Glossy lobe around r, the view reflected at n: specular (sum of E_k (s+1)/(2 pi) max(0, r.w_k)^s V_k where
///   n.w_k > 0, and the sum of lobe_l L_g,lm y_lm(r) times what is left of it (by Eq. 19 of [Now11], or the openness)); with the paper's norm s+2 in place of s+1 in both. A lobe that SH of the light's order is too
///   smooth for is read from the prefiltered picture of what the hard lights leave, times V~, where there is one.
/// * Mirror: reflectance times what is seen along r (`Reflected`); the light is in it, nothing is added. Without a
///   picture the sum of L_lm y_lm(r), a smooth stand-in.
///
/// Only the final shade is clamped at 0, never L_g.
pub fn shade(
    light: &LightTerms,
    surroundings: &Surroundings<'_>,
    material: &MaterialTerms,
    point: &ObjectPoint,
    visibility: impl Fn(usize, Vec3, f32) -> f32,
) -> [f32; 3] {
    let n = point.normal;
    let r = 2.0 * n.dot(point.to_eye) * n - point.to_eye;
    if material.exponent == MIRROR_EXPONENT {
        let seen = match surroundings.picture {
            Some(picture) => surroundings.reflected.seen(
                light,
                picture,
                point.position_world,
                r,
                material.body,
                visibility,
            ),
            None => lobe_sum(light.order, &light.total_rgb, &material.lobe, r),
        };
        return std::array::from_fn(|c| radiance(material.specular_rgb[c] * seen[c]));
    }
    let levels = surroundings.levels(material.exponent);
    let shines = levels.is_none_or(|p| !p.holds_hard_lights);
    let is_glossy = material.specular_rgb != [0.0; 3];
    let (mut matt, mut shine) = ([0.0f32; 3], [0.0f32; 3]);
    for (k, hard) in light.hard().iter().enumerate() {
        let w = Vec3::from(hard.to_light_world);
        let cosine = n.dot(w);
        // 0^0 is 1: the cosines decide before the power.
        if cosine <= 0.0 {
            continue;
        }
        let visible = visibility(k, point.position_world, cosine);
        let along = r.dot(w);
        let lobe = if is_glossy && shines && along > 0.0 {
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
    let [r_soft, g_soft, b_soft, is_transferred] = point.soft;
    let mut soft = [r_soft, g_soft, b_soft];
    // All corners of a triangle have transfer, or none.
    if is_transferred <= 0.5 {
        let whole = soft_over_pi(light, n);
        soft = std::array::from_fn(|c| openness * whole[c] - soft[c]);
    }
    let mut out: [f32; 3] = std::array::from_fn(|c| {
        let albedo = material.albedo_rgb[c] * point.tint_openness[c];
        albedo * (matt[c] + soft[c])
    });
    if is_glossy {
        let glossy = match levels {
            Some(picture) => picture.gloss(material.exponent, r),
            None => lobe_sum(light.order, &light.global_rgb, &material.lobe, r),
        };
        // The terms have the energy-safe norm in both halves.
        let scale = match surroundings.norm {
            PhongNorm::EnergySafe => 1.0,
            PhongNorm::Paper => (material.exponent + 2.0) / (material.exponent + 1.0),
        };
        for c in 0..3 {
            out[c] += material.specular_rgb[c] * scale * (shine[c] + point.gloss[c] * glossy[c]);
        }
    }
    out.map(radiance)
}

/// Not below 0, and finite where a sharp lobe takes a strong light beyond 32 bits; what is not a number counts as 0.
fn radiance(sum: f32) -> f32 {
    if sum > 0.0 { sum.min(f32::MAX) } else { 0.0 }
}

#[cfg(test)]
mod tests;
