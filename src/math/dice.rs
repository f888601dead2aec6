//! Numbers that look like chance and are the same on every machine: the only generators of the project.

/// A stream of numbers: Knuth's linear congruential generator of 64 bits, of which the upper ones are good.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    /// The same seed gives the same numbers.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits; the lower ones repeat soon.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0
    }

    /// Evenly within [0, 1), of 53 bits.
    pub fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// Evenly within [0, 1), of 24 bits.
    pub fn unit_f32(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Evenly within [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Of mean 0 and standard deviation 1, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// The upper 53 bits as a number within [0, 1).
pub fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// The step from one key to the next of [`mix`]: 2^64 over the golden ratio, odd.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Mixes bits well, so that a number is a function of its key (the finaliser of SplitMix64): equal in, equal out, and one bit in
/// changes half of those out. `mix` of a key that grows by [`STEP`] is the stream SplitMix64.
pub const fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// [`mix`] of 32 bits (the finaliser of MurmurHash3).
#[inline]
pub const fn mix_u32(mut bits: u32) -> u32 {
    bits ^= bits >> 16;
    bits = bits.wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_streams_are_the_published_ones() {
        // Steele, Lea and Flood's SplitMix64 from a seed of 1234567; MurmurHash3's finaliser of 1.
        let split: Vec<u64> = (1..=3).map(|k| mix(1_234_567u64.wrapping_add(STEP.wrapping_mul(k)))).collect();
        assert_eq!(split, [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]);
        assert_eq!((mix_u32(0), mix_u32(1)), (0, 0x514e_28b7));
        assert_eq!(Dice::new(0).bits(), 1_442_695_040_888_963_407);
    }

    #[test]
    fn numbers_are_spread_as_stated() {
        let mut dice = Dice::new(7);
        let n = 100_000;
        let (mut flat, mut mean, mut square, mut single) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let (u, z, s) = (dice.unit(), dice.normal(), f64::from(dice.unit_f32()));
            assert!((0.0..1.0).contains(&u) && (0.0..1.0).contains(&s));
            (flat, single) = (flat + u, single + s);
            (mean, square) = (mean + z, square + z * z);
        }
        let [flat, single, mean, square] = [flat, single, mean, square].map(|sum: f64| sum / f64::from(n));
        // Three standard errors: 3 / sqrt(12e5) = 0.0027; 3 / sqrt(1e5) = 0.0095; 3 sqrt(2 / 1e5) = 0.0134.
        assert!((flat - 0.5).abs() < 0.0027 && (single - 0.5).abs() < 0.0027, "{flat} {single}");
        assert!(mean.abs() < 0.0095 && (square - 1.0).abs() < 0.0134, "{mean} {square}");
    }
}
