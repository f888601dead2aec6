//! The pose of one square tag from its four corners, for any lens: both minima of the reprojection error.
//!
//! A small or far square has two poses that explain its corners nearly as well: seen without perspective, a
//! square tilted one way equals its mirror image tilted the other way. Both are kept; `choose` decides by where
//! the camera can be and where it was.

use super::refine::{PoseSigma, Refined, Sighting, refine};
use crate::math::{lens::Lens, pose::Pose};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// A ratio of errors below this leaves the choice open (spec, section 10).
pub const AMBIGUOUS_RATIO: f64 = 2.0;
/// The ratio that stands for "there is no second minimum"; larger ones are cut to it.
pub const LARGEST_RATIO: f64 = 1e6;

/// One minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagPose {
    /// Tag frame (origin in the middle; x right, y down in the tag's upright picture; z into the tag) to camera.
    pub camera_from_tag: Pose,
    /// Root of the mean squared residual, over both coordinates of the corners, pixels.
    pub rms_px: f64,
    /// Standard deviations of the camera's pose in the tag's frame.
    pub sigma: PoseSigma,
}

/// The poses that explain four corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagPoses {
    /// The one of smaller error.
    pub best: TagPose,
    /// The other minimum, where there is one.
    pub other: Option<TagPose>,
    /// Error of the other over error of the best, 1 to 1e6; 1e6 where there is no other.
    pub ambiguity: f64,
}

impl TagPoses {
    /// Whether the corners alone leave the choice open: the ratio of errors is below 2, or the other pose
    /// explains the corners within `noise_px`.
    pub fn is_ambiguous(&self, noise_px: f64) -> bool {
        self.other.is_some_and(|other| self.ambiguity < AMBIGUOUS_RATIO || other.rms_px < noise_px)
    }
}

/// Corners of a tag in its own frame, metres, in the library's order: lower left, lower right, upper right,
/// upper left.
pub fn corners_of_tag_m(side_m: f64) -> [DVec3; 4] {
    let h = side_m / 2.0;
    [DVec3::new(-h, h, 0.0), DVec3::new(h, h, 0.0), DVec3::new(h, -h, 0.0), DVec3::new(-h, -h, 0.0)]
}

/// Standard deviation of a corner's coordinate where nobody says better, pixels.
pub const USUAL_SIGMA_PX: f64 = 0.1;

/// Poses of a tag of side `side_m` metres whose corners (the library's order) were seen at `corners_px`
/// (continuous pixels, each coordinate taken as good to 0.1 px). `None` for corners that are no proper
/// quadrangle, that the lens cannot have seen, or a side that is not above 0.
pub fn solve(corners_px: &[DVec2; 4], side_m: f64, lens: &Lens) -> Option<TagPoses> {
    solve_rectangle(&corners_of_tag_m(side_m), corners_px, USUAL_SIGMA_PX, lens)
}

/// The same for any rectangle in its plane z = 0, its corners in order around it, each coordinate seen with
/// standard deviation `sigma_px` pixels.
pub fn solve_rectangle(
    corners_m: &[DVec3; 4],
    corners_px: &[DVec2; 4],
    sigma_px: f64,
    lens: &Lens,
) -> Option<TagPoses> {
    let finite = corners_m.iter().all(|c| c.is_finite()) && corners_px.iter().all(|c| c.is_finite());
    if !(finite && sigma_px > 0.0) {
        return None;
    }
    let start = start_pose(corners_m, corners_px, lens)?;
    let mut sightings = [Sighting { point_object: DVec3::ZERO, pixel: DVec2::ZERO, sigma_px }; 4];
    for ((s, point), pixel) in sightings.iter_mut().zip(corners_m).zip(corners_px) {
        (s.point_object, s.pixel) = (*point, *pixel);
    }
    let first = refine(&sightings, lens, &start)?;
    let second = second_minimum(&sightings, lens, &first);
    let (best, other) = match second {
        Some(second) if second.rms_px < first.rms_px => (second, Some(first)),
        _ => (first, second),
    };
    let pose = |r: &Refined| {
        Some(TagPose { camera_from_tag: r.camera_from_object, rms_px: r.rms_px, sigma: r.sigma()? })
    };
    let (best, other) = (pose(&best)?, other.as_ref().and_then(pose));
    // Below a millionth of a pixel both errors are rounding.
    let ratio = |other: &TagPose| (other.rms_px / best.rms_px.max(1e-6)).clamp(1.0, LARGEST_RATIO);
    Some(TagPoses { best, other, ambiguity: other.as_ref().map_or(LARGEST_RATIO, ratio) })
}

