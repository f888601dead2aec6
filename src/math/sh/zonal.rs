//! Zonal harmonics: functions of the angle to one axis. z_l is the coefficient of y_l0 when the axis is +z.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis};

/// Turns a zonal function to an axis: g_lm = sqrt(4 pi/(2l+1)) z_l y_lm(axis) (Eq. 3 of [Now11]).
///
/// `zonal` has one number for each band (the order is its length, at most 6), `axis` is a unit vector and
/// `out` has room for order^2 numbers.
pub fn rotate<T: Real>(zonal: &[T], axis: [T; 3], out: &mut [T]) {
    let order = zonal.len().min(MAX_ORDER);
    if order == 0 {
        return;
    }
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    basis::evaluate(order, axis, &mut y);
    for (l, z) in zonal.iter().enumerate().take(order) {
        let scale = *z / band_norm::<T>(l);
        for i in l * l..(l + 1) * (l + 1) {
            out[i] = scale * y[i];
        }
    }
}

/// sqrt((2l+1)/(4 pi)): y_l0 at +z.
fn band_norm<T: Real>(band: usize) -> T {
    (T::of((2 * band + 1) as f64) / (T::of(4.0) * T::PI())).sqrt()
}

/// I_l = integral of x^s P_l(x) over [0, 1] for l = 0, 1, .. : I_0 = 1/(s+1), I_1 = 1/(s+2),
/// I_l = I_{l-2} (s-l+2)/(s+l+1).
fn power_moments<T: Real>(exponent: T) -> impl Iterator<Item = T> {
    let one = T::one();
    let mut last = [T::zero(); 2];
    (0..).map(move |l: usize| {
        let band = T::of(l as f64);
        let moment = match l {
            0 => one / (exponent + one),
            1 => one / (exponent + T::of(2.0)),
            _ => last[l % 2] * (exponent - band + T::of(2.0)) / (exponent + band + one),
        };
        last[l % 2] = moment;
        moment
    })
}

/// Bands 0..order-1 of the Lambert lobe f+ = max(0, cos)/pi at albedo 1: .28209 .32574 .15770 0 -.03526 0 ..
/// (Table 1 of [Now11]). Any order; `out` has room for `order` numbers.
pub fn lambert<T: Real>(order: usize, out: &mut [T]) {
    for (l, (moment, z)) in power_moments(T::one()).zip(out.iter_mut()).enumerate().take(order) {
        // Odd bands above the first vanish exactly; I_l at s = 1 says so too (the factor s - 1).
        *z = band_norm::<T>(l) * T::of(2.0) * moment;
    }
}

/// How a Phong lobe is scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhongNorm {
    /// (s+2)/(2 pi), as Table 1 of [Now11]: a white furnace gives (s+2)/(s+1).
    Paper,
    /// (s+1)/(2 pi): the lobe's integral is 1 and no light is made.
    EnergySafe,
}

impl PhongNorm {
    /// Both, as they are called in settings.
    pub const NAMES: [&str; 2] = ["energy-safe", "paper"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::EnergySafe => "energy-safe",
            Self::Paper => "paper",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::EnergySafe, Self::Paper].into_iter().find(|n| n.name() == name)
    }
}

/// The factor before cos^s: (s+2)/(2 pi) or (s+1)/(2 pi).
pub fn phong_scale<T: Real>(exponent: T, norm: PhongNorm) -> T {
    let plus = match norm {
        PhongNorm::Paper => T::of(2.0),
        PhongNorm::EnergySafe => T::one(),
    };
    (exponent + plus) / (T::of(2.0) * T::PI())
}

/// cos^s where cos > 0, else 0: the test comes before the power, so that s = 0 does not light the back.
pub fn phong_lobe<T: Real>(cosine: T, exponent: T) -> T {
    if cosine > T::zero() { cosine.powf(exponent) } else { T::zero() }
}

/// Bands 0..order-1 of the Phong lobe f+ = scale max(0, cos)^s, s >= 0: z_l = sqrt((2l+1)/(4 pi)) (s+2) I_l with the
/// paper's norm (Table 1 of [Now11]), (s+1) with the energy-safe one. Any order.
pub fn phong<T: Real>(order: usize, exponent: T, norm: PhongNorm, out: &mut [T]) {
    let scale = T::of(2.0) * T::PI() * phong_scale(exponent, norm);
    for (l, (moment, z)) in power_moments(exponent).zip(out.iter_mut()).enumerate().take(order) {
        *z = band_norm::<T>(l) * scale * moment;
    }
}

