//! Coverage, bias, filter and fit of shadow maps.
use super::*;

/// A sphere of `rows` x 2 rows quads, radius 1.
fn sphere(rows: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let columns = 2 * rows;
    let mut positions = Vec::new();
    for j in 0..=rows {
        for i in 0..=columns {
            let theta = std::f32::consts::PI * j as f32 / rows as f32;
            let phi = std::f32::consts::TAU * i as f32 / columns as f32;
            positions.push(Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
        }
    }
    let mut triangles = Vec::new();
    for j in 0..rows as u32 {
        for i in 0..columns as u32 {
            let a = j * (columns as u32 + 1) + i;
            let b = a + columns as u32 + 1;
            triangles.push([a, b, b + 1]);
            triangles.push([a, b + 1, a + 1]);
        }
    }
    (positions, triangles)
}

fn fibonacci(n: usize) -> impl Iterator<Item = Vec3> {
    (0..n).map(move |j| crate::math::spiral::direction(j, n).as_vec3())
}

#[test]
fn what_faces_the_light_squarely_is_lit() {
    let corner = |x: f32, y: f32| Vec3::new(3.0 + x, y - 7.0, 0.15);
    let top = [corner(0.0, 0.0), corner(0.3, 0.0), corner(0.0, 0.3), Vec3::new(3.0, -7.0, 0.0)];
    let camera = ShadowCamera::fit([0.0, 0.0, 1.0], top.into_iter(), 256).unwrap();
    let mut map = ShadowMap::default();
    map.draw(&camera, &top, &[[0, 1, 2]]);
    for i in 0..400 {
        let p = corner(0.007 * (i % 20) as f32, 0.007 * (i / 20) as f32);
        assert_eq!(visibility(map.depth(), &camera, 4, p, 1.0), 1.0, "{p}");
    }
}

#[test]
fn every_caster_lies_inside_of_the_map_for_every_direction() {
    let corners: Vec<Vec3> = (0..8)
        .map(|k| Vec3::new((k & 1) as f32 * 0.3, (k >> 1 & 1) as f32 * 0.1 - 2.0, (k >> 2) as f32))
        .collect();
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Z, Vec3::new(1e-9, 0.0, 1.0)];
    for w in fibonacci(500).chain(axes) {
        let camera = ShadowCamera::fit(w.to_array(), corners.iter().copied(), 256).unwrap();
        let (inner, outer) = (EDGE_TEXELS - 0.01, 256.0 - EDGE_TEXELS + 0.01);
        for &p in &corners {
            let [x, y, depth] = camera.map(p);
            assert!(x >= inner && x <= outer && y >= inner && y <= outer, "{w}: {x} {y}");
            assert!(depth > 0.0 && depth < 1.0, "{w}: depth {depth}");
        }
        // A metre towards the light is a metre less of depth and no step aside.
        let (there, here) = (camera.map(w.normalize()), camera.map(Vec3::ZERO));
        let step: [f32; 3] = std::array::from_fn(|a| there[a] - here[a]);
        assert!(step[0].abs() < 1e-3 && step[1].abs() < 1e-3, "{w}: {step:?}");
        assert!((step[2] * camera.depth_m + 1.0).abs() < 1e-5, "{w}: {step:?}");
        // The longest extent fills the map up to one rung of the ladder of texel sizes.
        let spans = [0, 1].map(|a| {
            let of = |p: &Vec3| camera.map(*p)[a];
            corners.iter().map(of).fold(f32::MIN, f32::max) - corners.iter().map(of).fold(f32::MAX, f32::min)
        });
        let usable = 256.0 - 2.0 * EDGE_TEXELS - 1.0;
        assert!(spans[0].max(spans[1]) > usable * 0.917, "{w}: {spans:?}");
    }
}

#[test]
fn no_light_or_no_caster_makes_no_camera() {
    let point = [Vec3::ZERO];
    assert!(ShadowCamera::fit([0.0; 3], point.iter().copied(), 64).is_none());
    assert!(ShadowCamera::fit([f32::NAN, 0.0, 1.0], point.iter().copied(), 64).is_none());
    assert!(ShadowCamera::fit([0.0, 0.0, 1.0], std::iter::empty(), 64).is_none());
    let bad = [Vec3::new(f32::INFINITY, 0.0, 0.0)];
    assert!(ShadowCamera::fit([0.0, 0.0, 1.0], bad.iter().copied(), 64).is_none());
}

