// How much of its directions spheres hide from a receiver, orders 2 to 4, every rung but `directions`. Twin: src/visibility/blockers/mod.rs.
// Needs shared/sh_basis and a uniform `blockers` of the struct below, which Rust fills with `BlockerTerms`.

struct BlockerTerms {
    // Centre (world frame, metres) and radius.
    spheres: array<vec4<f32>, 64>,
    // Body of sphere 4 i + k in component k.
    bodies: array<vec4<u32>, 16>,
    // Spheres, rung (below), order (2 to 4), entries of gamma.
    counts: vec4<u32>,
    // (a, b) of Eq. 24 of [Now11] at nodes 2 i and 2 i + 1.
    response: array<vec4<f32>, 21>,
    // Logarithm of one cap over q = 1 - cos in 512 steps: g_l sqrt(4 pi/(2l+1)) / q of bands 0 to 3.
    logarithms: array<vec4<f32>, 513>,
    // i + 16 j + 256 k, the bits of the integral of y_i y_j y_k: two entries each.
    gamma: array<vec4<u32>, 39>,
}

const RUNG_DC = 0u;
const RUNG_LINEAR = 1u;
const RUNG_HYBRID = 2u;
const RUNG_SQUARED = 3u;
const RUNG_CHAIN = 4u;

// The receiver belongs to no body.
const NO_BODY = 0xffffffffu;

const WHOLE = 3.5449077;
const FOUR_PI = 12.5663706;
const SMALLEST_CAP = 1e-7;
const TOUCHING = 5e-7;

struct Cap {
    axis: vec3<f32>,
    // sin^2 of the half angle, its cosine, and 1 - cosine (0: nothing is hidden).
    sine_squared: f32,
    cosine: f32,
    q: f32,
}

