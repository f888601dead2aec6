use super::*;
use crate::{math::bvh::Bvh, nearfield::fixture, sources::tree::SourceTree};
use std::sync::LazyLock;

static FIELD: LazyLock<NearField> = LazyLock::new(|| {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    fixture::field(&room, 400, &fixture::ALL)
});

fn boxed(centre: Vec3, half: f32) -> Aabb {
    Aabb { low: centre - half, high: centre + half }
}

#[derive(Default)]
struct MarkedFrame {
    marks: Marks,
    lights: Representatives,
    rows: Vec<[f32; 3]>,
}

impl MarkedFrame {
    fn draw(&mut self, field: &NearField, objects: &[Aabb], count: usize) {
        self.marks.mark(field, objects, None);
        self.lights.choose(
            field,
            &self.marks,
            objects,
            None,
            WantedNodes::exactly(count),
            Priority::ErrorRemoved,
        );
        self.lights.light_rows(field, &self.marks, &mut self.rows);
    }
}

#[test]
fn any_number_of_lights_sends_the_same_light() {
    let field = &*FIELD;
    let object = boxed(Vec3::new(0.1, 0.0, 0.2), 0.1);
    let vertices = field.patches.vertices.len();
    let mut frame = MarkedFrame::default();
    frame.draw(field, &[object], usize::MAX);
    assert_eq!(frame.lights.near().len(), frame.marks.sources().len());
    let sums = |rows: &[[f32; 3]]| -> Vec<f32> {
        (0..vertices).map(|v| rows.chunks(vertices).map(|row| row[v][1]).sum()).collect()
    };
    let all = sums(&frame.rows);
    let kept = all.iter().zip(&field.kept_rgb);
    assert!(kept.clone().all(|(a, k)| *a <= k[1] * 1.0001 + 1e-6), "no more than there is");
    assert!(kept.filter(|(a, k)| **a > 0.5 * k[1] && k[1] > 0.0).count() > 50, "and a good part of it");
    for count in [1, 2, 10, 50] {
        frame.draw(field, &[object], count);
        assert_eq!(frame.lights.near().len(), count);
        for (a, b) in all.iter().zip(sums(&frame.rows)) {
            assert!((a - b).abs() <= 1e-5 * (a + 0.01), "{count}: {a} {b}");
        }
        for light in frame.lights.near() {
            assert_eq!(light.centre_world, field.sources[light.source as usize].centre_world);
            assert!(light.middle_world.is_finite() && !light.inside);
            let [long, short] = light.half_axes_world;
            assert!(long.length() >= short.length() && long.dot(short).abs() < 1e-4);
        }
    }
}

#[test]
fn one_light_for_the_lamp_is_as_large_as_the_lamp() {
    let field = fixture::field(&fixture::room(), 300, &fixture::ALL);
    let mut frame = MarkedFrame::default();
    frame.draw(&field, &[boxed(Vec3::new(0.6, -0.4, 0.5), 0.2)], 1);
    let light = frame.lights.near()[0];
    // The lamp lies at (0.6, -0.4, 1.74) and has half sides of 0.3 m; the light that arrives is nearly even, and its mean
    // distance is a little more than its middle's.
    assert!(light.middle_world.distance(Vec3::new(0.6, -0.4, 1.74)) < 0.04, "{light:?}");
    for axis in light.half_axes_world {
        assert!((axis.length() - 0.3).abs() < 0.01 && axis.z.abs() < 1e-3, "{axis}");
    }
    assert!(light.centre_world.distance(light.middle_world) < 0.08, "{light:?}");
    assert_eq!(light.normal_world, Vec3::NEG_Z);
}

#[test]
fn a_vertex_sees_the_part_of_a_light_that_the_room_leaves_open() {
    // The lamp at (0.6, -0.4, 1.74) has half sides of 0.3 m. The floor under the table is in the table's penumbra.
    let field = fixture::field(&fixture::room(), 1500, &fixture::ALL);
    let mut frame = MarkedFrame::default();
    frame.draw(&field, &[boxed(Vec3::new(0.3, -0.2, -0.5), 0.2)], 1);
    let mut parts = Vec::new();
    frame.lights.light_parts(&field, &frame.marks, &mut parts);
    let light = frame.lights.near()[0];
    let (mut whole, mut partly) = (0, 0);
    for (v, vertex) in field.patches.vertices.iter().enumerate().filter(|(v, _)| frame.rows[*v] != [0.0; 3]) {
        // The same from the transfers, source by source.
        let (mut sum, mut moment) = (0.0, Vec3::ZERO);
        for (s, source) in field.sources.iter().enumerate().filter(|(s, _)| frame.marks.has_source(*s)) {
            let sent = field.transfers().at(s, v) * source.luminance;
            sum += sent;
            moment += sent * source.centre_world;
        }
        let (middle, half) = parts[v].middle_half();
        let seen = (0..2).fold(light.middle_world, |at, k| at + light.half_axes_world[k] * middle[k]);
        // Sources stand where they are seen from the object, at one distance: 6.03 cm is the most that this was off.
        assert!(seen.distance(moment / sum) < 0.062, "{}: {seen} {}", vertex.position_world, moment / sum);
        assert!((0..2).all(|k| middle[k].abs() + half[k] < 2.0));
        whole += usize::from(half[0] > 0.9 && half[1] > 0.9);
        partly += usize::from(half[0].min(half[1]) < 0.7);
    }
    assert!(whole > 50 && partly > 10, "{whole} {partly}");
}

