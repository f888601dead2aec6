use super::*;
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    image::RadianceImage,
    scene::{Material, Mesh},
};
use glam::{DVec3, Mat3, Vec3};
use proptest::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

fn matt(albedo: f32) -> Material {
    Material::Lambert { albedo_rgb: [albedo; 3] }
}

fn body(shape: TraceShape, material: Material) -> TraceBody {
    let name = "body".into();
    TraceBody { name, shape, material, two_sided: false, emission: Emission::None, is_aperture: false }
}

fn ball(centre: Vec3, radius_m: f32, material: Material) -> TraceBody {
    body(TraceShape::Sphere { centre, radius_m }, material)
}

fn quad(corners: [Vec3; 4]) -> TraceShape {
    TraceShape::Mesh(Mesh {
        positions: corners.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    })
}

fn plane(half: f32) -> TraceShape {
    let at = |x: f32, y: f32| Vec3::new(x * half, y * half, 0.0);
    quad([at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)])
}

/// A box seen from inside or outside: corners by the signs of their coordinates.
fn cuboid(half: Vec3, inwards: bool) -> TraceShape {
    let corner = |i: u32| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0f32 } else { 1.0 };
        half * Vec3::new(sign(0), sign(1), sign(2))
    };
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]: &[u32; 4]| match inwards {
        true => [[a, c, b], [a, d, c]],
        false => [[a, b, c], [a, c, d]],
    });
    let positions = (0..8).map(corner).collect();
    TraceShape::Mesh(Mesh { positions, triangles: triangles.collect(), ..Mesh::default() })
}

/// A small picture from above.
fn view(side: u32, eye: DVec3, target: DVec3) -> TraceScene {
    let f = f64::from(side);
    let lens = Lens::pinhole(side, side, f, f, 0.5 * f, 0.5 * f);
    TraceScene::empty(lens, Pose::look_at(eye, target, DVec3::new(0.1, 1.0, 0.2).normalize()))
}

fn settings(samples: u32, samples_a_pass: u32) -> TraceSettings {
    TraceSettings { samples, samples_a_pass, ..TraceSettings::default() }
}

fn traced(scene: &TraceScene, settings: &TraceSettings) -> Traced {
    trace(scene, settings, &|_| ()).unwrap()
}

fn picture_sky(radiance: RadianceImage) -> Environment {
    Environment::Picture { radiance, map_from_world: Mat3::from_rotation_z(0.3) }
}

fn mean(picture: &RadianceImage) -> f64 {
    let all = picture.pixels().as_flattened();
    all.iter().map(|&c| f64::from(c)).sum::<f64>() / all.len() as f64
}

#[test]
fn white_bodies_vanish_in_even_light() {
    let mut scene = view(8, DVec3::new(0.0, -3.0, 1.0), DVec3::ZERO);
    scene.objects.push(ball(Vec3::ZERO, 0.9, matt(1.0)));
    scene.environment = Environment::Constant([1.0; 3]);
    let pictures = traced(&scene, &settings(16, 8));
    // Drawn in proportion to what counts: every sample is 1 but for rounding.
    assert!(pictures.with().pixels().as_flattened().iter().all(|c| (c - 1.0).abs() < 1e-5));
    assert!(pictures.coverage().pixels().contains(&1.0));
    // The same light as a picture is drawn from both sides, which has noise: its mean over the ball is 1.
    scene.environment = picture_sky(RadianceImage::filled(16, 8, [1.0; 3]));
    let pictures = traced(&scene, &settings(1024, 64));
    let error = pictures.noise.with_relative / 8.0;
    assert!((mean(&pictures.with()) - 1.0).abs() < 3.0 * error && error < 1e-3, "{error}");
}

