//! A lens from views of a flat board whose points are known: Zhang's closed form for a start (Z. Zhang, "A Flexible New Technique
//! for Camera Calibration", PAMI 2000), then all views and the lens at once by least squares.

pub mod corner;
mod fit;
mod start;

use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
};
use fit::BoardFit;
use glam::{DVec2, DVec3};

/// Views that a calibration needs at least.
pub const LEAST_VIEWS: usize = 4;
/// Points that a view needs to count.
pub const LEAST_POINTS: usize = 12;
/// Two of the boards must be turned against each other by so much, degrees: parallel ones leave the focal length open.
pub const LEAST_TILT_DEG: f64 = 10.0;
/// A focal length that is known no better, as a share of itself, is not known.
const WORST_FOCAL_SIGMA: f64 = 0.02;
/// A point that is off by so many times the middle distance is no point of the board.
const OUTLIER_MEDIANS: f64 = 6.0;
/// How often that is asked.
const ROUNDS: usize = 5;
/// What is never taken for an outlier, pixels.
const NO_OUTLIER_PX: f64 = 0.5;
/// Columns and rows of cells by which coverage is counted.
const CELLS: (usize, usize) = (8, 6);

/// A grid of tags as Kalibr lays it out: tag 0 at the lower left, numbers go to the right, then up; equal gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AprilGrid {
    /// Tags of a row.
    pub columns: u32,
    /// Tags of a column.
    pub rows: u32,
    /// Side of a tag's black square, metres.
    pub size_m: f64,
    /// Gap between two tags, as a share of that side.
    pub spacing: f64,
}

impl AprilGrid {
    /// Corners of a tag on the board, metres, x right and y up from the lower left corner of tag 0, in the order of
    /// `track::tag`: lower left, lower right, upper right, upper left. `None` where the board has no such tag.
    pub fn corners(&self, id: u32) -> Option<[DVec2; 4]> {
        if id >= self.columns.checked_mul(self.rows)? {
            return None;
        }
        let pitch = self.size_m * (1.0 + self.spacing);
        let origin = DVec2::new(f64::from(id % self.columns), f64::from(id / self.columns)) * pitch;
        let (x, y) = (DVec2::X * self.size_m, DVec2::Y * self.size_m);
        Some([origin, origin + x, origin + x + y, origin + y])
    }
}

/// A point of the board and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardPoint {
    /// On the board, metres.
    pub on_board: DVec2,
    /// In the picture, continuous pixels.
    pub pixel: DVec2,
}

/// Which distortion is solved for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DistortionKind {
    /// k1 k2 p1 p2 k3.
    #[default]
    RadialTangential,
    /// k1 k2 k3 k4 of a fisheye.
    Equidistant,
}

impl DistortionKind {
    fn none(self) -> Distortion {
        match self {
            Self::RadialTangential => Distortion::RadialTangential([0.0; 8]),
            Self::Equidistant => Distortion::Equidistant([0.0; 4]),
        }
    }
}

/// What came of one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibratedView {
    /// Index among the views that were given.
    pub index: usize,
    /// Root of the mean squared distance between seen and projected points, pixels.
    pub rms_px: f64,
    /// Points that count.
    pub points: usize,
    /// Between the board's normal and the optical axis, degrees.
    pub tilt_deg: f64,
    /// The board's place.
    pub camera_from_board: Pose,
}

/// A lens with how well it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedLens {
    /// Intrinsics and distortion, pixels, of the size of the views.
    pub lens: Lens,
    /// Root of the mean squared distance over all points, pixels.
    pub rms_px: f64,
    /// Standard deviations of fx, fy, cx and cy, pixels.
    pub sigma_px: [f64; 4],
    /// Share of 8 x 6 cells of the picture in which a point was seen.
    pub coverage: f64,
    /// Points that were left out because they fit nothing.
    pub outliers: usize,
    /// The views that count.
    pub views: Vec<CalibratedView>,
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// Too little was seen.
    #[error("{found} views show {LEAST_POINTS} points of the board or more: at least {LEAST_VIEWS} must")]
    TooFewViews {
        /// Those that do.
        found: usize,
    },
    /// The boards are parallel.
    #[error(
        "the views are too much alike: two of their boards must be turned against each other by {LEAST_TILT_DEG} degrees or more, and the \
         most is {most_deg:.1}: tilt the board to all sides"
    )]
    NoTilt {
        /// The largest angle between two boards, degrees.
        most_deg: f64,
    },
    /// The views leave the focal length open.
    #[error(
        "the views leave the focal length open: {focal_px:.1} px, give or take {sigma_px:.1}: take more of them, nearer and more tilted"
    )]
    Open {
        /// What it may be, pixels.
        focal_px: f64,
        /// Its standard deviation, pixels.
        sigma_px: f64,
    },
    /// Nothing fits.
    #[error("no lens explains the views: is the board flat, and are its sizes right?")]
    NoFit,
}

