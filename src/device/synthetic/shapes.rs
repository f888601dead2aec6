//! Analytic shapes: where a ray meets them, and where a point of a face lies.

use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A shape in the world frame, metres. Faces are numbered; each has coordinates u, v in [0, 1].
#[derive(Clone, Debug)]
pub enum SyntheticShape {
    /// The inside of a box: what a room is. Face = 2 axis + (1 at the larger coordinate).
    Room {
        /// Smallest corner.
        min: DVec3,
        /// Largest corner.
        max: DVec3,
    },
    /// A box turned about z. Faces as of a room.
    Block {
        /// Its middle.
        centre: DVec3,
        /// Half its edges.
        half: DVec3,
        /// Cosine and sine of the angle about z.
        turn: DVec2,
    },
    /// An upright cylinder, hollow from above where `hollow` holds the inner radius and the height of
    /// the inner floor. Faces: 0 outside, 1 top or rim, 2 inside, 3 inner floor.
    Cylinder {
        /// Middle of its foot.
        base: DVec3,
        /// Outer radius.
        radius: f64,
        /// Metres.
        height: f64,
        /// Inner radius, height of the inner floor.
        hollow: Option<(f64, f64)>,
    },
    /// A sphere; one face.
    Sphere {
        /// Its middle.
        centre: DVec3,
        /// Metres; above 0.
        radius: f64,
    },
    /// A ring that stands upright, cut off inside an upright cylinder: the handle of a mug. One face.
    Handle {
        /// Middle of the ring.
        centre: DVec3,
        /// Unit horizontal vector in the ring's plane, away from the mug.
        outward: DVec3,
        /// Radius of the ring's middle line, radius of its tube.
        radii: DVec2,
        /// The mug's axis (x, y) and radius.
        mug: DVec3,
    },
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Which face.
    pub face: usize,
    /// Coordinates on the face.
    pub uv: DVec2,
    /// Unit normal, towards the side that is seen.
    pub normal: DVec3,
}

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];
const OTHERS: [(usize, usize); 3] = [(1, 2), (0, 2), (0, 1)];

impl SyntheticShape {
    /// A box by its smallest and largest corner.
    pub fn block(min: [f64; 3], max: [f64; 3]) -> Self {
        let (min, max) = (DVec3::from(min), DVec3::from(max));
        Self::Block { centre: (min + max) / 2.0, half: (max - min) / 2.0, turn: DVec2::X }
    }

    /// A box that stands with the middle of its foot at `foot`, edges `size`, turned by `degrees` about z.
    pub fn standing(foot: [f64; 3], size: [f64; 3], degrees: f64) -> Self {
        let half = DVec3::from(size) / 2.0;
        let centre = DVec3::from(foot) + DVec3::Z * half.z;
        Self::Block { centre, half, turn: DVec2::from_angle(degrees.to_radians()) }
    }

    /// How many faces it has.
    pub fn faces(&self) -> usize {
        match self {
            Self::Room { .. } | Self::Block { .. } => 6,
            Self::Cylinder { hollow: Some(_), .. } => 4,
            Self::Cylinder { .. } => 2,
            Self::Sphere { .. } | Self::Handle { .. } => 1,
        }
    }

