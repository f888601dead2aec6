//! Odd meshes and odd pictures through everything that takes some: no panic, nothing that is not a number, or a refusal.

use crate::engines;
use glam::{Affine3A, DVec3, Vec3};
use halflight::{
    assets::shapes,
    engine::Engine,
    hdr::{
        align::{align, drift},
        attribute::{Tolerance, check_exposures, measured_ratio},
        black_level::black_level,
    },
    light::prefilter::Prefilter,
    model::{
        environment::EnvironmentPicture,
        frame::Exposure,
        image::{Image, Rgb8Image},
        light::{Lights, RadianceSamples},
        response::Response,
        scene::{Material, Mesh, Scene},
    },
    stress::stage::{StressStage, ground, object, sun, uniform},
    track::tag::{TagDetector, TagOptions, gray_of},
    visibility::{fit_spheres, openness, proxies::Proxies, shadow_maps::ShadowCamera},
};

const WHITE: Material = Material::Lambert { albedo_rgb: [1.0; 3] };

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    let normals = vec![Vec3::Z; positions.len()];
    Mesh { positions, normals, triangles, ..Mesh::default() }
}

/// Meshes of every odd kind, with names.
pub fn meshes() -> Vec<(&'static str, Mesh)> {
    let v = Vec3::new;
    let ball = shapes::uv_sphere(0.1, 12, 6);
    let mut holed = ball.clone();
    holed.positions[7] = Vec3::NAN;
    holed.positions[9].x = f32::INFINITY;
    let mut missing = ball.clone();
    missing.triangles.push([0, 1, 100_000]);
    missing.normals.truncate(3);
    let mut twice = ball.clone();
    twice.triangles.extend(ball.triangles.clone());
    let mut inside_out = ball.clone();
    inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let mut zero_normals = ball;
    zero_normals.normals.fill(Vec3::ZERO);
    vec![
        ("nothing", Mesh::default()),
        ("no triangle", mesh(vec![Vec3::ZERO], Vec::new())),
        ("a point", mesh(vec![v(0.0, 0.0, 0.1); 3], vec![[0, 1, 2], [0, 0, 0]])),
        (
            "a line",
            mesh(vec![v(-0.1, 0.0, 0.1), v(0.0, 0.0, 0.1), v(0.1, 0.0, 0.1)], vec![[0, 1, 2], [0, 2, 1]]),
        ),
        ("a needle", mesh(vec![v(-0.3, 0.0, 0.1), v(0.3, 1e-7, 0.1), v(0.3, -1e-7, 0.1)], vec![[0, 1, 2]])),
        ("a sheet", mesh(vec![v(-0.1, 0.0, 0.1), v(0.1, 0.0, 0.1), v(0.0, 0.1, 0.1)], vec![[0, 1, 2]])),
        (
            "as small as can be",
            mesh(vec![Vec3::ZERO, v(1e-20, 0.0, 0.0), v(0.0, 1e-20, 0.0)], vec![[0, 1, 2]]),
        ),
        (
            "as large as the world",
            mesh(vec![v(-1e6, -1e6, 0.5), v(1e6, 0.0, 0.5), v(0.0, 1e6, 0.5)], vec![[0, 1, 2]]),
        ),
        ("larger", mesh(vec![v(-1e30, -1e30, 0.5), v(1e30, 0.0, 0.5), v(0.0, 1e30, 0.5)], vec![[0, 1, 2]])),
        (
            "through the camera",
            mesh(vec![v(0.25, -0.6, -1.0), v(0.25, -0.6, 3.0), v(1.0, 1.0, 0.0)], vec![[0, 1, 2]]),
        ),
        ("with corners that are no places", holed),
        ("with corners that there are not", missing),
        ("each triangle twice", twice),
        ("inside out", inside_out),
        ("without normals", zero_normals),
        ("all NaN", mesh(vec![Vec3::NAN; 3], vec![[0, 1, 2]])),
    ]
}

#[test]
fn spheres_stand_ins_and_openness_of_odd_meshes() {
    for (name, mesh) in meshes() {
        let fitted = fit_spheres::fit(&mesh.positions, &mesh.triangles, 8, &mut |_| ());
        for sphere in fitted.iter().flat_map(|fit| &fit.spheres) {
            let sound = sphere.centre.is_finite() && sphere.radius.is_finite() && sphere.radius > 0.0;
            assert!(sound, "{name}: {sphere:?}");
        }
        let all = 0..mesh.triangles.len();
        for most in [0, 4, 500] {
            let proxies =
                Proxies::build(&mesh.positions, &mesh.triangles, std::iter::once(all.clone()), most);
            let mut places = Vec::new();
            proxies.gather(&mesh.positions, &mut places);
            let inside = |t: &[u32; 3]| t.iter().all(|&i| (i as usize) < places.len());
            assert!(proxies.triangles().iter().all(inside), "{name}");
            assert!(proxies.error() >= 0.0, "{name}: {}", proxies.error());
        }
        let open = openness::of_mesh(&mesh, 16, &|_| ());
        assert_eq!(open.len(), mesh.positions.len());
        assert!(open.iter().all(|o| (0.0..=1.0).contains(o)), "{name}: {open:?}");
        for w in [Vec3::Z, Vec3::NEG_X, Vec3::new(1e-20, 0.0, 1.0), Vec3::NAN] {
            if let Some(camera) = ShadowCamera::fit(w.to_array(), mesh.positions.iter().copied(), 64) {
                assert!(camera.rows.as_flattened().iter().all(|r| r.is_finite()), "{name}: {camera:?}");
            }
        }
    }
}

