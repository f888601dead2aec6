// Directions and solid angles of a mirror ball's pixels: the rays through each pixel's corners are mirrored at the
// sphere; their spherical quadrilateral is what the pixel sees. Any lens: the host makes the rays. Radiance and what
// the ball does not show are the host's part. Twin: src/core/light/unwrap_ball.rs (reflect_corner, cell).

struct UnwrapParams {
    // From the ball's centre to the camera, metres.
    eye_from_centre: vec3<f32>,
    // Metres.
    radius: f32,
    // Square of the largest distance between ray and centre that still counts.
    rim_squared: f32,
    // Pixels of the region.
    width: u32,
    height: u32,
    // 1: only the part of each cell with z > 0 counts.
    above_horizon: u32,
}

@group(0) @binding(0) var<uniform> params: UnwrapParams;
// (width + 1) x (height + 1): xyz unit, world frame; w 0 where the lens has no ray.
@group(0) @binding(1) var<storage, read> corner_rays: array<vec4<f32>>;
// xyz direction, w solid angle; all 0 where the pixel is not wholly on the ball.
@group(0) @binding(2) var<storage, read_write> cells: array<vec4<f32>>;

fn reflect_corner(ray: vec4<f32>) -> vec4<f32> {
    let k = ray.xyz;
    let along = dot(params.eye_from_centre, k);
    let foot = params.eye_from_centre - k * along;
    let distance_squared = dot(foot, foot);
    if ray.w == 0.0 || along >= 0.0 || distance_squared > params.rim_squared {
        return vec4<f32>(0.0);
    }
    let half_chord = sqrt(params.radius * params.radius - distance_squared);
    let normal = (foot - k * half_chord) / params.radius;
    let reflected = k + normal * (2.0 * half_chord / params.radius);
    return vec4<f32>(reflected / length(reflected), 1.0);
}

// atan(y / x) for x > 0 keeps its digits for small angles, which built-in functions need not.
fn angle(y: f32, x: f32) -> f32 {
    if abs(y) < 0.1 * x {
        let t = y / x;
        let s = t * t;
        return t * (1.0 - s * (1.0 / 3.0 - s * (1.0 / 5.0 - s / 7.0)));
    }
    return atan2(y, x);
}

struct Polygon {
    corners: array<vec3<f32>, 5>,
    count: u32,
}

// The part of a spherical quadrilateral with z >= 0.
fn clip_at_horizon(quad: array<vec3<f32>, 4>) -> Polygon {
    var corners = quad;
    var out: Polygon;
    for (var k = 0u; k < 4u; k += 1u) {
        let a = corners[k];
        let b = corners[(k + 1u) % 4u];
        if a.z > 0.0 && out.count < 5u {
            out.corners[out.count] = a;
            out.count += 1u;
        }
        if (a.z > 0.0) != (b.z > 0.0) && out.count < 5u {
            let crossing = a + (b - a) * (a.z / (a.z - b.z));
            let size = length(crossing.xy);
            if size > 0.0 {
                out.corners[out.count] = vec3<f32>(crossing.xy / size, 0.0);
                out.count += 1u;
            }
        }
    }
    if out.count < 3u {
        out.count = 0u;
    }
    return out;
}

fn cell(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>) -> vec4<f32> {
    if min(min(a.w, b.w), min(c.w, d.w)) == 0.0 {
        return vec4<f32>(0.0);
    }
    var polygon: Polygon;
    polygon.corners[0] = a.xyz;
    polygon.corners[1] = b.xyz;
    polygon.corners[2] = c.xyz;
    polygon.corners[3] = d.xyz;
    polygon.count = 4u;
    if params.above_horizon == 1u && min(min(a.z, b.z), min(c.z, d.z)) <= 0.0 {
        polygon = clip_at_horizon(array<vec3<f32>, 4>(a.xyz, b.xyz, c.xyz, d.xyz));
    }
    var total = 0.0;
    var moment = vec3<f32>(0.0);
    let p = polygon.corners[0];
    for (var k = 2u; k < polygon.count; k += 1u) {
        let q = polygon.corners[k - 1u];
        let r = polygon.corners[k];
        // The triple product of the differences: nearly parallel vectors keep their digits.
        let volume = dot(p, cross(q - p, r - p));
        let omega = 2.0 * angle(volume, 1.0 + dot(p, q) + dot(q, r) + dot(r, p));
        total += omega;
        moment += (p + q + r) * omega;
    }
    let size = length(moment);
    // Also where it is not a number.
    if !(size > 0.0) {
        return vec4<f32>(0.0);
    }
    // A mirror turns the corners' order over; the sign of both sums turns with it.
    return vec4<f32>(moment * (sign(total) / size), abs(total));
}

@compute @workgroup_size(8, 8)
fn unwrap(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.width || id.y >= params.height {
        return;
    }
    let top = id.y * (params.width + 1u) + id.x;
    let bottom = top + params.width + 1u;
    cells[id.y * params.width + id.x] = cell(
        reflect_corner(corner_rays[top]),
        reflect_corner(corner_rays[top + 1u]),
        reflect_corner(corner_rays[bottom + 1u]),
        reflect_corner(corner_rays[bottom]),
    );
}
