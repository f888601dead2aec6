//! tmp
use crate::device::{DeviceError, ErrorKind};
use crate::model::{estimate::*, frame::RawFrame, image::Image, rig::Rig};
use crate::track::{rig_pose::RigPoseSolver, tag::*, tag_pose::Prior};
/// tmp
pub struct Tracker {
    rig: Rig,
    solver: RigPoseSolver,
    options: TagOptions,
    gray: Image<u8>,
    out: Vec<TagDetection>,
    last: Option<PoseEstimate>,
}
impl Tracker {
    /// tmp
    pub fn start(rig: &Rig, _d: f32, _q: f32) -> Result<Self, DeviceError> {
        Ok(Self {
            rig: rig.clone(),
            solver: RigPoseSolver::default(),
            options: TagOptions::default(),
            gray: Image::default(),
            out: Vec::new(),
            last: None,
        })
    }
    /// tmp
    pub fn track(&mut self, frame: &RawFrame) -> Result<Option<PoseEstimate>, DeviceError> {
        let mut d = TagDetector::new(self.options.clone())
            .map_err(|e| DeviceError::new("tag", e.to_string(), ErrorKind::Refused))?;
        gray_of(&frame.pixels, &mut self.gray);
        d.detect(&self.gray, None, &mut self.out)
            .map_err(|e| DeviceError::new("tag", e.to_string(), ErrorKind::Refused))?;
        let prior = Prior { above_plane: true, predicted: None, ..Default::default() };
        let p = self.solver.solve(&self.out, &self.rig.tags, &self.rig.lens, &prior);
        if let Some(p) = p {
            self.last = Some(PoseEstimate {
                t: frame.t_mid,
                world_from_camera: p.world_from_camera,
                provenance: Provenance::Measured,
                sigma_position_m: 0.0,
                sigma_rotation_rad: 0.0,
            });
        } else if let Some(l) = &mut self.last {
            l.provenance = Provenance::Held { age_s: frame.t_mid.seconds_since(l.t) };
        }
        Ok(self.last)
    }
}
