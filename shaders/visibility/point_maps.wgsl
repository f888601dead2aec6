// Depth of the virtual objects' stand-ins seen from near lights, many lights in one pass: an instance is a light, and its
// map a tile of the page that is drawn to. Twin: src/visibility/point_maps.rs.
// The depth's bits go to an integer target, as in visibility/shadow_maps.

@group(0) @binding(0) var<uniform> cameras: PointCameras;
@group(0) @binding(1) var<uniform> page: PointPage;

struct PointPage {
    // The page's first light, tiles a side, texels a side of a tile, 0.
    first_tiles_texels: vec4<u32>,
}

struct Seen {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) tile: vec2<u32>,
}

@vertex
fn vertex(@location(0) position: vec3<f32>, @builtin(instance_index) instance: u32) -> Seen {
    let camera = cameras.cameras[page.first_tiles_texels.x + instance];
    let tiles = page.first_tiles_texels.y;
    let texels = page.first_tiles_texels.z;
    let side = f32(tiles * texels);
    let at = point_mapped(camera, position);
    var seen: Seen;
    seen.tile = vec2<u32>(instance % tiles, instance / tiles);
    let x = at.x + f32(seen.tile.x * texels) * at.z;
    let y = at.y + f32(seen.tile.y * texels) * at.z;
    // Behind the near plane 0 <= z <= w: the hardware cuts triangles there.
    seen.clip = vec4<f32>(2.0 * x / side - at.z, at.z - 2.0 * y / side, at.z - camera.place_near.w, at.z);
    if camera.place_near.w <= 0.0 {
        seen.clip = vec4<f32>(0.0, 0.0, -1.0, 1.0);
    }
    return seen;
}

@fragment
fn fragment(seen: Seen) -> @location(0) vec4<u32> {
    if any(vec2<u32>(seen.clip.xy) / page.first_tiles_texels.z != seen.tile) {
        discard;
    }
    // z / w = 1 - near / w.
    return vec4<u32>(bitcast<u32>(clamp(seen.clip.z, 0.0, 1.0)), 0u, 0u, 0u);
}
