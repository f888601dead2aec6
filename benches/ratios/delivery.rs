//! Frames a second by how a frame is timed and handed out, with a camera that moves.

use super::frame::{Frame, scene};
use glam::DVec3;
use halflight::{
    engine::{
        Engine, Timings,
        gpu::{Backend, GpuEngine},
    },
    math::pose::Pose,
    model::picture::Picture,
};
use std::time::Instant;

const FRAMES: usize = 30;
/// Frames before the clock starts: kernels are compiled in the first.
const WARM: usize = 3;

/// How a frame is timed and handed out.
struct Way {
    name: &'static str,
    timings: Timings,
    linear: bool,
}

const WAYS: [Way; 3] = [
    Way { name: "fenced, linear radiance read back", timings: Timings::Fenced, linear: true },
    Way { name: "stamps, linear radiance read back", timings: Timings::Stamps, linear: true },
    Way { name: "stamps, display alone", timings: Timings::Stamps, linear: false },
];

fn frames_a_second(frame: &Frame, engine: &mut GpuEngine, way: &Way) -> f64 {
    engine.ask_for_linear(way.linear);
    engine.load_scene(&frame.scene).expect("a sound scene");
    let mut out = Picture::default();
    let mut start = Instant::now();
    for k in 0..WARM + FRAMES {
        if k == WARM {
            start = Instant::now();
        }
        let eye = DVec3::new(0.1 + 0.005 * k as f64, -0.5, 0.4);
        let pose = Pose::look_at(eye, DVec3::new(0.0, 0.0, 0.05), DVec3::Z);
        let input = frame.input(&pose);
        engine.relight(&frame.plan, &input, &mut out).expect("a sound frame");
    }
    FRAMES as f64 / start.elapsed().as_secs_f64()
}

/// Prints the figures.
pub fn run() {
    let frame = Frame::new(scene(48));
    println!("{FRAMES} frames of 640 x 480 drawn on a device, frames a second");
    for backend in Backend::ALL {
        let mut engine = match GpuEngine::new(Some(backend)) {
            Ok(engine) => engine,
            Err(error) => {
                println!("  {error}");
                continue;
            }
        };
        println!("  {}", engine.description());
        for way in &WAYS {
            engine = engine.with_timings(way.timings);
            println!("    {:<42}{:6.2}", way.name, frames_a_second(&frame, &mut engine, way));
        }
    }
}
