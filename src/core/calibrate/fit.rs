//! The lens and all boards at once by Levenberg's and Marquardt's method. Each board's six unknowns meet only the lens', so they
//! are taken out of the equations board by board (Schur's complement), and nine remain.

use super::{BoardPoint, start};
use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
    solve::solve_positive,
};
use glam::{DQuat, DVec2, DVec3};

/// Unknowns of a lens: fx fy cx cy and five of distortion (a fisheye has four: the fifth stays).
const OF_LENS: usize = 9;
/// Unknowns of a board: turn and shift in the camera's frame.
const OF_BOARD: usize = 6;
/// Places of k1 k2 p1 p2 k3 in a lens.
const RADIAL: [usize; 5] = [0, 1, 2, 3, 4];
/// Of a central difference: distortion is linear in its coefficients, points of the unit plane are of the order of one.
const STEP: f64 = 1e-6;
/// What a point costs that the lens cannot see, pixels squared: far more than any that it sees.
const UNSEEN_COST: f64 = 1e6;
/// Improvement below which nothing is to be gained.
const ENOUGH: f64 = 1e-8;

type LensRow = [f64; OF_LENS];

/// A lens and the places of its boards.
#[derive(Clone, Debug)]
pub struct BoardFit {
    pub lens: Lens,
    pub boards: Vec<Pose>,
    cost: f64,
}

/// J^T J and J^T r of one board.
struct BoardTerms {
    lens_board: [[f64; OF_BOARD]; OF_LENS],
    board: [[f64; OF_BOARD]; OF_BOARD],
    right: [f64; OF_BOARD],
}

/// J^T J and J^T r of all.
struct Terms {
    lens: [LensRow; OF_LENS],
    right: LensRow,
    boards: Vec<BoardTerms>,
}

impl BoardFit {
    /// Begins with a lens; `None` where a board cannot be placed before it.
    pub fn new(lens: Lens, views: &[Vec<BoardPoint>]) -> Option<Self> {
        let boards = views.iter().map(|view| start::board_pose(&lens, view)).collect::<Option<Vec<_>>>()?;
        let mut fit = Self { lens, boards, cost: f64::INFINITY };
        fit.cost = fit.cost_of(views);
        Some(fit)
    }

    /// Sum of squared distances, pixels squared.
    pub fn cost(&self) -> f64 {
        self.cost
    }

    /// How far off a point of a view is, pixels.
    pub fn distance_px(&self, view: usize, point: &BoardPoint) -> f64 {
        let seen = self.lens.project(self.boards[view].transform(point.on_board.extend(0.0)));
        seen.map_or(UNSEEN_COST.sqrt(), |seen| seen.distance(point.pixel))
    }

    /// The middle distance over all points, pixels.
    pub fn median_px(&self, views: &[Vec<BoardPoint>]) -> f64 {
        let of_view = |(k, view): (usize, &Vec<BoardPoint>)| {
            view.iter().map(|p| self.distance_px(k, p)).collect::<Vec<f64>>()
        };
        let mut all: Vec<f64> = views.iter().enumerate().flat_map(of_view).collect();
        let middle = all.len() / 2;
        all.sort_by(f64::total_cmp);
        all.get(middle).copied().unwrap_or(0.0)
    }

    /// Goes downhill for at most so many steps.
    pub fn refine(&mut self, views: &[Vec<BoardPoint>], most_steps: usize) {
        self.cost = self.cost_of(views);
        let mut damping = 1e-3;
        let mut terms = self.terms(views);
        for _ in 0..most_steps {
            let next =
                terms.step(damping).map(|(of_lens, of_boards)| self.moved(&of_lens, &of_boards, views));
            match next.filter(|next| next.cost < self.cost) {
                Some(next) => {
                    let gain = (self.cost - next.cost) / self.cost;
                    *self = next;
                    damping = (damping * 0.2).max(1e-12);
                    if gain < ENOUGH {
                        return;
                    }
                    terms = self.terms(views);
                }
                None => {
                    damping *= 8.0;
                    if damping > 1e8 {
                        return;
                    }
                }
            }
        }
    }

