// How much of its directions spheres hide from a receiver, every rung but `directions`. Twin: src/core/visibility/blockers/mod.rs.
// Needs shared/sh_product and two uniforms of the structs below, `blockers` and `tables`, which Rust fills.

struct BlockerTerms {
    // Centre (world frame, metres) and radius.
    spheres: array<vec4<f32>, 256>,
    // Body of sphere 4 i + k in component k.
    bodies: array<vec4<u32>, 64>,
    // Spheres, rung (below), 0, 0.
    counts: vec4<u32>,
}

// What depends on SH_ORDER alone.
struct BlockerTables {
    // Pairs of rings, 0, 0, 0.
    counts: vec4<u32>,
    // (a, b) of Eq. 24 of [Now11] at nodes 2 i and 2 i + 1.
    response: array<vec4<f32>, 21>,
    // Logarithm of one cap over q = 1 - cos in 512 steps: g_l sqrt(4 pi/(2l+1)) / q of bands 0 to 3.
    logarithms: array<vec4<f32>, 513>,
    // The same of bands 4 and 5, in steps 2 i and 2 i + 1.
    logarithms_high: array<vec4<f32>, 257>,
    rings: array<Ring, 4>,
}

const RUNG_DC = 0u;
const RUNG_LINEAR = 1u;
const RUNG_HYBRID = 2u;
const RUNG_SQUARED = 3u;
const RUNG_CHAIN = 4u;

// The receiver belongs to no body.
const NO_BODY = 0xffffffffu;

// Spheres, the first of the list, whose caps are tested for lying in each other.
const TESTED = 64u;

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
    let sine = sqrt(cap.sine_squared);
    for (var k = 0u; k < min(blockers.counts.x, TESTED); k += 1u) {
        if k == i {
            continue;
        }
        let other = blocker_cap(k, point_world, normal, body);
        let larger = other.q > cap.q || (other.q == cap.q && k < i);
        let sines = sine * sqrt(other.sine_squared);
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
    let low = tables.response[node / 2u];
    let high = tables.response[(node + 1u) / 2u];
    let from_node = select(low.xy, low.zw, node % 2u == 1u);
    let to_node = select(high.zw, high.xy, node % 2u == 1u);
    return mix(from_node, to_node, position - f32(node));
}

// A cap's logarithm, from the table.
fn blocker_logarithm(cap: Cap) -> Sh {
    let position = min(cap.q * 512.0, 512.0);
    let row = min(u32(position), 511u);
    let part = position - f32(row);
    let low = mix(tables.logarithms[row], tables.logarithms[row + 1u], part) * cap.q;
    var high = vec2<f32>(0.0);
    if SH_ORDER > 4u {
        let from_row = tables.logarithms_high[row / 2u];
        let to_row = tables.logarithms_high[(row + 1u) / 2u];
        let is_odd = row % 2u == 1u;
        high = mix(select(from_row.xy, from_row.zw, is_odd), select(to_row.zw, to_row.xy, is_odd), part) * cap.q;
    }
    return sh_bands(sh_of(cap.axis), low, high);
}

// What a cap leaves visible (Eq. 23 of [Now11], exact): -2 pi R P_l'(c) / (l (l + 1)), ready to be turned.
fn blocker_visible(cap: Cap) -> Sh {
    let c = cap.cosine;
    let slope2 = 3.0 * c;
    let slope3 = 2.5 * c * slope2 - 1.5;
    let half = -0.5 * FOUR_PI * cap.sine_squared;
    let low = vec4<f32>(FOUR_PI - 0.5 * FOUR_PI * cap.q, half * vec3<f32>(1.0, slope2, slope3) / vec3<f32>(2.0, 6.0, 12.0));
    let slope4 = (7.0 * c * slope3 - 4.0 * slope2) / 3.0;
    let slope5 = (9.0 * c * slope4 - 5.0 * slope3) / 4.0;
    return sh_bands(sh_of(cap.axis), low, half * vec2<f32>(slope4, slope5) / vec2<f32>(20.0, 30.0));
}

// The truncated product (Eq. 4 of [Now11]).
fn blocker_product(f: Sh, g: Sh) -> Sh {
    var out = Sh();
    for (var i = 0u; i < tables.counts.x; i += 1u) {
        out = sh_product_on(tables.rings[i], f, g, out);
    }
    return out;
}

// The exponential of a sum of logarithms: Eq. 24, or scaling and squaring.
fn blocker_exponential(g: Sh, rung: u32) -> Sh {
    let norm = sh_norm_above_mean(g);
    var scale = 1.0;
    var squarings = 0u;
    let limit = select(1.0, 0.5, rung == RUNG_SQUARED);
    while rung != RUNG_LINEAR && norm * scale > limit && squarings < 24u {
        scale *= 0.5;
        squarings += 1u;
    }
    let mean = g[0].x * scale / WHOLE;
    var v: Sh;
    if rung == RUNG_SQUARED {
        var rest = sh_add(Sh(), g, scale);
        rest[0].x = 0.0;
        v = sh_add(rest, blocker_product(rest, rest), 0.5);
        v[0].x += WHOLE;
        v = sh_add(Sh(), v, exp(mean));
    } else {
        let ab = blocker_response(norm * scale);
        let both = exp(mean + log(ab.x));
        v = sh_add(Sh(), g, both * (ab.y / ab.x) * scale);
        v[0].x = both * WHOLE;
    }
    for (var step = 0u; step < squarings; step += 1u) {
        v = sh_guard(blocker_product(v, v));
    }
    return sh_guard(v);
}

// 1 - V of a receiver, exactly 0 where nothing blocks: a point and a unit normal in the world frame, and its body or
// NO_BODY. Any rung but `directions`.
fn blocker_blocked(point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> Sh {
    let rung = blockers.counts.y;
    var sum = Sh();
    let multiplies = rung == RUNG_DC || rung == RUNG_CHAIN;
    sum[0].x = select(0.0, WHOLE, multiplies);
    var any = false;
    for (var i = 0u; i < blockers.counts.x; i += 1u) {
        let cap = blocker_cap(i, point_world, normal, body);
        if cap.q == 0.0 || (i < TESTED && blocker_is_contained(i, cap, point_world, normal, body)) {
            continue;
        }
        any = true;
        if rung == RUNG_DC {
            sum[0].x *= 1.0 - 0.5 * cap.q;
        } else if rung == RUNG_CHAIN {
            sum = sh_guard(blocker_product(sum, blocker_visible(cap)));
        } else {
            sum = sh_add(sum, blocker_logarithm(cap), 1.0);
        }
    }
    if !any {
        return Sh();
    }
    if !multiplies {
        sum = blocker_exponential(sum, rung);
    }
    var blocked = sh_add(Sh(), sum, -1.0);
    blocked[0].x += WHOLE;
    return blocked;
}
