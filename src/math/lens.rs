//! Camera lenses: pinhole, radial-tangential (Brown-Conrady) and equidistant fisheye (Kannala-Brandt).

use glam::{DVec2, DVec3};

/// How rays bend between the pinhole's plane and the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// None: a pinhole.
    None,
    /// OpenCV's `plumb_bob` and `rational_polynomial`: k1 k2 p1 p2 k3 k4 k5 k6.
    RadialTangential([f64; 8]),
    /// Equidistant fisheye (OpenCV's `fisheye`): k1 k2 k3 k4 over the angle theta.
    Equidistant([f64; 4]),
}

/// A calibrated lens. Pixels are continuous: pixel (i, j) covers [i, i+1) x [j, j+1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point, x, in continuous pixels.
    pub cx: f64,
    /// Principal point, y, in continuous pixels.
    pub cy: f64,
    /// Distortion model and coefficients.
    pub distortion: Distortion,
}

impl Lens {
    /// No distortion; focal lengths and principal point in pixels.
    pub const fn pinhole(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { width, height, fx, fy, cx, cy, distortion: Distortion::None }
    }

    /// Where a point in the camera's frame appears, in continuous pixels: u = fx x_d + cx, v = fy y_d + cy,
    /// with (x_d, y_d) the distorted point of the plane z = 1. `None` behind the camera (a fisheye sees up to
    /// straight behind), beyond the radius where the distortion folds back, and for NaN. The result may lie
    /// outside the picture.
    pub fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        let DVec3 { x, y, z } = point_camera;
        if !point_camera.is_finite() {
            return None;
        }
        let plane = match self.distortion {
            Distortion::None => (z > 0.0).then(|| DVec2::new(x / z, y / z))?,
            Distortion::RadialTangential(k) => {
                let undistorted = (z > 0.0).then(|| DVec2::new(x / z, y / z))?;
                if !radial::monotone_up_to(&k, undistorted.length_squared()) {
                    return None;
                }
                let (distorted, jacobian) = radial::distort(&k, undistorted);
                (jacobian.determinant() > 0.0).then_some(distorted)?
            }
            Distortion::Equidistant(k) => {
                let sine = x.hypot(y);
                let theta = sine.atan2(z);
                if !(sine > 0.0) {
                    // On the axis: ahead is the centre, behind has no azimuth.
                    (z > 0.0).then_some(DVec2::ZERO)?
                } else if fisheye::monotone_up_to(&k, theta * theta) {
                    DVec2::new(x, y) * (fisheye::distort(&k, theta).0 / sine)
                } else {
                    return None;
                }
            }
        };
        let pixel = plane * DVec2::new(self.fx, self.fy) + DVec2::new(self.cx, self.cy);
        pixel.is_finite().then_some(pixel)
    }

    /// The unit direction, in the camera's frame, of the ray through a pixel (continuous, anywhere):
    /// `project(unproject(p)) == p`. `None` where the distortion reaches no such point, and for NaN.
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let plane = (pixel - DVec2::new(self.cx, self.cy)) / DVec2::new(self.fx, self.fy);
        if !plane.is_finite() {
            return None;
        }
        match self.distortion {
            Distortion::None => plane.extend(1.0).try_normalize(),
            Distortion::RadialTangential(k) => radial::undistort(&k, plane)?.extend(1.0).try_normalize(),
            Distortion::Equidistant(k) => {
                let radius = plane.length();
                let (sine, cosine) = fisheye::undistort(&k, radius)?.sin_cos();
                let side = if radius > 0.0 { plane / radius } else { DVec2::ZERO };
                (side * sine).extend(cosine).try_normalize()
            }
        }
    }
}

/// Whether the polynomial sum c_i s^i is positive on all of [0, end]: its Bernstein coefficients bound it
/// from below, and halving makes the bound tight. Exact but for touching zeros, which count as zeros.
fn positive_on<const N: usize>(coefficients: &[f64; N], end: f64) -> bool {
    let mut bernstein = [0.0; N];
    // b_j = sum_{i<=j} C(j,i)/C(n,i) c_i end^i
    for (j, b) in bernstein.iter_mut().enumerate() {
        let (mut ratio, mut power) = (1.0, 1.0);
        for (i, c) in coefficients.iter().enumerate().take(j + 1) {
            *b += ratio * c * power;
            ratio *= (j - i) as f64 / (N - 1 - i).max(1) as f64;
            power *= end;
        }
    }
    bernstein_positive(&bernstein, 0)
}

