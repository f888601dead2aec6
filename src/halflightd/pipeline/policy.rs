//! What is shown and said when something is missing: one table. Never black, and never an exit for anything that can
//! come back.

use super::event::DeviceRole;
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    time::Timestamp,
};

/// A pose that was not measured for longer than this is no longer drawn with: the objects would float.
pub const LONGEST_POSE_AGE_S: f64 = 0.5;
/// An engine that has failed for so long is given up, where another can stand in.
pub const ENGINE_PATIENCE_S: f64 = 1.0;
/// A camera that says nothing for so many of its own periods counts as lost.
pub const SILENT_PERIODS: f64 = 2.5;

/// What can be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Missing {
    /// No picture comes.
    Camera,
    /// No engine merges or draws.
    Engine,
    /// No tag has been seen since the start.
    FirstTag,
    /// The tag was seen, but not for some time.
    Pose,
    /// Light has not been measured since the start. Light that was measured is held, and is not missing.
    Light,
    /// The inertial sensor.
    Imu,
    /// What shows pictures.
    Display,
}

impl Missing {
    /// In the order of the names that `from_name` knows.
    pub const ALL: [Self; 7] =
        [Self::Camera, Self::Engine, Self::FirstTag, Self::Pose, Self::Light, Self::Imu, Self::Display];
}

/// What the viewer gets, the least first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shows {
    /// The last picture (plain gray before the first), with what is said laid over it.
    LastPicture,
    /// The camera's picture without virtual objects.
    CameraAlone,
    /// The camera's picture with virtual objects in it.
    Everything,
}

/// One row: from `after_s` seconds of missing it on, this is shown and said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicyRow {
    /// What is missing.
    pub missing: Missing,
    /// For how long at least, seconds.
    pub after_s: f64,
    /// What is shown then.
    pub shows: Shows,
    /// What is said then.
    pub says: &'static str,
    /// Whether the CPU engine stands in for the one that fails.
    pub stand_in: bool,
}

const fn row(missing: Missing, after_s: f64, shows: Shows, says: &'static str) -> PolicyRow {
    PolicyRow { missing, after_s, shows, says, stand_in: false }
}

/// The table. Of the rows that hold, the one that shows the least counts, and among equals the first.
pub const TABLE: [PolicyRow; 9] = [
    row(Missing::Camera, 0.0, Shows::LastPicture, "the camera is lost: waiting for it"),
    PolicyRow {
        stand_in: true,
        ..row(Missing::Engine, ENGINE_PATIENCE_S, Shows::CameraAlone, "the engine fails: the CPU takes over")
    },
    row(Missing::Engine, 0.0, Shows::CameraAlone, "the engine could not draw"),
    row(Missing::FirstTag, 0.0, Shows::CameraAlone, "no tag found yet"),
    row(Missing::Pose, 0.0, Shows::Everything, "the pose is predicted"),
    row(Missing::Pose, LONGEST_POSE_AGE_S, Shows::CameraAlone, "tag lost"),
    row(Missing::Light, 0.0, Shows::CameraAlone, "light not measured yet"),
    row(Missing::Imu, 0.0, Shows::Everything, "the IMU is lost: poses between tags do without it"),
    row(Missing::Display, 0.0, Shows::Everything, "the display is lost: waiting for it"),
];

/// What counts of the rows that hold: `None` where nothing is missing. `missing` are things with the seconds that they
/// have been missing for.
pub fn judge(missing: impl IntoIterator<Item = (Missing, f64)>) -> Option<&'static PolicyRow> {
    let mut found: Option<(usize, &'static PolicyRow)> = None;
    for (what, age_s) in missing {
        for (place, row) in TABLE.iter().enumerate() {
            // A row with a limit holds beyond it; NaN counts as long ago.
            let holds = row.missing == what && (row.after_s == 0.0 || !(age_s <= row.after_s));
            if holds && found.is_none_or(|(at, best)| (row.shows, place) < (best.shows, at)) {
                found = Some((place, row));
            }
        }
    }
    found.map(|(_, row)| row)
}

/// What a frame's estimates lack, with ages in seconds.
pub fn missing_of_frame(
    pose: Option<&PoseEstimate>,
    light_is_known: bool,
) -> impl Iterator<Item = (Missing, f64)> + use<> {
    let tag = match pose {
        None => Some((Missing::FirstTag, f64::INFINITY)),
        Some(pose) => Some((Missing::Pose, age_s(&pose.provenance))).filter(|(_, age_s)| *age_s > 0.0),
    };
    let light = (!light_is_known).then_some((Missing::Light, f64::INFINITY));
    tag.into_iter().chain(light)
}

