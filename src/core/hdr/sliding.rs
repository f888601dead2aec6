//! A new HDR picture with each frame, not with each bracket.

use super::{
    linear_light::LinearLight,
    merge_bracket::{MAX_PICTURES, MergeError, merge_bracket, merge_sensor},
    register::{BoundFill, SATURATED, Warp},
};
use crate::{
    math::{lens::Lens, pose::Pose},
    model::{
        frame::{Exposure, RawFrame},
        image::{HdrImage, Rgb8Image},
        response::Response,
        rig::MirrorBall,
        sensor::SensorImage,
    },
};
use std::sync::Arc;

/// Exposures nearer to each other than this share count as the same.
const SAME_EXPOSURE: f64 = 0.02;

/// Why a frame was not taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlidingError {
    /// The lens says how large pictures are.
    #[error("frame {sequence} has {} x {} pixels: the lens is calibrated for {} x {}", frame.0, frame.1, lens.0, lens.1)]
    Size {
        /// The frame's number.
        sequence: u64,
        /// Its width and height.
        frame: (usize, usize),
        /// The lens's width and height.
        lens: (u32, u32),
    },
    /// An exposure that no camera can have.
    #[error("frame {sequence} has an exposure of {effective_s} s (time x gain): must be finite and above 0")]
    Exposure {
        /// The frame's number.
        sequence: u64,
        /// Time times gain.
        effective_s: f64,
    },
}

/// One frame of the ring.
#[derive(Debug)]
struct RingFrame {
    pixels: Arc<Rgb8Image>,
    sensor: Option<Arc<SensorImage>>,
    exposure: Exposure,
    world_from_camera: Option<Pose>,
    /// Number of the push that brought it.
    pushed: u64,
    /// The picture as the newest camera would have seen it, with a clean end of the scale, where `is_redrawn`.
    redrawn: Redrawn,
    is_redrawn: bool,
}

/// Memory for one frame as the newest camera would have seen it.
#[derive(Debug, Default)]
struct Redrawn {
    coded: Rgb8Image,
    sensor: SensorImage,
}

/// The last frames of different exposures, seen from the newest frame's pose.
///
/// Holds at most `brackets` frames, newest first, each with its own exposure: a frame of the same exposure as a newer
/// one is dropped, and so is one that is older than two rounds of the bracket. No allocation once every slot has been
/// used; the result does not depend on the number of threads.
#[derive(Debug)]
pub struct SlidingMerge {
    brackets: usize,
    warp: Warp,
    /// Newest first.
    slots: Vec<RingFrame>,
    /// Buffers of dropped slots, to be used again.
    spare: Vec<Redrawn>,
    pushes: u64,
    /// Stands in unused places.
    empty: Rgb8Image,
}

/// The ring's pictures as their sensor gave them, as the newest camera would have seen them, newest first.
#[derive(Clone, Copy, Debug)]
pub struct RegisteredSensor<'a> {
    pictures: [&'a SensorImage; MAX_PICTURES],
    exposures: [Exposure; MAX_PICTURES],
    count: usize,
}

impl<'a> RegisteredSensor<'a> {
    /// The pictures, newest first; all of one size.
    pub fn pictures(&self) -> &[&'a SensorImage] {
        &self.pictures[..self.count]
    }

    /// One for each picture.
    pub fn exposures(&self) -> &[Exposure] {
        &self.exposures[..self.count]
    }
}

/// The ring's pictures as the newest camera would have seen them, newest first.
#[derive(Clone, Copy, Debug)]
pub struct Registered<'a> {
    pictures: [&'a Rgb8Image; MAX_PICTURES],
    exposures: [Exposure; MAX_PICTURES],
    count: usize,
}

impl<'a> Registered<'a> {
    /// The pictures, newest first; all of one size.
    pub fn pictures(&self) -> &[&'a Rgb8Image] {
        &self.pictures[..self.count]
    }

    /// One for each picture.
    pub fn exposures(&self) -> &[Exposure] {
        &self.exposures[..self.count]
    }
}

