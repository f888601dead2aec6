//! The widest instructions that the processor has, found when the program runs.

/// Runs `work` compiled for them (AVX-512, AVX2 or what every processor of its kind has); only what is inlined into `work`
/// gains. *The result is the same bit for bit whatever the processor*: no operation is fused with another, and an order
/// of sums that the code states is kept.
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

#[cfg(test)]
mod tests {
    use super::widest;

    #[test]
    fn nothing_is_fused_and_sums_keep_their_order() {
        let numbers: Vec<f32> = (0..1000).map(|i| (i as f32 * 0.7).sin() * 3.0f32.powi(i % 7)).collect();
        let sum = |numbers: &[f32]| numbers.iter().zip(&numbers[1..]).fold(0.0f32, |sum, (a, b)| sum + a * b);
        assert_eq!(widest(|| sum(&numbers)).to_bits(), sum(&numbers).to_bits());
        let fused = numbers.iter().zip(&numbers[1..]).fold(0.0f32, |sum, (a, b)| a.mul_add(*b, sum));
        assert_ne!(fused.to_bits(), sum(&numbers).to_bits(), "the numbers would show it");
    }
}
