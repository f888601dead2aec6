// The light of a frame, and the sums of its soft half. Twin: src/core/compose/shade_object.rs (LightTerms).

struct HardLight {
    // Unit, towards the light, world frame.
    to_light: vec4<f32>,
    irradiance_rgb: vec4<f32>,
}

struct LightTerms {
    // x: order n of the tables; rows beyond n^2 are zero. y: hard lights in use.
    order_hard: vec4<u32>,
    // x multiplies the radiance of objects, so that 16-bit floats hold it: 1 is the camera's white.
    exposure: vec4<f32>,
    // irradiance / pi of the soft half: the sum of rows times y(normal).
    soft_rgb: array<vec4<f32>, 36>,
    // L_g.
    global_rgb: array<vec4<f32>, 36>,
    // L_g + sum of E_k y(w_k).
    total_rgb: array<vec4<f32>, 36>,
    hard: array<HardLight, 64>,
}

// Whether the light has bands 4 and 5.
override HIGH_BANDS: bool = true;

const SOFT = 0u;
const GLOBAL = 1u;
const TOTAL = 2u;

fn light_row(rows: u32, i: u32) -> vec3<f32> {
    if rows == SOFT {
        return light.soft_rgb[i].xyz;
    }
    if rows == GLOBAL {
        return light.global_rgb[i].xyz;
    }
    return light.total_rgb[i].xyz;
}

// Sum of rows times y(direction), bands weighted: `low` for bands 0 to 3, `high` for 4 and 5.
fn lobe_sum(rows: u32, low: vec4<f32>, high: vec2<f32>, direction: vec3<f32>) -> vec3<f32> {
    let y = sh_low(direction);
    let band0 = y[0] * light_row(rows, 0u);
    let band1 = y[1] * light_row(rows, 1u) + y[2] * light_row(rows, 2u)
        + y[3] * light_row(rows, 3u);
    let band2 = y[4] * light_row(rows, 4u) + y[5] * light_row(rows, 5u)
        + y[6] * light_row(rows, 6u) + y[7] * light_row(rows, 7u)
        + y[8] * light_row(rows, 8u);
    let band3 = y[9] * light_row(rows, 9u) + y[10] * light_row(rows, 10u)
        + y[11] * light_row(rows, 11u) + y[12] * light_row(rows, 12u)
        + y[13] * light_row(rows, 13u) + y[14] * light_row(rows, 14u)
        + y[15] * light_row(rows, 15u);
    var sum = low.x * band0 + low.y * band1 + low.z * band2 + low.w * band3;
    if HIGH_BANDS {
        let h = sh_high(direction);
        let band4 = h[0] * light_row(rows, 16u) + h[1] * light_row(rows, 17u)
            + h[2] * light_row(rows, 18u) + h[3] * light_row(rows, 19u)
            + h[4] * light_row(rows, 20u) + h[5] * light_row(rows, 21u)
            + h[6] * light_row(rows, 22u) + h[7] * light_row(rows, 23u)
            + h[8] * light_row(rows, 24u);
        let band5 = h[9] * light_row(rows, 25u) + h[10] * light_row(rows, 26u)
            + h[11] * light_row(rows, 27u) + h[12] * light_row(rows, 28u)
            + h[13] * light_row(rows, 29u) + h[14] * light_row(rows, 30u)
            + h[15] * light_row(rows, 31u) + h[16] * light_row(rows, 32u)
            + h[17] * light_row(rows, 33u) + h[18] * light_row(rows, 34u)
            + h[19] * light_row(rows, 35u);
        sum += high.x * band4 + high.y * band5;
    }
    return sum;
}

// irradiance / pi of the soft half on a normal: what a white matt surface radiates. May be negative.
fn soft_over_pi(normal: vec3<f32>) -> vec3<f32> {
    return lobe_sum(SOFT, vec4<f32>(1.0), vec2<f32>(1.0), normal);
}
