// Radiance samples to SH coefficients of radiance: L_lm = sum of w L(d) y_lm(d), w the solid angle.
// The order of all sums is fixed by the sample numbers alone, so that every run gives the same bits.
// Twin: src/light/project_sh.rs.

struct ProjectParams {
    samples: u32,
    order: u32,
    first_partial: u32,
    partials: u32,
}

@group(0) @binding(0) var<uniform> params: ProjectParams;
@group(0) @binding(1) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> radiance: array<vec4<f32>>;
// Rows of 36: one row for 256 samples.
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> coefficients: array<vec4<f32>>;

const LANES = 64u;
const COEFFICIENTS = 36u;
// Rounds of 64 samples that one workgroup sums.
const ROUNDS = 4u;

var<workgroup> basis: array<f32, 2304>;
var<workgroup> weighted: array<vec4<f32>, 64>;

// Sums 16 samples of the round in order, for one coefficient.
fn run_of_16(first: u32, coefficient: u32) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    for (var i = first; i < first + 16u; i += 1u) {
        sum += weighted[i].xyz * basis[i * COEFFICIENTS + coefficient];
    }
    return sum;
}

@compute @workgroup_size(64)
fn partial_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var sums: array<vec3<f32>, 4>;
    for (var round = 0u; round < ROUNDS; round += 1u) {
        let sample = (group.x * ROUNDS + round) * LANES + lane;
        var light = vec4<f32>(0.0);
        if sample < params.samples {
            let direction = directions[sample];
            light = vec4<f32>(radiance[sample].xyz * direction.w, 0.0);
            let y = sh_basis(direction.xyz);
            for (var i = 0u; i < COEFFICIENTS; i += 1u) {
                basis[lane * COEFFICIENTS + i] = y[i];
            }
        } else {
            // Memory of an earlier round must not meet the zero above: it could be anything but a number.
            for (var i = 0u; i < COEFFICIENTS; i += 1u) {
                basis[lane * COEFFICIENTS + i] = 0.0;
            }
        }
        weighted[lane] = light;
        workgroupBarrier();
        if lane < params.order * params.order {
            sums[round] = (run_of_16(0u, lane) + run_of_16(16u, lane))
                + (run_of_16(32u, lane) + run_of_16(48u, lane));
        }
        workgroupBarrier();
    }
    if lane < params.order * params.order {
        let row = params.first_partial + group.x;
        let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        partials[row * COEFFICIENTS + lane] = vec4<f32>(sum, 0.0);
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
