// Depth of the virtual objects' stand-ins seen from near lights, many lights in one pass: an instance is a place on a light,
// and its view a square of the light's tile of the page that is drawn to. Twin: src/core/visibility/point_maps.rs.
// The depth's bits go to an integer target, as in visibility/shadow_maps.

@group(0) @binding(0) var<uniform> cameras: PointCameras;
@group(0) @binding(1) var<uniform> page: PointPage;
@group(0) @binding(2) var<uniform> lights: PointLights;

struct PointPage {
    // The page's first light, tiles a side, texels a side of a tile, 0.
    first_tiles_texels: vec4<u32>,
}

struct Seen {
    @builtin(position) clip: vec4<f32>,
    // First texel of the view in its page, and texels a side of it.
    @location(0) @interpolate(flat) first_side: vec3<u32>,
}

// Texels a side of a view.
fn view_texels() -> u32 {
    return page.first_tiles_texels.z / lights.tiles_maps_texels_side.w;
}

@vertex
fn vertex(@location(0) position: vec3<f32>, @builtin(instance_index) instance: u32) -> Seen {
    let n = lights.tiles_maps_texels_side.w;
    let tile = instance / (n * n);
    let cell = vec2<u32>(instance % n, instance / n % n);
    let k = page.first_tiles_texels.x + tile;
    let camera = cameras.cameras[k];
    let corner = point_corner(camera);
    let view = point_view(lights.half_axes[k], corner, cell, n);
    let at = point_seen(camera, corner, position);
    let tiles = page.first_tiles_texels.y;
    let texels = page.first_tiles_texels.z;
    let side = f32(tiles * texels);
    var seen: Seen;
    let first = vec2<u32>(tile % tiles, tile / tiles) * texels + cell * view_texels();
    seen.first_side = vec3<u32>(first, view_texels());
    let w = at.z - view.ahead;
    let xy = at.xy - view.aside + (view.start + vec2<f32>(first)) * w;
    // Behind the near plane 0 <= z <= w: the hardware cuts triangles there.
    seen.clip = vec4<f32>(2.0 * xy.x / side - w, w - 2.0 * xy.y / side, w - camera.place_near.w, w);
    if camera.place_near.w <= 0.0 {
        seen.clip = vec4<f32>(0.0, 0.0, -1.0, 1.0);
    }
    return seen;
}

@fragment
fn fragment(seen: Seen) -> @location(0) vec4<u32> {
    let texel = vec2<u32>(seen.clip.xy);
    // Divided in the vertex stage: software devices divide integers one by one.
    if any(texel < seen.first_side.xy) || any(texel >= seen.first_side.xy + seen.first_side.z) {
        discard;
    }
    // z / w = 1 - near / w.
    return vec4<u32>(bitcast<u32>(clamp(seen.clip.z, 0.0, 1.0)), 0u, 0u, 0u);
}
