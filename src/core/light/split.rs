//! The light in two halves: one directional light, and the rest in SH (Section 5 of [Now11] as corrected in
//! section 4 of the project's formulas). The kernels are generic, so that tests can hold them to f64.

use crate::math::sh::{MAX_COEFFICIENTS, Real, basis::evaluate};
use crate::model::light::{DirectionalLight, RadianceSh, SplitLight};

/// How to split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitOptions {
    /// Weights of r, g, b in the gray that gives the direction.
    pub gray_weights: [f32; 3],
    /// Least anisotropy |d| / (sqrt(4 pi) L_0) with which there is a direction at all; 1 is a point light.
    pub least_anisotropy: f32,
    /// Whether E_d fades in between one and four times that anisotropy, so that the light does not pop.
    pub fade_in: bool,
    /// Whether every band bounds E_d, as is right where only SH is known of the light (section 4b of the project's
    /// formulas); without it the split is the paper's own, and a broad sky is a hard sun.
    pub bounded: bool,
}

/// Gray weights of [Now11] (rounded Rec. 601).
pub const GRAY_PAPER: [f32; 3] = [0.3, 0.59, 0.11];
/// Gray weights for linear light (Rec. 709).
pub const GRAY_REC709: [f32; 3] = [0.2126, 0.7152, 0.0722];

impl Default for SplitOptions {
    fn default() -> Self {
        Self { gray_weights: GRAY_PAPER, least_anisotropy: 1e-3, fade_in: true, bounded: false }
    }
}

/// Where most light comes from, by its first moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dominant<T> {
    /// Unit vector towards the light; `None` below the least anisotropy.
    pub direction: Option<[T; 3]>,
    /// |d| / (sqrt(4 pi) |L_0|) of the gray light: 0 for uniform light, 1 for a point light. 0 where there is no light.
    pub anisotropy: T,
}

/// Estimators of E_d. All are exact for one point light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// The first moment along the direction, d . w (Eq. 11 of [Now11] times alpha). The default.
    Band1,
    /// 4 pi L~(w) / n^2: all bands [Slo08]. A uniform light looks like a sun to it.
    AllBands,
    /// 4 pi (L~(w) - L_0 y_0) / (n^2 - 1): all bands but the constant, joint with an ambient term [Slo08].
    NonConstant,
}

/// Light with its directional part taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factored<T> {
    /// The direction, if there is one.
    pub dominant: Dominant<T>,
    /// E_d for each channel, not negative; zero where there is no direction.
    pub irradiance_rgb: [T; 3],
    /// L_g = L - E_d y(w); rows as in the input, the rest zero.
    pub residual_rgb: [[T; 3]; MAX_COEFFICIENTS],
}

/// First moment of radiance, d = integral of L(w) w = sqrt(4 pi / 3) (-L_3, -L_1, L_2) (Eq. 8 of [Now11], exact).
pub fn first_moment<T: Real>(l1: T, l2: T, l3: T) -> [T; 3] {
    let scale = (T::of(4.0) * T::PI() / T::of(3.0)).sqrt();
    [-(scale * l3), -(scale * l1), scale * l2]
}

/// The dominant direction of light given as rows of r, g, b (Eq. 9 and 10 of [Now11], normalised), order 2 or more:
/// `None` below `least_anisotropy`, in the dark, and where a coefficient is not finite.
pub fn dominant<T: Real>(rgb: &[[T; 3]], gray_weights: [T; 3], least_anisotropy: T) -> Dominant<T> {
    let none = Dominant { direction: None, anisotropy: T::zero() };
    let [l0, l1, l2, l3, ..] = rgb else { return none };
    let gray = |c: &[T; 3]| gray_weights[0] * c[0] + gray_weights[1] * c[1] + gray_weights[2] * c[2];
    let d = first_moment(gray(l1), gray(l2), gray(l3));
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    let flux = (T::of(4.0) * T::PI()).sqrt() * gray(l0).abs();
    // Also where a coefficient is NaN: then no comparison holds.
    let stands_out = length > least_anisotropy * flux && length.is_finite();
    if !stands_out {
        let anisotropy = length / flux;
        return Dominant { anisotropy: if anisotropy.is_finite() { anisotropy } else { T::zero() }, ..none };
    }
    Dominant { direction: Some(d.map(|c| c / length)), anisotropy: length / flux }
}