fn bernstein_positive<const N: usize>(b: &[f64; N], depth: u32) -> bool {
    if !(b[0] > 0.0 && b[N - 1] > 0.0) {
        return false;
    }
    if b.iter().all(|v| *v > 0.0) {
        return true;
    }
    if depth == 20 {
        return false;
    }
    // De Casteljau at one half.
    let (mut left, mut right) = (*b, *b);
    for level in 1..N {
        for i in 0..N - level {
            right[i] = 0.5 * (right[i] + right[i + 1]);
        }
        left[level] = right[0];
    }
    // `right` now runs from the split point to the end.
    bernstein_positive(&left, depth + 1) && bernstein_positive(&right, depth + 1)
}

/// Largest x in [0, limit] with `rises(x)` and `of(x) <= target`; both hold at 0 and fail for good beyond some x.
fn bisect(limit: f64, target: f64, rises: impl Fn(f64) -> bool, of: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..64 {
        let mid = 0.5 * (low + high);
        if rises(mid) && of(mid) <= target { low = mid } else { high = mid }
    }
    low
}

/// Brown-Conrady with the rational extension: x_d = x N/D + 2 p1 x y + p2 (r^2 + 2 x^2),
/// y_d = y N/D + p1 (r^2 + 2 y^2) + 2 p2 x y, N = 1 + k1 s + k2 s^2 + k3 s^3, D = 1 + k4 s + k5 s^2 + k6 s^3,
/// s = r^2.
mod radial {
    use super::{bisect, positive_on};
    use glam::{DMat2, DVec2};

    /// Beyond 89.9 degrees off the axis no such lens is calibrated.
    const LARGEST_RADIUS: f64 = 600.0;
    /// Largest residual of the inversion, on the plane z = 1 (1e-8 px at 1000 px focal length).
    const TOLERANCE: f64 = 1e-11;

    /// N, D and their derivatives by s.
    fn rational(k: &[f64; 8], s: f64) -> (f64, f64, f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6] = *k;
        (
            1.0 + s * (k1 + s * (k2 + s * k3)),
            1.0 + s * (k4 + s * (k5 + s * k6)),
            k1 + s * (2.0 * k2 + s * 3.0 * k3),
            k4 + s * (2.0 * k5 + s * 3.0 * k6),
        )
    }

    /// The distorted point and its Jacobian.
    pub fn distort(k: &[f64; 8], point: DVec2) -> (DVec2, DMat2) {
        let (p1, p2) = (k[2], k[3]);
        let DVec2 { x, y } = point;
        let s = x * x + y * y;
        let (n, d, dn, dd) = rational(k, s);
        let ratio = n / d;
        // d(ratio)/dx = 2 x slope, d(ratio)/dy = 2 y slope
        let slope = (dn - ratio * dd) / d;
        let distorted = point * ratio
            + DVec2::new(
                2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            );
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = DMat2::from_cols(
            DVec2::new(ratio + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, cross),
            DVec2::new(cross, ratio + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x),
        );
        (distorted, jacobian)
    }

    /// Whether r N/D rises on all of [0, sqrt s]: D > 0 and (N + 2 s N') D - 2 s N D' > 0 there.
    pub fn monotone_up_to(k: &[f64; 8], s: f64) -> bool {
        let [k1, k2, _, _, k3, k4, k5, k6] = *k;
        let rising = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3];
        if k4 == 0.0 && k5 == 0.0 && k6 == 0.0 {
            return positive_on(&rising, s);
        }
        let (n, d, sloped) = ([1.0, k1, k2, k3], [1.0, k4, k5, k6], [0.0, 2.0 * k4, 4.0 * k5, 6.0 * k6]);
        let mut product = [0.0; 7];
        for i in 0..4 {
            for j in 0..4 {
                product[i + j] += rising[i] * d[j] - n[i] * sloped[j];
            }
        }
        positive_on(&d, s) && positive_on(&product, s)
    }

    /// Newton's iteration with halved steps where the error would grow.
    fn newton(k: &[f64; 8], target: DVec2, start: DVec2) -> Option<DVec2> {
        let mut point = start;
        let (mut distorted, mut jacobian) = distort(k, point);
        let mut error = (distorted - target).length();
        for _ in 0..40 {
            if error == 0.0 {
                break;
            }
            let mut step = jacobian.inverse() * (target - distorted);
            let mut better = false;
            // Within the tolerance whole steps are taken while they still help: they are nearly free.
            for _ in 0..if error <= TOLERANCE { 1 } else { 12 } {
                let next = distort(k, point + step);
                let next_error = (next.0 - target).length();
                if next_error < error {
                    point += step;
                    (distorted, jacobian) = next;
                    error = next_error;
                    better = true;
                    break;
                }
                step *= 0.5;
            }
            if !better {
                break;
            }
        }
        let good = error <= TOLERANCE * (1.0 + target.length())
            && jacobian.determinant() > 0.0
            && monotone_up_to(k, point.length_squared());
        good.then_some(point)
    }

    /// The point that is distorted to `target`, on the branch that contains the centre.
    pub fn undistort(k: &[f64; 8], target: DVec2) -> Option<DVec2> {
        newton(k, target, target).or_else(|| {
            // Start from the radius that the radial part alone gives.
            let radius = target.length();
            let found = bisect(
                LARGEST_RADIUS,
                radius,
                |r| monotone_up_to(k, r * r),
                |r| {
                    let (n, d, _, _) = rational(k, r * r);
                    r * n / d
                },
            );
            newton(k, target, target * (found / radius))
        })
    }
}

