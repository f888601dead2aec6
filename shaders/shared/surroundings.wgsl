// What mirrors and sharp gloss see: the picture of the environment and its prefiltered levels on octahedral squares, one
// under the other in one texture; the largest triangles of real surfaces; the spheres of virtual bodies.
// Twins: src/core/compose/reflected.rs, src/core/model/environment.rs, src/math/octahedral.rs.

struct SeenSphere {
    // Centre and radius, world frame, metres.
    place: vec4<f32>,
    // What it reflects of white light, and its body.
    rgb_body: vec4<f32>,
}

struct SeenTriangle {
    // A corner, world frame, metres; w: 1 where the albedo is known.
    corner: vec4<f32>,
    // The edges from it; w of the first: 1 where virtual shadows fall on it.
    edge_u: vec4<f32>,
    edge_v: vec4<f32>,
    albedo_rgb: vec4<f32>,
}

struct Surroundings {
    // Spheres, triangles, prefiltered levels, and flags: 2 the levels hold the hard lights.
    counts: vec4<u32>,
    // 1 for the paper's Phong norm, 0, 0, 0.
    settings: vec4<f32>,
    // First row and texels a side of the picture (0) and of the levels (1 ..).
    levels: array<vec4<u32>, 12>,
    spheres: array<SeenSphere, 64>,
    triangles: array<SeenTriangle, 64>,
}

const HOLDS_HARD_LIGHTS = 2u;
const FIRST_EXPONENT = 8.0;
const START_M = 1e-4;
const FAR_M = 1e30;
const OVER_PI = 0.318309886;

fn sign_of(x: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(1.0), vec2<f32>(-1.0), x < vec2<f32>(0.0));
}

fn octahedral_place(direction: vec3<f32>) -> vec2<f32> {
    let at = direction.xy / (abs(direction.x) + abs(direction.y) + abs(direction.z));
    if direction.z >= 0.0 {
        return at;
    }
    return (1.0 - abs(at.yx)) * sign_of(at);
}

// A texel of a level; over an edge the square meets itself, mirrored.
fn texel_of(first_row: i32, side: i32, at: vec2<i32>) -> vec3<f32> {
    var x = at.x;
    var y = at.y;
    if x < 0 || x >= side {
        x = clamp(x, 0, side - 1);
        y = side - 1 - y;
    }
    if y < 0 || y >= side {
        x = side - 1 - x;
        y = clamp(y, 0, side - 1);
    }
    return textureLoad(environment, vec2<i32>(x, first_row + y), 0).xyz;
}

// Radiance in a direction, bilinear. Level 0: all light, as it is.
fn seen_at(level: u32, direction: vec3<f32>) -> vec3<f32> {
    let first_row = i32(surroundings.levels[level].x);
    let side = i32(surroundings.levels[level].y);
    let at = (octahedral_place(direction) + 1.0) * (0.5 * f32(side)) - 0.5;
    let corner = floor(at);
    let f = at - corner;
    let left_top = vec2<i32>(corner);
    let a = texel_of(first_row, side, left_top);
    let b = texel_of(first_row, side, left_top + vec2<i32>(1, 0));
    let c = texel_of(first_row, side, left_top + vec2<i32>(0, 1));
    let d = texel_of(first_row, side, left_top + vec2<i32>(1, 1));
    let upper = a + f.x * (b - a);
    let lower = c + f.x * (d - c);
    return upper + f.y * (lower - upper);
}

// The mean radiance under the lobe cos^exponent about a direction.
fn gloss(exponent: f32, direction: vec3<f32>) -> vec3<f32> {
    let last = surroundings.counts.z - 1u;
    let at = min(log2(max(exponent / FIRST_EXPONENT, 1.0)), f32(last));
    let low = floor(at);
    let below = seen_at(1u + u32(low), direction);
    let above = seen_at(1u + min(u32(low) + 1u, last), direction);
    return below + (at - low) * (above - below);
}

