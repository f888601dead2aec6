use super::*;
use crate::{
    nearfield::fixture,
    visibility::point_maps::{WHOLE, visibility},
};
use glam::DVec3;

const QUALITY: NearQuality = NearQuality { lights: 12, left_rad: f32::INFINITY, texels: 128, places: 3 };

/// A box of 0.2 m, its corners and triangles.
fn cuboid(middle: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    cuboid_of(middle, 0.1)
}

fn cuboid_of(middle: Vec3, half: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { -half } else { half };
        middle + Vec3::new(sign(0), sign(1), sign(2))
    };
    let sides = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = sides.iter().flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

fn camera() -> (Lens, Pose) {
    let eye = DVec3::new(-1.2, -1.3, 0.9);
    (
        Lens::pinhole(160, 120, 90.0, 90.0, 80.0, 60.0),
        Pose::look_at(eye, DVec3::new(0.2, 0.1, -0.2), DVec3::Z),
    )
}

#[test]
fn every_light_that_loses_something_on_a_triangle_is_listed() {
    let room = fixture::room();
    let field = fixture::field(&room, 900, &fixture::ALL);
    let triangles: Vec<[u32; 3]> = field.patches.patches.iter().flat_map(|p| p.triangles()).collect();
    let (lens, pose) = camera();
    for middle in [Vec3::new(0.1, 0.0, 0.1), Vec3::new(0.2, -0.1, 0.5), Vec3::new(-0.9, -0.2, -0.6)] {
        let (positions, faces) = cuboid(middle);
        let proxies = Proxies::build(&positions, &faces, std::iter::once(0..faces.len()), 500);
        let mut frame = NearFrame::default();
        frame.update(&field, &proxies, &positions, (&lens, &pose), &QUALITY);
        assert!(!frame.lights().is_empty() && frame.lights().len() <= 12);
        frame.draw(&proxies);
        let mut lengths = [0, 0];
        for (round, is_drawn) in [false, true].into_iter().enumerate() {
            frame.list(&field, &triangles, is_drawn);
            let mut losing = 0;
            for (t, triangle) in triangles.iter().enumerate() {
                lengths[round] += frame.listed(t).len();
                if !triangle.iter().any(|&v| frame.marks().has_vertex(v as usize)) {
                    assert!(frame.listed(t).is_empty());
                    continue;
                }
                let corners = triangle.map(|v| field.patches.vertices[v as usize].position_world);
                for k in 0..frame.lights().len() {
                    if triangle.iter().all(|&v| frame.sent(k, v) == [0.0; 3]) {
                        continue;
                    }
                    let Some((camera, maps)) = frame.maps().get(k) else { continue };
                    let loses = (0..15).any(|i| {
                        let (a, b) = ((0.13 * i as f32).fract(), (0.37 * i as f32).fract());
                        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                        let point =
                            corners[0] + a * (corners[1] - corners[0]) + b * (corners[2] - corners[0]);
                        visibility(maps, camera, WHOLE, point, None) < 1.0
                    });
                    losing += usize::from(loses);
                    assert!(!loses || frame.listed(t).contains(&(k as u16)), "light {k}, triangle {t}");
                }
            }
            assert!(losing > 5, "{losing} at {middle}");
        }
        assert!(lengths[1] <= lengths[0] && lengths[0] < triangles.len() * frame.lights().len() / 2);
    }
}

#[test]
fn without_objects_there_is_nothing_to_draw() {
    let room = fixture::room();
    let field = fixture::field(&room, 300, &fixture::ALL);
    let (lens, pose) = camera();
    let mut frame = NearFrame::default();
    frame.update(&field, &Proxies::default(), &[], (&lens, &pose), &QUALITY);
    frame.draw(&Proxies::default());
    frame.list(&field, &[[0, 1, 2]], true);
    assert!(frame.lights().is_empty() && frame.listed(0).is_empty() && frame.listed(99).is_empty());
    // Objects of which nothing is finite hide nothing.
    let positions = [Vec3::NAN; 3];
    let proxies = Proxies::build(&positions, &[[0, 1, 2]], std::iter::once(0..1), 500);
    frame.update(&field, &proxies, &positions, (&lens, &pose), &QUALITY);
    frame.draw(&proxies);
    assert!(frame.maps().cameras().iter().all(Option::is_none));
}

#[test]
fn a_hundred_objects_are_one_frame() {
    let room = fixture::room();
    let field = fixture::field(&room, 300, &fixture::ALL);
    let triangles: Vec<[u32; 3]> = field.patches.patches.iter().flat_map(|p| p.triangles()).collect();
    let (lens, pose) = camera();
    let (mut positions, mut faces, mut objects) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..100u32 {
        let middle = Vec3::new((k % 10) as f32 * 0.3 - 1.4, (k / 10) as f32 * 0.25 - 1.1, -0.6);
        let (corners, own) = cuboid_of(middle, 0.05);
        let base = positions.len() as u32;
        let first = faces.len();
        faces.extend(own.iter().map(|t| t.map(|i| i + base)));
        positions.extend(corners);
        objects.push(first..faces.len());
    }
    let proxies = Proxies::build(&positions, &faces, objects.into_iter(), 500);
    let mut frame = NearFrame::default();
    frame.update(&field, &proxies, &positions, (&lens, &pose), &QUALITY);
    frame.draw(&proxies);
    frame.list(&field, &triangles, true);
    assert_eq!(frame.boxes().len(), 100);
    assert!(!frame.lights().is_empty() && frame.lights().len() <= QUALITY.lights);
    assert!((0..triangles.len()).any(|t| !frame.listed(t).is_empty()));
}

#[test]
fn an_object_around_the_lamp_takes_all_its_light_and_one_around_the_camera_what_it_hides() {
    let room = fixture::room();
    let field = fixture::field(&room, 300, &fixture::ALL);
    let (lens, pose) = camera();
    let seen = |frame: &NearFrame, point: Vec3| -> Vec<f32> {
        let of = |k: usize| {
            let (camera, maps) = frame.maps().get(k)?;
            Some(visibility(maps, camera, WHOLE, point, None))
        };
        (0..frame.lights().len()).map(|k| of(k).unwrap_or(1.0)).collect()
    };
    // The lamp is 0.6 m wide at (0.6, -0.4, 1.74).
    let (positions, faces) = cuboid_of(Vec3::new(0.6, -0.4, 1.7), 0.4);
    let proxies = Proxies::build(&positions, &faces, std::iter::once(0..faces.len()), 500);
    let mut frame = NearFrame::default();
    frame.update(&field, &proxies, &positions, (&lens, &pose), &QUALITY);
    frame.draw(&proxies);
    let lamp = seen(&frame, Vec3::new(0.1, 0.1, 0.0));
    assert!(!lamp.is_empty() && frame.lights().iter().all(|l| l.inside));
    assert!(lamp.iter().all(|v| *v == 0.0), "{lamp:?}");
    // Around the camera: a frame as any other, and finite.
    let (positions, faces) = cuboid_of(pose.translation.as_vec3(), 0.15);
    frame.update(&field, &proxies_of(&positions, &faces), &positions, (&lens, &pose), &QUALITY);
    frame.draw(&proxies_of(&positions, &faces));
    assert!(seen(&frame, Vec3::new(0.1, 0.1, 0.0)).iter().all(|v| (0.0..=1.0).contains(v)));
}

fn proxies_of(positions: &[Vec3], faces: &[[u32; 3]]) -> Proxies {
    Proxies::build(positions, faces, std::iter::once(0..faces.len()), 500)
}
