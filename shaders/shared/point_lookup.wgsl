// How much of a near light virtual objects let through to a point of a flat receiver.
// Twin: src/visibility/point_maps.rs (visibility).

struct PointLights {
    // Tiles a side of a page, maps a page, texels a side of a map, places a side of each light.
    tiles_maps_texels_side: vec4<u32>,
    // Half axes of each light's extent in its camera's axes, metres; the first one's w is the side of a texel one metre
    // before the light, metres.
    half_axes: array<array<vec4<f32>, 2>, 256>,
}

const SMOOTH_TEXELS = 0.75;

// All reads of a map for one point.
struct Reading {
    // Column and row, texels.
    at: vec2<f32>,
    depth: f32,
    // Of the receiver's plane, depth a texel.
    slope: vec2<f32>,
    rounding: f32,
    // First texel of the map in its page.
    first: vec2<i32>,
    page: i32,
    side: f32,
}

// The depth of what hides the point at a position of its map; below 0: nothing does.
fn hidden_by(reading: Reading, at: vec2<f32>) -> f32 {
    let texel = floor(at);
    if !(all(texel >= vec2<f32>(0.0)) && all(texel < vec2<f32>(reading.side))) {
        return -1.0;
    }
    let bits = textureLoad(point_maps, reading.first + vec2<i32>(texel), reading.page, 0).x;
    let stored = bitcast<f32>(bits);
    let plane = reading.depth + dot(reading.slope, texel + 0.5 - reading.at);
    return select(-1.0, stored, stored < min(plane - reading.rounding, EMPTY_DEPTH));
}

// A vector of the world in the camera's axes right, up and forward: the axes after the forward one in turn.
fn along_axes(camera: PointCamera, v: vec3<f32>) -> vec3<f32> {
    let forward = abs(camera.forward.xyz);
    return vec3<f32>(dot(v.yzx, forward), dot(v.zxy, forward), dot(v, camera.forward.xyz));
}

// Which part of a light is seen, of a code for each half axis: middles and half lengths along both, in their lengths.
fn seen_part(codes: vec2<f32>) -> vec4<f32> {
    let bits = vec2<u32>(codes);
    let middle = (vec2<f32>(bits >> vec2<u32>(12u)) - 2048.0) / 1024.0;
    return vec4<f32>(middle, vec2<f32>(bits & vec2<u32>(4095u)) / 2048.0);
}

// Of a part of light k.
fn point_visibility(k: u32, point_world: vec3<f32>, normal: vec3<f32>, part: vec4<f32>) -> f32 {
    let camera = cameras_near.cameras[k];
    let near_m = camera.place_near.w;
    let mapped = point_mapped(camera, point_world);
    let w = mapped.z;
    if near_m <= 0.0 || w <= near_m {
        return 1.0;
    }
    let texel = lights.half_axes[k][0].w;
    let tile = k % lights.tiles_maps_texels_side.y;
    let tiles = lights.tiles_maps_texels_side.x;
    let texels = lights.tiles_maps_texels_side.z;
    var reading: Reading;
    reading.at = mapped.xy / w;
    reading.depth = 1.0 - near_m / w;
    reading.rounding = ROUNDING_TEXELS * texel * (1.0 - reading.depth);
    reading.first = vec2<i32>(vec2<u32>(tile % tiles, tile / tiles) * texels);
    reading.page = i32(k / lights.tiles_maps_texels_side.y);
    reading.side = f32(texels);
    // How the plane's depth changes along the map, bounded where the light lies nearly in the plane.
    let off = dot(normal, point_world - camera.place_near.xyz);
    let most = MAX_BIAS_TEXELS * texel * near_m / w;
    let across = along_axes(camera, normal).xy;
    if off != 0.0 {
        reading.slope = clamp(-near_m * texel * across / off, vec2<f32>(-most), vec2<f32>(most));
    }
    let first = hidden_by(reading, reading.at);
    let n = lights.tiles_maps_texels_side.w;
    if n <= 1u {
        return select(0.0, 1.0, first < 0.0);
    }
    // Position at which the ray to a place beside the light's middle passes a blocker at a distance along the axis.
    let corner = -vec2<f32>(dot(camera.column.xyz, camera.forward.xyz), dot(camera.row.xyz, camera.forward.xyz));
    let inverse_r = (1.0 - reading.depth) / near_m;
    let u = lights.half_axes[k][0].xyz;
    let v = lights.half_axes[k][1].xyz;
    var sum = max(first, 0.0);
    var count = select(1.0, 0.0, first < 0.0);
    var inverse_b = 1.0 / near_m;
    var lit = 0.0;
    // First round: blockers at the near plane, and their mean; second round: how many places that one hides.
    for (var round = 0u; round < 2u; round += 1u) {
        for (var i = 0u; i < n * n; i += 1u) {
            let step = (2.0 * vec2<f32>(f32(i % n), f32(i / n)) + 1.0) / f32(n) - 1.0;
            let beside = part.xy + part.zw * step;
            let place = u * beside.x + v * beside.y;
            let forward = 1.0 / (1.0 - place.z * inverse_r);
            let scale = forward * (1.0 - place.z * inverse_b);
            let along = forward * (inverse_b - inverse_r) / texel;
            let at = (reading.at + corner) * scale - corner + place.xy * along;
            let stored = hidden_by(reading, at + SMOOTH_TEXELS * step);
            if stored >= 0.0 {
                sum += stored;
                count += 1.0;
            } else {
                lit += 1.0;
            }
        }
        if round == 0u {
            if count == 0.0 {
                return 1.0;
            }
            inverse_b = (1.0 - sum / count) / near_m;
            lit = 0.0;
        }
    }
    return lit / f32(n * n);
}
