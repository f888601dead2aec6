//! Surfaces of revolution from drawn profiles.

use super::revolve;
use crate::model::scene::Mesh;

/// One point of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfilePoint {
    /// Distance from the axis, not negative.
    pub radius: f64,
    /// Height.
    pub z: f64,
    /// The surface has an edge here; else it passes smoothly.
    pub sharp: bool,
}

impl ProfilePoint {
    /// A point that the curve passes smoothly.
    pub const fn smooth(radius: f64, z: f64) -> Self {
        Self { radius, z, sharp: false }
    }

    /// A point where the surface has an edge.
    pub const fn sharp(radius: f64, z: f64) -> Self {
        Self { radius, z, sharp: true }
    }
}

/// Turns a profile about the z axis. The profile runs from bottom to top with the outside to its right (starting
/// and ending on the axis gives a closed surface). Between edges the points are joined by a
/// cubic (Catmull-Rom, ends extended straight) in `steps` pieces each; two points between edges give a straight line.
pub fn lathe(profile: &[ProfilePoint], segments: u32, steps: u32) -> Mesh {
    let steps = steps.clamp(1, 64);
    let mut pieces = Vec::new();
    let mut start = 0;
    for end in 1..profile.len() {
        if profile[end].sharp || end + 1 == profile.len() {
            pieces.push(curve(&profile[start..=end], steps));
            start = end;
        }
    }
    revolve(&pieces, segments)
}

/// Points and normals along one smooth piece.
fn curve(points: &[ProfilePoint], steps: u32) -> Vec<(f64, f64, f64, f64)> {
    let at = |k: isize| -> [f64; 2] {
        let last = points.len() as isize - 1;
        let of = |i: isize| [points[i as usize].radius, points[i as usize].z];
        let extend = |end: [f64; 2], inner: [f64; 2]| [2.0 * end[0] - inner[0], 2.0 * end[1] - inner[1]];
        match k {
            k if k < 0 => extend(of(0), of(1)),
            k if k > last => extend(of(last), of(last - 1)),
            k => of(k),
        }
    };
    let steps = if points.len() == 2 { 1 } else { steps };
    let mut out = Vec::new();
    for segment in 0..points.len() as isize - 1 {
        let p: [[f64; 2]; 4] = [-1, 0, 1, 2].map(|offset| at(segment + offset));
        let last = segment == points.len() as isize - 2;
        for step in 0..steps + u32::from(last) {
            let t = f64::from(step) / f64::from(steps);
            let cubic = |c: usize| {
                let [a, b, d, e] = p.map(|q| q[c]);
                let (slope0, slope1) = (0.5 * (d - a), 0.5 * (e - b));
                let (k2, k3) = (3.0 * (d - b) - 2.0 * slope0 - slope1, 2.0 * (b - d) + slope0 + slope1);
                let value = b + t * (slope0 + t * (k2 + t * k3));
                (value, slope0 + t * (2.0 * k2 + t * 3.0 * k3))
            };
            let ((radius, radius_slope), (z, z_slope)) = (cubic(0), cubic(1));
            // The ends are taken as drawn, so that a point on the axis is exactly on it.
            let on_axis = (step == 0 && p[1][0] == 0.0) || (last && step == steps && p[2][0] == 0.0);
            let radius = if on_axis { 0.0 } else { radius.max(0.0) };
            // A smooth point on the axis has a level surface: straight up, or down at the bottom.
            let end = (segment == 0 && step == 0) || (last && step == steps);
            let (normal_r, normal_z) = if on_axis && end && points.len() > 2 {
                (0.0, if segment == 0 && step == 0 { -1.0 } else { 1.0 })
            } else {
                (z_slope, -radius_slope)
            };
            out.push((radius, z, normal_r, normal_z));
        }
    }
    out
}

/// A chess pawn of the given height standing on z = 0; its base has 0.325 of the height as radius.
pub fn pawn(height: f64, segments: u32) -> Mesh {
    use ProfilePoint as P;
    let mut profile = vec![
        P::sharp(0.0, 0.0),
        P::sharp(0.305, 0.0),
        P::smooth(0.325, 0.03),
        P::smooth(0.319, 0.075),
        P::sharp(0.285, 0.10),
        P::smooth(0.275, 0.13),
        P::smooth(0.245, 0.17),
        P::sharp(0.205, 0.195),
        P::smooth(0.165, 0.24),
        P::smooth(0.128, 0.32),
        P::smooth(0.105, 0.42),
        P::smooth(0.095, 0.53),
        P::sharp(0.105, 0.61),
        P::smooth(0.185, 0.632),
        P::smooth(0.195, 0.655),
        P::sharp(0.125, 0.69),
    ];
    // The head: a ball of radius 0.175 about z = 0.825 from where the collar meets it.
    let (centre, radius) = (0.825, 0.175f64);
    let from = ((0.69 - centre) / radius).asin();
    let steps = 8;
    for k in 1..=steps {
        let angle = from + (std::f64::consts::FRAC_PI_2 - from) * f64::from(k) / f64::from(steps);
        let r = if k == steps { 0.0 } else { radius * angle.cos() };
        profile.push(P::smooth(r, centre + radius * angle.sin()));
    }
    profile.iter_mut().for_each(|p| {
        p.radius *= height;
        p.z *= height;
    });
    // The collar's point must lie on the ball.
    profile[15].radius = (radius * from.cos()) * height;
    lathe(&profile, segments, 6)
}

/// An open vase of the given height with a wall of its own, standing on z = 0.
pub fn vase(height: f64, segments: u32) -> Mesh {
    use ProfilePoint as P;
    let profile = [
        P::sharp(0.0, 0.0),
        P::sharp(0.17, 0.0),
        P::smooth(0.20, 0.04),
        P::smooth(0.27, 0.20),
        P::smooth(0.30, 0.38),
        P::smooth(0.25, 0.58),
        P::smooth(0.14, 0.76),
        P::smooth(0.12, 0.84),
        P::smooth(0.15, 0.94),
        P::sharp(0.20, 1.0),
        P::sharp(0.18, 1.0),
        P::smooth(0.13, 0.94),
        P::smooth(0.10, 0.84),
        P::smooth(0.12, 0.76),
        P::smooth(0.23, 0.57),
        P::smooth(0.275, 0.38),
        P::smooth(0.245, 0.20),
        P::sharp(0.17, 0.05),
        P::sharp(0.0, 0.05),
    ]
    .map(|p| P { radius: p.radius * height, z: p.z * height, sharp: p.sharp });
    lathe(&profile, segments, 6)
}