#[test]
fn gloss_neither_makes_nor_loses_light() {
    // Seen straight from above the whole lobe lies above a plane: the energy-safe norm gives all of it back.
    let mut scene = view(4, DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO);
    let gloss = Material::Phong { albedo_rgb: [0.3; 3], specular_rgb: [0.5; 3], exponent: 60.0 };
    scene.objects.push(body(plane(50.0), gloss));
    for (environment, tolerance) in
        [(Environment::Constant([2.0; 3]), 5e-3), (picture_sky(RadianceImage::filled(8, 4, [2.0; 3])), 1e-2)]
    {
        scene.environment = environment;
        let light = mean(&traced(&scene, &settings(512, 64)).with());
        assert!((light - 1.6).abs() < 1.6 * tolerance, "{light}");
    }
    scene.phong_norm = crate::math::sh::zonal::PhongNorm::Paper;
    let light = mean(&traced(&scene, &settings(512, 64)).with());
    let paper = 0.6 + (62.0 / 61.0);
    assert!((light - paper).abs() < 0.01 * paper, "{light} instead of {paper}");
}

#[test]
fn the_sun_on_a_plane_and_the_shadow_of_a_ball() {
    let mut scene = view(32, DVec3::new(0.3, -2.0, 3.0), DVec3::ZERO);
    scene.real.push(body(plane(100.0), matt(0.6)));
    scene.objects.push(ball(Vec3::new(0.0, 0.0, 0.5), 0.4, matt(0.0)));
    let to_light = Vec3::new(0.4, 0.3, 0.8).normalize();
    scene.suns.push(TraceSun { to_light_world: to_light, irradiance_rgb: [3.0, 2.0, 1.0] });
    let pictures = traced(&scene, &settings(16, 8));
    let lit = [3.0, 2.0, 1.0].map(|e| 0.6 * FRAC_1_PI * e * to_light.z);
    let (ratio, without, cover) = (pictures.ratio(), pictures.without(), pictures.coverage());
    let mut dark = 0;
    for y in 0..32 {
        for x in 0..32 {
            for c in 0..3 {
                assert!((without.at(x, y)[c] / lit[c] - 1.0).abs() < 1e-5);
            }
            if *cover.at(x, y) > 0.0 {
                continue;
            }
            // The pixel's corners all in the shadow, or all out of it and away from its edge.
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(dx, dy)| {
                let at = glam::DVec2::new(x as f64 + dx, y as f64 + dy);
                let pose = &scene.world_from_camera;
                let ray = pose.rotate(scene.lens.unproject(at).unwrap());
                let point = pose.translation - ray * (pose.translation.z / ray.z);
                let to = DVec3::new(0.0, 0.0, 0.5) - point;
                to.cross(to_light.as_dvec3()).length()
            });
            if corners.iter().all(|d| *d < 0.4) {
                dark += 1;
                assert_eq!(*ratio.at(x, y), [0.0; 3], "{x} {y}");
            } else if corners.iter().all(|d| *d > 0.5) {
                assert_eq!(*ratio.at(x, y), [1.0; 3], "{x} {y}");
            }
        }
    }
    assert!(dark > 10, "{dark} pixels in shadow");
}

/// Lambert's contour: the form factor of a polygon above the horizon from a point of normal +z.
fn form_factor(point: Vec3, corners: &[Vec3]) -> f64 {
    let at = |i: usize| (corners[i % corners.len()] - point).as_dvec3().normalize();
    let sum: f64 = (0..corners.len())
        .map(|i| {
            let cross = at(i).cross(at(i + 1));
            cross.z / cross.length() * cross.length().atan2(at(i).dot(at(i + 1)))
        })
        .sum();
    sum.abs() / std::f64::consts::TAU
}

