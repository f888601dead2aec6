//! Objects over the camera's picture: clean edges by coverage, real surfaces darkened by the ratio.
//! Twin: `shaders/compose/composite.wgsl`.

/// One pixel: `background ratio (1 - coverage) + object`. `object` is premultiplied radiance (r, g, b) and
/// coverage (a) within [0, 1]. Finite and not negative for such inputs.
pub fn over(background_rgb: [f32; 3], ratio_rgb: [f32; 3], object: [f32; 4]) -> [f32; 3] {
    let open = 1.0 - object[3];
    std::array::from_fn(|c| (background_rgb[c] * ratio_rgb[c] * open + object[c]).max(0.0))
}