/// Kannala-Brandt: theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).
mod fisheye {
    use super::{bisect, positive_on};
    use std::f64::consts::PI;

    /// theta_d and its derivative.
    pub fn distort(k: &[f64; 4], theta: f64) -> (f64, f64) {
        let s = theta * theta;
        (
            theta * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))),
            1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * (7.0 * k[2] + s * 9.0 * k[3]))),
        )
    }

    /// Whether theta_d rises on all of [0, sqrt s].
    pub fn monotone_up_to(k: &[f64; 4], s: f64) -> bool {
        positive_on(&[1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]], s)
    }

    /// The angle in [0, pi] that is distorted to `target`, on the branch that contains 0.
    pub fn undistort(k: &[f64; 4], target: f64) -> Option<f64> {
        newton(k, target, target).or_else(|| {
            let rises = |theta: f64| monotone_up_to(k, theta * theta);
            newton(k, target, bisect(PI, target, rises, |theta| distort(k, theta).0))
        })
    }

    fn newton(k: &[f64; 4], target: f64, start: f64) -> Option<f64> {
        let mut theta = start;
        for _ in 0..30 {
            let (distorted, slope) = distort(k, theta);
            let step = (target - distorted) / slope;
            theta += step;
            if !(step.abs() > 1e-16 * theta.abs()) {
                break;
            }
        }
        let error = (distort(k, theta).0 - target).abs();
        let good = error <= 1e-12 * (1.0 + target) && (0.0..=PI).contains(&theta);
        (good && monotone_up_to(k, theta * theta)).then_some(theta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens(distortion: Distortion) -> Lens {
        Lens { distortion, ..Lens::pinhole(640, 480, 420.0, 430.0, 318.2, 241.7) }
    }

    /// Round trip over the whole picture; how many pixels could be inverted.
    fn round_trip(lens: &Lens) -> usize {
        let mut inverted = 0;
        for j in 0..=24 {
            for i in 0..=32 {
                let pixel = DVec2::new(f64::from(i) * 20.0, f64::from(j) * 20.0);
                let Some(ray) = lens.unproject(pixel) else { continue };
                assert!((ray.length() - 1.0).abs() < 1e-14);
                let back = lens.project(ray * 3.7).expect("a ray of the lens projects");
                assert!(back.distance(pixel) < 1e-6, "{lens:?}: {pixel} came back as {back}");
                inverted += 1;
            }
        }
        inverted
    }

    const ALL: usize = 25 * 33;

    #[test]
    fn pinhole_by_hand() {
        let lens = lens(Distortion::None);
        assert_eq!(lens.project(DVec3::new(1.0, -0.5, 2.0)), Some(DVec2::new(528.2, 134.2)));
        assert_eq!(lens.project(DVec3::new(1.0, 0.0, -2.0)), None);
        assert_eq!(lens.project(DVec3::new(1.0, 0.0, 0.0)), None);
        assert_eq!(round_trip(&lens), ALL);
    }

    #[test]
    fn radial_tangential_by_hand() {
        // x = 0.5, y = 0: s = 0.25; N/D = (1 - 0.05 + 0.00625) / (1 + 0.025); tangential x: p2 (s + 2 x^2), y: p1 s.
        let lens = lens(Distortion::RadialTangential([-0.2, 0.1, 0.01, -0.02, 0.0, 0.1, 0.0, 0.0]));
        let got = lens.project(DVec3::new(1.0, 0.0, 2.0)).unwrap();
        let want =
            DVec2::new(420.0 * (0.5 * 0.95625 / 1.025 - 0.02 * 0.75) + 318.2, 430.0 * 0.01 * 0.25 + 241.7);
        assert!(got.distance(want) < 1e-12, "{got} instead of {want}");
    }

    #[test]
    fn distorted_lenses_invert_over_the_picture() {
        for k in [
            [-0.28, 0.07, 0.001, -0.0005, 0.0, 0.0, 0.0, 0.0],
            [0.12, -0.05, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0],
            [0.9, 0.2, 0.0004, 0.0002, 0.01, 1.2, 0.4, 0.05],
            [-0.35, 0.15, 0.0, 0.0, -0.02, 0.0, 0.0, 0.0],
        ] {
            assert_eq!(round_trip(&lens(Distortion::RadialTangential(k))), ALL, "{k:?}");
        }
        for k in [[0.0; 4], [-0.02, 0.005, -0.003, 0.0006], [0.1, -0.01, 0.0, 0.0]] {
            assert_eq!(round_trip(&lens(Distortion::Equidistant(k))), ALL, "{k:?}");
        }
    }

    #[test]
    fn beyond_the_fold_there_is_nothing() {
        // r (1 - 0.3 r^2) rises up to r = sqrt(1/0.9) = 1.054, where it is 0.7027.
        let lens = lens(Distortion::RadialTangential([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert!(lens.project(DVec3::new(1.05, 0.0, 1.0)).is_some());
        assert_eq!(lens.project(DVec3::new(1.06, 0.0, 1.0)), None);
        // Far beyond, the polynomial comes back through the centre: still nothing.
        assert_eq!(lens.project(DVec3::new(1.8, 0.0, 1.0)), None);
        assert!(lens.unproject(DVec2::new(318.2 + 420.0 * 0.7026, 241.7)).is_some());
        assert_eq!(lens.unproject(DVec2::new(318.2 + 420.0 * 0.7028, 241.7)), None);
        assert!(round_trip(&lens) < ALL);
        // Rising again after a fold (k2 > 0) does not count either: 1 - 1.8 s + 0.75 s^2 < 0 from s = 0.87 to 1.53.
        let k = [-0.6, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(radial::monotone_up_to(&k, 0.86) && !radial::monotone_up_to(&k, 0.88));
        assert!(!radial::monotone_up_to(&k, 4.0));
        // A pole of the rational model ends it too.
        assert!(!radial::monotone_up_to(&[0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0], 2.1));
    }

    #[test]
    fn the_fisheye_sees_behind_itself() {
        let lens = lens(Distortion::Equidistant([0.0; 4]));
        let behind = DVec3::new(0.3, -0.2, -0.5);
        let pixel = lens.project(behind).unwrap();
        assert!(lens.unproject(pixel).unwrap().distance(behind.normalize()) < 1e-14);
        assert_eq!(lens.project(DVec3::NEG_Z), None);
        assert_eq!(lens.project(DVec3::Z), Some(DVec2::new(318.2, 241.7)));
        // pi is the end of the sphere.
        assert_eq!(lens.unproject(DVec2::new(318.2 + 420.0 * 3.15, 241.7)), None);
    }

    #[test]
    fn not_a_number_in_gives_none() {
        for distortion in
            [Distortion::None, Distortion::RadialTangential([0.1; 8]), Distortion::Equidistant([0.01; 4])]
        {
            let lens = lens(distortion);
            for bad in [f64::NAN, f64::INFINITY] {
                assert_eq!(lens.unproject(DVec2::new(bad, 3.0)), None);
                assert_eq!(lens.project(DVec3::new(bad, 0.0, 1.0)), None);
                assert_eq!(lens.project(DVec3::new(bad, bad, bad)), None);
            }
            assert_eq!(lens.project(DVec3::ZERO), None);
            let zero_focal = Lens { fx: 0.0, ..lens };
            assert_eq!(zero_focal.unproject(DVec2::new(1.0, 1.0)), None);
        }
        let broken = lens(Distortion::RadialTangential([f64::NAN; 8]));
        assert_eq!(broken.unproject(DVec2::new(1.0, 1.0)), None);
        assert_eq!(broken.project(DVec3::new(0.1, 0.1, 1.0)), None);
        let broken = lens(Distortion::Equidistant([f64::NAN; 4]));
        assert_eq!(broken.unproject(DVec2::new(1.0, 1.0)), None);
        assert_eq!(broken.project(DVec3::new(0.1, 0.1, 1.0)), None);
    }

    proptest! {
        #[test]
        fn random_lenses_invert(
            k in prop::array::uniform8(-0.5..0.5_f64), fish in prop::array::uniform4(-0.1..0.1_f64),
            x in -0.9..0.9_f64, y in -0.7..0.7_f64,
        ) {
            let mut k = k;
            k[2] *= 0.01;
            k[3] *= 0.01;
            for lens in [lens(Distortion::RadialTangential(k)), lens(Distortion::Equidistant(fish))] {
                let point = DVec3::new(x, y, 1.0);
                let Some(pixel) = lens.project(point) else { continue };
                // A point that projects has a way back, to itself: the branch is the same.
                let ray = lens.unproject(pixel);
                prop_assume!(ray.is_some() || !near_fold(&lens, point));
                let ray = ray.unwrap();
                let again = lens.project(ray).unwrap();
                prop_assert!(again.distance(pixel) < 1e-6);
            }
        }
    }

    /// Within 1e-3 of where the distortion folds, where the inverse is ill-conditioned.
    fn near_fold(lens: &Lens, point: DVec3) -> bool {
        lens.project(DVec3::new(point.x * 1.001, point.y * 1.001, point.z)).is_none()
    }
}
