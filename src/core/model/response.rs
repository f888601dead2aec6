//! A camera's response: what log exposure made each 8-bit value.

/// For each channel and 8-bit value z: g(z) = ln X, X = radiance times effective exposure in seconds, [DM97].
/// Invariant: finite and not decreasing in z.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    log_exposure: [[f32; 256]; 3],
}

/// The first number of a table that no response has.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "[{channel}][{value}] = {found}{}: must be finite and never fall",
    if *.before > *.found { format!(" after {}", .before) } else { String::new() }
)]
pub struct BadResponse {
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// The 8-bit value.
    pub value: usize,
    /// What stands there.
    pub found: f32,
    /// What stands before it; negative infinity for the first.
    pub before: f32,
}

impl Response {
    /// Takes g tables; `None` unless every value is finite and each channel never decreases.
    pub fn new(log_exposure: [[f32; 256]; 3]) -> Option<Self> {
        Self::checked(log_exposure).ok()
    }

    /// Takes g tables.
    ///
    /// # Errors
    /// The first number that is not finite, or falls.
    pub fn checked(log_exposure: [[f32; 256]; 3]) -> Result<Self, BadResponse> {
        for (channel, g) in log_exposure.iter().enumerate() {
            let mut before = f32::NEG_INFINITY;
            for (value, &found) in g.iter().enumerate() {
                if !(found.is_finite() && found >= before) {
                    return Err(BadResponse { channel, value, found, before });
                }
                before = found;
            }
        }
        Ok(Self { log_exposure })
    }

    /// The sRGB transfer, scaled so that 255 is an exposure of 1. Value 0 is taken as 0.25.
    pub fn srgb() -> Self {
        let mut g = [0.0f32; 256];
        for (z, slot) in g.iter_mut().enumerate() {
            let v = (z as f64).max(0.25) / 255.0;
            let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
            *slot = linear.ln() as f32;
        }
        Self { log_exposure: [g; 3] }
    }

    /// g(z) for each channel.
    pub fn log_exposure(&self) -> &[[f32; 256]; 3] {
        &self.log_exposure
    }

    /// For each channel and value z the exposure at which [`Response::value_of`] passes z + 1/2, where the rounded value steps
    /// up; never decreasing. The last is infinite. Between its entries a response is linear in exposure, so that z + 1/2 lies
    /// half way.
    pub fn thresholds(&self) -> [[f32; 256]; 3] {
        let mut thresholds = [[f32::INFINITY; 256]; 3];
        for (thresholds, g) in thresholds.iter_mut().zip(&self.log_exposure) {
            for z in 0..255 {
                thresholds[z] = (0.5 * (f64::from(g[z]).exp() + f64::from(g[z + 1]).exp())) as f32;
            }
        }
        thresholds
    }

    /// The 8-bit value, as a continuous number in 0..=255, that exposure X gives in a channel: the inverse of
    /// g, linear in X between its entries, clipped at both ends. Not finite or negative X gives 0.
    pub fn value_of(&self, channel: usize, exposure: f32) -> f32 {
        let g = &self.log_exposure[channel];
        if exposure.is_nan() || exposure <= 0.0 {
            return 0.0;
        }
        let log = exposure.ln();
        if log >= g[255] {
            return 255.0;
        }
        if log <= g[0] {
            return 0.0;
        }
        let upper = g.partition_point(|&x| x <= log).clamp(1, 255);
        let (low, high) = (g[upper - 1].exp(), g[upper].exp());
        let t = if high > low { ((exposure - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
        (upper - 1) as f32 + t
    }
}
