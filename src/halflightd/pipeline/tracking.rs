//! Tags are looked for on a thread of their own, one picture at a time; the pose over time is kept here.
//!
//! The thread is worth having because a picture can be searched before its turn: live as soon as it has come
//! ([`EarlySearch`]), while the one before it is drawn.

use crate::model::{
    estimate::PoseEstimate, frame::RawFrame, image::Image, imu::ImuSample, response::Response, rig::Rig,
    time::Timestamp,
};
pub use crate::track::state::{FollowOptions, TrackState, Update};
use crate::track::{
    edges::table_of_response,
    fuse::{FuseOptions, Fuser},
    tag::{Region, TagDetection, TagDetector, TagError, TagOptions, gray_of},
};
use std::{
    sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::JoinHandle,
};

/// How tags are looked for and followed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackingOptions {
    /// The detector.
    pub tags: TagOptions,
    /// The pose over time.
    pub follow: FollowOptions,
}

/// Why tracking could not go on.
#[derive(Debug, thiserror::Error)]
pub enum TrackingError {
    /// The detector refused its options or a picture.
    #[error(transparent)]
    Tags(#[from] TagError),
    /// The thread could not be started.
    #[error("tracking: the thread could not be started: {0}")]
    Thread(#[source] std::io::Error),
    /// The thread has ended, which only a fault in it can do.
    #[error("tracking: the thread has stopped")]
    Stopped,
    /// The picture is not of the lens's size.
    #[error("tracking: a picture of {width} x {height} pixels: must be {} x {} as the lens is", lens.0, lens.1)]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Columns and rows of the rig's lens.
        lens: (u32, u32),
    },
}

/// What one picture gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// The picture's number.
    pub sequence: u64,
    /// Middle of its exposure.
    pub t: Timestamp,
    /// Measured, missed, or too old.
    pub update: Update,
    /// The best that is known of the pose at `t`: of provenance `Measured` exactly where a tag was seen. `None`
    /// before the first tag.
    pub estimate: Option<PoseEstimate>,
    /// Whether the whole picture was searched, not only where tags were predicted.
    pub whole: bool,
}

/// Goes to the thread and comes back, so that its memory is reused.
#[derive(Default)]
struct Job {
    frame: Option<RawFrame>,
    regions: Vec<Region>,
    whole: bool,
    linear_of_value: Option<Box<[f32; 256]>>,
    found: Vec<TagDetection>,
    fault: Option<TagError>,
}

/// What is on its way to and from the thread, and what came of it.
struct SearchDesk {
    state: TrackState,
    /// The pose between tags, where there is an inertial sensor.
    fuser: Fuser,
    jobs: Option<SyncSender<Job>>,
    done: Receiver<Job>,
    /// `None` while the thread has it.
    idle: Option<Job>,
    /// The picture that the thread has.
    under_way: Option<(u64, Timestamp)>,
    linear_of_value: Option<Box<[f32; 256]>>,
}

/// Follows the camera: pictures in, poses out. At most one picture is under way; with `submit` followed by
/// `collect(true)` everything is in lockstep, and equal pictures give equal poses.
pub struct Tracker {
    desk: Arc<Mutex<SearchDesk>>,
    thread: Option<JoinHandle<()>>,
    lens_size: (u32, u32),
}

/// Has pictures searched before their turn, from any thread.
#[derive(Clone)]
pub struct EarlySearch(Arc<Mutex<SearchDesk>>);

impl EarlySearch {
    /// Has a picture searched now, where nothing else is. Never waits. Returns whether the search has begun.
    pub fn offer(&self, frame: &RawFrame) -> bool {
        // Somebody who waits for a search holds the lock; there is nothing to begin then.
        let Ok(mut desk) = self.0.try_lock() else { return false };
        desk.submit(frame).unwrap_or(false)
    }
}

