use super::device::{CompletedRequest, RequestDevice};
use super::exposure::{ExposureMetadata, RequestControls, taken};
use super::format::{CameraRole, GrantedStream, RoleChoice, RoleOffer, StreamFormat};
use super::*;
use crate::bracketed::{BracketedCamera, CameraResponse, ExposureControl};
use crate::clock::ManualClock;
use crate::developed::{CaptureSource, DevelopedCamera};
use crate::hdr::develop::SensorOptions;
use crate::model::pixels::PixelLayout;
use crate::model::{frame::Exposure, response::Response, time::Timestamp};
use crate::v4l2::node::{NodeFacts, Ready};
use crate::{FrameSource, v4l2::find::FoundNode};
use proptest::prelude::*;
use std::collections::VecDeque;
use std::io;
use std::sync::Mutex;
use std::time::Duration;

const BYTES: usize = 320 * 240 * 2;
const BUFFERS: usize = 4;

/// What the simulated library does next.
#[derive(Clone, Copy, Debug)]
enum LibraryTurn {
    /// A frame with this number; bytes used, and whether it is damaged.
    Frame(u32, usize, bool),
    Nothing,
    Gone,
}

struct Library {
    script: VecDeque<LibraryTurn>,
    /// Requests on their way, with what they ask for.
    queued: VecDeque<(usize, RequestControls)>,
    is_refusing: bool,
    takes_exposures: bool,
    states_exposures: bool,
    /// The sensor has what was asked for so many frames ago.
    delay: usize,
    asked: Vec<RequestControls>,
    /// Requests that were handed over twice.
    mistakes: usize,
}

#[derive(Clone)]
struct FakeSensor(Arc<Mutex<Library>>);

impl FakeSensor {
    fn new(script: impl IntoIterator<Item = LibraryTurn>) -> Self {
        Self(Arc::new(Mutex::new(Library {
            script: script.into_iter().collect(),
            queued: VecDeque::new(),
            is_refusing: false,
            takes_exposures: true,
            states_exposures: true,
            delay: 0,
            asked: Vec::new(),
            mistakes: 0,
        })))
    }

    fn with(self, change: impl FnOnce(&mut Library)) -> Self {
        change(&mut self.0.lock().unwrap());
        self
    }

    fn push(&self, turn: LibraryTurn) {
        self.0.lock().unwrap().script.push_back(turn);
    }
}

impl RequestDevice for FakeSensor {
    type Memory = Vec<u8>;

    fn offers(&self) -> io::Result<Vec<RoleOffer>> {
        let offer = |fourcc: &[u8; 4]| RoleOffer {
            role: CameraRole::Viewfinder,
            format: StreamFormat { fourcc: *fourcc, modifier: 0 },
            sizes: vec![[320, 240]],
            range: None,
        };
        Ok(match self.0.lock().unwrap().is_refusing {
            true => vec![offer(b"XR24"), offer(b"YU12")],
            false => vec![offer(b"XR24"), offer(b"YUYV")],
        })
    }

    fn configure(&mut self, choice: &RoleChoice) -> io::Result<GrantedStream> {
        let (width, height) = (choice.offer.width, choice.offer.height);
        Ok(GrantedStream { format: choice.format, width, height, stride: 2 * width })
    }

    fn start(&mut self, _layout: &PixelLayout, _controls: &RequestControls) -> io::Result<Vec<Vec<u8>>> {
        Ok((0..BUFFERS).map(|_| vec![128; BYTES]).collect())
    }

    fn takes_exposures(&self) -> bool {
        self.0.lock().unwrap().takes_exposures
    }

    fn queue(&mut self, index: usize, controls: &RequestControls) -> io::Result<()> {
        let mut library = self.0.lock().unwrap();
        if library.queued.iter().any(|(queued, _)| *queued == index) {
            library.mistakes += 1;
        }
        library.queued.push_back((index, *controls));
        library.asked.push(*controls);
        Ok(())
    }

