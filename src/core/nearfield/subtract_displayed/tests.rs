use super::*;
use crate::nearfield::intensity::{by_turns, intensity_transfers};
use proptest::prelude::*;

const GAMMA: f64 = 2.2;

/// Of exposures 0 to 1.
fn gamma() -> DisplayCurve {
    let g = std::array::from_fn(|z| (GAMMA * (f64::max(z as f64, 1e-3) / 255.0).ln()) as f32);
    DisplayCurve::of(&Response::new([g; 3]).unwrap())
}

fn tone(light: f64) -> f64 {
    255.0 * light.max(0.0).powf(1.0 / GAMMA)
}

/// Slope of `tone`.
fn slope(light: f64) -> f64 {
    255.0 / GAMMA * light.max(0.0).powf(1.0 / GAMMA - 1.0)
}

/// What is taken of a pixel of exposure `x` when the `hidden` of `lights` (shares of all light, strongest first) are: with
/// rounding, as the target, and without.
fn taken(lights: &[f64], x: f64, hidden: &[bool]) -> (f64, f64) {
    let curve = gamma();
    let mut before = [0.0f64; 2];
    let mut sum = 0.0;
    for (k, (&light, &hidden)) in lights.iter().zip(hidden).enumerate() {
        let set = &mut before[k % 2];
        let shares = [*set as f32, (*set + light) as f32];
        sum += f64::from(transfer(&curve, 1, x as f32, shares, if hidden { 1.0 } else { 0.0 }));
        *set += light;
    }
    let own: Vec<f64> = lights.iter().map(|l| l * x).collect();
    let second: Vec<bool> = by_turns(lights.len()).collect();
    let mut transfers = Vec::new();
    intensity_transfers(&own, &second, x, &tone, &mut transfers);
    (sum, transfers.iter().zip(hidden).filter(|(_, hidden)| **hidden).map(|(s, _)| s).sum())
}

#[test]
fn the_curve_is_the_response() {
    for response in [Response::srgb(), gamma().response] {
        let curve = DisplayCurve::of(&response);
        let mut last = 0.0;
        for k in 0..4000 {
            let exposure = 1.3 * (k as f32 / 4000.0).powi(3);
            let (value, exact) = (curve.value(2, exposure), response.value_of(2, exposure));
            // Its logarithms are rounded.
            assert!((value - exact).abs() < 2e-3 && value >= last, "{exposure}: {value} for {exact}");
            assert!((f32::from(curve.shown(2, exposure)) - exact).abs() <= 0.501);
            last = value;
        }
        assert_eq!(last, 255.0);
        assert!((0..=255).all(|z| curve.shown(0, curve.exposure(0, z)) == z));
        assert_eq!([f32::NAN, -1.0, 0.0].map(|e| curve.shown(0, e)), [0; 3]);
        assert_eq!([f32::INFINITY, f32::MAX].map(|e| curve.shown(0, e)), [255; 2]);
    }
}

#[test]
fn many_weak_lights_vanish() {
    // Spec 9: 50 that carry a tenth of the light are worth 11.8 values together, and each less than a half.
    let (rounded, exact) = taken(&[0.1 / 50.0; 50], 1.0, &[true; 50]);
    assert_eq!(rounded, 0.0);
    assert!((exact - 11.8).abs() < 0.1, "{exact}");
    // Ten of the same strength together are there.
    let (rounded, exact) = taken(&[0.1 / 10.0; 10], 1.0, &[true; 10]);
    assert!(rounded == 10.0 && (exact - 11.8).abs() < 0.1, "{rounded} {exact}");
}

#[test]
fn where_all_is_hidden_it_stays_too_bright() {
    // Spec 9: 2 T(L/2) - T(L) - T(0) = 117 values, but for rounding.
    for count in [2, 10, 50] {
        let (rounded, exact) =
            taken(&vec![1.0 / f64::from(count); count as usize], 1.0, &vec![true; count as usize]);
        assert!((255.0 - exact - 117.1).abs() < 0.1, "{count}: {exact}");
        assert!((rounded - exact).abs() <= 0.5 * f64::from(count), "{count}: {rounded} for {exact}");
    }
    // One light, and all of a linear display: nothing is wrong.
    assert_eq!(taken(&[1.0], 1.0, &[true]).0, 255.0);
}