fn lock(desk: &Mutex<SearchDesk>) -> MutexGuard<'_, SearchDesk> {
    // Every change of the desk leaves it whole.
    desk.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SearchDesk {
    /// The pose where a tag was seen; between tags by the inertial sensor, where it gives samples, else by the velocity.
    fn pose_at(&self, t: Timestamp) -> Option<PoseEstimate> {
        match self.fuser.sample_counts().taken {
            0 => self.state.pose_at(t),
            _ => self.fuser.pose_at(t),
        }
    }

    fn submit(&mut self, frame: &RawFrame) -> Result<bool, TrackingError> {
        let (width, height) = (frame.pixels.width(), frame.pixels.height());
        let lens = (self.state.rig().lens.width, self.state.rig().lens.height);
        if (width, height) != (lens.0 as usize, lens.1 as usize) {
            return Err(TrackingError::Size { width, height, lens });
        }
        let Some(mut job) = self.idle.take() else { return Ok(false) };
        job.regions.clear();
        if let Some(regions) = self.state.search(frame.t_mid) {
            job.regions.extend_from_slice(regions);
        }
        job.whole = job.regions.is_empty();
        job.linear_of_value = self.linear_of_value.take();
        job.frame = Some(frame.clone());
        self.under_way = Some((frame.sequence, frame.t_mid));
        let jobs = self.jobs.as_ref().ok_or(TrackingError::Stopped)?;
        jobs.send(job).map_err(|_closed| TrackingError::Stopped)?;
        Ok(true)
    }

    fn collect(&mut self, block: bool) -> Result<Option<Tracked>, TrackingError> {
        if self.idle.is_some() {
            return Ok(None);
        }
        let mut job = if block {
            self.done.recv().map_err(|_closed| TrackingError::Stopped)?
        } else {
            match self.done.try_recv() {
                Ok(job) => job,
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => return Err(TrackingError::Stopped),
            }
        };
        self.under_way = None;
        let (frame, fault, whole) = (job.frame.take(), job.fault.take(), job.whole);
        let result = match (fault, frame) {
            (Some(fault), _) => Err(fault.into()),
            (None, None) => Err(TrackingError::Stopped),
            (None, Some(frame)) => {
                let t = frame.t_mid;
                let update = self.state.update(t, &job.found);
                if let Some(measured) = self.state.pose_at(t) {
                    // Takes what was measured, and nothing else.
                    self.fuser.tag(&measured);
                }
                let estimate = self.pose_at(t);
                Ok(Some(Tracked { sequence: frame.sequence, t, update, estimate, whole }))
            }
        };
        self.idle = Some(job);
        result
    }
}

impl Tracker {
    /// Starts with usual options but for the detector's decimation (a whole number, 1 to 8) and blur, pixels.
    pub fn start(rig: &Rig, decimate: f32, quad_sigma_px: f32) -> Result<Self, TrackingError> {
        if decimate.fract() != 0.0 || !(1.0..=8.0).contains(&decimate) {
            let (given, allowed) = (decimate.to_string(), "a whole number within 1..=8");
            return Err(TagError::Option { option: "decimate", given, allowed }.into());
        }
        let tags = TagOptions { decimate: decimate as u32, quad_sigma_px, ..TagOptions::default() };
        Self::start_with(rig, TrackingOptions { tags, ..TrackingOptions::default() })
    }

    /// Starts the thread, which makes and owns the detector.
    pub fn start_with(rig: &Rig, options: TrackingOptions) -> Result<Self, TrackingError> {
        let (jobs, inbox) = sync_channel::<Job>(1);
        let (outbox, done) = sync_channel::<Job>(1);
        let (made, ready) = sync_channel::<Result<(), TagError>>(1);
        let tags = options.tags;
        let work = move || match TagDetector::new(tags) {
            Ok(detector) => {
                // Nobody listening means that the tracker is gone, and then the inbox is closed as well.
                let _ = made.send(Ok(()));
                serve(detector, &inbox, &outbox);
            }
            Err(error) => drop(made.send(Err(error))),
        };
        let thread = std::thread::Builder::new()
            .name("halflight-tags".into())
            .spawn(work)
            .map_err(TrackingError::Thread)?;
        ready.recv().map_err(|_closed| TrackingError::Stopped)??;
        let desk = SearchDesk {
            state: TrackState::new(rig.clone(), options.follow),
            fuser: Fuser::new(FuseOptions::default()),
            jobs: Some(jobs),
            done,
            idle: Some(Job::default()),
            under_way: None,
            linear_of_value: None,
        };
        let lens_size = (rig.lens.width, rig.lens.height);
        Ok(Self { desk: Arc::new(Mutex::new(desk)), thread: Some(thread), lens_size })
    }