// Cosine-weighted share of the hemisphere that the spheres leave open, each as if alone.
fn open_share(point_world: vec3<f32>, normal: vec3<f32>) -> f32 {
    var open = 1.0;
    for (var i = 0u; i < surroundings.counts.x; i += 1u) {
        let place = surroundings.spheres[i].place;
        let to_centre = place.xyz - point_world;
        let squared = dot(to_centre, to_centre);
        let up = dot(normal, to_centre);
        if up > 0.0 && squared > 0.0 {
            open *= 1.0 - up / sqrt(squared) * min(place.w * place.w / squared, 1.0);
        }
    }
    return open;
}

fn seen_surface(triangle: SeenTriangle, point_world: vec3<f32>, along: vec3<f32>) -> vec3<f32> {
    var normal = normalize(cross(triangle.edge_u.xyz, triangle.edge_v.xyz));
    if dot(normal, along) > 0.0 {
        normal = -normal;
    }
    let receives = triangle.edge_u.w == 1.0;
    var open = 1.0;
    if receives {
        open = open_share(point_world, normal);
    }
    var whole = max(soft_over_pi(normal), vec3<f32>(0.0));
    var left = whole * open;
    for (var k = 0u; k < light.order_hard.y; k += 1u) {
        let cosine = dot(normal, light.hard[k].to_light.xyz);
        if cosine > 0.0 {
            var visible = 1.0;
            if receives {
                visible = visibility(k, point_world, cosine);
            }
            let radiated = light.hard[k].irradiance_rgb.xyz * (cosine * OVER_PI);
            whole += radiated;
            left += radiated * visible;
        }
    }
    if triangle.corner.w == 1.0 {
        return triangle.albedo_rgb.xyz * left;
    }
    let share = select(vec3<f32>(1.0), left / whole, whole > vec3<f32>(0.0));
    return seen_at(0u, along) * share;
}

// What a body's mirror sees from a point along a unit direction.
fn reflected(origin: vec3<f32>, along: vec3<f32>, body: f32) -> vec3<f32> {
    var nearest = FAR_M;
    var hit = 0u;
    for (var i = 0u; i < surroundings.counts.y; i += 1u) {
        let u = surroundings.triangles[i].edge_u.xyz;
        let v = surroundings.triangles[i].edge_v.xyz;
        let from_corner = origin - surroundings.triangles[i].corner.xyz;
        let normal = cross(u, v);
        let facing = dot(normal, along);
        if facing == 0.0 {
            continue;
        }
        let t = -dot(normal, from_corner) / facing;
        if t <= START_M || t >= nearest {
            continue;
        }
        let p = cross(along, v) / -facing;
        let q = cross(from_corner, u) / -facing;
        let a = dot(from_corner, p);
        let b = dot(along, q);
        if a >= -1e-6 && b >= -1e-6 && a + b <= 1.000001 {
            nearest = t;
            hit = i + 1u;
        }
    }
    var ball = 0u;
    for (var i = 0u; i < surroundings.counts.x; i += 1u) {
        if surroundings.spheres[i].rgb_body.w == body {
            continue;
        }
        let place = surroundings.spheres[i].place;
        let to_centre = place.xyz - origin;
        let middle = dot(to_centre, along);
        let miss = to_centre - middle * along;
        let inside = place.w * place.w - dot(miss, miss);
        if middle <= 0.0 || inside <= 0.0 || dot(to_centre, to_centre) <= place.w * place.w {
            continue;
        }
        let t = middle - sqrt(inside);
        if t < nearest {
            nearest = t;
            ball = i + 1u;
        }
    }
    if ball > 0u {
        let normal = normalize(origin + nearest * along - surroundings.spheres[ball - 1u].place.xyz);
        var radiated = soft_over_pi(normal);
        for (var k = 0u; k < light.order_hard.y; k += 1u) {
            let cosine = max(dot(normal, light.hard[k].to_light.xyz), 0.0);
            radiated += light.hard[k].irradiance_rgb.xyz * (cosine * OVER_PI);
        }
        return surroundings.spheres[ball - 1u].rgb_body.xyz * max(radiated, vec3<f32>(0.0));
    }
    if hit > 0u {
        return seen_surface(surroundings.triangles[hit - 1u], origin + nearest * along, along);
    }
    return seen_at(0u, along);
}
