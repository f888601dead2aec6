//! Places a map of unknown scale in a frame whose scale is known (Section 3.2 of [Now11]), over f32 or f64.
//!
//! The same cameras stand at p_i in the known frame (a marker's, metres) and at q_i in the map's, where
//! q_i = o + s R p_i. The rotation R comes from the cameras' own rotations: with world-to-camera rotations it is the
//! mean of Rhat_i^-1 R_i ([`crate::math::rigid::nearest_rotation`]).

use crate::math::{rigid::Quaternion, sh::Real, vector::Vector};

/// One camera's centre in both frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapView<T = f64> {
    /// In the known frame, metres.
    pub known_m: Vector<T, 3>,
    /// In the map, in its own unit.
    pub map: Vector<T, 3>,
}

/// Where the known frame stands in the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement<T = f64> {
    /// Units of the map in a metre, above 0.
    pub scale: T,
    /// Origin of the known frame, in the map.
    pub origin: Vector<T, 3>,
}

/// The views' spread below this share of their distance from the known origin says nothing of the scale.
const LEAST_BASELINE: f64 = 0.05;

/// Scale and origin by linear least squares over all views: s = sum (q_i - q).R(p_i - p) / sum |p_i - p|^2 and
/// o = q - s R p with the means p, q. Works for parallel lines of sight too; the numbers are centred first, so that
/// f32 keeps its digits far from the origin. `None` with fewer than two views, with a spread (root mean square)
/// below 5 % of their distance from the known origin, or where the scale is not above 0.
pub fn place<T: Real>(map_from_known: Quaternion<T>, views: &[MapView<T>]) -> Option<Placement<T>> {
    if views.len() < 2 {
        return None;
    }
    let share = T::one() / T::of(views.len() as f64);
    let turned = |view: &MapView<T>| map_from_known.rotate(view.known_m);
    let mean = |of: &dyn Fn(&MapView<T>) -> Vector<T, 3>| {
        views.iter().fold(Vector::zero(), |sum, view| sum + of(view)) * share
    };
    let (known, map) = (mean(&turned), mean(&|view| view.map));
    let (mut product, mut square, mut distance) = (T::zero(), T::zero(), T::zero());
    for view in views {
        let arm = turned(view) - known;
        product += (view.map - map).dot(arm);
        square += arm.dot(arm);
        distance += view.known_m.dot(view.known_m);
    }
    let scale = product / square;
    let wide = square > T::of(LEAST_BASELINE * LEAST_BASELINE) * distance;
    let placement = Placement { scale, origin: map - known * scale };
    (wide && scale > T::zero() && scale.is_finite() && placement.origin.is_finite()).then_some(placement)
}

/// The scale from two views alone: the lines from each q_i along -R p_i meet in the known origin, at the parameter t
/// of the second, which is s. Noise keeps them from meeting: t is where the second comes nearest to the first.
/// `None` for parallel lines.
pub fn scale_of_two<T: Real>(map_from_known: Quaternion<T>, [first, second]: &[MapView<T>; 2]) -> Option<T> {
    let (a, b) = (-map_from_known.rotate(first.known_m), -map_from_known.rotate(second.known_m));
    let between = first.map - second.map;
    // |a|^2 |b|^2 - (a.b)^2 as a cross product: no cancellation for narrow angles.
    let normal = a.cross(b);
    let t = a.cross(between).dot(normal) / normal.dot(normal);
    t.is_finite().then_some(t)
}

