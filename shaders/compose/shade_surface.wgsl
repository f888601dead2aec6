// What virtual objects leave of the light on real surfaces: a ratio for each pixel, written as the bits of three
// floats. Drawing the surfaces finds the nearest one at each pixel's centre. Twin: src/compose/shade_surface.rs.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> light: LightTerms;
@group(0) @binding(2) var<uniform> cameras: ShadowCameras;
@group(0) @binding(3) var shadow_maps: texture_2d_array<u32>;

const PI = 3.14159265;
const TINY_IRRADIANCE = 1e-12;

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
    return vec4<u32>(bitcast<vec3<u32>>(ratio(normal, facet, seen)), 0u);
}

fn ratio(normal: vec3<f32>, facet: vec3<f32>, seen: Seen) -> vec3<f32> {
    let untouched = vec3<f32>(1.0);
    if seen.receives < 0.5 {
        return untouched;
    }
    var blocked = vec3<f32>(0.0);
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
    return select(untouched, max(1.0 - blocked / whole, vec3<f32>(0.0)), whole > vec3<f32>(TINY_IRRADIANCE));
}
