//! The light in the conventions of other programs: nine coefficients (bands 0 to 2), y up.
//!
//! All of them hold *radiance* in an orthonormal basis in the order l(l+1)+m, as we do; the convolution with the cosine
//! is theirs. They differ from us in two things: y is up, and some leave out the Condon-Shortley phase. A main light is
//! given by the direction *towards* it and by its irradiance on a surface that faces it.

use crate::model::light::{DirectionalLight, RadianceSh, SplitLight};

/// Coefficients of bands 0 to 2.
pub const ROWS: usize = 9;

/// Signs of the functions with odd m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// y_1 = 0.4886 (-y, z, -x): ours, that of the shaders published for ARCore and Android XR, and what Chromium passes
    /// on from them.
    CondonShortley,
    /// y_1 = 0.4886 (y, z, x): that of Ramamoorthi and Hanrahan, of three.js, and of the examples for WebXR.
    Plain,
}

/// A main light, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MainLight {
    /// Unit vector towards it.
    pub to_light_y_up: [f32; 3],
    /// Irradiance of a surface that faces it.
    pub irradiance_rgb: [f32; 3],
}

/// Light in nine coefficients, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YUpLight {
    /// All of the light.
    pub total_rgb: [[f32; 3]; ROWS],
    /// What is left without the main light.
    pub ambient_rgb: [[f32; 3]; ROWS],
    /// `None`: no direction dominates, and the ambient light is all.
    pub main: Option<MainLight>,
}

impl From<&DirectionalLight> for MainLight {
    fn from(light: &DirectionalLight) -> Self {
        Self {
            to_light_y_up: y_up(light.to_light_world).map(|x| x + 0.0),
            irradiance_rgb: light.irradiance_rgb,
        }
    }
}

/// A vector of the world (z up) with y up, both right-handed: (x, y, z) becomes (x, z, -y).
pub fn y_up<T: std::ops::Neg<Output = T>>([x, y, z]: [T; 3]) -> [T; 3] {
    [x, z, -y]
}

/// Bands 0 to 2 of `light` (world frame) with y up: evaluated at `y_up(w)` they give what the input gives at w. Bands
/// beyond its order are 0.
pub fn nine_y_up(light: &RadianceSh, phase: Phase) -> [[f32; 3]; ROWS] {
    // sqrt(3)/2: how 3z^2-1 and x^2-y^2 mix where axes change places.
    const MIX: f32 = 0.866_025_4;
    let mut out = [[0.0; 3]; ROWS];
    for c in 0..3 {
        // Rows with odd m lose the phase, so that row 1 stands for y, 2 for z, 3 for x, 4 for xy and so on.
        let row = |i: usize| {
            let value = if i < light.order * light.order { light.rgb[i][c] } else { 0.0 };
            if has_odd_m(i) { -value } else { value }
        };
        let turned = [
            row(0),
            row(2),
            -row(1),
            row(3),
            row(7),
            -row(5),
            -0.5 * row(6) - MIX * row(8),
            -row(4),
            -MIX * row(6) + 0.5 * row(8),
        ];
        for (i, value) in turned.into_iter().enumerate() {
            let flipped = phase == Phase::CondonShortley && has_odd_m(i);
            // The two zeros are written as one.
            out[i][c] = (if flipped { -value } else { value }) + 0.0;
        }
    }
    out
}

/// Measured light and its split with y up. `ambient` plus the main light's `E y(to_light)` is `total`.
pub fn y_up_light(total: &RadianceSh, split: &SplitLight, phase: Phase) -> YUpLight {
    YUpLight {
        total_rgb: nine_y_up(total, phase),
        ambient_rgb: nine_y_up(&split.global, phase),
        main: split.direct.as_ref().map(MainLight::from),
    }
}

