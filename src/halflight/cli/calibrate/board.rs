//! Boards that `halflight calibrate camera` knows, and where their points are in a picture.

use crate::calibrate::{AprilGrid, BoardPoint, corner::refine_corner};
use crate::cli::CliError;
use crate::model::image::Image;
use crate::track::tag::{TagDetection, TagDetector, TagOptions};
use calib_targets_chessboard::{
    ChessboardDetector, ChessboardParams, GrayImageView, default_chess_config, detect_corner_frame,
};
use glam::DVec2;

/// What `--board` may say.
const BOARDS: &str = "apriltag:COLUMNSxROWS,size=METRES,spacing=GAP and border=2 for Kalibr's own prints, e.g. apriltag:6x6,size=0.088,spacing=0.3, or \
                      chessboard:COLUMNSxROWS,size=METRES with the corners inside, e.g. chessboard:9x6,size=0.025";
/// Most tags of a board; the family has 587.
const MOST_TAGS: u32 = 587;
/// What counts around a corner: as a share of the way to the nearest other one, and in pixels.
const NEAR: f64 = 0.6;
const LEAST_PX: f64 = 2.5;
const MOST_PX: f64 = 10.0;
/// One in so many corners may lie outside of the board.
const OUTSIDE: usize = 16;
/// Most corners of a side of a chessboard.
const MOST_CORNERS: u32 = 100;

/// A flat board with points at known places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CalibrationBoard {
    /// Tags of family tag36h11, and the cells of their border.
    Tags(AprilGrid, u32),
    /// Black and white squares.
    Chess(ChessBoard),
}

/// A chessboard, counted by the corners inside, where four squares meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChessBoard {
    columns: u32,
    rows: u32,
    /// Side of a square, metres.
    size_m: f64,
}

impl CalibrationBoard {
    /// Reads `--board`.
    pub fn parse(text: &str) -> Result<Self, CliError> {
        let wrong =
            |what: String| CliError::on(format!("--board {text}"), format!("{what}: must be {BOARDS}"));
        let (kind, rest) = text.split_once(':').unwrap_or((text, ""));
        let is_chess = match kind {
            "apriltag" => false,
            "chessboard" => true,
            _ => return Err(wrong("an unknown board".into())),
        };
        let mut parts = rest.split(',');
        let sides = parts.next().and_then(|sides| sides.split_once('x'));
        let (columns, rows): (u32, u32) = sides
            .and_then(|(c, r)| Some((c.parse().ok()?, r.parse().ok()?)))
            .ok_or_else(|| wrong("no grid".into()))?;
        let (mut size_m, mut spacing) = (0.0, if is_chess { 0.0 } else { f64::NAN });
        let mut border_cells = 1;
        for part in parts {
            let number = |text: &str| text.parse::<f64>().map_err(|_e| wrong(format!("\"{part}\"")));
            match part.split_once('=') {
                Some(("size", text)) => size_m = number(text)?,
                Some(("spacing", text)) if !is_chess => spacing = number(text)?,
                Some(("border", "1")) if !is_chess => border_cells = 1,
                Some(("border", "2")) if !is_chess => border_cells = 2,
                _ => return Err(wrong(format!("\"{part}\""))),
            }
        }
        let is_few = columns > 0 && rows > 0 && columns.checked_mul(rows).is_some_and(|n| n <= MOST_TAGS);
        if !is_chess && !is_few {
            return Err(wrong(format!("{columns} x {rows} tags: 1 to {MOST_TAGS} of them")));
        }
        let is_side = |corners: u32| (2..=MOST_CORNERS).contains(&corners);
        if is_chess && !(is_side(columns) && is_side(rows)) {
            return Err(wrong(format!("{columns} x {rows} corners: 2 to {MOST_CORNERS} of a side")));
        }
        if !(0.001..=10.0).contains(&size_m) {
            return Err(wrong(format!("size = {size_m}: 0.001 to 10 metres")));
        }
        if !(0.0..=10.0).contains(&spacing) {
            return Err(wrong(format!("spacing = {spacing}: 0 to 10 sides of a tag")));
        }
        Ok(match is_chess {
            true => Self::Chess(ChessBoard { columns, rows, size_m }),
            false => Self::Tags(AprilGrid { columns, rows, size_m, spacing }, border_cells),
        })
    }
}

