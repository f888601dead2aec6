use super::*;
use crate::model::image::Image;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, Layers, WritableImage,
};
use proptest::prelude::*;

fn name() -> &'static Path {
    Path::new("picture.exr")
}

fn gradient(width: usize, height: usize) -> RadianceImage {
    let texel = |i: usize| [(i % width) as f32 * 0.37, (i / width) as f32, 1e4 / (1.0 + i as f32)];
    Image::from_pixels(width, height, (0..width * height).map(texel).collect()).unwrap()
}

fn encoded(picture: &RadianceImage) -> Vec<u8> {
    encode(name(), picture, ExrNote::default()).unwrap()
}

/// A part with the named channels, each of whose pixels is its number and its place in the data window.
fn part(
    size: (usize, usize),
    at: (i32, i32),
    channels: &[&str],
    title: Option<&str>,
) -> Layer<AnyChannels<FlatSamples>> {
    let list = channels.iter().enumerate().map(|(c, channel)| {
        let samples = (0..size.0 * size.1).map(|i| (1000 * (c + 1) + i) as f32).collect();
        AnyChannel::new(*channel, FlatSamples::F32(samples))
    });
    let mut attributes = LayerAttributes::default();
    attributes.layer_position = Vec2(at.0, at.1);
    attributes.layer_name = title.map(Into::into);
    let list = AnyChannels::sort(list.collect());
    Layer::new(Vec2(size.0, size.1), attributes, Encoding::SMALL_LOSSLESS, list)
}

