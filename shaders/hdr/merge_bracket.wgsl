// Exposures to linear radiance: ln E = sum w(z) (g(z) - ln t) / sum w(z), Eq. 6 of [DM97], with the hat weight
// and the bounds of channels that are 0 or 255 in every picture. Twin: src/core/hdr/merge_bracket.rs.
// One invocation merges four pixels, because four pixels are three whole words of packed bytes.

struct MergeParams {
    // Groups of four pixels.
    quads: u32,
    pictures: u32,
    // Words from one picture to the next.
    picture_words: u32,
    // Invocations in one row of the dispatch.
    row: u32,
}

@group(0) @binding(0) var<uniform> params: MergeParams;
@group(0) @binding(1) var<storage, read> pictures: array<u32>;
// For each picture, channel and value: w(z) (g(z) - ln t).
@group(0) @binding(2) var<storage, read> tables: array<f32>;
@group(0) @binding(3) var<storage, read_write> radiance: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> flags: array<u32>;

const LOWER_BOUND = 1u;
const UPPER_BOUND = 2u;
const NOTHING = 1e9;

// Four neighbouring bytes, merged.
struct Merged {
    radiance: vec4<f32>,
    flags: vec4<u32>,
}

// e^x by plain multiplications and additions, as the twin does it; x is taken into -87..=88.
fn exp_plain(exponent: vec4<f32>) -> vec4<f32> {
    let x = clamp(exponent, vec4<f32>(-87.0), vec4<f32>(88.0));
    let whole = round(x * 1.44269504);
    // ln 2 in two parts; the first has 9 bits, so that the product is exact.
    let r = x - whole * 0.693359375 - whole * -2.12194440e-4;
    let q = 0.5 + r * (0.16666577 + r * (0.041666556 + r * (0.008363173 + r * 0.0013926176)));
    let power_of_two = bitcast<vec4<f32>>((vec4<i32>(whole) + 127) << vec4<u32>(23u));
    return (1.0 + (r + r * r * q)) * power_of_two;
}

fn bytes_of(word: u32) -> vec4<u32> {
    return (vec4<u32>(word) >> vec4<u32>(0u, 8u, 16u, 24u)) & vec4<u32>(255u);
}

// Merges the word at `place` of every picture; `channels` says which channel each byte is.
fn merge_word(place: u32, channels: vec4<u32>) -> Merged {
    var log_sum = vec4<f32>(0.0);
    var weight_sum = vec4<u32>(0u);
    for (var k = 0u; k < params.pictures; k += 1u) {
        let z = bytes_of(pictures[k * params.picture_words + place]);
        let at = vec4<u32>(k * 768u) + channels * 256u + z;
        log_sum += vec4<f32>(tables[at.x], tables[at.y], tables[at.z], tables[at.w]);
        weight_sum += min(z, vec4<u32>(255u) - z);
    }
    var log_radiance = log_sum / vec4<f32>(max(weight_sum, vec4<u32>(1u)));
    var out: Merged;
    if any(weight_sum == vec4<u32>(0u)) {
        for (var i = 0u; i < 4u; i += 1u) {
            if weight_sum[i] == 0u {
                let bound = bounds(place, i, channels[i]);
                log_radiance[i] = bound.log_radiance;
                out.flags[i] = bound.flag;
            }
        }
    }
    out.radiance = exp_plain(log_radiance);
    return out;
}

struct Bound {
    log_radiance: f32,
    flag: u32,
}

// A byte that is 0 or 255 in every picture: the tightest bounds, after the tables g(255) - ln t and g(0) - ln t
// for each picture and channel.
fn bounds(place: u32, byte: u32, channel: u32) -> Bound {
    var at_least = -NOTHING;
    var at_most = NOTHING;
    for (var k = 0u; k < params.pictures; k += 1u) {
        let z = bytes_of(pictures[k * params.picture_words + place])[byte];
        let at = params.pictures * 768u + (k * 3u + channel) * 2u;
        if z == 255u {
            at_least = max(at_least, tables[at]);
        } else {
            at_most = min(at_most, tables[at + 1u]);
        }
    }
    if at_most == NOTHING {
        return Bound(at_least, LOWER_BOUND);
    }
    if at_least == -NOTHING {
        return Bound(at_most, UPPER_BOUND);
    }
    return Bound(0.5 * (at_least + at_most), LOWER_BOUND | UPPER_BOUND);
}

@compute @workgroup_size(64)
fn merge(@builtin(global_invocation_id) id: vec3<u32>) {
    let quad = id.y * params.row + id.x;
    if quad >= params.quads {
        return;
    }
    let first = merge_word(quad * 3u, vec4<u32>(0u, 1u, 2u, 0u));
    let second = merge_word(quad * 3u + 1u, vec4<u32>(1u, 2u, 0u, 1u));
    let third = merge_word(quad * 3u + 2u, vec4<u32>(2u, 0u, 1u, 2u));
    radiance[quad * 3u] = first.radiance;
    radiance[quad * 3u + 1u] = second.radiance;
    radiance[quad * 3u + 2u] = third.radiance;
    let a = first.flags;
    let b = second.flags;
    let c = third.flags;
    flags[quad] = (a.x | a.y | a.z) | ((a.w | b.x | b.y) << 8u)
        | ((b.z | b.w | c.x) << 16u) | ((c.y | c.z | c.w) << 24u);
}
