//! Radiance samples to SH coefficients. Twin of `shaders/light/project_sh.wgsl`.

use crate::math::sh::{
    MAX_COEFFICIENTS, MAX_ORDER,
    basis::{DIAGONAL, RECURRENCE},
};
use crate::model::light::{RadianceSamples, RadianceSh};

/// Samples that are summed in one go; the tree stands on these leaves.
pub const LEAF_SAMPLES: usize = 256;
/// Samples whose basis functions are held at once.
const BLOCK_SAMPLES: usize = 64;
/// Sums that run side by side inside a leaf.
const LANES: usize = 4;
/// Groups of lanes in a block.
const GROUPS: usize = BLOCK_SAMPLES / LANES;
/// From this many leaves on, the two halves of a tree run on two threads.
const PARALLEL_LEAVES: usize = 64;

type LeafLanes = [f32; LANES];
type Sum = [[f32; 3]; MAX_COEFFICIENTS];

/// Projects radiance on SH: L_i = sum over samples of L * y_i(direction) * solid angle (Eq. 2 of [Now11], i below
/// order^2), each colour channel for itself.
///
/// `samples`: unit directions (world frame) with solid angles in steradians, and finite radiance. `order` is
/// taken into 1..=6. Lists of unequal length count up to the shorter one.
///
/// The order of summation is fixed (leaves of [`LEAF_SAMPLES`], four running sums in a leaf, a binary tree above):
/// the result does not depend on the number of threads and is good to about 1e-6 of the sum of magnitudes even for
/// millions of samples, where one running f32 sum loses percents.
pub fn project_sh(samples: &RadianceSamples, order: usize) -> RadianceSh {
    let order = order.clamp(1, MAX_ORDER);
    let count = samples.directions.len().min(samples.radiance.len());
    let (directions, radiance) = (&samples.directions[..count], &samples.radiance[..count]);
    let rgb = match order {
        1 => tree::<1>(directions, radiance),
        2 => tree::<2>(directions, radiance),
        3 => tree::<3>(directions, radiance),
        4 => tree::<4>(directions, radiance),
        5 => tree::<5>(directions, radiance),
        _ => tree::<6>(directions, radiance),
    };
    RadianceSh { order, rgb }
}

/// Splits at the largest power of two of leaves below the whole, and adds the two halves.
fn tree<const ORDER: usize>(directions: &[[f32; 4]], radiance: &[[f32; 4]]) -> Sum {
    let leaves = directions.len().div_ceil(LEAF_SAMPLES);
    if leaves <= 1 {
        return leaf::<ORDER>(directions, radiance);
    }
    let middle = (leaves.next_power_of_two() / 2) * LEAF_SAMPLES;
    let (directions_low, directions_high) = directions.split_at(middle);
    let (radiance_low, radiance_high) = radiance.split_at(middle);
    let low = || tree::<ORDER>(directions_low, radiance_low);
    let high = || tree::<ORDER>(directions_high, radiance_high);
    let (mut low, high) = if leaves >= PARALLEL_LEAVES { rayon::join(low, high) } else { (low(), high()) };
    for (a, b) in low.iter_mut().zip(&high).take(ORDER * ORDER) {
        for (a, b) in a.iter_mut().zip(b) {
            *a += b;
        }
    }
    low
}

/// Sums at most [`LEAF_SAMPLES`] samples: sample 4 g + j goes to running sum j, and the four are added in pairs.
fn leaf<const ORDER: usize>(directions: &[[f32; 4]], radiance: &[[f32; 4]]) -> Sum {
    let mut basis = [[[0.0; LANES]; GROUPS]; MAX_COEFFICIENTS];
    let mut weighted = [[[0.0; LANES]; GROUPS]; 3];
    let mut running = [[[0.0; LANES]; 3]; MAX_COEFFICIENTS];
    for (directions, radiance) in directions.chunks(BLOCK_SAMPLES).zip(radiance.chunks(BLOCK_SAMPLES)) {
        let groups = directions.len().div_ceil(LANES);
        for (group, (d, c)) in directions.chunks(LANES).zip(radiance.chunks(LANES)).enumerate() {
            // Lanes beyond the last sample get no weight and an arbitrary direction.
            let mut axes: [LeafLanes; 3] = [[0.0; LANES], [0.0; LANES], [1.0; LANES]];
            let mut light: [LeafLanes; 3] = [[0.0; LANES]; 3];
            for (lane, (d, c)) in d.iter().zip(c).enumerate() {
                for axis in 0..3 {
                    axes[axis][lane] = d[axis];
                    light[axis][lane] = c[axis] * d[3];
                }
            }
            evaluate_lanes::<ORDER>(axes, group, &mut basis);
            for (row, light) in weighted.iter_mut().zip(light) {
                row[group] = light;
            }
        }
        for (basis, running) in basis.iter().zip(&mut running).take(ORDER * ORDER) {
            let mut sum = *running;
            for group in 0..groups {
                let y = basis[group];
                for (sum, weighted) in sum.iter_mut().zip(&weighted) {
                    for lane in 0..LANES {
                        sum[lane] += y[lane] * weighted[group][lane];
                    }
                }
            }
            *running = sum;
        }
    }
    running.map(|row| row.map(|lanes| (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])))
}