    /// Standard deviations of fx, fy, cx, cy from what is left unexplained; `None` where they are not fixed.
    pub fn sigma(&self, views: &[Vec<BoardPoint>]) -> Option<[f64; 4]> {
        let points: usize = views.iter().map(Vec::len).sum();
        let unknowns = OF_LENS + OF_BOARD * self.boards.len();
        let freedom = (2 * points).checked_sub(unknowns).filter(|left| *left > 0)? as f64;
        let variance = self.cost / freedom;
        let (reduced, _) = self.terms(views).reduced(0.0)?;
        let mut sigma = [0.0; 4];
        for (k, sigma) in sigma.iter_mut().enumerate() {
            let mut unit = [0.0; OF_LENS];
            unit[k] = 1.0;
            *sigma = (solve_positive(&reduced, unit)?[k] * variance).sqrt();
        }
        Some(sigma)
    }

    fn cost_of(&self, views: &[Vec<BoardPoint>]) -> f64 {
        let of_view = |(k, view): (usize, &Vec<BoardPoint>)| {
            view.iter().map(|p| self.distance_px(k, p).powi(2)).sum::<f64>()
        };
        views.iter().enumerate().map(of_view).sum()
    }

    fn moved(&self, of_lens: &LensRow, of_boards: &[[f64; OF_BOARD]], views: &[Vec<BoardPoint>]) -> Self {
        let boards = self.boards.iter().zip(of_boards).map(|(board, m)| {
            let turn = DQuat::from_scaled_axis(DVec3::new(m[0], m[1], m[2]));
            let shift = DVec3::new(m[3], m[4], m[5]);
            Pose::new((turn * board.rotation).normalize(), board.translation + shift)
        });
        let mut fit = Self { lens: moved_lens(&self.lens, of_lens), boards: boards.collect(), cost: 0.0 };
        let is_lens = fit.lens.fx > 0.0 && fit.lens.fy > 0.0;
        fit.cost = if is_lens { fit.cost_of(views) } else { f64::INFINITY };
        fit
    }

    fn terms(&self, views: &[Vec<BoardPoint>]) -> Terms {
        let mut terms = Terms { lens: [[0.0; OF_LENS]; OF_LENS], right: [0.0; OF_LENS], boards: Vec::new() };
        for (board, view) in self.boards.iter().zip(views) {
            let mut of_board = BoardTerms {
                lens_board: [[0.0; OF_BOARD]; OF_LENS],
                board: [[0.0; OF_BOARD]; OF_BOARD],
                right: [0.0; OF_BOARD],
            };
            for point in view {
                let turned = board.rotate(point.on_board.extend(0.0));
                let Some(rows) = self.rows(turned, board.translation) else { continue };
                let residual = point.pixel - rows.seen;
                for (axis, residual) in residual.to_array().into_iter().enumerate() {
                    terms.add(&mut of_board, &rows.lens[axis], &rows.board[axis], residual);
                }
            }
            terms.boards.push(of_board);
        }
        if matches!(self.lens.distortion, Distortion::Equidistant(_)) {
            terms.lens[OF_LENS - 1][OF_LENS - 1] = 1.0;
        }
        terms
    }

    /// Derivatives of a point's pixel. `None` where the lens does not see it.
    fn rows(&self, turned: DVec3, translation: DVec3) -> Option<PointRows> {
        let lens = &self.lens;
        let at = turned + translation;
        let seen = lens.project(at)?;
        let plane = (seen - DVec2::new(lens.cx, lens.cy)) / DVec2::new(lens.fx, lens.fy);
        let mut rows = PointRows { seen, lens: [[0.0; OF_LENS]; 2], board: [[0.0; OF_BOARD]; 2] };
        (rows.lens[0][0], rows.lens[1][1]) = (plane.x, plane.y);
        (rows.lens[0][2], rows.lens[1][3]) = (1.0, 1.0);
        for k in 4..OF_LENS {
            let mut change = [0.0; OF_LENS];
            change[k] = STEP;
            let more = moved_lens(lens, &change).project(at);
            change[k] = -STEP;
            let less = moved_lens(lens, &change).project(at);
            // Where the lens folds it is as if the coefficient did nothing.
            let slope = more.zip(less).map_or(DVec2::ZERO, |(more, less)| (more - less) / (2.0 * STEP));
            (rows.lens[0][k], rows.lens[1][k]) = (slope.x, slope.y);
        }
        let step = STEP * at.length();
        let slopes: [DVec2; 3] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let sides = lens.project(at + axis * step).zip(lens.project(at - axis * step));
            sides.map_or(DVec2::ZERO, |(more, less)| (more - less) / (2.0 * step))
        });
        for axis in 0..2 {
            let slope = DVec3::from_array(slopes.map(|s| s.to_array()[axis]));
            // A small turn w moves the point by w x turned.
            rows.board[axis][..3].copy_from_slice(&turned.cross(slope).to_array());
            rows.board[axis][3..].copy_from_slice(&slope.to_array());
        }
        Some(rows)
    }
}