/// E_d of one estimator for each channel, NOT clamped at zero. `direction` is unit; `order` 2 to 6 (below 2 it is
/// zero).
pub fn irradiance<T: Real>(order: usize, rgb: &[[T; 3]], direction: [T; 3], estimator: Estimator) -> [T; 3] {
    if order < 2 || rgb.len() < order * order || order * order > MAX_COEFFICIENTS {
        return [T::zero(); 3];
    }
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    evaluate(order, direction, &mut y);
    let four_pi = T::of(4.0) * T::PI();
    let count = T::of((order * order) as f64);
    std::array::from_fn(|c| match estimator {
        Estimator::Band1 => {
            let d = first_moment(rgb[1][c], rgb[2][c], rgb[3][c]);
            d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2]
        }
        Estimator::AllBands => four_pi * sum(rgb, &y, 0..order * order, c) / count,
        Estimator::NonConstant => four_pi * sum(rgb, &y, 1..order * order, c) / (count - T::one()),
    })
}

fn sum<T: Real>(rgb: &[[T; 3]], y: &[T], rows: std::ops::Range<usize>, channel: usize) -> T {
    let mut total = T::zero();
    for i in rows {
        total += rgb[i][channel] * y[i];
    }
    total
}

/// alpha of [Now11]: E_d = alpha c. pi over the sum of A_l (2l+1)/(4 pi) over the bands below `order`, with A_l the
/// clamped cosine's: 4 pi, 4 pi/3, 16 pi/17 (order 3 and 4), 32 pi/31 (5 and 6). `order` is taken into 1..=6.
pub fn alpha<T: Real>(order: usize) -> T {
    // pi / alpha, summed exactly: 1/4, + 1/2, + 5/16, + 0, - 3/32, + 0.
    let over_pi = match order {
        0 | 1 => 4.0,
        2 => 4.0 / 3.0,
        3 | 4 => 16.0 / 17.0,
        _ => 32.0 / 31.0,
    };
    T::PI() * T::of(over_pi)
}

/// Splits light into E_d y(w_d) and the rest, in numbers of either width; no fade. Below order 2, and where the
/// rows do not suffice, nothing is directional.
///
/// E_d^ch = max(0, d^ch . w_d); L_g = L - E_d y(w_d): the sum of both halves is the input.
pub fn factor<T: Real>(
    order: usize,
    rgb: &[[T; 3]],
    gray_weights: [T; 3],
    least_anisotropy: T,
) -> Factored<T> {
    let mut factored = Factored {
        dominant: dominant(rgb, gray_weights, least_anisotropy),
        irradiance_rgb: [T::zero(); 3],
        residual_rgb: [[T::zero(); 3]; MAX_COEFFICIENTS],
    };
    for (slot, row) in factored.residual_rgb.iter_mut().zip(rgb) {
        *slot = *row;
    }
    if order < 2 {
        factored.dominant.direction = None;
    }
    if let Some(direction) = factored.dominant.direction {
        factored.irradiance_rgb =
            irradiance(order, rgb, direction, Estimator::Band1).map(|e| e.max(T::zero()));
        take_out(order, direction, factored.irradiance_rgb, &mut factored.residual_rgb);
    }
    factored
}

