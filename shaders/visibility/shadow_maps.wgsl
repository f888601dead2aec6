// Depth of the virtual objects seen along the directional light. Twin: src/core/visibility/shadow_maps.rs.
// The depth's bits go to an integer target: that can be read texel by texel and copied on every backend, which
// depth formats cannot. The nearest triangle stays, whichever way it faces.

@group(0) @binding(0) var<uniform> camera: ShadowCamera;

struct Seen {
    @builtin(position) clip: vec4<f32>,
    @location(0) depth: f32,
}

@vertex
fn vertex(@location(0) position: vec3<f32>) -> Seen {
    let at = map_position(camera, position);
    let side = f32(camera.texels_taps.x);
    var seen: Seen;
    seen.clip = vec4<f32>(2.0 * at.x / side - 1.0, 1.0 - 2.0 * at.y / side, at.z, 1.0);
    seen.depth = at.z;
    return seen;
}

@fragment
fn fragment(seen: Seen) -> @location(0) vec4<u32> {
    return vec4<u32>(bitcast<u32>(clamp(seen.depth, 0.0, 1.0)), 0u, 0u, 0u);
}