/// A point's pixel and its derivatives, x and y.
struct PointRows {
    seen: DVec2,
    lens: [LensRow; 2],
    board: [[f64; OF_BOARD]; 2],
}

impl Terms {
    fn add(&mut self, board: &mut BoardTerms, of_lens: &LensRow, of_board: &[f64; OF_BOARD], residual: f64) {
        for i in 0..OF_LENS {
            for j in 0..OF_LENS {
                self.lens[i][j] += of_lens[i] * of_lens[j];
            }
            for j in 0..OF_BOARD {
                board.lens_board[i][j] += of_lens[i] * of_board[j];
            }
            self.right[i] += of_lens[i] * residual;
        }
        for i in 0..OF_BOARD {
            for j in 0..OF_BOARD {
                board.board[i][j] += of_board[i] * of_board[j];
            }
            board.right[i] += of_board[i] * residual;
        }
    }

    /// The equations of the lens alone, the boards taken out.
    fn reduced(&self, damping: f64) -> Option<([LensRow; OF_LENS], LensRow)> {
        let (mut left, mut right) = (self.lens, self.right);
        for i in 0..OF_LENS {
            left[i][i] *= 1.0 + damping;
        }
        for board in &self.boards {
            let damped = board.damped(damping);
            let of_right = solve_positive(&damped, board.right)?;
            for i in 0..OF_LENS {
                let solved = solve_positive(&damped, board.lens_board[i])?;
                for j in 0..OF_LENS {
                    left[i][j] -= dot(&board.lens_board[j], &solved);
                }
                right[i] -= dot(&board.lens_board[i], &of_right);
            }
        }
        Some((left, right))
    }

    /// The step of the lens and of each board.
    fn step(&self, damping: f64) -> Option<(LensRow, Vec<[f64; OF_BOARD]>)> {
        let (left, right) = self.reduced(damping)?;
        let of_lens = solve_positive(&left, right)?;
        let of_boards = self.boards.iter().map(|board| {
            let mut right = board.right;
            for (i, moved) in of_lens.iter().enumerate() {
                for j in 0..OF_BOARD {
                    right[j] -= board.lens_board[i][j] * moved;
                }
            }
            solve_positive(&board.damped(damping), right)
        });
        Some((of_lens, of_boards.collect::<Option<Vec<_>>>()?))
    }
}

impl BoardTerms {
    fn damped(&self, damping: f64) -> [[f64; OF_BOARD]; OF_BOARD] {
        let mut damped = self.board;
        for i in 0..OF_BOARD {
            damped[i][i] *= 1.0 + damping;
        }
        damped
    }
}

fn dot(a: &[f64; OF_BOARD], b: &[f64; OF_BOARD]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn moved_lens(lens: &Lens, change: &LensRow) -> Lens {
    let distortion = match lens.distortion {
        Distortion::None => Distortion::None,
        Distortion::RadialTangential(mut k) => {
            for (place, change) in RADIAL.into_iter().zip(&change[4..]) {
                k[place] += change;
            }
            Distortion::RadialTangential(k)
        }
        Distortion::Equidistant(mut k) => {
            for (k, change) in k.iter_mut().zip(&change[4..]) {
                *k += change;
            }
            Distortion::Equidistant(k)
        }
    };
    Lens {
        fx: lens.fx + change[0],
        fy: lens.fy + change[1],
        cx: lens.cx + change[2],
        cy: lens.cy + change[3],
        distortion,
        ..*lens
    }
}
