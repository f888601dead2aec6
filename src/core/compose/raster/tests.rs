//! The rasteriser against closed forms.

use super::*;
use crate::compose::geometry::ObjectGeometry;
use crate::math::lens::{Distortion, Lens};
use crate::model::scene::{Material, Mesh, Scene, VirtualObject};
use glam::{Affine3A, DVec2, DVec3};

fn scene(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> ObjectGeometry {
    let object = VirtualObject {
        name: "test".into(),
        mesh: Mesh { positions, triangles, ..Mesh::default() },
        material: Material::Lambert { albedo_rgb: [1.0; 3] },
        world_from_object: Affine3A::IDENTITY,
        openness: Vec::new(),
    };
    let mut geometry = ObjectGeometry::default();
    geometry.load(&Scene { objects: vec![object], ..Scene::default() });
    geometry
}

fn project(rays: &Rays, view: &View, geometry: &ObjectGeometry) -> Projected {
    let mut projected = Projected::default();
    projected.prepare(rays, view, &geometry.positions, &geometry.triangles);
    projected
}

fn draw_behind(
    lens: &Lens,
    pose: &Pose,
    geometry: &ObjectGeometry,
    real: &ObjectGeometry,
    samples: u32,
) -> Image<[f32; 4]> {
    let mut rays = Rays::default();
    rays.update(lens, samples);
    let view = View::of(pose);
    let (objects, occluders) = (project(&rays, &view, geometry), project(&rays, &view, real));
    let mut out = Image::default();
    let shade = |f: &Fragment| f.point_world.to_array();
    draw_objects(&rays, &view, &objects, &occluders, shade, &mut Samples::default(), &mut out);
    out
}

fn draw(lens: &Lens, pose: &Pose, geometry: &ObjectGeometry, samples: u32) -> Image<[f32; 4]> {
    draw_behind(lens, pose, geometry, &ObjectGeometry::default(), samples)
}

fn lenses() -> [Lens; 3] {
    let pinhole = Lens::pinhole(96, 64, 70.0, 72.0, 47.0, 33.5);
    let radial = Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    let fisheye = Distortion::Equidistant([0.02, 0.001, 0.0, 0.0]);
    [
        pinhole,
        Lens { distortion: radial, ..pinhole },
        Lens { distortion: fisheye, fx: 30.0, fy: 30.0, ..pinhole },
    ]
}

/// A big box around the camera: six faces of 2 triangles each.
fn room() -> ObjectGeometry {
    let positions = (0..8)
        .map(|k| {
            Vec3::new(
                (k & 1) as f32 * 4.0 - 2.0,
                (k >> 1 & 1) as f32 * 6.0 - 3.0,
                (k >> 2) as f32 * 5.0 - 2.0,
            )
        })
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    scene(positions, quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
}

#[test]
fn a_closed_room_covers_every_sample_through_every_lens() {
    let geometry = room();
    let poses = [
        Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z),
        Pose::look_at(DVec3::new(-1.5, 2.0, 2.5), DVec3::new(0.0, -2.0, -1.0), DVec3::Z),
    ];
    for lens in lenses() {
        for pose in &poses {
            for samples in [1, 4] {
                let layer = draw(&lens, pose, &geometry, samples);
                for pixel in layer.pixels() {
                    assert_eq!(pixel[3], 1.0, "{:?}", lens.distortion);
                }
            }
        }
    }
}

#[test]
fn a_fragment_lies_on_its_triangle_where_the_pixels_ray_meets_it() {
    let geometry = room();
    let pose = Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z);
    for lens in lenses() {
        let layer = draw(&lens, &pose, &geometry, 1);
        for (k, pixel) in layer.pixels().iter().enumerate() {
            let centre = DVec2::new((k % 96) as f64 + 0.5, (k / 96) as f64 + 0.5);
            let ray = pose.rotate(lens.unproject(centre).unwrap());
            let point = Vec3::from_slice(pixel).as_dvec3();
            let aside = (point - pose.translation).cross(ray).length();
            assert!(aside < 1e-5, "{aside}");
            let walls = [point.x.abs() - 2.0, point.y.abs() - 3.0, (point.z - 0.5).abs() - 2.5];
            let nearest = walls.map(f64::abs).into_iter().fold(f64::MAX, f64::min);
            assert!(nearest < 1e-5, "{point}");
        }
    }
}

#[test]
fn coverage_adds_up_to_the_area_and_edges_are_shared() {
    // Two triangles that share an edge, over a grid of offsets: the pair covers what the square covers.
    let lens = Lens::pinhole(64, 64, 50.0, 50.0, 32.0, 32.0);
    let mut total = 0.0;
    for k in 0..20 {
        let (dx, dy) = (0.0137 * k as f32, 0.0093 * k as f32);
        let p = |x: f32, y: f32| Vec3::new(x + dx, y + dy, 2.0);
        let geometry =
            scene(vec![p(-0.4, -0.4), p(0.4, -0.4), p(0.4, 0.4), p(-0.4, 0.4)], vec![[0, 1, 2], [0, 2, 3]]);
        let layer = draw(&lens, &Pose::IDENTITY, &geometry, 4);
        total += layer.pixels().iter().map(|p| p[3]).sum::<f32>() / 20.0;
        assert!(layer.pixels().iter().all(|p| p[3] <= 1.0));
    }
    // 0.8 m at 2 m and 50 px: 20 x 20 px; four samples a pixel over 20 offsets.
    assert!((total - 400.0).abs() < 2.0, "{total}");
}

