//! The camera's pose from all known tags of a rig at once.

use super::{
    refine::{PoseSigma, Sighting, chi_square, refine},
    tag::TagDetection,
    tag_pose::{LARGEST_RATIO, Prior, corners_of_tag_m, solve_rectangle},
};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::rig::TagPlacement;

/// What lens, placement and flatness may be wrong by, across one tag, beyond the corners' own noise, pixels;
/// only for choosing.
const MODEL_NOISE_PX: f64 = 0.1;
/// A tag further off (root mean square over its corners' coordinates) speaks of something else: a second print, a
/// wrong placement, pixels.
const OUTLIER_PX: f64 = 3.0;
/// The same while the pose is still that of a single tag, which may be wrong by much elsewhere, pixels.
const FIRST_OUTLIER_PX: f64 = 8.0;
/// Poses that differ by less are one minimum, radians.
const DISTINCT_RAD: f64 = 0.01;

/// The camera in the world, as the tags of one picture tell it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigPose {
    /// Pose of the camera, metres: takes points of its frame to the world.
    pub world_from_camera: Pose,
    /// Root of the mean squared residual, over both coordinates of all corners that entered, pixels.
    pub rms_px: f64,
    /// Standard deviations of the camera's pose.
    pub sigma: PoseSigma,
    /// Tags that entered.
    pub tags: usize,
    /// The other minimum, where there is one.
    pub other: Option<Pose>,
    /// Error of the other over error of this, 0 to 1e6: below 1 where the prior chose against the corners.
    pub ambiguity: f64,
    /// By how many squared standard deviations the corners alone prefer this pose over the other; negative where
    /// the prior chose against them, 0 where there is no other.
    pub evidence: f64,
}

/// Finds a rig's pose; keeps its memory from picture to picture.
#[derive(Clone, Debug, Default)]
pub struct RigPoseSolver {
    /// Four for each known tag that was seen.
    sightings: Vec<Sighting>,
    agreeing: Vec<Sighting>,
    candidates: Vec<(f64, Pose)>,
}

impl RigPoseSolver {
    /// The pose under which the tags of `placements` that were detected agree best with their corners and with
    /// the prior, refined over all that agree. `None` where no known tag was seen, or none that the prior
    /// allows. Property: with one tag it is the pose that `tag_pose::choose` chooses.
    pub fn solve(
        &mut self,
        detections: &[TagDetection],
        placements: &[TagPlacement],
        lens: &Lens,
        prior: &Prior,
    ) -> Option<RigPose> {
        self.gather(detections, placements, lens, prior);
        // The best start, and the best that leads elsewhere.
        let (_, first) = *self.candidates.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let apart = |p: &Pose| p.angle_to(&first) > DISTINCT_RAD;
        let second = self.candidates.iter().filter(|c| apart(&c.1)).min_by(|a, b| a.0.total_cmp(&b.0));
        let second = second.map(|s| s.1);
        let first = self.settle(first, lens, prior)?;
        let second = second
            .and_then(|s| self.settle(s, lens, prior))
            .filter(|s| s.pose.world_from_camera.angle_to(&first.pose.world_from_camera) > DISTINCT_RAD);
        let (chosen, other) = match second {
            Some(second) if second.cost < first.cost => (second, Some(first)),
            _ => (first, second),
        };
        let ratio = other
            .map_or(LARGEST_RATIO, |o| (o.pose.rms_px / chosen.pose.rms_px.max(1e-6)).min(LARGEST_RATIO));
        Some(RigPose {
            other: other.map(|o| o.pose.world_from_camera),
            ambiguity: ratio,
            evidence: other.map_or(0.0, |o| o.corners - chosen.corners),
            ..chosen.pose
        })
    }

    /// All corners of known tags, and each tag's two poses as candidates with their costs.
    fn gather(
        &mut self,
        detections: &[TagDetection],
        placements: &[TagPlacement],
        lens: &Lens,
        prior: &Prior,
    ) {
        self.sightings.clear();
        self.candidates.clear();
        for detection in detections {
            let Some(placement) = placements.iter().find(|p| p.id == detection.id) else { continue };
            let corners_m = corners_of_tag_m(placement.side_m);
            let sigma_px = detection.corner_sigma_px;
            let Some(poses) = solve_rectangle(&corners_m, &detection.corners_px, sigma_px, lens) else {
                continue;
            };
            for pose in std::iter::once(&poses.best).chain(&poses.other) {
                self.candidates.push((0.0, placement.world_from_tag.then(&pose.camera_from_tag.inverse())));
            }
            for (corner, pixel) in corners_m.into_iter().zip(detection.corners_px) {
                let point_object = placement.world_from_tag.transform(corner).into();
                self.sightings.push(Sighting { point_object, pixel: pixel.into(), sigma_px });
            }
        }
        let sightings = &self.sightings;
        for (cost, pose) in &mut self.candidates {
            *cost = corner_cost(sightings, lens, pose) + prior.cost(pose);
        }
        self.candidates.retain(|c| c.0.is_finite());
    }

