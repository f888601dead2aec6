//! Objects over the camera's picture: clean edges by coverage, real surfaces darkened by the ratio.
//! Twin: `shaders/compose/composite.wgsl`.

/// One pixel: `background ratio (1 - coverage) + object`. `object` is premultiplied radiance (r, g, b) and
/// coverage (a) within [0, 1]. Finite and not negative for such inputs.
pub fn over(background_rgb: [f32; 3], ratio_rgb: [f32; 3], object: [f32; 4]) -> [f32; 3] {
    let open = 1.0 - object[3];
    std::array::from_fn(|c| (background_rgb[c] * ratio_rgb[c] * open + object[c]).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::over;

    #[test]
    fn an_edge_pixel_is_the_mean_of_what_its_samples_see() {
        let background = [0.8, 0.4, 0.2];
        let object = [0.1, 0.2, 0.3];
        let quarter = [object[0] / 4.0, object[1] / 4.0, object[2] / 4.0, 0.25];
        let out = over(background, [0.5, 1.0, 0.25], quarter);
        for c in 0..3 {
            let mean = 0.75 * background[c] * [0.5, 1.0, 0.25][c] + 0.25 * object[c];
            assert!((out[c] - mean).abs() < 1e-7);
        }
        assert_eq!(over(background, [1.0; 3], [0.0; 4]), background);
        assert_eq!(over(background, [0.3; 3], [0.1, 0.2, 0.3, 1.0]), object);
    }
}
