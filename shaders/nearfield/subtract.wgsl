// What virtual objects leave of a known room's light: a ratio for each pixel, written as the bits of three floats.
// Drawing the room finds its nearest triangle at each pixel's centre. Twin: src/core/nearfield/subtract.rs.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> cameras_near: PointCameras;
@group(0) @binding(2) var<uniform> lights: PointLights;
@group(0) @binding(3) var point_maps: texture_2d_array<u32>;
// For each triangle where its lights begin and end in `listed`.
@group(0) @binding(4) var ranges: texture_2d<u32>;
// Four texels for each light of each triangle: what it sends to the triangle's corners; its number in the first one's w; in
// the other two's and in the fourth which part of it each corner sees, along both half axes.
@group(0) @binding(5) var listed: texture_2d<f32>;
@group(0) @binding(6) var<uniform> suns: SunTerms;
// The objects under each sun, and the room itself.
@group(0) @binding(7) var<uniform> cameras: ShadowCameras;
@group(0) @binding(8) var shadow_maps: texture_2d_array<u32>;
@group(0) @binding(9) var<uniform> room_cameras: ShadowCameras;
@group(0) @binding(10) var room_maps: texture_2d_array<u32>;
// A pass a light: which light, and what the passes have taken.
@group(0) @binding(11) var<uniform> turn: Turn;
@group(0) @binding(12) var taken: texture_2d<f32>;

struct SunTerms {
    // Suns, 0, 0, 0.
    counts: vec4<u32>,
    // Unit vector towards each (world frame), and its irradiance; in the last w 1 + the number of the sun whose map of the
    // objects it is hidden by, or 0.
    suns: array<array<vec4<f32>, 2>, 64>,
}

struct Turn {
    // Number of the light, or SUNS; 0, 0, 0.
    light: vec4<u32>,
}

const SUNS = 0xffffu;
const RANGES_A_ROW = 1024u;
const LISTED_A_ROW = 512u;
const NO_TRIANGLE = 0xffffffffu;
const TINY_LIGHT = 1e-12;
const INVERSE_PI = 0.31830989;
const ROOM_TAPS = 4u;

// Whether there are suns, and whether every light is one place, so that a pipeline has nothing of what is not: software
// devices run every branch.
override HAS_SUNS: bool = true;
override IS_HARD: bool = false;

struct Seen {
    @invariant @builtin(position) clip: vec4<f32>,
    @location(0) point_world: vec3<f32>,
    @location(1) @interpolate(flat) normal: vec3<f32>,
    // All light of the room that arrives, irradiance over pi.
    @location(2) gathered: vec3<f32>,
    // Weights of the triangle's first two corners.
    @location(3) weights: vec2<f32>,
    @location(4) @interpolate(flat) triangle: u32,
}

@vertex
fn vertex(
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) gathered: vec3<f32>,
    @location(3) weights: vec2<f32>,
    @location(4) triangle: u32,
) -> Seen {
    var seen: Seen;
    seen.clip = clip_position(view, position, 1.0);
    seen.point_world = position;
    seen.normal = normal;
    seen.gathered = gathered;
    seen.weights = weights;
    seen.triangle = triangle;
    return seen;
}

@fragment
fn fragment(seen: Seen) -> @location(0) vec4<u32> {
    return vec4<u32>(bitcast<vec3<u32>>(ratio(seen)), 0u);
}

// Where nothing is taken away, whatever the lights.
fn is_untouched(seen: Seen) -> bool {
    return seen.triangle == NO_TRIANGLE || dot(seen.normal, view.eye.xyz - seen.point_world) < 0.0;
}

struct Light {
    whole: vec3<f32>,
    blocked: vec3<f32>,
}

// All light at a point and what objects block of the suns'.
fn all_light(seen: Seen) -> Light {
    var light = Light(seen.gathered, vec3<f32>(0.0));
    if !HAS_SUNS {
        return light;
    }
    for (var k = 0u; k < suns.counts.x; k += 1u) {
        let cosine = dot(seen.normal, suns.suns[k][0].xyz);
        if cosine > 0.0 {
            let sun = suns.suns[k][1].xyz * (cosine * INVERSE_PI * arrives(k, seen.point_world, cosine));
            if any(sun > vec3<f32>(0.0)) {
                light.whole += sun;
                let map = u32(suns.suns[k][1].w);
                if map > 0u {
                    let slope = dot(seen.normal, suns.suns[map - 1u][0].xyz);
                    light.blocked += sun * (1.0 - visibility(map - 1u, seen.point_world, slope));
                }
            }
        }
    }
    return light;
}

// Where the triangle's lights begin and end in `listed`.
fn listed_range(seen: Seen) -> vec2<u32> {
    let texel = vec2<i32>(vec2<u32>(seen.triangle % RANGES_A_ROW, seen.triangle / RANGES_A_ROW));
    return textureLoad(ranges, texel, 0).xy;
}

// Where a light of a triangle begins in `listed`.
fn listed_at(i: u32) -> vec2<i32> {
    return vec2<i32>(vec2<u32>(4u * (i % LISTED_A_ROW), i / LISTED_A_ROW));
}

// Places a side of each light.
fn places_a_side() -> u32 {
    if IS_HARD {
        return 1u;
    }
    return lights.tiles_maps_texels_side.w;
}