    fn completed(&mut self) -> Option<CompletedRequest> {
        let mut library = self.0.lock().unwrap();
        let Some(&LibraryTurn::Frame(sequence, used, has_error)) = library.script.front() else {
            return None;
        };
        let (index, _) = library.queued.pop_front()?;
        library.script.pop_front();
        let had =
            library.asked[(sequence as usize).saturating_sub(library.delay).min(library.asked.len() - 1)];
        let metadata = ExposureMetadata {
            exposure_us: library.states_exposures.then_some(had.exposure_us),
            analogue_gain: library.states_exposures.then_some(had.gain),
            digital_gain: None,
        };
        Some(CompletedRequest { index, used, sequence, has_error, age_ns: Some(0), metadata })
    }

    fn wait(&mut self, _longest: Duration) -> io::Result<Ready> {
        let mut library = self.0.lock().unwrap();
        match library.script.front() {
            Some(LibraryTurn::Frame(..)) => Ok(Ready::Filled),
            Some(LibraryTurn::Gone) => Ok(Ready::Gone),
            Some(LibraryTurn::Nothing) => {
                library.script.pop_front();
                Ok(Ready::Nothing)
            }
            None => Ok(Ready::Nothing),
        }
    }
}

fn started(sensor: &FakeSensor) -> RequestCamera<FakeSensor> {
    start(sensor, &FormatWish::default()).unwrap()
}

fn start(sensor: &FakeSensor, wish: &FormatWish) -> Result<RequestCamera<FakeSensor>, DeviceError> {
    let clock = Arc::new(ManualClock::default());
    RequestCamera::start("libcamera:fake", "fake", sensor.clone(), wish, clock)
}

fn frame(sequence: u32) -> LibraryTurn {
    LibraryTurn::Frame(sequence, BYTES, false)
}

fn three() -> [Exposure; 3] {
    [0.001, 0.004, 0.016].map(|time_s| Exposure { time_s, gain: 1.0 })
}

#[test]
fn names_say_which_camera_and_which_pictures() {
    let options =
        LibcameraOptions::parse("/base/soc/i2c@1/imx219@10,size=1280x720,fps=60,format=pBAA").unwrap();
    assert_eq!(options.id, "/base/soc/i2c@1/imx219@10");
    let wish = FormatWish { width: 1280, height: 720, frames_per_s: 60.0, fourcc: Some(*b"pBAA") };
    assert_eq!(options.wish, wish);
    assert_eq!(LibcameraOptions::parse("").unwrap().id, "");
    let sized = LibcameraOptions::parse("size=320x240").unwrap();
    assert_eq!((sized.id.as_str(), sized.wish.width), ("", 320));
    assert_eq!(LibcameraOptions::parse("imx219").unwrap().id, "imx219");
    let refusal = |text: &str| LibcameraOptions::parse(text).unwrap_err().to_string();
    assert!(refusal("imx219,siez=1x1").contains("did you mean \"size\"?"));
    assert!(refusal("siez=1x1").contains("did you mean \"size\"?"));
    assert!(refusal("fps=0").contains("1..=1000"));
}

#[test]
fn a_part_of_a_name_or_a_model_is_enough() {
    let sensor =
        |id: &str, model: &str| LibcameraSensor { id: id.into(), model: model.into(), offers: Vec::new() };
    let sensors = [sensor("/base/i2c@10/imx219@10", "imx219"), sensor("/base/i2c@1", "ov5647")];
    let of = |text: &str| list::named(&sensors, text).map(|s| s.model.as_str());
    assert_eq!([of(""), of("ov5647"), of("/base/i2c@1")], [Some("imx219"), Some("ov5647"), Some("ov5647")]);
    assert_eq!(of("imx708"), None);
    assert!(nothing_there(&sensors, "imx708").contains("/base/i2c@1 (ov5647)"));
    assert!(nothing_there(&[], "").contains("udevd"));
}

#[test]
fn auto_takes_a_sensor_only_where_no_camera_is_on_usb() {
    let node = |bus: &str| FoundNode {
        path: "/dev/video0".into(),
        facts: NodeFacts { bus: bus.into(), captures: true, ..NodeFacts::default() },
    };
    let sensor = |id: &str| LibcameraSensor { id: id.into(), model: id.into(), offers: Vec::new() };
    let (raw, usb) = (sensor("/base/i2c@1/imx219@10"), sensor(r"\_SB_.PCI0-1:1.0-1d6b:0102"));
    assert!(is_best(&[], Some(std::slice::from_ref(&raw))));
    assert!(is_best(&[node("platform:3f801000.csi")], Some(&[usb.clone(), raw.clone()])));
    assert!(!is_best(&[node("usb-0000:00:14.0-1")], Some(&[raw])));
    // It need not even be asked then.
    assert!(!is_best(&[node("usb-0000:00:14.0-1")], None) && is_best(&[], None));
    assert!(!is_best(&[], Some(&[usb])));
    assert!(!is_best(&[], Some(&[])));
}

