use super::control::id;
use super::node::{
    BehindNode, ControlFacts, ControlKind, ControlNode, Filled, FrameRates, Granted, NodeFacts, Offer, Ready,
    VideoNode,
};
use super::*;
use crate::ErrorKind;
use crate::bracketed::ExposureControl;
use crate::clock::ManualClock;
use crate::developed::CaptureSource;
use crate::model::{frame::Exposure, time::Timestamp};
use proptest::prelude::*;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::Mutex;
use std::time::Duration;

/// What the simulated kernel does next.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// A frame with this number; bytes used, and whether it is called damaged.
    Frame(u32, usize, bool),
    Nothing,
    Gone,
}

#[derive(Default)]
struct Kernel {
    script: VecDeque<Step>,
    queued: VecDeque<usize>,
    controls: BTreeMap<u32, (ControlFacts, i32)>,
    is_running: bool,
    /// Buffers that were handed over twice.
    mistakes: usize,
    sensor: Option<FakeNode>,
}

#[derive(Clone)]
struct FakeNode(Arc<Mutex<Kernel>>);

const BYTES: usize = 320 * 240 * 2;

impl FakeNode {
    fn new(script: impl IntoIterator<Item = Step>) -> Self {
        let kernel = Kernel { script: script.into_iter().collect(), ..Kernel::default() };
        let node = Self(Arc::new(Mutex::new(kernel)));
        node.add(id::AUTO_EXPOSURE, ControlKind::Menu, [0, 3, 1], 3);
        node.add(id::EXPOSURE, ControlKind::Number, [1, 5000, 1], 157);
        node.add(id::GAIN, ControlKind::Number, [0, 255, 1], 16);
        node.add(id::AUTO_WHITE_BALANCE, ControlKind::Switch, [0, 1, 1], 1);
        node.add(id::SHARPNESS, ControlKind::Number, [0, 6, 1], 3);
        node
    }

    fn add(&self, id: u32, kind: ControlKind, [least, most, step]: [i32; 3], default: i32) {
        let facts =
            ControlFacts { id, name: format!("{id:x}"), kind, least, most, step, default, can_be_set: true };
        self.0.lock().unwrap().controls.insert(id, (facts, default));
    }

    fn value(&self, id: u32) -> i32 {
        self.0.lock().unwrap().controls[&id].1
    }
}

impl VideoNode for FakeNode {
    type Memory = Vec<u8>;

    fn facts(&self) -> io::Result<NodeFacts> {
        Ok(NodeFacts { card: "Fake".into(), captures: true, ..NodeFacts::default() })
    }

    fn offers(&self) -> io::Result<Vec<Offer>> {
        let mut rates = FrameRates::default();
        rates.add(30.0);
        Ok(vec![Offer { fourcc: *b"YUYV", width: 320, height: 240, rates }])
    }

    fn set_format(&mut self, fourcc: [u8; 4], width: u32, height: u32) -> io::Result<Granted> {
        Ok(Granted { fourcc, width, height, planes: 1, ..Granted::default() })
    }

    fn set_rate(&mut self, frames_per_s: f64) -> io::Result<f64> {
        Ok(frames_per_s)
    }

    fn buffers(&mut self, count: u32) -> io::Result<Vec<Vec<u8>>> {
        Ok((0..count).map(|_| vec![128; BYTES]).collect())
    }

    fn queue(&mut self, index: usize) -> io::Result<()> {
        let mut kernel = self.0.lock().unwrap();
        if kernel.queued.contains(&index) {
            kernel.mistakes += 1;
        }
        kernel.queued.push_back(index);
        Ok(())
    }

    fn dequeue(&mut self) -> io::Result<Option<Filled>> {
        let mut kernel = self.0.lock().unwrap();
        let Some(&Step::Frame(sequence, used, has_error)) = kernel.script.front() else { return Ok(None) };
        let Some(index) = kernel.queued.pop_front() else { return Ok(None) };
        kernel.script.pop_front();
        Ok(Some(Filled { index, used, sequence, has_error, ..Filled::default() }))
    }

