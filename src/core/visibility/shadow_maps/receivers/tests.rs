//! Maps hold every shadow that is seen, and no more than they must.
use super::*;
use crate::math::{dice::Dice, lens::Distortion};
use crate::model::light::HardLight;
use crate::visibility::shadow_maps::{EDGE_TEXELS, ShadowCamera, ShadowMapSet, axes};

const TEXELS: u32 = 512;
const BENT: Distortion = Distortion::RadialTangential([-0.28, 0.07, 0.001, -0.0005, 0.0, 0.0, 0.0, 0.0]);

/// Numbers and directions by chance.
struct Draws(Dice);

impl Draws {
    fn next(&mut self) -> f64 {
        self.0.unit()
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

fn lens(distortion: Distortion) -> Lens {
    Lens { distortion, ..Lens::pinhole(640, 480, 500.0, 510.0, 322.0, 236.0) }
}

/// A square on z = 0 of half that many metres, in so many squares a side; it looks up.
fn ground(half: f32, cells: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let at = |i: u32| half * (2.0 * i as f32 / cells as f32 - 1.0);
    let positions =
        (0..=cells).flat_map(|j| (0..=cells).map(move |i| Vec3::new(at(i), at(j), 0.0))).collect();
    let corner = |i: u32, j: u32| j * (cells + 1) + i;
    let squares = (0..cells).flat_map(|j| (0..cells).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    (positions, triangles.collect())
}

fn on_ground(half: f32, cells: u32) -> Receivers {
    let (positions, triangles) = ground(half, cells);
    let mut receivers = Receivers::default();
    receivers.load(&positions, &triangles, &vec![true; triangles.len()]);
    receivers
}

fn corners(low: Vec3, high: Vec3) -> [Vec3; 8] {
    std::array::from_fn(|k| {
        let of = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
        Vec3::new(of(0), of(1), of(2))
    })
}

fn fitted(light: DVec3, casters: &[Vec3], receivers: &Receivers) -> Option<ShadowCamera> {
    ShadowCamera::fit_soft(light.as_vec3().to_array(), casters.iter().copied(), receivers, TEXELS, 0.0)
}

/// Whether a point lies within the rectangle around casters in a light's plane, or at most so far beside it.
fn is_among(light: DVec3, casters: &[Vec3], p: DVec3, beside: f32) -> bool {
    let (right, up) = axes(light.as_vec3().as_dvec3().normalize());
    [right, up].iter().all(|axis| {
        let of = |q: DVec3| axis.dot(q);
        let (low, high) = casters.iter().fold((f64::MAX, f64::MIN), |(low, high), c| {
            (low.min(of(c.as_dvec3())), high.max(of(c.as_dvec3())))
        });
        let beside = f64::from(beside);
        (low - beside..=high + beside).contains(&of(p))
    })
}

#[test]
fn every_shadow_that_is_seen_lies_inside_of_the_map() {
    let mut draws = Draws(Dice::new(7));
    let (mut checked, mut finer, mut none) = (0, 0, 0);
    for round in 0..600 {
        let mut receivers = on_ground(20.0, if round % 3 == 0 { 16 } else { 1 });
        let (x, y) = (draws.between(-0.4, 0.4), draws.between(-0.4, 0.4));
        let target = DVec3::new(x, y, draws.between(-0.3, 0.3));
        let eye = target + draws.direction() * draws.between(0.1, 2.0);
        let pose = Pose::look_at(eye, target, DVec3::new(0.1, 0.2, 0.97));
        let lens = lens(if round % 2 == 0 { BENT } else { Distortion::None });
        let (low, high) = (Vec3::new(0.2, -0.1, 0.05), Vec3::new(0.5, 0.3, 0.8));
        let body = ShadowedBody { low, high, is_mirror: false };
        receivers.see(&lens, &pose, [body].into_iter());
        let casters = corners(low, high);
        let light = draws.direction();
        let camera = fitted(light, &casters, &receivers);
        let whole = fitted(light, &casters, &Receivers::default()).unwrap();
        none += usize::from(camera.is_none());
        finer += usize::from(camera.is_some_and(|c| c.texel_m < 0.6 * whole.texel_m));
        for _ in 0..200 {
            let pixel = DVec2::new(draws.between(0.0, 640.0), draws.between(0.0, 480.0));
            let ray = pose.rotate(lens.unproject(pixel).unwrap());
            // Of the ground, if it faces the light on this side; of the body, what is met first.
            let t = -eye.z / ray.z;
            let mut seen = Vec::new();
            let p = eye + t * ray;
            if t > 0.0 && p.truncate().abs().max_element() < 20.0 && light.z * eye.z > 0.0 {
                seen.push(p);
            }
            let slabs: [[f64; 2]; 3] = std::array::from_fn(|a| {
                let at = |bound: f32| (f64::from(bound) - eye[a]) / ray[a];
                let (s, t) = (at(low[a]), at(high[a]));
                [s.min(t), s.max(t)]
            });
            let first = slabs.iter().map(|s| s[0]).fold(0.0, f64::max);
            let last = slabs.iter().map(|s| s[1]).fold(f64::MAX, f64::min);
            if first <= last {
                seen.extend([first, last].map(|t| eye + t * ray));
            }
            // A filter of 8 taps reaches 3.5 texels; 0.05 for positions of 32 bits, in maps of 64 times finer texels.
            for reach in [0.0, 3.5] {
                let beside = reach * camera.map_or(whole.texel_m, |c| c.texel_m);
                for p in seen.iter().filter(|p| is_among(light, &casters, **p, beside)) {
                    let [x, y, _] = camera.expect("a shadow may be seen here").map(p.as_vec3());
                    let edge = EDGE_TEXELS - reach - 0.05;
                    let inside = edge..=TEXELS as f32 - edge;
                    assert!(inside.contains(&x) && inside.contains(&y), "round {round}: {p} at {x} {y}");
                    checked += 1;
                }
            }
        }
    }
    println!("{checked} points, {finer} maps finer, {none} not needed");
    assert!(checked > 20_000 && finer > 60 && none > 25, "{checked} {finer} {none}");
}

#[test]
fn where_all_shadows_are_seen_the_map_is_as_it_is_without_a_camera() {
    let mut receivers = on_ground(6.0, 1);
    let pose = Pose::look_at(DVec3::new(0.6, -2.5, 3.0), DVec3::new(0.0, 0.0, 0.1), DVec3::Z);
    let (low, high) = (Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.1, 0.1, 0.3));
    let casters = corners(low, high);
    let mut draws = Draws(Dice::new(1));
    for bodies in [&[ShadowedBody { low, high, is_mirror: false }][..], &[]] {
        for distortion in [Distortion::None, BENT] {
            receivers.see(&lens(distortion), &pose, bodies.iter().copied());
            for _ in 0..100 {
                // Shadows of at most a metre.
                let side = draws.direction();
                let light = DVec3::new(0.5 * side.x, 0.5 * side.y, 0.2 + side.z.abs()).normalize();
                let with = fitted(light, &casters, &receivers).unwrap();
                assert_eq!(with, fitted(light, &casters, &Receivers::default()).unwrap());
            }
        }
    }
}

/// An upright board on the ground, and a camera close to the top edge of its shadow: how far the shadow that is read from
/// the map is from the exact one.
#[test]
fn a_shadow_seen_from_close_by_is_drawn_finer() {
    let board = [
        Vec3::new(-0.5, 0.0, 0.0),
        Vec3::new(0.5, 0.0, 0.0),
        Vec3::new(0.5, 0.0, 1.0),
        Vec3::new(-0.5, 0.0, 1.0),
    ];
    let triangles = [[0, 1, 2], [0, 2, 3]];
    // The shadow of a point at height z lies at its x + 0.4 z and at y = 1.25 z.
    let light = DVec3::new(-0.4, -1.25, 1.0).normalize();
    let hard =
        [HardLight { to_light_world: light.as_vec3().to_array(), irradiance_rgb: [1.0; 3], extent_rad: 0.0 }];
    let exact = |p: Vec3| p.y > 0.0 && p.y < 1.25 && (p.x - 0.32 * p.y).abs() < 0.5;
    let lens = lens(Distortion::None);
    let pose = Pose::look_at(DVec3::new(0.9, 1.1, 0.2), DVec3::new(0.88, 1.24, 0.0), DVec3::Z);
    let mut seen = on_ground(10.0, 1);
    seen.see(&lens, &pose, std::iter::empty());
    let error = |receivers: &Receivers| {
        let mut maps = ShadowMapSet::default();
        maps.fit(&hard, &board, &triangles, receivers, 1024, 4);
        maps.draw(&board, &triangles);
        let (mut sum, mut dark) = (0.0, 0);
        for i in 0..640 * 480 {
            let pixel = DVec2::new(f64::from(i % 640) + 0.5, f64::from(i / 640) + 0.5);
            let ray = pose.rotate(lens.unproject(pixel).unwrap());
            let p = (pose.translation - ray * (pose.translation.z / ray.z)).as_vec3();
            let visible = maps.visibility(0, 4, p, light.z as f32);
            sum += (visible - if exact(p) { 0.0 } else { 1.0 }).abs();
            dark += usize::from(exact(p));
        }
        assert!((50_000..250_000).contains(&dark), "{dark}");
        (sum / (640.0 * 480.0), maps.cameras()[0].unwrap().texel_m)
    };
    let ((whole, whole_m), (fitted, fitted_m)) = (error(&Receivers::default()), error(&seen));
    println!("mean error {whole:.5} -> {fitted:.5}, texel {whole_m:.6} -> {fitted_m:.6} m");
    assert!(fitted_m < 0.25 * whole_m, "{fitted_m} {whole_m}");
    assert!(fitted < 0.25 * whole, "{fitted} {whole}");
}

#[test]
fn a_light_under_the_horizon_of_all_that_is_seen_has_no_map() {
    let (low, high) = (Vec3::new(-0.2, -0.2, 0.3), Vec3::new(0.2, 0.2, 0.6));
    let casters = corners(low, high);
    let triangles = [[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]];
    let light = |x: f32, z: f32| HardLight {
        to_light_world: Vec3::new(x, 0.1, z).normalize().to_array(),
        irradiance_rgb: [1.0; 3],
        extent_rad: 0.01,
    };
    let lights = [light(0.2, 1.0), light(0.2, -1.0), light(0.5, -1.0), light(1.0, 0.05)];
    let mut receivers = on_ground(3.0, 1);
    let mut maps = ShadowMapSet::default();
    let mut has_map = |pose: &Pose, bodies: &[ShadowedBody]| {
        receivers.see(&lens(Distortion::None), pose, bodies.iter().copied());
        maps.fit(&lights, &casters, &triangles, &receivers, 256, 4);
        maps.draw(&casters, &triangles);
        for (k, camera) in maps.cameras().iter().enumerate().filter(|(_, camera)| camera.is_none()) {
            assert!(maps.depth(k).is_empty() && maps.flat_light(k, 4, 1.0).is_none(), "{camera:?}");
        }
        maps.cameras().iter().map(Option::is_some).collect::<Vec<_>>()
    };
    let body = |is_mirror| [ShadowedBody { low, high, is_mirror }];
    // Down on the ground under the body, which is not in the picture; the last light's shadow is too far.
    let down = Pose::look_at(DVec3::new(0.0, 0.5, 0.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Z);
    assert_eq!(has_map(&down, &body(false)), [true, false, false, false]);
    assert_eq!(has_map(&down, &body(true)), [true, false, false, false]);
    // The body is seen: each light throws its shadow on itself.
    let across = Pose::look_at(DVec3::new(0.0, 2.0, 1.0), DVec3::new(0.0, 0.0, 0.3), DVec3::Z);
    assert_eq!(has_map(&across, &body(false)), [true; 4]);
    // From below the ground the others throw the shadow.
    let up = Pose::look_at(DVec3::new(0.0, 0.5, -1.0), DVec3::new(0.0, 0.1, 0.0), DVec3::Z);
    assert_eq!(has_map(&up, &[]), [false, true, true, false]);
    // Past everything, over the ground's end.
    let past = Pose::look_at(DVec3::new(0.0, 2.0, 1.0), DVec3::new(0.0, 5.0, 1.5), DVec3::Z);
    assert_eq!(has_map(&past, &body(true)), [false; 4]);
}

#[test]
fn mirrors_and_wide_lenses_see_all() {
    let (low, high) = (Vec3::splat(-0.1), Vec3::splat(0.1));
    let body = |is_mirror| [ShadowedBody { low, high, is_mirror }].into_iter();
    let mut receivers = on_ground(1.0, 1);
    let pose = Pose::look_at(DVec3::new(0.0, 1.0, 0.2), DVec3::new(0.0, 0.05, 0.1), DVec3::Z);
    let narrow = Lens::pinhole(64, 48, 400.0, 400.0, 32.0, 24.0);
    let mut sees_all = |lens: &Lens, is_mirror| {
        receivers.see(lens, &pose, body(is_mirror));
        receivers.is_everywhere
    };
    assert!(!sees_all(&narrow, false) && sees_all(&narrow, true));
    let wide = |fx| Lens {
        distortion: Distortion::Equidistant([0.0; 4]),
        ..Lens::pinhole(640, 480, fx, fx, 320.0, 240.0)
    };
    // 400 pixels off the axis: 1.33 or 2 radians.
    assert!(!sees_all(&wide(300.0), false) && sees_all(&wide(200.0), false));
    for bad in [Lens { fx: 0.0, ..narrow }, Lens { fx: f64::NAN, ..narrow }] {
        assert!(sees_all(&bad, false), "{bad:?}");
    }
    let nowhere = Pose { translation: DVec3::splat(f64::NAN), ..pose };
    receivers.see(&narrow, &nowhere, body(false));
    assert!(receivers.is_everywhere);
}

#[test]
fn the_cone_holds_the_picture_and_little_more() {
    let mut draws = Draws(Dice::new(3));
    for distortion in [Distortion::None, BENT, Distortion::Equidistant([-0.02, 0.005, -0.003, 0.0006])] {
        let lens = lens(distortion);
        let sides = cone(&lens).unwrap();
        let mut nearest = [f64::MAX; SIDES];
        for k in 0..40_000 {
            // A quarter of them on the border.
            let mut at = [draws.next(), draws.next()];
            if k % 4 == 0 {
                at[k / 4 % 2] = (k / 8 % 2) as f64;
            }
            let pixel = DVec2::new(640.0 * at[0], 480.0 * at[1]);
            let ray = lens.unproject(pixel).unwrap();
            for (nearest, side) in nearest.iter_mut().zip(sides) {
                *nearest = nearest.min(side.dot(ray / ray.z));
            }
        }
        // The room left, on the plane at a distance of 1: about a pixel.
        assert!(nearest.iter().all(|n| (0.0..0.004).contains(n)), "{distortion:?}: {nearest:?}");
    }
}
