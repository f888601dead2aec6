use super::*;
use proptest::prelude::*;

fn sheet(z: f32, half: f32) -> (Vec<Vec3>, Vec<Vec3>, Vec<[u32; 3]>) {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let positions = corners.map(|[x, y]| Vec3::new(x, y, z)).to_vec();
    (positions, vec![Vec3::Z; 4], vec![[0, 1, 2], [0, 2, 3]])
}

fn standing<'a>(mesh: &'a (Vec<Vec3>, Vec<Vec3>, Vec<[u32; 3]>)) -> Standing<'a> {
    Standing { positions_world: &mesh.0, normals_world: &mesh.1, triangles: &mesh.2, is_glossy: true }
}

/// What a row says under light of a constant radiance of 1.
fn under_a_white_sky(row: &[f16]) -> f64 {
    row[0].to_f64() * (4.0 * std::f64::consts::PI).sqrt()
}

#[test]
fn an_open_vertex_is_the_lambert_lobe_and_16_bits_cost_half_a_thousandth() {
    let mesh = (
        vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        vec![Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.48, -0.6, 0.64)],
        vec![[0, 1, 2]],
    );
    for order in 1..=6 {
        let baked = bake(&[standing(&mesh)], order, 64, &|_| ());
        for (row, normal) in baked[0].rows.chunks(order * order).zip(&mesh.1) {
            let mut bands = [0.0f64; 6];
            zonal::lambert(order, &mut bands);
            let mut exact = [0.0f64; 36];
            zonal::rotate(&bands[..order], normal.as_dvec3().to_array(), &mut exact);
            for (t, exact) in row.iter().zip(exact) {
                // The tilted vertices' own triangle blocks nothing that lies above their lifted start.
                let tolerance = exact.abs() / 2048.0 + 1e-7;
                assert!(
                    (t.to_f64() - exact).abs() <= tolerance || normal.z < 1.0,
                    "order {order}: {t} {exact}"
                );
            }
        }
    }
}

#[test]
fn a_lid_takes_its_form_factor_and_the_light_from_above() {
    // A point under the middle of a parallel square of side 2 at height 1: F = 4 atan(1/sqrt 2)/(pi sqrt 2) = 0.5541.
    let mut floor = sheet(0.0, 10.0);
    floor.0.push(Vec3::ZERO);
    floor.1.push(Vec3::Z);
    let lid = sheet(1.0, 1.0);
    let baked = bake(&[standing(&floor), standing(&lid)], 4, 1024, &|_| ());
    let row = &baked[0].rows[4 * 16..];
    // The spiral of 1024 rays counts an area with 4 straight edges: 0.005 measured for the openness.
    assert!((under_a_white_sky(row) - (1.0 - 0.5541)).abs() < 0.01, "{}", under_a_white_sky(row));
    // Light from straight above is blocked, light from the side is not: band 1's z falls, far more than the mean.
    let mut bands = [0.0f64; 4];
    zonal::lambert(4, &mut bands);
    let open_z = bands[1];
    assert!(row[2].to_f64() < 0.4 * open_z, "{} of {open_z}", row[2]);
    // By symmetry nothing leans to a side.
    assert!(row[1].to_f64().abs() < 0.01 && row[3].to_f64().abs() < 0.01);
    let few = bake(&[standing(&floor), standing(&lid)], 4, DEFAULT_RAYS, &|_| ());
    assert!((under_a_white_sky(&few[0].rows[64..]) - 0.4459).abs() < 0.02);
}

/// 1 - sum of b_i y_i.
fn seen_along(row: &[f64], direction: Vec3) -> f64 {
    let mut y = [0.0f64; 36];
    basis::evaluate(row.len().isqrt(), direction.as_dvec3().to_array(), &mut y);
    1.0 - row.iter().zip(y).map(|(b, y)| b * y).sum::<f64>()
}

#[test]
fn what_is_blocked_is_nothing_in_the_open_and_a_lid_s_solid_angle_under_it() {
    let open = (vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![Vec3::Z; 3], vec![[0, 1, 2]]);
    assert!(bake(&[standing(&open)], 6, 64, &|_| ())[0].blocked.iter().all(|b| *b == f16::ZERO));
    // A square of half side 1 at height 1 above a point: its solid angle is a sixth of the sphere's.
    let mut floor = sheet(0.0, 10.0);
    floor.0.push(Vec3::ZERO);
    floor.1.push(Vec3::Z);
    let lid = sheet(1.0, 1.0);
    for order in 2..=6 {
        let baked = bake(&[standing(&floor), standing(&lid)], order, 4096, &|_| ());
        let count = order * order;
        let row: Vec<f64> = baked[0].blocked[4 * count..].iter().map(|b| b.to_f64()).collect();
        // And as much as its mirror image. Rays start a ten-thousandth of the diagonal higher, 3 mm: 0.25 %.
        let solid_angle = row[0] * (4.0 * std::f64::consts::PI).sqrt();
        assert!((solid_angle - 4.0 * std::f64::consts::PI / 3.0).abs() < 0.02, "{solid_angle}");
        // Even about the horizon: odd l + m vanish.
        for (i, b) in row.iter().enumerate() {
            let (l, m) = (i.isqrt() as i64, i as i64 - (i.isqrt() * (i.isqrt() + 1)) as i64);
            assert!((l + m) % 2 == 0 || b.abs() < 1e-6, "{i}: {b}");
        }
        let (up, side) = (seen_along(&row, Vec3::Z), seen_along(&row, Vec3::X));
        assert!((up - seen_along(&row, Vec3::NEG_Z)).abs() < 1e-6);
        assert!(order < 4 || (up < 0.2 && side > 0.8), "order {order}: {up} {side}");
    }
}

