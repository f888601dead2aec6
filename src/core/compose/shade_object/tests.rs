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
    let position_world = Vec3::ZERO;
    ObjectPoint { position_world, normal, to_eye, tint_openness: [1.0; 4], soft: [0.0; 4], gloss: [1.0; 3] }
}

/// Without a picture, energy-safe.
fn shade(
    light: &LightTerms,
    material: &MaterialTerms,
    point: &ObjectPoint,
    visibility: impl Fn(usize) -> f32,
) -> [f32; 3] {
    let nothing = Reflected::default();
    let plain = Surroundings::new(None, &nothing, PhongNorm::EnergySafe, light.order);
    super::shade(light, &plain, material, point, |k, _, _| visibility(k))
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
fn sharp_lobes_in_strong_light_stay_finite() {
    // At the very peak (s + 1)/(2 pi) E is beyond 32 bits; a channel that reflects nothing stays dark.
    let light = sun(Vec3::Y, [1e10, 1e10, 0.0], RadianceSh::zero(4));
    let sharp = Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0, 0.0, 1.0], exponent: 1e30 };
    let out = shade(&light, &MaterialTerms::of(&sharp), &point(Vec3::Y, Vec3::Y), |_| 1.0);
    assert_eq!(out, [f32::MAX, 0.0, 0.0]);
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

/// For a hard light and for the same light in SH the shade's bands below the order are equal, whatever the lobe and its
/// norm: f+ is one and the same in both terms (section 5 of the project's formulas).
#[test]
fn each_lobe_is_the_same_in_both_terms() {
    let w = Vec3::new(0.48, 0.6, 0.64);
    let nothing = Reflected::default();
    let phong = |exponent| Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0; 3], exponent };
    let lambert = Material::Lambert { albedo_rgb: [1.0; 3] };
    for order in [4usize, 6] {
        // Constant light beside it keeps the shade above 0, where nothing is clamped; it is in both.
        let mut soft = RadianceSh::zero(order);
        soft.rgb[0] = [40.0; 3];
        let hard = sun(w, [1.0; 3], soft);
        let mut y = [0.0f32; MAX_COEFFICIENTS];
        basis::evaluate(order, w.to_array(), &mut y);
        for (row, y) in soft.rgb.iter_mut().zip(y).take(order * order) {
            row.iter_mut().for_each(|c| *c += y);
        }
        let spread = LightTerms::of(&Lights::soft(soft));
        for (material, norm) in [
            (lambert, PhongNorm::EnergySafe),
            (phong(3.0), PhongNorm::EnergySafe),
            (phong(8.0), PhongNorm::EnergySafe),
            (phong(8.0), PhongNorm::Paper),
        ] {
            let terms = MaterialTerms::of(&material);
            let surroundings = Surroundings::new(None, &nothing, norm, order);
            // Bands about w of what leaves along the normal, by 4000 midpoints of the cosine.
            let (mut by_hard, mut by_soft) = ([0.0f64; 6], [0.0f64; 6]);
            let side = w.any_orthonormal_vector();
            for k in 0..4000 {
                let x = -1.0 + (f64::from(k) + 0.5) / 2000.0;
                let n = (w * x as f32 + side * (1.0 - x * x).sqrt() as f32).normalize();
                let leaves = |light: &LightTerms| {
                    f64::from(super::shade(light, &surroundings, &terms, &point(n, n), |_, _, _| 1.0)[1])
                };
                let (a, b) = (leaves(&hard), leaves(&spread));
                assert!(b > 0.0, "clamped");
                let mut legendre = (1.0, x);
                for l in 0..order {
                    by_hard[l] += a * legendre.0 / 2000.0;
                    by_soft[l] += b * legendre.0 / 2000.0;
                    let m = l as f64 + 1.0;
                    legendre = (legendre.1, ((2.0 * m + 1.0) * x * legendre.1 - m * legendre.0) / (m + 1.0));
                }
            }
            for l in 0..order {
                let (a, b) = (by_hard[l], by_soft[l]);
                // Sums of 4000 f32 shades of size 10; the lobe's edge at the horizon between midpoints.
                assert!((a - b).abs() < 2e-5, "order {order}, {material:?}, {norm:?}, band {l}: {a} {b}");
            }
        }
    }
}

/// Sharp gloss reads the picture's levels; hard lights that are in them are not added again; a soft lobe stays in SH.
#[test]
fn sharp_gloss_is_read_from_the_levels() {
    use crate::model::environment::{EnvironmentPicture, OctahedralMap};
    let mut level = OctahedralMap::new(4);
    level.texels_mut().fill([2.0, 4.0, 8.0]);
    let mut picture =
        EnvironmentPicture { all: level.clone(), glossy: vec![level], ..EnvironmentPicture::default() };
    let light = sun(Vec3::Z, [10.0; 3], RadianceSh::zero(4));
    let nothing = Reflected::default();
    let point = ObjectPoint { gloss: [0.5; 3], ..point(Vec3::Z, Vec3::Z) };
    let out = |picture: &EnvironmentPicture, exponent: f32, norm| {
        let phong = Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [0.5; 3], exponent };
        let surroundings = Surroundings::new(Some(picture), &nothing, norm, light.order);
        super::shade(&light, &surroundings, &MaterialTerms::of(&phong), &point, |_, _, _| 1.0)
    };
    let shine = 0.5 * 10.0 * 41.0 / TAU;
    let sharp = out(&picture, 40.0, PhongNorm::EnergySafe);
    for (got, level) in sharp.iter().zip([2.0, 4.0, 8.0]) {
        assert!((got - shine - 0.5 * 0.5 * level).abs() < 1e-3, "{sharp:?}");
    }
    let paper = out(&picture, 40.0, PhongNorm::Paper);
    assert!((paper[0] / sharp[0] - 42.0 / 41.0).abs() < 1e-5);
    picture.holds_hard_lights = true;
    assert!((out(&picture, 40.0, PhongNorm::EnergySafe)[2] - 2.0).abs() < 1e-5);
    // Exponent 5 at order 4 is soft enough: L_g is 0, the hard light shines.
    let soft = out(&picture, 5.0, PhongNorm::EnergySafe);
    assert!((soft[2] - 0.5 * 10.0 * 6.0 / TAU).abs() < 1e-4, "{soft:?}");
    // Mirrors see the picture and nothing is added.
    let mirror = MaterialTerms::of(&Material::Mirror { reflectance_rgb: [0.5; 3] });
    let surroundings = Surroundings::new(Some(&picture), &nothing, PhongNorm::Paper, 4);
    assert_eq!(super::shade(&light, &surroundings, &mirror, &point, |_, _, _| 1.0), [1.0, 2.0, 4.0]);
}
