//! De-ringing: the least damping of a band-limited light after which its irradiance is nowhere negative.
//!
//! The window is a contraction towards the mean: of the bands that reach irradiance (1, 2 and 4) a share is taken away,
//! the same in each; band 0 keeps all of its energy, bands 3 and 5 add nothing to irradiance and stay. The least that
//! suffices follows from the exact minimum m and the mean E_0 of the irradiance: what stays is E_0 / (E_0 - m).
//!
//! Other windows that were tried on a point light, scaled until its irradiance is not negative, and the L2 error of the
//! light that each makes (order 4): this one 0.10; e^(-tl) 0.28; e^(-tl(l+1)) 0.51; Hanning and Lanczos 0.80.

use super::{MAX_COEFFICIENTS, MAX_ORDER, basis, zonal};
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Irradiance has no bands beyond: order 6 has band 5, which the clamped cosine takes out.
const IRRADIANCE_ORDER: usize = 5;
const IRRADIANCE_COEFFICIENTS: usize = IRRADIANCE_ORDER * IRRADIANCE_ORDER;
/// Directions of the first search.
const GRID: usize = 512;
/// No direction is further than this from one of the grid (measured, 0.113, rounded up).
const GRID_REACH_RAD: f64 = 0.12;
/// Minima of functions of degree 4 lie further apart than this.
const APART_RAD: f64 = 0.25;
/// What is left of the mean at the darkest place: stands above the rounding of coefficients in f32.
const MARGIN: f64 = 2e-6;

/// What de-ringing did to one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dering {
    /// Least irradiance before, over the mean irradiance (pi L_0 / sqrt(4 pi) .. the fourth of the flux).
    pub least_over_mean: f64,
    /// What was kept of bands 1, 2 and 4: 1 where nothing rings.
    pub kept: f64,
    /// |L - L'| / |L| over all bands.
    pub error: f64,
}

impl Dering {
    const UNTOUCHED: Self = Self { least_over_mean: 0.0, kept: 1.0, error: 0.0 };
}

/// A_l: what the clamped cosine makes of band l, pi, 2 pi/3, pi/4, 0, -pi/24.
fn cosine_bands() -> [f64; IRRADIANCE_ORDER] {
    let mut lobe = [0.0; IRRADIANCE_ORDER];
    zonal::lambert(IRRADIANCE_ORDER, &mut lobe);
    std::array::from_fn(|l| PI * lobe[l] * (4.0 * PI / (2 * l + 1) as f64).sqrt())
}

/// Irradiance as a function of the normal.
struct Irradiance([f64; IRRADIANCE_COEFFICIENTS]);

impl Irradiance {
    fn of(order: usize, radiance: &[f64]) -> Self {
        let bands = cosine_bands();
        let count = order.clamp(1, MAX_ORDER).pow(2).min(radiance.len());
        Self(std::array::from_fn(|i| if i < count { bands[i.isqrt()] * radiance[i] } else { 0.0 }))
    }

    fn at(&self, normal: [f64; 3]) -> f64 {
        let mut y = [0.0; IRRADIANCE_COEFFICIENTS];
        basis::evaluate(IRRADIANCE_ORDER, normal, &mut y);
        self.dot(&y)
    }

    fn dot(&self, y: &[f64; IRRADIANCE_COEFFICIENTS]) -> f64 {
        self.0.iter().zip(y).map(|(k, y)| k * y).sum()
    }

    /// The mean over all normals.
    fn mean(&self) -> f64 {
        self.0[0] / (4.0 * PI).sqrt()
    }

    /// Bounds how far it is from its mean.
    fn size(&self) -> f64 {
        self.0[1..].iter().map(|k| k.abs()).sum()
    }
}

type GridPoint = ([f64; 3], [f64; IRRADIANCE_COEFFICIENTS]);

