//! The widest instructions that the processor has, found when the program runs.

use pulp::Simd;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Runs `work` compiled for them (AVX-512, AVX2 or what every processor of its kind has); only what is inlined into `work`
/// gains. *The result is the same bit for bit whatever the processor*: no operation is fused with another, and an order
/// of sums that the code states is kept.
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// f32 side by side in one register of the widest kind; plain operations, each on all of them.
#[derive(Clone, Copy, Debug)]
pub struct Wide<S: Simd> {
    simd: S,
    numbers: S::f32s,
}

impl<S: Simd> Wide<S> {
    /// The same number in every place.
    #[inline(always)]
    pub fn splat(simd: S, number: f32) -> Self {
        Self { simd, numbers: simd.splat_f32s(number) }
    }

    /// The first numbers of a list; 0 where it is too short.
    #[inline(always)]
    pub fn load(simd: S, numbers: &[f32]) -> Self {
        let numbers = match S::as_simd_f32s(numbers).0.first() {
            Some(all) => *all,
            None => simd.partial_load_f32s(numbers),
        };
        Self { simd, numbers }
    }

    /// Writes the first numbers into a list that may be too short for all.
    #[inline(always)]
    pub fn store(self, out: &mut [f32]) {
        if out.len() < S::F32_LANES {
            self.simd.partial_store_f32s(out, self.numbers);
        } else if let Some(all) = S::as_mut_simd_f32s(out).0.first_mut() {
            *all = self.numbers;
        }
    }
}

impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { numbers: self.simd.add_f32s(self.numbers, other.numbers), ..self }
    }
}

impl<S: Simd> AddAssign for Wide<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { numbers: self.simd.sub_f32s(self.numbers, other.numbers), ..self }
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { numbers: self.simd.mul_f32s(self.numbers, other.numbers), ..self }
    }
}

impl<S: Simd> Mul<f32> for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * Self::splat(self.simd, factor)
    }
}

#[cfg(test)]
mod tests {
    use super::{Simd, Wide, widest};

    #[test]
    fn nothing_is_fused_and_sums_keep_their_order() {
        let numbers: Vec<f32> = (0..1000).map(|i| (i as f32 * 0.7).sin() * 3.0f32.powi(i % 7)).collect();
        let sum = |numbers: &[f32]| numbers.iter().zip(&numbers[1..]).fold(0.0f32, |sum, (a, b)| sum + a * b);
        assert_eq!(widest(|| sum(&numbers)).to_bits(), sum(&numbers).to_bits());
        let fused = numbers.iter().zip(&numbers[1..]).fold(0.0f32, |sum, (a, b)| a.mul_add(*b, sum));
        assert_ne!(fused.to_bits(), sum(&numbers).to_bits(), "the numbers would show it");
    }

    struct Dot<'a>([&'a [f32]; 3], &'a mut [f32]);

    impl pulp::WithSimd for Dot<'_> {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> usize {
            let parts = self.0.map(|part| part.chunks(S::F32_LANES));
            let [a, b, c] = parts;
            for (((a, b), c), out) in a.zip(b).zip(c).zip(self.1.chunks_mut(S::F32_LANES)) {
                let [a, b, c] = [a, b, c].map(|part| Wide::load(simd, part));
                let mut sum = a * b - c * 0.5;
                sum += a;
                (sum + Wide::splat(simd, 2.0)).store(out);
            }
            S::F32_LANES
        }
    }

    #[test]
    fn wide_numbers_are_plain_numbers_side_by_side() {
        let list = |k: usize| -> Vec<f32> { (0..77).map(|i| (i as f32 * 0.37 + k as f32).sin()).collect() };
        let [a, b, c] = [list(0), list(1), list(2)];
        for count in [0, 1, 15, 16, 17, 77] {
            let mut out = vec![9.0; 77];
            let lanes = pulp::Arch::new().dispatch(Dot([&a[..count], &b, &c], &mut out[..count]));
            println!("{lanes} lanes");
            for i in 0..count {
                let plain = a[i] * b[i] - c[i] * 0.5 + a[i] + 2.0;
                assert_eq!(out[i].to_bits(), plain.to_bits(), "{i} of {count}");
            }
            assert!(out[count..].iter().all(|o| *o == 9.0));
        }
    }
}
