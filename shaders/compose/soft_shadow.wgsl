// What spheres and boxes, in place of virtual objects, take of the soft light on real surfaces: (r, g, b) of irradiance / pi and
// the inverse depth, as bits of four floats, in a picture of every n-th pixel. One fragment stage for the rung
// `directions`, one for all others; or the same in vertex stages, over a grid (src/core/compose/soft_grid.rs), interpolated.
// Twin: src/core/compose/soft_shadow.rs (over src/core/visibility/blockers).

struct SoftTerms {
    // Directions, 0, 0, 0.
    counts: vec4<u32>,
    // h, sin(h/2), 4 pi / N, 0.
    softness: vec4<f32>,
    // sqrt(4 pi / (2 l + 1)) z_l of Lambert: bands 0 to 3, and 4 to 5.
    bands_low: vec4<f32>,
    bands_high: vec4<f32>,
    // Unit directions, four by four: x of four of them, y, z.
    directions: array<vec4<f32>, 192>,
    // Mean of y_i over the directions (0 for i = 0), four a row.
    means: array<vec4<f32>, 9>,
    // M^{L_g}, rows i, columns k <= i.
    matrix: array<vec4<f32>, 666>,
}

// Up to three normals of flat receivers, and what a direction (rung `directions`) or a coefficient of V (the others) that
// is blocked takes there: those of normal p from 256 p on.
struct PlaneTerms {
    // Normals, 0, 0, 0.
    counts: vec4<u32>,
    normals: array<vec4<f32>, 3>,
    weights: array<vec4<f32>, 768>,
}

const NO_PLANE = 0xffffffffu;
// Cosine of 0.6 mrad.
const SAME_NORMAL = 0.9999998;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> soft: SoftTerms;
@group(0) @binding(2) var<uniform> blockers: BlockerTerms;
@group(0) @binding(3) var<uniform> tables: BlockerTables;
@group(0) @binding(4) var<uniform> planes: PlaneTerms;

struct Seen {
    @builtin(position) clip: vec4<f32>,
    @location(0) point_world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // 1 where virtual shadows fall on the surface, else 0.
    @location(2) receives: f32,
    // What was found at the vertices, where it is.
    @location(3) taken: vec3<f32>,
}

fn placed(position: vec4<f32>, normal: vec3<f32>) -> Seen {
    var seen: Seen;
    seen.clip = clip_position(view, position.xyz, 1.0);
    seen.point_world = position.xyz;
    seen.normal = normal;
    seen.receives = position.w;
    seen.taken = vec3<f32>(0.0);
    return seen;
}

@vertex
fn vertex(@location(0) position: vec4<f32>, @location(1) normal: vec3<f32>) -> Seen {
    return placed(position, normal);
}

// The same, evaluated here: rung `directions`.
@vertex
fn vertex_directions(@location(0) position: vec4<f32>, @location(1) normal: vec3<f32>) -> Seen {
    var seen = placed(position, normal);
    if position.w > 0.5 {
        seen.taken = directed(position.xyz, normalize(normal));
    }
    return seen;
}

// The other rungs.
@vertex
fn vertex_ladder(@location(0) position: vec4<f32>, @location(1) normal: vec3<f32>) -> Seen {
    var seen = placed(position, normal);
    if position.w > 0.5 {
        seen.taken = laddered(position.xyz, normalize(normal));
    }
    return seen;
}

@fragment
fn interpolated(seen: Seen) -> @location(0) vec4<u32> {
    return picture(seen, seen.taken);
}

// Rung `directions`.
@fragment
fn fragment(seen: Seen, @builtin(front_facing) front: bool) -> @location(0) vec4<u32> {
    var out = vec3<f32>(0.0);
    let normal = receiver_normal(seen, front);
    if seen.receives > 0.5 {
        out = directed(seen.point_world, normal);
    }
    return picture(seen, out);
}

// The other rungs.
@fragment
fn ladder(seen: Seen, @builtin(front_facing) front: bool) -> @location(0) vec4<u32> {
    var out = vec3<f32>(0.0);
    let normal = receiver_normal(seen, front);
    if seen.receives > 0.5 {
        out = laddered(seen.point_world, normal);
    }
    return picture(seen, out);
}

fn directed(point_world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let first = plane_of(normal);
    if first == NO_PLANE {
        return taken(point_world, normal);
    }
    return taken_on_plane(first, point_world, normal);
}

fn laddered(point_world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    var blocked = blocker_blocked(point_world, normal, NO_BODY);
    let first = plane_of(normal);
    if first == NO_PLANE {
        return radiated(blocked, normal);
    }
    var out = vec3<f32>(0.0);
    for (var row = 0u; row < (SH_ORDER * SH_ORDER + 3u) / 4u; row += 1u) {
        let at = first + 4u * row;
        let four = blocked[row];
        out += four.x * planes.weights[at].xyz + four.y * planes.weights[at + 1u].xyz
            + four.z * planes.weights[at + 2u].xyz + four.w * planes.weights[at + 3u].xyz;
    }
    return out;
}

