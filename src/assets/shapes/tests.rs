use super::*;
use proptest::prelude::*;

/// Volume by the divergence theorem; right only for closed surfaces with all triangles outwards.
fn volume(mesh: &Mesh) -> f64 {
    let six: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            a.dot(b.cross(c))
        })
        .sum();
    six / 6.0
}

/// Every edge is used once in each direction, taking vertices at one place as one.
fn is_closed(mesh: &Mesh) -> bool {
    let key = |i: u32| (mesh.positions[i as usize] * 1e5).round().as_ivec3().to_array();
    let mut edges: HashMap<([i32; 3], [i32; 3]), i32> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((key(from), key(to))).or_default() += 1;
            *edges.entry((key(to), key(from))).or_default() -= 1;
        }
    }
    edges.values().all(|&n| n == 0)
}

fn check(name: &str, mesh: &Mesh) {
    let n = mesh.positions.len();
    assert!(n > 0 && mesh.normals.len() == n && mesh.tints_rgb.len() == n, "{name}");
    for normal in &mesh.normals {
        assert!((normal.length() - 1.0).abs() < 1e-6, "{name}: {normal}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
        let face = (b - a).cross(c - a);
        assert!(face.length() > 0.0, "{name}: no area {triangle:?}");
        let mean: DVec3 = triangle.iter().map(|&i| mesh.normals[i as usize].as_dvec3()).sum();
        assert!(face.normalize().dot(mean.normalize()) > 0.5, "{name}: {a} {b} {c} against {mean}");
    }
}

#[test]
fn shapes_are_closed_outward_and_smooth() {
    for (name, mesh, expected_volume, tolerance) in [
        ("cuboid", cuboid(DVec3::new(1.0, 2.0, 3.0)), 48.0, 1e-6),
        ("icosphere", icosphere(2.0, 4), 33.510, 0.01),
        ("uv_sphere", uv_sphere(2.0, 64, 32), 33.510, 0.01),
        ("cylinder", cylinder(1.0, 2.0, 64), TAU, 0.005),
        ("capsule", capsule(1.0, 4.0, 64), 10.472, 0.01),
        ("torus", torus(2.0, 0.5, 128, 64), 9.8696, 0.005),
        // Length of the centre line, 15.949, times the cross-section of 32 sides.
        ("torus_knot", torus_knot(1.0, 0.1, 512, 32), 0.4978, 0.005),
        // As measured: they pin the drawn profiles.
        ("pawn", pawn(1.0, 96), 0.1003, 0.005),
        ("vase", vase(1.0, 96), 0.0368, 0.005),
    ] {
        check(name, &mesh);
        assert!(is_closed(&mesh), "{name} is not closed");
        let measured = volume(&mesh);
        assert!((measured / expected_volume - 1.0).abs() < tolerance, "{name}: volume {measured}");
    }
    check("plane", &plane_z0(2.0));
    assert_eq!(plane_z0(2.0).normals[0], Vec3::Z);
}

#[test]
fn standing_shapes_stand_on_the_ground_at_their_height() {
    for (name, mesh) in [
        ("pawn", pawn(0.12, 48)),
        ("vase", vase(0.12, 48)),
        ("cylinder", cylinder(0.1, 0.12, 48)),
        ("capsule", capsule(0.03, 0.12, 48)),
    ] {
        let (low, high) = bounds(&mesh).unwrap();
        assert!(low.z.abs() < 1e-6 && (high.z - 0.12).abs() < 1e-6, "{name}: {low} {high}");
    }
}

#[test]
fn the_ring_leans_against_the_pawn_without_sinking() {
    let mesh = pawn_with_ring(1.0);
    check("still life", &mesh);
    let (low, high) = bounds(&mesh).unwrap();
    assert!(low.z.abs() < 1e-3 && (high.z - 1.0).abs() < 1e-3, "{low} {high}");
    // No vertex of the ring is inside the pawn, and one comes within a hundredth of it (0.004 as measured).
    let body = pawn(1.0, 64);
    let bvh = crate::math::bvh::Bvh::build(&body.positions, &body.triangles);
    let mut nearest = f32::INFINITY;
    for &p in &mesh.positions[body.positions.len()..] {
        let inwards = Vec3::new(-p.x, -p.y, 0.0);
        let Some(hit) = bvh.intersect(p, inwards.normalize(), 0.0, 2.0) else { continue };
        let [a, b, c] = body.triangles[hit.triangle as usize].map(|i| body.positions[i as usize]);
        assert!((b - a).cross(c - a).dot(inwards) < 0.0, "{p} is inside the pawn");
        nearest = nearest.min(hit.t);
    }
    assert!(nearest < 0.01, "{nearest}");
}

#[test]
fn spheres_have_exact_normals_and_stay_within_the_sphere() {
    let mesh = icosphere(0.5, 3);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (642, 1280));
    for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
        assert!((*p - *n * 0.5).length() < 1e-7);
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        for middle in [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0] {
            assert!(0.5 - middle.length() < 0.5 * 0.22 / 64.0, "{}", middle.length());
        }
    }
}

#[test]
fn a_mirrored_copy_still_looks_outwards() {
    let mirror = Affine3A::from_scale(Vec3::new(-2.0, 1.0, 0.5));
    let mesh = transformed(&icosphere(1.0, 2), &mirror);
    check("mirrored", &mesh);
    assert!(volume(&mesh) > 0.0);
}

proptest! {
    #[test]
    fn any_sizes_give_sound_lists(radius in -1.0f64..2.0, height in -1.0f64..3.0, n in 0u32..20, m in 0u32..20) {
        for mesh in [
            uv_sphere(radius, n, m), cylinder(radius, height, n), capsule(radius, height, n), pawn(height, n),
            torus(radius, height, n, m), torus_knot(radius, height, n, m), vase(height, n),
            cuboid(DVec3::new(radius, height, 1.0)), lathe(&[], n, m),
            lathe(&[ProfilePoint::smooth(radius, height)], n, m),
        ] {
            let count = mesh.positions.len();
            prop_assert!(mesh.normals.len() == count && mesh.tints_rgb.len() == count);
            prop_assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < count));
            prop_assert!(mesh.positions.iter().all(|p| p.is_finite()));
            prop_assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        }
    }
}
