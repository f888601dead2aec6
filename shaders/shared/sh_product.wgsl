// Functions in SH of order SH_ORDER, four coefficients a row, and their truncated product (Eq. 4 of [Now11]) through their
// values on rings of equal z. Twins: src/math/sh/rings.rs, and `guard` of src/math/sh/lanes.rs. Written out: no index is
// dynamic, so that all coefficients can stay in registers; what the order does not need is left out when a pipeline is
// made. Needs shared/sh_basis.

// 2 to 6.
override SH_ORDER: u32 = 4u;

// Coefficient i at row i / 4; 0 from SH_ORDER^2 on. Up to order 4 the rows from the fifth on are not used.
alias Sh = array<vec4<f32>, 9>;

// sqrt(4 pi): the coefficient of the constant 1.
const WHOLE = 3.5449077;

// Legendre functions on the rings at z >= 0, P_lm at l (l + 1) / 2 + m, and the same times the solid angle of a sample.
struct Ring {
    values: array<vec4<f32>, 6>,
    weighted: array<vec4<f32>, 6>,
}

// Cosine and sine waves of each m on the ring at z (x, y) and on the one at -z (z, w).
alias Waves = array<vec4<f32>, 6>;

// y_i(direction), i < SH_ORDER^2.
fn sh_of(direction: vec3<f32>) -> Sh {
    let a = sh_low(direction);
    var y = Sh();
    y[0] = vec4<f32>(a[0], a[1], a[2], a[3]);
    if SH_ORDER > 2u {
        y[1] = vec4<f32>(a[4], a[5], a[6], a[7]);
        y[2].x = a[8];
    }
    if SH_ORDER > 3u {
        y[2] = vec4<f32>(a[8], a[9], a[10], a[11]);
        y[3] = vec4<f32>(a[12], a[13], a[14], a[15]);
    }
    if SH_ORDER > 4u {
        let b = sh_high(direction);
        y[4] = vec4<f32>(b[0], b[1], b[2], b[3]);
        y[5] = vec4<f32>(b[4], b[5], b[6], b[7]);
        y[6].x = b[8];
        if SH_ORDER > 5u {
            y[6] = vec4<f32>(b[8], b[9], b[10], b[11]);
            y[7] = vec4<f32>(b[12], b[13], b[14], b[15]);
            y[8] = vec4<f32>(b[16], b[17], b[18], b[19]);
        }
    }
    return y;
}

// Each band times a factor: bands 0 to 3, and 4 to 5.
fn sh_bands(f: Sh, low: vec4<f32>, high: vec2<f32>) -> Sh {
    var out = f;
    out[0] *= low.xyyy;
    out[1] *= low.z;
    out[2] *= low.zwww;
    out[3] *= low.w;
    if SH_ORDER > 4u {
        out[4] *= high.x;
        out[5] *= high.x;
        out[6] *= high.xyyy;
        out[7] *= high.y;
        out[8] *= high.y;
    }
    return out;
}

// f + factor g.
fn sh_add(f: Sh, g: Sh, factor: f32) -> Sh {
    var out = f;
    out[0] += factor * g[0];
    out[1] += factor * g[1];
    out[2] += factor * g[2];
    out[3] += factor * g[3];
    if SH_ORDER > 4u {
        out[4] += factor * g[4];
        out[5] += factor * g[5];
        out[6] += factor * g[6];
        out[7] += factor * g[7];
        out[8] += factor * g[8];
    }
    return out;
}

// The norm of all bands above 0.
fn sh_norm_above_mean(f: Sh) -> f32 {
    var sum = dot(f[0].yzw, f[0].yzw) + dot(f[1], f[1]) + dot(f[2], f[2]) + dot(f[3], f[3]);
    if SH_ORDER > 4u {
        sum += dot(f[4], f[4]) + dot(f[5], f[5]) + dot(f[6], f[6]) + dot(f[7], f[7]) + dot(f[8], f[8]);
    }
    return sqrt(sum);
}

// What 0 <= V <= 1 allows.
fn sh_guard(v: Sh) -> Sh {
    let mean = clamp(v[0].x, 0.0, WHOLE);
    let bound = sqrt(max(mean * (WHOLE - mean), 0.0));
    let norm = sh_norm_above_mean(v);
    var out = v;
    if norm > bound {
        out = sh_add(Sh(), v, bound / norm);
    }
    out[0].x = mean;
    return out;
}

