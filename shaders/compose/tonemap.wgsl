// Back through the camera's response: for each channel the number of thresholds at or below the exposure, found
// by halving. Twin: src/compose/tonemap.rs. One invocation makes four pixels, which are three whole words.

struct TonemapParams {
    // Groups of four pixels.
    quads: u32,
    // Invocations in one row of the dispatch.
    row: u32,
    // Seconds of the shown exposure, at unit gain.
    exposure_s: f32,
    // 32-bit floats of the picture.
    floats: u32,
}

@group(0) @binding(0) var<uniform> params: TonemapParams;
// 256 for each channel, never decreasing.
@group(0) @binding(1) var<storage, read> thresholds: array<f32>;
@group(0) @binding(2) var<storage, read> radiance: array<f32>;
@group(0) @binding(3) var<storage, read_write> display: array<u32>;

fn encode(channel: u32, exposure: f32) -> u32 {
    // Also false for what is not a number.
    if !(exposure > 0.0) {
        return 0u;
    }
    var z = 0u;
    for (var step = 128u; step > 0u; step /= 2u) {
        if thresholds[channel * 256u + z + step - 1u] <= exposure {
            z += step;
        }
    }
    return z;
}

@compute @workgroup_size(64)
fn tonemap(@builtin(global_invocation_id) id: vec3<u32>) {
    let quad = id.y * params.row + id.x;
    if quad >= params.quads {
        return;
    }
    for (var word = 0u; word < 3u; word += 1u) {
        var packed = 0u;
        for (var byte = 0u; byte < 4u; byte += 1u) {
            let at = quad * 12u + word * 4u + byte;
            if at < params.floats {
                packed |= encode(at % 3u, radiance[at] * params.exposure_s) << (8u * byte);
            }
        }
        display[quad * 3u + word] = packed;
    }
}
