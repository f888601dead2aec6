//! Sound inputs of every format, made by rule, and what reads each.

use halflight::assets::{calibration, case, dds, gltf, obj, pictures, response, room, scene};
use halflight::config::{Settings, file, presets::FrontFile, resolve};
use halflight::daemon::{commands::Commands, settings_thread::Wishes};
use halflight::device::replay::{ReplayImu, ReplaySource};
use halflight::device::{FrameSource, ImuSource};
use halflight::lab::open_exr;
use halflight::model::{image::RadianceImage, response::Response, time::Timestamp};
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder, codecs::png::PngEncoder};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// A format: sound inputs, and what reads any bytes. Errors are what is wanted.
pub struct Format {
    pub name: &'static str,
    pub is_text: bool,
    pub sound: Vec<Vec<u8>>,
    pub read: fn(&[u8]) -> Result<(), String>,
}

/// What holds for a path that no parser may open.
fn name() -> &'static Path {
    Path::new("abused")
}

fn said<T>(result: Result<T, impl std::fmt::Display>) -> Result<(), String> {
    result.map(|_| ()).map_err(|e| e.to_string())
}

fn text(bytes: &[u8]) -> Result<&str, String> {
    std::str::from_utf8(bytes).map_err(|e| e.to_string())
}

fn binary(name: &'static str, sound: Vec<Vec<u8>>, read: fn(&[u8]) -> Result<(), String>) -> Format {
    Format { name, is_text: false, sound, read }
}

fn words(name: &'static str, sound: &[&str], read: fn(&[u8]) -> Result<(), String>) -> Format {
    Format { name, is_text: true, sound: sound.iter().map(|s| s.as_bytes().to_vec()).collect(), read }
}

fn pixels(width: usize, height: usize, channels: usize) -> Vec<u8> {
    (0..width * height * channels).map(|k| (k * 37 % 251) as u8).collect()
}

fn radiance() -> RadianceImage {
    let texels = (0..24 * 12).map(|k| std::array::from_fn(|c| (k % 17 + c) as f32 * 0.3)).collect();
    RadianceImage::from_pixels(24, 12, texels).unwrap()
}

fn pngs() -> Vec<Vec<u8>> {
    [(ExtendedColorType::Rgb8, 3), (ExtendedColorType::L16, 2), (ExtendedColorType::Rgba8, 4)]
        .map(|(color, bytes)| {
            let mut out = Vec::new();
            PngEncoder::new(&mut out).write_image(&pixels(16, 12, bytes), 16, 12, color).unwrap();
            out
        })
        .to_vec()
}

fn jpegs() -> Vec<Vec<u8>> {
    [(ExtendedColorType::Rgb8, 3), (ExtendedColorType::L8, 1)]
        .map(|(color, bytes)| {
            let mut out = Vec::new();
            JpegEncoder::new_with_quality(&mut out, 80)
                .write_image(&pixels(32, 24, bytes), 32, 24, color)
                .unwrap();
            out
        })
        .to_vec()
}

fn dds_cube() -> Vec<u8> {
    let mut bytes = Vec::from(*b"DDS ");
    // Header, then the extension: 4 x 4 texels of 32-bit RGBA floats, a cube.
    let mut header = [0u32; 31];
    header[..4].copy_from_slice(&[124, 0x1007, 4, 4]);
    header[18..21].copy_from_slice(&[32, 4, u32::from_le_bytes(*b"DX10")]);
    header[26] = 0x1000 | 8;
    header[27] = 0xfe00;
    let extension = [2u32, 3, 4, 1, 0];
    for word in header.iter().chain(&extension) {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend((0..6 * 16 * 4).flat_map(|k| (k as f32 * 0.01).to_le_bytes()));
    bytes
}

/// A triangle as GLB.
fn glb() -> Vec<u8> {
    let mut json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"translation":[0,0,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.4,0.3,1]}}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},{"bufferView":1,"componentType":5125,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":12}],"buffers":[{"byteLength":48}],
"animations":[{"name":"a","channels":[],"samplers":[]}]}"#
        .replace('\n', "");
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let mut data = Vec::new();
    for x in [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        data.extend(x.to_le_bytes());
    }
    for index in [0u32, 1, 2] {
        data.extend(index.to_le_bytes());
    }
    let mut out = Vec::from(*b"glTF");
    for word in [2, (12 + 8 + json.len() + 8 + data.len()) as u32, json.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(json.as_bytes());
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(data);
    out
}

/// Recordings without checksums, so that a damaged message reaches whoever reads it: with and without chunks.
fn recordings() -> Vec<Vec<u8>> {
    let jpeg = &jpegs()[0];
    let image = |sec: u32| {
        // foxglove.CompressedImage in protobuf: timestamp (1), data (2), format (3).
        let mut message = vec![0x0a, 2, 0x08, sec as u8, 0x12];
        let mut length = jpeg.len();
        while length >= 128 {
            message.push(length as u8 | 128);
            length >>= 7;
        }
        message.push(length as u8);
        message.extend(jpeg);
        message.extend(b"\x1a\x04jpeg");
        message
    };
    let calibration = br#"{"timestamp":{"sec":0,"nsec":0},"frame_id":"camera","width":32,"height":24,"distortion_model":"plumb_bob","D":[0,0,0,0,0],"K":[30,0,16,0,30,12,0,0,1],"R":[1,0,0,0,1,0,0,0,1],"P":[30,0,16,0,0,30,12,0,0,0,1,0]}"#;
    [true, false]
        .map(|chunks| {
            let mut out = Cursor::new(Vec::new());
            let options = mcap::WriteOptions::new()
                .compression(None)
                .use_chunks(chunks)
                .calculate_chunk_crcs(false)
                .calculate_data_section_crc(false)
                .calculate_summary_section_crc(false);
            let mut writer = options.create(&mut out).unwrap();
            let none = BTreeMap::new();
            let schema = writer.add_schema("foxglove.CompressedImage", "protobuf", b"").unwrap();
            let pictures = writer.add_channel(schema, "/camera/image", "protobuf", &none).unwrap();
            let schema = writer.add_schema("foxglove.CameraCalibration", "jsonschema", b"{}").unwrap();
            let lens = writer.add_channel(schema, "/camera/calibration", "json", &none).unwrap();
            for k in 0..4u32 {
                let time = u64::from(k + 1) * 1_000_000_000;
                let mut header = |channel_id, data: &[u8]| {
                    let header = mcap::records::MessageHeader {
                        channel_id,
                        sequence: k,
                        log_time: time,
                        publish_time: time,
                    };
                    writer.write_to_known_channel(&header, data).unwrap();
                };
                header(lens, calibration);
                header(pictures, &image(k + 1));
            }
            writer.finish().unwrap();
            drop(writer);
            out.into_inner()
        })
        .to_vec()
}

