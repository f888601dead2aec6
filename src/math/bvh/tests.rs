use super::*;
use proptest::prelude::*;

/// The triangle test of Woop, Benthin and Wald one triangle at a time: t and the corners' weights.
fn meets(corners: [Vec3; 3], origin: Vec3, direction: Vec3) -> Option<(f32, [f32; 3])> {
    let size = direction.abs();
    let z = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let (x, y) = ((z + 1) % 3, (z + 2) % 3);
    let shear = [direction[x] / direction[z], direction[y] / direction[z], 1.0 / direction[z]];
    let [a, b, c] = corners
        .map(|p| p - origin)
        .map(|p| [p[x] - shear[0] * p[z], p[y] - shear[1] * p[z], shear[2] * p[z]]);
    let mut edges = [(c, b), (a, c), (b, a)].map(|(p, q)| p[0] * q[1] - p[1] * q[0]);
    if edges.contains(&0.0) {
        edges = [(c, b), (a, c), (b, a)]
            .map(|(p, q)| (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32);
    }
    let determinant: f32 = edges[0] + edges[1] + edges[2];
    if edges.iter().any(|e| *e < 0.0) && edges.iter().any(|e| *e > 0.0) || determinant == 0.0 {
        return None;
    }
    let weights = edges.map(|e| e / determinant);
    let t = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
    (t > 0.0).then_some((t, weights))
}

fn brute(positions: &[Vec3], triangles: &[[u32; 3]], origin: Vec3, direction: Vec3) -> Option<TriangleHit> {
    if direction == Vec3::ZERO {
        return None;
    }
    let mut best: Option<TriangleHit> = None;
    for (index, t) in triangles.iter().enumerate() {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let area = (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()).length_squared();
        let Some((t, barycentric)) = meets([a, b, c], origin, direction).filter(|_| area > 0.0) else {
            continue;
        };
        if best.is_none_or(|b| t < b.t) {
            best = Some(TriangleHit { t, triangle: index as u32, barycentric });
        }
    }
    best
}

fn grid(n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions =
        (0..=n).flat_map(|y| (0..=n).map(move |x| Vec3::new(x as f32, y as f32, 0.0) / n as f32)).collect();
    let mut triangles = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let i = y * (n + 1) + x;
            triangles.extend([[i, i + 1, i + n + 1], [i + 1, i + n + 2, i + n + 1]]);
        }
    }
    (positions, triangles)
}

#[test]
fn rays_through_edges_and_corners_of_a_grid_never_leak() {
    let (positions, triangles) = grid(16);
    let bvh = Bvh::build(&positions, &triangles);
    assert_eq!(bvh.len(), 512);
    for y in 0..=32 {
        for x in 0..=32 {
            let target = Vec3::new(x as f32, y as f32, 0.0) / 32.0;
            for origin in [Vec3::new(0.3, 0.7, 1.0), target + Vec3::Z, Vec3::new(-3.0, 0.1, -0.2)] {
                let inner = (1..32).contains(&x) && (1..32).contains(&y);
                let hit = bvh.intersect(origin, target - origin, 0.0, f32::INFINITY);
                assert!(!inner || hit.is_some_and(|h| (h.t - 1.0).abs() < 1e-5), "{target} from {origin}");
            }
        }
    }
}

#[test]
fn limits_are_exclusive_and_nothing_is_met_outside_them() {
    let bvh = Bvh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
    let (origin, down) = (Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);
    let hit = bvh.intersect(origin, down, 0.0, 2.0).unwrap();
    assert_eq!((hit.t, hit.triangle, hit.barycentric), (1.0, 0, [0.5, 0.25, 0.25]));
    assert!(bvh.occluded(origin, down * 0.5, 0.0, 3.0) && !bvh.occluded(origin, down * 0.5, 0.0, 2.0));
    assert!(!bvh.occluded(origin, down, 1.0, 2.0) && !bvh.occluded(origin, down, 0.0, 1.0));
    assert!(bvh.occluded(Vec3::new(0.25, 0.25, -1.0), Vec3::Z, 0.0, 2.0), "the back side counts");
}

#[test]
fn hopeless_triangles_and_rays_are_passed_over() {
    let positions = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::NAN, Vec3::INFINITY, Vec3::Y];
    let bvh = Bvh::build(&positions, &[[0, 1, 2], [0, 0, 0], [0, 1, 3], [0, 4, 5], [0, 1, 99], [0, 1, 5]]);
    assert_eq!(bvh.len(), 1);
    let origin = Vec3::new(0.25, 0.25, 1.0);
    assert_eq!(bvh.intersect(origin, Vec3::NEG_Z, 0.0, 9.0).map(|h| h.triangle), Some(5));
    for direction in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
        assert!(!bvh.occluded(origin, direction, 0.0, 9.0));
    }
    assert!(!bvh.occluded(Vec3::NAN, Vec3::NEG_Z, 0.0, 9.0));
    let none = Bvh::build(&[], &[]);
    assert!(none.is_empty() && none.bounds().is_none() && !none.occluded(origin, Vec3::Z, 0.0, 1.0));
}

#[test]
fn a_thousand_triangles_in_one_place_stay_within_the_stack() {
    let bvh = Bvh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &vec![[0, 1, 2]; 1000]);
    let hit = bvh.intersect(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z, 0.0, 9.0).unwrap();
    assert_eq!(hit.triangle, 0, "the lowest index wins among equals");
    // Sizes that double defeat the bins: one triangle is cut off at a time until the depth limit.
    let positions: Vec<Vec3> = (0..600)
        .flat_map(|i| {
            let s = 2f32.powf(i as f32 / 6.0 - 50.0);
            [Vec3::new(s, 0.0, 0.0), Vec3::new(s, s, 0.0), Vec3::new(s, 0.0, s)]
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..600).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let bvh = Bvh::build(&positions, &triangles);
    let direction = Vec3::new(1.0, 0.3, 0.3);
    let hit = bvh.intersect(Vec3::ZERO, direction, 0.0, f32::INFINITY);
    assert_eq!(hit, brute(&positions, &triangles, Vec3::ZERO, direction));
    assert!(hit.is_some());
}

fn coordinate() -> impl Strategy<Value = f32> {
    // Whole numbers make shared planes, edges and coincidences; the rest is general.
    prop_oneof![(-3i32..=3).prop_map(|i| i as f32), -3.0f32..3.0]
}

fn point() -> impl Strategy<Value = Vec3> {
    (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn agrees_with_trying_every_triangle(
        positions in prop::collection::vec(point(), 3..60),
        picks in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 1..120),
        rays in prop::collection::vec((point(), point()), 1..20),
    ) {
        let triangles: Vec<[u32; 3]> =
            picks.iter().map(|p| p.map(|i| i.index(positions.len()) as u32)).collect();
        let bvh = Bvh::build(&positions, &triangles);
        for (origin, direction) in rays {
            let expected = brute(&positions, &triangles, origin, direction);
            let found = bvh.intersect(origin, direction, 0.0, f32::INFINITY);
            prop_assert_eq!(found, expected);
            prop_assert_eq!(bvh.occluded(origin, direction, 0.0, f32::INFINITY), expected.is_some());
            if let Some(hit) = found {
                let corners = triangles[hit.triangle as usize].map(|i| positions[i as usize]);
                let point: Vec3 = (0..3).map(|k| corners[k] * hit.barycentric[k]).sum();
                let along = origin + direction * hit.t;
                // Coordinates up to 3: a few roundings of 3 * 2^-24, more where the triangle is seen edge-on.
                prop_assert!(point.distance(along) < 1e-3, "{} {}", point, along);
            }
        }
    }
}
