//! The pose of one square tag from its four corners, for any lens: both minima of the reprojection error.
//! `minima` finds them, over f32 or f64; here they are in f64, and `choose` decides between them by where the camera
//! can be and where it was.

pub use super::minima::LARGEST_RATIO;
use super::{
    minima::{self, Minimum},
    refine::PoseSigma,
};
use crate::math::{lens::Lens, pose::Pose, vector::Vector};
use glam::{DMat3, DVec2, DVec3};

/// A ratio of errors below this leaves the choice open (spec, section 10).
pub const AMBIGUOUS_RATIO: f64 = 2.0;

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
    let (corners_m, corners_px) = (corners_m.map(Vector::from), corners_px.map(Vector::from));
    let found = minima::solve_rectangle(&corners_m, &corners_px, sigma_px, lens)?;
    let pose = |m: Minimum<f64>| TagPose {
        camera_from_tag: m.camera_from_object.into(),
        rms_px: m.rms_px,
        sigma: m.sigma,
    };
    Some(TagPoses { best: pose(found.best), other: found.other.map(pose), ambiguity: found.ambiguity })
}

/// The homography that maps the square -1..1 (x right, y down) to four points, its corners in the library's
/// order: lower left, lower right, upper right, upper left. `None` where three points are on one line or the
/// quadrangle is not convex.
pub fn homography_from_square(corners: &[DVec2; 4]) -> Option<DMat3> {
    homography_from_rectangle(&corners_of_tag_m(2.0), corners)
}

/// The homography that maps a rectangle (or parallelogram) of the plane z = 0 to four points.
pub fn homography_from_rectangle(rectangle: &[DVec3; 4], points: &[DVec2; 4]) -> Option<DMat3> {
    let columns = minima::homography_from_rectangle(&rectangle.map(Vector::from), &points.map(Vector::from))?;
    Some(DMat3::from_cols_array_2d(&columns.map(|c| c.0)))
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
