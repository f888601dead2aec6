//! What of a room hides a sun: the geometry that the room's own shadow under it is drawn from.

use crate::model::room::{Room, RoomSun};
use glam::{DVec3, Vec3};

/// Pieces whose area is below this share of the squared size of what they were cut from are left out.
const NO_AREA: f64 = 1e-12;
/// What lies so near behind an aperture, in its sizes, lies behind it.
const TOUCHING: f64 = 1e-6;

/// Triangles of a room that hide a sun: all but its apertures and what, seen from inside along the sun's direction, lies
/// behind them. Windows are often modelled before an unbroken wall: the wall gets a hole where the sun's rays pass through
/// the window. Agrees with `Faces::leaves` for rays towards the sun. Positions are not shared.
pub fn sun_blockers(room: &Room, sun: &RoomSun) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let towards = Vec3::from(sun.to_light_world).as_dvec3();
    let is_aperture = |index: usize| sun.apertures.binary_search(&(index as u32)).is_ok();
    let of_surfaces = |apertures: bool| {
        let chosen = room.surfaces.iter().enumerate().filter(move |(i, _)| is_aperture(*i) == apertures);
        chosen.flat_map(|(_, surface)| {
            surface.faces.iter().flat_map(|face| {
                let corner = |i: u32| surface.corners_world.get(i as usize).filter(|p| p.is_finite());
                let list = face.corners();
                let triangle = move |k: usize| {
                    let [a, b, c] = [list[0], list[k], list[k + 1]].map(corner);
                    Some([a?.as_dvec3(), b?.as_dvec3(), c?.as_dvec3()])
                };
                (1..list.len() - 1).filter_map(triangle)
            })
        })
    };
    let holes: Vec<Hole> = of_surfaces(true).filter_map(|corners| Hole::new(corners, towards)).collect();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for triangle in of_surfaces(false) {
        let mut pieces = vec![triangle.to_vec()];
        for hole in &holes {
            pieces = pieces.into_iter().flat_map(|piece| hole.cut(piece)).collect();
        }
        for piece in pieces {
            let base = positions.len() as u32;
            positions.extend(piece.iter().map(|p| p.as_vec3()));
            triangles.extend((1..piece.len() as u32 - 1).map(|k| [base, base + k, base + k + 1]));
        }
    }
    (positions, triangles)
}

/// A plane: a unit normal, and its product with a point of it.
type ClipPlane = (DVec3, f64);

/// The space behind a triangle, as far as the sun's rays through it go.
struct Hole {
    /// Its sides, which contain the sun's direction; normals point in.
    sides: [ClipPlane; 3],
    /// The triangle's own plane; its normal points to the sun.
    front: ClipPlane,
}

impl Hole {
    /// `None` where the sun's rays graze the triangle or it has no area.
    fn new(corners: [DVec3; 3], towards: DVec3) -> Option<Self> {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).try_normalize()?;
        let normal = if normal.dot(towards) < 0.0 { -normal } else { normal };
        let middle = (a + b + c) / 3.0;
        let side = |from: DVec3, to: DVec3| -> Option<ClipPlane> {
            let across = (to - from).cross(towards).try_normalize()?;
            let inwards = if across.dot(middle - from) < 0.0 { -across } else { across };
            Some((inwards, inwards.dot(from)))
        };
        let size = a.distance(b).max(a.distance(c));
        let front = (normal, normal.dot(a) - TOUCHING * size);
        (normal.dot(towards) > 1e-6).then_some(Self { sides: [side(a, b)?, side(b, c)?, side(c, a)?], front })
    }

    /// The parts of a convex outline that are not in the hole.
    fn cut(&self, outline: Vec<DVec3>) -> Vec<Vec<DVec3>> {
        let whole = outline.clone();
        let (mut kept, mut rest) = (Vec::new(), outline);
        for plane in self.sides.iter().chain([&self.front]) {
            let (inside, outside) = split(&rest, plane);
            if has_area(&outside, &whole) {
                kept.push(outside);
            }
            rest = inside;
            if !has_area(&rest, &whole) {
                // Nothing of it is in the hole: it stays in one piece.
                return vec![whole];
            }
        }
        kept
    }
}

