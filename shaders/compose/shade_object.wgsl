// Light onto virtual objects: E_k f+ from each hard light, the zonal lobe of the same f+ over the soft half
// (Eq. 16, 19 of [Now11], as corrected); mirrors and sharp gloss from the picture of the environment. Four samples a pixel; real surfaces hide what lies behind them.
// Twin: src/core/compose/shade_object.rs (and src/core/compose/raster.rs for coverage).

struct MaterialTerms {
    albedo_rgb: vec4<f32>,
    // Reflectance of the lobe or mirror, and the lobe's exponent.
    specular_exponent: vec4<f32>,
    // sqrt(4 pi / (2 l + 1)) z_l of the lobe, bands 0 to 3 and 4 to 5; z of the second: the body.
    lobe_low: vec4<f32>,
    lobe_high: vec4<f32>,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> light: LightTerms;
@group(0) @binding(2) var<uniform> cameras: ShadowCameras;
@group(0) @binding(3) var<uniform> material: MaterialTerms;
@group(0) @binding(4) var shadow_maps: texture_2d_array<u32>;
@group(0) @binding(5) var<uniform> surroundings: Surroundings;
@group(0) @binding(6) var environment: texture_2d<f32>;

const FRAC_1_PI = 0.318309886;
const TAU = 6.28318531;

// What a material is, so that a pipeline has nothing of the others: software devices run every branch.
override MATERIAL: u32 = 0u;
const MATT = 0u;
// A lobe by SH, and one that SH is too smooth for.
const GLOSSY = 1u;
const SHARP = 2u;
const MIRROR = 3u;
// There is no picture of the environment: SH stands in.
const BLURRED_MIRROR = 4u;

// Cosine between normals that count as near: 2.6 degrees.
const NEAR_ENOUGH = 0.999;
// Far beyond white, and still a 16-bit float.
const BRIGHTEST = 6e4;
// Real surfaces are moved back by this share of their distance: what stands on one is not hidden by it.
const CONTACT_SHARE = 1e-4;

// Two pixels' worth of attributes: at the pixel's centre, which the triangle may not cover, and inside of what it
// covers (wherever the device likes that to be).
struct Seen {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) from_eye: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) tint_openness: vec4<f32>,
    // The fourth is 1. Some software rasterisers interpolate with the w of the centre here; dividing by what has
    // become of the 1 mends that.
    @location(3) @interpolate(perspective, centroid) inside_from_eye: vec4<f32>,
    @location(4) @interpolate(perspective, centroid) inside_normal: vec3<f32>,
    @location(5) @interpolate(perspective, centroid) inside_tint_openness: vec4<f32>,
    // Soft light on what is matt by precomputed transfer, and 1; or what is taken of it, and 0.
    @location(6) soft: vec4<f32>,
    @location(7) @interpolate(perspective, centroid) inside_soft: vec4<f32>,
    // The share of the light of the glossy lobe that is left.
    @location(8) gloss: vec3<f32>,
    @location(9) @interpolate(perspective, centroid) inside_gloss: vec3<f32>,
}

@vertex
fn vertex(
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) tint_openness: vec4<f32>,
    @location(3) soft: vec4<f32>,
    @location(4) gloss: vec3<f32>,
) -> Seen {
    var seen: Seen;
    seen.clip = clip_position(view, position, 1.0);
    seen.from_eye = position - view.eye.xyz;
    seen.normal = normal;
    seen.tint_openness = tint_openness;
    seen.inside_from_eye = vec4<f32>(seen.from_eye, 1.0);
    seen.inside_normal = normal;
    seen.inside_tint_openness = tint_openness;
    seen.soft = soft;
    seen.inside_soft = soft;
    seen.gloss = gloss;
    seen.inside_gloss = gloss;
    return seen;
}

