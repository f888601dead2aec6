// How much of a near light virtual objects let through to a point of a receiver.
// Twin: src/core/visibility/point_maps.rs (visibility, of surfaces that do not cast).

// Of a light what leaves less than this is rounding.
const FAINT = 1e-5;
const LEAST_HALF = 1e-3;

// Which part of a light is seen, of a code for each half axis: middles and half lengths along both, in their lengths.
fn seen_part(codes: vec2<f32>) -> vec4<f32> {
    let bits = vec2<u32>(codes);
    let middle = (vec2<f32>(bits >> vec2<u32>(12u)) - 2048.0) / 1024.0;
    return vec4<f32>(middle, vec2<f32>(bits & vec2<u32>(4095u)) / 2048.0);
}

// The shares of a part of a light, along both half axes, that lie in one of n cells of each; the outermost reach on for ever.
fn cell_share(cell: vec2<u32>, n: u32, low: vec2<f32>, high: vec2<f32>) -> f32 {
    let first = 2.0 * vec2<f32>(cell) / f32(n) - 1.0;
    let last = 2.0 * vec2<f32>(cell + 1u) / f32(n) - 1.0;
    let begin = select(low, max(low, first), cell > vec2<u32>(0u));
    let end = select(high, min(high, last), cell + 1u < vec2<u32>(n));
    let length = max(end - begin, vec2<f32>(0.0)) / (high - low);
    return length.x * length.y;
}

// a / b of small numbers: software devices divide integers one by one.
fn divided(a: u32, b: u32) -> u32 {
    return u32((f32(a) + 0.5) / f32(b));
}

// Of a part of light k.
fn point_visibility(k: u32, point_world: vec3<f32>, part: vec4<f32>) -> f32 {
    let camera = cameras_near.cameras[k];
    let near_m = camera.place_near.w;
    let corner = point_corner(camera);
    let seen = point_seen(camera, corner, point_world);
    let half_axes = lights.half_axes[k];
    let tiles = lights.tiles_maps_texels_side.x;
    let page = divided(k, lights.tiles_maps_texels_side.y);
    let tile = k - page * lights.tiles_maps_texels_side.y;
    let tile_row = divided(tile, tiles);
    let texels = lights.tiles_maps_texels_side.z;
    let n = places_a_side();
    let side = divided(texels, n);
    let first = vec2<u32>(tile - tile_row * tiles, tile_row) * texels;
    let half = max(part.zw, vec2<f32>(LEAST_HALF));
    let low = part.xy - half;
    let high = part.xy + half;
    var hidden = 0.0;
    // The end is looked for after each turn: software devices run one more where it is looked for before.
    var cell = vec2<u32>(0u);
    loop {
        let view = point_view(half_axes, corner, cell, n);
        let w = seen.z - view.ahead;
        let inverse = 1.0 / w;
        let at = floor((seen.xy - view.aside) * inverse + view.start);
        if near_m > 0.0 && w > near_m && all(at >= vec2<f32>(0.0)) && all(at < vec2<f32>(f32(side))) {
            let texel = vec2<i32>(first + cell * side + vec2<u32>(at));
            let stored = bitcast<f32>(textureLoad(point_maps, texel, i32(page), 0).x);
            if stored < 1.0 - near_m * inverse {
                hidden += select(1.0, cell_share(cell, n, low, high), n > 1u);
            }
        }
        continuing {
            cell.x += 1u;
            if cell.x == n {
                cell = vec2<u32>(0u, cell.y + 1u);
            }
            break if cell.y >= n;
        }
    }
    let open = 1.0 - hidden;
    return select(0.0, open, open > FAINT);
}