#[test]
fn the_newest_picture_wins_and_what_is_lost_is_counted() {
    let sensor = FakeSensor::new([frame(7), frame(8), frame(11)]);
    let mut camera = started(&sensor);
    let got = CaptureSource::next(&mut camera, Timestamp(0)).unwrap();
    assert_eq!(got.sequence, 11);
    let counts = camera.counts();
    assert_eq!((counts.gaps, counts.passed_over, counts.damaged), (2, 2, 0));
    assert_eq!(CaptureSource::next(&mut camera, Timestamp(0)).unwrap_err().kind, ErrorKind::Again);
}

#[test]
fn damaged_and_short_pictures_are_dropped_and_counted() {
    let sensor = FakeSensor::new([
        LibraryTurn::Frame(0, BYTES, true),
        LibraryTurn::Frame(1, BYTES / 2, false),
        LibraryTurn::Frame(2, 0, false),
    ]);
    let mut camera = started(&sensor);
    let mut kind = || CaptureSource::next(&mut camera, Timestamp(0)).map_or_else(|e| Some(e.kind), |_| None);
    assert_eq!(kind(), Some(ErrorKind::Again));
    assert_eq!(sensor.0.lock().unwrap().queued.len(), BUFFERS);
    sensor.push(LibraryTurn::Frame(3, BYTES + 1, false));
    assert_eq!(kind(), Some(ErrorKind::Again));
    sensor.push(frame(4));
    assert_eq!(kind(), None);
    for k in 5..40 {
        sensor.push(LibraryTurn::Frame(k, BYTES, true));
    }
    assert_eq!(kind(), Some(ErrorKind::Reopen));
}

#[test]
fn a_camera_that_is_pulled_out_is_to_be_opened_again() {
    let sensor = FakeSensor::new([frame(0), LibraryTurn::Gone]);
    let mut camera = started(&sensor);
    assert!(CaptureSource::next(&mut camera, Timestamp(0)).is_ok());
    let error = CaptureSource::next(&mut camera, Timestamp(0)).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Reopen);
    assert!(error.to_string().contains("libcamera:fake: was pulled out"), "{error}");
}

#[test]
fn a_camera_without_a_format_that_is_read_says_what_it_offers() {
    let sensor = FakeSensor::new([]).with(|library| library.is_refusing = true);
    let error = start(&sensor, &FormatWish::default()).err().unwrap();
    assert_eq!(error.kind, ErrorKind::Refused);
    assert!(
        error.to_string().contains("libcamera:fake: has no format that is read here; it offers XR24, YU12"),
        "{error}"
    );
    let sensor = FakeSensor::new([]);
    let error =
        start(&sensor, &FormatWish { fourcc: Some(*b"NV12"), ..FormatWish::default() }).err().unwrap();
    assert!(error.to_string().contains("read here as NV12; it offers XR24, YUYV"), "{error}");
}

#[test]
fn each_frame_has_the_exposure_that_its_metadata_states() {
    // The sensor is two frames late: what the request asked for is not what its frame had.
    let sensor = FakeSensor::new([frame(0)]).with(|library| library.delay = 2);
    let mut camera = started(&sensor);
    camera.look_at_metadata(Timestamp(0)).unwrap();
    assert!(!camera.can_be_written());
    assert_eq!(camera.set_exposures(&three()).unwrap(), three());
    for k in 1..30 {
        sensor.push(frame(k));
        let got = CaptureSource::next(&mut camera, Timestamp(0)).unwrap();
        let had = sensor.0.lock().unwrap().asked[(k as usize).saturating_sub(2)];
        let exposure = Exposure { time_s: f64::from(had.exposure_us) / 1e6, gain: f64::from(had.gain) };
        assert_eq!(got.exposure, exposure, "frame {k}");
        assert_eq!(got.t_mid, Timestamp((0.5e9 * exposure.time_s) as i64));
    }
    let asked: Vec<i32> = sensor.0.lock().unwrap().asked.iter().map(|c| c.exposure_us).collect();
    // Four were on their way; then all three in turn.
    assert_eq!(asked[..10], [10_000, 10_000, 10_000, 10_000, 1000, 4000, 16_000, 1000, 4000, 16_000]);
}

