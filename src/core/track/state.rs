//! The camera's pose over time: prediction, where to search, what to believe. Pure: time comes with the calls.

use super::{
    refine::PoseSigma,
    rig_pose::{RigPose, RigPoseSolver},
    tag::{Region, TagDetection},
    tag_pose::{Prior, corners_of_tag_m},
};
use crate::math::pose::Pose;
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    rig::Rig,
    time::Timestamp,
};
use glam::{DQuat, DVec2, DVec3};

/// How the pose is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowOptions {
    /// The motion model is trusted this long after the last measurement, seconds; then the pose is held.
    pub predict_s: f64,
    /// A longer gap between two pictures starts afresh, seconds (spec, section 10).
    pub reset_gap_s: f64,
    /// Pictures in a row without a tag in the predicted regions before the whole picture is searched again. One
    /// cycle of exposures, so that a dark and a saturated picture do not cost a search of the whole.
    pub misses_before_whole: u32,
    /// Time constant of the velocity's filter, seconds.
    pub velocity_tau_s: f64,
    /// Whether the camera is known to be above the plane z = 0.
    pub above_plane: bool,
}

impl Default for FollowOptions {
    fn default() -> Self {
        Self {
            predict_s: 0.25,
            reset_gap_s: 1.0,
            misses_before_whole: 3,
            velocity_tau_s: 0.06,
            above_plane: true,
        }
    }
}

/// Accelerations of a camera in a hand, which the constant velocity knows nothing of.
const ACCELERATION_M_S2: f64 = 2.0;
/// The same for turning.
const ACCELERATION_RAD_S2: f64 = 6.0;
/// Speeds of a camera in a hand, for when no velocity is known yet.
const SPEED_M_S: f64 = 0.5;
/// The same for turning.
const SPEED_RAD_S: f64 = 1.5;
/// What a prediction may be wrong by at once.
const PREDICTION_FLOOR: PoseSigma = PoseSigma { position_m: 0.005, rotation_rad: 0.01 };
/// Summed evidence against the pose that the prediction chose, in squared standard deviations, that brings it
/// down: five standard deviations.
const DOUBT_LIMIT: f64 = 25.0;
/// Two pictures nearer in time than this say nothing of the speed, seconds: noise of a tenth of a millimetre within a
/// microsecond would be 100 m/s. No camera is faster than a thousand pictures a second.
const LEAST_STEP_S: f64 = 1e-3;
/// Margin around a predicted tag: pixels, and share of the tag's own size (its white rim is an eighth).
const MARGIN: (f64, f64) = (10.0, 0.3);
/// Regions that would cover more than this share of the picture are no gain over the whole.
const LARGEST_SHARE: f64 = 0.6;

#[derive(Clone, Copy, Debug)]
struct MeasuredPose {
    t: Timestamp,
    world_from_camera: Pose,
    sigma: PoseSigma,
}

/// Of the camera's centre and of its rotation, world frame.
#[derive(Clone, Copy, Debug)]
struct Velocity {
    linear_m_s: DVec3,
    angular_rad_s: DVec3,
}

/// Follows the camera from tag detections.
#[derive(Clone, Debug)]
pub struct TrackState {
    rig: Rig,
    options: FollowOptions,
    last: Option<MeasuredPose>,
    velocity: Option<Velocity>,
    /// Time of the newest picture that was looked at, tag or none.
    newest: Option<Timestamp>,
    misses: u32,
    doubt: f64,
    solver: RigPoseSolver,
    regions: Vec<Region>,
}

/// What a picture gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Update {
    /// A pose was measured from this many tags.
    Measured {
        /// Tags that entered.
        tags: usize,
        /// Root of the mean squared residual of their corners, pixels.
        rms_px: f64,
    },
    /// No known tag was seen, or none that fits.
    Missed,
    /// Not newer than the picture before: left out.
    Stale,
}

impl TrackState {
    /// Knows nothing yet but the rig.
    pub fn new(rig: Rig, options: FollowOptions) -> Self {
        Self {
            rig,
            options,
            last: None,
            velocity: None,
            newest: None,
            misses: 0,
            doubt: 0.0,
            solver: RigPoseSolver::default(),
            regions: Vec::new(),
        }
    }