fn grid() -> &'static [GridPoint] {
    static POINTS: OnceLock<Vec<GridPoint>> = OnceLock::new();
    POINTS.get_or_init(|| {
        (0..GRID)
            .map(|k| {
                let z = 1.0 - (2 * k + 1) as f64 / GRID as f64;
                let (sine, cosine) = (PI * (1.0 + 5f64.sqrt()) * k as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let direction = [r * cosine, r * sine, z];
                let mut y = [0.0; IRRADIANCE_COEFFICIENTS];
                basis::evaluate(IRRADIANCE_ORDER, direction, &mut y);
                (direction, y)
            })
            .collect()
    })
}

/// The least irradiance over all normals of light with these radiance coefficients (`order`^2 of them, finite).
///
/// A grid of 512 normals, then Newton's iteration on the sphere from every place where the minimum may be: along a
/// great circle the irradiance is a trigonometric polynomial of degree 4, whose second derivative is at most 16 times
/// its half range (Bernstein), so that the grid point next to the minimum is not far above it. Within 1e-9 of the range.
pub fn least_irradiance(order: usize, radiance: &[f64]) -> f64 {
    least(&Irradiance::of(order, radiance))
}

fn least(irradiance: &Irradiance) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut values = [0.0; GRID];
    for (value, (_, y)) in values.iter_mut().zip(grid()) {
        *value = irradiance.dot(y);
        (low, high) = (low.min(*value), high.max(*value));
    }
    if !(high > low) {
        return irradiance.mean().min(low);
    }
    // g(p) <= m + (range / 2) d^2 h^2 / 2 for the grid point p next to the minimum; the range itself is only known
    // from the grid, and is at most a seventh more.
    let curvature = (IRRADIANCE_ORDER - 1).pow(2) as f64;
    let slack = 1.2 * 0.25 * curvature * GRID_REACH_RAD.powi(2) * (high - low);
    let mut least = low;
    let border = low + slack;
    loop {
        let next = values.iter().enumerate().filter(|(_, v)| **v <= border).min_by(|a, b| a.1.total_cmp(b.1));
        let Some((start, _)) = next else { return least };
        let start = grid()[start].0;
        least = least.min(descend(irradiance, start));
        for (value, (direction, _)) in values.iter_mut().zip(grid()) {
            if dot(*direction, start) > APART_RAD.cos() {
                *value = f64::INFINITY;
            }
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Newton's iteration with steps that never go up; along a ring of minima the missing curvature is made up.
fn descend(irradiance: &Irradiance, start: [f64; 3]) -> f64 {
    const STEP: f64 = 1e-3;
    const LONGEST: f64 = 0.2;
    let floor = 1e-3 * irradiance.size();
    let mut at = glam::DVec3::from(start);
    let mut value = irradiance.at(start);
    for _ in 0..24 {
        let (u, v) = at.any_orthonormal_pair();
        let near = |a: f64, b: f64| (at + a * u + b * v).normalize();
        let g = |a: f64, b: f64| irradiance.at(near(a, b).to_array());
        let (east, west, north, south) = (g(STEP, 0.0), g(-STEP, 0.0), g(0.0, STEP), g(0.0, -STEP));
        let slope = [(east - west) / (2.0 * STEP), (north - south) / (2.0 * STEP)];
        let square = STEP * STEP;
        let (uu, vv) = ((east - 2.0 * value + west) / square, (north - 2.0 * value + south) / square);
        let uv = (g(STEP, STEP) - g(STEP, -STEP) - g(-STEP, STEP) + g(-STEP, -STEP)) / (4.0 * square);
        let smallest = 0.5 * (uu + vv) - (0.25 * (uu - vv).powi(2) + uv * uv).sqrt();
        let lift = (floor - smallest).max(0.0);
        let (uu, vv) = (uu + lift, vv + lift);
        let determinant = uu * vv - uv * uv;
        let step =
            [-(vv * slope[0] - uv * slope[1]) / determinant, -(uu * slope[1] - uv * slope[0]) / determinant];
        let length = step[0].hypot(step[1]);
        if !(length > 1e-9) {
            break;
        }
        let mut share = (LONGEST / length).min(1.0);
        let mut lower = None;
        for _ in 0..12 {
            let there = near(share * step[0], share * step[1]);
            let reached = irradiance.at(there.to_array());
            if reached < value {
                lower = Some((there, reached));
                break;
            }
            share *= 0.5;
        }
        let Some((there, reached)) = lower else { break };
        (at, value) = (there, reached);
    }
    value
}

/// Damps light of one channel (`order`^2 radiance coefficients) so that its irradiance is nowhere negative, and no
/// more than that. Light that does not ring is left as it is to the last bit; so is light whose mean is not above 0
/// or whose coefficients are not finite, which no damping can mend.
pub fn dering(order: usize, radiance: &mut [f64]) -> Dering {
    let count = order.clamp(1, MAX_ORDER).pow(2).min(radiance.len()).min(MAX_COEFFICIENTS);
    let radiance = &mut radiance[..count];
    let irradiance = Irradiance::of(order, radiance);
    let mean = irradiance.mean();
    if !(mean > 0.0) || radiance.iter().any(|c| !c.is_finite()) {
        return Dering::UNTOUCHED;
    }
    let least_over_mean = least(&irradiance) / mean;
    if least_over_mean >= 0.0 {
        return Dering { least_over_mean, ..Dering::UNTOUCHED };
    }
    let kept = (1.0 - MARGIN) / (1.0 - least_over_mean);
    let (mut taken, mut all) = (0.0, 0.0);
    for (i, c) in radiance.iter_mut().enumerate() {
        all += *c * *c;
        if matches!(i.isqrt(), 1 | 2 | 4) {
            taken += (*c * (1.0 - kept)).powi(2);
            *c *= kept;
        }
    }
    Dering { least_over_mean, kept, error: (taken / all).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Many directions: no place on the sphere is further than 0.009 from one of them.
    fn dense(irradiance: &Irradiance, count: usize) -> f64 {
        (0..count)
            .map(|k| {
                let z = 1.0 - (2 * k + 1) as f64 / count as f64;
                let (sine, cosine) = (PI * (1.0 + 5f64.sqrt()) * k as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                irradiance.at([r * cosine, r * sine, z])
            })
            .fold(f64::INFINITY, f64::min)
    }

    fn sun(order: usize, ambient: f64) -> Vec<f64> {
        let mut light = vec![0.0; order * order];
        basis::evaluate(order, [0.48, -0.6, 0.64], &mut light);
        light[0] += ambient;
        light
    }

    #[test]
    fn the_grid_reaches_everywhere() {
        let furthest = (0..20_000)
            .map(|k| {
                let z = 1.0 - (2 * k + 1) as f64 / 20_000.0;
                let (sine, cosine) = (1.7 + PI * (1.0 + 5f64.sqrt()) * f64::from(k)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let d = [r * cosine, r * sine, z];
                grid().iter().map(|(g, _)| dot(*g, d)).fold(-1.0, f64::max).clamp(-1.0, 1.0).acos()
            })
            .fold(0.0, f64::max);
        assert!(furthest < GRID_REACH_RAD, "{furthest}");
    }

    #[test]
    fn a_sun_rings_before_and_not_after() {
        for order in 3..=6 {
            let mut light = sun(order, 0.0);
            let before = Irradiance::of(order, &light);
            let mean = before.mean();
            assert!(dense(&before, 100_000) < -0.1 * mean, "order {order}");
            // Truncated Lambert: at least -0.0396 (order 3, 4) and -0.0313 (5, 6) of a mean of 1/4.
            let exact = if order < 5 { -0.039_583_333 } else { -0.031_25 };
            assert!(
                (least(&before) / (4.0 * mean) - exact).abs() < 1e-6,
                "{}",
                least(&before) / (4.0 * mean)
            );
            let done = dering(order, &mut light);
            let after = Irradiance::of(order, &light);
            assert!(dense(&after, 100_000) >= 0.0, "order {order}");
            assert_eq!(after.mean(), mean);
            // 0.1289, 0.0967, 0.0916, 0.0764 (order 3 to 6).
            assert!(done.error < 0.13 && done.kept > 0.86, "order {order}: {done:?}");
            // A little less damping leaves it negative.
            let mut weaker = sun(order, 0.0);
            for (i, c) in weaker.iter_mut().enumerate() {
                if matches!(i.isqrt(), 1 | 2 | 4) {
                    *c *= done.kept * 1.0001;
                }
            }
            assert!(dense(&Irradiance::of(order, &weaker), 100_000) < 0.0, "order {order}");
            // Once is enough.
            let once = light.clone();
            assert_eq!(dering(order, &mut light).kept, 1.0);
            assert_eq!(light, once);
        }
    }

    #[test]
    fn it_does_less_harm_than_a_hanning_window() {
        for order in 3..=6 {
            let error_of = |width: f64| {
                let window = |l: usize| 0.5 * (1.0 + (PI * (l as f64 / width).min(1.0)).cos());
                let (mut light, whole) = (sun(order, 0.0), sun(order, 0.0));
                light.iter_mut().enumerate().for_each(|(i, c)| *c *= window(i.isqrt()));
                let square: f64 = light.iter().zip(&whole).map(|(a, b)| (a - b).powi(2)).sum();
                let rings = least(&Irradiance::of(order, &light)) < 0.0;
                (rings, (square / whole.iter().map(|c| c * c).sum::<f64>()).sqrt())
            };
            let (mut rings, mut calm) = (20.0, 1.0);
            for _ in 0..30 {
                let middle = 0.5 * (rings + calm);
                if error_of(middle).0 { rings = middle } else { calm = middle }
            }
            let ours = dering(order, &mut sun(order, 0.0)).error;
            assert!(ours < 0.2 * error_of(calm).1, "order {order}: {ours} {}", error_of(calm).1);
        }
    }

    #[test]
    fn what_does_not_ring_stays() {
        let mut light = sun(4, 2.0);
        let before = light.clone();
        let done = dering(4, &mut light);
        assert!(done.least_over_mean > 0.0 && done.kept == 1.0 && done.error == 0.0 && light == before);
        for hopeless in [vec![-1.0, 0.5, 0.2, 0.1], vec![0.0; 4], vec![1.0, f64::NAN, 0.0, 0.0]] {
            let mut light = hopeless.clone();
            assert_eq!(dering(2, &mut light), Dering::UNTOUCHED);
            assert!(light.iter().zip(&hopeless).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn the_minimum_is_found_and_mended(
            order in 2usize..=6,
            rows in proptest::collection::vec(-1.0f64..1.0, 36),
            mean in 0.1f64..3.0,
        ) {
            let mut light = rows[..order * order].to_vec();
            light[0] = mean;
            let before = Irradiance::of(order, &light);
            let found = least(&before);
            let seen = dense(&before, 20_000);
            // Bernstein again, with places at most 0.02 from one that was looked at.
            let lowest = seen - 0.5 * 16.0 * before.size() * 0.02f64.powi(2);
            prop_assert!(found <= seen + 1e-12 && found >= lowest, "{} {}", found, seen);
            let done = dering(order, &mut light);
            let after = Irradiance::of(order, &light);
            prop_assert!(dense(&after, 20_000) >= 0.0);
            prop_assert_eq!(after.mean(), before.mean());
            prop_assert!((done.kept == 1.0) == (found >= 0.0));
            if found < 0.0 {
                prop_assert!(least(&after) < 1e-5 * after.mean(), "damped more than needed");
            }
            let once = light.clone();
            dering(order, &mut light);
            prop_assert_eq!(light, once);
        }
    }
}
