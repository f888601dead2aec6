use super::*;
use crate::nearfield::fixture;
use proptest::prelude::*;
use std::sync::LazyLock;

static FIELD: LazyLock<NearField> = LazyLock::new(|| {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    fixture::field(&room, 220, &fixture::ALL)
});

fn boxed(centre: Vec3, half: Vec3) -> Aabb {
    Aabb { low: centre - half, high: centre + half }
}

/// Whether the segment between two points meets a box: a shaft between points.
fn segment_meets(from: Vec3, to: Vec3, object: &Aabb) -> bool {
    shaft_interval(&Aabb::around([from]), &Aabb::around([to]), object).is_some()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn nothing_that_may_be_hidden_is_missed(
        centre in prop::array::uniform3(-1.0f32..1.0), half in prop::array::uniform3(0.0f32..0.3),
    ) {
        let field = &*FIELD;
        let object = boxed(Vec3::from(centre) * Vec3::new(1.9, 1.4, 0.7) + Vec3::Z * 0.5, Vec3::from(half));
        let mut marks = Marks::default();
        marks.mark(field, &[object], None);
        for (i, source) in field.sources.iter().enumerate() {
            for (first, codes) in field.transfers().blocks(i) {
                for (v, _) in codes.iter().enumerate().filter(|(_, t)| **t > 0) {
                    let vertex = first + v;
                    if segment_meets(source.centre_world, field.patches.vertices[vertex].position_world, &object) {
                        prop_assert!(marks.has_source(i) && marks.has_vertex(vertex), "{} {}", i, vertex);
                    }
                }
            }
        }
        prop_assert!(marks.sources().windows(2).all(|w| w[0] < w[1]));
        prop_assert!(marks.vertices().windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn many_objects_mark_what_each_marks(
        objects in prop::collection::vec((prop::array::uniform3(-1.0f32..1.0), 0.0f32..0.1), 0..6),
    ) {
        let field = &*FIELD;
        let boxes: Vec<Aabb> =
            objects.iter().map(|(c, h)| boxed(Vec3::from(*c), Vec3::splat(*h))).collect();
        let (mut together, mut alone) = (Marks::default(), Marks::default());
        together.mark(field, &boxes, None);
        let (mut sources, mut vertices) = (std::collections::BTreeSet::new(), std::collections::BTreeSet::new());
        for object in &boxes {
            alone.mark(field, &[*object], None);
            sources.extend(alone.sources().iter().copied());
            vertices.extend(alone.vertices().iter().copied());
        }
        prop_assert_eq!(together.sources(), sources.into_iter().collect::<Vec<_>>());
        prop_assert_eq!(together.vertices(), vertices.into_iter().collect::<Vec<_>>());
    }
}

#[test]
fn a_small_object_marks_little_and_a_hundred_are_fine() {
    // A lamp alone: where walls shine too, what stands in a corner is before all of them.
    let field = &fixture::field(&fixture::room(), 400, &fixture::ALL);
    let mut marks = Marks::default();
    // In a corner of the floor: the lamp's light to that corner, and little else.
    let object = boxed(Vec3::new(-1.9, 1.4, -0.7), Vec3::splat(0.04));
    marks.mark(field, &[object], None);
    assert!(marks.vertices().len() * 3 < field.patches.vertices.len(), "{}", marks.vertices().len());
    assert!(marks.tested() * 2 < field.shafts.len(), "{}", marks.tested());
    let hundred: Vec<Aabb> =
        (0..100).map(|i| boxed(Vec3::new(-1.9, 1.4, -0.7 + 0.02 * i as f32), Vec3::splat(0.04))).collect();
    marks.mark(field, &hundred, None);
    let tested = marks.tested();
    assert!(tested < 100 * field.shafts.len() / 4, "{tested}");
    assert!(!marks.sources().is_empty());
}

#[test]
fn objects_that_are_nowhere_or_everywhere() {
    let field = &*FIELD;
    let mut marks = Marks::default();
    let nan = Aabb { low: Vec3::NAN, high: Vec3::ONE };
    for nothing in [&[][..], &[Aabb::EMPTY], &[nan], &[boxed(Vec3::splat(50.0), Vec3::ONE)]] {
        marks.mark(field, nothing, None);
        assert!(marks.sources().is_empty() && marks.vertices().is_empty(), "{nothing:?}");
        assert!((0..field.sources.len()).all(|s| !marks.has_source(s)));
    }
    marks.mark(field, &[boxed(Vec3::ZERO, Vec3::splat(10.0))], None);
    assert_eq!(marks.sources().len(), field.sources.len());
    // An object around the lamp marks the lamp, and every place that it lights.
    let lamp = boxed(Vec3::new(0.6, -0.4, 1.74), Vec3::new(0.31, 0.31, 0.02));
    marks.mark(field, &[lamp], None);
    for (i, source) in field.sources.iter().enumerate().filter(|(_, s)| s.luminance > 1.0) {
        assert!(marks.has_source(i), "{source:?}");
        for (first, codes) in field.transfers().blocks(i) {
            assert!(codes.iter().enumerate().all(|(v, t)| *t == 0 || marks.has_vertex(first + v)));
        }
    }
}

#[test]
fn only_receivers_in_the_view_count() {
    let field = &*FIELD;
    let lens = Lens::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0);
    let object = boxed(Vec3::new(0.0, 0.0, 0.2), Vec3::splat(0.1));
    let (mut all, mut seen, mut view) = (Marks::default(), Marks::default(), SeenReceivers::default());
    all.mark(field, &[object], None);
    // Down at the table: what projects into the picture from in front is in the view.
    let eye = DVec3::new(-1.0, -1.0, 1.2);
    let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z);
    view.look(field, &lens, &pose);
    let inside = |p: glam::DVec2| p.x >= 0.0 && p.y >= 0.0 && p.x <= 640.0 && p.y <= 480.0;
    let mut in_picture = 0;
    for (item, &i) in field.receivers.iter().enumerate() {
        let patch = &field.patches.patches[i as usize];
        let at = patch.centre_world.as_dvec3();
        if patch.normal_world.as_dvec3().dot(eye - at) > 0.0
            && lens.project(pose.inverse().transform(at)).is_some_and(inside)
        {
            in_picture += 1;
            assert!(view.receivers[item]);
        }
    }
    let counted = view.receivers.iter().filter(|r| **r).count();
    assert!(in_picture > 20 && counted < field.receivers.len() / 2, "{in_picture} {counted}");
    seen.mark(field, &[object], Some(&view));
    assert!(seen.vertices().len() < all.vertices().len() && !seen.vertices().is_empty());
    assert!(seen.vertices().iter().all(|v| all.has_vertex(*v as usize)));
    // Straight up from above the ceiling nothing is seen; a fisheye that sees all round sees all fronts.
    view.look(field, &lens, &Pose::look_at(DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.0, 0.0, 9.0), DVec3::X));
    assert!(view.receivers.iter().all(|r| !r) && view.nodes.iter().all(|n| !n));
    seen.mark(field, &[object], Some(&view));
    assert!(seen.sources().is_empty());
    let fisheye =
        Lens { distortion: crate::math::lens::Distortion::Equidistant([0.0; 4]), fx: 80.0, fy: 80.0, ..lens };
    view.look(field, &fisheye, &Pose::look_at(DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, DVec3::X));
    let fronts = field.receivers.iter().filter(|&&i| {
        let patch = &field.patches.patches[i as usize];
        patch.normal_world.dot(Vec3::Z - patch.centre_world) > 0.0
    });
    assert_eq!(view.receivers.iter().filter(|r| **r).count(), fronts.count());
}

#[test]
fn frames_do_not_remember_and_do_not_grow() {
    let field = &*FIELD;
    let mut marks = Marks::default();
    let places: Vec<Aabb> =
        (0..8).map(|i| boxed(Vec3::new(-1.0 + 0.25 * i as f32, 0.0, 0.3), Vec3::splat(0.1))).collect();
    for object in &places {
        marks.mark(field, &[*object], None);
    }
    let held =
        |m: &Marks| [m.sources.capacity(), m.leaves.capacity(), m.vertices.capacity(), m.stack.capacity()];
    let before = held(&marks);
    for object in &places {
        marks.mark(field, &[*object], None);
        let mut fresh = Marks::default();
        fresh.mark(field, &[*object], None);
        assert_eq!((marks.sources(), marks.vertices()), (fresh.sources(), fresh.vertices()));
    }
    assert_eq!(before, held(&marks));
    // The counter's end.
    marks.frame = u32::MAX - 1;
    for object in &places {
        marks.mark(field, &[*object], None);
        let mut fresh = Marks::default();
        fresh.mark(field, &[*object], None);
        assert_eq!(marks.sources(), fresh.sources());
    }
}
