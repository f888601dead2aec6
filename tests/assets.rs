//! Files of the shared data, read whole.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DVec2, Vec3};
use halflight::{
    assets::{
        case::{self, EmitterKind},
        gltf, obj,
        pictures::{load_gray8, load_radiance, load_raw, load_rgb8},
        shapes::{bounds, merged, transformed},
    },
    math::bvh::Bvh,
    model::scene::Mesh,
    visibility::openness::of_mesh,
};

#[test]
fn real_pictures_load_and_the_mangled_one_is_refused() {
    let Some(shared) = support::shared("real_pictures") else { return };
    let memorial = load_radiance(&shared.join("data/brackets/memorial/memorial.hdr")).unwrap();
    assert_eq!((memorial.hdr.radiance.width(), memorial.hdr.radiance.height()), (512, 768));
    assert_eq!(memorial.replaced, Default::default());
    let error =
        load_radiance(&shared.join("data/brackets/malformed/memorial_crlf_corrupted.hdr")).unwrap_err();
    assert!(error.to_string().contains("CR LF"), "{error}");
    for (name, size) in [
        ("debevec_beach_probe_angular", (640, 640)),
        ("rooitou_park_1k", (1024, 512)),
        ("st_fagans_interior_1k", (1024, 512)),
        ("studio_small_03_1k", (1024, 512)),
        ("lebombo_1k", (1024, 512)),
        ("potsdamer_platz_1k", (1024, 512)),
    ] {
        let map = load_radiance(&shared.join(format!("data/hdr/{name}.hdr"))).unwrap();
        assert_eq!((map.hdr.radiance.width(), map.hdr.radiance.height()), size, "{name}");
        assert_eq!(map.replaced, Default::default(), "{name}");
        if name == "rooitou_park_1k" {
            let gray = |[r, g, b]: &[f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
            let largest = map.hdr.radiance.pixels().iter().map(gray).fold(0.0f32, f32::max);
            // The README's figure (luminance): 64,890.
            assert!((largest - 64_890.0).abs() < 200.0, "{largest}");
        }
    }
    // DWAB-compressed half floats; each map was scaled to an irradiance of pi on an upward surface.
    for name in ["overcast_city", "room_windows", "studio_lamps", "sun_beach"] {
        let map = load_radiance(&shared.join(format!("reference/env/{name}.exr"))).unwrap().hdr.radiance;
        assert_eq!((map.width(), map.height()), (512, 256));
        let mut irradiance = 0.0f64;
        for y in 0..128 {
            let theta = std::f64::consts::PI * (y as f64 + 0.5) / 256.0;
            let weight = theta.sin() * theta.cos() * (std::f64::consts::PI / 256.0).powi(2);
            for [r, g, b] in map.row(y) {
                irradiance += weight * (0.3 * f64::from(*r) + 0.59 * f64::from(*g) + 0.11 * f64::from(*b));
            }
        }
        // Midpoint rule against the README's statement: 0.1 %.
        assert!((irradiance / std::f64::consts::PI - 1.0).abs() < 1e-3, "{name}: {irradiance}");
    }
    let photo = load_rgb8(&shared.join("data/mirrorball/ola_raw0.jpg")).unwrap();
    assert_eq!((photo.width(), photo.height()), (1500, 1000));
    let mask = load_gray8(&shared.join("reference/f5_sun_beach/mask_mirror.png")).unwrap();
    assert!(mask.pixels().contains(&255) && mask.pixels().contains(&0));
}

const CASES: [&str; 18] = [
    "f1_overcast_city_figure20",
    "f1_overcast_city_one_b",
    "f1_room_windows_five",
    "f1_room_windows_overlap",
    "f1_studio_lamps_five",
    "f1_studio_lamps_overlap",
    "f1_sun_beach_figure20",
    "f1_sun_beach_one",
    "f2_room_windows",
    "f2_sun_beach",
    "f3_ceiling_light",
    "f3_window_ceiling_patch",
    "f4_sun25",
    "f4_sun45",
    "f5_overcast_city",
    "f5_room_windows",
    "f5_studio_lamps",
    "f5_sun_beach",
];

#[test]
fn every_reference_case_loads_with_all_its_files() {
    let Some(shared) = support::shared("reference_cases") else { return };
    for id in CASES {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        assert_eq!((case.id.as_str(), case.lens.width, case.lens.height), (id, 256, 192));
        assert_eq!(case.family.to_lowercase(), id[..2]);
        for image in &case.images {
            let (width, height) = if image.is_mask() {
                let mask = load_gray8(&image.file).unwrap();
                (mask.width(), mask.height())
            } else {
                let picture = load_raw(&image.file).unwrap();
                assert!(picture.pixels().as_flattened().iter().all(|c| c.is_finite()), "{id} {}", image.name);
                (picture.width(), picture.height())
            };
            assert_eq!((width, height), (256, 192), "{id} {}", image.name);
            assert!(!case.emitters(Some(&image.name)).unwrap().is_empty());
        }
        for emitter in &case.emitters {
            if let EmitterKind::Environment { file } = &emitter.kind {
                assert!(file.is_file(), "{}", file.display());
            }
        }
        assert_eq!(case.photographs.is_some(), case.family == "F5");
        assert_eq!(case.light_truth.is_some(), case.family == "F5");
        assert_eq!(case.alternative_sun.is_some(), case.family == "F4");
        if id == "f1_overcast_city_figure20" {
            let scene = case.scene(Some("with")).unwrap();
            assert_eq!((scene.objects.len(), scene.surfaces.len()), (20, 1));
            assert!(case.scene(Some("without")).unwrap().objects.is_empty());
        }
    }
}

#[test]
fn objects_of_a_case_appear_where_its_masks_say() {
    let Some(shared) = support::shared("case_masks") else { return };
    // Rays through pixel centres against the tessellated objects; pixels that a mask covers in part are left out.
    for (id, image, mask) in [
        ("f2_sun_beach", "beauty", "mask_bunny"),
        ("f2_sun_beach", "beauty", "mask_mirror"),
        ("f3_ceiling_light", "obj_table", "mask_table"),
        ("f3_window_ceiling_patch", "obj_under", "mask_under"),
        ("f4_sun45", "beauty", "mask_box"),
        ("f4_sun45", "beauty", "mask_ball"),
        ("f5_sun_beach", "hdr", "mask_mirror"),
    ] {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        let scene = case.scene(Some(image)).unwrap();
        let wanted = mask.trim_start_matches("mask_");
        let alone = scene.objects.iter().find(|o| o.name == wanted);
        let chosen = alone.unwrap_or(&scene.objects[0]);
        let bvh_of = |mesh: &Mesh| Bvh::build(&mesh.positions, &mesh.triangles);
        let target = bvh_of(&transformed(&chosen.mesh, &chosen.world_from_object));
        let mut blockers: Vec<Bvh> = scene.surfaces.iter().map(|s| bvh_of(&s.mesh)).collect();
        for object in scene.objects.iter().filter(|o| o.name != chosen.name) {
            blockers.push(bvh_of(&transformed(&object.mesh, &object.world_from_object)));
        }
        let coverage = load_gray8(&case.image(mask).unwrap().file).unwrap();
        let (mut wrong, mut covered) = (0, 0);
        for y in 0..192 {
            for x in 0..256 {
                let pixel = *coverage.at(x, y);
                if pixel != 0 && pixel != 255 {
                    continue;
                }
                let ray = case.lens.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).unwrap();
                let origin = case.world_from_camera.translation.as_vec3();
                let direction = case.world_from_camera.rotate(ray).as_vec3();
                let seen = target
                    .intersect(origin, direction, 1e-4, 1e4)
                    .is_some_and(|hit| blockers.iter().all(|b| !b.occluded(origin, direction, 1e-4, hit.t)));
                covered += i32::from(pixel == 255);
                wrong += i32::from(seen != (pixel == 255));
            }
        }
        assert!(covered > 100, "{id} {mask}: {covered}");
        // Spheres lie inside by up to 0.09 % of their radius, which is no pixel: none measured.
        assert_eq!(wrong, 0, "{id} {mask} of {covered}");
    }
}