#[test]
fn sixteen_bits_of_visibility_cost_less_than_a_thousandth() {
    let (floor, lid) = (sheet(0.0, 1.0), sheet(0.5, 0.7));
    let meshes = [standing(&floor), standing(&lid)];
    let baked = bake(&meshes, 6, 256, &|_| ());
    let positions: Vec<Vec3> = meshes.iter().flat_map(|m| m.positions_world.iter().copied()).collect();
    let bvh = Bvh::build(&positions, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
    let (low, high) = bvh.bounds().unwrap();
    let even = spiral::upper(256, spiral::evenly);
    let lift = LIFT * low.distance(high);
    let baker = Baker { bvh, lift, order: 6, lambert: lambert(6), lobe: Vec::new(), even };
    let (mut worst, mut blocked) = (0.0f64, 0.0f64);
    for (k, position) in floor.0.iter().enumerate() {
        let exact = baker.hidden(*position, Vec3::Z);
        let kept: Vec<f64> = baked[0].blocked[36 * k..36 * (k + 1)].iter().map(|b| b.to_f64()).collect();
        blocked = blocked.max(exact[0]);
        for direction in spiral::upper(200, spiral::evenly) {
            worst = worst.max((seen_along(&kept, direction) - seen_along(&exact, direction)).abs());
        }
    }
    println!("V is off by {worst:.1e}");
    // Measured 1.7e-4.
    assert!(blocked > 0.1 && worst < 5e-4, "{blocked} {worst}");
}

#[test]
fn a_lower_order_is_the_beginning_of_a_higher_one() {
    let (floor, lid) = (sheet(0.0, 3.0), sheet(0.5, 1.0));
    let six = bake(&[standing(&floor), standing(&lid)], 6, 64, &|_| ());
    let three = bake(&[standing(&floor), standing(&lid)], 3, 64, &|_| ());
    for (a, b) in six[0].rows.chunks(36).zip(three[0].rows.chunks(9)) {
        assert_eq!(&a[..9], b);
    }
}

#[test]
fn threads_change_nothing_and_progress_ends_at_one() {
    let (floor, lid) = (sheet(0.0, 3.0), sheet(0.5, 1.0));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let most = std::sync::Mutex::new(0.0f32);
        let baked = pool.install(|| {
            bake(&[standing(&floor), standing(&lid)], 4, 32, &|share| {
                let mut most = most.lock().unwrap();
                *most = most.max(share);
            })
        });
        assert_eq!(*most.lock().unwrap(), 1.0);
        baked
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn hopeless_meshes_are_taken() {
    assert!(bake(&[], 4, 16, &|_| ()).is_empty());
    let mut mesh = sheet(0.0, 1.0);
    mesh.1 = vec![Vec3::ZERO, Vec3::NAN];
    mesh.2.push([0, 1, 99]);
    mesh.0[3] = Vec3::NAN;
    let baked = bake(&[standing(&mesh)], 9, 0, &|_| ());
    assert_eq!(baked[0].rows.len(), 4 * 36);
    assert!(baked[0].rows.iter().all(|t| t.is_finite()));
    assert!((under_a_white_sky(&baked[0].rows) - 1.0).abs() < 1e-3);
}

proptest! {
    #[test]
    fn a_white_sky_gives_between_nothing_and_all(
        height in 0.01f32..2.0,
        half in 0.01f32..4.0,
        tilt in prop::array::uniform3(-1.0f32..1.0),
    ) {
        let mut floor = sheet(0.0, 5.0);
        floor.1 = vec![(Vec3::Z + 0.5 * Vec3::from(tilt)).normalize_or(Vec3::Z); 4];
        let lid = sheet(height, half);
        for object in bake(&[standing(&floor), standing(&lid)], 4, 32, &|_| ()) {
            for row in object.rows.chunks(16) {
                let white = under_a_white_sky(row);
                prop_assert!((-1e-3..=1.001).contains(&white), "{}", white);
                prop_assert!(row.iter().all(|t| t.is_finite() && t.to_f64().abs() < 0.6));
            }
        }
    }
}
