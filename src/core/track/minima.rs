//! Both minima of the reprojection error of a rectangle's four corners, over f32 or f64, for any camera.
//!
//! A small or far square has two poses that explain its corners nearly as well: seen without perspective, a
//! square tilted one way equals its mirror image tilted the other way. `tag_pose` gives both in f64.
//!
//! f32 follows f64 to 1e-4 of the pose's standard deviation at 0.1 px (median; 99 % within 5e-3), from tags that fill
//! the picture to tags of a few pixels (`tests/tags.rs`).

use super::refine::{PoseSigma, Refined, Sighting, refine};
use crate::math::{
    projection::Projection,
    rigid::{Quaternion, Rigid},
    sh::Real,
    vector::Vector,
};

/// The ratio that stands for "there is no second minimum"; larger ones are cut to it.
pub const LARGEST_RATIO: f64 = 1e6;

/// One minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minimum<T> {
    /// Frame of the rectangle to camera.
    pub camera_from_object: Rigid<T>,
    /// Root of the mean squared residual, over both coordinates of the corners, pixels.
    pub rms_px: T,
    /// Standard deviations of the camera's pose in the rectangle's frame.
    pub sigma: PoseSigma<T>,
}

/// The poses that explain four corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minima<T> {
    /// The one of smaller error.
    pub best: Minimum<T>,
    /// The other, where there is one.
    pub other: Option<Minimum<T>>,
    /// Error of the other over error of the best, 1 to 1e6; 1e6 where there is no other.
    pub ambiguity: T,
}

/// Poses of a rectangle in its plane z = 0 whose corners (metres, in order around it) were seen at `corners_px`
/// (continuous pixels), each coordinate with standard deviation `sigma_px` pixels. `None` for corners that are no
/// proper quadrangle, that the camera cannot have seen, or a sigma that is not above 0.
pub fn solve_rectangle<T: Real, P: Projection<T>>(
    corners_m: &[Vector<T, 3>; 4],
    corners_px: &[Vector<T, 2>; 4],
    sigma_px: T,
    lens: &P,
) -> Option<Minima<T>> {
    let finite = corners_m.iter().all(|c| c.is_finite()) && corners_px.iter().all(|c| c.is_finite());
    if !(finite && sigma_px > T::zero()) {
        return None;
    }
    let start = start_pose(corners_m, corners_px, lens)?;
    let sightings: [Sighting<T>; 4] =
        std::array::from_fn(|i| Sighting { point_object: corners_m[i], pixel: corners_px[i], sigma_px });
    let first = refine(&sightings, lens, &start)?;
    let second = second_minimum(&sightings, lens, &first);
    let (best, other) = match second {
        Some(second) if second.rms_px < first.rms_px => (second, Some(first)),
        _ => (first, second),
    };
    let minimum = |r: &Refined<T>| {
        Some(Minimum { camera_from_object: r.camera_from_object, rms_px: r.rms_px, sigma: r.sigma()? })
    };
    let (best, other) = (minimum(&best)?, other.as_ref().and_then(minimum));
    // Below a millionth of a pixel both errors are rounding; in f32 below that of a coordinate of 1000 px.
    let rounding = T::of(1e-6).max(T::of(1e3) * T::epsilon());
    let (least, most) = (T::one(), T::of(LARGEST_RATIO));
    let ratio = |other: &Minimum<T>| (other.rms_px / best.rms_px.max(rounding)).max(least).min(most);
    Some(Minima { best, other, ambiguity: other.as_ref().map_or(most, ratio) })
}

/// Looks for the minimum on the other side: from the mirrored pose, then from tilts all around.
fn second_minimum<T: Real, P: Projection<T>>(
    sightings: &[Sighting<T>; 4],
    lens: &P,
    first: &Refined<T>,
) -> Option<Refined<T>> {
    let pose = first.camera_from_object;
    let normal_of = |p: &Rigid<T>| p.rotation.rotate(Vector::axis(2));
    // Where the two minima meet, the error is flat to the fourth order: it fixes an angle to the fourth root of
    // the rounding, 0.02 rad in f32.
    let least_angle = T::of(1e-3).max(T::epsilon().sqrt().sqrt());
    let distinct = |r: &Refined<T>| {
        let apart = pose.angle_to(&r.camera_from_object) > least_angle;
        // A tag is seen from the side that it was seen from, in front of the camera.
        let facing = |p: &Rigid<T>| normal_of(p).dot(p.translation) > T::zero();
        (apart && facing(&pose) == facing(&r.camera_from_object)).then_some(*r)
    };
    if let Some(found) = refine(sightings, lens, &mirrored(&pose)).as_ref().and_then(distinct) {
        return Some(found);
    }
    // Near to face-on the mirrored start falls into the first minimum: lean further, in four directions.
    let (view, normal) = (view_of(&pose), normal_of(&pose));
    let upright = Quaternion::arc(normal, view * normal.dot(view).signum()).times(pose.rotation);
    let side = view.across();
    let mut best: Option<Refined<T>> = None;
    for axis in [side, -side, view.cross(side), -view.cross(side)] {
        let lean = Rigid::new(Quaternion::about(axis, T::of(0.7)).times(upright), pose.translation);
        if let Some(found) = refine(sightings, lens, &lean).as_ref().and_then(distinct)
            && best.is_none_or(|b| found.rms_px < b.rms_px)
        {
            best = Some(found);
        }
    }
    best
}

/// Unit direction from the camera to the object.
fn view_of<T: Real>(pose: &Rigid<T>) -> Vector<T, 3> {
    pose.translation.unit().unwrap_or(Vector::axis(2))
}

