// The light of a frame, and the sums of its soft half. Twin: src/compose/shade_object.rs (LightTerms).

struct LightTerms {
    // Unit, towards the directional light, world frame; zero where there is none.
    to_light: vec4<f32>,
    // E_d.
    direct_rgb: vec4<f32>,
    // Order n of the tables; rows beyond n^2 are zero.
    order: vec4<u32>,
    // x multiplies the radiance of objects, so that 16-bit floats hold it: 1 is the camera's white.
    exposure: vec4<f32>,
    // irradiance / pi of the soft half: the sum of rows times y(normal).
    soft_rgb: array<vec4<f32>, 36>,
    // L_g.
    global_rgb: array<vec4<f32>, 36>,
    // L_g + E_d y(w_d).
    total_rgb: array<vec4<f32>, 36>,
}

const SOFT = 0u;
const GLOBAL = 1u;
const TOTAL = 2u;

// Weight of a coefficient's band; `low` for bands 0 to 3, `high` for 4 and 5.
fn band_weight(i: u32, low: vec4<f32>, high: vec2<f32>) -> f32 {
    if i < 1u {
        return low.x;
    }
    if i < 4u {
        return low.y;
    }
    if i < 9u {
        return low.z;
    }
    if i < 16u {
        return low.w;
    }
    if i < 25u {
        return high.x;
    }
    return high.y;
}

fn light_row(rows: u32, i: u32) -> vec3<f32> {
    if rows == SOFT {
        return light.soft_rgb[i].xyz;
    }
    if rows == GLOBAL {
        return light.global_rgb[i].xyz;
    }
    return light.total_rgb[i].xyz;
}

// Sum of rows times y(direction), bands weighted.
fn lobe_sum(rows: u32, low: vec4<f32>, high: vec2<f32>, direction: vec3<f32>) -> vec3<f32> {
    var y = sh_basis(direction);
    var sum = vec3<f32>(0.0);
    for (var i = 0u; i < 16u; i += 1u) {
        sum += band_weight(i, low, high) * light_row(rows, i) * y[i];
    }
    if light.order.x > 4u {
        for (var i = 16u; i < 36u; i += 1u) {
            sum += band_weight(i, low, high) * light_row(rows, i) * y[i];
        }
    }
    return sum;
}

// irradiance / pi of the soft half on a normal: what a white matt surface radiates. May be negative.
fn soft_over_pi(normal: vec3<f32>) -> vec3<f32> {
    return lobe_sum(SOFT, vec4<f32>(1.0), vec2<f32>(1.0), normal);
}
