//! Pose from points: Levenberg-Marquardt on the reprojection error, in f64, for any lens.

use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// A point of an object and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// In the object's frame, metres.
    pub point_object: DVec3,
    /// Where it was seen, continuous pixels.
    pub pixel: DVec2,
    /// Standard deviation of either coordinate, pixels; above 0.
    pub sigma_px: f64,
}

/// A symmetric 6x6 matrix over (rotation, translation) of a small motion in the camera's frame.
pub type Matrix6 = [[f64; 6]; 6];

/// A pose at a minimum of the reprojection error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Object to camera.
    pub camera_from_object: Pose,
    /// Root of the mean squared residual, over both coordinates of all points, pixels.
    pub rms_px: f64,
    /// Sum of squared residuals, each over its sigma.
    pub chi_square: f64,
    /// Points that entered.
    pub points: usize,
    /// J^T J of the residuals over their sigmas, for p_camera -> exp(rotation) R p + t + translation.
    pub information: Matrix6,
}

/// Standard deviations of a camera's pose in an object's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSigma {
    /// Root of the trace of the position's covariance, metres.
    pub position_m: f64,
    /// Root of the trace of the rotation's covariance, radians.
    pub rotation_rad: f64,
}

impl Refined {
    /// Standard deviations of the camera's pose in the object's frame, from (J^T J)^-1; larger residuals than
    /// the stated sigmas explain enlarge them. `None` where the points do not fix the pose.
    pub fn sigma(&self) -> Option<PoseSigma> {
        let covariance = invert(&self.information)?;
        let freedom = (2 * self.points) as f64 - 6.0;
        let excess = if freedom > 0.0 { (self.chi_square / freedom).max(1.0) } else { 1.0 };
        // Camera centre c = -R^T t moves by -R^T (translation + t x rotation): lengths need no R^T.
        let t = self.camera_from_object.translation;
        let cross = [[0.0, -t.z, t.y], [t.z, 0.0, -t.x], [-t.y, t.x, 0.0]];
        let mut position = 0.0;
        for (row, cross_row) in cross.iter().enumerate() {
            let mut a = [0.0; 6];
            a[..3].copy_from_slice(cross_row);
            a[3 + row] = 1.0;
            for i in 0..6 {
                for j in 0..6 {
                    position += a[i] * covariance[i][j] * a[j];
                }
            }
        }
        let rotation: f64 = (0..3).map(|i| covariance[i][i]).sum();
        let sigma =
            PoseSigma { position_m: (position * excess).sqrt(), rotation_rad: (rotation * excess).sqrt() };
        (sigma.position_m.is_finite() && sigma.rotation_rad.is_finite()).then_some(sigma)
    }
}

/// Steps tried at most. From a homography's start five suffice; a mirrored start may need thirty.
const STEPS: usize = 80;

/// Follows the reprojection error from `start` to the minimum whose valley it lies in. No allocation.
/// `None` where fewer than three points are given, a point lies where the lens cannot see it, or numbers are
/// not finite.
pub fn refine(sightings: &[Sighting], lens: &Lens, start: &Pose) -> Option<Refined> {
    if sightings.len() < 3 {
        return None;
    }
    let mut pose = *start;
    let mut chi_square = chi_square(sightings, lens, &pose)?;
    let mut damping = 1e-3;
    let (mut information, mut gradient) = normal_equations(sightings, lens, &pose)?;
    for _ in 0..STEPS {
        let mut damped = information;
        for (i, row) in damped.iter_mut().enumerate() {
            row[i] += damping * information[i][i];
        }
        let step = solve(&damped, &gradient)?;
        let (rotation, translation) =
            (DVec3::new(step[0], step[1], step[2]), DVec3::new(step[3], step[4], step[5]));
        let candidate =
            Pose::new(DQuat::from_scaled_axis(rotation) * pose.rotation, pose.translation + translation);
        let next = self::chi_square(sightings, lens, &candidate).unwrap_or(f64::INFINITY);
        if next < chi_square {
            let gain = chi_square - next;
            pose = candidate;
            let settled = gain <= 1e-14 * chi_square || next < 1e-24;
            chi_square = next;
            damping = (damping * 0.2).max(1e-12);
            (information, gradient) = normal_equations(sightings, lens, &pose)?;
            if settled {
                break;
            }
        } else {
            // Nothing left to gain at the smallest steps: this is the minimum.
            if damping > 1e8 || step.iter().all(|s| s.abs() < 1e-14) {
                break;
            }
            damping *= 8.0;
        }
    }
    let mut squares = 0.0;
    for s in sightings {
        squares += lens.project(pose.transform(s.point_object))?.distance_squared(s.pixel);
    }
    let rms_px = (squares / (2 * sightings.len()) as f64).sqrt();
    rms_px.is_finite().then_some(Refined {
        camera_from_object: pose,
        rms_px,
        chi_square,
        points: sightings.len(),
        information,
    })
}

