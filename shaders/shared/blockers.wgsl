// How much of its directions spheres and boxes hide from a receiver, every rung but `directions`. Twin: src/core/visibility/blockers/mod.rs.
// Needs shared/sh_product and two uniforms of the structs below, `blockers` and `tables`, which Rust fills.

struct BlockerTerms {
    // Centre (world frame, metres) and radius.
    spheres: array<vec4<f32>, 256>,
    // Body of sphere 4 i + k in component k.
    bodies: array<vec4<u32>, 64>,
    // Spheres, rung (below), boxes, 0.
    counts: vec4<u32>,
    // Of each box three rows: centre (world frame, metres) and half the first extent; first axis and half the second
    // extent; second axis and half the third extent.
    boxes: array<array<vec4<f32>, 3>, 128>,
    // Body of box 4 i + k in component k.
    box_bodies: array<vec4<u32>, 32>,
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

const BOX_NOTHING = 0u;
const BOX_INSIDE = 1u;
const BOX_FACES = 2u;
// Squared distance from which a box is too far; nothing is divided by less than the second.
const BOX_FAR = 1e30;
const BOX_LEAST = 1e-30;
// A side shorter than this share of the box's longest has two nodes, any other four.
const BOX_SHORT = 0.125;

// A box as a receiver sees it. Twin: src/core/visibility/blockers/boxes.rs.
struct SeenBox {
    kind: u32,
    axes: array<vec3<f32>, 3>,
    // From the receiver to the centre along each axis, half the extents, the normal.
    at: vec3<f32>,
    half: vec3<f32>,
    up: vec3<f32>,
}

// A face of it: unit axes along its sides and straight to its plane, where it begins and ends along the first two, how
// far its plane is (0: there is no such face), and half its sides over the box's longest.
struct SeenFace {
    axes: array<vec3<f32>, 3>,
    low: vec2<f32>,
    high: vec2<f32>,
    depth: f32,
    short: vec2<f32>,
}

fn seen_box(i: u32, point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> SeenBox {
    let rows = blockers.boxes[i];
    var seen: SeenBox;
    seen.kind = BOX_NOTHING;
    seen.axes = array<vec3<f32>, 3>(rows[1].xyz, rows[2].xyz, cross(rows[1].xyz, rows[2].xyz));
    seen.half = vec3<f32>(rows[0].w, rows[1].w, rows[2].w);
    let to = rows[0].xyz - point_world;
    seen.at = vec3<f32>(dot(seen.axes[0], to), dot(seen.axes[1], to), dot(seen.axes[2], to));
    seen.up = vec3<f32>(dot(seen.axes[0], normal), dot(seen.axes[1], normal), dot(seen.axes[2], normal));
    if blockers.box_bodies[i / 4u][i % 4u] == body || !(dot(seen.at, seen.up) + dot(seen.half, abs(seen.up)) > 0.0)
        || !(dot(to, to) < BOX_FAR) {
        return seen;
    }
    seen.kind = select(BOX_FACES, BOX_INSIDE, all(abs(seen.at) <= seen.half));
    return seen;
}

fn seen_face(seen: SeenBox, k: u32) -> SeenFace {
    let i = (k + 1u) % 3u;
    let j = (k + 2u) % 3u;
    let side = select(1.0, -1.0, seen.at[k] < 0.0);
    var face: SeenFace;
    face.axes = array<vec3<f32>, 3>(seen.axes[i], seen.axes[j], seen.axes[k] * side);
    face.low = vec2<f32>(seen.at[i] - seen.half[i], seen.at[j] - seen.half[j]);
    face.high = vec2<f32>(seen.at[i] + seen.half[i], seen.at[j] + seen.half[j]);
    face.depth = max(abs(seen.at[k]) - seen.half[k], 0.0);
    let height = face.depth * side * seen.up[k] + seen.at[i] * seen.up[i] + seen.at[j] * seen.up[j]
        + seen.half[i] * abs(seen.up[i]) + seen.half[j] * abs(seen.up[j]);
    if !(height > 0.0) {
        face.depth = 0.0;
    }
    let longest = max(seen.half.x, max(seen.half.y, seen.half.z));
    face.short = vec2<f32>(seen.half[i], seen.half[j]) / longest;
    return face;
}

// Node and weight of the Gauss-Legendre rule on 0 to 1, of two or four nodes.
fn box_node(k: u32, is_short: bool) -> vec2<f32> {
    if is_short {
        return vec2<f32>(select(0.21132487, 0.78867513, k == 1u), 0.5);
    }
    let outer = k == 0u || k == 3u;
    let node = select(0.33000948, 0.06943184, outer);
    return vec2<f32>(select(node, 1.0 - node, k > 1u), select(0.32607258, 0.17392742, outer));
}

fn face_along(y: f32, z: f32, cosine: f32) -> f32 {
    return y * cosine / max(sqrt(z * z + y * y * cosine * cosine), BOX_LEAST);
}

// The integral of each y_i over the solid angle of a face, added.
fn face_hidden(face: SeenFace, before: Sh) -> Sh {
    var out = before;
    let z = face.depth;
    let first = atan2(face.low.x, z);
    let span = atan2(z * (face.high.x - face.low.x), z * z + face.low.x * face.high.x);
    let is_short = face.short < vec2<f32>(BOX_SHORT);
    for (var i = 0u; i < select(4u, 2u, is_short.x); i += 1u) {
        let t = box_node(i, is_short.x);
        let angle = first + t.x * span;
        let begin = face_along(face.low.y, z, cos(angle));
        let size = face_along(face.high.y, z, cos(angle)) - begin;
        for (var j = 0u; j < select(4u, 2u, is_short.y); j += 1u) {
            let u = box_node(j, is_short.y);
            let h = begin + u.x * size;
            let across = sqrt(max(1.0 - h * h, 0.0));
            let w = face.axes[0] * (across * sin(angle)) + face.axes[1] * h + face.axes[2] * (across * cos(angle));
            out = sh_add(out, sh_of(w), t.y * u.y * span * size);
        }
    }
    return out;
}

// The integral of each y_i over what box i hides from a receiver.
fn box_hidden(i: u32, point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> Sh {
    let seen = seen_box(i, point_world, normal, body);
    var out = Sh();
    if seen.kind == BOX_INSIDE {
        // A hemisphere: 2 pi P_l'(0) / (l (l + 1)).
        let half = 0.5 * FOUR_PI;
        return sh_bands(sh_of(normal), half * vec4<f32>(1.0, 0.5, 0.0, -0.125), half * vec2<f32>(0.0, 0.0625));
    }
    if seen.kind == BOX_FACES {
        for (var k = 0u; k < 3u; k += 1u) {
            let face = seen_face(seen, k);
            if face.depth > 0.0 {
                out = face_hidden(face, out);
            }
        }
    }
    return out;
}

// V without what the boxes hide, of `dc` its mean alone.
fn without_boxes(v: Sh, point_world: vec3<f32>, normal: vec3<f32>, body: u32) -> Sh {
    var out = v;
    for (var i = 0u; i < blockers.counts.z; i += 1u) {
        let hidden = box_hidden(i, point_world, normal, body);
        if !(hidden[0].x > 0.0) {
            continue;
        }
        var open = sh_add(Sh(), hidden, -1.0);
        open[0].x = max(open[0].x + WHOLE, 0.0);
        if blockers.counts.y == RUNG_DC {
            out[0].x *= open[0].x / WHOLE;
        } else {
            out = sh_guard(blocker_product(out, open));
        }
    }
    return out;
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
        sum = Sh();
        sum[0].x = WHOLE;
    } else if !multiplies {
        sum = blocker_exponential(sum, rung);
    }
    sum = without_boxes(sum, point_world, normal, body);
    var blocked = sh_add(Sh(), sum, -1.0);
    blocked[0].x += WHOLE;
    return blocked;
}