/// Looks for the minimum on the other side: from the mirrored pose, then from tilts all around.
fn second_minimum(sightings: &[Sighting; 4], lens: &Lens, first: &Refined) -> Option<Refined> {
    let pose = first.camera_from_object;
    let distinct = |r: &Refined| {
        let apart = pose.angle_to(&r.camera_from_object) > 1e-3;
        // A tag is seen from the side that it was seen from, in front of the camera.
        let facing = |p: &Pose| (p.rotation * DVec3::Z).dot(p.translation) > 0.0;
        (apart && facing(&pose) == facing(&r.camera_from_object)).then_some(*r)
    };
    if let Some(found) = refine(sightings, lens, &mirrored(&pose)).as_ref().and_then(distinct) {
        return Some(found);
    }
    // Near to face-on the mirrored start falls into the first minimum: lean further, in four directions.
    let view = pose.translation.normalize_or(DVec3::Z);
    let normal = pose.rotation * DVec3::Z;
    let upright = DQuat::from_rotation_arc(normal, view * normal.dot(view).signum()) * pose.rotation;
    let side = view.any_orthonormal_vector();
    let mut best: Option<Refined> = None;
    for axis in [side, -side, view.cross(side), -view.cross(side)] {
        let lean = Pose::new(DQuat::from_axis_angle(axis, 0.7) * upright, pose.translation);
        if let Some(found) = refine(sightings, lens, &lean).as_ref().and_then(distinct)
            && best.is_none_or(|b| found.rms_px < b.rms_px)
        {
            best = Some(found);
        }
    }
    best
}

/// The pose that looks the same without perspective: its plane mirrored about the plane across the line of
/// sight, so that the normal n becomes 2 v (v . n) - n.
fn mirrored(pose: &Pose) -> Pose {
    let view = pose.translation.normalize_or(DVec3::Z);
    let mirror = |p: DVec3| p - 2.0 * view * view.dot(p);
    let m = DMat3::from_quat(pose.rotation);
    let turned = DMat3::from_cols(mirror(m.x_axis), mirror(m.y_axis), -mirror(m.z_axis));
    Pose::from_matrix(turned, pose.translation)
}

/// A pose from the homography of the corners, in a pinhole turned so that it looks at them (so that a fisheye's
/// side looks are as good as any).
fn start_pose(corners_m: &[DVec3; 4], corners_px: &[DVec2; 4], lens: &Lens) -> Option<Pose> {
    let mut rays = [DVec3::ZERO; 4];
    for (ray, pixel) in rays.iter_mut().zip(corners_px) {
        *ray = lens.unproject(*pixel)?;
    }
    let ahead = rays.iter().sum::<DVec3>().try_normalize()?;
    // `from_rotation_arc` needs no axis of ours, not even for straight behind.
    let virtual_from_camera = DQuat::from_rotation_arc(ahead, DVec3::Z);
    let mut plane = [DVec2::ZERO; 4];
    for (p, ray) in plane.iter_mut().zip(rays) {
        let ray = virtual_from_camera * ray;
        if ray.z < 1e-3 {
            return None;
        }
        *p = ray.truncate() / ray.z;
    }
    let pose = pose_from_homography(&homography_from_rectangle(corners_m, &plane)?)?;
    let back = virtual_from_camera.conjugate();
    Some(Pose::new(back * pose.rotation, back * pose.translation))
}

/// Rotation and translation nearest to a homography from the plane z = 0 (metres) to the plane z = 1.
fn pose_from_homography(homography: &DMat3) -> Option<Pose> {
    let scale = 2.0 / (homography.x_axis.length() + homography.y_axis.length());
    // The plane lies in front of the camera.
    let scale = if homography.z_axis.z < 0.0 { -scale } else { scale };
    let (x, y, t) = (homography.x_axis * scale, homography.y_axis * scale, homography.z_axis * scale);
    // The two unit vectors at right angles that are nearest to x and y, symmetrically.
    let sum = (x.try_normalize()? + y.try_normalize()?).try_normalize()?;
    let difference = x.try_normalize()? - y.try_normalize()?;
    let difference = (difference - sum * sum.dot(difference)).try_normalize()?;
    let (x, y) = ((sum + difference).normalize(), (sum - difference).normalize());
    t.is_finite().then(|| Pose::from_matrix(DMat3::from_cols(x, y, x.cross(y)), t))
}