fn file_of(display: IntegerBounds, parts: Vec<Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let layers: Layers<AnyChannels<FlatSamples>> = parts.into_iter().collect();
    let image = ExrImage { attributes: ImageAttributes::new(display), layer_data: layers };
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn radiance(bytes: &[u8]) -> Result<RadianceImage, String> {
    decode_radiance(name(), bytes).map(|loaded| loaded.hdr.radiance).map_err(|e| e.to_string())
}

#[test]
fn a_picture_comes_back_bit_for_bit() {
    let picture = gradient(37, 19);
    let file = std::env::temp_dir().join(format!("halflight-exr-{}.exr", std::process::id()));
    save_exr_f32(&file, &picture).unwrap();
    assert_eq!(load_radiance(&file).unwrap().hdr.radiance, picture);
    assert_eq!(load_raw(&file).unwrap(), picture);
    assert_eq!(stated_axes(&file).unwrap(), None);
    // What the product reads alone is refused with the reason.
    let error = pictures::load_radiance(&file).unwrap_err().to_string();
    assert!(error.contains("OpenEXR"), "{error}");
    std::fs::remove_file(&file).unwrap();
}

#[test]
fn a_file_says_what_its_numbers_are() {
    let meta = MetaData::read_from_buffered(Cursor::new(encoded(&gradient(5, 4))), false).unwrap();
    let header = &meta.headers[0];
    assert_eq!(header.shared_attributes.chromaticities, Some(colors::rec709()));
    let own = &header.own_attributes;
    assert!(own.software_name.as_ref().is_some_and(|s| s.to_string().starts_with("half-light ")));
    assert!(own.comments.as_ref().is_some_and(|s| s.to_string().contains("Linear radiance")));
    assert_eq!(own.exposure, Some(1.0));
}

/// The display window is the picture, wherever the data window lies.
#[test]
fn the_display_window_is_the_picture() {
    let display = IntegerBounds::new((-3, 2), (12usize, 8usize));
    for (at, size) in
        [((-3, 2), (12, 8)), ((0, 4), (5, 3)), ((-9, -4), (30, 20)), ((7, 8), (9, 9)), ((40, 40), (2, 2))]
    {
        let picture = radiance(&file_of(display, vec![part(size, at, &["R", "G", "B"], None)])).unwrap();
        assert_eq!((picture.width(), picture.height()), (12, 8));
        for y in 0..8 {
            for x in 0..12 {
                let (u, v) = (x as i32 - 3 - at.0, y as i32 + 2 - at.1);
                let is_there = (0..size.0 as i32).contains(&u) && (0..size.1 as i32).contains(&v);
                let i = v * size.0 as i32 + u;
                let want = [1000, 2000, 3000].map(|c| if is_there { (c + i) as f32 } else { 0.0 });
                assert_eq!(*picture.at(x, y), want, "{at:?} {size:?}: {x} {y}");
            }
        }
    }
}

#[test]
fn the_first_part_with_red_green_and_blue_is_read_and_others_are_named() {
    let display = IntegerBounds::new((0, 0), (4usize, 3usize));
    let depth = || part((4, 3), (0, 0), &["Z"], Some("depth"));
    let passes = || part((4, 3), (0, 0), &["diffuse.R", "diffuse.G", "diffuse.B"], Some("passes"));
    let beauty = part((4, 3), (0, 0), &["A", "R", "G", "B"], Some("beauty"));
    let picture = radiance(&file_of(display, vec![depth(), passes(), beauty])).unwrap();
    assert_eq!(*picture.at(1, 0), [2001.0, 3001.0, 4001.0]);
    let error = radiance(&file_of(display, vec![depth(), passes()])).unwrap_err();
    assert!(error.contains("depth: Z") && error.contains("passes: diffuse.R"), "{error}");
    // Luminance alone is gray; with chroma it is another colour model.
    let gray = radiance(&file_of(display, vec![part((4, 3), (0, 0), &["Y"], None)])).unwrap();
    assert_eq!(*gray.at(2, 1), [1006.0; 3]);
    let error =
        radiance(&file_of(display, vec![part((4, 3), (0, 0), &["Y", "RY", "BY"], None)])).unwrap_err();
    assert!(error.contains("RY") && error.contains("without RY and BY"), "{error}");
}

#[test]
fn stated_primaries_are_brought_into_ours() {
    let display = IntegerBounds::new((0, 0), (2usize, 1usize));
    let mut attributes = ImageAttributes::new(display);
    let mut primaries = colors::rec709();
    (primaries.red, primaries.green, primaries.blue) =
        (Vec2(0.708, 0.292), Vec2(0.170, 0.797), Vec2(0.131, 0.046));
    attributes.chromaticities = Some(primaries);
    // White, and Rec. 709's red in Rec. 2020 (ITU-R BT.2087-0).
    let channel = |name: &str, values: [f32; 2]| AnyChannel::new(name, FlatSamples::F32(values.to_vec()));
    let list = AnyChannels::sort(
        [channel("R", [1.0, 0.6274]), channel("G", [1.0, 0.0691]), channel("B", [1.0, 0.0164])]
            .into_iter()
            .collect(),
    );
    let layer = Layer::new(Vec2(2, 1), LayerAttributes::default(), Encoding::UNCOMPRESSED, list);
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::new(attributes, layer).write().to_buffered(&mut bytes).unwrap();
    let picture = radiance(bytes.get_ref()).unwrap();
    let close = |got: [f32; 3], want: [f32; 3]| (0..3).all(|c| (got[c] - want[c]).abs() < 5e-4);
    assert!(close(*picture.at(0, 0), [1.0; 3]), "{:?}", picture.at(0, 0));
    assert!(close(*picture.at(1, 0), [1.0, 0.0, 0.0]), "{:?}", picture.at(1, 0));
}

/// Each texel of a cube in OpenEXR's own layout (ImfEnvmap) is where our chart, with the stated axes, has it.
#[test]
fn a_cube_of_openexr_is_where_its_layout_says() {
    const SIDE: usize = 4;
    // ImfEnvmap's direction of a face's place: right-handed, y up; u to the right, v down.
    let own = |face: usize, u: f64, v: f64| match face {
        0 => [1.0, -v, u],
        1 => [-1.0, -v, -u],
        2 => [u, 1.0, -v],
        3 => [u, -1.0, v],
        4 => [-u, -v, 1.0],
        _ => [u, -v, -1.0],
    };
    let place = |k: usize| (2 * k + 1) as f64 / SIDE as f64 - 1.0;
    // World: x, -z, y. Stored shifted so that no number is negative.
    let texel = |i: usize| {
        let (row, column) = (i / SIDE, i % SIDE);
        let [x, y, z] = own(row / SIDE, place(column), place(row % SIDE));
        [x, -z, y].map(|c| (c + 2.0) as f32)
    };
    let all: Vec<[f32; 3]> = (0..6 * SIDE * SIDE).map(texel).collect();
    let channels = ["R", "G", "B"]
        .iter()
        .enumerate()
        .map(|(c, name)| AnyChannel::new(*name, FlatSamples::F32(all.iter().map(|t| t[c]).collect())));
    let mut attributes = LayerAttributes::default();
    attributes.environment_map = Some(EnvironmentMap::Cube);
    let list = AnyChannels::sort(channels.collect());
    let layer = Layer::new(Vec2(SIDE, 6 * SIDE), attributes, Encoding::SMALL_LOSSLESS, list);
    let file = std::env::temp_dir().join(format!("halflight-cube-{}.exr", std::process::id()));
    ExrImage::from_layer(layer).write().to_file(&file).unwrap();
    let picture = load_radiance(&file).unwrap().hdr.radiance;
    let world_from_map = stated_axes(&file).unwrap().unwrap().world_from_map(0.0);
    for row in 0..6 * SIDE {
        for column in 0..SIDE {
            let direction = crate::math::sphere::cube_direction(row / SIDE, place(column), place(row % SIDE));
            let world = world_from_map * direction;
            let stored = glam::DVec3::from(picture.at(column, row).map(|c| f64::from(c) - 2.0)).normalize();
            assert!(world.distance(stored) < 1e-5, "{row} {column}: {world} {stored}");
        }
    }
    assert_eq!(load_raw(&file).unwrap(), picture);
    std::fs::remove_file(&file).unwrap();
}

#[test]
fn a_cut_file_is_refused_or_has_lost_nothing() {
    let picture = gradient(24, 40);
    let bytes = encoded(&picture);
    let mut refused = 0;
    for length in 0..bytes.len() {
        match radiance(&bytes[..length]) {
            Ok(loaded) => assert_eq!(loaded, picture, "{length} of {}", bytes.len()),
            Err(_) => refused += 1,
        }
    }
    assert_eq!(refused, bytes.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever happens to the bytes: an error or a picture that is finite and not negative, and no panic.
    #[test]
    fn damaged_files_give_an_error_or_a_sound_picture(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        cut in any::<prop::sample::Index>(),
        cuts in any::<bool>(),
    ) {
        let mut bytes = encoded(&gradient(24, 9));
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if cuts {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(loaded) = decode_radiance(name(), &bytes) {
            let sound = |c: &f32| c.is_finite() && *c >= 0.0;
            prop_assert!(loaded.hdr.radiance.pixels().iter().flatten().all(sound));
        }
    }
}
