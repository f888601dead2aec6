// What virtual objects leave of a known room's light, subtracted light by light from what an 8-bit display shows of the place,
// as in [Gib03]. Comes after subtract.wgsl, whose bindings, vertex stage and light it uses.
// Twin: src/core/nearfield/subtract_displayed.rs.

// As `listed`: what lights before one in its set send to the triangle's corners; w: 0 first set, 1 second.
@group(0) @binding(13) var before: texture_2d<f32>;
// Of the camera's picture.
@group(0) @binding(14) var exposures: texture_2d<f32>;
// 256 columns; for each channel where values step up, then for each channel the exposure of each value.
@group(0) @binding(15) var display: texture_2d<f32>;

const LARGEST_FINITE = 3.4028235e38;

// How many of a row are at or below an exposure.
fn steps(row: u32, exposure: f32) -> u32 {
    var z = 0u;
    for (var step = 128u; step > 0u; step /= 2u) {
        if textureLoad(display, vec2<u32>(z + step - 1u, row), 0).x <= exposure {
            z += step;
        }
    }
    // The last one.
    if z == 255u && textureLoad(display, vec2<u32>(255u, row), 0).x <= exposure {
        z = 256u;
    }
    return z;
}

fn shown_value(channel: u32, exposure: f32) -> f32 {
    // Also false for what is not a number.
    if !(exposure > 0.0) {
        return 0.0;
    }
    return f32(steps(channel, min(exposure, LARGEST_FINITE)));
}

fn exposure_of(channel: u32, value: f32) -> f32 {
    return textureLoad(display, vec2<u32>(u32(value), 3u + channel), 0).x;
}

// As a real number, linear between whole values.
fn value_of(channel: u32, exposure: f32) -> f32 {
    let above = steps(3u + channel, exposure);
    if above == 0u {
        return 0.0;
    }
    if above == 256u {
        return 255.0;
    }
    let low = textureLoad(display, vec2<u32>(above - 1u, 3u + channel), 0).x;
    let high = textureLoad(display, vec2<u32>(above, 3u + channel), 0).x;
    return f32(above - 1u) + (exposure - low) / (high - low);
}

fn shown_at(pixel: vec2<i32>) -> vec3<f32> {
    let exposure = textureLoad(exposures, pixel, 0).xyz;
    return vec3<f32>(shown_value(0u, exposure.x), shown_value(1u, exposure.y), shown_value(2u, exposure.z));
}

// What the display shows of the room.
@fragment
fn shown_room(seen: Seen) -> @location(0) vec4<f32> {
    return vec4<f32>(shown_at(vec2<i32>(seen.clip.xy)) / 255.0, 0.0);
}

// In whole values: of a light that sends `own` of all light `whole` after others of its set that send `earlier`.
fn displayed_transfer(
    shown: vec3<f32>, whole: vec3<f32>, earlier: vec3<f32>, own: vec3<f32>, hidden: vec3<f32>
) -> vec3<f32> {
    var taken = vec3<f32>(0.0);
    for (var c = 0u; c < 3u; c += 1u) {
        if whole[c] > TINY_LIGHT && hidden[c] > 0.0 {
            let exposure = exposure_of(c, shown[c]);
            let high = value_of(c, exposure * max(1.0 - earlier[c] / whole[c], 0.0));
            let low = value_of(c, exposure * max(1.0 - (earlier[c] + own[c]) / whole[c], 0.0));
            taken[c] = floor(hidden[c] * (high - low) + 0.5);
        }
    }
    return taken;
}

// A pass a light: what it is worth where it is hidden, to be subtracted from the target.
@fragment
fn one_displayed(seen: Seen) -> @location(0) vec4<f32> {
    if is_untouched(seen) {
        discard;
    }
    let light = all_light(seen);
    let shown = shown_at(vec2<i32>(seen.clip.xy));
    let suns_own = light.whole - seen.gathered;
    if turn.light.x == SUNS {
        let hidden = select(vec3<f32>(0.0), light.blocked / suns_own, light.blocked > vec3<f32>(0.0));
        return vec4<f32>(displayed_transfer(shown, light.whole, vec3<f32>(0.0), suns_own, hidden) / 255.0, 0.0);
    }
    // The list is in order of the lights' numbers.
    let range = listed_range(seen);
    var low = range.x;
    var high = range.y;
    while low < high {
        let middle = (low + high) / 2u;
        if u32(textureLoad(listed, listed_at(middle), 0).w) < turn.light.x {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    if low >= range.y || u32(textureLoad(listed, listed_at(low), 0).w) != turn.light.x {
        discard;
    }
    let visible = point_visibility(turn.light.x, seen.point_world, part_of(seen, listed_at(low)));
    if visible >= 1.0 {
        discard;
    }
    let weights = vec3<f32>(seen.weights, 1.0 - seen.weights.x - seen.weights.y);
    var own = vec3<f32>(0.0);
    var earlier = vec3<f32>(0.0);
    var of_second = 0.0;
    for (var corner = 0; corner < 3; corner += 1) {
        let at = listed_at(low) + vec2<i32>(corner, 0);
        let others = textureLoad(before, at, 0);
        own += weights[corner] * textureLoad(listed, at, 0).xyz;
        earlier += weights[corner] * others.xyz;
        of_second = others.w;
    }
    earlier += of_second * suns_own;
    let hidden = vec3<f32>(1.0 - visible);
    return vec4<f32>(displayed_transfer(shown, light.whole, earlier, own, hidden) / 255.0, 0.0);
}

// After all passes: what makes of the camera's picture what is left, as the bits of three floats.
@fragment
fn after_displayed(seen: Seen) -> @location(0) vec4<u32> {
    let pixel = vec2<i32>(seen.clip.xy);
    let exposure = textureLoad(exposures, pixel, 0).xyz;
    let shown = shown_at(pixel);
    let left = floor(textureLoad(taken, pixel, 0).xyz * 255.0 + 0.5);
    var ratio = vec3<f32>(1.0);
    for (var c = 0u; c < 3u; c += 1u) {
        if left[c] < shown[c] && exposure[c] <= LARGEST_FINITE {
            ratio[c] = select(min(exposure_of(c, left[c]) / exposure[c], 1.0), 0.0, left[c] == 0.0);
        }
    }
    return vec4<u32>(bitcast<vec3<u32>>(ratio), 0u);
}
