//! The random numbers of a path: Sobol points in pairs, scrambled by Owen's method.
//!
//! A number depends on the pixel, on the pass, on the sample in its pass and on the place in the path where it is used, and
//! on nothing else: not on threads, not on what was traced before. So any thread may take any pixel, and a trace that was
//! cut goes on as if it had not been. The first 2^k samples of a pass are a (0, k, 2)-net in every pair, which samples
//! smooth light with far less noise than independent numbers; each pass is scrambled anew, so that passes are independent
//! and their spread tells the noise without bias. Pairs are told apart by shuffling the order of points.
//!
//! Scrambling by hashing: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020; Laine and Karras,
//! "Stratified Sampling for Stochastic Transparency", EGSR 2011.

use crate::math::dice::mix_u32 as mix;

/// 2^-24: the 24 upper bits of a number become a float below 1.
const STEP: f32 = 1.0 / 16_777_216.0;

/// Owen's scrambling of a binary fraction: whether a bit flips depends on the bits above it alone.
#[inline]
fn scrambled(fraction: u32, seed: u32) -> u32 {
    let mut bits = fraction.reverse_bits();
    bits ^= bits.wrapping_mul(0x3d20_adea);
    bits = bits.wrapping_add(seed);
    bits = bits.wrapping_mul((seed >> 16) | 1);
    bits ^= bits.wrapping_mul(0x0552_6c56);
    bits ^= bits.wrapping_mul(0x53a2_2864);
    bits.reverse_bits()
}

/// The second Sobol coordinate of point `index`: Pascal's triangle modulo 2, which is the fifth Kronecker power of
/// [1 1; 0 1], times the index; then mirrored like the first.
#[inline]
fn second_coordinate(index: u32) -> u32 {
    let mut bits = index;
    bits ^= (bits & 0xaaaa_aaaa) >> 1;
    bits ^= (bits & 0xcccc_cccc) >> 2;
    bits ^= (bits & 0xf0f0_f0f0) >> 4;
    bits ^= (bits & 0xff00_ff00) >> 8;
    bits ^= (bits & 0xffff_0000) >> 16;
    bits.reverse_bits()
}

/// The numbers of one sample of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence {
    seed: u32,
    index: u32,
}

impl Sequence {
    /// Of sample `index` in pass `pass` of a pixel.
    #[inline]
    pub fn new(seed: u32, pixel: u32, pass: u32, index: u32) -> Self {
        let seed = mix(seed ^ mix(pixel ^ mix(pass.wrapping_add(0x9e37_79b9))));
        Self { seed, index }
    }

    /// Two numbers in [0, 1) for a place in the path.
    #[inline]
    pub fn pair(&self, place: u32) -> [f32; 2] {
        let seed = mix(self.seed ^ place.wrapping_mul(0x9e37_79b9));
        // Shuffled without leaving the net: the first 2^k indices stay an aligned block.
        let index = scrambled(self.index, seed);
        let x = scrambled(index.reverse_bits(), mix(seed ^ 0x68bc_21eb));
        let y = scrambled(second_coordinate(index), mix(seed ^ 0x02e5_be93));
        [(x >> 8) as f32 * STEP, (y >> 8) as f32 * STEP]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_coordinate_is_sobols() {
        // Direction numbers of the second dimension: v_1 = 1/2, v_k = v_(k-1) xor (v_(k-1) >> 1).
        for index in (0..5000u32).chain([u32::MAX, 0xdead_beef]) {
            let (mut direction, mut sum) = (1u32 << 31, 0);
            for bit in 0..32 {
                if index >> bit & 1 == 1 {
                    sum ^= direction;
                }
                direction ^= direction >> 1;
            }
            assert_eq!(second_coordinate(index), sum, "{index}");
        }
    }

    #[test]
    fn samples_of_a_pass_are_a_net_in_every_pair() {
        // 64 points: one in each elementary box of 1/64, of any of its seven shapes.
        for (pixel, pass, place) in [(0, 0, 0), (17, 3, 5), (49_151, 1, 2)] {
            let points: Vec<[f32; 2]> =
                (0..64).map(|i| Sequence::new(9, pixel, pass, i).pair(place)).collect();
            for columns in [1u32, 2, 4, 8, 16, 32, 64] {
                let rows = 64 / columns;
                let mut boxes = vec![0; 64];
                for [x, y] in &points {
                    let (i, j) = ((x * columns as f32) as usize, (y * rows as f32) as usize);
                    boxes[j * columns as usize + i] += 1;
                }
                assert!(boxes.iter().all(|&count| count == 1), "{columns} x {rows}: {boxes:?}");
            }
        }
    }

    #[test]
    fn pairs_and_passes_are_independent() {
        // Correlation over many pixels of numbers that must have none; 4 sigma of 20,000 pairs is 0.028.
        let correlation = |a: &dyn Fn(u32) -> f32, b: &dyn Fn(u32) -> f32| {
            let sum: f64 = (0..20_000).map(|i| f64::from(a(i) - 0.5) * f64::from(b(i) - 0.5)).sum();
            12.0 * sum / 20_000.0
        };
        let number =
            |pixel, pass, sample, place, axis: usize| Sequence::new(1, pixel, pass, sample).pair(place)[axis];
        for r in [
            correlation(&|i| number(i, 0, 0, 0, 0), &|i| number(i, 0, 0, 0, 1)),
            correlation(&|i| number(i, 0, 0, 0, 0), &|i| number(i, 0, 0, 1, 0)),
            correlation(&|i| number(i, 0, 5, 0, 0), &|i| number(i, 1, 5, 0, 0)),
            correlation(&|i| number(i, 0, 3, 2, 1), &|i| number(i + 1, 0, 3, 2, 1)),
        ] {
            assert!(r.abs() < 0.028, "{r}");
        }
    }
}
