//! Pose from points: Levenberg-Marquardt on the reprojection error, over f32 or f64, for any camera.

use crate::math::{
    projection::Projection,
    rigid::{Quaternion, Rigid},
    sh::Real,
    vector::Vector,
};

/// A point of an object and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting<T = f64> {
    /// In the object's frame, metres.
    pub point_object: Vector<T, 3>,
    /// Where it was seen, continuous pixels.
    pub pixel: Vector<T, 2>,
    /// Standard deviation of either coordinate, pixels; above 0.
    pub sigma_px: T,
}

/// A symmetric 6x6 matrix over (rotation, translation) of a small motion in the camera's frame.
pub type Matrix6<T = f64> = [[T; 6]; 6];

/// A pose at a minimum of the reprojection error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined<T = f64> {
    /// Takes points of the object to the camera's frame, metres.
    pub camera_from_object: Rigid<T>,
    /// Root of the mean squared residual, over both coordinates of all points, pixels.
    pub rms_px: T,
    /// Sum of squared residuals, each over its sigma.
    pub chi_square: T,
    /// Points that entered.
    pub points: usize,
    /// J^T J of the residuals over their sigmas, for p_camera -> exp(rotation) R p + t + translation.
    pub information: Matrix6<T>,
}

/// Standard deviations of a camera's pose in an object's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSigma<T = f64> {
    /// Root of the trace of the position's covariance, metres.
    pub position_m: T,
    /// Root of the trace of the rotation's covariance, radians.
    pub rotation_rad: T,
}