/// Finds the lens of a camera with pictures of this size from views of a board.
///
/// # Errors
/// Too few views, views without tilt, or points that no lens explains.
pub fn calibrate(
    views: &[Vec<BoardPoint>],
    (width, height): (u32, u32),
    kind: DistortionKind,
) -> Result<CalibratedLens, CalibrateError> {
    let is_seen = |view: &&Vec<BoardPoint>| {
        view.len() >= LEAST_POINTS && view.iter().all(|p| p.pixel.is_finite() && p.on_board.is_finite())
    };
    let kept: Vec<usize> = (0..views.len()).filter(|k| is_seen(&&views[*k])).collect();
    if kept.len() < LEAST_VIEWS {
        return Err(CalibrateError::TooFewViews { found: kept.len() });
    }
    let all: Vec<Vec<BoardPoint>> = kept.iter().map(|k| views[*k].clone()).collect();
    let mut points = all.clone();
    let starts = start::focal_lengths(&points, (width, height)).into_iter().filter_map(|focal_px| {
        let (cx, cy) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        let pinhole = Lens::pinhole(width, height, focal_px, focal_px, cx, cy);
        let mut fit = BoardFit::new(Lens { distortion: kind.none(), ..pinhole }, &points)?;
        fit.refine(&points, 12);
        Some(fit)
    });
    let best = starts.min_by(|a, b| a.cost().total_cmp(&b.cost()));
    let mut fit = best.ok_or(CalibrateError::NoFit)?;
    fit.refine(&points, 200);
    let mut outliers = 0;
    // Wrong points pull good ones away, so who is wrong is asked again of all.
    for _ in 0..ROUNDS {
        let kept = without_outliers(&all, &fit);
        if kept == points {
            break;
        }
        outliers = all.iter().zip(&kept).map(|(all, kept)| all.len() - kept.len()).sum();
        points = kept;
        fit.refine(&points, 200);
    }
    finish(&fit, &points, &kept, outliers)
}

/// The points without those that fit nothing. A view keeps at least what it needs.
fn without_outliers(all: &[Vec<BoardPoint>], fit: &BoardFit) -> Vec<Vec<BoardPoint>> {
    let limit_px = (OUTLIER_MEDIANS * fit.median_px(all)).max(NO_OUTLIER_PX);
    let of_view = |(k, view): (usize, &Vec<BoardPoint>)| {
        let is_good = |p: &&BoardPoint| fit.distance_px(k, p) <= limit_px;
        let good: Vec<BoardPoint> = view.iter().filter(is_good).copied().collect();
        if good.len() >= LEAST_POINTS { good } else { view.clone() }
    };
    all.iter().enumerate().map(of_view).collect()
}

fn finish(
    fit: &BoardFit,
    points: &[Vec<BoardPoint>],
    kept: &[usize],
    outliers: usize,
) -> Result<CalibratedLens, CalibrateError> {
    let count: usize = points.iter().map(Vec::len).sum();
    let rms_px = (fit.cost() / count as f64).sqrt();
    // A lens that misses by so much explains nothing.
    if !(rms_px < 0.02 * f64::from(fit.lens.width)) {
        return Err(CalibrateError::NoFit);
    }
    let normal = |pose: &Pose| pose.rotate(DVec3::Z);
    let mut most_deg = 0.0f64;
    for (k, a) in fit.boards.iter().enumerate() {
        for b in &fit.boards[..k] {
            most_deg = most_deg.max(normal(a).angle_between(normal(b)).to_degrees());
        }
    }
    if most_deg < LEAST_TILT_DEG {
        return Err(CalibrateError::NoTilt { most_deg });
    }
    let (focal_px, open) = (fit.lens.fx, f64::INFINITY);
    let sigma_px = fit.sigma(points).ok_or(CalibrateError::Open { focal_px, sigma_px: open })?;
    if !(sigma_px[0] <= WORST_FOCAL_SIGMA * focal_px) {
        return Err(CalibrateError::Open { focal_px, sigma_px: sigma_px[0] });
    }
    let views = points.iter().enumerate().map(|(k, view)| {
        let sum: f64 = view.iter().map(|p| fit.distance_px(k, p).powi(2)).sum();
        let axis = normal(&fit.boards[k]).z.abs().min(1.0);
        CalibratedView {
            index: kept[k],
            rms_px: (sum / view.len() as f64).sqrt(),
            points: view.len(),
            tilt_deg: axis.acos().to_degrees(),
            camera_from_board: fit.boards[k],
        }
    });
    let views = views.collect();
    Ok(CalibratedLens { lens: fit.lens, rms_px, sigma_px, coverage: coverage(fit, points), outliers, views })
}

fn coverage(fit: &BoardFit, points: &[Vec<BoardPoint>]) -> f64 {
    let (columns, rows) = CELLS;
    let mut seen = vec![false; columns * rows];
    for point in points.iter().flatten() {
        let x = (point.pixel.x / f64::from(fit.lens.width) * columns as f64).max(0.0) as usize;
        let y = (point.pixel.y / f64::from(fit.lens.height) * rows as f64).max(0.0) as usize;
        seen[y.min(rows - 1) * columns + x.min(columns - 1)] = true;
    }
    seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64
}

#[cfg(test)]
mod tests;