#[test]
fn an_object_around_a_source_is_told_of() {
    let field = &*FIELD;
    let mut frame = MarkedFrame::default();
    frame.draw(field, &[boxed(Vec3::new(0.6, -0.4, 1.74), 0.4)], 4);
    assert!(frame.lights.near().iter().any(|l| l.inside));
    let hundred: Vec<Aabb> =
        (0..100).map(|i| boxed(Vec3::new(0.01 * i as f32 - 0.5, 0.2, 0.1), 0.03)).collect();
    frame.draw(field, &hundred, 8);
    assert_eq!(frame.lights.near().len(), 8);
    frame.draw(field, &[], 8);
    assert!(frame.lights.near().is_empty() && frame.rows.is_empty());
}

#[test]
fn a_sun_shares_the_count() {
    let field = &*FIELD;
    let object = boxed(Vec3::new(0.1, 0.0, 0.2), 0.1);
    // Sixteen texels of a far light as wide as a window, and as a sun, brighter than all of the room.
    let of = |width: f32| -> Vec<Vec3> {
        (0..16).map(|i| Vec3::new(0.3 + width * (i as f32 - 7.5), 0.2, 1.0).normalize()).collect()
    };
    let mut frame = MarkedFrame::default();
    frame.marks.mark(field, &[object], None);
    for (width, least, most) in [(0.05, 6, 11), (0.0005, 1, 4)] {
        let directions = of(width);
        let tree = SourceTree::build(&directions, &[1.0; 16]);
        let towards: Vec<Vec3> = tree.order().iter().map(|&i| directions[i as usize]).collect();
        let far = Marked { tree: &tree, light: &[0.5; 16], towards: &towards, lasting: false };
        frame.lights.choose(
            field,
            &frame.marks,
            &[object],
            Some(far),
            WantedNodes::exactly(12),
            Priority::ErrorRemoved,
        );
        let suns = frame.lights.far().len();
        assert_eq!(suns + frame.lights.near().len(), 12);
        assert!((least..=most).contains(&suns), "{width}: {suns}");
    }
}

#[test]
fn a_slow_object_changes_little_from_step_to_step() {
    let mut room = fixture::room();
    room.surfaces[0] = fixture::walls(0.05);
    let field = &fixture::field(&room, 1500, &fixture::ALL);
    let vertices = field.patches.vertices.len();
    let positions: Vec<Vec3> =
        (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 0.2 - 0.1).collect();
    let triangles: Vec<[u32; 3]> =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
            .into_iter()
            .flat_map(|[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]])
            .collect();
    // Places on the table at which the light taken away is looked at: its corners' vertices.
    let watched: Vec<usize> = (0..vertices)
        .filter(|&v| {
            let at = field.patches.vertices[v];
            at.normal_world == Vec3::Z && at.position_world.z == 0.0
        })
        .collect();
    let mut frame = MarkedFrame::default();
    let mut before: Option<(Vec<u32>, Vec<f32>)> = None;
    let (mut swapped, mut largest_step, mut lights, mut taken) = (0, 0.0f32, 0, 0.0f32);
    let whole: f32 = watched.iter().map(|&v| field.kept_rgb[v][1]).sum();
    const STEPS: usize = 100;
    for step in 0..STEPS {
        // Half a millimetre a step, at 30 steps a second a slow hand.
        let centre = Vec3::new(-0.3 + 0.0005 * step as f32, 0.05, 0.25);
        let object = boxed(centre, 0.1);
        let moved: Vec<Vec3> = positions.iter().map(|p| *p + centre).collect();
        let bvh = Bvh::build(&moved, &triangles);
        frame.draw(field, &[object], 10);
        let nodes: Vec<u32> = frame.lights.near().iter().map(|l| l.source).collect();
        lights += nodes.len();
        let removed: Vec<f32> = watched
            .iter()
            .map(|&v| {
                let at = field.patches.vertices[v].gather_world;
                let hidden = |l: &Representative| bvh.occluded(at, l.centre_world - at, 0.0, 1.0);
                let lights = frame.lights.near().iter().enumerate().filter(|(_, l)| hidden(l));
                lights.map(|(k, _)| frame.rows[k * vertices + v][1]).sum()
            })
            .collect();
        if let Some((old_nodes, old_removed)) = before {
            swapped += nodes.iter().filter(|n| !old_nodes.contains(n)).count();
            let change: f32 = removed.iter().zip(&old_removed).map(|(a, b)| (a - b).abs()).sum();
            largest_step = largest_step.max(change / whole);
        }
        taken = taken.max(removed.iter().sum::<f32>() / whole);
        before = Some((nodes, removed));
    }
    assert!(watched.len() > 10 && taken > 0.02, "{} {taken}: a shadow falls on the table", watched.len());
    println!("{swapped} of {lights} lights changed, largest step {largest_step} of {taken}");
    // 10 lights over 100 steps: at most one in fifty moves; and no step takes away or gives back more of the table's
    // light than one light passing over a few places does.
    assert!(swapped <= lights / 50, "{swapped} of {lights} lights changed");
    assert!(largest_step < 0.02, "{largest_step}");
}