// f on the rings at z and -z: the bands with l - m even are equal on both, the others opposite.
fn sh_to_rings(f: Sh, ring: Ring) -> Waves {
    let p = ring.values;
    var waves = Waves();
    var even0 = p[0].x * f[0].x + p[0].w * f[1].z;
    var odd0 = p[0].y * f[0].z + p[1].z * f[3].x;
    var even1 = p[0].z * vec2<f32>(f[0].w, f[0].y) + p[1].w * vec2<f32>(f[3].y, f[2].w);
    var odd1 = p[1].x * vec2<f32>(f[1].w, f[1].y);
    var even2 = p[1].y * vec2<f32>(f[2].x, f[1].x);
    var odd2 = p[2].x * vec2<f32>(f[3].z, f[2].z);
    var even3 = p[2].y * vec2<f32>(f[3].w, f[2].y);
    var odd3 = vec2<f32>(0.0);
    if SH_ORDER > 4u {
        even0 += p[2].z * f[5].x;
        odd0 += p[3].w * f[7].z;
        even1 += p[4].x * vec2<f32>(f[7].w, f[7].y);
        odd1 += p[2].w * vec2<f32>(f[5].y, f[4].w);
        even2 += p[3].x * vec2<f32>(f[5].z, f[4].z);
        odd2 += p[4].y * vec2<f32>(f[8].x, f[7].x);
        even3 += p[4].z * vec2<f32>(f[8].y, f[6].w);
        odd3 += p[3].y * vec2<f32>(f[5].w, f[4].y);
        let even4 = p[3].z * vec2<f32>(f[6].x, f[4].x);
        let odd4 = p[4].w * vec2<f32>(f[8].z, f[6].z);
        waves[4] = vec4<f32>(even4 + odd4, even4 - odd4);
        let even5 = p[5].x * vec2<f32>(f[8].w, f[6].y);
        waves[5] = even5.xyxy;
    }
    waves[0] = vec4<f32>(even0 + odd0, 0.0, even0 - odd0, 0.0);
    waves[1] = vec4<f32>(even1 + odd1, even1 - odd1);
    waves[2] = vec4<f32>(even2 + odd2, even2 - odd2);
    waves[3] = vec4<f32>(even3 + odd3, even3 - odd3);
    return waves;
}

// Adds what the rings give to the coefficients.
fn sh_from_rings(waves: Waves, ring: Ring, sum: Sh) -> Sh {
    let p = ring.weighted;
    var out = sum;
    let both0 = waves[0].xy + waves[0].zw;
    let apart0 = waves[0].xy - waves[0].zw;
    let both1 = waves[1].xy + waves[1].zw;
    let apart1 = waves[1].xy - waves[1].zw;
    let both2 = waves[2].xy + waves[2].zw;
    let apart2 = waves[2].xy - waves[2].zw;
    let both3 = waves[3].xy + waves[3].zw;
    let apart3 = waves[3].xy - waves[3].zw;
    if SH_ORDER > 4u {
        let both4 = waves[4].xy + waves[4].zw;
        let apart4 = waves[4].xy - waves[4].zw;
        let both5 = waves[5].xy + waves[5].zw;
        out[5].x += p[2].z * both0.x;
        out[5].y += p[2].w * apart1.x;
        out[4].w += p[2].w * apart1.y;
        out[5].z += p[3].x * both2.x;
        out[4].z += p[3].x * both2.y;
        out[5].w += p[3].y * apart3.x;
        out[4].y += p[3].y * apart3.y;
        out[6].x += p[3].z * both4.x;
        out[4].x += p[3].z * both4.y;
        out[7].z += p[3].w * apart0.x;
        out[7].w += p[4].x * both1.x;
        out[7].y += p[4].x * both1.y;
        out[8].x += p[4].y * apart2.x;
        out[7].x += p[4].y * apart2.y;
        out[8].y += p[4].z * both3.x;
        out[6].w += p[4].z * both3.y;
        out[8].z += p[4].w * apart4.x;
        out[6].z += p[4].w * apart4.y;
        out[8].w += p[5].x * both5.x;
        out[6].y += p[5].x * both5.y;
    }
    out[0].x += p[0].x * both0.x;
    out[0].z += p[0].y * apart0.x;
    out[0].w += p[0].z * both1.x;
    out[0].y += p[0].z * both1.y;
    out[1].z += p[0].w * both0.x;
    out[1].w += p[1].x * apart1.x;
    out[1].y += p[1].x * apart1.y;
    out[2].x += p[1].y * both2.x;
    out[1].x += p[1].y * both2.y;
    out[3].x += p[1].z * apart0.x;
    out[3].y += p[1].w * both1.x;
    out[2].w += p[1].w * both1.y;
    out[3].z += p[2].x * apart2.x;
    out[2].z += p[2].x * apart2.y;
    out[3].w += p[2].y * both3.x;
    out[2].y += p[2].y * both3.y;
    return out;
}