/// The part on the side of the plane's normal, and the other.
fn split(outline: &[DVec3], &(normal, at): &ClipPlane) -> (Vec<DVec3>, Vec<DVec3>) {
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for (k, &p) in outline.iter().enumerate() {
        let q = outline[(k + 1) % outline.len()];
        let (here, there) = (normal.dot(p) - at, normal.dot(q) - at);
        if here >= 0.0 {
            inside.push(p)
        } else {
            outside.push(p)
        }
        if (here >= 0.0) != (there >= 0.0) {
            let between = p.lerp(q, here / (here - there));
            inside.push(between);
            outside.push(between);
        }
    }
    (inside, outside)
}

fn has_area(outline: &[DVec3], of: &[DVec3]) -> bool {
    let twice = |list: &[DVec3]| -> f64 {
        let pairs =
            (1..list.len().saturating_sub(1)).map(|k| (list[k] - list[0]).cross(list[k + 1] - list[0]));
        pairs.sum::<DVec3>().length()
    };
    outline.len() >= 3 && twice(outline) > NO_AREA * twice(of)
}

#[cfg(test)]
mod tests {
    use super::super::{faces::Faces, fixture};
    use super::*;
    use crate::{
        math::bvh::Bvh,
        model::room::{Face, RoomSurface},
    };
    use proptest::prelude::*;

    fn with_window(inset: f32) -> Room {
        let corner = |y: f32, z: f32| Vec3::new(-2.0 + inset, y, z);
        let window = RoomSurface {
            name: "window".into(),
            corners_world: vec![corner(-0.8, 0.2), corner(0.8, 0.2), corner(0.8, 1.5), corner(-0.8, 1.5)],
            faces: vec![Face::Quad([0, 1, 2, 3])],
            ..RoomSurface::default()
        };
        let mut room = fixture::room();
        room.surfaces.push(window);
        room
    }

    fn sun(towards: Vec3) -> RoomSun {
        RoomSun {
            to_light_world: towards.normalize().to_array(),
            irradiance_rgb: [1.0; 3],
            extent_rad: 0.0,
            apertures: vec![3],
        }
    }

    proptest! {
        #[test]
        fn a_ray_is_hidden_where_it_does_not_leave(
            inset in prop_oneof![Just(0.002f32), Just(0.3)],
            y in -1.0f32..1.0, z in 0.05f32..1.5,
            places in prop::collection::vec(prop::array::uniform3(0.01f32..0.99), 60),
        ) {
            let room = with_window(inset);
            let sun = sun(Vec3::new(-2.0, y, z));
            let towards = Vec3::from(sun.to_light_world);
            let faces = Faces::of_room(&room);
            let (positions, triangles) = sun_blockers(&room, &sun);
            let bvh = Bvh::build(&positions, &triangles);
            let mut wrong = 0;
            for p in places {
                let from = Vec3::new(-1.69 + 3.68 * p[0], -1.5 + 3.0 * p[1], -0.75 + 2.5 * p[2]);
                let hidden = bvh.occluded(from, towards, 0.0, f32::INFINITY);
                wrong += u32::from(hidden == faces.leaves(from, towards, &sun.apertures));
            }
            // Rays along an edge may be decided either way.
            prop_assert!(wrong <= 1, "{wrong} of 60");
        }
    }

    #[test]
    fn the_hole_is_as_large_as_the_window() {
        let area = |(positions, triangles): (Vec<Vec3>, Vec<[u32; 3]>)| -> f32 {
            let each = triangles.iter().map(|t| {
                let [a, b, c] = t.map(|i| positions[i as usize]);
                0.5 * (b - a).cross(c - a).length()
            });
            each.sum()
        };
        let room = with_window(0.002);
        let straight = sun(Vec3::new(-1.0, 0.0, 0.3));
        let all = area(sun_blockers(&room, &RoomSun { apertures: Vec::new(), ..straight.clone() }));
        let open = area(sun_blockers(&room, &straight));
        // The window itself, and its shadow on the wall: 1.6 x 1.3 m each.
        assert!((all - open - 2.0 * 2.08).abs() < 1e-3, "{all} {open}");
    }
}
