//! Files of the shared data, read whole.

mod support;

use halflight::assets::pictures::{load_gray8, load_radiance, load_rgb8};

#[test]
fn real_pictures_load_and_the_mangled_one_is_refused() {
    let Some(shared) = support::shared("real_pictures") else { return };
    let memorial = load_radiance(&shared.join("data/brackets/memorial/memorial.hdr")).unwrap();
    assert_eq!((memorial.hdr.radiance.width(), memorial.hdr.radiance.height()), (512, 768));
    assert_eq!(memorial.replaced, Default::default());
    let error =
        load_radiance(&shared.join("data/brackets/malformed/memorial_crlf_corrupted.hdr")).unwrap_err();
    assert!(error.to_string().contains("CR LF"), "{error}");
    for (name, size) in [
        ("debevec_beach_probe_angular", (640, 640)),
        ("rooitou_park_1k", (1024, 512)),
        ("st_fagans_interior_1k", (1024, 512)),
        ("studio_small_03_1k", (1024, 512)),
        ("lebombo_1k", (1024, 512)),
        ("potsdamer_platz_1k", (1024, 512)),
    ] {
        let map = load_radiance(&shared.join(format!("data/hdr/{name}.hdr"))).unwrap();
        assert_eq!((map.hdr.radiance.width(), map.hdr.radiance.height()), size, "{name}");
        assert_eq!(map.replaced, Default::default(), "{name}");
        if name == "rooitou_park_1k" {
            let gray = |[r, g, b]: &[f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
            let largest = map.hdr.radiance.pixels().iter().map(gray).fold(0.0f32, f32::max);
            // The README's figure (luminance): 64,890.
            assert!((largest - 64_890.0).abs() < 200.0, "{largest}");
        }
    }
    // DWAB-compressed half floats; each map was scaled to an irradiance of pi on an upward surface.
    for name in ["overcast_city", "room_windows", "studio_lamps", "sun_beach"] {
        let map = load_radiance(&shared.join(format!("reference/env/{name}.exr"))).unwrap().hdr.radiance;
        assert_eq!((map.width(), map.height()), (512, 256));
        let mut irradiance = 0.0f64;
        for y in 0..128 {
            let theta = std::f64::consts::PI * (y as f64 + 0.5) / 256.0;
            let weight = theta.sin() * theta.cos() * (std::f64::consts::PI / 256.0).powi(2);
            for [r, g, b] in map.row(y) {
                irradiance += weight * (0.3 * f64::from(*r) + 0.59 * f64::from(*g) + 0.11 * f64::from(*b));
            }
        }
        // Midpoint rule against the README's statement: 0.1 %.
        assert!((irradiance / std::f64::consts::PI - 1.0).abs() < 1e-3, "{name}: {irradiance}");
    }
    let photo = load_rgb8(&shared.join("data/mirrorball/ola_raw0.jpg")).unwrap();
    assert_eq!((photo.width(), photo.height()), (1500, 1000));
    let mask = load_gray8(&shared.join("reference/f5_sun_beach/mask_mirror.png")).unwrap();
    assert!(mask.pixels().contains(&255) && mask.pixels().contains(&0));
}