impl<T: Real> Refined<T> {
    /// Standard deviations of the camera's pose in the object's frame, from (J^T J)^-1; larger residuals than
    /// the stated sigmas explain enlarge them. `None` where the points do not fix the pose.
    pub fn sigma(&self) -> Option<PoseSigma<T>> {
        let covariance = invert(&self.information)?;
        let o = T::zero();
        let freedom = T::of((2 * self.points) as f64 - 6.0);
        let excess = if freedom > o { (self.chi_square / freedom).max(T::one()) } else { T::one() };
        // Camera centre c = -R^T t moves by -R^T (translation + t x rotation): lengths need no R^T.
        let [x, y, z] = self.camera_from_object.translation.0;
        let cross = [[o, -z, y], [z, o, -x], [-y, x, o]];
        let mut position = o;
        for (row, cross_row) in cross.iter().enumerate() {
            let mut a = [o; 6];
            a[..3].copy_from_slice(cross_row);
            a[3 + row] = T::one();
            for i in 0..6 {
                for j in 0..6 {
                    position += a[i] * covariance[i][j] * a[j];
                }
            }
        }
        let rotation = (0..3).fold(o, |sum, i| sum + covariance[i][i]);
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
pub fn refine<T: Real, P: Projection<T>>(
    sightings: &[Sighting<T>],
    lens: &P,
    start: &Rigid<T>,
) -> Option<Refined<T>> {
    if sightings.len() < 3 {
        return None;
    }
    let mut pose = *start;
    let mut chi_square = chi_square(sightings, lens, &pose)?;
    let mut damping = T::of(1e-3);
    // A gain below this share is rounding, in f32 already a unit in the last place.
    let least_gain = T::of(1e-14).max(T::epsilon());
    let (mut information, mut gradient) = normal_equations(sightings, lens, &pose)?;
    for _ in 0..STEPS {
        let mut damped = information;
        for (i, row) in damped.iter_mut().enumerate() {
            row[i] += damping * information[i][i];
        }
        let step = solve(&damped, &gradient)?;
        let [rx, ry, rz, tx, ty, tz] = step;
        let candidate = Rigid::new(
            Quaternion::exp(Vector([rx, ry, rz])).times(pose.rotation),
            pose.translation + Vector([tx, ty, tz]),
        );
        let next = self::chi_square(sightings, lens, &candidate).unwrap_or(T::infinity());
        if next < chi_square {
            let gain = chi_square - next;
            pose = candidate;
            let settled = gain <= least_gain * chi_square || next < T::of(1e-24);
            chi_square = next;
            damping = (damping * T::of(0.2)).max(T::of(1e-12));
            (information, gradient) = normal_equations(sightings, lens, &pose)?;
            if settled {
                break;
            }
        } else {
            // Nothing left to gain at the smallest steps: this is the minimum.
            if damping > T::of(1e8) || step.iter().all(|s| s.abs() < T::of(1e-14)) {
                break;
            }
            damping = damping * T::of(8.0);
        }
    }
    let mut squares = T::zero();
    for s in sightings {
        squares += lens.project(pose.transform(s.point_object))?.distance_squared(s.pixel);
    }
    let rms_px = (squares / T::of((2 * sightings.len()) as f64)).sqrt();
    rms_px.is_finite().then_some(Refined {
        camera_from_object: pose,
        rms_px,
        chi_square,
        points: sightings.len(),
        information,
    })
}

/// Sum of squared residuals over their sigmas; `None` where a point cannot be seen.
pub fn chi_square<T: Real, P: Projection<T>>(
    sightings: &[Sighting<T>],
    lens: &P,
    camera_from_object: &Rigid<T>,
) -> Option<T> {
    let mut sum = T::zero();
    for s in sightings {
        let seen = lens.project(camera_from_object.transform(s.point_object))?;
        sum += seen.distance_squared(s.pixel) / (s.sigma_px * s.sigma_px);
    }
    sum.is_finite().then_some(sum)
}

/// J^T J and -J^T r.
fn normal_equations<T: Real, P: Projection<T>>(
    sightings: &[Sighting<T>],
    lens: &P,
    pose: &Rigid<T>,
) -> Option<(Matrix6<T>, [T; 6])> {
    let (mut information, mut gradient) = ([[T::zero(); 6]; 6], [T::zero(); 6]);
    for s in sightings {
        let turned = pose.rotation.rotate(s.point_object);
        let p = turned + pose.translation;
        let residual = (lens.project(p)? - s.pixel) / s.sigma_px;
        let by_point = lens.jacobian(p)?;
        for (by, residual) in by_point.into_iter().zip(residual.0) {
            let by = by / s.sigma_px;
            // d(exp(w) q)/dw = -[q]x, and by . (-[q]x) = q x by.
            let ([rx, ry, rz], [tx, ty, tz]) = (turned.cross(by).0, by.0);
            let row = [rx, ry, rz, tx, ty, tz];
            for i in 0..6 {
                gradient[i] += -(row[i] * residual);
                for j in 0..6 {
                    information[i][j] += row[i] * row[j];
                }
            }
        }
    }
    Some((information, gradient))
}

/// Lower Cholesky factor after scaling to a unit diagonal, and the scale; `None` unless positive definite.
fn factor<T: Real>(matrix: &Matrix6<T>) -> Option<(Matrix6<T>, [T; 6])> {
    let mut scale = [T::zero(); 6];
    for (i, s) in scale.iter_mut().enumerate() {
        let d = matrix[i][i];
        if !(d > T::zero() && d.is_finite()) {
            return None;
        }
        *s = T::one() / d.sqrt();
    }
    let mut lower = [[T::zero(); 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let mut sum = matrix[i][j] * scale[i] * scale[j];
            sum = sum - (0..j).fold(T::zero(), |known, k| known + lower[i][k] * lower[j][k]);
            if i == j {
                if sum.is_nan() || sum <= T::of(1e-15) {
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

fn solve<T: Real>(matrix: &Matrix6<T>, right: &[T; 6]) -> Option<[T; 6]> {
    let (lower, scale) = factor(matrix)?;
    let mut x = [T::zero(); 6];
    for i in 0..6 {
        let mut sum = right[i] * scale[i];
        for k in 0..i {
            sum = sum - lower[i][k] * x[k];
        }
        x[i] = sum / lower[i][i];
    }
    for i in (0..6).rev() {
        let mut sum = x[i];
        for k in i + 1..6 {
            sum = sum - lower[k][i] * x[k];
        }
        x[i] = sum / lower[i][i];
    }
    for (x, s) in x.iter_mut().zip(scale) {
        *x = *x * s;
    }
    x.iter().all(|x| x.is_finite()).then_some(x)
}

/// The inverse of a positive definite matrix.
fn invert<T: Real>(matrix: &Matrix6<T>) -> Option<Matrix6<T>> {
    let mut inverse = [[T::zero(); 6]; 6];
    for (i, row) in inverse.iter_mut().enumerate() {
        let mut unit = [T::zero(); 6];
        unit[i] = T::one();
        *row = solve(matrix, &unit)?;
    }
    Some(inverse)
}