    fn start(&mut self) -> io::Result<()> {
        self.0.lock().unwrap().is_running = true;
        Ok(())
    }

    fn stop(&mut self) -> io::Result<()> {
        self.0.lock().unwrap().is_running = false;
        Ok(())
    }

    fn wait(&mut self, _longest: Duration) -> io::Result<Ready> {
        let mut kernel = self.0.lock().unwrap();
        match kernel.script.front() {
            Some(Step::Frame(..)) => Ok(Ready::Filled),
            Some(Step::Gone) => Ok(Ready::Gone),
            Some(Step::Nothing) => {
                kernel.script.pop_front();
                Ok(Ready::Nothing)
            }
            None => Ok(Ready::Nothing),
        }
    }

    fn sensor(&self) -> Option<BehindNode> {
        let sensor = self.0.lock().unwrap().sensor.clone()?;
        Some(BehindNode { name: "fake sensor".into(), size: [640, 480], controls: Box::new(sensor) })
    }
}

impl ControlNode for FakeNode {
    fn control_facts(&self, id: u32) -> Option<ControlFacts> {
        self.0.lock().unwrap().controls.get(&id).map(|(facts, _)| facts.clone())
    }

    fn control(&self, id: u32) -> io::Result<i32> {
        let kernel = self.0.lock().unwrap();
        kernel.controls.get(&id).map(|(_, held)| *held).ok_or_else(|| io::Error::from_raw_os_error(22))
    }

    fn wide_control(&self, id: u32) -> io::Result<i64> {
        self.control(id).map(i64::from)
    }

    /// As UVC's driver: clamps, and refuses an exposure while the camera chooses it.
    fn set_control(&self, id: u32, value: i32) -> io::Result<i32> {
        let mut kernel = self.0.lock().unwrap();
        if id == id::EXPOSURE && kernel.controls.get(&id::AUTO_EXPOSURE).is_some_and(|c| c.1 != 1) {
            return Err(io::Error::from_raw_os_error(13));
        }
        let Some((facts, held)) = kernel.controls.get_mut(&id) else {
            return Err(io::Error::from_raw_os_error(22));
        };
        *held = value.clamp(facts.least, facts.most);
        let taken = *held;
        // As a sensor's driver: the longest exposure is a frame less four lines.
        if id == id::BETWEEN_FRAMES
            && let Some((lines, _)) = kernel.controls.get_mut(&id::LINES)
        {
            lines.most = 480 + taken - 4;
        }
        Ok(taken)
    }
}

/// Controls of a raw sensor: lines of 10 microseconds, a gain that is a code, a pause that makes 100 frames a second.
fn raw_sensor() -> FakeNode {
    let sensor = FakeNode(Arc::default());
    sensor.add(id::LINES, ControlKind::Number, [4, 996, 1], 800);
    sensor.add(id::BETWEEN_FRAMES, ControlKind::Number, [20, 60_000, 1], 520);
    sensor.add(id::BETWEEN_LINES, ControlKind::Number, [360, 360, 1], 360);
    sensor.add(id::PIXEL_RATE, ControlKind::Number, [100_000_000, 100_000_000, 1], 100_000_000);
    sensor.add(id::ANALOGUE_GAIN, ControlKind::Number, [0, 232, 1], 0);
    sensor.set_control(id::ANALOGUE_GAIN, 128).unwrap();
    sensor
}

fn started(node: &FakeNode) -> V4l2Camera<FakeNode> {
    let wish = FormatWish { width: 320, height: 240, ..FormatWish::default() };
    V4l2Camera::start("v4l2:fake", node.clone(), &wish, Arc::new(ManualClock::default())).unwrap()
}

fn frame(sequence: u32) -> Step {
    Step::Frame(sequence, BYTES, false)
}

