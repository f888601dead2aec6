//! The exact form factor of a polygon (Section 5 of [Gib03]): Lambert's contour formula, cut at the horizon.

use glam::DVec3;
use std::f64::consts::TAU;

/// What is smaller counts as nothing: a source in the receiver's plane gives rounding noise of either sign.
pub const SMALLEST: f64 = 1e-7;
/// Most corners of a polygon.
pub const MAX_CORNERS: usize = 4;
/// A polygon is seen edge-on where the point is nearer to its plane than this share of its size.
const EDGE_ON: f64 = 1e-7;
/// asin(s)/s in powers of s^2.
const SERIES: [f64; 9] = [
    1.0,
    1.0 / 6.0,
    3.0 / 40.0,
    5.0 / 112.0,
    35.0 / 1152.0,
    63.0 / 2816.0,
    231.0 / 13_312.0,
    143.0 / 10_240.0,
    6435.0 / 557_056.0,
];

/// Share of the cosine-weighted hemisphere about `normal` (unit) at `point` that a flat convex polygon covers, whichever
/// way it faces: F = integral of max(0, n.w) / pi over its solid angle, so that radiance L of it gives the irradiance
/// pi L F. Within [0, 1]; 0 below 1e-7, for a point in the polygon's plane (also on the polygon), and where anything is
/// not finite. At most 4 corners count, in order, of either sense. What lies below the point's horizon is cut off.
/// Splitting a polygon splits its form factor.
///
/// F = 1/(2 pi) sum over edges n.(a x b) / |a x b| angle(a, b), a and b the ends seen from the point.
pub fn form_factor(point: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let count = corners.len().min(MAX_CORNERS);
    if count < 3 {
        return 0.0;
    }
    let mut seen = [DVec3::ZERO; MAX_CORNERS];
    let mut heights = [0.0; MAX_CORNERS];
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for ((to, height), corner) in seen.iter_mut().zip(&mut heights).zip(&corners[..count]) {
        *to = *corner - point;
        *height = normal.dot(*to);
        (lowest, highest) = (lowest.min(*height), highest.max(*height));
    }
    if !(highest > 0.0) {
        return 0.0;
    }
    // Seen edge-on: volume of the pyramid against that of its base's own size.
    let plane = (seen[1] - seen[0]).cross(seen[2] - seen[0]);
    if !(plane.dot(seen[0]).abs() > EDGE_ON * plane.length().powf(1.5)) {
        return 0.0;
    }
    let sum = if lowest >= 0.0 {
        contour(normal, &mut seen[..count])
    } else {
        // Each cut of a convex polygon by a plane adds one corner at most.
        let mut cut = [DVec3::ZERO; MAX_CORNERS + 1];
        let mut used = 0;
        for i in 0..count {
            let j = (i + 1) % count;
            if heights[i] >= 0.0 {
                cut[used] = seen[i];
                used += 1;
            }
            if (heights[i] < 0.0) != (heights[j] < 0.0) && used <= MAX_CORNERS {
                cut[used] = seen[i].lerp(seen[j], heights[i] / (heights[i] - heights[j]));
                used += 1;
            }
            if used > MAX_CORNERS {
                break;
            }
        }
        contour(normal, &mut cut[..used])
    };
    let factor = sum.abs() / TAU;
    if factor >= SMALLEST { factor.min(1.0) } else { 0.0 }
}

/// Sum over the edges; corners become unit vectors.
fn contour(normal: DVec3, corners: &mut [DVec3]) -> f64 {
    for corner in corners.iter_mut() {
        *corner = corner.normalize_or_zero();
    }
    let Some(mut a) = corners.last().copied() else { return 0.0 };
    let mut sum = 0.0;
    for &b in corners.iter() {
        let cross = a.cross(b);
        sum += normal.dot(cross) * angle_over_sine(cross.length_squared(), a.dot(b));
        a = b;
    }
    sum
}

/// angle / sin(angle) from the sine's square and the cosine; 0 where the sine is 0, for such an edge adds nothing.
fn angle_over_sine(sine_squared: f64, cosine: f64) -> f64 {
    // Short edges by the series of asin(s)/s, up to angles of 17 degrees: wrong by less than 5e-12.
    if sine_squared < 0.09 && cosine > 0.0 {
        return SERIES.iter().rev().fold(0.0, |sum, c| sum * sine_squared + c);
    }
    let sine = sine_squared.sqrt();
    if sine > 0.0 { sine.atan2(cosine) / sine } else { 0.0 }
}

#[cfg(test)]
mod tests;