    /// What it was made with.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) {
        (self.last, self.velocity, self.newest) = (None, None, None);
        (self.misses, self.doubt) = (0, 0.0);
    }

    /// Where to search the picture taken at `t`: around each tag as predicted, or `None` for the whole picture
    /// (nothing known yet, lost, or no tag predicted inside).
    pub fn search(&mut self, t: Timestamp) -> Option<&[Region]> {
        self.regions.clear();
        let (pose, sigma) = self.predict(t)?;
        if self.misses >= self.options.misses_before_whole {
            return None;
        }
        let lens = &self.rig.lens;
        let camera_from_world = pose.inverse();
        let (width, height) = (lens.width as usize, lens.height as usize);
        for tag in &self.rig.tags {
            let camera_from_tag = camera_from_world.then(&tag.world_from_tag);
            // A tag shows its face to a camera on its -z side.
            if camera_from_tag.inverse().translation.z >= 0.0 {
                continue;
            }
            let mut corners = [DVec2::NAN; 4];
            for (pixel, corner) in corners.iter_mut().zip(corners_of_tag_m(tag.side_m)) {
                *pixel = lens.project(camera_from_tag.transform(corner)).unwrap_or(DVec2::NAN);
            }
            let side = corners[0].distance(corners[2]);
            let distance = camera_from_tag.translation.length().max(tag.side_m);
            // What the prediction may be wrong by, as it moves the tag in the picture.
            let wander = lens.fx.max(lens.fy) * (sigma.rotation_rad + sigma.position_m / distance);
            let margin = MARGIN.0 + MARGIN.1 * side + wander.min(0.5 * f64::from(lens.width));
            let region = Region::around(&corners, margin).and_then(|r| r.within(width, height));
            if let Some(region) = region {
                join(&mut self.regions, region);
            }
        }
        let area: f64 = self.regions.iter().map(|r| f64::from(r.width) * f64::from(r.height)).sum();
        let worth = !self.regions.is_empty() && area < LARGEST_SHARE * (width * height) as f64;
        worth.then_some(&self.regions)
    }

    /// Takes the tags found in the picture of time `t`. A picture that is not newer than the last one is left
    /// out; after a gap of more than a second all starts afresh.
    pub fn update(&mut self, t: Timestamp, detections: &[TagDetection]) -> Update {
        if let Some(newest) = self.newest {
            let gap_s = t.seconds_since(newest);
            if gap_s <= 0.0 {
                return Update::Stale;
            }
            if gap_s > self.options.reset_gap_s {
                self.reset();
            }
        }
        self.newest = Some(t);
        let Some(found) = self.measure(t, detections) else {
            self.misses = self.misses.saturating_add(1);
            return Update::Missed;
        };
        self.misses = 0;
        self.follow_velocity(t, &found);
        self.last = Some(MeasuredPose { t, world_from_camera: found.world_from_camera, sigma: found.sigma });
        Update::Measured { tags: found.tags, rms_px: found.rms_px }
    }

    /// The pose of the tags, chosen by plane and time. Where the prediction chose against the corners again and
    /// again, it is dropped: it may have started from the wrong one of two poses.
    fn measure(&mut self, t: Timestamp, detections: &[TagDetection]) -> Option<RigPose> {
        let blind = Prior { predicted: None, above_plane: self.options.above_plane };
        let prior = Prior { predicted: self.predict(t), ..blind };
        let (tags, lens) = (&self.rig.tags, &self.rig.lens);
        let found = self.solver.solve(detections, tags, lens, &prior)?;
        self.doubt = (self.doubt - found.evidence).max(0.0);
        if self.doubt <= DOUBT_LIMIT {
            return Some(found);
        }
        let fresh = self.solver.solve(detections, tags, lens, &blind);
        self.reset();
        self.newest = Some(t);
        fresh
    }

    fn follow_velocity(&mut self, t: Timestamp, found: &RigPose) {
        let Some(last) = self.last else { return };
        let dt = t.seconds_since(last.t);
        if dt < LEAST_STEP_S {
            return;
        }
        let delta = found.world_from_camera.rotation * last.world_from_camera.rotation.conjugate();
        // The short way round: q and -q are one rotation.
        let delta = if delta.w < 0.0 { -delta } else { delta };
        let now = Velocity {
            linear_m_s: (found.world_from_camera.translation - last.world_from_camera.translation) / dt,
            angular_rad_s: delta.to_scaled_axis() / dt,
        };
        let share = 1.0 - (-dt / self.options.velocity_tau_s).exp();
        self.velocity = Some(match self.velocity {
            None => now,
            Some(before) => Velocity {
                linear_m_s: before.linear_m_s.lerp(now.linear_m_s, share),
                angular_rad_s: before.angular_rad_s.lerp(now.angular_rad_s, share),
            },
        });
    }

    /// The motion model's pose at `t` and how far off it may be; `None` before the first measurement, and once
    /// the last one is older than the longest gap.
    fn predict(&self, t: Timestamp) -> Option<(Pose, PoseSigma)> {
        let last = self.last?;
        let age_s = t.seconds_since(last.t).max(0.0);
        (age_s <= self.options.reset_gap_s).then(|| self.extrapolate(&last, age_s))
    }

    fn extrapolate(&self, last: &MeasuredPose, age_s: f64) -> (Pose, PoseSigma) {
        // Beyond `predict_s` the pose stays where the model had brought it; its uncertainty goes on growing.
        let moved_s = age_s.min(self.options.predict_s);
        let (pose, unknown) = match self.velocity {
            Some(v) => {
                let turned = DQuat::from_scaled_axis(v.angular_rad_s * moved_s);
                let pose = Pose::new(
                    turned * last.world_from_camera.rotation,
                    last.world_from_camera.translation + v.linear_m_s * moved_s,
                );
                let half = 0.5 * age_s * age_s;
                (pose, (ACCELERATION_M_S2 * half, ACCELERATION_RAD_S2 * half))
            }
            None => (last.world_from_camera, (SPEED_M_S * age_s, SPEED_RAD_S * age_s)),
        };
        let sigma = PoseSigma {
            position_m: last.sigma.position_m.hypot(PREDICTION_FLOOR.position_m) + unknown.0,
            rotation_rad: last.sigma.rotation_rad.hypot(PREDICTION_FLOOR.rotation_rad) + unknown.1,
        };
        (pose, sigma)
    }

    /// The best that is known of the pose at `t`: measured, predicted for up to `predict_s`, then held. For a
    /// time before the last measurement it is that measurement, with its own time. `None` before the first.
    pub fn pose_at(&self, t: Timestamp) -> Option<PoseEstimate> {
        let last = self.last?;
        let age_s = t.seconds_since(last.t);
        if age_s <= 0.0 {
            return Some(PoseEstimate {
                t: last.t,
                world_from_camera: last.world_from_camera,
                provenance: Provenance::Measured,
                sigma_position_m: last.sigma.position_m,
                sigma_rotation_rad: last.sigma.rotation_rad,
            });
        }
        let (world_from_camera, sigma) = self.extrapolate(&last, age_s);
        let predicted = self.velocity.is_some() && age_s <= self.options.predict_s;
        Some(PoseEstimate {
            t,
            world_from_camera,
            provenance: if predicted { Provenance::Predicted { age_s } } else { Provenance::Held { age_s } },
            sigma_position_m: sigma.position_m,
            sigma_rotation_rad: sigma.rotation_rad,
        })
    }
}