#[test]
fn a_square_lamp_gives_its_form_factor() {
    let mut scene = view(6, DVec3::new(0.0, 0.0, 4.0), DVec3::new(0.3, 0.1, 0.0));
    scene.real.push(body(plane(100.0), matt(0.8)));
    // Out of the camera's sight, facing the plane's middle from above.
    let corners = [
        Vec3::new(1.5, -1.0, 2.5),
        Vec3::new(1.5, 1.0, 2.5),
        Vec3::new(3.0, 1.0, 1.0),
        Vec3::new(3.0, -1.0, 1.0),
    ];
    let mut lamp = body(quad(corners), matt(0.0));
    lamp.two_sided = true;
    lamp.emission = Emission::Own([5.0, 4.0, 3.0]);
    scene.real.push(lamp);
    let pictures = traced(&scene, &settings(2048, 256));
    let (with, errors) = (pictures.with(), pictures.with_error());
    let (mut squares, mut count, mut bias, mut worst) = (0.0, 0.0, 0.0, 0.0f64);
    for y in 0..6 {
        for x in 0..6 {
            // The mean over the pixel, by 8 x 8 midpoints.
            let mut exact = 0.0;
            for k in 0..64 {
                let (dx, dy) = ((f64::from(k % 8) + 0.5) / 8.0, (f64::from(k / 8) + 0.5) / 8.0);
                let at = glam::DVec2::new(x as f64 + dx, y as f64 + dy);
                let pose = &scene.world_from_camera;
                let ray = pose.rotate(scene.lens.unproject(at).unwrap());
                let point = pose.translation - ray * (pose.translation.z / ray.z);
                exact += 0.8 * 5.0 * form_factor(point.as_vec3(), &corners) / 64.0;
            }
            let (ours, error) = (f64::from(with.at(x, y)[0]), f64::from(errors.at(x, y)[0]));
            squares += ((ours - exact) / error).powi(2);
            bias += ours / exact - 1.0;
            worst = worst.max((ours / exact - 1.0).abs());
            count += 1.0;
        }
    }
    // Eight passes: the mean of t^2 with 7 degrees of freedom is 1.4; its spread over 36 pixels is about 0.5.
    let (squares, bias) = (squares / count, bias / count);
    assert!((0.5..2.6).contains(&squares), "{squares}");
    // Measured 5e-4 and 0.02.
    assert!(bias.abs() < 1e-3 && worst < 0.03, "bias {bias}, worst {worst}");
}

#[test]
fn light_in_a_closed_box_is_its_series() {
    // Walls that all send out 1 and reflect half: 1 + 1/2 + 1/4 .., as far as bounces go.
    let mut scene = view(4, DVec3::new(0.2, -0.3, 0.1), DVec3::new(1.0, 1.0, 0.4));
    let mut walls = body(cuboid(Vec3::new(1.0, 1.5, 0.8), true), matt(0.5));
    walls.emission = Emission::Own([1.0; 3]);
    scene.real.push(walls);
    // A black ball takes light; without it the series holds.
    scene.objects.push(ball(Vec3::new(-0.5, 0.8, -0.3), 0.3, matt(0.0)));
    for bounces in [0, 1, 3] {
        let pictures = traced(&scene, &TraceSettings { bounces, ..settings(256, 64) });
        let series: f64 = (0..bounces + 2).map(|k| 0.5f64.powi(k as i32)).sum();
        let light = mean(&pictures.without());
        let error = light * pictures.noise.without_relative / 4.0;
        assert!((light - series).abs() < 3.0 * error && error < 0.01 * series, "{light} {series} {error}");
        assert!(mean(&pictures.with()) < light);
    }
}

