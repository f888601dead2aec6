use super::*;

const OPENCV: &str = "%YAML:1.0
---
image_width: 640
image_height: 480
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
";
const STEREO: &str = "%YAML:1.0
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 534., 0., 335., 0., 534., 240., 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 544., 0., 334., 0., 544., 242., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ -0.1, 0.2, 0., 0. ]
";
const ROS: &str = "image_width: 752
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [400.5, 0, 370.25, 0, 401, 240, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients:
  rows: 1
  cols: 4
  data: [-0.01, 0.02, -0.003, 0.0004]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
";
const LISTS: &str = "a:
  file: one.png
  K: [336.7, 0.0, 333.3, 0.0, 336.0, 212.7, 0.0, 0.0, 1.0]
  height: 480
  width: 640
b:
  K: [[329.8, 0.0, 528.0], [0.0, 332.9, 396.0], [0.0, 0.0, 1.0]]
";

fn read(text: &str, name: Option<&str>) -> Result<Lens, String> {
    parse(text.as_bytes(), name, Path::new("cam.yml")).map_err(|e| e.to_string())
}

#[test]
fn half_a_pixel_is_added_to_the_principal_point() {
    let k = [-0.26, -0.038, 0.0017, -0.00028, 0.23, 0.0, 0.0, 0.0];
    let want = Lens {
        distortion: Distortion::RadialTangential(k),
        ..Lens::pinhole(640, 480, 535.0, 536.0, 342.5, 235.5)
    };
    assert_eq!(read(OPENCV, None), Ok(want));
}

#[test]
fn several_cameras_go_by_name() {
    let first = Lens::pinhole(0, 0, 534.0, 534.0, 335.5, 240.5);
    assert_eq!(read(STEREO, None), Ok(first));
    assert_eq!(read(STEREO, Some("M1")), Ok(first));
    let second = read(STEREO, Some("M2")).unwrap();
    assert_eq!((second.fx, second.cx), (544.0, 334.5));
    let k = [-0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(second.distortion, Distortion::RadialTangential(k));
    let error = read(STEREO, Some("M3")).unwrap_err();
    assert_eq!(error, "cam.yml: camera = M3: must be one of the file's: M1, M2");
    assert_eq!(read(LISTS, None).unwrap().cx, 333.8);
    assert_eq!(read(LISTS, Some("b")), Ok(Lens::pinhole(0, 0, 329.8, 332.9, 528.5, 396.5)));
}

#[test]
fn ros_camera_info_with_a_fisheye() {
    let want = Lens {
        distortion: Distortion::Equidistant([-0.01, 0.02, -0.003, 0.0004]),
        ..Lens::pinhole(752, 480, 400.5, 401.0, 370.75, 240.5)
    };
    assert_eq!(read(ROS, None), Ok(want));
    let rational = ROS
        .replace("equidistant", "rational_polynomial")
        .replace("cols: 4", "cols: 8")
        .replace("0.0004]", "0.0004, 1, 2, 3, 4]");
    let k = [-0.01, 0.02, -0.003, 0.0004, 1.0, 2.0, 3.0, 4.0];
    assert_eq!(read(&rational, None).unwrap().distortion, Distortion::RadialTangential(k));
}

#[test]
fn mistakes_are_named() {
    for (from, to, want) in [
        ("5.35e+02", "-3", "cam.yml: camera_matrix[0][0] (fx) = -3: must be 0.001 to 1000000 pixels"),
        ("5.35e+02", "x", "cam.yml: camera_matrix.data[0] = x: must be a finite number"),
        ("5.35e+02", ".inf", "cam.yml: camera_matrix.data[0] = .inf: must be a finite number"),
        ("5.35e+02, 0.,", "5.35e+02, 7,", "cam.yml: camera_matrix[0][1] (skew) = 7: must be 0"),
        ("1. ]", "1., 1. ]", "10 numbers: must be rows x cols = 3 x 3 of them"),
        ("2.3e-01 ]", "2.3e-01, 4 ]", "6 numbers: must be rows x cols = 5 x 1 of them"),
        ("image_width: 640", "image_width: 0", "image_width = 0: must be a whole number of pixels"),
        ("image_width: 640", "n: 3", "image_width, image_height = only one of them: must be both"),
        ("camera_matrix:", "matrix:", "camera matrix = none: must be a mapping with camera_matrix"),
        ("5.35e+02, 0.,", "5.35e+02, &b 0.,", "YAML, line 9 = an anchor or alias: must be written out"),
        // The list goes on in lines that are indented for one bracket: the library finds that first.
        ("[ 5.35", "[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[ 5.35", "YAML"),
        (
            "image_width: 640",
            "image_width: [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[640]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]",
            "nesting: must be at most 32 levels deep",
        ),
        (
            "---",
            "- - - - - - - - - - - - - - - - - - - - - - - - - - - - - - - - - - -",
            "nesting: must be at most 32",
        ),
        ("data: [", "data: {", "YAML"),
    ] {
        assert!(OPENCV.contains(from), "{from}");
        let error = read(&OPENCV.replacen(from, to, 1), None).unwrap_err();
        assert!(error.contains(want), "{to}: {error}");
    }
    let model = ROS.replace("equidistant", "fov");
    let error = read(&model, None).unwrap_err();
    assert_eq!(
        error,
        "cam.yml: distortion_model = fov: must be plumb_bob, rational_polynomial or equidistant"
    );
    assert!(parse(&[0xff, 0xfe], None, Path::new("x")).unwrap_err().to_string().contains("UTF-8"));
    assert!(parse(&vec![b' '; MAX_BYTES + 1], None, Path::new("x")).is_err());
    let missing = load(Path::new("/nowhere/cam.yml#M1")).unwrap_err().to_string();
    assert!(missing.starts_with("/nowhere/cam.yml: cannot be opened"), "{missing}");
}

#[test]
fn the_picture_gives_or_must_agree_with_the_size() {
    let unknown = Lens::pinhole(0, 0, 1.0, 1.0, 0.5, 0.5);
    let sized = for_picture(unknown, 640, 480, Path::new("a")).unwrap();
    assert_eq!((sized.width, sized.height), (640, 480));
    assert!(for_picture(sized, 640, 480, Path::new("a")).is_ok());
    let error = for_picture(sized, 320, 240, Path::new("a")).unwrap_err().to_string();
    assert!(error.contains("640 x 480: must be the picture's own size, 320 x 240"), "{error}");
}