/// Adds a region, joined with all that it overlaps.
fn join(regions: &mut Vec<Region>, mut region: Region) {
    while let Some((at, joined)) =
        regions.iter().enumerate().find_map(|(i, r)| r.joined(region).map(|j| (i, j)))
    {
        regions.swap_remove(at);
        region = joined;
    }
    regions.push(region);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lens::Lens;
    use crate::model::rig::TagPlacement;
    use glam::DMat3;

    const LENS: Lens = Lens::pinhole(640, 480, 650.0, 650.0, 320.0, 240.0);

    fn rig(side_m: f64) -> Rig {
        let face_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let world_from_tag = Pose::from_matrix(face_up, DVec3::ZERO);
        Rig { lens: LENS, tags: vec![TagPlacement { id: 0, side_m, world_from_tag }], ball: None }
    }

    /// A camera that moves sideways at 0.2 m/s and turns with it.
    fn camera(seconds: f64) -> Pose {
        let eye = DVec3::new(0.2 * seconds - 0.1, -0.6, 0.5);
        Pose::look_at(eye, DVec3::new(0.05 * seconds, 0.0, 0.0), DVec3::Z)
    }

    fn seen(rig: &Rig, pose: &Pose) -> TagDetection {
        let tag = &rig.tags[0];
        let corners_px = corners_of_tag_m(tag.side_m).map(|c| {
            let p = pose.inverse().transform(tag.world_from_tag.transform(c));
            LENS.project(p).expect("in view")
        });
        TagDetection { id: 0, hamming: 0, decision_margin: 90.0, corners_px, corner_sigma_px: 0.03 }
    }

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds)
    }

    /// A state that has followed the camera at 30 Hz up to `until` seconds.
    fn following(rig: &Rig, until: f64) -> TrackState {
        let mut state = TrackState::new(rig.clone(), FollowOptions::default());
        let mut t = 0.0;
        while t <= until + 1e-9 {
            let update = state.update(at(t), &[seen(rig, &camera(t))]);
            assert!(matches!(update, Update::Measured { tags: 1, .. }), "{update:?}");
            t += 1.0 / 30.0;
        }
        state
    }

    #[test]
    fn measured_then_predicted_then_held() {
        let rig = rig(0.08);
        let state = following(&rig, 1.0);
        assert_eq!(TrackState::new(rig, FollowOptions::default()).pose_at(at(0.0)), None);
        let now = state.pose_at(at(1.0)).unwrap();
        assert_eq!(now.provenance, Provenance::Measured);
        assert!(now.world_from_camera.translation.distance(camera(1.0).translation) < 1e-6);
        // A tenth of a second ahead, at 0.2 m/s: held it would be 20 mm off.
        let ahead = state.pose_at(at(1.1)).unwrap();
        assert!(matches!(ahead.provenance, Provenance::Predicted { age_s } if (age_s - 0.1).abs() < 1e-6));
        assert!(ahead.world_from_camera.translation.distance(camera(1.1).translation) < 5e-4);
        assert!(ahead.world_from_camera.angle_to(&camera(1.1)) < 2e-3);
        assert!(ahead.sigma_position_m > now.sigma_position_m);
        // Later it stays where the model had brought it.
        let (later, last) = (state.pose_at(at(1.6)).unwrap(), state.pose_at(at(5.0)).unwrap());
        assert!(matches!(later.provenance, Provenance::Held { age_s } if (age_s - 0.6).abs() < 1e-6));
        assert_eq!(later.world_from_camera, last.world_from_camera);
        assert!(last.sigma_position_m > later.sigma_position_m);
    }

    #[test]
    fn equal_and_backward_times_change_nothing() {
        let rig = rig(0.08);
        let mut state = following(&rig, 0.5);
        let before = state.pose_at(at(0.6)).unwrap();
        let elsewhere = [seen(&rig, &camera(3.0))];
        assert_eq!(state.update(at(0.5), &elsewhere), Update::Stale);
        assert_eq!(state.update(at(0.2), &elsewhere), Update::Stale);
        assert_eq!(state.update(at(0.2), &[]), Update::Stale);
        assert_eq!(state.pose_at(at(0.6)).unwrap(), before);
        // Asked for the past, it gives its measurement with that measurement's time.
        assert_eq!(state.pose_at(at(0.1)).unwrap().t, at(0.5));
    }

    #[test]
    fn pictures_of_nearly_one_time_say_nothing_of_the_speed() {
        let rig = rig(0.08);
        let mut state = following(&rig, 0.5);
        // 2 mm aside within a microsecond: 2 km/s.
        let aside = Pose::new(camera(0.5).rotation, camera(0.5).translation + DVec3::new(0.002, 0.0, 0.0));
        assert!(matches!(state.update(at(0.500_001), &[seen(&rig, &aside)]), Update::Measured { .. }));
        let ahead = state.pose_at(at(0.6)).unwrap().world_from_camera.translation;
        assert!(ahead.distance(camera(0.6).translation) < 4e-3, "{ahead}");
    }

    #[test]
    fn a_long_gap_starts_afresh() {
        let rig = rig(0.08);
        let mut state = following(&rig, 0.5);
        assert!(state.search(at(0.6)).is_some());
        assert_eq!(state.search(at(1.7)), None);
        // The camera has jumped: with the old velocity this would be predicted half a metre off.
        let update = state.update(at(1.7), &[seen(&rig, &camera(-1.0))]);
        assert!(matches!(update, Update::Measured { .. }));
        let ahead = state.pose_at(at(1.75)).unwrap();
        assert!(matches!(ahead.provenance, Provenance::Held { .. }), "no velocity is known yet");
        assert!(ahead.world_from_camera.translation.distance(camera(-1.0).translation) < 1e-6);
    }

    #[test]
    fn regions_hold_the_tag_until_it_is_lost_and_found() {
        let rig = rig(0.08);
        let mut state = TrackState::new(rig.clone(), FollowOptions::default());
        assert_eq!(state.search(at(0.0)), None);
        state = following(&rig, 0.5);
        let tag = seen(&rig, &camera(0.5 + 1.0 / 30.0));
        let holds = |regions: &[Region]| {
            let [r] = regions else { panic!("one tag, {} regions", regions.len()) };
            let (low, high) = ((f64::from(r.x), f64::from(r.y)), (r.x + r.width, r.y + r.height));
            tag.corners_px
                .iter()
                .all(|c| c.x > low.0 && c.y > low.1 && c.x < f64::from(high.0) && c.y < f64::from(high.1))
                && r.width * r.height < 640 * 480 / 4
        };
        assert!(holds(state.search(at(0.5 + 1.0 / 30.0)).unwrap()));
        for miss in 1..=3 {
            let t = at(0.5 + f64::from(miss) / 30.0);
            assert!(state.search(t).is_some(), "miss {miss}");
            assert_eq!(state.update(t, &[]), Update::Missed);
        }
        assert_eq!(state.search(at(0.65)), None);
        assert!(matches!(state.update(at(0.65), &[seen(&rig, &camera(0.65))]), Update::Measured { .. }));
        assert!(state.search(at(0.7)).is_some());
    }

    #[test]
    fn a_wrong_first_choice_is_given_up() {
        // Small and far: both poses fit nearly. The first picture is made to prefer the mirrored one.
        let rig = rig(0.05);
        let pose = |t: f64| {
            let eye = DVec3::new(0.2 * t, -0.9, 0.8);
            Pose::look_at(eye, DVec3::ZERO, DVec3::Z)
        };
        let mut solver = RigPoseSolver::default();
        let first = seen(&rig, &pose(0.0));
        let both = solver.solve(&[first], &rig.tags, &LENS, &Prior::default()).unwrap();
        let wrong = both.other.expect("two minima");
        let mut state = TrackState::new(rig.clone(), FollowOptions::default());
        state.update(at(0.0), &[seen(&rig, &wrong)]);
        let away = |s: &TrackState, t: f64| {
            s.pose_at(at(t)).unwrap().world_from_camera.angle_to(&pose(t)).to_degrees()
        };
        assert!(away(&state, 0.0) > 20.0);
        let mut recovered = None;
        for k in 1..60 {
            let t = f64::from(k) / 30.0;
            state.update(at(t), &[seen(&rig, &pose(t))]);
            if away(&state, t) < 1.0 {
                recovered.get_or_insert(k);
            } else {
                assert!(recovered.is_none(), "lost again at {k}");
            }
        }
        assert!(recovered.is_some());
    }

    #[test]
    fn overlapping_regions_become_one() {
        let square = |x, y| Region { x, y, width: 10, height: 10 };
        let mut regions = Vec::new();
        for r in [square(0, 0), square(40, 0), square(18, 0), square(9, 0)] {
            join(&mut regions, r);
        }
        // The last touches the first and the third; these, joined, still do not reach the second.
        regions.sort_by_key(|r| r.x);
        assert_eq!(regions, [Region { x: 0, y: 0, width: 28, height: 10 }, square(40, 0)]);
    }
}
