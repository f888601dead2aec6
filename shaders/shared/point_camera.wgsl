// A perspective camera at a near light, and where its map lies among the others.
// Twin: src/visibility/point_maps.rs (PointCamera).

struct PointCamera {
    // World metres to column times w, row times w (texels), and w: metres from the light along the camera's axis.
    column: vec4<f32>,
    row: vec4<f32>,
    forward: vec4<f32>,
    // The light's place in the world, metres; the near plane's distance, metres (0: there is no map and everything is lit).
    place_near: vec4<f32>,
}

struct PointCameras {
    cameras: array<PointCamera, 256>,
}

// Column and row, both times w, and w.
fn point_mapped(camera: PointCamera, p: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(camera.column.xyz, p) + camera.column.w,
        dot(camera.row.xyz, p) + camera.row.w,
        dot(camera.forward.xyz, p) + camera.forward.w,
    );
}