impl SlidingMerge {
    /// A ring of `brackets` frames (1 to 9; what lies outside is taken as the nearer end) of a camera with this
    /// lens. The ball, where there is one, is warped through its reflection.
    pub fn new(brackets: usize, lens: &Lens, ball: Option<MirrorBall>) -> Self {
        let brackets = brackets.clamp(1, 9);
        Self {
            brackets,
            warp: Warp::new(lens, ball),
            slots: Vec::with_capacity(brackets + 1),
            spare: Vec::with_capacity(brackets + 1),
            pushes: 0,
            empty: Rgb8Image::default(),
        }
    }

    /// Merges so many frames from the next one on (1 to 9; what lies outside is taken as the nearer end).
    pub fn keep(&mut self, brackets: usize) {
        self.brackets = brackets.clamp(1, 9);
    }

    /// Forgets all frames.
    pub fn clear(&mut self) {
        self.spare.extend(self.slots.drain(..).map(|slot| slot.redrawn));
    }

    /// Takes the newest frame; its pixels are shared, not copied. Without a pose it is never warped.
    pub fn push(&mut self, frame: &RawFrame, world_from_camera: Option<Pose>) -> Result<(), SlidingError> {
        let size = (frame.pixels.width(), frame.pixels.height());
        let lens = self.warp.size();
        if size != (lens.0 as usize, lens.1 as usize) {
            return Err(SlidingError::Size { sequence: frame.sequence, frame: size, lens });
        }
        let effective_s = frame.exposure.effective_s();
        if !(effective_s.is_finite() && effective_s > 0.0) {
            return Err(SlidingError::Exposure { sequence: frame.sequence, effective_s });
        }
        self.pushes += 1;
        let oldest = self.pushes.saturating_sub(2 * self.brackets as u64);
        let mut kept = 0;
        for k in 0..self.slots.len() {
            let slot = &self.slots[k];
            let ratio = slot.exposure.effective_s() / effective_s;
            if (ratio - 1.0).abs() > SAME_EXPOSURE && slot.pushed > oldest && kept + 1 < self.brackets {
                self.slots.swap(kept, k);
                kept += 1;
            }
        }
        self.spare.extend(self.slots.drain(kept..).map(|slot| slot.redrawn));
        let slot = RingFrame {
            pixels: Arc::clone(&frame.pixels),
            // A picture of another size is none of this frame's.
            sensor: frame.sensor.as_ref().filter(|sensor| sensor.size() == size).map(Arc::clone),
            exposure: frame.exposure,
            world_from_camera,
            pushed: self.pushes,
            redrawn: self.spare.pop().unwrap_or_default(),
            is_redrawn: false,
        };
        self.slots.insert(0, slot);
        Ok(())
    }

