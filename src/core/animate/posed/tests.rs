use super::*;
use crate::model::animation::{
    AnimationChannel, BoundSphere, Clip, Interpolation, Joint, Moves, Playing, Skeleton, SkeletonNode, Walk,
};
use crate::model::scene::{Material, Mesh, VirtualObject};
use glam::{Quat, Vec2, Vec4};

fn object(name: &str) -> VirtualObject {
    VirtualObject {
        name: name.into(),
        mesh: Mesh {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z],
            normals: vec![Vec3::Z; 3],
            tints_rgb: vec![[1.0; 3]; 3],
            triangles: vec![[0, 1, 2]],
        },
        material: Material::Lambert { albedo_rgb: [0.5; 3] },
        world_from_object: Affine3A::from_translation(Vec3::Z),
        openness: vec![1.0; 3],
    }
}

/// One node that a clip lifts by 1 m in 1 s and turns about x, one object on it, one sphere; scaled to half.
fn lifted(object: usize) -> Figure {
    let node = SkeletonNode { name: "bone".into(), parent: None, rest: Transform::IDENTITY };
    let joint = Joint { node: 0, node_from_bind: Affine3A::from_translation(-Vec3::X) };
    let channel = |moves, to: Vec4, from: Vec4| AnimationChannel {
        node: 0,
        moves,
        interpolation: Interpolation::Linear,
        times_s: vec![0.0, 1.0],
        values: vec![from, to],
    };
    let quarter = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    Figure {
        name: "figure".into(),
        skeleton: Skeleton { nodes: vec![node], joints: vec![joint], figure_from_root: Affine3A::IDENTITY },
        clips: vec![Clip {
            name: "lift".into(),
            start_s: 0.0,
            duration_s: 1.0,
            channels: vec![
                channel(Moves::Translation, Vec4::Z, Vec4::ZERO),
                channel(Moves::Rotation, quarter.into(), Vec4::W),
                channel(Moves::Scale, Vec4::ONE * 2.0, Vec4::ONE * 2.0),
            ],
        }],
        parts: vec![FigurePart {
            object,
            attachment: Attachment::Skinned {
                bind_positions: vec![Vec3::X, Vec3::X * 2.0, Vec3::X + Vec3::Y],
                bind_normals: vec![Vec3::Y; 3],
                joints: vec![[0; 4]; 3],
                weights: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            },
        }],
        world_from_figure: Affine3A::from_scale(Vec3::splat(0.5)),
        playing: Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: false }),
        walk: None,
        sphere_count: 4,
        spheres: vec![BoundSphere { node: 0, centre_node: Vec3::Y, radius_node: 0.25 }],
        boxes: Vec::new(),
    }
}

fn scene() -> Scene {
    Scene {
        objects: vec![object("still"), object("moving"), object("body")],
        figures: vec![lifted(1)],
        ..Scene::default()
    }
}

#[test]
fn vertices_and_spheres_follow_their_node() {
    let mut posed = Posed::new(&scene());
    posed.update(&scene(), 1.0);
    // Half of: lifted by 1, turned y to z, scaled by 2.
    let moving = &posed.objects()[1];
    for (found, expected) in moving.positions_world.iter().zip([
        Vec3::new(0.0, 0.0, 0.5),
        Vec3::new(1.0, 0.0, 0.5),
        Vec3::new(0.0, 0.0, 1.5),
    ]) {
        assert!(found.abs_diff_eq(expected, 1e-6), "{found} {expected}");
    }
    assert!(moving.normals_world.iter().all(|n| n.abs_diff_eq(Vec3::Z, 1e-6)));
    let [sphere] = posed.spheres() else { panic!("{:?}", posed.spheres()) };
    assert!(sphere.centre_world.abs_diff_eq(Vec3::new(0.0, 0.0, 1.5), 1e-6), "{sphere:?}");
    assert!((sphere.radius_m - 0.25).abs() < 1e-6 && sphere.body == 1, "{sphere:?}");
    assert_eq!(posed.objects()[0].positions_world, [Vec3::X + Vec3::Z, Vec3::Y + Vec3::Z, Vec3::Z * 2.0]);
}

#[test]
fn only_what_moves_counts_as_moved() {
    let mut scene = scene();
    let moved = |posed: &Posed| posed.objects().iter().map(|o| o.moved).collect::<Vec<_>>();
    let mut posed = Posed::new(&scene);
    assert_eq!(moved(&posed), [true; 3]);
    posed.update(&scene, 0.5);
    assert_eq!(moved(&posed), [false, true, false]);
    // Resting again is seen by a new `Posed` only; a still figure stays where it was put.
    scene.figures[0].playing = None;
    let mut posed = Posed::new(&scene);
    posed.update(&scene, 7.0);
    assert_eq!((moved(&posed), posed.spheres().len()), (vec![false; 3], 1));
    // Another scene is noticed.
    scene.objects.pop();
    posed.update(&scene, 7.0);
    assert_eq!(moved(&posed), [true; 2]);
}

#[test]
fn bodies_are_numbered_by_their_first_object() {
    let mut scene = scene();
    let second = FigurePart { object: 0, attachment: Attachment::Rigid { joint: 0 } };
    scene.figures[0].parts.push(second);
    let posed = Posed::new(&scene);
    assert_eq!(posed.objects().iter().map(|o| o.body).collect::<Vec<_>>(), [1, 1, 2]);
}

#[test]
fn a_walk_carries_the_whole_figure() {
    let mut scene = scene();
    let corners = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]].map(Vec2::from);
    let legs = walk::round_corners(&corners).unwrap();
    scene.figures[0].playing = None;
    scene.figures[0].walk = Some(Walk { legs, speed_m_s: 0.1 });
    let mut posed = Posed::new(&scene);
    let start = posed.objects()[1].positions_world.clone();
    assert_eq!(start[0].y, 0.0);
    posed.update(&scene, 1.0);
    for (before, after) in start.iter().zip(&posed.objects()[1].positions_world) {
        assert!((*after - *before).abs_diff_eq(Vec3::X * 0.1, 1e-6), "{before} {after}");
    }
}

#[test]
fn times_and_references_out_of_range_are_taken() {
    let mut scene = scene();
    scene.figures[0].parts.push(FigurePart { object: 77, attachment: Attachment::Rigid { joint: 9 } });
    scene.figures[0].spheres.push(BoundSphere { node: 5, centre_node: Vec3::ZERO, radius_node: 1.0 });
    scene.figures.push(Figure { parts: Vec::new(), clips: Vec::new(), ..lifted(0) });
    let mut posed = Posed::new(&scene);
    for t in [0.3, -5.0, 1e300, f64::NAN, f64::INFINITY] {
        posed.update(&scene, t);
        for object in posed.objects() {
            assert!(object.positions_world.iter().all(|p| p.is_finite()), "{t}");
            assert!(object.normals_world.iter().all(|n| (n.length() - 1.0).abs() < 1e-5), "{t}");
        }
    }
    let mut again = Posed::new(&scene);
    again.update(&scene, 0.37);
    posed.update(&scene, 0.37);
    assert_eq!(
        (again.objects()[1].positions_world.clone(), again.spheres().len()),
        (posed.objects()[1].positions_world.clone(), posed.spheres().len())
    );
}