/// Seconds since the measurement behind an estimate.
pub fn age_s(provenance: &Provenance) -> f64 {
    match provenance {
        Provenance::Measured | Provenance::Interpolated => 0.0,
        Provenance::Predicted { age_s } | Provenance::Held { age_s } => *age_s,
    }
}

/// Which devices are missing, and since when, on the clock of the loop.
#[derive(Clone, Debug, Default)]
pub struct Absences {
    since: [Option<Timestamp>; DeviceRole::ALL.len()],
    /// When the newest frame came, and the camera's usual period, seconds.
    frame_at: Option<Timestamp>,
    period_s: Option<f64>,
}

impl Absences {
    /// A device is lost; one that is lost already is so since the first time.
    pub fn lose(&mut self, role: DeviceRole, now: Timestamp) {
        self.since[role as usize].get_or_insert(now);
    }

    /// A device is there again. Returns for how long it was missing, seconds.
    pub fn find(&mut self, role: DeviceRole, now: Timestamp) -> Option<f64> {
        if role == DeviceRole::Camera {
            // What it misses until its next frame counts from here.
            self.frame_at = None;
        }
        self.since[role as usize].take().map(|since| now.seconds_since(since))
    }

    /// A frame came: the camera is there, and this is its pace. Returns for how long it was missing.
    pub fn frame_came(&mut self, now: Timestamp) -> Option<f64> {
        if let Some(before) = self.frame_at {
            let apart = now.seconds_since(before);
            // A gap is no period.
            let usual = self.period_s.filter(|usual| apart > SILENT_PERIODS * usual);
            if apart > 0.0 && usual.is_none() {
                self.period_s = Some(self.period_s.map_or(apart, |p| p + 0.1 * (apart - p)));
            }
        }
        let was_lost = self.find(DeviceRole::Camera, now);
        self.frame_at = Some(now);
        was_lost
    }

    /// Takes note of a camera that says nothing at all.
    pub fn look_at_the_clock(&mut self, now: Timestamp) {
        if let Some(silent) = self.silent_at().filter(|silent| now >= *silent) {
            self.lose(DeviceRole::Camera, silent);
        }
    }

    /// When the camera counts as lost if no frame comes before.
    pub fn silent_at(&self) -> Option<Timestamp> {
        let (at, period_s) = (self.frame_at?, self.period_s?);
        Some(at.plus_seconds(SILENT_PERIODS * period_s))
    }

    /// Whether a device is missing.
    pub fn lacks(&self, role: DeviceRole) -> bool {
        self.since[role as usize].is_some()
    }