/// The pose that looks the same without perspective: its plane mirrored about the plane across the line of
/// sight, so that the normal n becomes 2 v (v . n) - n.
fn mirrored<T: Real>(pose: &Rigid<T>) -> Rigid<T> {
    let view = view_of(pose);
    let mirror = |p: Vector<T, 3>| p - view * T::of(2.0) * view.dot(p);
    let [x, y, z] = pose.rotation.columns();
    Rigid::from_columns(&[mirror(x), mirror(y), -mirror(z)], pose.translation)
}

/// A pose from the homography of the corners, in a pinhole turned so that it looks at them (so that a fisheye's
/// side looks are as good as any).
fn start_pose<T: Real, P: Projection<T>>(
    corners_m: &[Vector<T, 3>; 4],
    corners_px: &[Vector<T, 2>; 4],
    lens: &P,
) -> Option<Rigid<T>> {
    let mut rays = [Vector::zero(); 4];
    for (ray, pixel) in rays.iter_mut().zip(corners_px) {
        *ray = lens.unproject(*pixel)?;
    }
    let ahead = rays.into_iter().fold(Vector::zero(), |sum, ray| sum + ray).unit()?;
    // An arc needs no axis of ours, not even for straight behind.
    let virtual_from_camera = Quaternion::arc(ahead, Vector::axis(2));
    let mut plane = [Vector::zero(); 4];
    for (p, ray) in plane.iter_mut().zip(rays) {
        let ray = virtual_from_camera.rotate(ray);
        if ray.0[2] < T::of(1e-3) {
            return None;
        }
        *p = ray.on_plane();
    }
    let pose = pose_from_homography(&homography_from_rectangle(corners_m, &plane)?)?;
    let back = virtual_from_camera.conjugate();
    Some(Rigid::new(back.times(pose.rotation), back.rotate(pose.translation)))
}

/// A homography by its columns: it maps (x, y, 1) to a point of the plane z = 1, times a factor.
pub type Homography<T> = [Vector<T, 3>; 3];

/// Rotation and translation nearest to a homography from the plane z = 0 (metres) to the plane z = 1.
fn pose_from_homography<T: Real>(homography: &Homography<T>) -> Option<Rigid<T>> {
    let [x, y, t] = *homography;
    let scale = T::of(2.0) / (x.length() + y.length());
    // The plane lies in front of the camera.
    let scale = if t.0[2] < T::zero() { -scale } else { scale };
    let (x, y, t) = (x * scale, y * scale, t * scale);
    // The two unit vectors at right angles that are nearest to x and y, symmetrically.
    let sum = (x.unit()? + y.unit()?).unit()?;
    let difference = x.unit()? - y.unit()?;
    let difference = (difference - sum * sum.dot(difference)).unit()?;
    let (x, y) = ((sum + difference).unit()?, (sum - difference).unit()?);
    t.is_finite().then(|| Rigid::from_columns(&[x, y, x.cross(y)], t))
}

/// The homography that maps a rectangle (or parallelogram) of the plane z = 0 to four points. `None` where three
/// points are on one line or the quadrangle is not convex.
pub fn homography_from_rectangle<T: Real>(
    rectangle: &[Vector<T, 3>; 4],
    points: &[Vector<T, 2>; 4],
) -> Option<Homography<T>> {
    let unit = homography_from_unit_square(points)?;
    let flat = |p: Vector<T, 3>| Vector([p.0[0], p.0[1], T::one()]);
    let origin = flat(rectangle[0]);
    let (x, y) = (flat(rectangle[1]) - origin, flat(rectangle[3]) - origin);
    // The inverse of (x y origin): its rows are cross products over the determinant.
    let rows = [y.cross(origin), origin.cross(x), x.cross(y)];
    let determinant = origin.dot(rows[2]);
    if determinant.is_nan() || determinant.abs() <= T::of(1e-18) {
        return None;
    }
    let shrink = T::one() / x.dot(rows[0]);
    let rows = rows.map(|row| row * shrink);
    Some(std::array::from_fn(|c| unit[0] * rows[0].0[c] + unit[1] * rows[1].0[c] + unit[2] * rows[2].0[c]))
}

/// Maps (0,0), (1,0), (1,1), (0,1) to the four points.
fn homography_from_unit_square<T: Real>(q: &[Vector<T, 2>; 4]) -> Option<Homography<T>> {
    // Convex, and no corner flat: all four turns have one sign.
    let turn = |i: usize| (q[(i + 1) % 4] - q[i]).cross(q[(i + 2) % 4] - q[(i + 1) % 4]);
    let size = q.iter().fold(T::zero(), |size, p| size.max(p.distance_squared(q[0])));
    let turns = [turn(0), turn(1), turn(2), turn(3)];
    let sign = turns[0].signum();
    // In f32 a turn is no better than a few units in the last place.
    let flat = T::of(1e-7).max(T::of(4.0) * T::epsilon());
    if !turns.iter().all(|t| *t * sign > flat * size) {
        return None;
    }
    let (a, b, sum) = (q[1] - q[2], q[3] - q[2], q[0] - q[1] + q[2] - q[3]);
    let denominator = a.cross(b);
    let (g, h) = (sum.cross(b) / denominator, a.cross(sum) / denominator);
    let x = (q[1] - q[0] + q[1] * g).extend(g);
    let y = (q[3] - q[0] + q[3] * h).extend(h);
    Some([x, y, q[0].extend(T::one())])
}
