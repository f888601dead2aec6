// Objects over the camera's picture: background x ratio x (1 - coverage) + object, in linear radiance.
// Twin: src/core/compose/composite.rs.

struct CompositeParams {
    // Columns and rows of the picture; first column and row of the object layer.
    size_origin: vec4<u32>,
    // Multiplies the object layer's colours: 1 / (what they were multiplied with).
    layer_scale: f32,
    // Bit 0: there is an object layer; bit 1: there are ratios.
    present: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> params: CompositeParams;
@group(0) @binding(1) var<storage, read> background: array<f32>;
@group(0) @binding(2) var object_layer: texture_2d<f32>;
@group(0) @binding(3) var ratios: texture_2d<u32>;
@group(0) @binding(4) var<storage, read_write> radiance: array<f32>;

@compute @workgroup_size(8, 8)
fn composite(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size_origin.xy) {
        return;
    }
    let at = (id.y * params.size_origin.x + id.x) * 3u;
    var out = vec3<f32>(background[at], background[at + 1u], background[at + 2u]);
    if (params.present & 2u) != 0u {
        out *= bitcast<vec3<f32>>(textureLoad(ratios, id.xy, 0).xyz);
    }
    // The layer is a part of the picture; what lies before it wraps round to large numbers.
    let place = id.xy - params.size_origin.zw;
    if (params.present & 1u) != 0u && all(place < textureDimensions(object_layer)) {
        let object = textureLoad(object_layer, place, 0);
        out = out * (1.0 - object.w) + object.xyz * params.layer_scale;
    }
    out = max(out, vec3<f32>(0.0));
    radiance[at] = out.x;
    radiance[at + 1u] = out.y;
    radiance[at + 2u] = out.z;
}
