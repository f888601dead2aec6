//! Interpolation between 8-bit pixels in linear light.

use crate::model::response::Response;

/// Values of a channel that differ by no more are blended as they are: an error of about 0.1 % in radiance.
const SMOOTH: u8 = 8;

/// Blends 8-bit values as the light that made them, so that a small bright spot keeps its light: blended as values,
/// a lamp two pixels wide on dark ground loses a tenth of it, since a response is nearly logarithmic.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearLight {
    /// For each channel and value, the exposure that made it.
    exposure: [[f32; 256]; 3],
    /// For each channel, the exposure from which the next value is nearer: for values 0..=254.
    threshold: [[f32; 255]; 3],
}

impl LinearLight {
    /// For pictures of this response.
    pub fn new(response: &Response) -> Self {
        let exposure = response.log_exposure().map(|g| g.map(f32::exp));
        let threshold = exposure.map(|x| std::array::from_fn(|z| 0.5 * (x[z] + x[z + 1])));
        Self { exposure, threshold }
    }

    /// Puts the channels of `pixel` right in which the four values, blended with weights that sum to 4096, differ too
    /// much to be blended as they are; saturated ones (255) stay.
    pub fn mend(&self, taps: [[u8; 3]; 4], weights: [u64; 4], pixel: &mut [u8; 3]) {
        for (c, value) in pixel.iter_mut().enumerate() {
            let values = taps.map(|tap| tap[c]);
            let low = values.iter().fold(255, |low, z| z.min(&low).to_owned());
            let high = values.iter().fold(0, |high, z| z.max(&high).to_owned());
            if *value == 255 || high - low <= SMOOTH {
                continue;
            }
            let mut exposure = 0.0;
            for (z, weight) in values.iter().zip(weights) {
                exposure += self.exposure[c][usize::from(*z)] * (weight as f32 / 4096.0);
            }
            *value = self.threshold[c].partition_point(|x| *x <= exposure) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUARTERS: [u64; 4] = [1024; 4];

    #[test]
    fn light_is_averaged_not_values() {
        let response = Response::srgb();
        let light = LinearLight::new(&response);
        let grays = [200u8, 10, 10, 10].map(|z| [z, 100, 50]);
        let mut pixel = [58, 100, 50];
        light.mend(grays, QUARTERS, &mut pixel);
        let g = response.log_exposure()[0];
        let mean = (g[200].exp() + 3.0 * g[10].exp()) / 4.0;
        // 107, where the mean of the values is 58; rounded to the nearest value.
        assert!((f32::from(pixel[0]) - response.value_of(0, mean)).abs() < 0.51, "{pixel:?}");
        assert!((100..115).contains(&pixel[0]) && pixel[1..] == [100, 50], "{pixel:?}");
    }

    #[test]
    fn what_is_smooth_or_saturated_stays() {
        let light = LinearLight::new(&Response::srgb());
        let mut pixel = [255, 104, 7];
        light.mend([[255, 100, 3], [20, 108, 11], [20, 104, 7], [20, 104, 7]], QUARTERS, &mut pixel);
        assert_eq!(pixel, [255, 104, 7]);
    }

    #[test]
    fn a_tap_of_full_weight_is_itself() {
        let light = LinearLight::new(&Response::srgb());
        for z in 0..=252u8 {
            let mut pixel = [1; 3];
            light.mend(
                [[z; 3], [z.wrapping_add(128).min(252); 3], [z; 3], [z; 3]],
                [4096, 0, 0, 0],
                &mut pixel,
            );
            assert_eq!(pixel, [z; 3]);
        }
    }
}
