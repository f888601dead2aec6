//! The camera's response from its own exposures, found at its start.
//!
//! Attribution compares light, so it needs to know what light each 8-bit value means; most cameras are not sRGB. The search
//! goes up and down from one exposure by factors of two. Each is held until the picture has changed and rests, so nothing needs
//! to be known of the control's delay. `hdr::response` solves the curve [DM97] from one picture of each.

use super::thumbnail::Thumbnail;
use crate::hdr::{
    attribute::{Tolerance, check_exposures},
    response::{LEAST_EXPOSURE_RATIO, ResponseOrigin, SolveOptions, solve},
};
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};

/// Most exposures of a search.
const MOST_HELD: usize = 9;
/// From one exposure to the next.
const STEP: f64 = 2.0;
/// A control that moved by less has come to its end.
const LEAST_STEP: f64 = 1.4;
/// Frames after which the first exposure, which was written before the search began, is in force: controls take up to six.
const FIRST_FRAMES: u32 = 8;
/// Frames that rest before a picture counts.
const RESTING: usize = 3;
/// Frames after which a picture counts although it does not rest (lamps flicker), and after which one that has not
/// changed will not.
const MOST_FRAMES: u32 = 16;
/// Values are equal that differ by less: of noise a mean over a picture has next to nothing.
const EQUAL_VALUES: f64 = 0.7;
const EQUAL_SHARE: f64 = 0.02;
/// A picture tells no more where so much of it is saturated, or so dark.
const MOST_SATURATED: f64 = 0.5;
const MOST_DARK: f64 = 0.8;
const SATURATED: usize = 250;
const DARK: usize = 24;
/// Pixels of a picture that is held, at most: nine whole pictures of high definition would be 56 MB.
const MOST_PIXELS: usize = 640 * 480;
/// Quantiles of a picture that stand for its pixels where those move.
const RANKS: usize = 2048;
/// rms of the fit, ln exposure, from which the scene moved or the control does something else.
const WORST_RESIDUAL: f64 = 0.12;

/// What the search wants next.
#[derive(Clone, Debug, PartialEq)]
pub enum SearchStep {
    /// The next frame.
    Frame,
    /// This exposure written, what the camera made of it told to [`ResponseSearch::written`], and the next frame.
    Write(Exposure),
    /// Nothing more: `finish` can be called.
    Finish,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LadderWay {
    Up,
    Down,
}

struct HeldPicture {
    exposure: Exposure,
    picture: Rgb8Image,
}

/// A search that goes on with each frame.
pub struct ResponseSearch {
    held: Vec<HeldPicture>,
    way: LadderWay,
    /// In force, or soon.
    current: Exposure,
    /// Frames since it was written.
    frames: u32,
    /// Mean value of the picture that was held before.
    before: Option<f64>,
    /// Mean values of the newest frames, newest last.
    recent: [f64; RESTING],
    longest_s: f64,
    shortest_s: f64,
    /// A write that moved the control changed nothing.
    has_dead_control: bool,
}

impl ResponseSearch {
    /// Begins at `start`, which has been written, and keeps to times within these bounds, seconds.
    pub fn new(start: Exposure, shortest_s: f64, longest_s: f64) -> Self {
        Self {
            held: Vec::with_capacity(MOST_HELD),
            way: LadderWay::Up,
            current: start,
            frames: 0,
            before: None,
            recent: [f64::NAN; RESTING],
            longest_s,
            shortest_s,
            has_dead_control: false,
        }
    }

    /// Takes a frame.
    pub fn frame(&mut self, picture: &Rgb8Image, thumbnail: &Thumbnail) -> SearchStep {
        self.frames += 1;
        let seen = PictureSums::of(thumbnail);
        self.recent.rotate_left(1);
        self.recent[RESTING - 1] = seen.mean;
        let rests = self.recent.iter().all(|mean| equal(*mean, seen.mean));
        let waited = self.frames >= MOST_FRAMES;
        let changed = self.before.is_none_or(|before| !equal(before, seen.mean));
        let is_held = match self.before {
            None => self.frames >= FIRST_FRAMES && (rests || waited),
            Some(_) => (rests && changed && self.frames >= RESTING as u32) || waited,
        };
        if !is_held {
            return SearchStep::Frame;
        }
        if !changed {
            // At the ends of the scale there is nothing to change.
            self.has_dead_control |= seen.saturated < MOST_SATURATED && seen.dark < MOST_DARK;
            return self.turn_round(&seen, false);
        }
        self.before = Some(seen.mean);
        self.held.push(HeldPicture { exposure: self.current, picture: every_few(picture) });
        self.turn_round(&seen, true)
    }