// The cap that sphere i hides from a receiver.
fn blocker_cap(i: u32, point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> Cap {
    var cap = Cap(normal, 0.0, 1.0, 0.0);
    let sphere = blockers.spheres[i];
    let own = blockers.bodies[i / 4u][i % 4u];
    let to = sphere.xyz - point_world;
    if own == body || !(dot(to, normal) > -sphere.w) {
        return cap;
    }
    let square = dot(to, to);
    cap.sine_squared = 1.0;
    if square > 1e-30 {
        let inverse = 1.0 / sqrt(square);
        let ratio = sphere.w * inverse;
        cap.axis = to * inverse;
        cap.sine_squared = min(ratio * ratio, 1.0);
    }
    cap.cosine = sqrt(1.0 - cap.sine_squared);
    cap.q = cap.sine_squared / (1.0 + cap.cosine);
    if cap.q <= SMALLEST_CAP {
        return Cap(normal, 0.0, 1.0, 0.0);
    }
    return cap;
}

// Whether cap i lies in another one; of equal ones the first stays.
fn blocker_is_contained(i: u32, cap: Cap, point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> bool {
    for (var k = 0u; k < blockers.counts.x; k += 1u) {
        if k == i {
            continue;
        }
        let other = blocker_cap(k, point_world, normal, body);
        let larger = other.q > cap.q || (other.q == cap.q && k < i);
        let sines = sqrt(cap.sine_squared) * sqrt(other.sine_squared);
        if larger && dot(cap.axis, other.axis) + TOUCHING >= cap.cosine * other.cosine + sines {
            return true;
        }
    }
    return false;
}

// (a, b) of Eq. 24 at x >= 0.
fn blocker_response(x: f32) -> vec2<f32> {
    var position = (x - 8.0) * 0.5 + 28.0;
    if x < 8.0 {
        position = (x - 2.0) * 2.0 + 16.0;
    }
    if x < 2.0 {
        position = x * 8.0;
    }
    position = min(position, 40.0);
    let node = min(u32(position), 39u);
    let low = blockers.response[node / 2u];
    let high = blockers.response[(node + 1u) / 2u];
    let from_node = select(low.xy, low.zw, node % 2u == 1u);
    let to_node = select(high.zw, high.xy, node % 2u == 1u);
    return mix(from_node, to_node, position - f32(node));
}

// Bands 0 to 3 of a cap's logarithm, ready to be turned.
fn blocker_logarithm(q: f32) -> vec4<f32> {
    let position = min(q * 512.0, 512.0);
    let row = min(u32(position), 511u);
    return mix(blockers.logarithms[row], blockers.logarithms[row + 1u], position - f32(row)) * q;
}

// Bands 0 to 3 of what a cap leaves visible, ready to be turned (Eq. 23 of [Now11], exact).
fn blocker_visible(cap: Cap) -> vec4<f32> {
    let c = cap.cosine;
    let slope = vec3<f32>(1.0, 3.0 * c, 7.5 * c * c - 1.5) / vec3<f32>(2.0, 6.0, 12.0);
    return vec4<f32>(FOUR_PI - 0.5 * FOUR_PI * cap.q, -0.5 * FOUR_PI * cap.sine_squared * slope);
}

// Zonal bands turned to an axis: the coefficients of bands beyond the order are 0.
fn blocker_turn(bands: vec4<f32>, axis: vec3<f32>) -> array<f32, 16> {
    var y = sh_low(axis);
    let kept = bands * select(vec4<f32>(0.0), vec4<f32>(1.0), vec4<u32>(0u, 1u, 2u, 3u) < vec4<u32>(blockers.counts.z));
    for (var i = 0u; i < 16u; i += 1u) {
        let band = select(select(select(kept.w, kept.z, i < 9u), kept.y, i < 4u), kept.x, i < 1u);
        y[i] *= band;
    }
    return y;
}

// The truncated product (Eq. 4 of [Now11]).
fn blocker_product(f_in: array<f32, 16>, g_in: array<f32, 16>) -> array<f32, 16> {
    var f = f_in;
    var g = g_in;
    var out = array<f32, 16>();
    let entries = blockers.counts.w;
    for (var entry = 0u; entry < entries; entry += 1u) {
        let pair = blockers.gamma[entry / 2u];
        let own = select(pair.xy, pair.zw, entry % 2u == 1u);
        let packed = own.x;
        let integral = bitcast<f32>(own.y);
        let i = packed & 15u;
        let j = (packed >> 4u) & 15u;
        let k = (packed >> 8u) & 15u;
        // Each different choice of the output index once.
        out[k] += integral * select(f[i] * g[j] + f[j] * g[i], f[i] * g[i], i == j);
        if j != k {
            out[j] += integral * select(f[i] * g[k] + f[k] * g[i], f[i] * g[i], i == k);
        }
        if i != j {
            out[i] += integral * select(f[j] * g[k] + f[k] * g[j], f[j] * g[j], j == k);
        }
    }
    return out;
}

fn blocker_norm(v_in: array<f32, 16>) -> f32 {
    var v = v_in;
    var sum = 0.0;
    for (var i = 1u; i < 16u; i += 1u) {
        sum += v[i] * v[i];
    }
    return sqrt(sum);
}

// What 0 <= V <= 1 allows.
fn blocker_guard(v_in: array<f32, 16>) -> array<f32, 16> {
    var v = v_in;
    v[0] = clamp(v[0], 0.0, WHOLE);
    let bound = sqrt(max(v[0] * (WHOLE - v[0]), 0.0));
    let norm = blocker_norm(v);
    if norm > bound {
        for (var i = 1u; i < 16u; i += 1u) {
            v[i] *= bound / norm;
        }
    }
    return v;
}

// The exponential of a sum of logarithms: Eq. 24, or scaling and squaring.
fn blocker_exponential(g_in: array<f32, 16>, rung: u32) -> array<f32, 16> {
    var g = g_in;
    let norm = blocker_norm(g);
    var scale = 1.0;
    var squarings = 0u;
    let limit = select(1.0, 0.5, rung == RUNG_SQUARED);
    while rung != RUNG_LINEAR && norm * scale > limit && squarings < 24u {
        scale *= 0.5;
        squarings += 1u;
    }
    let mean = g[0] * scale / WHOLE;
    var v = g;
    if rung == RUNG_SQUARED {
        v[0] = 0.0;
        for (var i = 1u; i < 16u; i += 1u) {
            v[i] *= scale;
        }
        var square = blocker_product(v, v);
        v[0] = WHOLE;
        for (var i = 0u; i < 16u; i += 1u) {
            v[i] = (square[i] * 0.5 + v[i]) * exp(mean);
        }
    } else {
        let ab = blocker_response(norm * scale);
        let both = exp(mean + log(ab.x));
        v[0] = both * WHOLE;
        for (var i = 1u; i < 16u; i += 1u) {
            v[i] *= both * (ab.y / ab.x) * scale;
        }
    }
    for (var step = 0u; step < squarings; step += 1u) {
        v = blocker_guard(blocker_product(v, v));
    }
    return blocker_guard(v);
}

// 1 - V of a receiver, exactly 0 where nothing blocks: a point and a unit normal in the world frame, and its body or
// NO_BODY. Any rung but `directions`.
fn blocker_blocked(point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> array<f32, 16> {
    let rung = blockers.counts.y;
    var sum = array<f32, 16>();
    let multiplies = rung == RUNG_DC || rung == RUNG_CHAIN;
    sum[0] = select(0.0, WHOLE, multiplies);
    var any = false;
    for (var i = 0u; i < blockers.counts.x; i += 1u) {
        let cap = blocker_cap(i, point_world, normal, body);
        if cap.q == 0.0 || blocker_is_contained(i, cap, point_world, normal, body) {
            continue;
        }
        any = true;
        if rung == RUNG_DC {
            sum[0] *= 1.0 - 0.5 * cap.q;
        } else if rung == RUNG_CHAIN {
            sum = blocker_guard(blocker_product(sum, blocker_turn(blocker_visible(cap), cap.axis)));
        } else {
            var turned = blocker_turn(blocker_logarithm(cap.q), cap.axis);
            for (var k = 0u; k < 16u; k += 1u) {
                sum[k] += turned[k];
            }
        }
    }
    if !any {
        return array<f32, 16>();
    }
    if !multiplies {
        sum = blocker_exponential(sum, rung);
    }
    for (var k = 0u; k < 16u; k += 1u) {
        sum[k] = -sum[k];
    }
    sum[0] += WHOLE;
    return sum;
}
