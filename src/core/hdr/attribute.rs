//! Which exposure did this frame have? Compares what is stated with what the pixels say.

use super::merge_bracket::MAX_PICTURES;
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};
use std::ops::Range;

/// Values from which a ratio is measured: away from saturation, and from black, where stray light and the toe of
/// film (the scans of `brackets/memorial` hold no value below 14) hide the exposure.
const WELL_EXPOSED: std::ops::RangeInclusive<u8> = 40..=235;
/// Pixels of a picture that are looked at, about.
const PIXELS_LOOKED_AT: usize = 20_000;
/// Fewest well-exposed values that two pictures must share.
const FEWEST_SHARED: u32 = 300;
/// The histogram of ln ratios covers -SPAN..SPAN.
const SPAN: f32 = 16.0;
const BINS_PER_UNIT: f32 = 128.0;
const BINS: usize = (2.0 * SPAN * BINS_PER_UNIT) as usize;

/// How far pixels may stray from what is stated, in ln exposure: `absolute + relative x |ln stated ratio|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// In ln exposure.
    pub absolute: f64,
    /// Share of |ln stated ratio|.
    pub relative: f64,
}

impl Tolerance {
    /// For a response that is only a guess: its slope may be wrong by half (1.5 for the camera of the mirror ball
    /// pictures against sRGB), but equal pictures at a ratio of 2 are still told apart.
    pub const GUESSED_RESPONSE: Self = Self { absolute: 0.15, relative: 0.6 };
    /// For a response that was calibrated or solved.
    pub const KNOWN_RESPONSE: Self = Self { absolute: 0.15, relative: 0.1 };

    fn allows(self, stated_log: f64, measured_log: f64) -> bool {
        (measured_log - stated_log).abs() <= self.absolute + self.relative * stated_log.abs()
    }
}

/// What the check found for a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExposureVerdict {
    /// Agrees with the largest group of pictures that agree among themselves.
    Consistent,
    /// Its pixels contradict its stated exposure.
    Contradicted,
    /// It shares too few well-exposed pixels with any other picture.
    #[default]
    Unchecked,
}

/// One picture of a bracket against the picture that it shares most well-exposed pixels with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PictureReport {
    /// Index of that other picture; `None` where there is none.
    pub against: Option<usize>,
    /// Stated exposure of this picture / that of the other.
    pub stated_ratio: f64,
    /// The same from the pixels.
    pub measured_ratio: f64,
    /// The verdict over all other pictures.
    pub verdict: ExposureVerdict,
}

/// Reports of a bracket, one for each picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureCheck {
    reports: [PictureReport; MAX_PICTURES],
    count: usize,
}

impl ExposureCheck {
    /// One for each picture, in order.
    pub fn reports(&self) -> &[PictureReport] {
        &self.reports[..self.count]
    }

    /// Whether no picture contradicts its stated exposure.
    pub fn sound(&self) -> bool {
        self.reports().iter().all(|r| r.verdict != ExposureVerdict::Contradicted)
    }
}

/// A ratio of exposures, measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredRatio {
    /// ln (exposure of a / exposure of b): median of g(z_a) - g(z_b).
    pub log_ratio: f64,
    /// Values (pixels x channels) that it comes from.
    pub shared: u32,
}

/// Exposure of `a` over that of `b` from their pixels: the median of g(z_a) - g(z_b) over about 20,000 pixels on a
/// grid, all channels, where both values are within 40..=235. The median forgives things that moved. Resolution
/// 1/128. `None` where sizes differ or fewer than 300 values are shared. No allocation.
pub fn measured_ratio(a: &Rgb8Image, b: &Rgb8Image, response: &Response) -> Option<MeasuredRatio> {
    measured_ratio_of(a, b, response, 0..3)
}