#[test]
fn stated_exposures_pass_through_the_bracketing_as_they_are() {
    let sensor = FakeSensor::new([frame(0)]).with(|library| library.delay = 1);
    let mut camera = started(&sensor);
    camera.look_at_metadata(Timestamp(0)).unwrap();
    let developed = DevelopedCamera::new("fake", camera, Response::srgb(), SensorOptions::default()).unwrap();
    let mut bracketed =
        BracketedCamera::new("fake", developed, CameraResponse::Stated(Box::new(Response::srgb())));
    assert_eq!(bracketed.set_exposures(&three()).unwrap(), three());
    let mut times = Vec::new();
    for k in 1..12 {
        sensor.push(frame(k));
        // The clock of the test stands still, so a shorter exposure after a longer one is not later than it.
        if let Ok(got) = bracketed.next(Timestamp(0)) {
            times.push(got.exposure.time_s);
        }
    }
    assert_eq!(bracketed.report(), None);
    assert!(times.contains(&0.016), "{times:?}");
}

#[test]
fn without_metadata_a_frame_has_what_its_request_asked_and_its_exposure_is_to_be_told() {
    let sensor = FakeSensor::new([frame(0)]).with(|library| library.states_exposures = false);
    let mut camera = started(&sensor);
    assert!(!camera.can_be_written());
    camera.look_at_metadata(Timestamp(0)).unwrap();
    assert!(camera.can_be_written() && camera.times_are_starts());
    assert_eq!(camera.set_exposures(&three()).unwrap(), three());
    let written = camera.write_exposure(Exposure { time_s: 0.002, gain: 2.0 }).unwrap();
    assert_eq!(written, taken(written));
    for k in 1..9 {
        sensor.push(frame(k));
        let got = CaptureSource::next(&mut camera, Timestamp(0)).unwrap();
        // Those that were on their way asked for the first.
        assert_eq!(got.exposure.time_s, if k < 4 { 0.01 } else { 0.002 }, "frame {k}");
    }
}

#[test]
fn a_camera_whose_requests_take_no_exposure_still_runs() {
    let sensor = FakeSensor::new([frame(0)]).with(|library| library.takes_exposures = false);
    let mut camera = started(&sensor);
    assert_eq!(camera.set_exposures(&three()).unwrap().len(), 1);
    assert!(CaptureSource::next(&mut camera, Timestamp(0)).is_ok());
    assert!(!camera.can_be_written());
}

proptest! {
    /// No request is ever handed over twice or lost, whatever the library says and however long pictures are held.
    #[test]
    fn requests_come_back(turns in prop::collection::vec((0u32..4, any::<u32>(), 0usize..2 * BYTES, any::<bool>()), 0..60)) {
        let script = turns.iter().map(|&(kind, sequence, used, damaged)| match kind {
            0 => LibraryTurn::Nothing,
            1 => LibraryTurn::Frame(sequence, used, damaged),
            _ => frame(sequence),
        });
        let sensor = FakeSensor::new(script);
        let mut camera = started(&sensor);
        let mut held = VecDeque::new();
        for (kind, ..) in &turns {
            match CaptureSource::next(&mut camera, Timestamp(0)) {
                Ok(frame) => held.push_back(frame),
                Err(error) => prop_assert!(matches!(error.kind, ErrorKind::Again | ErrorKind::Reopen)),
            }
            if kind % 2 == 0 || held.len() > 2 {
                held.pop_front();
            }
        }
        held.clear();
        let _ = CaptureSource::next(&mut camera, Timestamp(0));
        let library = sensor.0.lock().unwrap();
        prop_assert_eq!(library.mistakes, 0);
        prop_assert!(library.queued.len() >= BUFFERS - 1);
    }
}