    /// Has pictures searched before their turn.
    pub fn early(&self) -> EarlySearch {
        EarlySearch(Arc::clone(&self.desk))
    }

    /// The best that is known of the pose at a moment; `None` before the first tag.
    pub fn pose_at(&self, t: Timestamp) -> Option<PoseEstimate> {
        lock(&self.desk).pose_at(t)
    }

    /// Takes an inertial sample: from the first one on, poses between tags are turned by the gyroscope.
    pub fn sense(&mut self, sample: &ImuSample) {
        lock(&self.desk).fuser.imu(sample);
    }

    /// Uses the camera's own response from the next picture on: corners are found in linear light.
    pub fn set_response(&mut self, response: &Response) {
        lock(&self.desk).linear_of_value = Some(Box::new(table_of_response(response)));
    }

    /// Forgets all measurements, e.g. when a recording starts again. A picture under way still counts.
    pub fn reset(&mut self) {
        let mut desk = lock(&self.desk);
        desk.state.reset();
        desk.fuser.reset();
    }

    /// Whether a picture is under way.
    pub fn is_busy(&self) -> bool {
        lock(&self.desk).idle.is_none()
    }

    /// Hands a picture to the thread. `false` where one is still under way: collect it first, or let this one go
    /// (the next is newer).
    pub fn submit(&mut self, frame: &RawFrame) -> Result<bool, TrackingError> {
        lock(&self.desk).submit(frame)
    }

    /// Takes the picture that was under way, waiting for it if `block`. `None` where none is, or it is not done.
    /// A picture that the detector refuses is an error and changes nothing.
    pub fn collect(&mut self, block: bool) -> Result<Option<Tracked>, TrackingError> {
        lock(&self.desk).collect(block)
    }

    /// Waits for a picture's search, which may have begun before its turn, and gives the best that is known of the pose at
    /// its time (see `Tracked::estimate`). A search of another picture under way is collected first: where it is older, it
    /// is one more measurement.
    pub fn track(&mut self, frame: &RawFrame) -> Result<Option<PoseEstimate>, TrackingError> {
        let (width, height) = (frame.pixels.width(), frame.pixels.height());
        let lens = self.lens_size;
        if (width, height) != (lens.0 as usize, lens.1 as usize) {
            return Err(TrackingError::Size { width, height, lens });
        }
        let mut desk = lock(&self.desk);
        if desk.under_way != Some((frame.sequence, frame.t_mid)) {
            desk.collect(true)?;
            desk.submit(frame)?;
        }
        Ok(desk.collect(true)?.and_then(|tracked| tracked.estimate))
    }

    /// Does something with the tags found in the picture collected last, known ones and others; none while one is under way.
    pub fn with_detections<R>(&self, look: impl FnOnce(&[TagDetection]) -> R) -> R {
        let desk = lock(&self.desk);
        look(desk.idle.as_ref().map_or(&[], |job| &job.found))
    }
}

impl Drop for Tracker {
    fn drop(&mut self) {
        // Closing the channel ends the thread after the picture that it has.
        lock(&self.desk).jobs = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed; there is nobody left to tell.
            let _ = thread.join();
        }
    }
}

/// The thread: one picture after the other until the channel closes.
fn serve(mut detector: TagDetector, inbox: &Receiver<Job>, outbox: &SyncSender<Job>) {
    let mut gray = Image::default();
    while let Ok(mut job) = inbox.recv() {
        job.found.clear();
        job.fault = search(&mut detector, &mut gray, &mut job).err();
        if outbox.send(job).is_err() {
            return;
        }
    }
}