#[test]
fn lights_are_dealt_out_from_strong_to_weak() {
    use crate::nearfield::{fixture, frame::NearQuality};
    use crate::visibility::proxies::Proxies;
    use glam::{DVec3, Vec3};
    let field = fixture::field(&fixture::room(), 300, &fixture::ALL);
    let positions = [Vec3::new(0.0, 0.0, 0.2), Vec3::new(0.2, 0.0, 0.2), Vec3::new(0.1, 0.2, 0.3)];
    let proxies = Proxies::build(&positions, &[[0, 1, 2]], std::iter::once(0..1), 500);
    let lens = crate::math::lens::Lens::pinhole(160, 120, 90.0, 90.0, 80.0, 60.0);
    let pose = crate::math::pose::Pose::look_at(DVec3::new(-1.2, -1.3, 0.9), DVec3::ZERO, DVec3::Z);
    let (mut frame, mut dealt) = (NearFrame::default(), DisplayedLights::default());
    for lights in [7, 5, 1] {
        frame.update(
            &field,
            &proxies,
            &positions,
            (&lens, &pose),
            &NearQuality { lights, left_rad: f32::INFINITY, texels: 64, places: 1 },
        );
        dealt.update(&frame);
        let count = frame.lights().len();
        assert!(count > 0 && count <= lights);
        let strength = |k: usize| crate::math::color::luminance(frame.intensities()[k]);
        let mut sorted: Vec<usize> = (0..count).collect();
        sorted.sort_by(|a, b| strength(*b).total_cmp(&strength(*a)).then(a.cmp(b)));
        for vertex in (0..field.patches.vertices.len() as u32).step_by(17) {
            let mut sums = [[0.0f32; 3]; 2];
            for (place, &k) in sorted.iter().enumerate() {
                assert_eq!(dealt.is_second(k), place % 2 == 1);
                assert_eq!(dealt.before(k, vertex), sums[place % 2]);
                let sent = frame.sent(k, vertex);
                sums[place % 2] = std::array::from_fn(|c| sums[place % 2][c] + sent[c]);
            }
        }
    }
    assert!(dealt.before(99, 0) == [0.0; 3] && !dealt.is_second(99));
}

proptest! {
    /// (T'(L) - T'(m)) Q <= I - I_exact <= (T'(L - Q) - T'(L)) Q, and the rounding of each light that is hidden.
    #[test]
    fn the_error_stays_within_its_bound(
        strengths in prop::collection::vec((0.01f64..1.0, any::<bool>()), 1..40),
        carried in 0.2f64..0.95,
        x in 0.05f64..1.0,
    ) {
        let mut strengths = strengths;
        strengths.sort_by(|a, b| b.0.total_cmp(&a.0));
        let whole: f64 = strengths.iter().map(|s| s.0).sum();
        let lights: Vec<f64> = strengths.iter().map(|s| s.0 / whole * carried).collect();
        let hidden: Vec<bool> = strengths.iter().map(|s| s.1).collect();
        let (rounded, exact) = taken(&lights, x, &hidden);
        let set = |which: usize| lights.iter().skip(which).step_by(2).sum::<f64>();
        let q: f64 = x * lights.iter().zip(&hidden).filter(|(_, h)| **h).map(|(l, _)| l).sum::<f64>();
        let m = x * (1.0 - set(0).max(set(1)));
        let low = (slope(x) - slope(m)) * q;
        let high = (slope(x - q) - slope(x)) * q;
        let off = |taken: f64| (tone(x) - taken).max(0.0) - tone(x - q);
        prop_assert!(off(exact) >= low - 1e-6 && off(exact) <= high + 1e-6, "{low} {} {high}", off(exact));
        // Half a value a light, and the curve's own straight pieces.
        let most = 0.5 * hidden.iter().filter(|h| **h).count() as f64 + 0.5;
        prop_assert!(off(rounded) >= low - most && off(rounded) <= high + most, "{low} {} {high}", off(rounded));
    }

    /// The picture times the ratio is shown as what is left, and never brighter than before.
    #[test]
    fn the_ratio_shows_what_is_left(log in -12.0f32..3.0, left in 0u8..=255) {
        for curve in [gamma(), DisplayCurve::of(&Response::srgb())] {
            let exposure = log.exp();
            let shown = curve.shown(1, exposure);
            let ratio = ratio(&curve, 1, exposure, left, shown);
            prop_assert!((0.0..=1.0).contains(&ratio));
            prop_assert_eq!(curve.shown(1, exposure * ratio), left.min(shown));
        }
    }
}
