//! The normal distribution: what lies within a distance of its middle, and the half width that holds its usual share.

/// Share within one standard deviation.
pub const WITHIN_ONE: f64 = 0.682_689;

/// Share of a normal distribution within +-z of its standard deviations, to 3e-5 (Hastings' rational approximation).
pub fn within(z: f64) -> f64 {
    let x = z / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.470_47 * x);
    1.0 - t * (0.348_024_2 + t * (-0.095_879_8 + t * 0.747_855_6)) * (-x * x).exp()
}

/// The half width that holds as much as one standard deviation does, of errors drawn evenly from normal distributions of
/// these variances. Where they are equal it is their root.
pub fn half_width(variances: &[f64]) -> f64 {
    let (mut low, mut high) = (0.0, 1.01 * variances.iter().fold(0.0, |m: f64, v| m.max(*v)).sqrt());
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        let held = variances.iter().map(|v| within(middle / v.sqrt())).sum::<f64>() / variances.len() as f64;
        if held < WITHIN_ONE { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_of_the_tables() {
        for (z, share) in [(0.0, 0.0), (0.5, 0.382_925), (1.0, 0.682_689), (2.0, 0.954_500), (4.0, 0.999_937)]
        {
            assert!((within(z) - share).abs() < 4e-5, "{z}: {}", within(z));
        }
    }

    #[test]
    fn the_half_width_holds_the_share_of_one_standard_deviation() {
        assert!((half_width(&[4.0; 8]) - 2.0).abs() < 1e-3);
        // Less than the root of the mean variance, 2.24: the wide ones have long tails.
        let mixed = half_width(&[1.0, 9.0]);
        let held = 0.5 * (within(mixed) + within(mixed / 3.0));
        assert!((held - WITHIN_ONE).abs() < 1e-6 && mixed < 1.8, "{mixed}");
    }
}