/// What a picture shows of the board.
#[derive(Debug, Default)]
pub struct SeenBoard {
    /// In no order.
    pub points: Vec<BoardPoint>,
    /// What it shows in place of it.
    pub note: Option<String>,
}

/// Finds a board's points in pictures.
pub enum BoardFinder {
    /// Each tag is known by its number.
    Tags(AprilGrid, Box<TagDetector>),
    /// Corners are told apart by their neighbours alone.
    Chess(ChessBoard, ChessboardDetector),
}

impl BoardFinder {
    /// Makes ready what looks for it; an error where the library refuses.
    pub fn new(board: &CalibrationBoard) -> Result<Self, CliError> {
        Ok(match board {
            CalibrationBoard::Tags(grid, border_cells) => {
                let options = TagOptions { border_cells: *border_cells, ..TagOptions::thorough() };
                Self::Tags(*grid, Box::new(TagDetector::new(options)?))
            }
            CalibrationBoard::Chess(board) => {
                let detector = ChessboardDetector::new(ChessboardParams::default());
                Self::Chess(*board, detector.map_err(|e| CliError(e.to_string()))?)
            }
        })
    }

    /// The points that a picture shows, in no order; none where it shows no board.
    pub fn points(&mut self, gray: &Image<u8>) -> Result<SeenBoard, CliError> {
        match self {
            Self::Tags(grid, detector) => {
                let mut tags = Vec::new();
                detector.detect(gray, None, &mut tags)?;
                Ok(SeenBoard { points: points_of_tags(&tags, grid), note: None })
            }
            Self::Chess(board, detector) => Ok(points_of_chess(gray, board, detector)),
        }
    }
}

/// Corners of the board's tags; a tag that is seen twice is none.
fn points_of_tags(tags: &[TagDetection], board: &AprilGrid) -> Vec<BoardPoint> {
    let is_one = |tag: &&TagDetection| tags.iter().filter(|other| other.id == tag.id).count() == 1;
    let corners = tags.iter().filter(is_one).filter_map(|tag| Some((board.corners(tag.id)?, tag.corners_px)));
    corners
        .flat_map(|(on_board, pixels)| on_board.into_iter().zip(pixels))
        .map(|(on_board, pixel)| BoardPoint { on_board, pixel })
        .collect()
}

/// Corners of squares. Which corner of the board is the first is not known, and of no matter: each view has its own place of the
/// board. Of a grid that is larger than the board the part with most corners counts, where next to nothing lies outside; else it
/// is another board.
fn points_of_chess(gray: &Image<u8>, board: &ChessBoard, detector: &ChessboardDetector) -> SeenBoard {
    let view = GrayImageView { width: gray.width(), height: gray.height(), data: gray.pixels() };
    let frame = detect_corner_frame(&view, &default_chess_config());
    let Some(found) = detector.detect(&frame.corners) else { return SeenBoard::default() };
    let places: Vec<[i64; 2]> =
        found.corners.iter().map(|c| [i64::from(c.grid.u), i64::from(c.grid.v)]).collect();
    let Some(inside) = part_of_board(&places, board) else {
        let side = |k: usize| places.iter().map(|p| p[k]).max().unwrap_or(0) + 1;
        let note = format!(
            "shows a grid of {} x {} corners, {} x {} were named",
            side(0),
            side(1),
            board.columns,
            board.rows
        );
        return SeenBoard { points: Vec::new(), note: Some(note) };
    };
    // Theirs count from the middle of the first pixel.
    let pixels: Vec<DVec2> = (found.corners.iter())
        .map(|corner| DVec2::new(f64::from(corner.position.x), f64::from(corner.position.y)) + 0.5)
        .collect();
    let refined = |(k, &pixel): (usize, &DVec2)| {
        if !inside(places[k]) {
            return None;
        }
        // No other corner may be near enough to count.
        let others = pixels.iter().enumerate().filter(|(other, _)| *other != k);
        let nearest = others.map(|(_, other)| other.distance(pixel)).fold(f64::INFINITY, f64::min);
        let pixel = refine_corner(gray, pixel, (NEAR * nearest).clamp(LEAST_PX, MOST_PX))?;
        Some(BoardPoint {
            on_board: DVec2::new(places[k][0] as f64, places[k][1] as f64) * board.size_m,
            pixel,
        })
    };
    SeenBoard { points: pixels.iter().enumerate().filter_map(refined).collect(), note: None }
}

