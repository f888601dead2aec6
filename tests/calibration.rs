//! Calibration files: those of the shared data, and hostile ones.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]
#![allow(clippy::excessive_precision, reason = "numbers as they stand in the files")]

mod support;

use halflight::assets::calibration::{load, parse};
use halflight::math::lens::{Distortion, Lens};
use proptest::prelude::*;
use std::path::Path;

#[test]
fn the_chessboard_calibrations_load() {
    let Some(shared) = support::shared("the_chessboard_calibrations_load") else { return };
    let folder = shared.join("data/calib/opencv_chess");
    let left = load(&folder.join("left_intrinsics.yml")).unwrap();
    assert_eq!((left.width, left.height), (640, 480));
    // The file's own digits, and half a pixel.
    assert_eq!((left.fx, left.fy), (5.3591573396163199e+02, 5.3591573396163199e+02));
    assert_eq!((left.cx, left.cy), (3.4228315473308373e+02 + 0.5, 2.3557082909788173e+02 + 0.5));
    let Distortion::RadialTangential(k) = left.distortion else { panic!("{:?}", left.distortion) };
    assert_eq!(k[0], -2.6637260909660682e-01);
    assert_eq!(k[4], 2.3839153080878486e-01);
    assert_eq!(k[5..], [0.0; 3]);

    let stereo = folder.join("intrinsics.yml");
    let first = load(&stereo).unwrap();
    assert_eq!(first, load(Path::new(&format!("{}#M1", stereo.display()))).unwrap());
    let second = load(Path::new(&format!("{}#M2", stereo.display()))).unwrap();
    assert_eq!((first.cx, second.cx), (3.3568643204394891e+02 + 0.5, 3.3455744527912015e+02 + 0.5));
    assert_eq!((second.width, second.height), (0, 0));

    let info = shared.join("data/apriltag/duckie/test_info.yaml");
    let rotation = load(Path::new(&format!("{}#rotation_test", info.display()))).unwrap();
    assert_eq!(rotation, Lens::pinhole(1056, 792, 329.8729619143081, 332.94611303946357, 528.5, 396.5));
}

const FILES: [&str; 3] = [
    "%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.35e+02, 0., 3.42e+02, 0., 5.36e+02, 2.35e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6e-01, -3.8e-02, 1.7e-03, -2.8e-04, 2.3e-01 ]
",
    "image_width: 752
image_height: 480
camera_matrix:
  rows: 3
  cols: 3
  data: [400.5, 0, 370.25, 0, 401, 240, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients: {rows: 1, cols: 4, data: [-0.01, 0.02, -0.003, 0.0004]}
",
    "a:\n  K: [336.7, 0.0, 333.3, 0.0, 336.0, 212.7, 0.0, 0.0, 1.0]\n  height: 480\n  width: 640\n",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..Default::default() })]

    #[test]
    fn bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = parse(&bytes, None, Path::new("x"));
    }

    #[test]
    fn yaml_like_text_never_panics(text in "[-a-zA-Z0-9:\\[\\]{}.,!&*#%|>'\" \n\t?]{0,200}") {
        let _ = parse(text.as_bytes(), None, Path::new("x"));
    }

    #[test]
    fn mutated_files_never_panic(
        which in 0..3_usize, at in prop::collection::vec((0..700_usize, any::<u8>(), 0..3_u8), 1..6),
    ) {
        let mut bytes = FILES[which].as_bytes().to_vec();
        for (place, byte, kind) in at {
            let place = place % bytes.len();
            match kind {
                0 => bytes[place] = byte,
                1 => bytes.insert(place, byte & 0x7f),
                _ => bytes.truncate(place.max(1)),
            }
        }
        if let Ok(lens) = parse(&bytes, None, Path::new("x")) {
            prop_assert!(lens.fx > 0.0 && lens.fy > 0.0 && lens.cx.is_finite() && lens.cy.is_finite());
        }
    }
}