#[test]
fn a_mirror_shows_what_it_reflects() {
    let texels = (0..64 * 32).map(|i| [(i % 64) as f32, (i / 64) as f32, 1.0]).collect();
    let mut scene = view(4, DVec3::new(0.0, -1.0, 1.0), DVec3::ZERO);
    scene.environment = picture_sky(RadianceImage::from_pixels(64, 32, texels).unwrap());
    let mirror = Material::Mirror { reflectance_rgb: [0.5; 3] };
    scene.objects.push(body(plane(50.0), mirror));
    let shown = traced(&scene, &settings(64, 32)).with();
    // Seen straight: the camera turned over the plane.
    let (eye, target) = (DVec3::new(0.0, -1.0, -1.0), DVec3::ZERO);
    let mut straight = TraceScene { objects: Vec::new(), ..scene };
    let back = straight.world_from_camera;
    let flip = glam::DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
    straight.world_from_camera = Pose::look_at(eye, target, flip * back.rotate(DVec3::NEG_Y));
    let seen = traced(&straight, &settings(64, 32)).with();
    for y in 0..4 {
        for x in 0..4 {
            let (a, b) = (shown.at(x, y), seen.at(3 - x, y));
            for c in 0..3 {
                assert!((a[c] - 0.5 * b[c]).abs() < 0.02 * b[c].max(1.0), "{a:?} {b:?}");
            }
        }
    }
}

/// Everything at once: sky, sun, lamp, gloss, mirror, a bounce.
fn everything() -> TraceScene {
    let mut scene = view(12, DVec3::new(0.3, -2.0, 1.5), DVec3::new(0.0, 0.0, 0.2));
    scene.real.push(body(plane(10.0), matt(0.6)));
    let up = |z: f32| [(0.5, 0.5), (0.5, 0.9), (0.9, 0.9), (0.9, 0.5)].map(|(x, y)| Vec3::new(x, y, z));
    let mut lamp = body(quad(up(1.2)), matt(0.0));
    lamp.emission = Emission::Own([9.0, 8.0, 7.0]);
    scene.real.push(lamp);
    scene.objects.push(ball(Vec3::new(0.0, 0.0, 0.3), 0.3, matt(0.5)));
    let gloss = Material::Phong { albedo_rgb: [0.2; 3], specular_rgb: [0.6; 3], exponent: 30.0 };
    scene.objects.push(body(cuboid(Vec3::new(0.2, 0.9, 0.25), false), gloss));
    scene.objects.push(ball(Vec3::new(-0.6, 0.2, 0.2), 0.2, Material::Mirror { reflectance_rgb: [0.9; 3] }));
    let texels = (0..16 * 8).map(|i| [1.0 + (i % 7) as f32, 1.0, 0.1 * (i % 5) as f32]).collect();
    scene.environment = picture_sky(RadianceImage::from_pixels(16, 8, texels).unwrap());
    scene.suns.push(TraceSun { to_light_world: Vec3::new(-0.3, 0.2, 0.9), irradiance_rgb: [2.0; 3] });
    scene
}

#[test]
fn threads_change_nothing_and_cuts_change_nothing() {
    let scene = everything();
    let how = TraceSettings { bounces: 2, ..settings(24, 8) };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| traced(&scene, &how))
    };
    let alone = on(1);
    assert_eq!(alone, on(4));
    assert!(alone.noise.with_relative > 0.0 && alone.noise.dropped == 0);
    // Cut after one pass, with fewer samples to do at first.
    let mut first = Tracer::new(&scene, &TraceSettings { samples: 8, ..how }).unwrap();
    first.pass();
    assert!(first.is_done());
    let bytes = first.checkpoint();
    let mut second = Tracer::new(&scene, &how).unwrap();
    second.resume(&bytes).unwrap();
    while !second.is_done() {
        second.pass();
    }
    assert_eq!(second.finish(), alone);
    let other = traced(&scene, &TraceSettings { seed: 1, ..how });
    assert_ne!(other.with(), alone.with());
}

#[test]
fn what_objects_do_not_touch_has_no_noise_in_the_difference() {
    let scene = everything();
    let pictures = traced(&scene, &settings(64, 16));
    let without = traced(&TraceScene { objects: Vec::new(), ..scene }, &settings(64, 16));
    // The same numbers: the picture without is that of a scene without, bit for bit.
    assert_eq!(pictures.without(), without.with());
    assert_eq!(without.with(), without.without());
    assert_eq!(without.noise.shadow_pixels, 0);
    let touched = pictures.difference_error().pixels().iter().filter(|e| **e != [0.0; 3]).count();
    assert!(touched > 20 && pictures.noise.shadow_pixels > 5, "{touched}");
}