    /// Takes a frame that states its exposure: one that has not the exposure of this step yet is passed over.
    pub fn stated_frame(
        &mut self,
        picture: &Rgb8Image,
        thumbnail: &Thumbnail,
        stated: Exposure,
    ) -> SearchStep {
        self.frames += 1;
        if is_far(stated, self.current) && self.frames < MOST_FRAMES {
            return SearchStep::Frame;
        }
        let seen = PictureSums::of(thumbnail);
        // The sensor was asked for more than it can.
        let is_new = self.held.iter().all(|held| is_far(held.exposure, stated));
        if is_new {
            self.held.push(HeldPicture { exposure: stated, picture: every_few(picture) });
        }
        self.turn_round(&seen, is_new)
    }

    /// Tells what the camera made of the exposure that was to be written. A control that has come to its end is turned round.
    pub fn written(&mut self, read_back: Exposure) -> SearchStep {
        self.frames = 0;
        self.recent = [f64::NAN; RESTING];
        if self.held.iter().all(|held| is_far(held.exposure, read_back)) {
            self.current = read_back;
            return SearchStep::Frame;
        }
        let nothing = PictureSums { mean: 0.0, saturated: 1.0, dark: 1.0 };
        self.turn_round(&nothing, false)
    }

    /// Chooses the next exposure; `goes_on` is false where this way has come to its end.
    fn turn_round(&mut self, seen: &PictureSums, goes_on: bool) -> SearchStep {
        if self.held.len() >= MOST_HELD || self.has_dead_control {
            return SearchStep::Finish;
        }
        let times = self.held.iter().map(|held| held.exposure.effective_s());
        let (shortest, longest) = times.fold((f64::INFINITY, 0.0f64), |(s, l), t| (s.min(t), l.max(t)));
        let gain = self.current.gain;
        if self.way == LadderWay::Up {
            let wish_s = STEP * longest / gain;
            if goes_on && seen.saturated < MOST_SATURATED && wish_s <= self.longest_s {
                return SearchStep::Write(Exposure { time_s: wish_s, gain });
            }
            self.way = LadderWay::Down;
        } else if !goes_on || seen.dark >= MOST_DARK {
            return SearchStep::Finish;
        }
        let wish_s = shortest / STEP / gain;
        if wish_s.is_finite() && wish_s >= self.shortest_s {
            SearchStep::Write(Exposure { time_s: wish_s, gain })
        } else {
            SearchStep::Finish
        }
    }