/// Takes E y(w) out of `rgb`.
fn take_out<T: Real>(order: usize, direction: [T; 3], irradiance_rgb: [T; 3], rgb: &mut [[T; 3]]) {
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    evaluate(order, direction, &mut y);
    for (row, y) in rgb.iter_mut().zip(y).take(order * order) {
        for (c, e) in row.iter_mut().zip(irradiance_rgb) {
            *c = *c - e * y;
        }
    }
}

/// Splits measured light (order 2 to 6; order 1 has no direction). With `fade_in`, E_d is multiplied by
/// smoothstep(tau, 4 tau, anisotropy), tau = `least_anisotropy`, and what is not taken stays in the global half, so
/// that both halves together are always the input.
pub fn split(total: &RadianceSh, options: &SplitOptions) -> SplitLight {
    let factored =
        factor(total.order, total.rows(), options.gray_weights, options.least_anisotropy.max(f32::EPSILON));
    let mut global = *total;
    let direct = factored.dominant.direction.map(|to_light_world| {
        let fade = if options.fade_in {
            smoothstep(options.least_anisotropy, 4.0 * options.least_anisotropy, factored.dominant.anisotropy)
        } else {
            1.0
        };
        let mut irradiance_rgb = factored.irradiance_rgb;
        if options.bounded {
            irradiance_rgb = bounded_by_bands(total.order, total.rows(), to_light_world, irradiance_rgb);
        }
        let irradiance_rgb = irradiance_rgb.map(|e| e * fade);
        take_out(total.order, to_light_world, irradiance_rgb, &mut global.rgb);
        DirectionalLight { to_light_world, irradiance_rgb, fade }
    });
    SplitLight { direct, global }
}