/// The same over some of the channels.
pub fn measured_ratio_of(
    a: &Rgb8Image,
    b: &Rgb8Image,
    response: &Response,
    channels: Range<usize>,
) -> Option<MeasuredRatio> {
    let (width, height) = (a.width(), a.height());
    if (width, height) != (b.width(), b.height()) {
        return None;
    }
    let step = (((width * height) as f64 / PIXELS_LOOKED_AT as f64).sqrt() as usize).max(1);
    let g = response.log_exposure();
    let mut histogram = [0u32; BINS];
    let mut shared = 0u32;
    for y in (step / 2..height).step_by(step) {
        let (row_a, row_b) = (a.row(y), b.row(y));
        for (pa, pb) in row_a.iter().zip(row_b).skip(step / 2).step_by(step) {
            let values = pa.iter().zip(pb).zip(g).take(channels.end).skip(channels.start);
            for ((za, zb), g) in values {
                if WELL_EXPOSED.contains(za) && WELL_EXPOSED.contains(zb) {
                    let log_ratio = g[usize::from(*za)] - g[usize::from(*zb)];
                    let bin = ((log_ratio + SPAN) * BINS_PER_UNIT).clamp(0.0, BINS as f32 - 1.0);
                    histogram[bin as usize] += 1;
                    shared += 1;
                }
            }
        }
    }
    if shared < FEWEST_SHARED {
        return None;
    }
    // Ties share a bin; the middle one within it, as if they were spread evenly over it.
    let middle = f64::from(shared) / 2.0;
    let mut below = 0.0;
    for (bin, &count) in histogram.iter().enumerate() {
        let count = f64::from(count);
        if below + count >= middle && count > 0.0 {
            // Equal values fall on the lower edge of their bin.
            let within = if count > 0.5 * f64::from(shared) { 0.0 } else { (middle - below) / count };
            let log_ratio = (bin as f64 + within) / f64::from(BINS_PER_UNIT) - f64::from(SPAN);
            return Some(MeasuredRatio { log_ratio, shared });
        }
        below += count;
    }
    None
}

/// Checks each picture's stated exposure against the pixels of the others, pair by pair (g(z_i) - g(z_j) must have
/// the median ln t_i - ln t_j). The largest group of pictures that agree is taken as right; who disagrees with it is
/// `Contradicted`. Where no two agree, or two groups are equally large and disagree, all that disagree are.
/// More than [`MAX_PICTURES`] pictures are not looked at. No allocation.
pub fn check_exposures(
    pictures: &[&Rgb8Image],
    exposures: &[Exposure],
    response: &Response,
    tolerance: Tolerance,
) -> ExposureCheck {
    let count = pictures.len().min(exposures.len()).min(MAX_PICTURES);
    let mut check = ExposureCheck { reports: [PictureReport::default(); MAX_PICTURES], count };
    let mut agree = [[None::<bool>; MAX_PICTURES]; MAX_PICTURES];
    let mut best_shared = [0u32; MAX_PICTURES];
    for i in 0..count {
        for j in 0..i {
            let Some(measured) = measured_ratio(pictures[i], pictures[j], response) else { continue };
            let stated_log = (exposures[i].effective_s() / exposures[j].effective_s()).ln();
            let agrees = Some(tolerance.allows(stated_log, measured.log_ratio));
            (agree[i][j], agree[j][i]) = (agrees, agrees);
            for (this, other, sign) in [(i, j, 1.0), (j, i, -1.0)] {
                if measured.shared > best_shared[this] {
                    best_shared[this] = measured.shared;
                    check.reports[this] = PictureReport {
                        against: Some(other),
                        stated_ratio: (sign * stated_log).exp(),
                        measured_ratio: (sign * measured.log_ratio).exp(),
                        verdict: ExposureVerdict::Unchecked,
                    };
                }
            }
        }
    }
    judge(&agree, count, &mut check.reports);
    check
}

/// Fills in the verdicts from who agrees with whom.
fn judge(
    agree: &[[Option<bool>; MAX_PICTURES]; MAX_PICTURES],
    count: usize,
    reports: &mut [PictureReport; MAX_PICTURES],
) {
    // Groups: pictures joined by pairs that agree carry the smallest index among them.
    let mut group: [usize; MAX_PICTURES] = std::array::from_fn(|i| i);
    for _ in 0..count {
        for i in 0..count {
            for j in 0..count {
                if agree[i][j] == Some(true) {
                    group[i] = group[i].min(group[j]);
                }
            }
        }
    }
    let size = |g: usize| group[..count].iter().filter(|&&other| other == g).count();
    let disagrees =
        |i: usize, with: usize| (0..count).any(|j| group[j] == with && agree[i][j] == Some(false));
    for i in 0..count {
        let own = size(group[i]);
        // Contradicted by a group that is at least as large as one's own.
        let outvoted = (0..count).any(|g| g != group[i] && size(g) >= own && disagrees(i, g));
        // Within a group, chains of small errors may add up; the majority of pairs decides.
        let votes = |wanted: bool| {
            (0..count).filter(|&j| group[j] == group[i] && agree[i][j] == Some(wanted)).count()
        };
        reports[i].verdict = if outvoted || votes(false) > votes(true) {
            ExposureVerdict::Contradicted
        } else if own > 1 {
            ExposureVerdict::Consistent
        } else {
            ExposureVerdict::Unchecked
        };
    }
}