/// [`crate::math::sh::basis::evaluate`] for four directions at once, with the same operations in the same order.
#[inline(always)]
fn evaluate_lanes<const ORDER: usize>(
    [x, y, z]: [LeafLanes; 3],
    group: usize,
    out: &mut [[LeafLanes; GROUPS]; MAX_COEFFICIENTS],
) {
    let (mut re, mut im) = ([1.0; LANES], [0.0; LANES]);
    for m in 0..ORDER {
        let (mut below, mut legendre) = ([0.0; LANES], [DIAGONAL[m] as f32; LANES]);
        for (l, row) in RECURRENCE.iter().enumerate().take(ORDER).skip(m) {
            if l > m {
                let (a, b) = (row[m].0 as f32, row[m].1 as f32);
                let next = each(|k| a * (z[k] * legendre[k] - b * below[k]));
                (below, legendre) = (legendre, next);
            }
            let centre = l * (l + 1);
            out[centre + m][group] = each(|k| legendre[k] * re[k]);
            if m > 0 {
                out[centre - m][group] = each(|k| legendre[k] * im[k]);
            }
        }
        (re, im) = (each(|k| x[k] * re[k] - y[k] * im[k]), each(|k| x[k] * im[k] + y[k] * re[k]));
    }
}

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> LeafLanes {
    std::array::from_fn(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh::basis::evaluate;

    /// Directions of equal area, in the order of the Fibonacci spiral.
    fn spiral(count: usize) -> impl Iterator<Item = [f32; 3]> {
        (0..count).map(move |j| crate::math::spiral::direction(j, count).as_vec3().to_array())
    }

    fn samples(count: usize, radiance: impl Fn([f32; 3]) -> [f32; 3]) -> RadianceSamples {
        let omega = (4.0 * std::f64::consts::PI / count as f64) as f32;
        let mut samples = RadianceSamples::default();
        for d in spiral(count) {
            let [r, g, b] = radiance(d);
            samples.directions.push([d[0], d[1], d[2], omega]);
            samples.radiance.push([r, g, b, 0.0]);
        }
        samples
    }

    #[test]
    fn lanes_agree_with_the_basis_bit_for_bit() {
        for (index, direction) in spiral(64).enumerate() {
            let mut one = RadianceSamples::default();
            one.directions.push([direction[0], direction[1], direction[2], 1.0]);
            one.radiance.push([1.0, 0.5, 0.25, 0.0]);
            for order in 1..=6 {
                let mut y = [0.0f32; 36];
                evaluate(order, direction, &mut y);
                let got = project_sh(&one, order);
                for (row, y) in got.rgb.iter().zip(&y) {
                    // Half of a number is exact, so equality is fair; + 0.0 makes the zeros one.
                    assert_eq!(
                        row.map(|v| v + 0.0),
                        [y + 0.0, y * 0.5 + 0.0, y * 0.25 + 0.0],
                        "{index} {order}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_band_limited_environment_comes_back() {
        let mut want = [0.0f32; 36];
        for (i, slot) in want.iter_mut().enumerate() {
            *slot = ((i * 37 % 11) as f32 - 5.0) / 7.0;
        }
        let got = project_sh(
            &samples(40_000, |d| {
                let mut y = [0.0f32; 36];
                evaluate(6, d, &mut y);
                let value: f32 = y.iter().zip(&want).map(|(a, b)| a * b).sum();
                [value, 2.0 * value, 0.0]
            }),
            6,
        );
        for (row, want) in got.rgb.iter().zip(&want) {
            // 6e-5 is the quadrature error of the spiral itself.
            assert!((row[0] - want).abs() < 1e-4 && (row[1] - 2.0 * want).abs() < 2e-4 && row[2] == 0.0);
        }
    }

    #[test]
    fn six_million_samples_and_a_sun_keep_their_digits() {
        // Section 10 of the spec: one running sum loses 2.9 % here; the tree must keep 2e-6.
        let count = 6_000_000;
        let mut all = RadianceSamples {
            directions: vec![[0.0, 0.0, 1.0, 2e-6]; count],
            radiance: vec![[1.0, 1.0, 1.0, 0.0]; count],
        };
        all.radiance[17] = [1e6, 1e6, 1e6, 0.0];
        let omega = f64::from(2e-6f32);
        let want = 0.28209479177387814 * omega * ((count - 1) as f64 + 1e6);
        let got = f64::from(project_sh(&all, 2).rgb[0][0]);
        assert!((got / want - 1.0).abs() < 2e-6, "{got} instead of {want}");
    }

    #[test]
    fn threads_change_nothing() {
        let all = samples(70_001, |d| [d[0] + 2.0, d[1] * d[2] + 1.0, 3.0]);
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(alone.install(|| project_sh(&all, 5)), three.install(|| project_sh(&all, 5)));
    }

    #[test]
    fn nothing_is_nothing() {
        assert_eq!(project_sh(&RadianceSamples::default(), 4), RadianceSh::zero(4));
        let mut lopsided = RadianceSamples::default();
        lopsided.directions.push([0.0, 0.0, 1.0, 1.0]);
        assert_eq!(project_sh(&lopsided, 9), RadianceSh::zero(6));
    }
}