#[test]
fn neighbouring_triangles_leave_no_gap_and_a_disc_has_its_area() {
    let (positions, triangles) = sphere(24);
    let w = Vec3::new(0.3, -0.5, 0.7).normalize();
    let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 512).unwrap();
    let mut map = ShadowMap::default();
    map.draw(&camera, &positions, &triangles);
    let centre = camera.map(Vec3::ZERO);
    let radius = 1.0 / camera.texel_m;
    let mut covered = 0;
    for (k, &depth) in map.depth().iter().enumerate() {
        let (i, j) = ((k % 512) as f32 + 0.5 - centre[0], (k / 512) as f32 + 0.5 - centre[1]);
        covered += usize::from(depth < EMPTY_DEPTH);
        if i.hypot(j) < 0.97 * radius {
            // Facets of 7.5 degrees lie at most 0.6 % of the radius inside of the sphere.
            let exact = centre[2] - (1.0 - (i * i + j * j) / (radius * radius)).sqrt() / camera.depth_m;
            assert!((depth - exact).abs() * camera.depth_m < 0.03, "{i} {j}: {depth} {exact}");
        }
    }
    let area = covered as f32 / (std::f32::consts::PI * radius * radius);
    assert!((0.985..1.0).contains(&area), "{area}");
}

#[test]
fn no_acne_on_a_sphere_and_no_light_behind_it() {
    let (positions, triangles) = sphere(64);
    let (mut worst, mut leak) = (1.0f32, 0.0f32);
    for w in [Vec3::Z, Vec3::new(0.6, 0.1, 0.2).normalize(), Vec3::new(-0.5, 0.5, 0.7).normalize()] {
        let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 1024).unwrap();
        let mut map = ShadowMap::default();
        map.draw(&camera, &positions, &triangles);
        for t in &triangles {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            let normal = (b - a).cross(c - a);
            if normal.length() < 1e-6 {
                continue;
            }
            let cosine = normal.normalize().dot(w);
            let seen = visibility(map.depth(), &camera, 4, (a + b + c) / 3.0, cosine);
            if cosine > 0.1 {
                worst = worst.min(seen);
            } else if cosine < -0.3 {
                // Not asked for in rendering: turned away. The map must know all the same.
                leak = leak.max(seen);
            }
        }
    }
    assert!(worst == 1.0, "lit facets must be wholly lit: {worst}");
    assert!(leak == 0.0, "the far side must be dark: {leak}");
}

#[test]
fn a_body_on_the_ground_has_no_bright_gap_at_its_foot() {
    // A cube of 1 m on z = 0 under a sun of 35 degrees: points of the ground 2 mm beside its shadowed side.
    let positions: Vec<Vec3> =
        (0..8).map(|k| Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> =
        quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    let w = Vec3::new(-0.82, 0.0, 0.5736).normalize();
    let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 1024).unwrap();
    let mut map = ShadowMap::default();
    map.draw(&camera, &positions, &triangles);
    for k in 0..90 {
        let y = 0.05 + 0.01 * k as f32;
        let dark = visibility(map.depth(), &camera, 4, Vec3::new(1.002, y, 0.0), w.z);
        assert!(dark == 0.0, "y {y}: {dark}");
        let bright = visibility(map.depth(), &camera, 4, Vec3::new(-0.002, y, 0.0), w.z);
        assert!(bright == 1.0, "y {y}: {bright}");
    }
}

#[test]
fn the_filter_is_a_box_of_taps_minus_one_texels() {
    let mut map = vec![EMPTY_DEPTH; 64 * 64];
    for row in map.chunks_mut(64) {
        row[..32].fill(0.25);
    }
    for taps in 2..=8u32 {
        let width = (taps - 1) as f32;
        for k in 0..400 {
            let x = 20.0 + 0.0637 * k as f32;
            let exact = ((x + 0.5 * width - 32.0) / width).clamp(0.0, 1.0);
            let seen = lit(&map, 64, taps, x, 30.3, 0.5);
            assert!((seen - exact).abs() < 1e-5, "{taps} taps at {x}: {seen}, not {exact}");
        }
    }
    assert_eq!(lit(&map, 64, 1, 31.9, 3.0, 0.5), 0.0);
    assert_eq!(lit(&map, 64, 1, 32.1, 3.0, 0.5), 1.0);
    assert_eq!(lit(&map, 64, 4, 10.0, 10.0, 0.2), 1.0, "in front of the caster");
    assert_eq!(lit(&map, 64, 4, 10.0, 10.0, 7.0), 0.0, "far behind the caster");
    assert_eq!(lit(&map, 64, 4, 40.0, 10.0, 7.0), 1.0, "far behind nothing");
    for outside in [-1e30, -20.0, 70.0, 1e30, f32::NAN, f32::INFINITY] {
        assert_eq!(lit(&map, 64, 4, outside, 10.0, 0.5), 1.0);
        assert_eq!(lit(&map, 64, 4, 10.0, outside, 0.5), 1.0);
    }
}