/// Relative L2 error of the Phong lobe cut to bands 0..order-1: sqrt(1 - sum z_l^2 / integral of f+^2), the same for both
/// norms. At order 4: .24 at s = 5, .48 at 10, .68 at 20, .85 at 50. Negative exponents count as 0.
pub fn phong_truncation(order: usize, exponent: f64) -> f64 {
    let exponent = exponent.max(0.0);
    let mut bands = [0.0f64; 16];
    let order = order.min(bands.len());
    phong(order, exponent, PhongNorm::EnergySafe, &mut bands);
    let kept: f64 = bands[..order].iter().map(|z| z * z).sum();
    let scale: f64 = phong_scale(exponent, PhongNorm::EnergySafe);
    let whole = 2.0 * std::f64::consts::PI * scale * scale / (2.0 * exponent + 1.0);
    (1.0 - kept / whole).max(0.0).sqrt()
}

/// The relative error of a truncated lobe from which on it is better read from a prefiltered picture: that of exponent
/// 10 at order 4 (section 5 of the project's formulas), which order 6 reaches at 23.
const SATURATED: f64 = 0.48;

/// Whether SH of an order is too smooth for a Phong lobe.
pub fn phong_saturates(order: usize, exponent: f32) -> bool {
    phong_truncation(order, f64::from(exponent)) > SATURATED
}

/// The largest exponent that SH of an order is not too smooth for, to a thousandth.
pub fn phong_saturation(order: usize) -> f32 {
    let (mut low, mut high) = (0.0f32, 256.0f32);
    while high - low > 1e-3 {
        let middle = 0.5 * (low + high);
        if phong_saturates(order, middle) { high = middle } else { low = middle }
    }
    low
}

/// Bands 0..order-1 of a mirror, a delta: z_l = sqrt((2l+1)/(4 pi)) (Table 1 of [Now11]). Any order.
pub fn mirror<T: Real>(order: usize, out: &mut [T]) {
    for (l, z) in out.iter_mut().enumerate().take(order) {
        *z = band_norm(l);
    }
}

/// alpha = pi / sum_l A_l (2l+1)/(4 pi), A_l the clamped cosine's bands: scales [Now11]'s c (Eq. 11) to
/// E_d = alpha c. 4 pi/3 at order 2, 16 pi/17 at 3 and 4, 32 pi/31 at 5 and 6. Any order >= 1.
pub fn alpha<T: Real>(order: usize) -> T {
    // A_l = 2 pi I_l(1), so A_l (2l+1)/(4 pi) = (2l+1) I_l(1) / 2.
    let mut sum = T::zero();
    for (l, moment) in power_moments(T::one()).enumerate().take(order.max(1)) {
        sum += T::of((2 * l + 1) as f64) * moment * T::of(0.5);
    }
    T::PI() / sum
}

/// 1 - sqrt(1 - R) as R/(1 + sqrt(1-R)), which keeps its digits for small R. R is taken into [0, 1].
pub fn one_minus_cosine<T: Real>(sine_squared: T) -> T {
    let sine_squared = sine_squared.max(T::zero()).min(T::one());
    sine_squared / (T::one() + (T::one() - sine_squared).sqrt())
}

