//! The textbook's formulas, in f32, written down as they stand: what they give in hard cases is printed beside ours.
//! Nothing else uses them.

use crate::math::sh::product;
use half::f16;

/// w = d / |d| (Eq. 9 of [Now11]).
pub fn direction(d: [f32; 3]) -> [f32; 3] {
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    d.map(|c| c / length)
}

/// d / (|d| + epsilon): the usual way around 0/0.
pub fn direction_with_epsilon(d: [f32; 3], epsilon: f32) -> [f32; 3] {
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    d.map(|c| c / (length + epsilon))
}

/// E_d = d . w for one channel, whatever its sign (Eq. 11 of [Now11]).
pub fn irradiance(d_channel: [f32; 3], w: [f32; 3]) -> f32 {
    d_channel.iter().zip(w).map(|(d, w)| d * w).sum()
}

/// Solid angle of a mirror ball's picture over its area, both normalised to the outline, by the formula of a camera in
/// perspective: `q` is radius over distance, `r` the place.
pub fn ball_jacobian(q: f32, r: f32) -> f32 {
    let tangent = q.asin().tan();
    let psi = (r * tangent).atan();
    let theta = 2.0 * (psi.sin() / q).asin() - psi;
    theta.sin()
        * (2.0 * psi.cos() / (q * q - psi.sin() * psi.sin()).sqrt() - 1.0)
        * tangent
        * psi.cos().powi(2)
        / r
}

/// The polar angle of an angular map (Eq. 6 of [Now11]): pi r.
pub fn angular_map_angle(r: f32) -> f32 {
    std::f32::consts::PI * r
}

/// One sum from the first number to the last.
pub fn running_sum(numbers: impl IntoIterator<Item = f32>) -> f32 {
    numbers.into_iter().fold(0.0, |sum, number| sum + number)
}

/// The same in half floats.
pub fn running_sum_half(numbers: impl IntoIterator<Item = f32>) -> f32 {
    numbers.into_iter().fold(f16::ZERO, |sum, number| sum + f16::from_f32(number)).to_f32()
}

/// The polar angle of a direction by arc cosine, radians.
pub fn polar_angle(z: f32) -> f32 {
    z.acos()
}

/// The merge of [DM97]: exp(sum w (g(z) - ln t) / sum w) with the hat weight; g = ln z/255.
pub fn merged(values: &[u8], times_s: &[f32]) -> f32 {
    let (mut sum, mut all) = (0.0f32, 0.0f32);
    for (&z, t) in values.iter().zip(times_s) {
        let w = f32::from(z.min(255 - z));
        sum += w * ((f32::from(z) / 255.0).ln() - t.ln());
        all += w;
    }
    (sum / all).exp()
}

/// The slope of the response between two pictures: (g(z_1) - g(z_2)) / (ln t_1 - ln t_2).
pub fn response_slope(values: [u8; 2], times_s: [f32; 2]) -> f32 {
    let g = |z: u8| (f32::from(z) / 255.0).ln();
    (g(values[0]) - g(values[1])) / (times_s[0].ln() - times_s[1].ln())
}

/// Mean visibility beside a sphere, (1 + sqrt(1 - (r/d)^2)) / 2 (Eq. 22 and 23 of [Now11]).
pub fn mean_visibility(radius: f32, distance: f32) -> f32 {
    let ratio = radius / distance;
    0.5 * (1.0 + (1.0 - ratio * ratio).sqrt())
}

/// Mean visibility of the same sphere so many times by the product chain, V <- V * V_1 truncated: `one` holds order^2
/// coefficients.
pub fn chain(order: usize, one: &[f32], times: usize) -> f32 {
    let mut all = one.to_vec();
    let mut next = vec![0.0f32; one.len()];
    for _ in 1..times {
        product::product(order, &all, one, &mut next);
        all.copy_from_slice(&next);
    }
    all[0] / (4.0 * std::f32::consts::PI).sqrt()
}

/// exp(mean) a: the two factors of Eq. 24 of [Now11], each by itself.
pub fn exponential(mean: f32, log_a: f32) -> f32 {
    mean.exp() * log_a.exp()
}

/// max(0, cos)^s.
pub fn lobe(cosine: f32, exponent: f32) -> f32 {
    cosine.max(0.0).powf(exponent)
}

/// What a Phong lobe with the paper's factor (s + 2)/(2 pi) sends back in a white furnace: its integral, by rings.
pub fn furnace(exponent: f32) -> f32 {
    let rings = 1000;
    let sum: f32 = (0..rings).map(|k| lobe((k as f32 + 0.5) / rings as f32, exponent)).sum();
    (exponent + 2.0) * sum / rings as f32
}

/// Bias of a shadow map in texels by the slope alone: half the filter and half a texel, times sqrt2 tan(theta).
pub fn bias_texels(half_filter_texels: f32, cosine: f32) -> f32 {
    (half_filter_texels + 0.5) * std::f32::consts::SQRT_2 * cosine.acos().tan()
}