fn receiver_normal(seen: Seen, front: bool) -> vec3<f32> {
    let facet = facet_normal(seen.point_world - view.eye.xyz, seen.clip.w);
    if dot(seen.normal, seen.normal) > 0.0 {
        return normalize(seen.normal) * select(-1.0, 1.0, front);
    }
    return facet;
}

fn picture(seen: Seen, out: vec3<f32>) -> vec4<u32> {
    let inverse_depth = 1.0 / dot(view.forward.xyz, seen.point_world - view.eye.xyz);
    return vec4<u32>(bitcast<vec3<u32>>(out), bitcast<u32>(inverse_depth));
}

// Where the weights of a receiver's plane begin, or NO_PLANE.
fn plane_of(normal: vec3<f32>) -> u32 {
    for (var p = 0u; p < planes.counts.x; p += 1u) {
        if dot(planes.normals[p].xyz, normal) > SAME_NORMAL {
            return 256u * p;
        }
    }
    return NO_PLANE;
}

// The rung `directions` on a plane: no harmonics.
fn taken_on_plane(first: u32, point_world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    for (var j = 0u; j < soft.counts.x; j += 8u) {
        let blocked = blocked_eight(j, point_world, normal);
        for (var k = 0u; k < 4u; k += 1u) {
            sum += blocked[0][k] * planes.weights[first + j + k].xyz;
            sum += blocked[1][k] * planes.weights[first + j + 4u + k].xyz;
        }
    }
    return sum;
}

// The shares of directions j to j + 7 that are blocked (j is a multiple of 8; beyond the last direction 0): what a sphere
// hides is found once for all eight.
fn blocked_eight(j: u32, point_world: vec3<f32>, normal: vec3<f32>) -> array<vec4<f32>, 2> {
    let at = 3u * (j / 4u);
    let ax = soft.directions[at];
    let ay = soft.directions[at + 1u];
    let az = soft.directions[at + 2u];
    let bx = soft.directions[at + 3u];
    let by = soft.directions[at + 4u];
    let bz = soft.directions[at + 5u];
    var a = vec4<f32>(1.0);
    var b = vec4<f32>(1.0);
    for (var s = 0u; s < blockers.counts.x; s += 1u) {
        let sphere = blockers.spheres[s];
        let to = sphere.xyz - point_world;
        let square = dot(to, to);
        // Wholly under the horizon, or not in reach of any direction.
        if dot(to, normal) > -sphere.w {
            var axis = normal;
            var sine_squared = 1.0;
            if square > 1e-30 {
                axis = to * inverseSqrt(square);
                sine_squared = min(sphere.w * sphere.w / square, 1.0);
            }
            let cosine = sqrt(1.0 - sine_squared);
            let q = sine_squared / (1.0 + cosine);
            if q <= SMALLEST_CAP {
                continue;
            }
            let slope = 1.0 / (soft.softness.x * max(sqrt(sine_squared), soft.softness.y));
            // Caps narrower than the ramp hide their own solid angle in the mean.
            let e = 0.5 / slope;
            let share = select(1.0, 4.0 * q * e / ((q + e) * (q + e)), q < e);
            let threshold = vec4<f32>(1.0 - share + share * (cosine * slope + 0.5));
            let along = share * slope * axis;
            a *= clamp(threshold - (along.x * ax + along.y * ay + along.z * az), vec4<f32>(0.0), vec4<f32>(1.0));
            b *= clamp(threshold - (along.x * bx + along.y * by + along.z * bz), vec4<f32>(0.0), vec4<f32>(1.0));
        }
    }
    for (var i = 0u; i < blockers.counts.z; i += 1u) {
        let seen = seen_box(i, point_world, normal, NO_BODY);
        if seen.kind == BOX_NOTHING {
            continue;
        }
        var hidden_a = vec4<f32>(0.0);
        var hidden_b = vec4<f32>(0.0);
        for (var k = 0u; k < 3u; k += 1u) {
            let face = soft_face(seen, k, normal);
            hidden_a += face_share(face, ax, ay, az);
            hidden_b += face_share(face, bx, by, bz);
        }
        a *= vec4<f32>(1.0) - min(hidden_a, vec4<f32>(1.0));
        b *= vec4<f32>(1.0) - min(hidden_b, vec4<f32>(1.0));
    }
    let number = vec4<u32>(j) + vec4<u32>(0u, 1u, 2u, 3u);
    let count = vec4<u32>(soft.counts.x);
    return array<vec4<f32>, 2>(
        select(vec4<f32>(0.0), vec4<f32>(1.0) - a, number < count),
        select(vec4<f32>(0.0), vec4<f32>(1.0) - b, number + vec4<u32>(4u) < count),
    );
}