/// Which places of a grid are the board's: a window of its size, upright or lying, that holds most of them. `None` where too many are
/// outside of every such window.
fn part_of_board(places: &[[i64; 2]], board: &ChessBoard) -> Option<impl Fn([i64; 2]) -> bool + use<>> {
    let (columns, rows) = (i64::from(board.columns), i64::from(board.rows));
    let most = |k: usize| places.iter().map(|p| p[k]).max().unwrap_or(0);
    let mut best: Option<([i64; 2], [i64; 2], usize)> = None;
    for size in [[columns, rows], [rows, columns]] {
        for x in 0..=(most(0) + 1 - size[0]).clamp(0, i64::from(MOST_CORNERS)) {
            for y in 0..=(most(1) + 1 - size[1]).clamp(0, i64::from(MOST_CORNERS)) {
                let is_in =
                    |p: &&[i64; 2]| (x..x + size[0]).contains(&p[0]) && (y..y + size[1]).contains(&p[1]);
                let count = places.iter().filter(is_in).count();
                if best.is_none_or(|(.., most)| count > most) {
                    best = Some(([x, y], size, count));
                }
            }
        }
    }
    let (start, size, count) = best?;
    let is_board = (places.len() - count) * OUTSIDE < places.len();
    let inside = move |p: [i64; 2]| (0..2).all(|k| (start[k]..start[k] + size[k]).contains(&p[k]));
    is_board.then_some(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_false_corner_beside_the_board_is_left_out_and_another_board_is_none() {
        let board = ChessBoard { columns: 4, rows: 3, size_m: 0.025 };
        let grid = |w: i64, h: i64| (0..w * h).map(move |i| [i % w, i / w]);
        for lying in [false, true] {
            let seen: Vec<[i64; 2]> = match lying {
                false => grid(4, 6).filter(|p| p[1] < 3).map(|p| [p[0] + 1, p[1]]).collect(),
                true => grid(3, 4).collect(),
            };
            let inside = part_of_board(&seen, &board).unwrap();
            assert!(seen.iter().all(|p| inside(*p)));
        }
        let many = ChessBoard { columns: 9, rows: 6, size_m: 0.025 };
        let one_more: Vec<[i64; 2]> = grid(9, 6).map(|p| [p[0] + 1, p[1]]).chain([[0, 2]]).collect();
        let inside = part_of_board(&one_more, &many).unwrap();
        assert_eq!(one_more.iter().filter(|p| inside(**p)).count(), 54);
        assert!(part_of_board(&grid(9, 6).collect::<Vec<_>>(), &ChessBoard { columns: 8, ..many }).is_none());
        assert!(part_of_board(&[], &many).is_none());
    }

    #[test]
    fn boards_are_read_and_mistakes_say_what_is_allowed() {
        let tags = AprilGrid { columns: 6, rows: 5, size_m: 0.088, spacing: 0.3 };
        let read = |text| CalibrationBoard::parse(text).unwrap();
        assert_eq!(read("apriltag:6x5,size=0.088,spacing=0.3"), CalibrationBoard::Tags(tags, 1));
        assert_eq!(read("apriltag:6x5,size=0.088,spacing=0.3,border=2"), CalibrationBoard::Tags(tags, 2));
        let chess = ChessBoard { columns: 9, rows: 6, size_m: 0.025 };
        assert_eq!(read("chessboard:9x6,size=0.025"), CalibrationBoard::Chess(chess));
        for (text, said) in [
            ("chess:6x6", "an unknown board"),
            ("apriltag:6,size=1", "no grid"),
            ("apriltag:6x0,size=0.1,spacing=0.3", "6 x 0 tags"),
            ("apriltag:60x60,size=0.1,spacing=0.3", "1 to 587"),
            ("apriltag:6x6,spacing=0.3", "size = 0"),
            ("apriltag:6x6,size=0.1", "spacing = NaN"),
            ("apriltag:6x6,size=x,spacing=0.3", "\"size=x\""),
            ("apriltag:6x6,side=1", "\"side=1\""),
            ("apriltag:6x6,size=0.1,spacing=0.3,border=3", "\"border=3\""),
            ("chessboard:9x1,size=0.025", "2 to 100 of a side"),
            ("chessboard:9x6,size=0.025,spacing=0.3", "\"spacing=0.3\""),
        ] {
            let error = CalibrationBoard::parse(text).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("e.g. chessboard:9x6"), "{text}: {error}");
        }
    }
}
