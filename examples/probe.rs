use halflight::device::{FrameSource, synthetic};
use halflight::model::time::Timestamp;
fn main() {
    let arg = std::env::args().nth(1).unwrap_or_default();
    let n: usize = std::env::args().nth(2).map_or(3, |s| s.parse().unwrap());
    let t0 = std::time::Instant::now();
    let (mut s, _imu) = synthetic::open(&synthetic::Options::parse(&arg).unwrap());
    eprintln!("open {:?}", t0.elapsed());
    for i in 0..n {
        let t0 = std::time::Instant::now();
        let f = s.next_frame(Timestamp(0)).unwrap();
        eprintln!("frame {:?}", t0.elapsed());
        let px: Vec<u8> = f.pixels.pixels().iter().flatten().copied().collect();
        let mut sorted = px.clone();
        sorted.sort();
        eprintln!(
            "  p5 {} median {} p95 {} sat {}",
            sorted[px.len() / 20],
            sorted[px.len() / 2],
            sorted[px.len() * 19 / 20],
            px.iter().filter(|v| **v == 255).count()
        );
        image::save_buffer(
            format!("/tmp/hl_synth_{i}.png"),
            &px,
            f.pixels.width() as u32,
            f.pixels.height() as u32,
            image::ColorType::Rgb8,
        )
        .unwrap();
    }
    let t = s.truth().unwrap();
    eprintln!("to_light {:?} elev {}", t.to_light_world, t.to_light_world[2].asin().to_degrees());
    for k in 0..4 {
        eprintln!("{k} {:?}", t.light.rgb[k]);
    }
}