// A face of a box as four planes through the receiver and its sides, softened for the directions. Twin: `SoftFace` of
// src/core/visibility/blockers/boxes.rs.
struct SoftFace {
    // Normals that point inwards over h.
    sides: array<vec3<f32>, 4>,
    // Cosine of the angle between the normals of two sides that face each other, how much all four are one plane, and 1 (0:
    // no such face).
    facing_joined_seen: vec4<f32>,
}

fn soft_face(seen: SeenBox, k: u32, normal: vec3<f32>) -> SoftFace {
    var soft_face: SoftFace;
    let inverse = 1.0 / soft.softness.x;
    if seen.kind == BOX_INSIDE {
        let n = normal * inverse;
        soft_face.sides = array<vec3<f32>, 4>(n, n, n, n);
        soft_face.facing_joined_seen = vec4<f32>(1.0, 1.0, 1.0, select(0.0, 1.0, k == 0u));
        return soft_face;
    }
    let face = seen_face(seen, k);
    let z = face.depth;
    if z <= 0.0 {
        return soft_face;
    }
    var joined = 1.0;
    for (var side = 0u; side < 2u; side += 1u) {
        let low = face.low[side];
        let high = face.high[side];
        let to_low = max(sqrt(low * low + z * z), BOX_LEAST);
        let to_high = max(sqrt(high * high + z * z), BOX_LEAST);
        soft_face.sides[2u * side] = (face.axes[side] * z - face.axes[2] * low) * (inverse / to_low);
        soft_face.sides[2u * side + 1u] = (face.axes[2] * high - face.axes[side] * z) * (inverse / to_high);
        soft_face.facing_joined_seen[side] = -(z * z + low * high) / (to_low * to_high);
        joined *= 0.5 * (high / to_high - low / to_low);
    }
    soft_face.facing_joined_seen.z = joined;
    soft_face.facing_joined_seen.w = 1.0;
    return soft_face;
}

// The shares of four directions that a face hides.
fn face_share(face: SoftFace, x: vec4<f32>, y: vec4<f32>, z: vec4<f32>) -> vec4<f32> {
    var inner: array<vec4<f32>, 4>;
    for (var i = 0u; i < 4u; i += 1u) {
        let n = face.sides[i];
        inner[i] = clamp(n.x * x + n.y * y + n.z * z + vec4<f32>(0.5), vec4<f32>(0.0), vec4<f32>(1.0));
    }
    let across = on_both(inner[0], inner[1], face.facing_joined_seen.x);
    let along = on_both(inner[2], inner[3], face.facing_joined_seen.y);
    return on_both(across, along, face.facing_joined_seen.z) * face.facing_joined_seen.w;
}

// The share that is on the inner side of two edges, of the shares on that of each, and the cosine between their normals.
fn on_both(a: vec4<f32>, b: vec4<f32>, cosine: f32) -> vec4<f32> {
    let extreme = select(max(a + b - vec4<f32>(1.0), vec4<f32>(0.0)), min(a, b), cosine > 0.0);
    let size = abs(cosine);
    return (1.0 - size) * (a * b) + size * extreme;
}

fn taken(point_world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    var blocked = Sh();
    var all = 0.0;
    for (var j = 0u; j < soft.counts.x; j += 8u) {
        var eight = blocked_eight(j, point_world, normal);
        for (var k = 0u; k < 8u; k += 1u) {
            let share = eight[k / 4u][k % 4u];
            if share > 0.0 {
                all += share;
                let at = 3u * ((j + k) / 4u);
                let w = vec3<f32>(
                    soft.directions[at][k % 4u],
                    soft.directions[at + 1u][k % 4u],
                    soft.directions[at + 2u][k % 4u],
                );
                blocked = sh_add(blocked, sh_of(w), share);
            }
        }
    }
    if all == 0.0 {
        return vec3<f32>(0.0);
    }
    return radiated(sh_add(blocked, soft.means, -all), normal) * soft.softness.z;
}

// What a white matt receiver radiates of the light that coefficients of blocked directions let in.
fn radiated(blocked: Sh, normal: vec3<f32>) -> vec3<f32> {
    var d = blocked;
    // The zonal lobe about the normal.
    var f = sh_bands(sh_of(normal), soft.bands_low, soft.bands_high.xy);
    var sum = vec3<f32>(0.0);
    var at = 0u;
    for (var i = 0u; i < SH_ORDER * SH_ORDER; i += 1u) {
        let d_i = d[i / 4u][i % 4u];
        let f_i = f[i / 4u][i % 4u];
        for (var k = 0u; k < i; k += 1u) {
            sum += soft.matrix[at].xyz * (d_i * f[k / 4u][k % 4u] + d[k / 4u][k % 4u] * f_i);
            at += 1u;
        }
        sum += soft.matrix[at].xyz * (d_i * f_i);
        at += 1u;
    }
    return sum;
}
