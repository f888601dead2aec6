//! De-ringing of measured light: what is smooth by construction must not shine negatively on any surface.

use crate::math::sh::{MAX_COEFFICIENTS, dering as one_channel};
use crate::model::light::RadianceSh;

/// Damps each channel of `light` for itself until its irradiance is nowhere negative, and no more (see
/// [`one_channel::dering`]). Band 0, and with it the flux, is untouched. Gives what was done to r, g and b.
pub fn dering(light: &mut RadianceSh) -> [one_channel::Dering; 3] {
    let count = (light.order * light.order).min(MAX_COEFFICIENTS);
    std::array::from_fn(|c| {
        let mut channel = [0.0; MAX_COEFFICIENTS];
        for (wide, row) in channel.iter_mut().zip(&light.rgb[..count]) {
            *wide = f64::from(row[c]);
        }
        let done = one_channel::dering(light.order, &mut channel[..count]);
        if done.kept < 1.0 {
            for (row, wide) in light.rgb[..count].iter_mut().zip(channel) {
                row[c] = wide as f32;
            }
        }
        done
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh::basis;

    #[test]
    fn channels_are_damped_one_by_one() {
        let mut y = [0.0_f32; 36];
        basis::evaluate(4, [0.6, 0.0, 0.8], &mut y);
        let mut light = RadianceSh::zero(4);
        for (row, y) in light.rgb.iter_mut().zip(y) {
            *row = [y, 3.0 * y, y];
        }
        // Blue has a sky that covers the ringing.
        light.rgb[0][2] += 1.0;
        let before = light;
        let [red, green, blue] = dering(&mut light);
        assert!(red.kept < 0.87 && (red.kept - green.kept).abs() < 1e-6 && blue.kept == 1.0);
        for (row, was) in light.rows().iter().zip(before.rows()) {
            assert_eq!(row[2], was[2]);
        }
        assert_eq!(light.rgb[0], before.rgb[0]);
        // In f32 too: once is enough.
        let once = light;
        dering(&mut light);
        assert_eq!(light, once);
    }
}