    /// Smallest and largest corner of the box around it.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Self::Room { min, max } => (*min, *max),
            Self::Block { centre, half, turn } => {
                let reach = DVec3::new(
                    turn.x.abs() * half.x + turn.y.abs() * half.y,
                    turn.y.abs() * half.x + turn.x.abs() * half.y,
                    half.z,
                );
                (*centre - reach, *centre + reach)
            }
            Self::Cylinder { base, radius, height, .. } => {
                (*base - DVec3::new(*radius, *radius, 0.0), *base + DVec3::new(*radius, *radius, *height))
            }
            Self::Sphere { centre, radius } => (*centre - *radius, *centre + *radius),
            Self::Handle { centre, radii, .. } => {
                (*centre - (radii.x + radii.y), *centre + (radii.x + radii.y))
            }
        }
    }

    /// Lengths of a face along u and v, metres (a round face is measured along its outline).
    pub fn face_size(&self, face: usize) -> DVec2 {
        match self {
            Self::Room { min, max } => {
                let (a, b) = OTHERS[face / 2];
                DVec2::new((*max - *min)[a], (*max - *min)[b])
            }
            Self::Block { half, .. } => {
                let (a, b) = OTHERS[face / 2];
                DVec2::new(2.0 * half[a], 2.0 * half[b])
            }
            Self::Cylinder { radius, height, .. } if face == 0 || face == 2 => {
                DVec2::new(TAU * radius, *height)
            }
            Self::Cylinder { radius, .. } => DVec2::splat(2.0 * radius),
            Self::Sphere { radius, .. } => DVec2::new(TAU * radius, PI * radius),
            Self::Handle { radii, .. } => DVec2::new(TAU * radii.x, TAU * radii.y),
        }
    }

    /// The point of a face and its normal: the inverse of `meet`.
    pub fn face_point(&self, face: usize, uv: DVec2) -> (DVec3, DVec3) {
        match self {
            Self::Room { min, max } => {
                let (axis, (a, b)) = (face / 2, OTHERS[face / 2]);
                let mut p = if face % 2 == 1 { *max } else { *min };
                p[a] = min[a] + uv.x * (max[a] - min[a]);
                p[b] = min[b] + uv.y * (max[b] - min[b]);
                (p, if face % 2 == 1 { -AXES[axis] } else { AXES[axis] })
            }
            Self::Block { centre, half, turn } => {
                let (axis, (a, b)) = (face / 2, OTHERS[face / 2]);
                let sign = if face % 2 == 1 { 1.0 } else { -1.0 };
                let mut p = DVec3::ZERO;
                p[axis] = sign * half[axis];
                p[a] = (2.0 * uv.x - 1.0) * half[a];
                p[b] = (2.0 * uv.y - 1.0) * half[b];
                (*centre + turned(p, *turn), turned(AXES[axis] * sign, *turn))
            }
            Self::Cylinder { base, radius, height, hollow } => {
                let (inner, floor) = hollow.unwrap_or((0.0, 0.0));
                let around = DVec2::from_angle(TAU * (uv.x - 0.5)).extend(0.0);
                match face {
                    0 => (*base + around * *radius + DVec3::Z * (uv.y * height), around),
                    2 => (*base + around * inner + DVec3::Z * (uv.y * height), -around),
                    _ => {
                        let flat =
                            ((uv * 2.0 - 1.0) * *radius).extend(if face == 1 { *height } else { floor });
                        (*base + flat, DVec3::Z)
                    }
                }
            }
            Self::Sphere { centre, radius } => {
                let (theta, phi) = (PI * uv.y, TAU * (uv.x - 0.5));
                let n = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                (*centre + n * *radius, n)
            }
            Self::Handle { centre, outward, radii, .. } => {
                let (a, b) = (TAU * (uv.x - 0.5), TAU * (uv.y - 0.5));
                let ring = *outward * a.cos() + DVec3::Z * a.sin();
                let n = ring * b.cos() + outward.cross(DVec3::Z) * b.sin();
                (*centre + ring * radii.x + n * radii.y, n)
            }
        }
    }

    /// The first meeting with t in (t_min, t_max); the direction is a unit vector.
    pub fn meet(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Option<Meeting> {
        match self {
            Self::Room { min, max } => meet_room(*min, *max, origin, direction, t_min, t_max),
            Self::Block { centre, half, turn } => {
                let back = DVec2::new(turn.x, -turn.y);
                let (o, d) = (turned(origin - *centre, back), turned(direction, back));
                let (t, axis) = enter(o, d, *half).filter(|(t, _)| *t > t_min && *t < t_max)?;
                let (a, b) = OTHERS[axis];
                let p = o + d * t;
                let uv = DVec2::new(p[a] / half[a] + 1.0, p[b] / half[b] + 1.0) / 2.0;
                let positive = d[axis] < 0.0;
                let normal = turned(if positive { AXES[axis] } else { -AXES[axis] }, *turn);
                Some(Meeting { t, face: 2 * axis + usize::from(positive), uv, normal })
            }
            Self::Cylinder { base, radius, height, hollow } => {
                meet_cylinder(origin - *base, direction, *radius, *height, *hollow, t_min, t_max)
            }
            Self::Sphere { centre, radius } => {
                let o = origin - *centre;
                let b = o.dot(direction);
                let h = b * b - (o.length_squared() - radius * radius);
                let t = (h >= 0.0).then(|| -b - h.sqrt()).filter(|t| *t > t_min && *t < t_max)?;
                let normal = (o + direction * t) / *radius;
                let uv =
                    DVec2::new(normal.y.atan2(normal.x) / TAU + 0.5, normal.z.clamp(-1.0, 1.0).acos() / PI);
                Some(Meeting { t, face: 0, uv, normal })
            }
            Self::Handle { .. } => self.meet_handle(origin, direction, t_min, t_max),
        }
    }

    /// Walks along the ray by the distance to the nearest surface.
    fn meet_handle(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Option<Meeting> {
        let Self::Handle { centre, outward, radii, mug } = self else { return None };
        let reach = radii.x + radii.y;
        let to = *centre - origin;
        let (along, near) = (to.dot(direction), to.length_squared());
        let half = reach * reach - (near - along * along);
        if half < 0.0 {
            return None;
        }
        let (mut t, end) = ((along - half.sqrt()).max(t_min), (along + half.sqrt()).min(t_max));
        let across = outward.cross(DVec3::Z);
        for _ in 0..64 {
            if t >= end {
                return None;
            }
            let p = origin + direction * t - *centre;
            let ring = DVec2::new(p.dot(*outward), p.z);
            let tube = DVec2::new(ring.length() - radii.x, p.dot(across));
            let from_axis = (p + *centre).truncate() - mug.truncate();
            let distance = (tube.length() - radii.y).max(mug.z - from_axis.length());
            if distance < 1e-6 {
                let spoke = *outward * ring.x + DVec3::Z * ring.y;
                let normal = (spoke.normalize_or_zero() * tube.x + across * tube.y).normalize_or(DVec3::Z);
                let uv = DVec2::new(ring.to_angle(), tube.to_angle()) / TAU + 0.5;
                return (normal.dot(direction) < 0.0).then_some(Meeting { t, face: 0, uv, normal });
            }
            t += distance;
        }
        None
    }
}

fn turned(p: DVec3, turn: DVec2) -> DVec3 {
    turn.rotate(p.truncate()).extend(p.z)
}

/// Distance at which a ray enters the box of these half edges about the origin, and through which axis.
fn enter(o: DVec3, d: DVec3, half: DVec3) -> Option<(f64, usize)> {
    let (mut near, mut far, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for k in 0..3 {
        let inverse = 1.0 / d[k];
        let (a, b) = ((-half[k] - o[k]) * inverse, (half[k] - o[k]) * inverse);
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        if low > near {
            (near, axis) = (low, k);
        }
        far = far.min(high);
    }
    (near <= far).then_some((near, axis))
}

/// Whether a ray, given by its origin and the inverse of its direction, passes a box before t_max.
pub fn passes(bounds: &(DVec3, DVec3), origin: DVec3, inverse: DVec3, t_max: f64) -> bool {
    let (a, b) = ((bounds.0 - origin) * inverse, (bounds.1 - origin) * inverse);
    let (low, high) = (a.min(b).max_element(), a.max(b).min_element());
    low <= high && high > 0.0 && low < t_max
}

fn meet_room(min: DVec3, max: DVec3, o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<Meeting> {
    let (mut t, mut axis) = (f64::INFINITY, 0);
    for k in 0..3 {
        let wall = if d[k] > 0.0 { max[k] } else { min[k] };
        let to = (wall - o[k]) / d[k];
        if to < t {
            (t, axis) = (to, k);
        }
    }
    if !(t > t_min && t < t_max) {
        return None;
    }
    let (a, b) = OTHERS[axis];
    let p = o + d * t;
    let uv = DVec2::new((p[a] - min[a]) / (max[a] - min[a]), (p[b] - min[b]) / (max[b] - min[b]));
    let positive = d[axis] > 0.0;
    let normal = if positive { -AXES[axis] } else { AXES[axis] };
    Some(Meeting { t, face: 2 * axis + usize::from(positive), uv, normal })
}

fn meet_cylinder(
    o: DVec3,
    d: DVec3,
    radius: f64,
    height: f64,
    hollow: Option<(f64, f64)>,
    t_min: f64,
    t_max: f64,
) -> Option<Meeting> {
    let mut best: Option<Meeting> = None;
    let mut offer = |t: f64, face: usize, uv: DVec2, normal: DVec3| {
        if t > t_min && t < best.map_or(t_max, |m| m.t) {
            best = Some(Meeting { t, face, uv, normal });
        }
    };
    let (a, b) = (d.truncate().length_squared(), o.truncate().dot(d.truncate()));
    // Both roots for a wall of this radius: outside seen at the near one, inside at the far one.
    let mut wall = |r: f64, inside: bool, from: f64| {
        let h = b * b - a * (o.truncate().length_squared() - r * r);
        if h <= 0.0 || a < 1e-18 {
            return;
        }
        let t = if inside { (-b + h.sqrt()) / a } else { (-b - h.sqrt()) / a };
        let p = o + d * t;
        if p.z >= from && p.z <= height {
            let n = p.truncate() / r;
            let uv = DVec2::new(n.to_angle() / TAU + 0.5, p.z / height);
            offer(t, if inside { 2 } else { 0 }, uv, if inside { -n.extend(0.0) } else { n.extend(0.0) });
        }
    };
    wall(radius, false, 0.0);
    if let Some((inner, floor)) = hollow {
        wall(inner, true, floor);
    }
    if d.z < 0.0 {
        let mut flat = |z: f64, face: usize, from: f64, to: f64| {
            let t = (z - o.z) / d.z;
            let p = (o + d * t).truncate();
            if p.length() >= from && p.length() <= to {
                offer(t, face, (p / radius + 1.0) / 2.0, DVec3::Z);
            }
        };
        flat(height, 1, hollow.map_or(0.0, |h| h.0), radius);
        if let Some((inner, floor)) = hollow {
            flat(floor, 3, 0.0, inner);
        }
    }
    best
}