#[test]
fn what_is_behind_the_camera_or_hidden_is_not_drawn() {
    let lens = Lens::pinhole(32, 32, 30.0, 30.0, 16.0, 16.0);
    let square = |z: f32| {
        let p = |x: f32, y: f32| Vec3::new(x, y, z);
        scene(vec![p(-1.0, -1.0), p(1.0, -1.0), p(1.0, 1.0), p(-1.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
    };
    let behind = draw(&lens, &Pose::IDENTITY, &square(-1.0), 4);
    assert!(behind.pixels().iter().all(|p| *p == [0.0; 4]));
    // A real screen over the left half, before the square, at its very place, and behind it.
    let screen = |z: f32| {
        let p = |x: f32, y: f32| Vec3::new(x * z, y * z, z);
        scene(vec![p(-1.0, -1.0), p(0.0, -1.0), p(0.0, 1.0), p(-1.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
    };
    for (z, hidden) in [(0.5, true), (0.999, true), (1.0, false), (2.0, false)] {
        let layer = draw_behind(&lens, &Pose::IDENTITY, &square(1.0), &screen(z), 4);
        for (k, pixel) in layer.pixels().iter().enumerate() {
            let expected = if hidden && k % 32 < 16 { 0.0 } else { 1.0 };
            assert_eq!(pixel[3], expected, "screen at {z}, column {}", k % 32);
        }
    }
}

#[test]
fn surfaces_are_met_at_pixel_centres_nearest_first() {
    let pose = Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z);
    let geometry = room();
    for lens in lenses() {
        let mut rays = Rays::default();
        rays.update(&lens, 4);
        let view = View::of(&pose);
        let projected = project(&rays, &view, &geometry);
        let mut met = Image::default();
        let shade = |f: &Fragment| f.point_world.to_array();
        draw_surfaces(&rays, &view, &projected, [9.0; 3], shade, &mut Samples::default(), &mut met);
        let layer = draw(&lens, &pose, &geometry, 1);
        for (a, b) in met.pixels().iter().zip(layer.pixels()) {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_triangle_through_the_cameras_plane_is_drawn_where_it_is_in_front() {
    // The ground, from 3 m behind to 50 m in front of a camera at 1 m height that looks level.
    let geometry = scene(
        vec![
            Vec3::new(-40.0, 1.0, -3.0),
            Vec3::new(40.0, 1.0, -3.0),
            Vec3::new(40.0, 1.0, 50.0),
            Vec3::new(-40.0, 1.0, 50.0),
        ],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    for lens in lenses() {
        let layer = draw(&lens, &Pose::IDENTITY, &geometry, 4);
        for y in 0..64 {
            let pixel = layer.at(48, y)[3];
            let level = lens.project(DVec3::new(0.0, 1.0, 50.0)).unwrap().y;
            if (y as f64) > level + 1.0 {
                assert_eq!(pixel, 1.0, "{:?} row {y}", lens.distortion);
            } else if ((y + 1) as f64) < level - 1.0 {
                assert_eq!(pixel, 0.0, "{:?} row {y}", lens.distortion);
            }
        }
    }
}

#[test]
fn neighbours_in_a_row_get_their_own_fragments_bit_for_bit() {
    let pose = Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z);
    let geometry = room();
    for lens in lenses() {
        let mut rays = Rays::default();
        assert!(rays.update(&lens, 4) && !rays.update(&lens, 4));
        let view = View::of(&pose);
        let projected = project(&rays, &view, &geometry);
        let mut counts = Image::default();
        let shade = |row: &Row<'_>, out: &mut [usize]| {
            let mut k = 0;
            while k < out.len() {
                let count = row.run(k, 8);
                assert!((1..=8).contains(&count));
                let points = row.points::<8>(k, count).unwrap();
                for lane in 0..8 {
                    let fragment = row.fragment(k + lane.min(count - 1)).unwrap();
                    assert_eq!(Some(fragment.triangle), row.triangle(k));
                    assert_eq!(fragment.pixel, row.pixel(k + lane.min(count - 1)));
                    assert_eq!(fragment.point_world.to_array(), points.point_world.map(|axis| axis[lane]));
                    assert_eq!((-fragment.to_eye).to_array(), points.away.map(|axis| axis[lane]));
                }
                let facet = geometry.facet_normals[row.triangle(k).unwrap()];
                let front = (k..k + count).all(|k| facet.dot(row.fragment(k).unwrap().to_eye) >= 0.0);
                assert_eq!(points.see_front(facet), front);
                out[k..k + count].fill(count);
                k += count;
            }
        };
        draw_rows(&rays, &view, &projected, 0, shade, &mut Samples::default(), &mut counts);
        assert!(counts.pixels().iter().filter(|c| **c == 8).count() > 3000);
    }
}
