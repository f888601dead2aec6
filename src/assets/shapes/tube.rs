//! Closed tubes.

use super::push;
use crate::model::scene::Mesh;
use glam::DVec3;
use std::f64::consts::TAU;

/// A ring about the z axis, centred on the origin: `radius` to the middle of the wire.
pub fn torus(radius: f64, wire_radius: f64, segments: u32, sides: u32) -> Mesh {
    tube(segments, sides, wire_radius, |t| {
        let (sine, cosine) = (TAU * t).sin_cos();
        let out = DVec3::new(cosine, sine, 0.0);
        (out * radius, out, DVec3::Z)
    })
}

/// A (2, 3) torus knot about the z axis, centred on the origin, about 3 `radius` wide and 2 high.
pub fn torus_knot(radius: f64, wire_radius: f64, segments: u32, sides: u32) -> Mesh {
    let at = |t: f64| {
        let (long, short) = (2.0 * TAU * t, 3.0 * TAU * t);
        let out = radius * (1.0 + 0.5 * short.cos());
        DVec3::new(out * long.cos(), out * long.sin(), 0.5 * radius * short.sin())
    };
    tube(segments, sides, wire_radius, |t| {
        let centre = at(t);
        let along = (at(t + 1e-5) - at(t - 1e-5)).normalize_or(DVec3::X);
        // Away from the core circle of the torus: never along the knot, and the same after a whole turn.
        let core = DVec3::new(centre.x, centre.y, 0.0).normalize_or(DVec3::X) * radius;
        let away = centre - core;
        let first = (away - along * away.dot(along)).normalize_or(DVec3::Z);
        (centre, first, first.cross(along))
    })
}

/// Sweeps a circle along a closed curve: `frame(t)`, t within 0 to 1, gives the centre and two unit vectors across
/// the curve with first x second pointing back along it.
fn tube(segments: u32, sides: u32, wire_radius: f64, frame: impl Fn(f64) -> (DVec3, DVec3, DVec3)) -> Mesh {
    let (segments, sides) = (segments.clamp(3, 8192), sides.clamp(3, 1024));
    let mut mesh = Mesh::default();
    for segment in 0..segments {
        let (centre, first, second) = frame(f64::from(segment) / f64::from(segments));
        for side in 0..sides {
            let (sine, cosine) = (TAU * f64::from(side) / f64::from(sides)).sin_cos();
            let normal = first * cosine + second * sine;
            push(&mut mesh, centre + normal * wire_radius, normal);
        }
    }
    for segment in 0..segments {
        for side in 0..sides {
            let index = |s: u32, k: u32| (s % segments) * sides + k % sides;
            let [a, b] = [index(segment, side), index(segment + 1, side)];
            let [c, d] = [index(segment + 1, side + 1), index(segment, side + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}
