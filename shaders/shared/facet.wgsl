// The facet that a fragment lies on, from derivatives. `from_eye`: its point minus the eye, interpolated with
// perspective to the pixel's centre; `inverse_w`: the w of the fragment's position. Their product A and inverse_w
// itself run linearly over the picture, also beyond the triangle and its horizon, where the point itself does not:
// the cross product of the point's derivatives is written in those. The result looks at the eye.

fn facet_normal(from_eye: vec3<f32>, inverse_w: f32) -> vec3<f32> {
    let a = from_eye * inverse_w;
    let a_x = dpdx(a);
    let a_y = dpdy(a);
    let facet = normalize(
        inverse_w * cross(a_x, a_y) - dpdx(inverse_w) * cross(a, a_y) - dpdy(inverse_w) * cross(a_x, a),
    );
    return select(facet, -facet, dot(facet, from_eye) > 0.0);
}