#[test]
fn the_bunny_is_a_sound_mesh() {
    let Some(shared) = support::shared("bunny") else { return };
    let bunny = obj::load(&shared.join("reference/meshes/bunny.obj")).unwrap();
    assert_eq!((bunny.positions.len(), bunny.triangles.len()), (1839, 3674));
    let (low, high) = bounds(&bunny).unwrap();
    assert!(low.z.abs() < 1e-6 && (high.z - 0.1).abs() < 1e-3, "{low} {high}");
    assert_sound("bunny", &bunny);
    let open = of_mesh(&bunny, 64, &|_| ());
    let mean = open.iter().sum::<f32>() / open.len() as f32;
    // Mostly convex: ears and paws shade a tenth.
    assert!((0.75..0.97).contains(&mean), "{mean}");
    let room = obj::load(&shared.join("data/models/cornellbox_suzanne.obj")).unwrap();
    assert_sound("suzanne", &room);
    assert!(room.triangles.len() > 500, "{}", room.triangles.len());
}

fn assert_sound(name: &str, mesh: &Mesh) {
    let n = mesh.positions.len();
    assert!(
        n > 0 && mesh.normals.len() == n && mesh.tints_rgb.len() == n && !mesh.triangles.is_empty(),
        "{name}"
    );
    assert!(mesh.positions.iter().all(|p| p.is_finite()), "{name}");
    assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5), "{name}");
    assert!(mesh.tints_rgb.as_flattened().iter().all(|t| (0.0..=1.0).contains(t)), "{name}");
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n), "{name}");
}