/// Every odd mesh as an object and as a real surface, in soft and hard light, where it is and put nowhere.
pub fn all(engine: &mut dyn Engine) {
    let light = Lights { global: uniform(0.5).global, ..sun(Vec3::new(0.3, 0.1, 0.9).normalize(), 1.0) };
    for (name, mesh) in meshes() {
        let mut as_surface = ground();
        as_surface.name = "odd".into();
        as_surface.mesh = mesh.clone();
        let odd = object("odd", mesh, WHITE, Vec3::ZERO);
        let mut nowhere = odd.clone();
        nowhere.world_from_object = Affine3A::from_translation(Vec3::NAN);
        let mut flat = odd.clone();
        flat.world_from_object = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
        let ball = object("ball", shapes::cuboid(DVec3::splat(0.05)), WHITE, Vec3::new(0.1, 0.0, 0.05));
        let scenes = [
            ("an object", vec![odd], vec![ground()]),
            ("an object that is nowhere", vec![nowhere], vec![ground()]),
            ("an object that is flat", vec![flat], vec![ground()]),
            ("a surface", vec![ball], vec![ground(), as_surface]),
        ];
        for (what, objects, surfaces) in scenes {
            let scene = Scene { objects, surfaces, ..Scene::default() };
            for samples in [1, 4] {
                let mut stage = StressStage { size_px: [16, 12], ..StressStage::new(scene.clone(), light) };
                stage.quality.coverage_samples = samples;
                let picture = stage.draw(engine).expect("a sound frame").radiance;
                for c in picture.pixels().as_flattened() {
                    assert!(c.is_finite() && *c >= 0.0, "{name} as {what}: {c}");
                }
            }
        }
    }
}

engines::on_each!("odd::gl");

fn pictures() -> Vec<Rgb8Image> {
    let sizes = [(1, 1), (1, 40), (40, 1), (2, 2), (16, 16), (64, 48)];
    let kinds: [fn(usize) -> u8; 6] = [
        |_| 0,
        |_| 255,
        |k| (k * 7919 % 256) as u8,
        |k| if k % 2 == 0 { 0 } else { 255 },
        |k| (k % 256) as u8,
        |_| 128,
    ];
    let made = sizes.into_iter().flat_map(|(width, height)| {
        kinds.map(|kind| {
            let pixels = (0..width * height).map(|k| [kind(k); 3]).collect();
            Rgb8Image::from_pixels(width, height, pixels).expect("as many as were made")
        })
    });
    made.collect()
}

#[test]
fn brackets_of_odd_pictures() {
    let pictures = pictures();
    let response = Response::srgb();
    let mut gray = Image::default();
    let mut detector = TagDetector::new(TagOptions::default()).expect("a detector");
    let mut tags = Vec::new();
    for first in &pictures {
        for second in &pictures {
            let bracket = [first, second, first];
            for times_s in [[0.01, 0.04, 0.16], [0.01, 0.01, 0.01], [0.0, f64::NAN, -1.0]] {
                let exposures = times_s.map(|time_s| Exposure { time_s, gain: 1.0 });
                let aligned = align(&bracket, &exposures, &response);
                assert!(aligned.drifts.iter().all(|d| d.shift_px.is_finite() && d.turn_rad.is_finite()));
                assert_eq!(aligned.pictures.len(), 3);
                for (picture, given) in aligned.pictures.iter().zip(bracket) {
                    assert_eq!((picture.width(), picture.height()), (given.width(), given.height()));
                }
                let _ = black_level(&bracket, &exposures);
                let check = check_exposures(&bracket, &exposures, &response, Tolerance::GUESSED_RESPONSE);
                assert_eq!(check.reports().len(), 3);
            }
            assert!(drift(first, second).is_none_or(|d| d.shift_px.is_finite()));
            assert!(measured_ratio(first, second, &response).is_none_or(|m| m.log_ratio.is_finite()));
        }
        gray_of(first, &mut gray);
        // Too small ones are refused in words.
        match detector.detect(&gray, None, &mut tags) {
            Ok(()) => assert!(tags.is_empty(), "{tags:?}"),
            Err(error) => assert!(error.to_string().contains("pixels"), "{error}"),
        }
    }
}

#[test]
fn surroundings_of_odd_samples() {
    let direction = |k: usize| match k % 5 {
        0 => [0.0, 0.0, 1.0, 0.1],
        1 => [0.0, 0.0, 0.0, 0.1],
        2 => [f32::NAN, 0.0, 0.0, 0.1],
        3 => [1.0, 0.0, 0.0, 0.0],
        _ => [0.0, -1.0, 0.0, 1e-30],
    };
    for count in [0, 1, 2, 3, 5, 500] {
        let mut samples = RadianceSamples::default();
        for k in 0..count {
            samples.directions.push(direction(k));
            samples.radiance.push([1.0, 1e6, 0.0, 0.0]);
        }
        let (mut work, mut picture) = (Prefilter::default(), EnvironmentPicture::default());
        for _ in 0..2 {
            work.see(&samples, 0.5, &mut picture);
            work.levels(None, &mut picture);
            work.levels(Some(&samples), &mut picture);
        }
        let texels =
            picture.all.texels().iter().chain(picture.glossy.iter().flat_map(|level| level.texels()));
        for c in texels.flatten() {
            assert!(c.is_finite() && (0.0..=1.001e6).contains(c), "{count} samples: {c}");
        }
    }
}