fn search(detector: &mut TagDetector, gray: &mut Image<u8>, job: &mut Job) -> Result<(), TagError> {
    if let Some(table) = job.linear_of_value.take() {
        detector.set_linear_of_value(&table)?;
    }
    let Some(frame) = &job.frame else { return Ok(()) };
    gray_of(&frame.pixels, gray);
    let regions = if job.whole { None } else { Some(job.regions.as_slice()) };
    detector.detect(gray, regions, &mut job.found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{lens::Lens, pose::Pose};
    use crate::model::{estimate::Provenance, frame::Exposure, image::Rgb8Image, rig::TagPlacement};
    use crate::track::{drawing::draw, tag_pose::corners_of_tag_m};
    use glam::{DMat3, DVec3};
    use std::sync::Arc;

    fn rig() -> Rig {
        let face_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let world_from_tag = Pose::from_matrix(face_up, DVec3::ZERO);
        let tags = vec![TagPlacement { id: 0, side_m: 0.1, world_from_tag }];
        Rig { lens: Lens::pinhole(320, 240, 320.0, 320.0, 160.0, 120.0), tags, ball: None }
    }

    fn camera(seconds: f64) -> Pose {
        Pose::look_at(DVec3::new(0.1 * seconds, -0.35, 0.3), DVec3::ZERO, DVec3::Z)
    }

    /// A frame of the tag as seen at that time; dark ones show nothing.
    fn frame(sequence: u64, seconds: f64, dark: bool) -> RawFrame {
        let rig = rig();
        let camera_from_world = camera(seconds).inverse();
        let corners = corners_of_tag_m(0.1).map(|c| {
            let p = camera_from_world.transform(rig.tags[0].world_from_tag.transform(c));
            rig.lens.project(p).expect("in view")
        });
        // `srgb_encode` of the linear light, as the default response takes it.
        let encode = |l: f64| if l <= 0.0031308 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
        let gray = draw(320, 240, 0, &corners, |l| if dark { 0.004 } else { encode(l) });
        let pixels = Rgb8Image::from_pixels(320, 240, gray.pixels().iter().map(|&g| [g, g, g]).collect());
        let pixels = Arc::new(pixels.expect("all pixels"));
        let (t_mid, exposure) = (Timestamp::from_seconds(seconds), Exposure { time_s: 0.01, gain: 1.0 });
        RawFrame { sequence, t_mid, exposure, pixels, sensor: None, row_time_s: 0.0, response: None }
    }

    fn start() -> Tracker {
        Tracker::start(&rig(), 2.0, 0.8).unwrap()
    }

    fn lockstep(tracker: &mut Tracker, frame: &RawFrame) -> Tracked {
        assert!(tracker.submit(frame).unwrap());
        tracker.collect(true).unwrap().expect("one picture under way")
    }

    #[test]
    fn follows_through_dark_pictures() {
        let mut tracker = start();
        assert!(tracker.pose_at(Timestamp(0)).is_none());
        let (mut worst_measured, mut worst_predicted) = (0.0f64, 0.0f64);
        for k in 0..12u64 {
            let seconds = k as f64 / 30.0;
            let dark = k % 3 == 2;
            let tracked = lockstep(&mut tracker, &frame(k, seconds, dark));
            assert_eq!(tracked.sequence, k);
            let estimate = tracked.estimate.expect("the first picture shows the tag");
            let off = estimate.world_from_camera.translation.distance(camera(seconds).translation);
            if dark {
                assert_eq!(tracked.update, Update::Missed);
                assert!(matches!(estimate.provenance, Provenance::Predicted { .. }));
                worst_predicted = worst_predicted.max(off);
            } else {
                assert!(matches!(tracked.update, Update::Measured { tags: 1, .. }), "{k}: {tracked:?}");
                assert_eq!(estimate.provenance, Provenance::Measured);
                worst_measured = worst_measured.max(off);
            }
            assert_eq!(tracked.whole, k == 0, "after the first hit only regions are searched");
            assert_eq!(tracker.with_detections(<[_]>::len), usize::from(!dark));
        }
        // At 0.46 m; the camera moves 3.3 mm between pictures.
        assert!(worst_measured < 5e-4, "{worst_measured}");
        assert!(worst_predicted < 1.5e-3, "{worst_predicted}");
    }

    #[test]
    fn equal_pictures_give_equal_poses() {
        let run = || {
            let mut tracker = start();
            (0..4).map(|k| tracker.track(&frame(k, k as f64 / 30.0, k == 2)).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(run(), run());
    }

    /// How the camera turns, its own axes.
    fn turning_rad_s(seconds: f64) -> [f64; 3] {
        const STEP_S: f64 = 1e-3;
        let [before, after] = [-0.5, 0.5].map(|half| camera(seconds + half * STEP_S).rotation);
        ((before.inverse() * after).to_scaled_axis() / STEP_S).to_array()
    }

    /// A camera that turns while its tag is hidden: the gyroscope knows.
    #[test]
    fn between_tags_the_gyroscope_turns_the_pose() {
        let (mut plain, mut sensed) = (start(), start());
        let seen = |k: u64| frame(k, k as f64 / 30.0, k >= 4);
        let rate_rad_s = 0.8;
        for k in 0..8u64 {
            for step in 0..7 {
                let t = Timestamp::from_seconds((k as f64 + f64::from(step) / 7.0 - 1.0) / 30.0);
                // As the camera truly turns, and otherwise while nobody sees.
                let gyro_rad_s =
                    if t > seen(3).t_mid { [0.0, rate_rad_s, 0.0] } else { turning_rad_s(t.seconds()) };
                sensed.sense(&ImuSample { t, gyro_rad_s, accel_m_s2: [0.0; 3] });
            }
            let (without, with) = (plain.track(&seen(k)).unwrap(), sensed.track(&seen(k)).unwrap());
            if k < 4 {
                assert_eq!(without, with, "where the tag is found nothing changes");
            }
        }
        let turned = |tracker: &Tracker| {
            let [before, after] = [3, 7].map(|k| tracker.pose_at(seen(k).t_mid));
            before.zip(after).map(|(b, a)| b.world_from_camera.angle_to(&a.world_from_camera)).unwrap()
        };
        let expected = rate_rad_s * 4.0 / 30.0;
        let [without, with] = [turned(&plain), turned(&sensed)];
        assert!((with - expected).abs() < 0.02, "{with}, not {expected}");
        assert!((without - expected).abs() > 0.05, "{without}");
    }

    /// What is searched before its turn, in order or not, gives the same poses in the end.
    #[test]
    fn a_search_before_its_turn_gives_the_same_pose() {
        let frames: Vec<RawFrame> = (0..5).map(|k| frame(k, k as f64 / 30.0, false)).collect();
        let mut plain = start();
        let expected: Vec<_> = frames.iter().map(|f| plain.track(f).unwrap()).collect();
        let mut tracker = start();
        let early = tracker.early();
        let mut found = Vec::new();
        for (k, frame) in frames.iter().enumerate() {
            found.push(tracker.track(frame).unwrap());
            if let Some(next) = frames.get(k + 1) {
                assert!(early.offer(next), "nothing is under way");
                assert!(!early.offer(next), "one at a time");
            }
        }
        assert_eq!(found, expected);
        // A picture that was searched and then passed over is one more measurement.
        let mut tracker = start();
        tracker.track(&frames[0]).unwrap();
        assert!(tracker.early().offer(&frames[1]));
        assert_eq!(tracker.track(&frames[2]).unwrap(), expected[2]);
    }

    #[test]
    fn one_picture_at_a_time_and_clear_refusals() {
        let mut tracker = start();
        assert_eq!(tracker.collect(true).unwrap(), None);
        let one = frame(0, 0.0, false);
        assert!(tracker.submit(&one).unwrap());
        assert!(tracker.is_busy());
        assert!(!tracker.submit(&one).unwrap());
        assert!(tracker.collect(true).unwrap().is_some());
        assert!(!tracker.is_busy());
        assert_eq!(lockstep(&mut tracker, &one).update, Update::Stale, "the same time again");
        let small = RawFrame { pixels: Arc::new(Rgb8Image::filled(160, 120, [0; 3])), ..one };
        let error = tracker.submit(&small).unwrap_err().to_string();
        assert_eq!(error, "tracking: a picture of 160 x 120 pixels: must be 320 x 240 as the lens is");
        assert!(!tracker.is_busy());
        for decimate in [0.0, 1.5, 99.0, f32::NAN] {
            let error = Tracker::start(&rig(), decimate, 0.8).err().expect("refused").to_string();
            assert!(error.contains(&format!("decimate = {decimate}: must be a whole number")), "{error}");
        }
        let error = Tracker::start(&rig(), 2.0, -1.0).err().expect("refused").to_string();
        assert!(error.contains("quad_sigma_px = -1"), "{error}");
    }
}
