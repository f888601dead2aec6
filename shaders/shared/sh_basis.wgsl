// Real spherical harmonics y_lm (Eq. 1 of [Now11]): Re/Im (x+iy)^m times a polynomial of z, by the three-term
// recurrence P_l^m = a (z P_{l-1}^m - b P_{l-2}^m), written out: no index is dynamic and no loop has to be unrolled.
// Condon-Shortley phase inside; in the order of the index l(l+1)+m. Twin: src/math/sh/basis.rs.

// Bands 0 to 3: coefficients 0 to 15.
fn sh_low(direction: vec3<f32>) -> array<f32, 16> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let re1 = x;
    let im1 = y;
    let re2 = x * re1 - y * im1;
    let im2 = x * im1 + y * re1;
    let re3 = x * re2 - y * im2;
    let im3 = x * im2 + y * re2;
    let p00 = 0.282094792;
    let p10 = 1.732050808 * z * p00;
    let p20 = 1.936491673 * (z * p10 - 0.577350269 * p00);
    let p30 = 1.972026594 * (z * p20 - 0.516397779 * p10);
    let p11 = -0.488602512;
    let p21 = 2.236067977 * z * p11;
    let p31 = 2.091650066 * (z * p21 - 0.447213595 * p11);
    let p22 = 0.546274215;
    let p32 = 2.645751311 * z * p22;
    let p33 = -0.590043590;
    return array<f32, 16>(
        p00,
        p11 * im1, p10, p11 * re1,
        p22 * im2, p21 * im1, p20, p21 * re1, p22 * re2,
        p33 * im3, p32 * im2, p31 * im1, p30, p31 * re1, p32 * re2, p33 * re3,
    );
}

// Bands 4 and 5: coefficients 16 to 35.
fn sh_high(direction: vec3<f32>) -> array<f32, 20> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let re1 = x;
    let im1 = y;
    let re2 = x * re1 - y * im1;
    let im2 = x * im1 + y * re1;
    let re3 = x * re2 - y * im2;
    let im3 = x * im2 + y * re2;
    let re4 = x * re3 - y * im3;
    let im4 = x * im3 + y * re3;
    let re5 = x * re4 - y * im4;
    let im5 = x * im4 + y * re4;
    let p00 = 0.282094792;
    let p10 = 1.732050808 * z * p00;
    let p20 = 1.936491673 * (z * p10 - 0.577350269 * p00);
    let p30 = 1.972026594 * (z * p20 - 0.516397779 * p10);
    let p40 = 1.984313483 * (z * p30 - 0.507092553 * p20);
    let p50 = 1.989974874 * (z * p40 - 0.503952631 * p30);
    let p11 = -0.488602512;
    let p21 = 2.236067977 * z * p11;
    let p31 = 2.091650066 * (z * p21 - 0.447213595 * p11);
    let p41 = 2.049390153 * (z * p31 - 0.478091444 * p21);
    let p51 = 2.031009601 * (z * p41 - 0.487950036 * p31);
    let p22 = 0.546274215;
    let p32 = 2.645751311 * z * p22;
    let p42 = 2.291287847 * (z * p32 - 0.377964473 * p22);
    let p52 = 2.171240593 * (z * p42 - 0.436435780 * p32);
    let p33 = -0.590043590;
    let p43 = 3.000000000 * z * p33;
    let p53 = 2.487468593 * (z * p43 - 0.333333333 * p33);
    let p44 = 0.625835735;
    let p54 = 3.316624790 * z * p44;
    let p55 = -0.656382057;
    return array<f32, 20>(
        p44 * im4, p43 * im3, p42 * im2, p41 * im1, p40, p41 * re1, p42 * re2, p43 * re3,
        p44 * re4,
        p55 * im5, p54 * im4, p53 * im3, p52 * im2, p51 * im1, p50, p51 * re1, p52 * re2,
        p53 * re3, p54 * re4, p55 * re5,
    );
}