    /// The ring as the newest camera would have seen it; `response` tells what to put where an older frame saw
    /// nothing. Empty before the first frame. A frame without a pose, or from where the newest one stands, is
    /// given as it is, but for values at the end of the scale, which become 255 where a shorter exposure is at hand.
    pub fn registered(&mut self, response: &Response) -> Registered<'_> {
        if let Some((newest, older)) = self.slots.split_first_mut() {
            newest.is_redrawn = false;
            let light = LinearLight::new(response);
            for slot in older {
                let poses = newest.world_from_camera.zip(slot.world_from_camera);
                slot.is_redrawn = poses.is_some_and(|(newest, older)| self.warp.aim(&newest, &older));
                if slot.is_redrawn {
                    let fill = BoundFill::new(response, newest.exposure, slot.exposure);
                    self.warp.apply(&slot.pixels, &newest.pixels, (&fill, &light), &mut slot.redrawn.coded);
                }
            }
        }
        self.clear_saturated_ends();
        let count = self.slots.len();
        let Some(first) = self.slots.first() else {
            return Registered {
                pictures: [&self.empty; MAX_PICTURES],
                exposures: [Exposure { time_s: 1.0, gain: 1.0 }; MAX_PICTURES],
                count,
            };
        };
        let mut registered = Registered {
            pictures: [&*first.pixels; MAX_PICTURES],
            exposures: [first.exposure; MAX_PICTURES],
            count,
        };
        for (k, slot) in self.slots.iter().enumerate() {
            registered.pictures[k] = if slot.is_redrawn { &slot.redrawn.coded } else { &*slot.pixels };
            registered.exposures[k] = slot.exposure;
        }
        registered
    }

    /// As [`SlidingMerge::registered`], at the sensor's own fineness; `None` unless every frame in the ring came with it. What an
    /// older frame did not see is unseen there.
    pub fn registered_sensor(&mut self) -> Option<RegisteredSensor<'_>> {
        if self.slots.iter().any(|slot| slot.sensor.is_none()) {
            return None;
        }
        if let Some((newest, older)) = self.slots.split_first_mut() {
            newest.is_redrawn = false;
            for slot in older {
                let poses = newest.world_from_camera.zip(slot.world_from_camera);
                slot.is_redrawn = poses.is_some_and(|(newest, older)| self.warp.aim(&newest, &older));
                if let (true, Some(sensor)) = (slot.is_redrawn, &slot.sensor) {
                    self.warp.apply_to_sensor(sensor, &mut slot.redrawn.sensor);
                }
            }
        }
        let first = self.slots.first()?;
        let mut registered = RegisteredSensor {
            pictures: [first.sensor.as_deref()?; MAX_PICTURES],
            exposures: [first.exposure; MAX_PICTURES],
            count: self.slots.len(),
        };
        for (k, slot) in self.slots.iter().enumerate() {
            let redrawn = slot.is_redrawn.then_some(&slot.redrawn.sensor);
            registered.pictures[k] = redrawn.or(slot.sensor.as_deref())?;
            registered.exposures[k] = slot.exposure;
        }
        Some(registered)
    }

    /// In pictures that were not warped, and of which the ring holds a shorter exposure, sets the values at the end of
    /// the scale to 255 (warping does so by itself): noise and compression let a saturated pixel come out as 253 or
    /// 254, and with its small weight it would still pull a lamp's radiance down, which may be many times larger.
    fn clear_saturated_ends(&mut self) {
        let shortest = self.slots.iter().map(|s| s.exposure.effective_s()).fold(f64::INFINITY, f64::min);
        for slot in self.slots.iter_mut().filter(|slot| !slot.is_redrawn) {
            if slot.exposure.effective_s() <= shortest {
                continue;
            }
            let (width, height) = (slot.pixels.width(), slot.pixels.height());
            slot.redrawn.coded.reshape(width, height, [0; 3]);
            let values = slot.pixels.pixels().as_flattened();
            for (out, z) in slot.redrawn.coded.pixels_mut().as_flattened_mut().iter_mut().zip(values) {
                *out = if *z >= SATURATED { 255 } else { *z };
            }
            slot.is_redrawn = true;
        }
    }

    /// Registers and merges what the ring holds: as the sensor gave it ([`merge_sensor`]) where it did, else by
    /// [`merge_bracket`].
    pub fn merge(&mut self, response: &Response, out: &mut HdrImage) -> Result<(), MergeError> {
        if let Some(registered) = self.registered_sensor() {
            return merge_sensor(registered.pictures(), registered.exposures(), out);
        }
        let registered = self.registered(response);
        merge_bracket(registered.pictures(), registered.exposures(), response, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::time::Timestamp;
    use glam::DVec3;

    fn frame(sequence: u64, time_s: f64, z: u8) -> RawFrame {
        RawFrame {
            sequence,
            t_mid: Timestamp(0),
            exposure: Exposure { time_s, gain: 1.0 },
            pixels: Arc::new(Rgb8Image::filled(64, 48, [z; 3])),
            sensor: None,
            row_time_s: 0.0,
            response: None,
        }
    }

    fn ring(brackets: usize) -> SlidingMerge {
        SlidingMerge::new(brackets, &Lens::pinhole(64, 48, 80.0, 80.0, 32.0, 24.0), None)
    }

    fn held(ring: &mut SlidingMerge) -> Vec<(f64, u8)> {
        let registered = ring.registered(&Response::srgb());
        let values = registered.pictures().iter().map(|p| p.at(0, 0)[0]);
        registered.exposures().iter().map(|e| e.time_s).zip(values).collect()
    }

    #[test]
    fn each_frame_brings_a_new_bracket() {
        let mut ring = ring(3);
        assert!(held(&mut ring).is_empty());
        for (k, (time_s, z)) in
            [(0.1, 10), (0.4, 20), (1.6, 30), (0.1, 40), (0.4, 50)].into_iter().enumerate()
        {
            ring.push(&frame(k as u64, time_s, z), None).unwrap();
        }
        assert_eq!(held(&mut ring), [(0.4, 50), (0.1, 40), (1.6, 30)]);
        // A fourth exposure puts out the oldest.
        ring.push(&frame(5, 6.4, 60), None).unwrap();
        assert_eq!(held(&mut ring), [(6.4, 60), (0.4, 50), (0.1, 40)]);
        ring.clear();
        assert!(held(&mut ring).is_empty());
    }

    #[test]
    fn exposures_that_are_no_longer_made_are_let_go() {
        let mut ring = ring(3);
        for (k, time_s) in [0.1, 0.4, 1.6].into_iter().enumerate() {
            ring.push(&frame(k as u64, time_s, 9), None).unwrap();
        }
        for k in 3..9 {
            ring.push(&frame(k, 0.4, k as u8), None).unwrap();
        }
        assert_eq!(held(&mut ring), [(0.4, 8)]);
    }

    #[test]
    fn a_frame_of_the_same_exposure_is_replaced_also_by_a_slightly_different_one() {
        let mut ring = ring(3);
        ring.push(&frame(0, 0.1, 1), None).unwrap();
        ring.push(&frame(1, 0.1001, 2), None).unwrap();
        assert_eq!(held(&mut ring), [(0.1001, 2)]);
    }

    #[test]
    fn the_end_of_the_scale_is_cleaned_where_a_shorter_exposure_is_at_hand() {
        let mut ring = ring(3);
        ring.push(&frame(0, 0.4, 253), None).unwrap();
        assert_eq!(held(&mut ring), [(0.4, 253)]);
        ring.push(&frame(1, 0.1, 254), None).unwrap();
        assert_eq!(held(&mut ring), [(0.1, 254), (0.4, 255)]);
        ring.push(&frame(2, 0.4, 252), None).unwrap();
        assert_eq!(held(&mut ring), [(0.4, 252), (0.1, 254)]);
    }

    #[test]
    fn frames_that_do_not_fit_are_refused() {
        let mut ring = ring(3);
        let mut wrong = frame(7, 0.1, 1);
        wrong.pixels = Arc::new(Rgb8Image::filled(10, 48, [0; 3]));
        let error = ring.push(&wrong, None).unwrap_err().to_string();
        assert_eq!(error, "frame 7 has 10 x 48 pixels: the lens is calibrated for 64 x 48");
        for time_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(ring.push(&frame(1, time_s, 1), None), Err(SlidingError::Exposure { .. })));
        }
        assert!(ring.merge(&Response::srgb(), &mut HdrImage::default()).is_err(), "nothing to merge yet");
    }

    #[test]
    fn buffers_are_used_again() {
        let mut ring = ring(2);
        let pose = |k: u64| {
            Pose::look_at(
                DVec3::new(0.01 * k as f64, -0.5, 0.4),
                DVec3::new(0.01 * k as f64, 0.0, 0.0),
                DVec3::Z,
            )
        };
        let mut seen = std::collections::BTreeSet::new();
        for k in 0..12 {
            ring.push(&frame(k, if k % 2 == 0 { 0.1 } else { 0.4 }, 90), Some(pose(k))).unwrap();
            let registered = ring.registered(&Response::srgb());
            assert_eq!(registered.pictures().len(), if k == 0 { 1 } else { 2 });
            if let Some(older) = registered.pictures().get(1) {
                assert!(older.pixels().contains(&[90; 3]), "{:?}", older.at(32, 24));
                seen.insert(older.pixels().as_ptr());
            }
        }
        // The ring's two slots and one in flight.
        assert!(seen.len() <= 3, "{}", seen.len());
    }
}