#[test]
fn real_models_come_out_upright_and_sound() {
    let Some(shared) = support::shared("models") else { return };
    // Triangles, lowest and highest corner (z up, facing -y), objects. Boxes of files without nodes or skins follow
    // from their accessors' own bounds; the robot's is as posed by its skin: feet at 0, head at 4.4.
    for (name, triangles, low, high, objects) in [
        ("CornellBox_bevy.glb", 36, [-556.0, 0.0, 0.0], [0.0, 559.2, 548.8], 5),
        ("DamagedHelmet.glb", 15_452, [-0.947, -0.813, -0.901], [0.942, 1.187, 0.901], 1),
        ("Fox.glb", 576, [-12.593, -66.625, -0.122], [12.593, 88.095, 78.907], 1),
        ("RobotExpressive.glb", 3_234, [-1.691, -1.706, -0.020], [1.554, 0.950, 4.442], 3),
        ("SimpleSkin.gltf", 8, [-0.5, 0.0, 0.0], [0.5, 0.0, 2.0], 1),
    ] {
        let model = gltf::load_with(&shared.join("data/models").join(name), 8, &|_| ()).unwrap();
        let meshes: Vec<Mesh> = model.iter().map(|o| o.mesh.clone()).collect();
        let all = merged(&meshes);
        assert_eq!((model.len(), all.triangles.len()), (objects, triangles), "{name}");
        let (found_low, found_high) = bounds(&all).unwrap();
        let near = |a: Vec3, b: [f32; 3]| a.abs_diff_eq(Vec3::from(b), 1e-3);
        assert!(near(found_low, low) && near(found_high, high), "{name}: {found_low} {found_high}");
        for object in &model {
            assert_sound(&object.name, &object.mesh);
            assert_eq!(object.openness.len(), object.mesh.positions.len());
            assert!(object.openness.iter().all(|o| (0.0..=1.0).contains(o)));
        }
        if name == "Fox.glb" {
            // Its texture reaches the vertices: orange on the whole.
            let n = model[0].mesh.tints_rgb.len() as f32;
            let mean = |c: usize| model[0].mesh.tints_rgb.iter().map(|t| t[c]).sum::<f32>() / n;
            assert!(mean(0) > 2.0 * mean(2) && mean(0) > mean(1), "{} {} {}", mean(0), mean(1), mean(2));
        }
    }
}
