//! From the primaries that a file states to ours.

use exr::{math::Vec2, meta::attribute::Chromaticities};
use glam::{DMat3, DVec3};

/// Rec. 709: red, green, blue and D65 (ITU-R BT.709), as x and y.
const REC_709: [[f64; 2]; 4] = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]];
/// Differences of x and y below this are how the same primaries are rounded.
const SAME: f64 = 2e-4;
/// Bradford's response of the eye's cones to X, Y, Z; for the change from one white to another.
const CONES: DMat3 = DMat3::from_cols(
    DVec3::new(0.8951, -0.7502, 0.0389),
    DVec3::new(0.2664, 1.7135, -0.0685),
    DVec3::new(-0.1614, 0.0367, 1.0296),
);

/// Rec. 709 as OpenEXR states it.
pub fn rec709() -> Chromaticities {
    let [red, green, blue, white] = REC_709.map(|[x, y]| Vec2(x as f32, y as f32));
    Chromaticities { red, green, blue, white }
}

/// X, Y, Z of a chromaticity, whose sum is 1.
fn xyz([x, y]: [f64; 2]) -> DVec3 {
    DVec3::new(x, y, 1.0 - x - y)
}

/// X, Y, Z of a white with Y = 1; not finite for what is no white.
fn white_xyz(white: [f64; 2]) -> DVec3 {
    xyz(white) / white[1].max(0.0)
}

/// From red, green and blue, whose sum is the white, to X, Y, Z.
fn to_xyz([red, green, blue, white]: [[f64; 2]; 4]) -> Option<DMat3> {
    let primaries = DMat3::from_cols(xyz(red), xyz(green), xyz(blue));
    let is_sound = primaries.is_finite() && primaries.determinant().abs() > 1e-6;
    let shares = is_sound.then(|| primaries.inverse() * white_xyz(white))?;
    (shares.is_finite() && shares.min_element() > 0.0).then(|| primaries * DMat3::from_diagonal(shares))
}

/// What brings colours of these primaries into Rec. 709, white to white; `Some(None)` where they are the same, `None` where they
/// are no primaries.
pub fn to_rec709(stated: &Chromaticities) -> Option<Option<DMat3>> {
    let stated =
        [stated.red, stated.green, stated.blue, stated.white].map(|Vec2(x, y)| [f64::from(x), f64::from(y)]);
    let near = |(a, b): (&[f64; 2], &[f64; 2])| (0..2).all(|k| (a[k] - b[k]).abs() < SAME);
    if stated.iter().zip(&REC_709).all(near) {
        return Some(None);
    }
    let (from, ours) = (to_xyz(stated)?, to_xyz(REC_709)?);
    let cones = |white: [f64; 2]| CONES * white_xyz(white);
    let change = CONES.inverse() * DMat3::from_diagonal(cones(REC_709[3]) / cones(stated[3])) * CONES;
    let matrix = ours.inverse() * change * from;
    matrix.is_finite().then_some(Some(matrix))
}

/// The texel in our space; without what is negative only because Rec. 709 does not hold the colour. One that is not finite stays.
pub fn within(matrix: DMat3, texel: [f32; 3]) -> [f32; 3] {
    if !texel.iter().all(|c| c.is_finite()) {
        return texel;
    }
    let ours = (matrix * DVec3::from(texel.map(f64::from))).to_array().map(|c| c as f32);
    if texel.iter().all(|c| *c >= 0.0) { ours.map(|c| c.max(0.0)) } else { ours }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stated(numbers: [[f32; 2]; 4]) -> Chromaticities {
        let [red, green, blue, white] = numbers.map(|[x, y]| Vec2(x, y));
        Chromaticities { red, green, blue, white }
    }

    const REC_2020: [[f32; 2]; 4] = [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], [0.3127, 0.3290]];
    const ACES: [[f32; 2]; 4] = [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]];

    /// ITU-R BT.2087-0 gives the matrix from Rec. 709 to Rec. 2020.
    #[test]
    fn rec_2020_becomes_rec_709() {
        let matrix = to_rec709(&stated(REC_2020)).unwrap().unwrap();
        let forth = DMat3::from_cols(
            DVec3::new(0.6274, 0.0691, 0.0164),
            DVec3::new(0.3293, 0.9195, 0.0880),
            DVec3::new(0.0433, 0.0114, 0.8956),
        );
        assert!((matrix * forth).abs_diff_eq(DMat3::IDENTITY, 3e-4), "{matrix}");
    }

    #[test]
    fn white_stays_white_and_our_own_primaries_change_nothing() {
        assert_eq!(to_rec709(&rec709()), Some(None));
        for space in [REC_2020, ACES] {
            let matrix = to_rec709(&stated(space)).unwrap().unwrap();
            let white = within(matrix, [1.0; 3]);
            assert!(white.iter().all(|c| (c - 1.0).abs() < 1e-5), "{white:?}");
            let green = within(matrix, [0.0, 1.0, 0.0]);
            assert!(green[0] == 0.0 && green[1] > 0.9, "{green:?}");
        }
    }

    #[test]
    fn what_are_no_primaries_is_refused() {
        for bad in [
            [[0.3, 0.3]; 4],
            [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.9, 0.05]],
            [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.0]],
            [[f32::NAN, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]],
        ] {
            assert_eq!(to_rec709(&stated(bad)), None, "{bad:?}");
        }
    }
}