#[test]
fn objects_go_over_a_photograph_whatever_the_albedo() {
    let mut scene = view(16, DVec3::new(0.3, -2.0, 1.5), DVec3::new(0.0, 0.0, 0.2));
    scene.objects.push(ball(Vec3::new(0.0, 0.0, 0.3), 0.3, matt(0.5)));
    scene.environment = Environment::Constant([1.0, 0.8, 0.6]);
    let place = RadianceImage::filled(16, 16, [0.3, 0.2, 0.1]);
    let over = [0.2, 0.9].map(|albedo| {
        scene.real = vec![body(plane(10.0), matt(albedo))];
        traced(&scene, &settings(64, 16)).over(&place).unwrap()
    });
    for (a, b) in over[0].pixels().as_flattened().iter().zip(over[1].pixels().as_flattened()) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
    // A surface is dimmed, in its own colour.
    let [r, g, b] = *over[0].at(0, 15);
    assert!(r < 0.3 && (g / r - 2.0 / 3.0).abs() < 1e-5 && (b / r - 1.0 / 3.0).abs() < 1e-5, "{r} {g} {b}");
    let pictures = traced(&scene, &settings(64, 16));
    assert!(pictures.over(&RadianceImage::filled(16, 15, [0.0; 3])).is_none());
    // Every third pixel: the whole picture is given, and looked at there.
    let coarse = traced(&scene, &TraceSettings { step_px: 3, ..settings(64, 16) });
    let mut marked = place.clone();
    *marked.at_mut(coarse.full_px(0), coarse.full_px(4)) = [30.0; 3];
    let over = coarse.over(&marked).unwrap();
    assert_eq!((over.width(), over.height(), coarse.full_px(1)), (5, 5, 4));
    assert!(over.at(0, 4)[0] > 10.0 && over.at(1, 4)[0] < 1.0);
    assert_eq!(coarse.with().at(2, 3), pictures.with().at(7, 10));
}

#[test]
fn a_noise_target_ends_a_trace() {
    let mut scene = view(16, DVec3::new(0.3, -2.0, 1.5), DVec3::new(0.0, 0.0, 0.2));
    scene.real.push(body(plane(10.0), matt(0.5)));
    scene.objects.push(ball(Vec3::new(0.0, 0.0, 0.3), 0.3, matt(0.5)));
    scene.environment = picture_sky(RadianceImage::filled(16, 8, [1.0; 3]));
    let coarse = traced(&scene, &TraceSettings { shadow_noise: Some(0.05), ..settings(4096, 8) });
    let fine = traced(&scene, &TraceSettings { shadow_noise: Some(0.01), ..settings(4096, 8) });
    assert!(coarse.noise.shadow_relative < 0.05 && fine.noise.shadow_relative < 0.01);
    assert!(coarse.samples < fine.samples && fine.samples < 4096, "{} {}", coarse.samples, fine.samples);
}

#[test]
fn the_noise_that_is_said_is_the_noise_that_is() {
    let scene = everything();
    let truth = traced(&scene, &settings(8192, 128));
    let (mut said, mut found) = (0.0, 0.0);
    for seed in 1..5 {
        let pictures = traced(&scene, &TraceSettings { seed, ..settings(64, 16) });
        let (with, error) = (pictures.with(), pictures.with_error());
        let exact = truth.with();
        for i in 0..with.pixels().len() {
            for c in 0..3 {
                found += f64::from(with.pixels()[i][c] - exact.pixels()[i][c]).powi(2);
                said += f64::from(error.pixels()[i][c]).powi(2);
            }
        }
    }
    // 144 pixels, 4 passes, 4 seeds: the ratio of variances is good to about 10 %; the truth's own noise is 1 % of it.
    assert!((found / said - 1.0).abs() < 0.3, "{}", found / said);
}

