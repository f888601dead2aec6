// How much of a hard light virtual objects let through to a point.
// Twin: src/core/visibility/shadow_maps.rs (bias_m, lit, visibility).

const EMPTY_DEPTH = 1.0;
const MAX_BIAS_TEXELS = 64.0;
const ROUNDING_TEXELS = 0.1;

fn bias_m(texel_m: f32, half_width_texels: f32, cos_theta: f32, max_bias_m: f32) -> f32 {
    if cos_theta <= 0.0 {
        return max_bias_m;
    }
    let c = min(cos_theta, 1.0);
    let tangent = sqrt((1.0 - c) * (1.0 + c)) / c;
    return min(texel_m * (half_width_texels + 0.5) * 1.41421356 * tangent, max_bias_m);
}

// Overlap of tap i of 0..=side with the filter's box that starts `fraction` into tap 0.
fn tap_weight(i: u32, side: u32, fraction: f32) -> f32 {
    if side == 0u {
        return 1.0;
    }
    if i == 0u {
        return 1.0 - fraction;
    }
    if i == side {
        return fraction;
    }
    return 1.0;
}

fn lit(k: u32, at: vec2<f32>, depth: f32) -> f32 {
    let texels = i32(cameras.cameras[k].texels_taps.x);
    let reference = min(depth, EMPTY_DEPTH);
    let side = max(cameras.cameras[k].texels_taps.y, 1u) - 1u;
    let half = 0.5 * f32(side);
    let corner = floor(at - half);
    let inside = all(corner >= vec2<f32>(-16.0)) && all(corner < vec2<f32>(f32(texels)));
    if !inside {
        return 1.0;
    }
    let fraction = at - half - corner;
    let first = vec2<i32>(corner);
    var sum = 0.0;
    for (var j = 0u; j <= side; j += 1u) {
        let weight_y = tap_weight(j, side, fraction.y);
        for (var i = 0u; i <= side; i += 1u) {
            let texel = first + vec2<i32>(i32(i), i32(j));
            var stored = EMPTY_DEPTH;
            if all(texel >= vec2<i32>(0)) && all(texel < vec2<i32>(texels)) {
                stored = bitcast<f32>(textureLoad(shadow_maps, texel, i32(k), 0).x);
            }
            if reference <= stored {
                sum += tap_weight(i, side, fraction.x) * weight_y;
            }
        }
    }
    let norm = f32(max(side, 1u));
    return min(sum / (norm * norm), 1.0);
}

// Of hard light k. `cos_theta`: the receiver's facet normal times the light.
fn visibility(k: u32, point_world: vec3<f32>, cos_theta: f32) -> f32 {
    let camera = cameras.cameras[k];
    if camera.texels_taps.x == 0u {
        return 1.0;
    }
    let at = map_position(camera, point_world);
    let texel_m = camera.texel_depth_m.x;
    let half_width = 0.5 * f32(camera.texels_taps.y);
    let bias = bias_m(texel_m, half_width, cos_theta, MAX_BIAS_TEXELS * texel_m) + ROUNDING_TEXELS * texel_m;
    return lit(k, at.xy, at.z - bias / camera.texel_depth_m.y);
}