fn replay(bytes: &[u8]) -> Result<(), String> {
    let mut source = ReplaySource::new("replay:abused", Cursor::new(bytes)).map_err(|e| e.to_string())?;
    for _ in 0..50 {
        if source.next(Timestamp::NEVER).is_err() {
            break;
        }
    }
    let _ = (source.rig(), source.response());
    if let Ok(mut imu) = ReplayImu::new("replay:abused", Cursor::new(bytes)) {
        while imu.next(Timestamp::NEVER).is_ok() {}
    }
    Ok(())
}

const SCENE: &str = r#"[camera]
lens = { width = 32, height = 24, fx = 30.0, fy = 30.0, cx = 16.0, cy = 12.0 }
position = [0.0, -0.6, 0.4]
look_at = [0.0, 0.0, 0.0]
[light]
constant = [0.3, 0.3, 0.3]
[ball]
centre = [-0.2, 0.04, 0.06]
radius_m = 0.06
[[tag]]
id = 0
side_m = 0.1
position = [0.0, 0.0, 0.0]
[[surface]]
shape = "plane"
half_extent = 0.5
[[object]]
shape = "box"
size = [0.04, 0.05, 0.12]
position = [0.14, 0.06, 0.0]
material = { kind = "phong", albedo_rgb = [0.6, 0.5, 0.4], exponent = 8.0 }
"#;
const YAML: &str = "image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [600, 0, 320, 0, 600, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.2, 0.001, 0.002, 0]\n";
const CASE: &str = r#"{"id":"c","camera":{"width":64,"height":48,"fx":60,"fy":60,"cx":32,"cy":24,"position":[0,-1,1],"look_at":[0,0,0]},"images":[],"objects":[]}"#;

/// Every format that comes from outside; made once, as files lie in between.
pub fn formats() -> &'static [Format] {
    static FORMATS: OnceLock<Vec<Format>> = OnceLock::new();
    FORMATS.get_or_init(all)
}

fn all() -> Vec<Format> {
    let even = Response::srgb();
    let response_json = response::to_json(&even);
    let front = include_str!("../../src/halflightd/config/front.json");
    vec![
        binary("png", pngs(), |b| said(pictures::decode_rgb8(name(), b))),
        binary("jpeg", jpegs(), |b| said(pictures::decode_rgb8(name(), b))),
        binary("radiance", vec![radiance_file()], |b| said(pictures::decode_radiance(name(), b))),
        binary("openexr", vec![exr()], |b| said(open_exr::decode_radiance(name(), b))),
        binary("dds", vec![dds_cube()], |b| said(dds::decode_cube(name(), b))),
        binary("gltf", vec![glb()], |b| said(gltf::decode(name(), b))),
        binary("gltf room", vec![glb()], |b| said(room::decode_room(name(), b))),
        words("obj", &["v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -1 -2 -3\n"], |b| {
            said(obj::parse(name(), text(b)?))
        }),
        words("scene", &[SCENE], |b| said(scene::parse(name(), text(b)?))),
        words("settings", &["quality.spheres = 6\n[present]\nview = \"mirror\"\nhud = true\n"], |b| {
            let typed = file::parse(text(b)?)?;
            said(resolve("abused", &typed, &Settings::default()))
        }),
        words(
            "calibration",
            &[YAML, r#"{"camera_matrix":[[600,0,320],[0,600,240],[0,0,1]],"width":640,"height":480}"#],
            |b| said(calibration::parse(b, None, name())),
        ),
        words("response", &[&response_json], |b| said(response::parse(name(), text(b)?))),
        words("front", &[front], |b| said(FrontFile::parse(text(b)?))),
        words("case", &[CASE], |b| said(case::parse(name(), text(b)?))),
        words("command", &["set present.view mirror", "get quality", "status"], |b| {
            let commands = Commands::new(Arc::default(), Arc::new(Wishes::new(&Settings::default())));
            let answer = commands.answer(text(b)?);
            if answer.contains('\n') { Err("an answer of two lines".into()) } else { Ok(()) }
        }),
        binary("recording", recordings(), replay),
    ]
}

fn exr() -> Vec<u8> {
    open_exr::encode(name(), &radiance(), open_exr::ExrNote::default()).unwrap()
}

fn radiance_file() -> Vec<u8> {
    let file = std::env::temp_dir().join(format!("halflight-abuse-{}.hdr", std::process::id()));
    pictures::save_hdr(&file, &radiance()).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    std::fs::remove_file(file).unwrap();
    bytes
}
