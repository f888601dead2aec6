use super::*;
use crate::dice::Dice;
use proptest::prelude::*;

fn soup(count: usize, size: f32, seed: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut dice = Dice::new(u64::from(seed));
    let mut point = |scale: f32| Vec3::from_array([(); 3].map(|()| dice.unit_f32() - 0.5)) * scale;
    let mut positions = Vec::new();
    for _ in 0..count {
        let centre = point(2.0);
        positions.extend([centre + point(size), centre + point(size), centre + point(size)]);
    }
    (positions, (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn triangles(positions: &[Vec3], indices: &[[u32; 3]]) -> ShapeTree<TriangleBlock> {
    ShapeTree::build(indices.iter().map(|t| t.map(|i| positions[i as usize])))
}

#[test]
fn rays_along_axes_and_through_edges_are_met() {
    // A grid of squares in z = 0, each of two triangles; rays down through corners, edges and diagonals.
    let mut shapes = Vec::new();
    for i in 0..8u8 {
        for j in 0..8u8 {
            let at = |dx: u8, dy: u8| Vec3::new(f32::from(i + dx) * 0.1, f32::from(j + dy) * 0.1, 0.0);
            shapes.push([at(0, 0), at(1, 0), at(1, 1)]);
            shapes.push([at(0, 0), at(1, 1), at(0, 1)]);
        }
    }
    let tree: ShapeTree<TriangleBlock> = ShapeTree::build(shapes.into_iter());
    for i in 0..=32u8 {
        for j in 0..=32u8 {
            let target = Vec3::new(f32::from(i).clamp(0.5, 31.5), f32::from(j).clamp(0.5, 31.5), 0.0) * 0.025;
            for from in [Vec3::Z, Vec3::new(0.3, -0.2, 1.0), Vec3::new(-7.0, 0.0, 0.5)] {
                let ray = PreparedRay::new(target + from, -from);
                let hit = tree.nearest(&ray, 0.0, 2.0).expect("no leak");
                assert!((hit.t - 1.0).abs() < 1e-5);
            }
        }
    }
    assert!(tree.nearest(&PreparedRay::new(Vec3::Z, Vec3::X), 0.0, 9.0).is_none());
}

#[test]
fn spheres_by_hand() {
    let spheres = (0..20u8).map(|i| (Vec3::new(f32::from(i), 0.0, 0.0), 0.25));
    let tree: ShapeTree<SphereBlock> = ShapeTree::build(spheres);
    let hit = tree.nearest(&PreparedRay::new(Vec3::new(-1.0, 0.0, 0.0), Vec3::X), 0.0, 100.0).unwrap();
    assert_eq!((hit.shape, hit.t), (0, 0.75));
    let hit =
        tree.nearest(&PreparedRay::new(Vec3::new(7.0, 0.0, 5.0), Vec3::NEG_Z * 2.0), 0.0, 100.0).unwrap();
    assert_eq!((hit.shape, hit.t), (7, 4.75 / 2.0));
    // From inside the far side is met.
    let hit = tree.nearest(&PreparedRay::new(Vec3::new(3.0, 0.0, 0.0), Vec3::Y), 1e-4, 100.0).unwrap();
    assert_eq!((hit.shape, hit.t), (3, 0.25));
    assert!(!tree.occluded(&PreparedRay::new(Vec3::new(0.5, 0.0, 5.0), Vec3::NEG_Z), 0.0, 100.0));
    assert!(!tree.occluded(&PreparedRay::new(Vec3::new(-1.0, 0.0, 0.0), Vec3::X), 0.0, 0.7));
}

#[test]
fn nothing_and_nonsense_meet_nothing() {
    let empty: ShapeTree<TriangleBlock> = ShapeTree::build(std::iter::empty());
    assert!(!empty.occluded(&PreparedRay::new(Vec3::ZERO, Vec3::X), 0.0, f32::INFINITY));
    let flat = [[Vec3::ZERO; 3], [Vec3::NAN, Vec3::X, Vec3::Y], [Vec3::ZERO, Vec3::X, Vec3::X * 2.0]];
    let tree: ShapeTree<TriangleBlock> = ShapeTree::build(flat.into_iter());
    assert!(tree.nodes.is_empty());
    let (positions, indices) = soup(50, 0.5, 1);
    let tree = triangles(&positions, &indices);
    for bad in [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO] {
        assert!(tree.nearest(&PreparedRay::new(Vec3::ZERO, bad), 0.0, 10.0).is_none());
    }
    // Many in one place cannot be told apart and still all count.
    let same = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 500];
    let tree: ShapeTree<TriangleBlock> = ShapeTree::build(same.into_iter());
    assert!(tree.occluded(&PreparedRay::new(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z), 0.0, 10.0));
}

proptest! {
    #[test]
    fn every_triangle_is_found(count in 1usize..300, seed: u32) {
        // A ray from just above a triangle's middle towards it meets that triangle or one before it.
        let (positions, indices) = soup(count, 0.3, seed);
        let tree = triangles(&positions, &indices);
        for t in &indices {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            let normal = (b - a).cross(c - a);
            prop_assume!(normal.length() > 1e-4);
            let ray = PreparedRay::new((a + b + c) / 3.0 + normal.normalize() * 0.1, -normal.normalize());
            let hit = tree.nearest(&ray, 0.0, 1.0);
            prop_assert!(hit.is_some_and(|h| h.t < 0.1 + 1e-4), "{hit:?}");
        }
    }
}
