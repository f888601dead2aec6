// A perspective camera at a near light, the places on the light that it is seen from, and where its maps lie among the others.
// Twin: src/core/visibility/point_maps/camera.rs.

struct PointCamera {
    // World metres to column times w, row times w (texels), and w: metres from the light's middle along the camera's axis.
    column: vec4<f32>,
    row: vec4<f32>,
    forward: vec4<f32>,
    // The light's middle in the world, metres; the near plane's distance, metres (0: there is no map and everything is lit).
    place_near: vec4<f32>,
}

struct PointCameras {
    cameras: array<PointCamera, 256>,
}

struct PointLights {
    // Tiles a side of a page, maps a page, texels a side of a map, places a side of each light.
    tiles_maps_texels_side: vec4<u32>,
    // Half axes of each light's extent in its camera's axes, metres; the first one's w is the side of a texel one metre
    // before the light, metres, the second one's how far a view is shifted, texels for a metre aside.
    half_axes: array<array<vec4<f32>, 2>, 256>,
}

// The projection from one place by that from the middle: columns are (x - aside.x) / (w - ahead) + start.x.
struct PointView {
    aside: vec2<f32>,
    ahead: f32,
    start: vec2<f32>,
}

// Column and row from the light's middle without the map's corner, both times w, and w.
fn point_seen(camera: PointCamera, corner: vec2<f32>, p: vec3<f32>) -> vec3<f32> {
    let w = dot(camera.forward.xyz, p) + camera.forward.w;
    let x = dot(camera.column.xyz, p) + camera.column.w;
    let y = dot(camera.row.xyz, p) + camera.row.w;
    return vec3<f32>(vec2<f32>(x, y) + corner * w, w);
}

// The tangents of the map's corner, in texels.
fn point_corner(camera: PointCamera) -> vec2<f32> {
    return -vec2<f32>(dot(camera.column.xyz, camera.forward.xyz), dot(camera.row.xyz, camera.forward.xyz));
}

// From the place in a cell of a light's grid of n x n places.
fn point_view(half_axes: array<vec4<f32>, 2>, corner: vec2<f32>, cell: vec2<u32>, n: u32) -> PointView {
    let step = (2.0 * vec2<f32>(cell) + 1.0) / f32(n) - 1.0;
    let place = half_axes[0].xyz * step.x + half_axes[1].xyz * step.y;
    var view: PointView;
    view.aside = place.xy / half_axes[0].w;
    view.ahead = place.z;
    view.start = place.xy * half_axes[1].w - corner + vec2<f32>(cell) / f32(n);
    return view;
}