/// Which of `candidates` a frame had, judged by a frame of known exposure: the candidate whose ln exposure is
/// nearest to the measured one, with that measured exposure (seconds at unit gain). `None` without candidates or
/// where the two share too few well-exposed pixels.
pub fn attribute(
    frame: &Rgb8Image,
    reference: &Rgb8Image,
    reference_exposure: Exposure,
    candidates: &[Exposure],
    response: &Response,
) -> Option<(usize, f64)> {
    let measured_s =
        measured_ratio(frame, reference, response)?.log_ratio.exp() * reference_exposure.effective_s();
    let distance = |e: &Exposure| (e.effective_s() / measured_s).ln().abs();
    candidates
        .iter()
        .enumerate()
        .min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))
        .map(|(index, _)| (index, measured_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pictures(times_s: &[f64]) -> Vec<Rgb8Image> {
        let response = Response::srgb();
        let see = |t: f64| {
            let pixels = (0..96 * 64)
                .map(|i| {
                    let radiance = (8.0 * (i as f64 / 6144.0 - 0.5)).exp();
                    std::array::from_fn(|c| response.value_of(c, (radiance * t) as f32).round() as u8)
                })
                .collect();
            Rgb8Image::from_pixels(96, 64, pixels).unwrap()
        };
        times_s.iter().map(|&t| see(t)).collect()
    }

    fn seconds(times_s: &[f64]) -> Vec<Exposure> {
        times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
    }

    fn verdicts(real_s: &[f64], stated_s: &[f64]) -> Vec<ExposureVerdict> {
        let pictures = pictures(real_s);
        let pictures: Vec<_> = pictures.iter().collect();
        let check =
            check_exposures(&pictures, &seconds(stated_s), &Response::srgb(), Tolerance::KNOWN_RESPONSE);
        check.reports().iter().map(|r| r.verdict).collect()
    }

    use ExposureVerdict::{Consistent, Contradicted, Unchecked};

    #[test]
    fn a_ratio_is_measured_to_its_resolution() {
        for ratio in [1.0, 1.3, 4.0, 0.25] {
            let p = pictures(&[0.1 * ratio, 0.1]);
            let got = measured_ratio(&p[0], &p[1], &Response::srgb()).unwrap();
            // A bin is 0.008 wide; rounding to 8 bits does not move a median over a ramp by more.
            assert!((got.log_ratio - ratio.ln()).abs() < 0.01, "{ratio}: {got:?}");
        }
    }

    #[test]
    fn one_dead_frame_is_found_and_the_others_are_left_alone() {
        assert_eq!(verdicts(&[0.1, 0.4, 1.6], &[0.1, 0.4, 1.6]), [Consistent; 3]);
        assert_eq!(verdicts(&[0.1, 0.4, 0.4], &[0.1, 0.4, 1.6]), [Consistent, Consistent, Contradicted]);
        assert_eq!(verdicts(&[0.1, 0.1, 1.6], &[0.1, 0.4, 1.6]), [Consistent, Contradicted, Consistent]);
    }

    #[test]
    fn where_nobody_agrees_all_are_contradicted() {
        assert_eq!(verdicts(&[0.2, 0.2, 0.2], &[0.1, 0.4, 1.6]), [Contradicted; 3]);
        assert_eq!(verdicts(&[0.2, 0.2], &[0.1, 0.4]), [Contradicted; 2]);
        // Two against two.
        assert_eq!(verdicts(&[0.1, 0.2, 0.4, 0.8], &[0.1, 0.2, 0.1, 0.2]), [Contradicted; 4]);
    }

    #[test]
    fn what_shares_no_pixels_is_not_judged() {
        assert_eq!(verdicts(&[0.1, 0.4, 1e6], &[0.1, 0.4, 9.0]), [Consistent, Consistent, Unchecked]);
        assert_eq!(verdicts(&[0.1], &[0.1]), [Unchecked]);
        assert_eq!(verdicts(&[], &[]), []);
    }

    #[test]
    fn reports_name_stated_and_measured_ratios() {
        let p = pictures(&[0.1, 0.1]);
        let check = check_exposures(
            &[&p[0], &p[1]],
            &seconds(&[0.1, 0.4]),
            &Response::srgb(),
            Tolerance::GUESSED_RESPONSE,
        );
        assert!(!check.sound());
        let r = check.reports()[1];
        assert_eq!(r.against, Some(0));
        assert!((r.stated_ratio - 4.0).abs() < 1e-9 && (r.measured_ratio - 1.0).abs() < 0.01, "{r:?}");
    }

    #[test]
    fn a_frame_is_given_its_exposure() {
        let p = pictures(&[0.1, 0.39]);
        let candidates = seconds(&[0.025, 0.1, 0.4, 1.6]);
        let (index, measured_s) =
            attribute(&p[1], &p[0], candidates[1], &candidates, &Response::srgb()).unwrap();
        assert_eq!(index, 2);
        assert!((measured_s / 0.39 - 1.0).abs() < 0.01, "{measured_s}");
        assert!(attribute(&p[1], &p[0], candidates[1], &[], &Response::srgb()).is_none());
    }
}