#[test]
fn bad_input_is_refused_in_words() {
    let scene = everything();
    let refused =
        |scene: &TraceScene, how: &TraceSettings| Tracer::new(scene, how).err().unwrap().to_string();
    for (how, words) in [
        (TraceSettings { samples: 0, ..settings(8, 8) }, "samples = 0: must be within 1..="),
        (
            TraceSettings { samples_a_pass: 12, ..settings(8, 8) },
            "samples_a_pass = 12: must be a power of two",
        ),
        (TraceSettings { bounces: 65, ..settings(8, 8) }, "bounces = 65"),
        (TraceSettings { step_px: 0, ..settings(8, 8) }, "step_px = 0"),
        (TraceSettings { step_px: 40, ..settings(8, 8) }, "step_px = 40"),
        (TraceSettings { shadow_noise: Some(f64::NAN), ..settings(8, 8) }, "shadow_noise = NaN"),
    ] {
        let error = refused(&scene, &how);
        assert!(error.contains(words), "{error}");
    }
    let mut broken = everything();
    broken.objects.push(ball(Vec3::NAN, 1.0, matt(0.5)));
    assert!(refused(&broken, &settings(8, 8)).contains("body body: is a sphere"));
    let mut broken = everything();
    let mesh = Mesh { positions: vec![Vec3::ZERO; 3], triangles: vec![[0, 1, 3]], ..Mesh::default() };
    broken.real.push(body(TraceShape::Mesh(mesh), matt(0.5)));
    assert!(refused(&broken, &settings(8, 8)).contains("corner that there is not"));
    let foreign = Tracer::new(&scene, &settings(8, 8)).unwrap();
    let mut foreign_passed = foreign;
    foreign_passed.pass();
    let bytes = foreign_passed.checkpoint();
    let mut other = Tracer::new(&scene, &TraceSettings { bounces: 1, ..settings(8, 8) }).unwrap();
    assert!(other.resume(&bytes).unwrap_err().to_string().contains("belongs to another scene"));
    let mut smaller = Tracer::new(&scene, &TraceSettings { step_px: 2, ..settings(8, 8) }).unwrap();
    assert!(smaller.resume(&bytes).unwrap_err().to_string().contains("must be"));
    assert!(other.resume(b"something").unwrap_err().to_string().contains("is no checkpoint"));
}

/// A checkpoint of a small scene, and the scene.
fn kept() -> (TraceScene, TraceSettings, Vec<u8>) {
    let mut scene = view(3, DVec3::new(0.3, -2.0, 1.5), DVec3::ZERO);
    scene.environment = Environment::Constant([PI; 3]);
    let how = settings(8, 8);
    let mut tracer = Tracer::new(&scene, &how).unwrap();
    tracer.pass();
    (scene, how, tracer.checkpoint())
}

proptest! {
    #[test]
    fn no_bytes_make_resuming_panic(at: prop::sample::Index, to: u8, keep in 0.0..1.2f64) {
        let (scene, how, bytes) = kept();
        let mut changed = bytes.clone();
        let index = at.index(bytes.len());
        changed[index] = to;
        changed.truncate((keep * bytes.len() as f64) as usize);
        let mut tracer = Tracer::new(&scene, &how).unwrap();
        let outcome = tracer.resume(&changed);
        // Sound or refused, and what is refused changes nothing.
        prop_assert_eq!(outcome.is_ok(), changed == bytes);
        if outcome.is_err() {
            prop_assert_eq!(tracer.samples(), 0);
        }
    }

    #[test]
    fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let (scene, how, _) = kept();
        let mut tracer = Tracer::new(&scene, &how).unwrap();
        prop_assert!(tracer.resume(&bytes).is_err());
    }
}
