// Exposures to linear radiance: ln E = sum w(z) (g(z) - ln t) / sum w(z), Eq. 6 of [DM97], with the hat weight
// and the bounds of channels that are 0 or 255 in every picture. Twin: src/core/hdr/merge_bracket.rs.
// One invocation merges four pixels, because four pixels are three whole words of packed bytes.
// merge_sensor does the same for pictures of 16 bits, linear in light: E = sum w (z - black) f / sum w.

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
// For each picture, channel and value: w(z) (g(z) - ln t). For merge_sensor 8 numbers a picture: weight, black, saturation, fall
// of the weight towards it, half a step, and the radiance of a value of 1 in each channel.
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

// The flags of four pixels: those of each one's channels together.
fn packed_flags(a: vec4<u32>, b: vec4<u32>, c: vec4<u32>) -> u32 {
    return (a.x | a.y | a.z) | ((a.w | b.x | b.y) << 8u)
        | ((b.z | b.w | c.x) << 16u) | ((c.y | c.z | c.w) << 24u);
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
    flags[quad] = packed_flags(first.flags, second.flags, third.flags);
}

// Values of 16 bits, and what is known of them.
const UNSEEN = 0u;
const LARGEST = 3.4028235e38;
const TERMS = 8u;

// Merges four neighbouring values of 16 bits: the two words from `place` on of every picture.
fn merge_values(place: u32, channels: vec4<u32>) -> Merged {
    var sum = vec4<f32>(0.0);
    var weight_sum = vec4<f32>(0.0);
    var at_least = vec4<f32>(0.0);
    var least = vec4<f32>(LARGEST);
    for (var k = 0u; k < params.pictures; k += 1u) {
        let word = k * params.picture_words + place;
        let pair = vec2<u32>(pictures[word], pictures[word + 1u]);
        let values = vec4<u32>(pair.x & 0xffffu, pair.x >> 16u, pair.y & 0xffffu, pair.y >> 16u);
        let z = vec4<f32>(values);
        let at = k * TERMS;
        let black = tables[at + 1u];
        let saturated = tables[at + 2u];
        let places = vec4<u32>(at + 5u) + channels;
        let factor = vec4<f32>(tables[places.x], tables[places.y], tables[places.z], tables[places.w]);
        let is_seen = values != vec4<u32>(UNSEEN);
        let below = clamp((saturated - z) * tables[at + 3u], vec4<f32>(0.0), vec4<f32>(1.0));
        let weight = select(vec4<f32>(0.0), tables[at] * below * below, is_seen);
        let counts = weight > vec4<f32>(0.0);
        sum += weight * ((z - black) * factor);
        weight_sum += weight;
        at_least = max(at_least, select(vec4<f32>(0.0), (saturated - black) * factor, is_seen & !counts));
        least = min(least, select(vec4<f32>(LARGEST), tables[at + 4u] * factor, counts));
    }
    let is_known = weight_sum > vec4<f32>(0.0);
    let mean = sum / select(vec4<f32>(1.0), weight_sum, is_known);
    let is_dark = select(vec4<u32>(0u), vec4<u32>(UPPER_BOUND), mean < least);
    let is_bound = select(vec4<u32>(LOWER_BOUND | UPPER_BOUND), vec4<u32>(LOWER_BOUND), at_least > vec4<f32>(0.0));
    return Merged(select(at_least, max(mean, vec4<f32>(0.0)), is_known), select(is_bound, is_dark, is_known));
}

@compute @workgroup_size(64)
fn merge_sensor(@builtin(global_invocation_id) id: vec3<u32>) {
    let quad = id.y * params.row + id.x;
    if quad >= params.quads {
        return;
    }
    let first = merge_values(quad * 6u, vec4<u32>(0u, 1u, 2u, 0u));
    let second = merge_values(quad * 6u + 2u, vec4<u32>(1u, 2u, 0u, 1u));
    let third = merge_values(quad * 6u + 4u, vec4<u32>(2u, 0u, 1u, 2u));
    radiance[quad * 3u] = first.radiance;
    radiance[quad * 3u + 1u] = second.radiance;
    radiance[quad * 3u + 2u] = third.radiance;
    flags[quad] = packed_flags(first.flags, second.flags, third.flags);
}
