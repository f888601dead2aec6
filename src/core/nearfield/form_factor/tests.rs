use super::*;
use proptest::prelude::*;

fn square(half: f64, z: f64) -> [DVec3; 4] {
    [
        DVec3::new(-half, -half, z),
        DVec3::new(half, -half, z),
        DVec3::new(half, half, z),
        DVec3::new(-half, half, z),
    ]
}

#[test]
fn a_square_above_by_the_closed_form() {
    // Four equal quarters: F = 4 * (1/2pi) (2 x / sqrt(1 + x^2)) atan(x / sqrt(1 + x^2)), x = half side over height.
    for x in [1e-3f64, 0.05, 0.29, 0.31, 1.0, 30.0, 1e4] {
        let root = (1.0 + x * x).sqrt();
        let exact = 4.0 / TAU * 2.0 * x / root * (x / root).atan();
        let got = form_factor(DVec3::ZERO, DVec3::Z, &square(x, 1.0));
        assert!((got - exact).abs() < 1e-11 * (1.0 + exact), "{x}: {got} instead of {exact}");
    }
}

#[test]
fn what_cannot_be_seen_gives_nothing() {
    let above = square(1.0, 1.0);
    assert_eq!(form_factor(DVec3::ZERO, DVec3::NEG_Z, &above), 0.0, "behind");
    assert_eq!(form_factor(DVec3::new(5.0, 0.0, 1.0), DVec3::Z, &above), 0.0, "in its plane, beside it");
    assert_eq!(form_factor(DVec3::new(0.2, 0.0, 1.0), DVec3::Z, &above), 0.0, "on it");
    assert_eq!(form_factor(DVec3::new(0.0, 0.0, -1e5), DVec3::Z, &above), 0.0, "below 1e-7");
    assert_eq!(form_factor(DVec3::ZERO, DVec3::Z, &above[..2]), 0.0);
    for bad in [f64::NAN, f64::INFINITY] {
        assert_eq!(form_factor(DVec3::new(bad, 0.0, 0.0), DVec3::Z, &above), 0.0);
        assert_eq!(form_factor(DVec3::ZERO, DVec3::new(0.0, 0.0, bad), &above) % 1.0, 0.0);
        let mut corners = above;
        corners[2].x = bad;
        assert!((0.0..=1.0).contains(&form_factor(DVec3::ZERO, DVec3::Z, &corners)));
    }
}

#[test]
fn a_closed_room_covers_the_hemisphere() {
    // The five other sides of a cube seen from a place on its floor, for normals that tilt below the horizon too.
    let side = |axis: usize, sign: f64| {
        square(1.0, sign).map(|p| match axis {
            0 => DVec3::new(p.z, p.x, p.y),
            1 => DVec3::new(p.y, p.z, p.x),
            _ => p,
        })
    };
    for normal in [DVec3::Z, DVec3::new(0.3, -0.2, 0.6).normalize(), DVec3::X] {
        let mut sum = 0.0;
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                sum += form_factor(DVec3::new(0.3, -0.4, 0.1), normal, &side(axis, sign));
            }
        }
        assert!((sum - 1.0).abs() < 1e-11, "{normal}: {sum}");
    }
}

proptest! {
    #[test]
    fn bounded_additive_and_blind_to_sense(
        at in prop::array::uniform3(-1.5f64..1.5), towards in prop::array::uniform3(-1.0f64..1.0),
        u in prop::array::uniform3(-1.0f64..1.0), v in prop::array::uniform3(-1.0f64..1.0),
        cut in prop::array::uniform2(0.05f64..0.95),
    ) {
        let (normal, u, v) = (DVec3::from(towards), DVec3::from(u), DVec3::from(v));
        prop_assume!(normal.length() > 0.1 && u.cross(v).length() > 1e-3);
        let (point, normal) = (DVec3::from(at), normal.normalize());
        let whole = [DVec3::ZERO, u, u + v, v];
        let factor = form_factor(point, normal, &whole);
        prop_assert!((0.0..=1.0).contains(&factor));
        let reversed = form_factor(point, normal, &[v, u + v, u, DVec3::ZERO]);
        prop_assert!((factor - reversed).abs() < 1e-12);
        // Two quadrilaterals by a slanting cut, and two triangles. What is below 1e-7 may be missing of each part.
        let (low, high) = (u * cut[0], v + u * cut[1]);
        let parts = form_factor(point, normal, &[DVec3::ZERO, low, high, v])
            + form_factor(point, normal, &[low, u, u + v, high]);
        prop_assert!((factor - parts).abs() <= 2.0 * SMALLEST + 1e-11, "{} {}", factor, parts);
        let triangles = form_factor(point, normal, &[whole[0], whole[1], whole[2]])
            + form_factor(point, normal, &[whole[0], whole[2], whole[3]]);
        prop_assert!((factor - triangles).abs() <= 2.0 * SMALLEST + 1e-11, "{} {}", factor, triangles);
    }
}