    /// Refines a candidate over the tags that agree with it: all, if all do once refined.
    fn settle(&mut self, world_from_camera: Pose, lens: &Lens, prior: &Prior) -> Option<SettledPose> {
        let start = world_from_camera.inverse();
        let all = refine(&self.sightings, lens, &start.into());
        let agrees = |tag: &[Sighting], pose: &Pose, limit| tag_rms(tag, lens, pose) < limit;
        let refined = match all {
            Some(all)
                if (self.sightings.chunks_exact(4))
                    .all(|tag| agrees(tag, &all.camera_from_object.into(), OUTLIER_PX)) =>
            {
                all
            }
            _ => {
                let (mut pose, mut refined) = (start, None);
                for limit in [FIRST_OUTLIER_PX, OUTLIER_PX, OUTLIER_PX] {
                    self.agreeing.clear();
                    for tag in self.sightings.chunks_exact(4).filter(|tag| agrees(tag, &pose, limit)) {
                        self.agreeing.extend_from_slice(tag);
                    }
                    let better = refine(&self.agreeing, lens, &pose.into())?;
                    pose = better.camera_from_object.into();
                    refined = Some(better);
                }
                refined?
            }
        };
        let camera_from_world = Pose::from(refined.camera_from_object);
        let world_from_camera = camera_from_world.inverse();
        let corners = corner_cost(&self.sightings, lens, &world_from_camera);
        let cost = corners + prior.cost(&world_from_camera);
        cost.is_finite().then_some(SettledPose {
            cost,
            corners,
            pose: RigPose {
                world_from_camera,
                rms_px: refined.rms_px,
                sigma: refined.sigma()?,
                tags: refined.points / 4,
                other: None,
                ambiguity: LARGEST_RATIO,
                evidence: 0.0,
            },
        })
    }
}

#[derive(Clone, Copy)]
struct SettledPose {
    /// Of corners and prior.
    cost: f64,
    corners: f64,
    pose: RigPose,
}

/// Root mean square of one tag's residuals, pixels; infinite where it cannot be seen.
fn tag_rms(tag: &[Sighting], lens: &Lens, camera_from_world: &Pose) -> f64 {
    chi_square(tag, lens, &(*camera_from_world).into())
        .map_or(f64::INFINITY, |c| (c / 8.0).sqrt() * tag[0].sigma_px)
}

/// Squared standard deviations of one tag's corners, the model's own error included; cut for outliers.
fn tag_cost(tag: &[Sighting], lens: &Lens, camera_from_world: &Pose) -> f64 {
    let variance = tag[0].sigma_px.powi(2) + MODEL_NOISE_PX * MODEL_NOISE_PX;
    8.0 * tag_rms(tag, lens, camera_from_world).min(OUTLIER_PX).powi(2) / variance
}