// Which part of a light of its triangle the point sees: between the corners' parts by the light that comes of each.
fn part_of(seen: Seen, corner: vec2<i32>) -> vec4<f32> {
    let entire = vec4<f32>(0.0, 0.0, 1.0, 1.0);
    if places_a_side() <= 1u {
        return entire;
    }
    let a = textureLoad(listed, corner, 0);
    let b = textureLoad(listed, corner + vec2<i32>(1, 0), 0);
    let c = textureLoad(listed, corner + vec2<i32>(2, 0), 0);
    let sums = vec3<f32>(a.x + a.y + a.z, b.x + b.y + b.z, c.x + c.y + c.z);
    let light = max(vec3<f32>(seen.weights, 1.0 - seen.weights.x - seen.weights.y), vec3<f32>(0.0)) * sums;
    let whole = light.x + light.y + light.z;
    if whole <= 0.0 {
        return entire;
    }
    let rest = textureLoad(listed, corner + vec2<i32>(3, 0), 0);
    let parts = light.x * seen_part(vec2<f32>(b.w, c.w)) + light.y * seen_part(rest.xy);
    return (parts + light.z * seen_part(rest.zw)) / whole;
}

// What objects block of a light of the point's triangle.
fn blocked_of(seen: Seen, i: u32) -> vec3<f32> {
    let corner = listed_at(i);
    let a = textureLoad(listed, corner, 0);
    let visible = point_visibility(u32(a.w), seen.point_world, part_of(seen, corner));
    if visible >= 1.0 {
        return vec3<f32>(0.0);
    }
    let b = textureLoad(listed, corner + vec2<i32>(1, 0), 0);
    let c = textureLoad(listed, corner + vec2<i32>(2, 0), 0);
    let third = 1.0 - seen.weights.x - seen.weights.y;
    return (1.0 - visible) * (seen.weights.x * a.xyz + seen.weights.y * b.xyz + third * c.xyz);
}

fn ratio(seen: Seen) -> vec3<f32> {
    let untouched = vec3<f32>(1.0);
    if is_untouched(seen) {
        return untouched;
    }
    let light = all_light(seen);
    var blocked = light.blocked;
    let range = listed_range(seen);
    // The end is looked for after each turn: software devices run one more where it is looked for before.
    var i = range.x;
    if i < range.y {
        loop {
            blocked += blocked_of(seen, i);
            continuing {
                i += 1u;
                break if i >= range.y;
            }
        }
    }
    if all(blocked == vec3<f32>(0.0)) {
        return untouched;
    }
    let rest = clamp(1.0 - blocked / light.whole, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(untouched, rest, light.whole > vec3<f32>(TINY_LIGHT));
}

// Depth alone, to a target of ratios.
@fragment
fn depth_alone() -> @location(0) vec4<u32> {
    return vec4<u32>(0u);
}

// Depth alone.
@fragment
fn nearest_room(seen: Seen) -> @location(0) vec4<f32> {
    return vec4<f32>(0.0);
}

// A pass a light: the share of all light that objects block of one, to be added to the others'.
@fragment
fn one_light(seen: Seen) -> @location(0) vec4<f32> {
    if is_untouched(seen) {
        discard;
    }
    let light = all_light(seen);
    var blocked = light.blocked;
    if turn.light.x != SUNS {
        // The list is in order of the lights' numbers.
        let range = listed_range(seen);
        var low = range.x;
        var high = range.y;
        while low < high {
            let middle = (low + high) / 2u;
            if u32(textureLoad(listed, listed_at(middle), 0).w) < turn.light.x {
                low = middle + 1u;
            } else {
                high = middle;
            }
        }
        if low >= range.y || u32(textureLoad(listed, listed_at(low), 0).w) != turn.light.x {
            discard;
        }
        blocked = blocked_of(seen, low);
    }
    let share = blocked / light.whole;
    return vec4<f32>(select(vec3<f32>(0.0), share, light.whole > vec3<f32>(TINY_LIGHT)), 0.0);
}

// After all passes: what is left, as the bits of three floats.
@fragment
fn after_all(seen: Seen) -> @location(0) vec4<u32> {
    let rest = 1.0 - textureLoad(taken, vec2<i32>(seen.clip.xy), 0).xyz;
    return vec4<u32>(bitcast<vec3<u32>>(clamp(rest, vec3<f32>(0.0), vec3<f32>(1.0))), 0u);
}

// Share of sun k that the room itself lets through; as `visibility`, of the room's own map.
fn arrives(k: u32, point_world: vec3<f32>, cosine: f32) -> f32 {
    let camera = room_cameras.cameras[k];
    let texels = i32(camera.texels_taps.x);
    if texels == 0 {
        return 1.0;
    }
    let mapped = map_position(camera, point_world);
    let texel_m = camera.texel_depth_m.x;
    let most = MAX_BIAS_TEXELS * texel_m;
    let bias = bias_m(texel_m, 0.5 * f32(ROOM_TAPS), cosine, most) + ROUNDING_TEXELS * texel_m;
    let reference = min(mapped.z - bias / camera.texel_depth_m.y, EMPTY_DEPTH);
    let start = mapped.xy - 0.5 * f32(ROOM_TAPS - 1u);
    let corner = floor(start);
    if !(all(corner >= vec2<f32>(-16.0)) && all(corner < vec2<f32>(f32(texels)))) {
        return 1.0;
    }
    let fraction = start - corner;
    var sum = 0.0;
    for (var j = 0u; j < ROOM_TAPS; j += 1u) {
        for (var i = 0u; i < ROOM_TAPS; i += 1u) {
            let texel = vec2<i32>(corner) + vec2<i32>(i32(i), i32(j));
            var stored = EMPTY_DEPTH;
            if all(texel >= vec2<i32>(0)) && all(texel < vec2<i32>(texels)) {
                stored = bitcast<f32>(textureLoad(room_maps, texel, i32(k), 0).x);
            }
            if reference <= stored {
                sum += tap_weight(i, ROOM_TAPS - 1u, fraction.x) * tap_weight(j, ROOM_TAPS - 1u, fraction.y);
            }
        }
    }
    return min(sum / f32((ROOM_TAPS - 1u) * (ROOM_TAPS - 1u)), 1.0);
}