#[test]
fn names_say_which_camera_and_which_pictures() {
    let options = V4l2Options::parse("/dev/video2,size=1280x720,fps=60,format=MJPG").unwrap();
    assert_eq!(options.node, NodeWish::Path("/dev/video2".into()));
    let wish = FormatWish { width: 1280, height: 720, frames_per_s: 60.0, fourcc: Some(*b"MJPG") };
    assert_eq!(options.wish, wish);
    assert_eq!(V4l2Options::parse("").unwrap().node, NodeWish::Any);
    assert_eq!(V4l2Options::parse("card=C920").unwrap().node, NodeWish::Card("C920".into()));
    let refusal = |text: &str| V4l2Options::parse(text).unwrap_err().to_string();
    assert!(refusal("/dev/video0,siez=1x1").contains("did you mean \"size\"?"));
    assert!(refusal("size=640").contains("must be WIDTHxHEIGHT"));
    assert!(refusal("format=H264").contains("four letters of a format that is read"));
    assert!(refusal("fps=0").contains("1..=1000"));
    assert!(refusal("/dev/video0,card=x").contains("a path was given, too"));
}

#[test]
fn the_newest_picture_wins_and_what_is_lost_is_counted() {
    let node = FakeNode::new([frame(7), frame(8), frame(11)]);
    let mut camera = started(&node);
    let got = camera.next(Timestamp(0)).unwrap();
    assert_eq!(got.sequence, 11);
    let counts = camera.counts();
    assert_eq!((counts.gaps, counts.passed_over, counts.damaged), (2, 2, 0));
    assert_eq!(camera.next(Timestamp(0)).unwrap_err().kind, ErrorKind::Again);
}

#[test]
fn damaged_and_short_pictures_are_dropped_and_counted() {
    let node = FakeNode::new([
        Step::Frame(0, BYTES, true),
        Step::Frame(1, BYTES / 2, false),
        Step::Frame(2, 0, false),
    ]);
    let mut camera = started(&node);
    assert_eq!(camera.next(Timestamp(0)).unwrap_err().kind, ErrorKind::Again);
    assert_eq!(camera.counts().damaged, 3);
    assert_eq!(node.0.lock().unwrap().queued.len(), 4);
    node.0.lock().unwrap().script.push_back(Step::Frame(3, BYTES + 1, false));
    assert_eq!(camera.next(Timestamp(0)).unwrap_err().kind, ErrorKind::Again);
    node.0.lock().unwrap().script.push_back(frame(4));
    assert_eq!(camera.next(Timestamp(0)).unwrap().sequence, 4);
}

#[test]
fn a_camera_that_is_pulled_out_is_to_be_opened_again() {
    let node = FakeNode::new([frame(0), Step::Gone]);
    let mut camera = started(&node);
    assert!(camera.next(Timestamp(0)).is_ok());
    let error = camera.next(Timestamp(0)).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Reopen);
    assert!(error.to_string().contains("v4l2:fake"));
}

const TAKEN: [u32; 5] = [id::AUTO_EXPOSURE, id::EXPOSURE, id::GAIN, id::AUTO_WHITE_BALANCE, id::SHARPNESS];

#[test]
fn controls_are_taken_and_put_back_as_they_were() {
    let node = FakeNode::new([]);
    let before: Vec<i32> = TAKEN.map(|id| node.value(id)).to_vec();
    let mut camera = started(&node);
    let now = [id::AUTO_EXPOSURE, id::AUTO_WHITE_BALANCE, id::SHARPNESS].map(|id| node.value(id));
    assert_eq!(now, [1, 0, 0]);
    // In steps of 100 us, within the camera's limits.
    let taken = camera.write_exposure(Exposure { time_s: 0.012_34, gain: 2.0 }).unwrap();
    assert!((taken.time_s - 0.0123).abs() < 1e-12 && (taken.gain - 2.0).abs() < 1e-12);
    assert_eq!((node.value(id::EXPOSURE), node.value(id::GAIN)), (123, 32));
    let all = camera.set_exposures(&[9.0, 0.0].map(|time_s| Exposure { time_s, gain: 1.0 })).unwrap();
    assert!((all[0].time_s - 0.5).abs() < 1e-12 && (all[1].time_s - 1e-4).abs() < 1e-12);
    let is_running = || node.0.lock().unwrap().is_running;
    assert!(is_running());
    drop(camera);
    assert!(!is_running());
    let after: Vec<i32> = TAKEN.map(|id| node.value(id)).to_vec();
    assert_eq!(after, before);
}

