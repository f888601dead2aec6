//! Where the least squares begin: focal lengths by the closed form, and a board's place through any lens.

use super::BoardPoint;
use crate::math::solve::{least_squares, symmetric_eigen};
use crate::math::{lens::Lens, pose::Pose, pose::nearest_rotation};
use glam::{DMat3, DVec2, DVec3};

/// Focal lengths that are tried beside the closed form's, as shares of the picture's width: distortion misleads it.
const TRIED: [f64; 4] = [0.35, 0.6, 1.0, 1.8];
/// Rays nearer to the picture's plane say little of a board's place.
const LEAST_AHEAD: f64 = 0.2;

/// The closed form's focal length, where there is one, and some others.
pub fn focal_lengths(views: &[Vec<BoardPoint>], (width, height): (u32, u32)) -> Vec<f64> {
    let size = DVec2::new(f64::from(width), f64::from(height));
    let sane = |focal: &f64| (0.1 * size.x..=20.0 * size.x).contains(focal);
    let closed = closed_form(views, size / 2.0).filter(sane);
    closed.into_iter().chain(TRIED.map(|share| share * size.x)).collect()
}

/// With the principal point in the picture's middle and square pixels, a board's homography (h1 h2 h3) has
/// h1^T B h2 = 0 and h1^T B h1 = h2^T B h2 with B = diag(b, b, 1), b = 1 / f^2.
fn closed_form(views: &[Vec<BoardPoint>], middle: DVec2) -> Option<f64> {
    // In units of half the picture, so that both kinds of equation weigh alike.
    let unit = middle.x;
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for view in views {
        let pairs: Vec<(DVec2, DVec2)> =
            view.iter().map(|p| (p.on_board, (p.pixel - middle) / unit)).collect();
        let Some(h) = homography(&pairs) else { continue };
        let (a, b) = (h.x_axis, h.y_axis);
        let scale = 1.0 / (a.length() * b.length());
        left.push(scale * (a.x * b.x + a.y * b.y));
        right.push(-scale * a.z * b.z);
        left.push(scale * (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y));
        right.push(scale * (b.z * b.z - a.z * a.z));
    }
    let solved = least_squares(left.len(), 1, &left, &right)?;
    let inverse_square = *solved.solution.first()?;
    (solved.rank == 1 && inverse_square > 0.0).then(|| unit / inverse_square.sqrt())
}

/// The board's place in front of a camera. `None` where too few of its points can be seen through the lens.
pub fn board_pose(lens: &Lens, view: &[BoardPoint]) -> Option<Pose> {
    let pairs: Vec<(DVec2, DVec2)> = view
        .iter()
        .filter_map(|p| {
            let ray = lens.unproject(p.pixel)?;
            (ray.z > LEAST_AHEAD).then(|| (p.on_board, DVec2::new(ray.x, ray.y) / ray.z))
        })
        .collect();
    let h = homography(&pairs)?;
    let scale = 2.0 / (h.x_axis.length() + h.y_axis.length());
    // The board is before the camera.
    let scale = scale.copysign(h.z_axis.z);
    let (x, y, translation) = (h.x_axis * scale, h.y_axis * scale, h.z_axis * scale);
    let rotation = nearest_rotation(DMat3::from_cols(x, y, x.cross(y)))?;
    Some(Pose::new(rotation, translation))
}

/// The homography that takes the first of each pair to the second, by least squares over all. `None` where there is none.
fn homography(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    if pairs.len() < 6 {
        return None;
    }
    let (from, to) = (Normalised::of(pairs.iter().map(|p| p.0))?, Normalised::of(pairs.iter().map(|p| p.1))?);
    let mut normal = [[0.0; 9]; 9];
    for (a, b) in pairs {
        let (a, b) = (from.apply(*a), to.apply(*b));
        let rows = [
            [a.x, a.y, 1.0, 0.0, 0.0, 0.0, -b.x * a.x, -b.x * a.y, -b.x],
            [0.0, 0.0, 0.0, a.x, a.y, 1.0, -b.y * a.x, -b.y * a.y, -b.y],
        ];
        for row in rows {
            for i in 0..9 {
                for j in 0..9 {
                    normal[i][j] += row[i] * row[j];
                }
            }
        }
    }
    let (values, vectors) = symmetric_eigen(&normal)?;
    // Points on a line leave more than one homography open.
    if !(values[7] > 1e-12 * values[0]) {
        return None;
    }
    let h = DMat3::from_cols_array(&vectors[8]).transpose();
    let found = to.matrix().inverse() * h * from.matrix();
    found.is_finite().then_some(found)
}

/// Coordinates about their mean, at the scale of their spread: equations in them are sound.
struct Normalised {
    mean: DVec2,
    scale: f64,
}

impl Normalised {
    fn of(points: impl Iterator<Item = DVec2> + Clone) -> Option<Self> {
        let count = points.clone().count() as f64;
        let mean = points.clone().sum::<DVec2>() / count;
        let spread = points.map(|p| p.distance(mean)).sum::<f64>() / count;
        (spread > 0.0 && spread.is_finite()).then(|| Self { mean, scale: 1.0 / spread })
    }

    fn apply(&self, point: DVec2) -> DVec2 {
        (point - self.mean) * self.scale
    }

    fn matrix(&self) -> DMat3 {
        DMat3::from_cols(DVec3::X * self.scale, DVec3::Y * self.scale, (-self.mean * self.scale).extend(1.0))
    }
}
