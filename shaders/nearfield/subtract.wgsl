// What virtual objects leave of a known room's light: a ratio for each pixel, written as the bits of three floats.
// Drawing the room finds its nearest triangle at each pixel's centre. Twin: src/nearfield/subtract.rs.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> cameras_near: PointCameras;
@group(0) @binding(2) var<uniform> lights: PointLights;
@group(0) @binding(3) var point_maps: texture_2d_array<u32>;
// For each triangle where its lights begin and end in `listed`.
@group(0) @binding(4) var ranges: texture_2d<u32>;
// Three texels for each light of each triangle: what it sends to the triangle's corners; its number in the first one's w.
@group(0) @binding(5) var listed: texture_2d<f32>;
@group(0) @binding(6) var<uniform> suns: SunTerms;
// The objects under each sun, and the room itself.
@group(0) @binding(7) var<uniform> cameras: ShadowCameras;
@group(0) @binding(8) var shadow_maps: texture_2d_array<u32>;
@group(0) @binding(9) var<uniform> room_cameras: ShadowCameras;
@group(0) @binding(10) var room_maps: texture_2d_array<u32>;

struct SunTerms {
    // Suns, 0, 0, 0.
    counts: vec4<u32>,
    // Unit vector towards each (world frame), and its irradiance.
    suns: array<array<vec4<f32>, 2>, 64>,
}

const RANGES_A_ROW = 1024u;
const LISTED_A_ROW = 682u;
const NO_TRIANGLE = 0xffffffffu;
const TINY_LIGHT = 1e-12;
const INVERSE_PI = 0.31830989;
const ROOM_TAPS = 4u;

struct Seen {
    @builtin(position) clip: vec4<f32>,
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

fn ratio(seen: Seen) -> vec3<f32> {
    let untouched = vec3<f32>(1.0);
    let is_front = dot(seen.normal, view.eye.xyz - seen.point_world) >= 0.0;
    if seen.triangle == NO_TRIANGLE || !is_front {
        return untouched;
    }
    var whole = seen.gathered;
    var blocked = vec3<f32>(0.0);
    for (var k = 0u; k < suns.counts.x; k += 1u) {
        let cosine = dot(seen.normal, suns.suns[k][0].xyz);
        if cosine > 0.0 {
            let light = suns.suns[k][1].xyz * (cosine * INVERSE_PI * arrives(k, seen.point_world, cosine));
            if any(light > vec3<f32>(0.0)) {
                whole += light;
                blocked += light * (1.0 - visibility(k, seen.point_world, cosine));
            }
        }
    }
    let texel = vec2<i32>(vec2<u32>(seen.triangle % RANGES_A_ROW, seen.triangle / RANGES_A_ROW));
    let range = textureLoad(ranges, texel, 0).xy;
    for (var i = range.x; i < range.y; i += 1u) {
        let corner = vec2<i32>(vec2<u32>(3u * (i % LISTED_A_ROW), i / LISTED_A_ROW));
        let a = textureLoad(listed, corner, 0);
        let visible = point_visibility(u32(a.w), seen.point_world, seen.normal);
        if visible < 1.0 {
            let b = textureLoad(listed, corner + vec2<i32>(1, 0), 0).xyz;
            let c = textureLoad(listed, corner + vec2<i32>(2, 0), 0).xyz;
            let third = 1.0 - seen.weights.x - seen.weights.y;
            blocked += (1.0 - visible) * (seen.weights.x * a.xyz + seen.weights.y * b + third * c);
        }
    }
    if all(blocked == vec3<f32>(0.0)) {
        return untouched;
    }
    let left = clamp(1.0 - blocked / whole, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(untouched, left, whole > vec3<f32>(TINY_LIGHT));
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