/// Bands 0..order-1 of a cap's indicator (what a sphere blocks), R = sin^2 of its half angle = (r/d)^2, at most a
/// hemisphere (R is taken into [0, 1]): B_0 = sqrt(pi) R/(1+c), B_l = sqrt(pi(2l+1)) R P_l'(c)/(l(l+1)), c = sqrt(1-R)
/// (1 minus Eq. 23 of [Now11], exact). Any order.
pub fn cap<T: Real>(order: usize, sine_squared: T, out: &mut [T]) {
    let (zero, one) = (T::zero(), T::one());
    let sine_squared = sine_squared.max(zero).min(one);
    let c = (one - sine_squared).sqrt();
    // P_l'(c) by (l-1) P_l' = (2l-1) c P_{l-1}' - l P_{l-2}'.
    let (mut below, mut slope) = (zero, one);
    for (l, b) in out.iter_mut().enumerate().take(order) {
        let band = T::of(l as f64);
        if l == 0 {
            *b = T::PI().sqrt() * one_minus_cosine(sine_squared);
            continue;
        }
        if l > 1 {
            let next = (T::of((2 * l - 1) as f64) * c * slope - band * below) / (band - one);
            (below, slope) = (slope, next);
        }
        let norm = (T::PI() * T::of((2 * l + 1) as f64)).sqrt();
        *b = norm * sine_squared * slope / (band * (band + one));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncated_phong_errs_as_tabulated() {
        // Section 5 of the project's formulas, two digits.
        let table = [(4, 5.0, 0.24), (4, 10.0, 0.48), (4, 20.0, 0.68), (4, 50.0, 0.85), (4, 100.0, 0.92)];
        for (order, s, error) in
            table.into_iter().chain([(4, 1000.0, 0.99), (6, 10.0, 0.18), (6, 20.0, 0.42), (6, 50.0, 0.70)])
        {
            let got = phong_truncation(order, s);
            assert!((got - error).abs() < 0.0051, "order {order}, s = {s}: {got}");
        }
        assert!(!phong_saturates(4, 9.9) && phong_saturates(4, 10.5));
        assert!(!phong_saturates(6, 20.0) && phong_saturates(6, 25.0));
        assert!((phong_saturation(4) - 10.0).abs() < 0.2, "{}", phong_saturation(4));
        assert!(!phong_saturates(4, 0.0) && !phong_saturates(4, -3.0));
    }
    use crate::quadrature::gauss_legendre;
    use std::f64::consts::PI;

    /// 2 pi integral of f(x) y_l0(x) over [low, 1]: the definition.
    fn by_definition(l: usize, low: f64, f: impl Fn(f64) -> f64) -> f64 {
        let mut y = [0.0; 36];
        let half = 0.5 * (1.0 - low);
        gauss_legendre(40)
            .iter()
            .map(|(t, w)| {
                let x = low + half * (t + 1.0);
                basis::evaluate(6, [(1.0 - x * x).max(0.0).sqrt(), 0.0, x], &mut y);
                2.0 * PI * half * w * f(x) * y[l * (l + 1)]
            })
            .sum()
    }

    #[test]
    fn lobes_match_their_integrals() {
        let mut z = [0.0; 6];
        lambert(6, &mut z);
        for (l, z) in z.iter().enumerate() {
            assert!((z - by_definition(l, 0.0, |x| x / PI)).abs() < 1e-14, "Lambert band {l}");
        }
        for s in [0.0, 1.0, 2.0, 7.0, 20.0] {
            phong(6, s, PhongNorm::EnergySafe, &mut z);
            for (l, z) in z.iter().enumerate() {
                let want = by_definition(l, 0.0, |x| (s + 1.0) / (2.0 * PI) * x.powf(s));
                assert!((z - want).abs() < 1e-13, "Phong {s} band {l}: {z} instead of {want}");
            }
        }
    }

    #[test]
    fn caps_match_their_integrals() {
        let mut b = [0.0; 6];
        for sine_squared in [0.01_f64, 0.3, 0.9, 1.0] {
            cap(6, sine_squared, &mut b);
            for (l, b) in b.iter().enumerate() {
                let want = by_definition(l, (1.0 - sine_squared).sqrt(), |_| 1.0);
                assert!((b - want).abs() < 1e-14, "R {sine_squared} band {l}: {b} instead of {want}");
            }
        }
        cap(6, 4.0, &mut b);
        assert!((b[0] - PI.sqrt()).abs() < 1e-15 && b.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn a_rotated_mirror_is_the_delta_at_its_axis() {
        let axis = [0.48, -0.6, 0.64];
        let (mut z, mut delta, mut y) = ([0.0_f64; 6], [0.0; 36], [0.0; 36]);
        mirror(6, &mut z);
        rotate(&z, axis, &mut delta);
        basis::evaluate(6, axis, &mut y);
        for (got, want) in delta.iter().zip(y) {
            assert!((got - want).abs() < 1e-15);
        }
    }

    #[test]
    fn the_back_of_a_phong_lobe_is_dark() {
        assert_eq!(phong_lobe(0.0, 0.0), 0.0);
        assert_eq!(phong_lobe(-0.5_f32, 2.0), 0.0);
        assert_eq!(phong_lobe(0.5, 0.0), 1.0);
        assert_eq!(phong_lobe(f64::NAN, 2.0), 0.0);
    }
}