@fragment
fn fragment(seen: Seen, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let facet = facet_normal(seen.from_eye, seen.clip.w);
    // The centre is shaded, as in the twin, unless it lies so far beside the triangle that what is found there has
    // nothing to do with it.
    var from_eye = seen.from_eye;
    var normal = safe_normal(seen.normal, facet, front);
    var tint_openness = seen.tint_openness;
    var soft = seen.soft;
    var gloss_left = seen.gloss;
    let inside_normal = safe_normal(seen.inside_normal, facet, front);
    if dot(normal, inside_normal) < NEAR_ENOUGH {
        from_eye = seen.inside_from_eye.xyz / seen.inside_from_eye.w;
        normal = inside_normal;
        tint_openness = seen.inside_tint_openness / seen.inside_from_eye.w;
        soft = seen.inside_soft / seen.inside_from_eye.w;
        gloss_left = seen.inside_gloss / seen.inside_from_eye.w;
    }
    let point_world = view.eye.xyz + from_eye;
    let radiance = shade(normal, facet, -normalize(from_eye), point_world, tint_openness, soft, gloss_left);
    return vec4<f32>(min(max(radiance, vec3<f32>(0.0)) * light.exposure.x, vec3<f32>(BRIGHTEST)), 1.0);
}

fn safe_normal(interpolated: vec3<f32>, facet: vec3<f32>, front: bool) -> vec3<f32> {
    if dot(interpolated, interpolated) == 0.0 {
        return facet;
    }
    return normalize(interpolated) * select(-1.0, 1.0, front);
}

fn shade(
    n: vec3<f32>,
    facet: vec3<f32>,
    to_eye: vec3<f32>,
    point_world: vec3<f32>,
    tint_openness: vec4<f32>,
    transferred: vec4<f32>,
    gloss_left: vec3<f32>,
) -> vec3<f32> {
    let specular = material.specular_exponent.xyz;
    let exponent = material.specular_exponent.w;
    let r = 2.0 * dot(n, to_eye) * n - to_eye;
    if MATERIAL == MIRROR {
        return specular * reflected(point_world, r, material.lobe_high.z);
    }
    if MATERIAL == BLURRED_MIRROR {
        return specular * lobe_sum(TOTAL, material.lobe_low, material.lobe_high.xy, r);
    }
    let is_glossy = MATERIAL != MATT;
    let sharp = MATERIAL == SHARP;
    let shines = !sharp || (surroundings.counts.w & HOLDS_HARD_LIGHTS) == 0u;
    var matt = vec3<f32>(0.0);
    var shine = vec3<f32>(0.0);
    for (var k = 0u; k < light.order_hard.y; k += 1u) {
        let w = light.hard[k].to_light.xyz;
        let cosine = dot(n, w);
        // 0^0 is 1: the cosines decide before the power.
        if cosine > 0.0 {
            let visible = visibility(k, point_world, min(cosine, dot(facet, w)));
            let irradiance = light.hard[k].irradiance_rgb.xyz;
            matt += irradiance * (cosine * FRAC_1_PI * visible);
            let along = dot(r, w);
            if is_glossy && shines && along > 0.0 {
                shine += irradiance * ((exponent + 1.0) / TAU * pow(min(along, 1.0), exponent) * visible);
            }
        }
    }
    let openness = tint_openness.w;
    let albedo = material.albedo_rgb.xyz * tint_openness.xyz;
    var soft = transferred.xyz;
    if transferred.w <= 0.5 {
        soft = openness * soft_over_pi(n) - soft;
    }
    var out = albedo * (matt + soft);
    if is_glossy {
        var glossy = vec3<f32>(0.0);
        if sharp {
            glossy = gloss(exponent, r);
        } else {
            glossy = lobe_sum(GLOBAL, material.lobe_low, material.lobe_high.xy, r);
        }
        // The terms have the energy-safe norm in both halves.
        let scale = select(1.0, (exponent + 2.0) / (exponent + 1.0), surroundings.settings.x == 1.0);
        out += specular * scale * (shine + gloss_left * glossy);
    }
    return out;
}

// Depth only, of objects first: what lies behind others is not shaded.
@vertex
fn depth_vertex(@location(0) position: vec3<f32>) -> @invariant @builtin(position) vec4<f32> {
    return clip_position(view, position, 1.0);
}

// And of real surfaces.
@vertex
fn surface_vertex(@location(0) position: vec4<f32>) -> @builtin(position) vec4<f32> {
    return clip_position(view, position.xyz, 1.0 - CONTACT_SHARE);
}

@fragment
fn depth_fragment() -> @location(0) vec4<f32> {
    return vec4<f32>(0.0);
}