/// Whether m of row l(l+1)+m is odd, for bands 0 to 2.
const fn has_odd_m(row: usize) -> bool {
    matches!(row, 1 | 3 | 5 | 7)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::split::{SplitOptions, split};
    use crate::math::{
        quadrature,
        sh::{basis, project, rotate::Rotation, zonal},
    };
    use std::f64::consts::PI;

    /// Light of radiance (1, 0.5, 0.25) from the half space around `axis` (world), 0.1 of it from the other.
    fn one_sided(axis: [f64; 3]) -> RadianceSh {
        let samples = quadrature::sphere(300).into_iter().map(|(direction, solid_angle)| {
            let along: f64 = (0..3).map(|i| direction[i] * axis[i]).sum();
            let bright = if along > 0.0 { 1.0 } else { 0.1 };
            project::Sample { direction, solid_angle, radiance: [bright, 0.5 * bright, 0.25 * bright] }
        });
        RadianceSh { order: 4, rgb: project::project(4, samples).map(|row| row.map(|c| c as f32)) }
    }

    /// Irradiance by the three bands of our own lobes, world frame.
    fn own_irradiance(light: &RadianceSh, normal: [f64; 3]) -> [f64; 3] {
        let (mut zonal, mut lobe) = ([0.0; 3], [0.0; 9]);
        zonal::lambert(3, &mut zonal);
        zonal::rotate(&zonal, normal, &mut lobe);
        std::array::from_fn(|c| PI * (0..9).map(|i| lobe[i] * f64::from(light.rgb[i][c])).sum::<f64>())
    }

    /// Irradiance as three.js computes it in its shader from nine vectors (constants as published, six digits).
    fn three_js(k: &[[f32; 3]; 9], [x, y, z]: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| {
            let k = |i: usize| f64::from(k[i][c]);
            let band1 = 2.0 * 0.511664 * (k(1) * y + k(2) * z + k(3) * x);
            let band2 = 2.0 * 0.429043 * (k(4) * x * y + k(5) * y * z + k(7) * x * z);
            let zonal = k(6) * (0.743125 * z * z - 0.247708) + k(8) * 0.429043 * (x * x - y * y);
            k(0) * 0.886227 + band1 + band2 + zonal
        })
    }

    /// Radiance that leaves a white matt surface as the shader published for ARCore computes it: factors first, then
    /// a polynomial of the normal.
    fn arcore(k: &[[f32; 3]; 9], [x, y, z]: [f64; 3]) -> [f64; 3] {
        let factors =
            [0.282095, -0.325735, 0.325735, -0.325735, 0.273137, -0.273137, 0.078848, -0.273137, 0.136569];
        let shape = [1.0, y, z, x, y * x, y * z, 3.0 * z * z - 1.0, z * x, x * x - y * y];
        std::array::from_fn(|c| (0..9).map(|i| f64::from(k[i][c]) * factors[i] * shape[i]).sum())
    }

    const AXES: [[f64; 3]; 6] = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];

    #[test]
    fn one_sided_light_comes_from_its_side_in_every_convention() {
        for axis in AXES {
            let light = one_sided(axis);
            let plain = nine_y_up(&light, Phase::Plain);
            let phased = nine_y_up(&light, Phase::CondonShortley);
            for (normal, _) in quadrature::sphere(9) {
                let own = own_irradiance(&light, normal);
                let three = three_js(&plain, y_up(normal));
                let android = arcore(&phased, y_up(normal)).map(|radiance| PI * radiance);
                for c in 0..3 {
                    // Their constants have six digits; irradiance is up to pi.
                    assert!((three[c] - own[c]).abs() < 1e-5, "{axis:?} {normal:?}: {} {}", three[c], own[c]);
                    assert!(
                        (android[c] - own[c]).abs() < 1e-5,
                        "{axis:?} {normal:?}: {} {}",
                        android[c],
                        own[c]
                    );
                }
                // The truth; three bands hold it. The border of the half space falls between nodes: 0.013.
                let cosine: f64 = (0..3).map(|i| axis[i] * normal[i]).sum();
                let truth = PI * (0.5 * (1.0 + cosine) + 0.1 * 0.5 * (1.0 - cosine));
                assert!((three[0] - truth).abs() < 0.02, "{axis:?} {normal:?}: {} {truth}", three[0]);
            }
            // A rotation by half a turn or a mirror image would pass none of this.
            let at = |d: [f64; 3]| three_js(&plain, y_up(d))[0];
            for other in AXES.into_iter().filter(|other| *other != axis) {
                assert!(at(axis) > at(other) + 0.5, "{axis:?} is not brighter than {other:?}");
            }
        }
    }

    #[test]
    fn up_is_y_and_the_turn_is_a_rotation() {
        assert_eq!(y_up([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0]);
        assert_eq!(y_up([1.0, 2.0, 3.0]), [1.0, 3.0, -2.0]);
        let mut light = RadianceSh::zero(3);
        for (i, row) in light.rgb.iter_mut().take(9).enumerate() {
            *row = [1.0 + i as f32, -2.0 + 0.7 * i as f32, (3.0 - i as f32).powi(2)];
        }
        let mut want = [[0.0; 3]; 9];
        let rotation = Rotation::new(3, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]);
        rotation.apply_rows(&light.rgb[..9], &mut want);
        let got = nine_y_up(&light, Phase::CondonShortley);
        for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
            // f32 quadrature in the rotation.
            assert!((got - want).abs() < 3e-5, "{got} instead of {want}");
        }
    }

    #[test]
    fn ambient_and_main_light_are_the_total() {
        let light = one_sided([0.6, -0.48, 0.64]);
        let options = SplitOptions { fade_in: false, ..SplitOptions::default() };
        for phase in [Phase::CondonShortley, Phase::Plain] {
            let told = y_up_light(&light, &split(&light, &options), phase);
            let main = told.main.unwrap();
            let mut y = [0.0_f32; 9];
            basis::evaluate(3, main.to_light_y_up, &mut y);
            for (i, y) in y.iter().enumerate() {
                let y = if phase == Phase::Plain && has_odd_m(i) { -y } else { *y };
                for c in 0..3 {
                    let both = told.ambient_rgb[i][c] + main.irradiance_rgb[c] * y;
                    // Three roundings of numbers up to 4.
                    assert!((both - told.total_rgb[i][c]).abs() < 2e-6, "{phase:?} row {i}");
                }
            }
            let toward: f32 = (0..3).map(|i| main.to_light_y_up[i] * y_up([0.6, -0.48, 0.64])[i]).sum();
            assert!(toward > 0.9999, "{toward}");
        }
    }

    #[test]
    fn bands_that_were_not_measured_are_zero() {
        let mut light = RadianceSh::zero(2);
        light.rgb = [[1.0; 3]; 36];
        let nine = nine_y_up(&light, Phase::Plain);
        assert!(nine[..4].iter().flatten().all(|c| c.abs() == 1.0) && nine[4..] == [[0.0; 3]; 5]);
    }
}
