// Real spherical harmonics y_lm of orders 1 to 6 (Eq. 1 of [Now11]): Re/Im (x+iy)^m times a polynomial of z, by
// the three-term recurrence P_l^m = a (z P_{l-1}^m - b P_{l-2}^m), written out so that no index is dynamic.
// Condon-Shortley phase inside; index l(l+1)+m. Always all 36 values. Twin: src/math/sh/basis.rs.

fn sh_basis(direction: vec3<f32>) -> array<f32, 36> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    var sh: array<f32, 36>;
    // m = 0
    let p00 = 0.282094792;
    let p10 = 1.732050808 * z * p00;
    let p20 = 1.936491673 * (z * p10 - 0.577350269 * p00);
    let p30 = 1.972026594 * (z * p20 - 0.516397779 * p10);
    let p40 = 1.984313483 * (z * p30 - 0.507092553 * p20);
    let p50 = 1.989974874 * (z * p40 - 0.503952631 * p30);
    sh[0] = p00;
    sh[2] = p10;
    sh[6] = p20;
    sh[12] = p30;
    sh[20] = p40;
    sh[30] = p50;

    // m = 1 and -1
    let re1 = x;
    let im1 = y;
    let p11 = -0.488602512;
    let p21 = 2.236067977 * z * p11;
    let p31 = 2.091650066 * (z * p21 - 0.447213595 * p11);
    let p41 = 2.049390153 * (z * p31 - 0.478091444 * p21);
    let p51 = 2.031009601 * (z * p41 - 0.487950036 * p31);
    sh[1] = p11 * im1;
    sh[3] = p11 * re1;
    sh[5] = p21 * im1;
    sh[7] = p21 * re1;
    sh[11] = p31 * im1;
    sh[13] = p31 * re1;
    sh[19] = p41 * im1;
    sh[21] = p41 * re1;
    sh[29] = p51 * im1;
    sh[31] = p51 * re1;

    // m = 2 and -2
    let re2 = x * re1 - y * im1;
    let im2 = x * im1 + y * re1;
    let p22 = 0.546274215;
    let p32 = 2.645751311 * z * p22;
    let p42 = 2.291287847 * (z * p32 - 0.377964473 * p22);
    let p52 = 2.171240593 * (z * p42 - 0.436435780 * p32);
    sh[4] = p22 * im2;
    sh[8] = p22 * re2;
    sh[10] = p32 * im2;
    sh[14] = p32 * re2;
    sh[18] = p42 * im2;
    sh[22] = p42 * re2;
    sh[28] = p52 * im2;
    sh[32] = p52 * re2;

    // m = 3 and -3
    let re3 = x * re2 - y * im2;
    let im3 = x * im2 + y * re2;
    let p33 = -0.590043590;
    let p43 = 3.000000000 * z * p33;
    let p53 = 2.487468593 * (z * p43 - 0.333333333 * p33);
    sh[9] = p33 * im3;
    sh[15] = p33 * re3;
    sh[17] = p43 * im3;
    sh[23] = p43 * re3;
    sh[27] = p53 * im3;
    sh[33] = p53 * re3;

    // m = 4 and -4
    let re4 = x * re3 - y * im3;
    let im4 = x * im3 + y * re3;
    let p44 = 0.625835735;
    let p54 = 3.316624790 * z * p44;
    sh[16] = p44 * im4;
    sh[24] = p44 * re4;
    sh[26] = p54 * im4;
    sh[34] = p54 * re4;

    // m = 5 and -5
    let re5 = x * re4 - y * im4;
    let im5 = x * im4 + y * re4;
    let p55 = -0.656382057;
    sh[25] = p55 * im5;
    sh[35] = p55 * re5;
    return sh;
}