// Waves up to m = 3 at phi = 2 pi j / 12, on both rings: even ones repeat after half a turn, odd ones change sign.
fn sh_twelve(w: Waves) -> array<vec2<f32>, 12> {
    let mean = w[0].xz;
    let c = 0.5 * w[2].xz;
    let s = 0.8660254 * w[2].yw;
    let plus = mean + c;
    let minus = mean - c;
    let e = array(mean + 2.0 * c, plus + s, minus + s, mean - 2.0 * c, minus - s, plus - s);
    let c_root = 0.8660254 * w[1].xz;
    let s_root = 0.8660254 * w[1].yw;
    let side = 0.5 * w[1].yw + w[3].yw;
    let tilt = 0.5 * w[1].xz - w[3].xz;
    let o = array(w[1].xz + w[3].xz, side + c_root, s_root + tilt, w[1].yw - w[3].yw, s_root - tilt, side - c_root);
    return array(
        e[0] + o[0], e[1] + o[1], e[2] + o[2], e[3] + o[3], e[4] + o[4], e[5] + o[5],
        e[0] - o[0], e[1] - o[1], e[2] - o[2], e[3] - o[3], e[4] - o[4], e[5] - o[5],
    );
}

// Sums of 12 samples times cos and sin of m phi, m up to 3.
fn sh_from_twelve(h: array<vec2<f32>, 12>) -> Waves {
    let e = array(h[0] + h[6], h[1] + h[7], h[2] + h[8], h[3] + h[9], h[4] + h[10], h[5] + h[11]);
    let o = array(h[0] - h[6], h[1] - h[7], h[2] - h[8], h[3] - h[9], h[4] - h[10], h[5] - h[11]);
    let near = e[1] + e[5];
    let far = e[2] + e[4];
    let side = o[1] + o[5];
    let cross = o[2] - o[4];
    return sh_waves(
        e[0] + e[3] + near + far,
        array(
            o[0] + 0.8660254 * (o[1] - o[5]) + 0.5 * cross,
            e[0] - e[3] + 0.5 * (near - far),
            o[0] - cross,
            vec2<f32>(0.0),
            vec2<f32>(0.0),
        ),
        array(
            o[3] + 0.8660254 * (o[2] + o[4]) + 0.5 * side,
            0.8660254 * (e[1] - e[5] + e[2] - e[4]),
            side - o[3],
            vec2<f32>(0.0),
            vec2<f32>(0.0),
        ),
    );
}

// From the mean and the cosine and sine waves of m = 1 to 5, each on both rings.
fn sh_waves(mean: vec2<f32>, cosine: array<vec2<f32>, 5>, sine: array<vec2<f32>, 5>) -> Waves {
    return Waves(
        vec4<f32>(mean.x, 0.0, mean.y, 0.0),
        vec4<f32>(cosine[0], sine[0]).xzyw,
        vec4<f32>(cosine[1], sine[1]).xzyw,
        vec4<f32>(cosine[2], sine[2]).xzyw,
        vec4<f32>(cosine[3], sine[3]).xzyw,
        vec4<f32>(cosine[4], sine[4]).xzyw,
    );
}

const COS_22_5 = 0.92387953;
const SIN_22_5 = 0.38268343;
const COS_45 = 0.70710678;

