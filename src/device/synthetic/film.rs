//! The camera's sensor: a response like that of film, shot and read noise, 8 bits.

use super::random::normal;
use crate::model::response::Response;

/// Exposure (radiance times seconds at unit gain) that just saturates.
pub const SATURATION: f64 = 2.0;
/// Electrons that an exposure of 1 frees in one pixel.
const ELECTRONS_PER_EXPOSURE: f64 = 12_000.0;
/// Standard deviation of reading one pixel, electrons.
const READ_NOISE_ELECTRONS: f64 = 3.0;
/// For each channel: exponent and knee of the curve.
const CURVES: [(f64, f64); 3] = [(0.60, 0.62), (0.585, 0.60), (0.595, 0.56)];

/// The film curve: 8-bit value / 255 = h(X) / h(saturation) with h(X) = (X / (X + knee))^exponent. It rises
/// steeply from black, is nearly logarithmic over the middle and has a shoulder; it is not any power law.
/// Value 0 is taken as 0.25.
pub fn film() -> Response {
    let g = CURVES.map(|(exponent, knee)| {
        std::array::from_fn(|z| {
            let top = (SATURATION / (SATURATION + knee)).powf(exponent);
            let share = ((z as f64).max(0.25) / 255.0 * top).powf(1.0 / exponent);
            (knee * share / (1.0 - share)).ln() as f32
        })
    });
    // The curve is smooth and rises everywhere, so the table always passes.
    Response::new(g).unwrap_or_else(Response::srgb)
}

/// Turns exposures into 8-bit values: round(`response.value_of`), by tables.
#[derive(Clone, Debug)]
pub struct Quantiser {
    /// For each channel, the exposure from which each value 1..=255 is given.
    thresholds: [Vec<f64>; 3],
    /// For each channel, the value at the lower end of each step of sqrt(X).
    starts: [Vec<u8>; 3],
    steps_per_root: [f64; 3],
}

const STEPS: usize = 2048;

impl Quantiser {
    /// Tables for this response.
    pub fn new(response: &Response) -> Self {
        let edges = response.log_exposure().map(|g| {
            let x = g.map(|log| f64::from(log).exp());
            (1..256).map(|z| (x[z - 1] + x[z]) / 2.0).collect::<Vec<_>>()
        });
        let steps_per_root = std::array::from_fn(|c: usize| STEPS as f64 / edges[c][254].sqrt());
        let starts = std::array::from_fn(|c: usize| {
            (0..STEPS)
                .map(|i| {
                    let x = (i as f64 / steps_per_root[c]).powi(2);
                    edges[c].partition_point(|edge| *edge <= x) as u8
                })
                .collect()
        });
        Self { thresholds: edges, starts, steps_per_root }
    }

    /// The 8-bit value of an exposure.
    pub fn value(&self, channel: usize, exposure: f64) -> u8 {
        let step = (exposure.max(0.0).sqrt() * self.steps_per_root[channel]) as usize;
        let Some(&start) = self.starts[channel].get(step) else { return 255 };
        let mut z = start;
        while z < 255 && self.thresholds[channel][z as usize] <= exposure {
            z += 1;
        }
        z
    }
}

/// Adds shot noise (its variance is the number of electrons) and read noise, each times `strength`.
/// Gain multiplies after the electrons are counted, so it brings no light.
pub fn expose(radiance: f64, time_s: f64, gain: f64, strength: f64, key: [u64; 3]) -> f64 {
    let electrons = radiance * time_s * ELECTRONS_PER_EXPOSURE;
    let deviation = (electrons + READ_NOISE_ELECTRONS * READ_NOISE_ELECTRONS).sqrt() * strength;
    let noisy = if deviation > 0.0 { electrons + deviation * normal(key) } else { electrons };
    gain * noisy / ELECTRONS_PER_EXPOSURE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiser_rounds_the_response() {
        let response = film();
        let q = Quantiser::new(&response);
        for channel in 0..3 {
            for i in 0..4000 {
                let x = (f64::from(i) / 4000.0).powi(3) * 2.2;
                let exact = response.value_of(channel, x as f32);
                // 0.02: the response works in f32 with exp and ln, the tables in f64.
                assert!((f32::from(q.value(channel, x)) - exact).abs() <= 0.52, "{channel} {x} {exact}");
            }
        }
        assert_eq!((q.value(0, -1.0), q.value(1, 0.0), q.value(2, 1e9)), (0, 0, 255));
    }

    #[test]
    fn film_saturates_where_stated_and_differs_from_srgb() {
        let g = film();
        let srgb = Response::srgb();
        for channel in 0..3 {
            assert!((f64::from(g.log_exposure()[channel][255]) - SATURATION.ln()).abs() < 1e-6);
            // The ratio of the exposures at values 220 and 60 is no power law's and not that of sRGB.
            let spread = |r: &Response| r.log_exposure()[channel][220] - r.log_exposure()[channel][60];
            assert!((spread(&g) - spread(&srgb)).abs() > 0.1);
        }
    }

    #[test]
    fn noise_has_the_stated_size() {
        let (radiance, time, n) = (10.0, 0.01, 20_000u64);
        let mean_electrons = radiance * time * ELECTRONS_PER_EXPOSURE;
        let mut sum = 0.0;
        for i in 0..n {
            sum += ((expose(radiance, time, 1.0, 1.0, [5, 0, i]) - 0.1) * ELECTRONS_PER_EXPOSURE).powi(2);
        }
        let variance = sum / n as f64;
        // Four standard errors of a variance: 4 sqrt(2 / n) = 4 %.
        assert!((variance / (mean_electrons + 9.0) - 1.0).abs() < 0.04);
    }
}