/// The right axis of a shadow camera, z x w, normalised.
pub fn right_of(w: [f32; 3]) -> [f32; 3] {
    direction([-w[1], w[0], 0.0])
}

/// Depth between a near and a far plane along the light; what is outside is cut off.
pub fn clipped_depth(depth: f32, near: f32, far: f32) -> Option<f32> {
    let share = (depth - near) / (far - near);
    (0.0..=1.0).contains(&share).then_some(share)
}

/// Ratio of light with and without a virtual object: (soft + E cos V) / (soft + E cos).
pub fn light_ratio(soft: f32, irradiance: f32, cosine: f32, visible: f32) -> f32 {
    (soft + irradiance * cosine * visible) / (soft + irradiance * cosine)
}

/// Form factor by the two middles: A cos cos / (pi r^2).
pub fn form_factor_of_middles(area: f32, cosines: [f32; 2], distance: f32) -> f32 {
    area * cosines[0] * cosines[1] / (std::f32::consts::PI * distance * distance)
}

/// Form factor by Lambert's contour with arc cosines: sum n.(a x b)/|a x b| acos(a.b) / (2 pi).
pub fn form_factor_by_contour(normal: [f32; 3], corners: &[[f32; 3]]) -> f32 {
    let mut sum = 0.0;
    for (k, a) in corners.iter().enumerate() {
        let (a, b) = (direction(*a), direction(corners[(k + 1) % corners.len()]));
        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let unit = direction(cross);
        let angle = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).acos();
        sum += angle * irradiance(normal, unit);
    }
    (sum / (2.0 * std::f32::consts::PI)).abs()
}

/// Light that is kept where each source below a share of all is left out.
pub fn kept_above_share(sources: &[f32], share: f32) -> f32 {
    let all: f32 = sources.iter().sum();
    sources.iter().filter(|s| **s >= share * all).sum::<f32>() / all
}

/// Product of quaternions x y z w, as it comes.
pub fn quaternion_product(p: [f32; 4], q: [f32; 4]) -> [f32; 4] {
    let ([a, b, c, d], [x, y, z, w]) = (p, q);
    [
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    ]
}

/// Spherical interpolation: sin((1-t) a)/sin(a) p + sin(t a)/sin(a) q, a = acos(p.q).
pub fn slerp(p: [f32; 4], q: [f32; 4], t: f32) -> [f32; 4] {
    let angle = p.iter().zip(q).map(|(p, q)| p * q).sum::<f32>().acos();
    let (first, second) = (((1.0 - t) * angle).sin() / angle.sin(), (t * angle).sin() / angle.sin());
    std::array::from_fn(|k| first * p[k] + second * q[k])
}

/// A filter's next value: old + (1 - exp(-dt/tau)) (new - old).
pub fn filtered(old: f32, new: f32, dt_s: f32, tau_s: f32) -> f32 {
    old + (1.0 - (-dt_s / tau_s).exp()) * (new - old)
}

/// A speed from two places: (b - a) / dt.
pub fn speed(a: f32, b: f32, dt_s: f32) -> f32 {
    (b - a) / dt_s
}

/// Distance of a square of a known side by the area of its picture: f side / sqrt(area).
pub fn distance_by_area(focal_px: f32, side_m: f32, corners_px: &[[f32; 2]; 4]) -> f32 {
    let mut twice = 0.0;
    for (k, a) in corners_px.iter().enumerate() {
        let b = corners_px[(k + 1) % 4];
        twice += a[0] * b[1] - a[1] * b[0];
    }
    focal_px * side_m / (0.5 * twice).abs().sqrt()
}

/// The place of a column of a picture between its borders: x / (width - 1).
pub fn column_share(x: usize, width: usize) -> f32 {
    x as f32 / (width as f32 - 1.0)
}

/// A pixel's number, y width + x.
pub fn pixel_number(x: u32, y: u32, width: u32) -> f32 {
    y as f32 * width as f32 + x as f32
}

/// T of a display of gamma 2.2: 0 to 255, cut at white.
pub fn displayed(light: f32) -> f32 {
    255.0 * light.clamp(0.0, 1.0).powf(1.0 / 2.2)
}

/// Values that are left of a shown pixel where each light `share` of so many is taken from the 8-bit value by itself,
/// S = T(X) - T(X (1 - share)) of the pixel's own light X, rounded.
pub fn left_of_display(light: f32, share: f32, count: usize) -> f32 {
    let each = (displayed(light) - displayed(light * (1.0 - share))).round();
    (displayed(light) - each * count as f32).max(0.0)
}

/// A number that is kept as a half float.
pub fn half(number: f32) -> f32 {
    f16::from_f32(number).to_f32()
}
