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
    ObjectPoint { position_world, normal, to_eye, tint_openness: [1.0; 4], transferred_rgb: None }
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