#[test]
fn a_camera_without_exposure_control_still_runs() {
    let node = FakeNode::new([frame(0)]);
    node.0.lock().unwrap().controls.clear();
    let mut camera = started(&node);
    assert_eq!(camera.exposure_limits(), None);
    assert_eq!(camera.set_exposures(&[Exposure { time_s: 0.1, gain: 1.0 }; 3]).unwrap().len(), 1);
    assert!(camera.next(Timestamp(0)).is_ok());
}

proptest! {
    /// No buffer is ever handed over twice or lost, whatever the kernel says and however long pictures are held.
    #[test]
    fn buffers_come_back(steps in prop::collection::vec((0u32..4, any::<u32>(), 0usize..2 * BYTES, any::<bool>()), 0..60)) {
        let script = steps.iter().map(|&(kind, sequence, used, damaged)| match kind {
            0 => Step::Nothing,
            1 => Step::Frame(sequence, used, damaged),
            _ => frame(sequence),
        });
        let node = FakeNode::new(script);
        let mut camera = started(&node);
        let mut held = VecDeque::new();
        for (kind, ..) in &steps {
            match camera.next(Timestamp(0)) {
                Ok(frame) => held.push_back(frame),
                Err(error) => prop_assert_eq!(error.kind, ErrorKind::Again),
            }
            if kind % 2 == 0 || held.len() > 2 {
                held.pop_front();
            }
        }
        held.clear();
        let _ = camera.next(Timestamp(0));
        let kernel = node.0.lock().unwrap();
        prop_assert_eq!(kernel.mistakes, 0);
        prop_assert!(kernel.queued.len() >= 3);
    }
}

#[test]
fn the_sensor_behind_a_node_is_exposed_in_lines() {
    let (node, sensor) = (FakeNode(Arc::default()), raw_sensor());
    node.0.lock().unwrap().sensor = Some(sensor.clone());
    let mut camera = started(&node);
    // 30 frames a second are 3333 lines.
    assert_eq!(sensor.value(id::BETWEEN_FRAMES), 3333 - 480);
    // A gain that is a code stays at the driver's choice.
    assert_eq!(sensor.value(id::ANALOGUE_GAIN), 0);
    let limits = camera.exposure_limits().unwrap();
    assert!(
        (limits.shortest_s - 4e-5).abs() < 1e-9 && (limits.longest_s - 0.03329).abs() < 1e-9,
        "{limits:?}"
    );
    let taken = camera.write_exposure(Exposure { time_s: 0.012_345, gain: 2.0 }).unwrap();
    assert!((taken.time_s - 0.01235).abs() < 1e-9 && taken.gain == 1.0, "{taken:?}");
    assert_eq!(sensor.value(id::LINES), 1235);
    drop(camera);
    let left = [id::LINES, id::BETWEEN_FRAMES, id::ANALOGUE_GAIN].map(|id| sensor.value(id));
    assert_eq!(left, [800, 520, 128]);
}

#[test]
fn a_node_with_its_sensor_s_controls_needs_no_sub_device() {
    let node = raw_sensor();
    let mut camera = started(&node);
    // Its own pictures are 320 columns wide: a line takes 6.8 microseconds.
    let taken = camera.write_exposure(Exposure { time_s: 0.0068, gain: 1.0 }).unwrap();
    assert!((taken.time_s - 0.0068).abs() < 1e-9, "{taken:?}");
    assert_eq!(node.value(id::LINES), 1000);
}

#[test]
fn a_sensor_that_does_not_say_how_long_a_line_is_cannot_be_exposed() {
    for missing in [id::PIXEL_RATE, id::BETWEEN_LINES, id::LINES] {
        let node = raw_sensor();
        node.0.lock().unwrap().controls.remove(&missing);
        assert!(!started(&node).can_be_written(), "{missing:x}");
    }
}
