//! Charts of the sphere as formulas over f32 or f64: angular map, mirror ball (orthographic and
//! perspective), cube face. `sphere` gives them as vectors in f64.
//!
//! (u, v) are in [-1, 1] with the disc r = hypot(u, v) <= 1. A picture of width w has texels of area (2/w)^2,
//! so a texel's solid angle is about its Jacobian d_omega/(du dv) times (2/w)^2.

use super::sh::Real;

/// sin(x)/x (not normalised by pi); 1 at 0.
pub fn sinc<T: Real>(x: T) -> T {
    // Below this the next term, x^2/6, is under half an ulp of 1 in f64 and f32 alike.
    if x.abs() < T::of(1e-8) { T::one() } else { x.sin() / x }
}

/// Direction of an angular map, map axis +z: polar angle pi r, azimuth atan2(v, u) (Eq. 6 of [Now11] with
/// its two angles put right). `None` outside the disc.
pub fn angular_direction<T: Real>(u: T, v: T) -> Option<[T; 3]> {
    let r = u.hypot(v);
    if !(r <= T::one()) {
        return None;
    }
    let polar = T::PI() * r;
    // sin(pi r)/r without a division by zero.
    let scale = T::PI() * sinc(polar);
    Some([scale * u, scale * v, polar.cos()])
}

/// Solid angle per area of an angular map: pi^2 sinc(pi r); a texel of width 2/w has (2 pi / w)^2 sinc(pi r)
/// (Eq. 6 of [Now11]). Zero outside the disc.
pub fn angular_jacobian<T: Real>(u: T, v: T) -> T {
    let r = u.hypot(v);
    if r <= T::one() { T::PI() * T::PI() * sinc(T::PI() * r) } else { T::zero() }
}

/// Direction seen in an orthographic photograph of a mirror ball, +z towards the camera: the normal
/// n = (u, v, sqrt(1-r^2)) mirrors z into R = 2 n_z n - z. Area preserving: d_omega = 4 du dv. `None` outside
/// the disc; the rim is the direction behind the ball.
pub fn ball_orthographic_direction<T: Real>(u: T, v: T) -> Option<[T; 3]> {
    let r2 = u * u + v * v;
    if !(r2 <= T::one()) {
        return None;
    }
    let two = T::of(2.0);
    let n_z = (T::one() - r2).sqrt();
    Some([two * n_z * u, two * n_z * v, T::one() - two * r2])
}

/// Solid angle per area of an orthographic mirror ball: 4.
pub fn ball_orthographic_jacobian<T: Real>() -> T {
    T::of(4.0)
}

/// Polar angle, from the direction ball -> camera, of what a perspective camera sees in a mirror ball:
/// psi = atan(r tan(asin q)), theta = 2 asin(sin psi / q) - psi.
///
/// `r` is the distance from the picture of the ball's centre over that of its silhouette, 0..=1, and `q` is
/// radius over camera distance, within (0, 1). Rises from 0 to pi - asin q; `None` outside the ranges.
pub fn ball_polar_angle<T: Real>(q: T, r: T) -> Option<T> {
    let (sine, _, psi) = ball_ray(q, r)?;
    Some(T::of(2.0) * (sine / q).min(T::one()).asin() - psi)
}

/// Solid angle per area (d_omega/du dv, both normalised to the silhouette) of a perspective mirror ball:
/// sin(theta) [2 cos psi / sqrt(q^2 - sin^2 psi) - 1] tan(asin q) cos^2 psi / r, and ((2/q-1) tan asin q)^2
/// at r = 0. Diverges like (1-r)^-1/2 at the rim, where this is `None`, as it is outside the ranges.
pub fn ball_jacobian<T: Real>(q: T, r: T) -> Option<T> {
    let (sine, cosine, _) = ball_ray(q, r)?;
    let theta = ball_polar_angle(q, r)?;
    let one = T::one();
    let two = T::of(2.0);
    let tangent = q / ((one - q) * (one + q)).sqrt();
    // Too near the centre, sin(theta)/r is 0/0; the limit's own error is of order r^2.
    if r < T::of(1e-6) {
        return Some(((two / q - one) * tangent).powi(2));
    }
    let under = (q - sine) * (q + sine);
    let jacobian = theta.sin() * (two * cosine / under.sqrt() - one) * tangent * cosine * cosine / r;
    (r < one && under > T::zero() && jacobian.is_finite()).then_some(jacobian)
}

/// Half angle of the cone behind the ball that a camera cannot see in it: asin q.
pub fn ball_blind_half_angle<T: Real>(q: T) -> T {
    q.asin()
}

/// Share of the sphere inside that cone: (1 - cos asin q)/2, in the form that keeps its digits for small q.
pub fn ball_blind_fraction<T: Real>(q: T) -> T {
    let cosine = ((T::one() - q) * (T::one() + q)).sqrt();
    T::of(0.5) * q * q / (T::one() + cosine)
}

/// (sin psi, cos psi, psi) of the camera ray at silhouette-normalised radius r.
fn ball_ray<T: Real>(q: T, r: T) -> Option<(T, T, T)> {
    let (zero, one) = (T::zero(), T::one());
    if !(q > zero && q < one && r >= zero && r <= one) {
        return None;
    }
    let slope = r * q / ((one - q) * (one + q)).sqrt();
    let cosine = one / (one + slope * slope).sqrt();
    Some((slope * cosine, cosine, slope.atan()))
}

/// Solid angle of a cube texel by Eq. 7 of [Now11], the midpoint rule: 4 t^(-3/2) / w^2 with
/// t = 1 + u^2 + v^2 at the texel's centre. Second order: the six faces sum to 4 pi within 6e-5 at w = 64.
pub fn cube_texel_solid_angle_midpoint<T: Real>(width: usize, i: usize, j: usize) -> T {
    let w = T::of(width as f64);
    let centre = |k: usize| (T::of(2.0) * T::of(k as f64) + T::one()) / w - T::one();
    let (u, v) = (centre(i), centre(j));
    let t = T::one() + u * u + v * v;
    T::of(4.0) / (t * t.sqrt() * w * w)
}

/// Exact solid angle of a cube texel: A(x1,y1) - A(x0,y1) - A(x1,y0) + A(x0,y0) with
/// A(x, y) = atan2(x y, sqrt(x^2 + y^2 + 1)).
pub fn cube_texel_solid_angle<T: Real>(width: usize, i: usize, j: usize) -> T {
    let w = T::of(width as f64);
    let edge = |k: usize| T::of(2.0) * T::of(k as f64) / w - T::one();
    let corner = |x: T, y: T| (x * y).atan2((x * x + y * y + T::one()).sqrt());
    let (x0, x1, y0, y1) = (edge(i), edge(i + 1), edge(j), edge(j + 1));
    (corner(x1, y1) - corner(x0, y1)) - (corner(x1, y0) - corner(x0, y0))
}
