// Radiance samples to SH coefficients of radiance: L_lm = sum of w L(d) y_lm(d), w the solid angle.
// The order of all sums is fixed by the sample numbers alone, so that every run gives the same bits.
// Twin: src/core/light/project_sh.rs.

struct ProjectParams {
    samples: u32,
    order: u32,
    // Rows of partial sums before this part's, and in all.
    first_partial: u32,
    partials: u32,
    // Rounds of 64 samples that one workgroup sums, and groups of 4 samples in a round.
    rounds: u32,
    groups: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> params: ProjectParams;
@group(0) @binding(1) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> radiance: array<vec4<f32>>;
// Rows of 36: one row for 256 samples.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> coefficients: array<vec4<f32>>;

const LANES = 64u;
const COEFFICIENTS = 36u;

// Basis functions and weighted light of 64 samples.
var<workgroup> basis: array<f32, 2304>;
var<workgroup> weighted: array<vec4<f32>, 64>;

// As the twin's leaf of 256 samples: sample 4 g + j goes to running sum j, and the four are added in pairs.
// The numbers of rounds and groups come from the host, so that no compiler unrolls these loops.
@compute @workgroup_size(64)
fn partial_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var sum_0 = vec3<f32>(0.0);
    var sum_1 = vec3<f32>(0.0);
    var sum_2 = vec3<f32>(0.0);
    var sum_3 = vec3<f32>(0.0);
    let at = lane * COEFFICIENTS;
    for (var round = 0u; round < params.rounds; round += 1u) {
        let sample = (group.x * params.rounds + round) * LANES + lane;
        // Lanes beyond the last sample get no light and an arbitrary direction.
        var direction = vec4<f32>(0.0, 0.0, 1.0, 0.0);
        var light = vec3<f32>(0.0);
        if sample < params.samples {
            direction = directions[sample];
            light = radiance[sample].xyz * direction.w;
        }
        weighted[lane] = vec4<f32>(light, 0.0);
        let y = sh_low(direction.xyz);
        basis[at + 0u] = y[0];
        basis[at + 1u] = y[1];
        basis[at + 2u] = y[2];
        basis[at + 3u] = y[3];
        basis[at + 4u] = y[4];
        basis[at + 5u] = y[5];
        basis[at + 6u] = y[6];
        basis[at + 7u] = y[7];
        basis[at + 8u] = y[8];
        basis[at + 9u] = y[9];
        basis[at + 10u] = y[10];
        basis[at + 11u] = y[11];
        basis[at + 12u] = y[12];
        basis[at + 13u] = y[13];
        basis[at + 14u] = y[14];
        basis[at + 15u] = y[15];
        if params.order > 4u {
            let h = sh_high(direction.xyz);
            basis[at + 16u] = h[0];
            basis[at + 17u] = h[1];
            basis[at + 18u] = h[2];
            basis[at + 19u] = h[3];
            basis[at + 20u] = h[4];
            basis[at + 21u] = h[5];
            basis[at + 22u] = h[6];
            basis[at + 23u] = h[7];
            basis[at + 24u] = h[8];
            basis[at + 25u] = h[9];
            basis[at + 26u] = h[10];
            basis[at + 27u] = h[11];
            basis[at + 28u] = h[12];
            basis[at + 29u] = h[13];
            basis[at + 30u] = h[14];
            basis[at + 31u] = h[15];
            basis[at + 32u] = h[16];
            basis[at + 33u] = h[17];
            basis[at + 34u] = h[18];
            basis[at + 35u] = h[19];
        }
        workgroupBarrier();
        if lane < params.order * params.order {
            for (var g = 0u; g < params.groups; g += 1u) {
                let s = 4u * g;
                let first = s * COEFFICIENTS + lane;
                sum_0 += weighted[s].xyz * basis[first];
                sum_1 += weighted[s + 1u].xyz * basis[first + COEFFICIENTS];
                sum_2 += weighted[s + 2u].xyz * basis[first + 2u * COEFFICIENTS];
                sum_3 += weighted[s + 3u].xyz * basis[first + 3u * COEFFICIENTS];
            }
        }
        workgroupBarrier();
    }
    if lane < params.order * params.order {
        let row = params.first_partial + group.x;
        partials[row * COEFFICIENTS + lane] = vec4<f32>((sum_0 + sum_2) + (sum_1 + sum_3), 0.0);
    }
}

@compute @workgroup_size(64)
fn total(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var sum = vec4<f32>(0.0);
    for (var row = lane; row < params.partials; row += LANES) {
        sum += partials[row * COEFFICIENTS + group.x];
    }
    weighted[lane] = sum;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            weighted[lane] += weighted[lane + half];
        }
    }
    if lane == 0u {
        coefficients[group.x] = weighted[0];
    }
}
