use super::*;
use crate::math::sh::{basis, zonal};
use proptest::prelude::*;
use std::f32::consts::PI;

fn sphere(centre: [f32; 3], radius_m: f32) -> BlockerSphere {
    BlockerSphere { centre_world: Vec3::from_array(centre), radius_m, body: 0 }
}

fn of(spheres: &[BlockerSphere], rung: Rung, order: usize, directions: usize) -> Blockers {
    let mut blockers = Blockers::new();
    blockers.prepare(spheres, rung, order, directions);
    blockers
}

fn at_origin(blockers: &Blockers) -> [f32; 36] {
    let mut v = [7.0; 36];
    blockers.visibility(Vec3::ZERO, Vec3::Z, None, &mut v);
    v
}

fn whole() -> f32 {
    (4.0 * PI).sqrt()
}

/// A transfer row that weighs every coefficient.
fn transfer() -> [[f32; 3]; 36] {
    std::array::from_fn(|i| [1.0 / (1.0 + i as f32), 0.3 * (i as f32).sin(), 0.2])
}

fn any_spheres(most: usize) -> impl Strategy<Value = Vec<BlockerSphere>> {
    let one = (prop::array::uniform3(-1.5..1.5_f32), 0.02..1.2_f32, 0..3_u32)
        .prop_map(|(centre, radius, body)| BlockerSphere { body, ..sphere(centre, radius) });
    prop::collection::vec(one, 0..most)
}

#[test]
fn nothing_in_the_way_is_exactly_open() {
    // Under the horizon, of the receiver's own body, without extent, nowhere.
    let hopeless = [
        sphere([0.0, 0.3, -1.0], 0.9),
        BlockerSphere { body: 5, ..sphere([0.0, 0.0, 1.0], 0.5) },
        sphere([0.0, 0.0, 1.0], 0.0),
        sphere([0.0, 0.0, 1.0], -1.0),
        sphere([f32::NAN, 0.0, 1.0], 0.5),
        sphere([0.0, f32::INFINITY, 1.0], 0.5),
        sphere([0.0, 0.0, 1.0], f32::NAN),
    ];
    for rung in Rung::ALL {
        for order in 2..=6 {
            let blockers = of(&hopeless, rung, order, 64);
            let mut v = [7.0; 36];
            blockers.visibility(Vec3::ZERO, Vec3::Z, Some(5), &mut v);
            assert_eq!(v[0], whole(), "{rung:?} {order}");
            assert!(v[1..].iter().all(|v| *v == 0.0), "{rung:?} {order}: {v:?}");
            let (blocked, open) = blockers.shade(Vec3::ZERO, Vec3::Z, Some(5), &transfer());
            assert_eq!(blocked, open);
            let (mut plane, mut out) = (BlockedPlane::default(), [[0.0; 3]]);
            blockers.plane(Vec3::Z, Some(5), &transfer(), &mut plane);
            blockers.shade_plane(&plane, &[Vec3::ZERO], &mut out);
            assert_eq!(out[0], plane.unblocked());
        }
    }
}

#[test]
fn one_sphere_is_eq_23() {
    let axis = Vec3::new(0.36, -0.48, 0.8);
    for half_angle in [4.0_f32, 20.0, 40.0] {
        let s = sphere((axis * 2.0).to_array(), 2.0 * half_angle.to_radians().sin());
        for order in 2..=6 {
            let mut zonal = [0.0; 6];
            crate::math::sh::cap::visible(order, half_angle.to_radians().sin().powi(2), &mut zonal);
            let mut truth = [0.0; 36];
            zonal::rotate(&zonal[..order], axis.to_array(), &mut truth);
            // Relative error of V, from the ladder at 5 to 30 degrees: chain is exact; the others grow with the cap.
            for (rung, most) in [
                (Rung::Chain, 1e-6),
                (Rung::Squared, 0.05),
                (Rung::Hybrid, 0.08),
                (Rung::Linear, 0.2),
                (Rung::Directions, 0.02),
            ] {
                let v = at_origin(&of(&[s], rung, order, 256));
                let off: f32 = v.iter().zip(truth).map(|(v, t)| (v - t).powi(2)).sum();
                let off = off.sqrt() / whole();
                assert!(off < most, "{rung:?} order {order} at {half_angle}: {off}");
            }
            let mean = at_origin(&of(&[s], Rung::Dc, order, 64));
            assert!((mean[0] - truth[0]).abs() < 1e-6 && mean[1..].iter().all(|v| *v == 0.0));
        }
    }
}