/// Sum of squared residuals over their sigmas; `None` where a point cannot be seen.
pub fn chi_square(sightings: &[Sighting], lens: &Lens, camera_from_object: &Pose) -> Option<f64> {
    let mut sum = 0.0;
    for s in sightings {
        let seen = lens.project(camera_from_object.transform(s.point_object))?;
        sum += seen.distance_squared(s.pixel) / (s.sigma_px * s.sigma_px);
    }
    sum.is_finite().then_some(sum)
}

/// J^T J and -J^T r.
fn normal_equations(sightings: &[Sighting], lens: &Lens, pose: &Pose) -> Option<(Matrix6, [f64; 6])> {
    let (mut information, mut gradient) = ([[0.0; 6]; 6], [0.0; 6]);
    for s in sightings {
        let turned = pose.rotate(s.point_object);
        let p = turned + pose.translation;
        let residual = (lens.project(p)? - s.pixel) / s.sigma_px;
        let by_point = projection_jacobian(lens, p)?;
        for (by, residual) in by_point.into_iter().zip([residual.x, residual.y]) {
            let by = by / s.sigma_px;
            // d(exp(w) q)/dw = -[q]x, and by . (-[q]x) = q x by.
            let by_rotation = turned.cross(by);
            let row = [by_rotation.x, by_rotation.y, by_rotation.z, by.x, by.y, by.z];
            for i in 0..6 {
                gradient[i] -= row[i] * residual;
                for j in 0..6 {
                    information[i][j] += row[i] * row[j];
                }
            }
        }
    }
    Some((information, gradient))
}

/// Rows du/dp and dv/dp of the projection.
fn projection_jacobian(lens: &Lens, p: DVec3) -> Option<[DVec3; 2]> {
    if lens.distortion == Distortion::None {
        return Some([
            DVec3::new(lens.fx / p.z, 0.0, -lens.fx * p.x / (p.z * p.z)),
            DVec3::new(0.0, lens.fy / p.z, -lens.fy * p.y / (p.z * p.z)),
        ]);
    }
    // Central differences: the step balances truncation (h^2) and rounding (1e-16 / h).
    let h = 1e-5 * p.length();
    let mut columns = [DVec2::ZERO; 3];
    for (column, axis) in columns.iter_mut().zip(DMat3::IDENTITY.to_cols_array_2d()) {
        let axis = DVec3::from_array(axis) * h;
        *column = (lens.project(p + axis)? - lens.project(p - axis)?) / (2.0 * h);
    }
    Some([
        DVec3::new(columns[0].x, columns[1].x, columns[2].x),
        DVec3::new(columns[0].y, columns[1].y, columns[2].y),
    ])
}

/// Lower Cholesky factor after scaling to a unit diagonal, and the scale; `None` unless positive definite.
fn factor(matrix: &Matrix6) -> Option<(Matrix6, [f64; 6])> {
    let mut scale = [0.0; 6];
    for (i, s) in scale.iter_mut().enumerate() {
        let d = matrix[i][i];
        if !(d > 0.0 && d.is_finite()) {
            return None;
        }
        *s = 1.0 / d.sqrt();
    }
    let mut lower = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let mut sum = matrix[i][j] * scale[i] * scale[j];
            sum -= (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
            if i == j {
                if sum.is_nan() || sum <= 1e-15 {
                    return None;
                }
                lower[i][i] = sum.sqrt();
            } else {
                lower[i][j] = sum / lower[j][j];
            }
        }
    }
    Some((lower, scale))
}

fn solve(matrix: &Matrix6, right: &[f64; 6]) -> Option<[f64; 6]> {
    let (lower, scale) = factor(matrix)?;
    let mut x = [0.0; 6];
    for i in 0..6 {
        let mut sum = right[i] * scale[i];
        for k in 0..i {
            sum -= lower[i][k] * x[k];
        }
        x[i] = sum / lower[i][i];
    }
    for i in (0..6).rev() {
        let mut sum = x[i];
        for k in i + 1..6 {
            sum -= lower[k][i] * x[k];
        }
        x[i] = sum / lower[i][i];
    }
    for (x, s) in x.iter_mut().zip(scale) {
        *x *= s;
    }
    x.iter().all(|x| x.is_finite()).then_some(x)
}

/// The inverse of a positive definite matrix.
fn invert(matrix: &Matrix6) -> Option<Matrix6> {
    let mut inverse = [[0.0; 6]; 6];
    for (i, row) in inverse.iter_mut().enumerate() {
        let mut unit = [0.0; 6];
        unit[i] = 1.0;
        *row = solve(matrix, &unit)?;
    }
    Some(inverse)
}