/// The homography that maps the square -1..1 (x right, y down) to four points, its corners in the library's
/// order: lower left, lower right, upper right, upper left. `None` where three points are on one line or the
/// quadrangle is not convex.
pub fn homography_from_square(corners: &[DVec2; 4]) -> Option<DMat3> {
    homography_from_rectangle(&corners_of_tag_m(2.0), corners)
}

/// The homography that maps a rectangle (or parallelogram) of the plane z = 0 to four points.
pub fn homography_from_rectangle(rectangle: &[DVec3; 4], points: &[DVec2; 4]) -> Option<DMat3> {
    let unit = homography_from_unit_square(points)?;
    let flat = |p: DVec3| DVec3::new(p.x, p.y, 1.0);
    let origin = flat(rectangle[0]);
    let rectangle_from_unit =
        DMat3::from_cols(flat(rectangle[1]) - origin, flat(rectangle[3]) - origin, origin);
    let determinant = rectangle_from_unit.determinant();
    if determinant.is_nan() || determinant.abs() <= 1e-18 {
        return None;
    }
    Some(unit * rectangle_from_unit.inverse())
}

/// Maps (0,0), (1,0), (1,1), (0,1) to the four points.
fn homography_from_unit_square(q: &[DVec2; 4]) -> Option<DMat3> {
    // Convex, and no corner flat: all four turns have one sign.
    let turn = |i: usize| (q[(i + 1) % 4] - q[i]).perp_dot(q[(i + 2) % 4] - q[(i + 1) % 4]);
    let size = q.iter().map(|p| p.distance_squared(q[0])).fold(0.0, f64::max);
    let turns = [turn(0), turn(1), turn(2), turn(3)];
    let sign = turns[0].signum();
    if !turns.iter().all(|t| t * sign > 1e-7 * size) {
        return None;
    }
    let (a, b, sum) = (q[1] - q[2], q[3] - q[2], q[0] - q[1] + q[2] - q[3]);
    let denominator = a.perp_dot(b);
    let (g, h) = (sum.perp_dot(b) / denominator, a.perp_dot(sum) / denominator);
    let x = (q[1] - q[0] + q[1] * g).extend(g);
    let y = (q[3] - q[0] + q[3] * h).extend(h);
    Some(DMat3::from_cols(x, y, q[0].extend(1.0)))
}

/// What is known before a choice between poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prior {
    /// The camera's pose as predicted, and how far off the prediction may be.
    pub predicted: Option<(Pose, PoseSigma)>,
    /// Whether the camera must be above the plane z = 0 of the world.
    pub above_plane: bool,
}

impl Prior {
    /// How unlikely a pose is, as squared standard deviations; infinite below the plane.
    pub fn cost(&self, world_from_camera: &Pose) -> f64 {
        if self.above_plane && world_from_camera.translation.z <= 0.0 {
            return f64::INFINITY;
        }
        self.predicted.map_or(0.0, |(pose, sigma)| {
            let away = pose.translation.distance(world_from_camera.translation) / sigma.position_m;
            let turned = pose.angle_to(world_from_camera) / sigma.rotation_rad;
            away * away + turned * turned
        })
    }
}

/// The camera's pose in the world from a tag's poses: the one of smallest cost, errors of the corners counted
/// against `noise_px` and the pose against the prior. `None` where the prior forbids both.
pub fn choose<'a>(
    poses: &'a TagPoses,
    world_from_tag: &Pose,
    prior: &Prior,
    noise_px: f64,
) -> Option<(Pose, &'a TagPose)> {
    let mut chosen: Option<(f64, Pose, &TagPose)> = None;
    for pose in std::iter::once(&poses.best).chain(&poses.other) {
        let world_from_camera = world_from_tag.then(&pose.camera_from_tag.inverse());
        let cost = 8.0 * (pose.rms_px / noise_px).powi(2) + prior.cost(&world_from_camera);
        if cost.is_finite() && chosen.is_none_or(|(least, ..)| cost < least) {
            chosen = Some((cost, world_from_camera, pose));
        }
    }
    chosen.map(|(_, world_from_camera, pose)| (world_from_camera, pose))
}
