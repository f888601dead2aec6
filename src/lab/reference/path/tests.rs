use super::*;
use crate::math::pose::Pose;
use crate::model::{image::RadianceImage, scene::Mesh};
use crate::reference::{Environment, TraceBody, TraceSettings, TraceShape, TraceSun, trace};
use glam::DVec3;

/// A square that faces up (or down), of a half side, at a height.
fn square(half: f32, height: f32, up: bool, albedo: f32) -> TraceBody {
    let at = |x: f32, y: f32| Vec3::new(x * half, y * half, height);
    let positions = vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    let triangles = if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
    TraceBody {
        name: "square".into(),
        shape: TraceShape::Mesh(Mesh { positions, triangles, ..Mesh::default() }),
        material: Material::Lambert { albedo_rgb: [albedo; 3] },
        two_sided: false,
        emission: Emission::None,
        is_aperture: false,
    }
}

fn seen_from(eye: DVec3, target: DVec3) -> TraceScene {
    TraceScene::empty(Lens::pinhole(3, 3, 60.0, 60.0, 1.5, 1.5), Pose::look_at(eye, target, DVec3::Y))
}

/// Mean of the picture with, and of the one without.
fn means(scene: &TraceScene, bounces: u32) -> [f64; 2] {
    let how = TraceSettings { samples: 512, bounces, ..TraceSettings::default() };
    let pictures = trace(scene, &how, &|_| ()).unwrap();
    [pictures.with(), pictures.without()].map(|picture| {
        let all = picture.pixels().as_flattened();
        all.iter().map(|&c| f64::from(c)).sum::<f64>() / all.len() as f64
    })
}

#[test]
fn suns_shine_through_windows_and_through_nothing_else() {
    let mut scene = seen_from(DVec3::new(0.3, -2.0, 0.6), DVec3::ZERO);
    let window = TraceBody { is_aperture: true, ..square(0.5, 1.0, false, 0.0) };
    let wall = square(3.0, 2.0, false, 0.5);
    scene.real = vec![square(5.0, 0.0, true, 0.5), window.clone(), wall.clone()];
    scene.suns.push(TraceSun { to_light_world: Vec3::Z, irradiance_rgb: [2.0; 3] });
    let lit = 1.0 / std::f64::consts::PI;
    let [with, without] = means(&scene, 0);
    assert!((with - lit).abs() < 1e-5 && (without - lit).abs() < 1e-5, "{with} {without}");
    // What stands before the window hides the sun, what stands behind it does not.
    scene.objects = vec![square(0.4, 0.8, false, 0.0)];
    assert_eq!(means(&scene, 0)[0], 0.0);
    scene.objects = vec![square(0.4, 1.5, false, 0.0)];
    assert!((means(&scene, 0)[0] - lit).abs() < 1e-5);
    // Beside the window the wall hides it, and so does a window that is none.
    scene.objects.clear();
    scene.world_from_camera =
        seen_from(DVec3::new(1.0, -2.0, 0.6), DVec3::new(1.5, 0.0, 0.0)).world_from_camera;
    assert_eq!(means(&scene, 0)[1], 0.0);
    scene.world_from_camera = seen_from(DVec3::new(0.3, -2.0, 0.6), DVec3::ZERO).world_from_camera;
    scene.real[1].is_aperture = false;
    assert_eq!(means(&scene, 0)[1], 0.0);
}

/// An object that looks down on a wide floor, seen from below.
fn over_a_floor(emission: Emission) -> TraceScene {
    let mut scene = seen_from(DVec3::new(0.0, -0.4, 0.1), DVec3::new(0.0, 0.0, 0.5));
    scene.real.push(TraceBody { emission, ..square(80.0, 0.0, true, 0.5) });
    scene.objects.push(square(0.5, 0.5, false, 0.8));
    scene
}

#[test]
fn measured_light_is_received_and_not_seen() {
    let scene = over_a_floor(Emission::Measured([2.0; 3]));
    for bounces in [0, 2] {
        // All that was measured, whatever is allowed to bounce; the floor fills the hemisphere but for 4e-5.
        let [with, without] = means(&scene, bounces);
        assert!((with - 1.6).abs() < 0.01 && without == 0.0, "{with} {without}");
    }
    // The camera sees the floor in the light that falls on it: none.
    let mut floor = TraceScene { objects: Vec::new(), ..scene };
    floor.world_from_camera = seen_from(DVec3::new(0.0, -1.0, 1.0), DVec3::ZERO).world_from_camera;
    assert_eq!(means(&floor, 0), [0.0; 2]);
    // Light of its own is seen as well.
    floor.real[0].emission = Emission::Own([2.0; 3]);
    assert_eq!(means(&floor, 0), [2.0; 2]);
}

#[test]
fn what_is_not_known_shows_the_surroundings() {
    let texels = (0..32 * 16).map(|i| if i < 32 * 8 { [0.0f32; 3] } else { [3.0; 3] });
    let radiance = RadianceImage::from_pixels(32, 16, texels.collect()).unwrap();
    let sky = Environment::Picture { radiance, map_from_world: Mat3::IDENTITY };
    // Light only from below the horizon, where the floor is.
    let scene = TraceScene { environment: sky, ..over_a_floor(Emission::Surroundings) };
    for bounces in [0, 1] {
        let [with, _] = means(&scene, bounces);
        // The texels above the horizon's edge are half lit: 1.5 % of the light comes from within them.
        assert!((with - 2.4).abs() < 0.06, "{with}");
    }
    let hidden = TraceScene { real: over_a_floor(Emission::None).real, ..scene };
    // Past the floor's edge a little of it is seen: (0.5 / 80)^2 of 2.4, 9e-5.
    assert!(means(&hidden, 0)[0] < 2e-4);
}