    /// What is missing now, with ages in seconds.
    pub fn missing(&self, now: Timestamp) -> impl Iterator<Item = (Missing, f64)> {
        let of_roles = [
            (DeviceRole::Camera, Missing::Camera),
            (DeviceRole::Imu, Missing::Imu),
            (DeviceRole::Display, Missing::Display),
        ];
        let since = self.since;
        of_roles.into_iter().filter_map(move |(role, missing)| {
            since[role as usize].map(|since| (missing, now.seconds_since(since)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Clock, clock::ManualClock};
    use crate::math::pose::Pose;

    fn says(missing: &[(Missing, f64)]) -> Option<(Shows, &'static str)> {
        judge(missing.iter().copied()).map(|row| (row.shows, row.says))
    }

    /// Every row by itself, just before and just after it begins to hold, with the time of a manual clock.
    #[test]
    fn each_row_holds_from_its_time_on() {
        for row in TABLE {
            let clock = ManualClock::new(Timestamp::from_seconds(7.0));
            let lost_at = clock.now();
            let at = |clock: &ManualClock| says(&[(row.missing, clock.now().seconds_since(lost_at))]);
            if row.after_s > 0.0 {
                clock.wait_until(lost_at.plus_seconds(row.after_s - 1e-6));
                assert_ne!(at(&clock).map(|(_, says)| says), Some(row.says), "{row:?} too early");
            }
            clock.wait_until(lost_at.plus_seconds(row.after_s + 1e-6));
            assert_eq!(at(&clock), Some((row.shows, row.says)), "{row:?}");
        }
        for missing in Missing::ALL {
            assert!(TABLE.iter().any(|row| row.missing == missing && row.after_s == 0.0), "{missing:?}");
        }
        assert_eq!(says(&[]), None);
    }

    #[test]
    fn what_shows_the_least_counts() {
        use Missing::{Camera, Display, Engine, FirstTag, Imu, Light};
        let camera = Some((Shows::LastPicture, "the camera is lost: waiting for it"));
        assert_eq!(says(&[(Imu, 9.0), (Light, 9.0), (Camera, 0.0), (Engine, 9.0)]), camera);
        let tag = Some((Shows::CameraAlone, "no tag found yet"));
        assert_eq!(says(&[(Light, 9.0), (FirstTag, 9.0), (Display, 9.0)]), tag);
        let imu = Some((Shows::Everything, "the IMU is lost: poses between tags do without it"));
        assert_eq!(says(&[(Display, 1.0), (Imu, 1.0)]), imu);
        let stand_in = |age_s| judge([(Engine, age_s)]).unwrap().stand_in;
        assert!(!stand_in(0.5) && stand_in(1.5));
    }

    #[test]
    fn estimates_say_what_they_lack() {
        let pose = |provenance| PoseEstimate {
            t: Timestamp(0),
            world_from_camera: Pose::IDENTITY,
            provenance,
            sigma_position_m: 0.0,
            sigma_rotation_rad: 0.0,
        };
        let of = |pose: Option<PoseEstimate>, light| {
            judge(missing_of_frame(pose.as_ref(), light)).map(|row| (row.shows, row.says))
        };
        assert_eq!(of(None, true), Some((Shows::CameraAlone, "no tag found yet")));
        assert_eq!(of(Some(pose(Provenance::Measured)), true), None);
        assert_eq!(
            of(Some(pose(Provenance::Measured)), false),
            Some((Shows::CameraAlone, "light not measured yet"))
        );
        let predicted = |age_s| of(Some(pose(Provenance::Predicted { age_s })), true);
        assert_eq!(predicted(0.5), Some((Shows::Everything, "the pose is predicted")));
        assert_eq!(predicted(0.51), Some((Shows::CameraAlone, "tag lost")));
        assert_eq!(predicted(f64::NAN), None, "an age that is none is not above 0");
    }

    #[test]
    fn a_silent_camera_is_lost_within_three_of_its_periods() {
        let (mut absences, period_s) = (Absences::default(), 1.0 / 30.0);
        assert_eq!(absences.silent_at(), None, "nothing is known of its pace yet");
        let at = |k: f64| Timestamp::from_seconds(k * period_s);
        for k in 0..10 {
            assert_eq!(absences.frame_came(at(f64::from(k))), None);
        }
        absences.look_at_the_clock(at(9.0 + 2.4));
        assert!(!absences.lacks(DeviceRole::Camera));
        absences.look_at_the_clock(at(9.0 + 3.0));
        assert!(absences.lacks(DeviceRole::Camera));
        let was_lost = absences.frame_came(at(40.0)).unwrap();
        assert!((was_lost - (40.0 - 9.0 - SILENT_PERIODS) * period_s).abs() < 1e-6, "{was_lost}");
        // The gap has not changed what is known of its pace.
        let silent = absences.silent_at().unwrap();
        assert!((silent.seconds_since(at(40.0)) - SILENT_PERIODS * period_s).abs() < 1e-6);
        assert!(!absences.lacks(DeviceRole::Camera));
    }

    #[test]
    fn devices_are_missing_since_they_were_first_lost() {
        let mut absences = Absences::default();
        let at = Timestamp::from_seconds;
        absences.lose(DeviceRole::Imu, at(1.0));
        absences.lose(DeviceRole::Imu, at(2.0));
        let missing: Vec<_> = absences.missing(at(4.0)).collect();
        assert_eq!(missing, [(Missing::Imu, 3.0)]);
        assert_eq!(absences.find(DeviceRole::Imu, at(5.0)), Some(4.0));
        assert_eq!(absences.find(DeviceRole::Imu, at(6.0)), None);
        // The command line is no part of the picture.
        absences.lose(DeviceRole::Link, at(6.0));
        assert_eq!(absences.missing(at(7.0)).count(), 0);
    }
}
