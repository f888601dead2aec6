// Back through the camera's response: for each channel the number of thresholds at or below the exposure, found
// from what it is at the start of the exposure's cell. Twin: src/core/compose/tonemap.rs. One invocation makes four pixels,
// which are three whole words.

struct TonemapParams {
    // Groups of four pixels.
    quads: u32,
    // The first cell of the start table.
    first_cell: u32,
    // Seconds of the shown exposure, at unit gain.
    exposure_s: f32,
    // 32-bit floats of the picture.
    floats: u32,
}

@group(0) @binding(0) var<uniform> params: TonemapParams;
// A row of 256 for each channel, never decreasing; the last is infinite.
@group(0) @binding(1) var thresholds: texture_2d<f32>;
// For each cell of exposures the value at its lower end, a byte for each channel.
@group(0) @binding(2) var starts: texture_2d<u32>;
@group(0) @binding(3) var<storage, read> radiance: array<f32>;
@group(0) @binding(4) var<storage, read_write> display: array<u32>;

const LANES = 64u;
const CELLS_A_ROW = 256u;
const CELLS = 16384u;
const CELL_SHIFT = 15u;
const LARGEST_FINITE = 3.4028235e38;

fn encode(channel: u32, exposure: f32) -> u32 {
    // Also false for what is not a number.
    if !(exposure > 0.0) {
        return 0u;
    }
    let known = min(exposure, LARGEST_FINITE);
    let bits = bitcast<u32>(known) >> CELL_SHIFT;
    let cell = min(max(bits, params.first_cell) - params.first_cell, CELLS - 1u);
    let start = textureLoad(starts, vec2<u32>(cell % CELLS_A_ROW, cell / CELLS_A_ROW), 0).x;
    var z = (start >> (8u * channel)) & 255u;
    // Hardly ever is there more than one step in a cell.
    while textureLoad(thresholds, vec2<u32>(z, channel), 0).x <= known {
        z += 1u;
    }
    return z;
}

@compute @workgroup_size(LANES)
fn tonemap(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let quad = id.y * groups.x * LANES + id.x;
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
