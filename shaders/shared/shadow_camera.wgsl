// The orthographic camera that looks along a hard light.
// Twin: src/core/visibility/shadow_maps.rs (ShadowCamera).

struct ShadowCamera {
    // Rows of the map from world metres to column, row (texels) and depth.
    column: vec4<f32>,
    row: vec4<f32>,
    depth: vec4<f32>,
    // Side of a texel in metres, metres for a depth of 1.
    texel_depth_m: vec4<f32>,
    // Texels a side (0: there is no map and everything is lit), taps a side of the filter.
    texels_taps: vec4<u32>,
}

struct ShadowCameras {
    cameras: array<ShadowCamera, 64>,
}

fn map_position(camera: ShadowCamera, p: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(camera.column.xyz, p) + camera.column.w,
        dot(camera.row.xyz, p) + camera.row.w,
        dot(camera.depth.xyz, p) + camera.depth.w,
    );
}
