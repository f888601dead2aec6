//! Colour: the sRGB transfer curve and gray.

use super::sh::Real;

/// Rounded Rec. 601 weights, as [Now11] uses them on SH vectors (Eq. 10).
pub const GRAY_PAPER: [f64; 3] = [0.3, 0.59, 0.11];
/// Rec. 709 weights: luminance of linear RGB with sRGB's primaries.
pub const GRAY_REC709: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Linear to sRGB-encoded, both 0..=1: 12.92 c up to 0.0031308, above 1.055 c^(1/2.4) - 0.055
/// (IEC 61966-2-1). Goes on beyond 1; below 0 it is the straight line. Inverse: [`srgb_decode`].
#[inline]
pub fn srgb_encode<T: Real>(linear: T) -> T {
    if linear > T::of(0.003_130_8) {
        T::of(1.055) * linear.powf(T::of(1.0 / 2.4)) - T::of(0.055)
    } else {
        T::of(12.92) * linear
    }
}

/// sRGB-encoded to linear, both 0..=1: c/12.92 up to 0.04045, above ((c + 0.055)/1.055)^2.4.
#[inline]
pub fn srgb_decode<T: Real>(encoded: T) -> T {
    if encoded > T::of(0.040_45) {
        ((encoded + T::of(0.055)) / T::of(1.055)).powf(T::of(2.4))
    } else {
        encoded / T::of(12.92)
    }
}

/// Weighted sum of linear RGB; `weights` as [`GRAY_PAPER`] or [`GRAY_REC709`].
#[inline]
pub fn gray_with<T: Real>(rgb: [T; 3], weights: [f64; 3]) -> T {
    rgb[0] * T::of(weights[0]) + rgb[1] * T::of(weights[1]) + rgb[2] * T::of(weights[2])
}

/// 0.3 R + 0.59 G + 0.11 B.
#[inline]
pub fn gray<T: Real>(rgb: [T; 3]) -> T {
    gray_with(rgb, GRAY_PAPER)
}

/// 0.2126 R + 0.7152 G + 0.0722 B: luminance of linear RGB.
#[inline]
pub fn luminance<T: Real>(rgb: [T; 3]) -> T {
    gray_with(rgb, GRAY_REC709)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_is_inverted_and_continuous() {
        for i in 0..=255 {
            let encoded = f64::from(i) / 255.0;
            let back = srgb_encode(srgb_decode(encoded));
            // The standard's two knees are rounded: they miss each other by 3e-8.
            assert!((back - encoded).abs() < 1e-7, "{encoded} came back as {back}");
            let back = srgb_encode(srgb_decode(encoded as f32));
            assert!((back - encoded as f32).abs() < 4e-7);
        }
        assert!((srgb_decode(0.5_f64) - 0.214_041_140_482_232_5).abs() < 1e-15);
        assert!((srgb_encode(1.0_f64) - 1.0).abs() < 1e-15 && srgb_encode(0.0_f64) == 0.0);
    }

    #[test]
    fn white_is_one() {
        assert!((gray([1.0_f64; 3]) - 1.0).abs() < 1e-15);
        assert!((luminance([1.0_f64; 3]) - 1.0).abs() < 1e-15);
        assert!((gray([0.0, 1.0, 0.0_f64]) - 0.59).abs() < 1e-15);
    }
}
