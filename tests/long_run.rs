//! Weeks of running: nothing grows. Twenty thousand small frames go through the loop and the whole pipeline (tracking, merging,
//! light that is not found, text), of two exposures; not through a device's thread. One test alone, for the bytes are those of
//! the whole program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/bytes/sys.rs"]
mod sys;

use halflight::device::{
    DeviceError, ErrorKind, FrameSource, ImuSource, clock::ManualClock, clock::MonotonicClock,
};
use halflight::engine::cpu::CpuEngine;
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::{
    frame::{Exposure, RawFrame},
    image::{Image, Rgb8Image},
    imu::ImuSample,
    quality::Quality,
    response::Response,
    rig::{Rig, TagPlacement},
    scene::Scene,
    time::Timestamp,
};
use halflight::pipeline::{
    Options, Pipeline, PipelineError,
    inbox::Inbox,
    lockstep::Lockstep,
    turns::{FinishedFrame, FrameSink, run},
};
use std::sync::Arc;

const SIZE: [usize; 2] = [64, 48];
const WARM_UP: u64 = 2_000;
const FRAMES: u64 = 20_000;
const PERIOD_NS: i64 = 33_333_333;

/// The same two pictures over and over.
struct TwoPictures {
    pictures: [Arc<Rgb8Image>; 2],
    given: u64,
}

impl FrameSource for TwoPictures {
    fn next(&mut self, _deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        if self.given == FRAMES {
            return Err(DeviceError::new("test", "go on", ErrorKind::Ended));
        }
        let which = (self.given % 2) as usize;
        self.given += 1;
        Ok(RawFrame {
            sequence: self.given,
            t_mid: Timestamp(self.given as i64 * PERIOD_NS),
            exposure: Exposure { time_s: [0.002, 0.008][which], gain: 1.0 },
            pixels: Arc::clone(&self.pictures[which]),
            sensor: None,
            row_time_s: 0.0,
            response: None,
        })
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        Ok(exposures.to_vec())
    }

    fn rig(&self) -> Option<Rig> {
        None
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
}

/// Seven samples a frame.
struct Still {
    given: i64,
}

impl ImuSource for Still {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let t = Timestamp((self.given + 1) * PERIOD_NS / 7);
        if t > deadline {
            return Err(DeviceError::again());
        }
        self.given += 1;
        Ok(ImuSample { t, gyro_rad_s: [0.01, 0.0, -0.02], accel_m_s2: [0.0, -9.81, 0.0] })
    }
}

/// Looks at the memory.
#[derive(Default)]
struct Memory {
    frames: u64,
    passes: u64,
    live: [isize; 2],
    resident_kib: [Option<u64>; 2],
}

impl FrameSink for Memory {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        self.frames += 1;
        self.passes += finished.passes.len() as u64;
        let slot = match self.frames {
            WARM_UP => 0,
            FRAMES => 1,
            _ => return Ok(true),
        };
        self.resident_kib[slot] = resident_kib();
        self.live[slot] = sys::live_bytes();
        Ok(true)
    }
}

/// `None` where there is no such thing.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_ascii_whitespace().nth(1)?.parse().ok()
}

/// Stripes, so that the detector has edges to look at.
fn picture(bright: u8) -> Arc<Rgb8Image> {
    let mut picture = Image::filled(SIZE[0], SIZE[1], [20; 3]);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            if (x / 8 + y / 8) % 2 == 0 {
                *picture.at_mut(x, y) = [bright, bright / 2, bright / 3];
            }
        }
    }
    Arc::new(picture)
}

#[test]
fn twenty_thousand_frames_hold_the_memory_still() {
    let tags = vec![TagPlacement { id: 0, side_m: 0.1, world_from_tag: Pose::IDENTITY }];
    let rig =
        Rig { lens: Lens::pinhole(SIZE[0] as u32, SIZE[1] as u32, 60.0, 60.0, 32.0, 24.0), tags, ball: None };
    let options = Options {
        exposures_in_cycle: 2,
        hud: true,
        quality: Quality { brackets: 2, ..Quality::default() },
        ..Options::default()
    };
    let engine = Box::new(CpuEngine::new(Some(1)).unwrap());
    let watch = Box::new(MonotonicClock::default());
    let mut pipeline =
        Pipeline::new(engine, watch, rig, Response::srgb(), Scene::default(), options).unwrap();
    let frames = Box::new(TwoPictures { pictures: [picture(90), picture(240)], given: 0 });
    let inbox = Arc::<Inbox>::default();
    let imu = Box::new(Still { given: 0 });
    let mut events = Lockstep::new(Arc::clone(&inbox), frames, Some(imu), ManualClock::default());
    let mut memory = Memory::default();
    let counts = run(&mut events, &mut pipeline, &mut memory, 0).unwrap();
    assert_eq!((counts.frames, memory.frames), (FRAMES, FRAMES));
    assert!(memory.passes >= FRAMES, "passes are handed out: {}", memory.passes);
    let [before, after] = memory.live;
    println!("live bytes {before}, then {after}; resident {:?} KiB", memory.resident_kib);
    // Nothing of ours is held back. The detector's own library allocates outside of this count: the resident memory has it.
    assert!((after - before).abs() <= 4096, "{before} bytes, then {after}");
    if let [Some(before), Some(after)] = memory.resident_kib {
        // 18,000 frames that each leave 32 bytes would be 560 KiB.
        assert!(after <= before + 512, "{before} KiB, then {after}");
    }
}
