//! Boxes that stand for the thin parts of a mesh where it blocks soft light: plates, sheets, bars. Spheres cannot: so many
//! would be needed that their number grows with the square of extent over thickness.
//!
//! A mesh is taken apart into its connected pieces (`pieces`). A piece is thin where its volume over its surface is small
//! against its extent and its surface is flat for the most part, or where it is a straight bar. Thin pieces are cut along
//! their own flat sides into blocks, of which boxes are put together, the one that covers most first (`blocks`). Where few boxes
//! cover it well they stand for the piece. Rods that are bent, closed or tapered become chains of boxes along their axis
//! (`chain`). Else spheres do, as for all that is not thin. All in a fixed order: equal meshes give equal boxes.

mod blocks;
mod chain;
mod pieces;

use blocks::Blocks;
use glam::Vec3;
use pieces::{Piece, pieces};

/// Boxes of a body at most.
pub const MAX_BOXES: usize = 20;
/// A piece is thin where twice its volume over its surface is below this share of the root of half its surface: of a square
/// plate where it is thinner than about a quarter of its side. A cube has 0.19, a ball 0.27.
const THIN: f32 = 0.15;
/// Share of the surface of a plate that flat sides make up at least.
const FLAT: f32 = 0.7;
/// How much longer than wide a bar is at least, and which share of the box around it is full.
const BAR: (f32, f32) = (4.0, 0.7);
/// Boxes stand for a piece where what they leave uncovered and what they cover besides is no more than this share of it.
const MOST_OFF: f64 = 0.16;
/// Below this share of its extent a piece has no thickness: a sheet.
const NO_THICKNESS: f32 = 1e-3;

/// A box in the frame of its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedBox {
    /// In the units of the mesh.
    pub centre: Vec3,
    /// Unit vectors at right angles to each other, right-handed.
    pub axes: [Vec3; 3],
    /// Half the extent along each; the last is 0 for a sheet.
    pub half: Vec3,
}

/// Finds boxes, `most` of them at most, for the thin pieces of a mesh, for the largest first. Triangles with an index that
/// there is not, or without an area, are left out. Empty where nothing is thin.
pub fn fit(positions: &[Vec3], triangles: &[[u32; 3]], most: usize) -> Vec<FittedBox> {
    let most = most.min(MAX_BOXES);
    let mut found = Vec::new();
    for piece in pieces(positions, triangles) {
        if found.len() == most {
            break;
        }
        let left = most - found.len();
        found.extend(of_piece(&piece, left).or_else(|| chain::of_rod(&piece, left)).into_iter().flatten());
    }
    found
}

/// Boxes for one piece; `None` where it is not thin, or no so few boxes cover it.
fn of_piece(piece: &Piece, most: usize) -> Option<Vec<FittedBox>> {
    let area = piece.area();
    let volume = piece.volume();
    let thinness = 2.0 * volume / area / (0.5 * area).sqrt();
    if !(thinness < THIN) {
        return None;
    }
    let sides = piece.sides();
    let frame = piece.frame(sides.first()?.normal);
    let extent = frame.high - frame.low;
    let is_sheet = extent.z <= NO_THICKNESS * extent.max_element();
    if !is_sheet {
        if let Some(bar) = bar(&frame, extent, area, volume) {
            return Some(vec![bar]);
        }
        // An open shell that is not flat encloses what it does not fill.
        if !piece.is_closed() {
            return None;
        }
    }
    let flat: f32 = sides.iter().filter(|side| side.area > 0.02 * area).map(|side| side.area).sum();
    if flat < FLAT * area {
        return None;
    }
    let mut blocks = Blocks::cut(piece, &frame, is_sheet);
    let boxes = blocks.boxes(most);
    let (uncovered, outside) = blocks.shares();
    (uncovered + outside <= MOST_OFF).then(|| {
        let grow = ((1.0 - uncovered + outside).max(0.5)).recip().sqrt() as f32;
        let exact = (grow - 1.0).abs() < 1e-3;
        boxes
            .into_iter()
            .map(|[low, high]| {
                let half = 0.5 * (high - low);
                // In all as much as there is: the two longer sides are stretched.
                let grow = Vec3::from(
                    half.to_array().map(|h| if exact || h == half.min_element() { 1.0 } else { grow }),
                );
                frame.placed(0.5 * (low + high), half * grow)
            })
            .collect()
    })
}

/// A straight bar's box, its section such that it has the bar's surface: a convex body's silhouette is a quarter of
/// its surface in the mean.
fn bar(frame: &pieces::PieceFrame, extent: Vec3, area: f32, volume: f32) -> Option<FittedBox> {
    let longest = extent.max_element();
    let across: Vec<usize> = (0..3).filter(|&k| extent[k] < longest).collect();
    let [i, j] = across[..] else { return None };
    let (a, b) = (extent[i], extent[j]);
    let full = volume / (a * b * longest);
    if longest < BAR.0 * a.max(b) || !(BAR.1..1.01).contains(&full) {
        return None;
    }
    let share = (area / (2.0 * (a + b) * longest + 2.0 * a * b)).clamp(0.7, 1.0);
    let mut half = 0.5 * extent;
    half[i] *= share;
    half[j] *= share;
    Some(frame.placed(0.5 * (frame.low + frame.high), half))
}
