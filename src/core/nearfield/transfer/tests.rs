use super::*;
use crate::nearfield::fixture;

#[test]
fn half_behind_the_table_is_half_visible() {
    // Below the table's edge, seen from a floor place from which the edge halves the lamp.
    let room = fixture::room();
    let field = fixture::field(&room, 60, &fixture::ALL);
    let statics = Statics::new(&room);
    let lamp = RoomPatch {
        corners: [0, 1, 2, 3],
        centre_world: Vec3::new(0.6, -0.4, 1.74),
        normal_world: Vec3::NEG_Z,
        area_m2: 0.36,
        ..field.patches.patches[0]
    };
    let mut patches = RoomPatches::default();
    for (x, y) in [(0.3, -0.7), (0.3, -0.1), (0.9, -0.1), (0.9, -0.7)] {
        patches.vertices.push(crate::model::room::PatchVertex {
            position_world: Vec3::new(x, y, 1.74),
            gather_world: Vec3::ZERO,
            normal_world: Vec3::NEG_Z,
        });
    }
    let outline = SourceOutline::new(&patches, &lamp, 5);
    // From (x, -0.4) on the floor, through the edge x = 0.6 of the table's lower side (0.71 above it) to the lamp's
    // middle at x = 0.6: straight up.
    let whole = form_factor(
        glam::DVec3::new(0.6, -0.2, -0.7499),
        glam::DVec3::Z,
        &[(0.3, -0.7), (0.3, -0.1), (0.9, -0.1), (0.9, -0.7)].map(|(x, y)| glam::DVec3::new(x, y, 1.74)),
    ) as f32;
    let mut sum = 0.0;
    for vertex in 0..64 {
        sum += outline.transfer(&statics, Vec3::new(0.6, -0.2, -0.7499), Vec3::Z, vertex, 4) / whole / 64.0;
    }
    assert!((sum - 0.5).abs() < 0.01, "{sum}");
    // Shifts differ from vertex to vertex, and one ray each is right in the mean too.
    let single: f32 = (0..1024)
        .map(|v| outline.transfer(&statics, Vec3::new(0.6, -0.2, -0.7499), Vec3::Z, v, 1) / whole / 1024.0)
        .sum();
    assert!((single - 0.5).abs() < 0.02, "{single}");
    // From behind the lamp, and from below the floor's horizon: nothing.
    assert_eq!(outline.transfer(&statics, Vec3::new(0.6, -0.4, 1.745), Vec3::Z, 0, 1), 0.0);
    assert_eq!(outline.transfer(&statics, Vec3::new(0.6, -0.4, 1.0), Vec3::NEG_Z, 0, 1), 0.0);
}