/// E_d where no band may hold less of it than a point light would put there:
/// E_d <= (4 pi / (2l+1)) sum over m of y_lm(w) L_lm for every l >= 1, and not below 0. A point light passes
/// unchanged, a broad sky gives about 0.
pub fn bounded_by_bands<T: Real>(
    order: usize,
    rgb: &[[T; 3]],
    direction: [T; 3],
    irradiance_rgb: [T; 3],
) -> [T; 3] {
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    evaluate(order, direction, &mut y);
    let four_pi = T::of(4.0) * T::PI();
    std::array::from_fn(|c| {
        let mut least = irradiance_rgb[c];
        for l in 1..order {
            let band = four_pi / T::of((2 * l + 1) as f64) * sum(rgb, &y, l * l..(l + 1) * (l + 1), c);
            least = least.min(band);
        }
        least.max(T::zero())
    })
}

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(order: usize, direction: [f32; 3], irradiance: f32, ambient: f32) -> RadianceSh {
        let mut light = RadianceSh::zero(order);
        let mut y = [0.0f32; 36];
        evaluate(order, direction, &mut y);
        for (row, y) in light.rgb.iter_mut().zip(y).take(order * order) {
            *row = [irradiance * y, 0.5 * irradiance * y, 0.25 * irradiance * y];
        }
        for c in &mut light.rgb[0] {
            *c += ambient * (4.0 * std::f32::consts::PI).sqrt();
        }
        light
    }

    #[test]
    fn a_sun_in_a_uniform_sky_is_taken_out_whole() {
        let direction = [0.36, -0.48, 0.8];
        for order in 2..=6 {
            let light = split(&lit(order, direction, 3.0, 0.2), &SplitOptions::default());
            let sun = light.direct.unwrap();
            assert_eq!(sun.fade, 1.0);
            for (got, want) in sun.to_light_world.iter().zip(direction) {
                assert!((got - want).abs() < 3e-7);
            }
            for (got, want) in sun.irradiance_rgb.iter().zip([3.0, 1.5, 0.75]) {
                assert!((got - want).abs() < 2e-6, "{got} {want}");
            }
            let sky = 0.2 * (4.0 * std::f32::consts::PI).sqrt();
            assert!((light.global.rgb[0][0] - sky).abs() < 1e-6);
            assert!(light.global.rgb[1..].iter().flatten().all(|c| c.abs() < 3e-6));
        }
    }

    #[test]
    fn every_band_bounds_the_light() {
        let options = SplitOptions { bounded: true, ..SplitOptions::default() };
        let up = [0.0, 0.0, 1.0];
        let sun = split(&lit(4, up, 3.0, 0.2), &options).direct.unwrap();
        assert!((sun.irradiance_rgb[0] - 3.0).abs() < 2e-6, "a point light passes: {:?}", sun.irradiance_rgb);
        // A cosine sky, L = 1 + z: band 1 alone would make a sun of it.
        let mut sky = lit(4, up, 0.0, 1.0);
        sky.rgb[2] = [1.0; 3];
        let paper = split(&sky, &SplitOptions::default());
        assert!(paper.direct.unwrap().irradiance_rgb[0] > 2.0);
        let bounded = split(&sky, &options);
        assert_eq!(bounded.direct.unwrap().irradiance_rgb, [0.0; 3]);
        assert_eq!(bounded.global.rgb, sky.rgb);
    }

    #[test]
    fn each_axis_gives_its_own_direction() {
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                let got = split(&lit(2, direction, 1.0, 0.1), &SplitOptions::default()).direct.unwrap();
                for (got, want) in got.to_light_world.iter().zip(direction) {
                    assert!((got - want).abs() < 1e-6, "{:?} {direction:?}", got);
                }
            }
        }
    }

    #[test]
    fn darkness_uniform_light_and_nan_have_no_direction() {
        let mut broken = RadianceSh::zero(4);
        broken.rgb[2][1] = f32::NAN;
        for light in [RadianceSh::zero(4), lit(4, [0.0, 0.0, 1.0], 0.0, 1.0), RadianceSh::zero(1), broken] {
            let halves = split(&light, &SplitOptions::default());
            assert!(halves.direct.is_none());
            assert!(halves.global.order == light.order);
        }
    }

    #[test]
    fn the_light_fades_in_and_nothing_is_lost() {
        let options = SplitOptions::default();
        let mut last = 0.0;
        for step in 0..70 {
            // Anisotropy from 0 to 7 tau / 1.5 (gray is 0.6 of red).
            let irradiance = 4.0 * std::f32::consts::PI * 1e-4 * step as f32;
            let light = lit(4, [0.0, 0.6, 0.8], irradiance, 1.0);
            let halves = split(&light, &options);
            let (fade, direct) = halves.direct.map_or((0.0, [0.0; 3]), |d| (d.fade, d.irradiance_rgb));
            assert!(fade >= last && fade - last < 0.06, "{last} then {fade}");
            last = fade;
            let mut sum = halves.global;
            if let Some(d) = halves.direct {
                take_out(4, d.to_light_world, direct.map(|e| -e), &mut sum.rgb);
            }
            for (a, b) in sum.rgb.iter().flatten().zip(light.rgb.iter().flatten()) {
                assert!((a - b).abs() < 1e-6);
            }
        }
        assert_eq!(last, 1.0);
    }

    #[test]
    fn estimators_agree_on_a_point_light_and_differ_on_a_uniform_one() {
        let uniform = lit(4, [0.0, 0.0, 1.0], 0.0, 1.0);
        let up = [0.0, 0.0, 1.0];
        assert_eq!(irradiance(4, uniform.rows(), up, Estimator::Band1)[0], 0.0);
        let all = irradiance(4, uniform.rows(), up, Estimator::AllBands)[0];
        assert!((all - 4.0 * std::f32::consts::PI / 16.0).abs() < 1e-6);
        assert!(irradiance(4, uniform.rows(), up, Estimator::NonConstant)[0].abs() < 1e-6);
        let point = lit(4, up, 2.0, 0.0);
        for estimator in [Estimator::Band1, Estimator::AllBands, Estimator::NonConstant] {
            assert!((irradiance(4, point.rows(), up, estimator)[0] - 2.0).abs() < 3e-6);
        }
    }
}
