//! Limits on what comes from outside; `docs/limits.md` has the table of all.

/// Longest side of a picture or of a camera's lens, pixels.
pub const MAX_SIDE: usize = 16_384;
/// Most pixels of a camera that is drawn for: 33 million, enough for 7680 x 4320. Each takes about 24 bytes in a frame.
pub const MAX_CAMERA_PIXELS: usize = 1 << 25;
/// Largest focal length and coordinate of a principal point, pixels.
pub const MAX_LENS_PX: f64 = 1e6;
/// Smallest focal length, pixels.
pub const MIN_FOCAL_PX: f64 = 1e-3;

/// Farthest place from the origin along each axis, metres. f32 has a millimetre there.
pub const MAX_PLACE_M: f64 = 10_000.0;
/// Smallest and largest side of a tag, metres.
pub const MIN_TAG_M: f64 = 0.001;
/// See [`MIN_TAG_M`].
pub const MAX_TAG_M: f64 = 10.0;
/// Smallest and largest radius of a mirror ball, metres.
pub const MIN_BALL_M: f64 = 0.001;
/// See [`MIN_BALL_M`].
pub const MAX_BALL_M: f64 = 10.0;
/// Longest exposure, seconds.
pub const MAX_TIME_S: f64 = 1e5;
/// Largest gain.
pub const MAX_GAIN: f64 = 1e5;

/// Whether a camera may have so many columns and rows.
///
/// # Errors
/// What is allowed, so that it reads well after "must be".
pub fn check_camera_size(width: usize, height: usize) -> Result<(), String> {
    let sides = 1..=MAX_SIDE;
    let is_sound = sides.contains(&width)
        && sides.contains(&height)
        && width.saturating_mul(height) <= MAX_CAMERA_PIXELS;
    is_sound
        .then_some(())
        .ok_or_else(|| format!("1 to {MAX_SIDE} pixels a side and at most {MAX_CAMERA_PIXELS} in all"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_and_area_have_a_limit() {
        for (width, height) in [(1, 1), (7680, 4320), (MAX_SIDE, 2048), (1, MAX_SIDE)] {
            assert_eq!(check_camera_size(width, height), Ok(()), "{width} x {height}");
        }
        for (width, height) in [
            (0, 1),
            (1, 0),
            (MAX_SIDE + 1, 1),
            (MAX_SIDE, 2049),
            (MAX_SIDE, MAX_SIDE),
            (usize::MAX, usize::MAX),
        ] {
            assert!(check_camera_size(width, height).is_err(), "{width} x {height}");
        }
    }
}