fn corner_cost(sightings: &[Sighting], lens: &Lens, world_from_camera: &Pose) -> f64 {
    let camera_from_world = world_from_camera.inverse();
    sightings.chunks_exact(4).map(|tag| tag_cost(tag, lens, &camera_from_world)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec2, DVec3};

    const LENS: Lens = Lens::pinhole(640, 480, 520.0, 520.0, 320.0, 240.0);

    /// Tags lying on the table, face up: x right, y towards the viewer (down in the tag's picture), z down.
    fn on_table(id: u32, x: f64, y: f64, side_m: f64) -> TagPlacement {
        let rotation = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        TagPlacement { id, side_m, world_from_tag: Pose::from_matrix(rotation, DVec3::new(x, y, 0.0)) }
    }

    fn seen(placement: &TagPlacement, world_from_camera: &Pose, noise_px: f64) -> TagDetection {
        let camera_from_world = world_from_camera.inverse();
        let mut k = 0.0;
        let corners_px = corners_of_tag_m(placement.side_m).map(|c| {
            k += 1.0;
            let exact = LENS.project(camera_from_world.transform(placement.world_from_tag.transform(c)));
            let noise = DVec2::from_angle(k * 2.4 + f64::from(placement.id)) * noise_px;
            exact.expect("in front") + noise
        });
        TagDetection {
            id: placement.id,
            hamming: 0,
            decision_margin: 100.0,
            corners_px,
            corner_sigma_px: noise_px.max(0.02),
        }
    }

    fn camera() -> Pose {
        Pose::look_at(DVec3::new(0.1, -1.4, 0.9), DVec3::new(0.1, 0.1, 0.0), DVec3::Z)
    }

    #[test]
    fn several_tags_are_better_than_one() {
        let placements =
            [on_table(1, 0.0, 0.0, 0.08), on_table(2, 0.3, 0.1, 0.08), on_table(3, 0.1, 0.3, 0.08)];
        let truth = camera();
        let detections = placements.map(|p| seen(&p, &truth, 0.15));
        let mut solver = RigPoseSolver::default();
        let prior = Prior { above_plane: true, predicted: None };
        let all = solver.solve(&detections, &placements, &LENS, &prior).unwrap();
        let one = solver.solve(&detections[..1], &placements, &LENS, &prior).unwrap();
        assert_eq!((all.tags, one.tags), (3, 1));
        let away = |p: &RigPose| p.world_from_camera.translation.distance(truth.translation);
        assert!(away(&all) < 0.01, "{}", away(&all));
        assert!(all.sigma.position_m < one.sigma.position_m / 3.0);
        // Three tags in one plane leave no second pose, or one that is far worse.
        assert!(all.ambiguity > 10.0, "{}", all.ambiguity);
    }

    #[test]
    fn a_second_print_elsewhere_is_left_out() {
        let placements =
            [on_table(1, 0.0, 0.0, 0.08), on_table(2, 0.3, 0.1, 0.08), on_table(3, 0.1, 0.3, 0.08)];
        let truth = camera();
        let mut detections = placements.map(|p| seen(&p, &truth, 0.0)).to_vec();
        detections.push(seen(&on_table(2, -0.3, 0.3, 0.08), &truth, 0.0));
        detections.push(seen(&on_table(9, -0.3, 0.0, 0.08), &truth, 0.0));
        let got = RigPoseSolver::default().solve(&detections, &placements, &LENS, &Prior::default()).unwrap();
        assert_eq!(got.tags, 3);
        assert!(got.world_from_camera.translation.distance(truth.translation) < 1e-6);
    }

    #[test]
    fn an_ambiguous_tag_follows_the_prediction() {
        // Small and far: the corners' noise decides for either pose, so the prediction must.
        let placements = [on_table(1, 0.0, 0.0, 0.03)];
        let truth = Pose::look_at(DVec3::new(0.3, -1.6, 1.4), DVec3::ZERO, DVec3::Z);
        let sigma = PoseSigma { position_m: 0.05, rotation_rad: 0.05 };
        let mut turned = 0;
        for k in 0..12 {
            let mut detection = seen(&placements[0], &truth, 0.0);
            for (i, c) in detection.corners_px.iter_mut().enumerate() {
                *c += DVec2::from_angle(f64::from(k) * 1.7 + i as f64 * 2.9) * 0.3;
            }
            detection.corner_sigma_px = 0.3;
            let mut solver = RigPoseSolver::default();
            let near = |p: &RigPose| p.world_from_camera.translation.distance(truth.translation) < 0.5;
            let blind = solver.solve(&[detection], &placements, &LENS, &Prior::default()).unwrap();
            turned += usize::from(!near(&blind));
            let prior = Prior { predicted: Some((truth, sigma)), above_plane: true };
            let guided = solver.solve(&[detection], &placements, &LENS, &prior).unwrap();
            assert!(near(&guided), "case {k}: {guided:?}");
        }
        assert!(turned > 0, "no case was ambiguous");
    }

    #[test]
    fn the_plane_forbids_a_camera_below_it() {
        // The tag hangs face down: seen from below, whatever its two poses say.
        let below =
            TagPlacement { id: 1, side_m: 0.08, world_from_tag: Pose::new(DQuat::IDENTITY, DVec3::ZERO) };
        let truth = Pose::look_at(DVec3::new(0.1, -0.3, -0.5), DVec3::ZERO, DVec3::Z);
        let detection = seen(&below, &truth, 0.0);
        let mut solver = RigPoseSolver::default();
        assert!(solver.solve(&[detection], &[below], &LENS, &Prior::default()).is_some());
        let prior = Prior { above_plane: true, predicted: None };
        assert_eq!(solver.solve(&[detection], &[below], &LENS, &prior), None);
        assert_eq!(solver.solve(&[], &[below], &LENS, &Prior::default()), None);
    }
}