#[test]
fn bias_is_bounded_and_finite() {
    assert_eq!(bias_m(0.01, 2.0, 1.0, 0.2), 0.0);
    assert_eq!(bias_m(0.01, 2.0, 0.0, 0.2), 0.2);
    assert_eq!(bias_m(0.01, 2.0, -0.5, 0.2), 0.2);
    assert_eq!(bias_m(0.01, 2.0, f32::MIN_POSITIVE, 0.2), 0.2);
    assert_eq!(bias_m(0.01, 2.0, 1.0 + 1e-6, 0.2), 0.0);
}

/// Spheres in a row, some lights, and their maps in bands or whole.
fn maps(lights: usize, texels: u32) -> (ShadowMapSet, Vec<crate::model::light::HardLight>) {
    let lights: Vec<_> = fibonacci(2 * lights)
        .take(lights)
        .map(|w| crate::model::light::HardLight {
            to_light_world: w.to_array(),
            irradiance_rgb: [1.0; 3],
            extent_rad: 0.01,
        })
        .collect();
    let (unit, mut triangles) = sphere(24);
    let count = unit.len() as u32;
    let balls =
        [(Vec3::new(0.0, 0.0, 0.2), 0.2), (Vec3::new(0.5, 0.1, 0.1), 0.1), (Vec3::new(-0.6, 0.3, 0.5), 0.05)];
    let casters: Vec<Vec3> = balls.iter().flat_map(|(c, r)| unit.iter().map(|p| *c + *r * *p)).collect();
    let one = triangles.clone();
    for k in 1..3 {
        triangles.extend(one.iter().map(|t| t.map(|i| i + k * count)));
    }
    let mut maps = ShadowMapSet::default();
    // What was drawn before must leave no trace.
    let elsewhere: Vec<Vec3> = casters.iter().map(|p| *p * Vec3::new(-0.8, 1.0, 1.3)).collect();
    for casters in [&elsewhere, &casters] {
        maps.fit(&lights, casters, &triangles, &Receivers::default(), texels, 4);
        maps.draw(casters, &triangles);
    }
    for (k, camera) in maps.cameras().iter().enumerate() {
        let mut alone = ShadowMap::default();
        alone.draw(&camera.unwrap(), &casters, &triangles);
        assert_eq!(alone.depth(), maps.depth(k), "light {k}");
        let mut taken_over = ShadowMap::default();
        taken_over.set_depth(alone.depth().to_vec());
        for (y, row) in alone.depth().chunks(camera.unwrap().texels as usize).enumerate() {
            for x in (0..row.len()).filter(|x| row[*x] < EMPTY_DEPTH) {
                let (x, y) = (x as f32, y as f32);
                assert!(alone.reach().is_near(x, y) && taken_over.reach().is_near(x, y));
                assert!(alone.reach().is_near_box([x - 3.0, y], [x, y + 300.0]));
            }
        }
    }
    (maps, lights)
}

#[test]
fn points_of_a_flat_receiver_read_together_get_what_each_gets() {
    for (lights, texels) in [(2, 128), (8, 512)] {
        let (maps, lights) = maps(lights, texels);
        let (mut beside, mut shadowed) = (0, 0);
        for (k, light) in lights.iter().enumerate() {
            let cosine = light.to_light_world[2];
            let Some(flat) = maps.flat_light(k, 4, cosine) else {
                assert!(cosine <= 0.0);
                continue;
            };
            for row in 0..160 {
                for start in 0..8 {
                    let at = |i: usize| {
                        Vec3::new(0.4 * start as f32 - 1.6 + 0.025 * i as f32, 0.02 * row as f32 - 1.6, 0.0)
                    };
                    let points: [[f32; 16]; 3] = std::array::from_fn(|c| std::array::from_fn(|i| at(i)[c]));
                    let visible = maps.visibility_flat(&flat, 4, &points, 16);
                    let near = maps.may_shadow(k, at(0).to_array(), at(15).to_array());
                    for (i, visible) in visible.iter().enumerate() {
                        assert_eq!(*visible, maps.visibility(k, 4, at(i), cosine));
                        assert!(near || *visible == 1.0);
                        shadowed += usize::from(*visible < 1.0);
                    }
                    beside += usize::from(!near);
                }
            }
        }
        assert!(beside > 500 && shadowed > 500, "{beside} {shadowed}");
    }
}
