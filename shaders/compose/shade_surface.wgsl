// What virtual objects leave of the light on real surfaces: a ratio for each pixel, written as the bits of three
// floats. Drawing the surfaces finds the nearest one at each pixel's centre. Twin: src/core/compose/shade_surface.rs.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> light: LightTerms;
@group(0) @binding(2) var<uniform> cameras: ShadowCameras;
@group(0) @binding(3) var shadow_maps: texture_2d_array<u32>;
@group(0) @binding(4) var<uniform> soft: SoftPicture;
@group(0) @binding(5) var soft_picture: texture_2d<u32>;

struct SoftPicture {
    // Columns, rows, pixels from one to the next, 1 where there is one.
    size_step: vec4<u32>,
}

const PI = 3.14159265;
const TINY_IRRADIANCE = 1e-12;
// Neighbours of a coarse picture count as the same surface where their inverse depths agree to this share.
const SAME_SURFACE = 0.02;

struct Seen {
    @builtin(position) clip: vec4<f32>,
    @location(0) point_world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // 1 where virtual shadows fall on the surface, else 0.
    @location(2) receives: f32,
}

@vertex
fn vertex(@location(0) position: vec4<f32>, @location(1) normal: vec3<f32>) -> Seen {
    var seen: Seen;
    seen.clip = clip_position(view, position.xyz, 1.0);
    seen.point_world = position.xyz;
    seen.normal = normal;
    seen.receives = position.w;
    return seen;
}

@fragment
fn fragment(seen: Seen, @builtin(front_facing) front: bool) -> @location(0) vec4<u32> {
    let facet = facet_normal(seen.point_world - view.eye.xyz, seen.clip.w);
    var normal = facet;
    if dot(seen.normal, seen.normal) > 0.0 {
        normal = normalize(seen.normal) * select(-1.0, 1.0, front);
    }
    // Outside of any branch: derivatives.
    let inverse_depth = 1.0 / dot(view.forward.xyz, seen.point_world - view.eye.xyz);
    let slope = vec2<f32>(dpdx(inverse_depth), dpdy(inverse_depth));
    let taken = carried_up(seen.clip.xy, inverse_depth, slope);
    return vec4<u32>(bitcast<vec3<u32>>(ratio(normal, facet, taken, seen)), 0u);
}

// What the soft half loses at a pixel, from the coarse picture: the bilinear mean of those of its four neighbours that
// lie on the same surface, or the one nearest to it in depth.
fn carried_up(at_px: vec2<f32>, inverse_depth: f32, slope: vec2<f32>) -> vec3<f32> {
    if soft.size_step.w == 0u {
        return vec3<f32>(0.0);
    }
    let step = f32(soft.size_step.z);
    let at = at_px / step - 0.5;
    let corner = floor(at);
    let fraction = at - corner;
    let last = vec2<f32>(soft.size_step.xy) - 1.0;
    var sum = vec3<f32>(0.0);
    var weights = 0.0;
    var nearest = vec3<f32>(0.0);
    var apart = 1e30;
    for (var k = 0u; k < 4u; k += 1u) {
        let offset = vec2<f32>(f32(k & 1u), f32(k >> 1u));
        let coarse = clamp(corner + offset, vec2<f32>(0.0), last);
        let bits = textureLoad(soft_picture, vec2<i32>(coarse), 0);
        let there = bitcast<f32>(bits.w);
        let expected = inverse_depth + dot(slope, (coarse + 0.5) * step - at_px);
        let share = mix(1.0 - fraction, fraction, offset);
        let weight = share.x * share.y;
        let off = abs(there - expected);
        if there > 0.0 && weight > 0.0 && off <= SAME_SURFACE * expected {
            sum += weight * bitcast<vec3<f32>>(bits.xyz);
            weights += weight;
        }
        if there > 0.0 && off < apart {
            apart = off;
            nearest = bitcast<vec3<f32>>(bits.xyz);
        }
    }
    if weights > 1e-3 {
        return sum / weights;
    }
    return nearest;
}

fn ratio(normal: vec3<f32>, facet: vec3<f32>, taken: vec3<f32>, seen: Seen) -> vec3<f32> {
    let untouched = vec3<f32>(1.0);
    if seen.receives < 0.5 {
        return untouched;
    }
    var blocked = max(PI * taken, vec3<f32>(0.0));
    var shed = vec3<f32>(0.0);
    for (var k = 0u; k < light.order_hard.y; k += 1u) {
        let w = light.hard[k].to_light.xyz;
        let cosine = dot(normal, w);
        // Turned away from the light: it gives nothing, and nothing can be taken.
        if cosine > 0.0 {
            let facet_cosine = dot(facet, w);
            var visible = 0.0;
            if facet_cosine > 0.0 {
                visible = visibility(k, seen.point_world, facet_cosine);
            }
            let irradiance = light.hard[k].irradiance_rgb.xyz * cosine;
            blocked += irradiance * (1.0 - visible);
            shed += irradiance;
        }
    }
    if all(blocked == vec3<f32>(0.0)) {
        return untouched;
    }
    let whole = shed + max(PI * soft_over_pi(normal), vec3<f32>(0.0));
    return select(untouched, clamp(1.0 - blocked / whole, vec3<f32>(0.0), vec3<f32>(1.0)), whole > vec3<f32>(TINY_IRRADIANCE));
}