#[test]
fn a_receiver_inside_sees_a_hemisphere_hidden() {
    for rung in Rung::ALL {
        let deep = at_origin(&of(&[sphere([0.0, 0.0, 0.0], 1.0)], rung, 4, 128));
        let shallow = at_origin(&of(&[sphere([0.0, 0.0, 0.5], 1.0)], rung, 4, 128));
        assert_eq!(deep, shallow, "{rung:?}: about the normal");
        let most = if rung == Rung::Linear { 0.5 } else { 0.15 };
        assert!((deep[0] / whole() - 0.5).abs() < most, "{rung:?}: {}", deep[0] / whole());
    }
}

#[test]
fn a_sphere_behind_another_changes_nothing() {
    let front = sphere([0.1, 0.0, 1.0], 0.4);
    let behind = BlockerSphere { body: 1, ..sphere([0.25, 0.05, 2.4], 0.3) };
    for rung in [Rung::Dc, Rung::Linear, Rung::Hybrid, Rung::Squared, Rung::Chain] {
        let alone = at_origin(&of(&[front], rung, 4, 64));
        assert_eq!(at_origin(&of(&[front, behind], rung, 4, 64)), alone, "{rung:?}");
        assert_eq!(at_origin(&of(&[behind, front], rung, 4, 64)), alone, "{rung:?}");
        assert_eq!(at_origin(&of(&[front; 200], rung, 4, 64)), alone, "{rung:?}");
        let others: Vec<_> = (0..50).map(|body| BlockerSphere { body, ..front }).collect();
        assert_eq!(at_origin(&of(&others, rung, 4, 64)), alone, "{rung:?}: one of each body");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn groups_of_receivers_change_nothing(
        spheres in any_spheres(12), points in prop::collection::vec(prop::array::uniform3(-2.0..2.0_f32), 1..20),
        order in 2..=6_usize, tilt in prop::array::uniform3(-1.0..1.0_f32),
    ) {
        let points: Vec<Vec3> = points.into_iter().map(Vec3::from_array).collect();
        let normal = (Vec3::Z + 0.8 * Vec3::from_array(tilt)).normalize_or(Vec3::Z);
        for rung in Rung::ALL {
            let blockers = of(&spheres, rung, order, 64);
            let mut many = Vec::new();
            blockers.visibility_many(&points, &vec![normal; points.len()], Some(2), |_, v| many.push(*v));
            prop_assert_eq!(many.len(), points.len());
            let mut plane = BlockedPlane::default();
            blockers.plane(normal, Some(2), &transfer(), &mut plane);
            let mut shaded = vec![[0.0; 3]; points.len()];
            blockers.shade_plane(&plane, &points, &mut shaded);
            for ((point, many), shaded) in points.iter().zip(&many).zip(&shaded) {
                let mut one = [0.0; 36];
                blockers.visibility(*point, normal, Some(2), &mut one);
                prop_assert_eq!(&one, many, "{:?}", rung);
                let (blocked, open) = blockers.shade(*point, normal, Some(2), &transfer());
                prop_assert_eq!(open, plane.unblocked());
                for (a, b) in blocked.iter().zip(shaded) {
                    let most = if rung == Rung::Directions { 2e-5 } else { 0.0 };
                    prop_assert!((a - b).abs() <= most, "{:?}: {} and {}", rung, a, b);
                }
            }
        }
    }

    #[test]
    fn visibility_stays_possible(spheres in any_spheres(60), order in 2..=6_usize, count in 32..=256_usize) {
        for rung in Rung::ALL {
            possible(&at_origin(&of(&spheres, rung, order, count)), rung, order);
        }
    }

    #[test]
    fn crowds_do_not_blow_up(
        centre in prop::array::uniform3(-1.0..1.0_f32), spread in prop::sample::select(vec![0.0, 1e-3, 0.1, 0.5]),
        radius in 0.05..0.8_f32, order in 2..=6_usize, seed in prop::collection::vec(-1.0..1.0_f32, 600),
    ) {
        // Of different bodies, so that nothing is left out before the caps are compared.
        let crowd: Vec<BlockerSphere> = (0..200)
            .map(|i| {
                let off: [f32; 3] = std::array::from_fn(|k| centre[k] + spread * seed[3 * i + k]);
                BlockerSphere { body: i as u32, ..sphere(off, radius) }
            })
            .collect();
        for rung in Rung::ALL {
            possible(&at_origin(&of(&crowd, rung, order, 64)), rung, order);
        }
    }
}

/// 0 <= V_0 <= sqrt(4 pi), and the bound of 0 <= V <= 1 on the rest.
fn possible(v: &[f32; 36], rung: Rung, order: usize) {
    assert!(v.iter().all(|v| v.is_finite()), "{rung:?} order {order}: {v:?}");
    assert!((0.0..=whole() * 1.000_001).contains(&v[0]), "{rung:?} order {order}: {}", v[0]);
    let rest = v[1..].iter().map(|v| v * v).sum::<f32>();
    let bound = v[0] * (whole() - v[0]);
    assert!(rest <= bound * 1.00001 + 2e-6, "{rung:?} order {order}: {rest} > {bound}");
}

#[test]
fn directions_do_not_pop() {
    // Spec 7: a sphere of 6 degrees that moves by 0.11 degrees.
    for count in [32, 64, 128, 256] {
        let blockers = |degrees: f32| {
            let (s, c) = degrees.to_radians().sin_cos();
            of(&[sphere([0.6 * s, 0.6 * c, 0.8], 6.0_f32.to_radians().sin())], Rung::Directions, 4, count)
        };
        let mut last = at_origin(&blockers(0.0))[0];
        let mut largest = 0.0_f32;
        for step in 1..=600 {
            let now = at_origin(&blockers(step as f32 * 0.11 / 0.6))[0];
            largest = largest.max((now - last).abs() / whole());
            last = now;
        }
        println!("directions, N = {count}: largest step of the mean visibility {largest:.2e}");
        assert!(largest < 2e-4, "N = {count}: {largest}");
    }
}

#[test]
fn settings_are_taken_into_their_ranges() {
    let blockers = of(&[sphere([0.0, 0.0, 1.0], 0.5)], Rung::Directions, 99, 100_000);
    assert_eq!((blockers.order(), blockers.directions.basis().len()), (6, 256));
    let blockers = of(&[], Rung::Directions, 0, 0);
    assert_eq!((blockers.order(), blockers.directions.basis().len()), (2, 32));
    assert_eq!(blockers.rung(), Rung::Directions);
    // The weights of N directions sum to the sphere, for any N.
    let blockers = of(&[], Rung::Directions, 3, 61);
    let sum: f32 = blockers.directions.basis().iter().map(|row| row[0]).sum();
    let mut y = [0.0; 36];
    basis::evaluate(1, [0.0, 0.0, 1.0], &mut y);
    assert!((sum - 4.0 * PI * y[0]).abs() < 1e-5);
}

/// However narrow the cap, fixed directions hide its own solid angle in the mean over where it stands.
#[test]
fn fixed_directions_hide_small_caps_in_the_mean() {
    for (count, half_angle_deg, most) in
        [(128, 0.5, 0.05), (128, 3.0, 0.05), (64, 6.0, 0.05), (128, 12.0, 0.06)]
    {
        let half_angle = f32::to_radians(half_angle_deg);
        let (mut sum, places) = (0.0f64, 400);
        for k in 0..places {
            let z = (k as f32 + 0.5) / places as f32;
            let axis = ((1.0 - z * z).sqrt() * crate::math::spiral::turn_f32(k)).extend(z);
            let blockers =
                of(&[sphere((3.0 * axis).to_array(), 3.0 * half_angle.sin())], Rung::Directions, 4, count);
            sum += f64::from(1.0 - at_origin(&blockers)[0] / whole());
        }
        let (found, want) = (sum / places as f64, 0.5 * (1.0 - f64::from(half_angle).cos()));
        println!("{half_angle_deg} degrees, {count} directions: {found:.3e} for {want:.3e}");
        assert!((found / want - 1.0).abs() < most, "{half_angle_deg} degrees: {found:e} for {want:e}");
    }
}