// Waves up to m = 5 at phi = 2 pi j / 16.
fn sh_sixteen(w: Waves) -> array<vec2<f32>, 16> {
    let mean = w[0].xz;
    let c1 = w[1].xz;
    let s1 = w[1].yw;
    let c2 = w[2].xz;
    let s2 = w[2].yw;
    let c4 = w[4].xz;
    let s4 = w[4].yw;
    let quarter = array(mean + c4, mean + s4, mean - c4, mean - s4);
    let turn = array(c2, COS_45 * (c2 + s2), s2, COS_45 * (s2 - c2));
    let e = array(
        quarter[0] + turn[0], quarter[1] + turn[1], quarter[2] + turn[2], quarter[3] + turn[3],
        quarter[0] - turn[0], quarter[1] - turn[1], quarter[2] - turn[2], quarter[3] - turn[3],
    );
    let c_sum = w[3].xz + w[5].xz;
    let c_gap = w[3].xz - w[5].xz;
    let s_sum = w[3].yw + w[5].yw;
    let s_gap = w[3].yw - w[5].yw;
    let x = array(c1 + c_sum, COS_22_5 * c1 + SIN_22_5 * c_gap, COS_45 * (c1 - c_sum), SIN_22_5 * c1 - COS_22_5 * c_gap);
    let y = array(SIN_22_5 * s1 + COS_22_5 * s_sum, COS_45 * (s1 + s_gap), COS_22_5 * s1 - SIN_22_5 * s_sum, s1 - s_gap);
    let o = array(x[0], x[1] + y[0], x[2] + y[1], x[3] + y[2], y[3], y[2] - x[3], y[1] - x[2], y[0] - x[1]);
    return array(
        e[0] + o[0], e[1] + o[1], e[2] + o[2], e[3] + o[3], e[4] + o[4], e[5] + o[5], e[6] + o[6], e[7] + o[7],
        e[0] - o[0], e[1] - o[1], e[2] - o[2], e[3] - o[3], e[4] - o[4], e[5] - o[5], e[6] - o[6], e[7] - o[7],
    );
}

// Sums of 16 samples times cos and sin of m phi, m up to 5.
fn sh_from_sixteen(h: array<vec2<f32>, 16>) -> Waves {
    let e = array(
        h[0] + h[8], h[1] + h[9], h[2] + h[10], h[3] + h[11], h[4] + h[12], h[5] + h[13], h[6] + h[14], h[7] + h[15],
    );
    let o = array(
        h[0] - h[8], h[1] - h[9], h[2] - h[10], h[3] - h[11], h[4] - h[12], h[5] - h[13], h[6] - h[14], h[7] - h[15],
    );
    let quarter = array(e[0] + e[4], e[1] + e[5], e[2] + e[6], e[3] + e[7]);
    let turn = array(e[0] - e[4], e[1] - e[5], e[2] - e[6], e[3] - e[7]);
    let q = array(o[1] - o[7], COS_45 * (o[2] - o[6]), o[3] - o[5]);
    let p = array(o[1] + o[7], COS_45 * (o[2] + o[6]), o[3] + o[5]);
    let c_in = o[0] - q[1];
    let c_gap = SIN_22_5 * q[0] - COS_22_5 * q[2];
    let s_in = p[1] - o[4];
    let s_gap = COS_22_5 * p[0] - SIN_22_5 * p[2];
    return sh_waves(
        quarter[0] + quarter[2] + quarter[1] + quarter[3],
        array(
            o[0] + q[1] + COS_22_5 * q[0] + SIN_22_5 * q[2],
            turn[0] + COS_45 * (turn[1] - turn[3]),
            c_in + c_gap,
            quarter[0] - quarter[2],
            c_in - c_gap,
        ),
        array(
            o[4] + p[1] + SIN_22_5 * p[0] + COS_22_5 * p[2],
            turn[2] + COS_45 * (turn[1] + turn[3]),
            s_gap + s_in,
            quarter[1] - quarter[3],
            s_gap - s_in,
        ),
    );
}

// What a pair of rings adds to the product.
fn sh_product_on(ring: Ring, f: Sh, g: Sh, sum: Sh) -> Sh {
    let a = sh_to_rings(f, ring);
    let b = sh_to_rings(g, ring);
    if SH_ORDER > 4u {
        let s = sh_sixteen(a);
        let t = sh_sixteen(b);
        let both = array(
            s[0] * t[0], s[1] * t[1], s[2] * t[2], s[3] * t[3], s[4] * t[4], s[5] * t[5], s[6] * t[6], s[7] * t[7],
            s[8] * t[8], s[9] * t[9], s[10] * t[10], s[11] * t[11], s[12] * t[12], s[13] * t[13], s[14] * t[14],
            s[15] * t[15],
        );
        return sh_from_rings(sh_from_sixteen(both), ring, sum);
    }
    let s = sh_twelve(a);
    let t = sh_twelve(b);
    let both = array(
        s[0] * t[0], s[1] * t[1], s[2] * t[2], s[3] * t[3], s[4] * t[4], s[5] * t[5],
        s[6] * t[6], s[7] * t[7], s[8] * t[8], s[9] * t[9], s[10] * t[10], s[11] * t[11],
    );
    return sh_from_rings(sh_from_twelve(both), ring, sum);
}