    /// Solves the response; its value 128 means the light that it means in sRGB. An error says why nothing can be known.
    pub fn finish(self) -> Result<Response, String> {
        if self.has_dead_control {
            return Err("its exposure does nothing".to_owned());
        }
        let pictures: Vec<&Rgb8Image> = self.held.iter().map(|held| &held.picture).collect();
        let exposures: Vec<Exposure> = self.held.iter().map(|held| held.exposure).collect();
        if pictures.len() < 2 {
            return Err(format!("its pictures differ at no two exposures {LEAST_EXPOSURE_RATIO} apart"));
        }
        let still = solved(&pictures, &exposures);
        if still.is_ok() {
            return still;
        }
        // The camera or the scene moves: pixels do not stay in their places, but what there is to be seen does.
        let ranked: Vec<Rgb8Image> = pictures.iter().map(|picture| ranked(picture)).collect();
        solved(&ranked.iter().collect::<Vec<_>>(), &exposures).or(still)
    }
}

fn is_far(a: Exposure, b: Exposure) -> bool {
    !((a.effective_s() / b.effective_s()).ln().abs() < LEAST_STEP.ln())
}

fn solved(pictures: &[&Rgb8Image], exposures: &[Exposure]) -> Result<Response, String> {
    let log_exposure_at_128 = Response::srgb().log_exposure().map(|g| f64::from(g[128]));
    let options = SolveOptions { log_exposure_at_128, ..SolveOptions::default() };
    let found = solve(pictures, exposures, &options);
    match found.origin {
        ResponseOrigin::Fallback { why } => return Err(why),
        ResponseOrigin::Solved { residual_rms } if !(residual_rms <= WORST_RESIDUAL) => {
            return Err(format!(
                "the scene or its light moved (residual {residual_rms:.2} in ln exposure, at most {WORST_RESIDUAL} is allowed)"
            ));
        }
        ResponseOrigin::Solved { .. } => {}
    }
    let check = check_exposures(pictures, exposures, &found.response, Tolerance::KNOWN_RESPONSE);
    if check.sound() { Ok(found.response) } else { Err("its exposures are not what it says".to_owned()) }
}

/// Every second, third or so pixel of every such row.
fn every_few(picture: &Rgb8Image) -> Rgb8Image {
    let (width, height) = (picture.width(), picture.height());
    let step = ((width * height) as f64 / MOST_PIXELS as f64).sqrt().ceil().max(1.0) as usize;
    let mut small = Rgb8Image::default();
    small.reshape(width / step, height / step, [0; 3]);
    for y in 0..height / step {
        for x in 0..width / step {
            *small.at_mut(x, y) = *picture.at(x * step, y * step);
        }
    }
    small
}

/// A row in which pixel k has the k-th of [`RANKS`] quantiles of each channel: a brighter exposure keeps the order of values, so
/// equal ranks saw equal light [GN03].
fn ranked(picture: &Rgb8Image) -> Rgb8Image {
    let mut row = Rgb8Image::default();
    row.reshape(RANKS, 1, [0; 3]);
    let pixels = picture.pixels().len().max(1);
    for channel in 0..3 {
        let mut counts = [0usize; 256];
        picture.pixels().iter().for_each(|pixel| counts[usize::from(pixel[channel])] += 1);
        let (mut value, mut below) = (0, counts[0]);
        for (k, pixel) in row.pixels_mut().iter_mut().enumerate() {
            let rank = (2 * k + 1) * pixels / (2 * RANKS);
            while below <= rank && value < 255 {
                value += 1;
                below += counts[value];
            }
            pixel[channel] = value as u8;
        }
    }
    row
}

/// A picture in three numbers.
struct PictureSums {
    /// Of the largest channel.
    mean: f64,
    /// Shares of samples.
    saturated: f64,
    dark: f64,
}

impl PictureSums {
    fn of(thumbnail: &Thumbnail) -> Self {
        let counts = thumbnail.counts();
        let sum = |range: &[u32]| range.iter().map(|n| f64::from(*n)).sum::<f64>();
        let all = sum(counts).max(1.0);
        let weighted: f64 = counts.iter().enumerate().map(|(z, n)| z as f64 * f64::from(*n)).sum();
        Self {
            mean: weighted / all,
            saturated: sum(&counts[SATURATED..]) / all,
            dark: sum(&counts[..=DARK]) / all,
        }
    }
}

fn equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= EQUAL_VALUES + EQUAL_SHARE * a.max(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_pictures_are_held_small() {
        let pixels = (0..1920 * 1080).map(|i| [(i % 1920 / 8) as u8, (i / 1920 / 5) as u8, 7]);
        let small = every_few(&Rgb8Image::from_pixels(1920, 1080, pixels.collect()).unwrap());
        assert_eq!((small.width(), small.height()), (640, 360));
        assert_eq!(*small.at(100, 50), [(300 / 8) as u8, (150 / 5) as u8, 7]);
        let usual = Rgb8Image::filled(640, 480, [9; 3]);
        assert_eq!(every_few(&usual), usual);
        assert_eq!(every_few(&Rgb8Image::default()).pixels().len(), 0);
    }
}
