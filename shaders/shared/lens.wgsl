// World points to clip space through any lens. Twin: src/math/lens.rs (pinhole, radial-tangential, equidistant).
// Depth is reversed: near / distance, 1 at the near distance and 0 at infinity.

struct View {
    // Camera's position, world frame, metres.
    eye: vec4<f32>,
    // Rows of camera_from_world (rotation).
    right: vec4<f32>,
    down: vec4<f32>,
    forward: vec4<f32>,
    // fx, fy, cx, cy in pixels.
    focal: vec4<f32>,
    // Width, height in pixels, near distance in metres, largest squared radius (radial) or angle (equidistant).
    frame: vec4<f32>,
    // k1 k2 p1 p2 and k3 k4 k5 k6 (radial), k1 k2 k3 k4 (equidistant).
    distortion: vec4<f32>,
    distortion_more: vec4<f32>,
    // Model: 0 pinhole, 1 radial-tangential, 2 equidistant.
    model: vec4<u32>,
}

const RADIAL = 1u;
const EQUIDISTANT = 2u;

fn distort_radial(view: View, plane: vec2<f32>) -> vec2<f32> {
    let k = view.distortion;
    let more = view.distortion_more;
    // Beyond the largest radius the last ratio goes on: such points lie outside of the picture.
    let s = min(dot(plane, plane), view.frame.w);
    let ratio = (1.0 + s * (k.x + s * (k.y + s * more.x))) / (1.0 + s * (more.y + s * (more.z + s * more.w)));
    let cross = 2.0 * plane.x * plane.y;
    return plane * ratio + vec2<f32>(
        k.z * cross + k.w * (s + 2.0 * plane.x * plane.x),
        k.z * (s + 2.0 * plane.y * plane.y) + k.w * cross,
    );
}

// Where a world point lands; `scale` of the depth, 1 but for what is moved back a little.
fn clip_position(view: View, point_world: vec3<f32>, depth_scale: f32) -> vec4<f32> {
    let from_eye = point_world - view.eye.xyz;
    let p = vec3<f32>(
        dot(view.right.xyz, from_eye),
        dot(view.down.xyz, from_eye),
        dot(view.forward.xyz, from_eye),
    );
    // Pixels from the principal point times w.
    var scaled = p.xy;
    var w = p.z;
    var depth = view.frame.z * depth_scale;
    if view.model.x == RADIAL && p.z > 0.0 {
        scaled = distort_radial(view, p.xy / p.z) * p.z;
    }
    if view.model.x == EQUIDISTANT {
        let sine = length(p.xy);
        let theta = atan2(sine, p.z);
        let square = theta * theta;
        let k = view.distortion;
        let bent = theta * (1.0 + square * (k.x + square * (k.y + square * (k.z + square * k.w))));
        w = length(p);
        scaled = select(vec2<f32>(0.0), p.xy * (bent / sine), sine > 0.0) * w;
        if theta > view.frame.w {
            depth = -w;
        }
    }
    let offset = 2.0 * view.focal.zw - view.frame.xy;
    let xy = (2.0 * view.focal.xy * scaled + offset * w) / view.frame.xy;
    return vec4<f32>(xy.x, -xy.y, depth, w);
}