/// The same from x and y alone, as the paper has it: 3 to 20 times the error of [`scale_of_two`] and [`place`] (spec,
/// section 8), and nothing where the lines differ in z only. To compare with.
pub fn scale_of_two_flat<T: Real>(
    map_from_known: Quaternion<T>,
    [first, second]: &[MapView<T>; 2],
) -> Option<T> {
    let flat = |v: Vector<T, 3>| Vector([v.0[0], v.0[1]]);
    let (a, b) = (flat(-map_from_known.rotate(first.known_m)), flat(-map_from_known.rotate(second.known_m)));
    let t = a.cross(flat(first.map - second.map)) / a.cross(b);
    t.is_finite().then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn views(turn: Quaternion<f64>, scale: f64, origin: Vector<f64, 3>, known: &[[f64; 3]]) -> Vec<MapView> {
        let view =
            |p: &[f64; 3]| MapView { known_m: Vector(*p), map: origin + turn.rotate(Vector(*p)) * scale };
        known.iter().map(view).collect()
    }

    #[test]
    fn what_fixes_no_scale_is_refused() {
        let turn = Quaternion::exp(Vector([0.3, -0.2, 0.9]));
        let origin = Vector([1.0, 2.0, 3.0]);
        // All within 1 % of their distance; one alone; a map that is turned over.
        let close = views(turn, 2.0, origin, &[[0.5, 0.0, 0.0], [0.505, 0.0, 0.0]]);
        assert_eq!(place(turn, &close), None);
        assert_eq!(place(turn, &close[..1]), None);
        assert_eq!(place(turn, &views(turn, -2.0, origin, &[[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])), None);
        assert_eq!(place(turn, &views(turn, f64::NAN, origin, &[[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])), None);
        // Parallel lines of sight: two views have no crossing, least squares needs none.
        let parallel = views(turn, 2.0, origin, &[[0.2, 0.0, 0.0], [0.4, 0.0, 0.0]]);
        let pair = [parallel[0], parallel[1]];
        assert!(scale_of_two(turn, &pair).is_none_or(|t| (t - 2.0).abs() > 1e-3));
        assert!((place(turn, &parallel).unwrap().scale - 2.0).abs() < 1e-12);
        // Differing in z only (of the map): nothing in x and y.
        let upright = Quaternion::identity();
        let pair = views(upright, 2.0, Vector([0.0; 3]), &[[0.3, 0.3, 0.1], [0.3, 0.3, 0.5]]);
        assert_eq!(scale_of_two_flat(upright, &[pair[0], pair[1]]), None);
        assert!((scale_of_two(upright, &[pair[0], pair[1]]).unwrap() - 2.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_placement_comes_back(
            axis in prop::array::uniform3(-2.0..2.0_f64), scale in 0.1..20.0_f64,
            origin in prop::array::uniform3(-10.0..10.0_f64),
            p in prop::array::uniform3(0.2..0.6_f64), q in prop::array::uniform3(-0.6..-0.1_f64), z in 0.3..0.8_f64,
        ) {
            let turn = Quaternion::exp(Vector(axis));
            let views = views(turn, scale, Vector(origin), &[p, q, [p[0], q[1], z]]);
            let got = place(turn, &views).unwrap();
            prop_assert!((got.scale / scale - 1.0).abs() < 1e-13);
            prop_assert!((got.origin - Vector(origin)).length() < 1e-13 * (10.0 + scale));
            let narrow = |v: Vector<f64, 3>| Vector(v.0.map(|x| x as f32));
            let slim: Vec<MapView<f32>> =
                views.iter().map(|v| MapView { known_m: narrow(v.known_m), map: narrow(v.map) }).collect();
            let slim = place(Quaternion(turn.0.map(|v| v as f32)), &slim).unwrap();
            // The map's coordinates are rounded to 2^-24 of their size; the spread is half a metre times the scale.
            let size = 10.0 + scale;
            prop_assert!((f64::from(slim.scale) - scale).abs() < 4e-7 * size, "{} for {scale}", slim.scale);
            let off = (Vector(slim.origin.0.map(f64::from)) - Vector(origin)).length();
            prop_assert!(off < 1e-6 * size, "{off:e}");
            let pair = [views[0], views[1]];
            prop_assume!(Vector(p).unit().unwrap().cross(Vector(q).unit().unwrap()).length() > 0.1);
            prop_assert!((scale_of_two(turn, &pair).unwrap() / scale - 1.0).abs() < 1e-10);
        }
    }
}
