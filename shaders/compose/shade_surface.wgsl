// What virtual objects leave of the light on real surfaces: a ratio for each pixel, written as the bits of three
// floats. Drawing the surfaces finds the nearest one at each pixel's centre. Twin: src/compose/shade_surface.rs.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> light: LightTerms;
@group(0) @binding(2) var<uniform> camera: ShadowCamera;
@group(0) @binding(3) var shadow_map: texture_2d<u32>;

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
    let cosine = dot(normal, light.to_light.xyz);
    // Turned away from the light: the ratio is 1 whatever the shadow.
    if seen.receives < 0.5 || cosine <= 0.0 {
        return untouched;
    }
    let facet_cosine = dot(facet, light.to_light.xyz);
    var visible = 0.0;
    if facet_cosine > 0.0 {
        visible = visibility(camera, seen.point_world, facet_cosine);
    }
    if visible >= 1.0 {
        return untouched;
    }
    let direct = light.direct_rgb.xyz * cosine;
    let soft = max(PI * soft_over_pi(normal), vec3<f32>(0.0));
    let all = direct + soft;
    return select(untouched, (direct * visible + soft) / all, all > vec3<f32>(TINY_IRRADIANCE));
}
