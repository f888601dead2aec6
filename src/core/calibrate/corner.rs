//! Where four squares of a chessboard meet, to a fraction of a pixel.

use crate::model::image::Image;
use glam::{DMat2, DVec2};

/// Steps until it rests.
const STEPS: usize = 20;
/// It rests where a step is shorter, pixels.
const RESTS_PX: f64 = 1e-3;
/// Farther from its start it is another corner, as a share of the radius.
const FARTHEST: f64 = 0.75;

/// The place in whose surroundings every slope of the picture is square to the way there: sum of w g g^T (p - c) = 0 over the
/// pixels p within `radius` of c, with slopes g and weights w that fall to the rim (W. Förstner, E. Gülch, "A Fast Operator for Detection and Precise Location
/// of Distinct Points", ISPRS 1987). Continuous pixels. `None` where nothing is distinct there, or the rim is outside of the picture.
pub fn refine_corner(gray: &Image<u8>, start: DVec2, radius: f64) -> Option<DVec2> {
    let mut corner = start;
    for _ in 0..STEPS {
        let (low, high) = (corner - radius, corner + radius);
        let (width, height) = (gray.width() as f64, gray.height() as f64);
        let is_inside =
            low.cmpge(DVec2::splat(2.0)).all() && high.cmple(DVec2::new(width, height) - 2.0).all();
        if !is_inside {
            return None;
        }
        let (mut normal, mut side) = (DMat2::ZERO, DVec2::ZERO);
        for y in low.y as usize..=high.y as usize {
            for x in low.x as usize..=high.x as usize {
                let place = DVec2::new(x as f64, y as f64) + 0.5;
                let share = (place - corner).length_squared() / (radius * radius);
                if share >= 1.0 {
                    continue;
                }
                let value = |x: usize, y: usize| f64::from(*gray.at(x, y));
                let slope = DVec2::new(value(x + 1, y) - value(x - 1, y), value(x, y + 1) - value(x, y - 1));
                let outer =
                    (1.0 - share) * (1.0 - share) * DMat2::from_cols(slope * slope.x, slope * slope.y);
                normal += outer;
                side += outer * place;
            }
        }
        // The smaller slope must be a slope, too: along a lone edge the corner is anywhere.
        let trace = normal.x_axis.x + normal.y_axis.y;
        if !(normal.determinant() > 1e-3 * trace * trace) {
            return None;
        }
        let next = normal.inverse() * side;
        let step = (next - corner).length();
        corner = next;
        if !((corner - start).length() < FARTHEST * radius) {
            return None;
        }
        if step < RESTS_PX {
            return Some(corner);
        }
    }
    Some(corner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;

    /// Four squares that meet at a place, turned and sheared, 16 samples a pixel, with noise.
    fn picture(corner: DVec2, turn: f64, shear: f64, noise: f64, dice: &mut Dice) -> Image<u8> {
        let (along, across) = (DVec2::from_angle(turn), DVec2::from_angle(turn + 1.571 + shear));
        let mut gray = Image::<u8>::default();
        gray.reshape(40, 40, 0);
        for y in 0..40 {
            for x in 0..40 {
                let samples = (0..16).map(|k| {
                    let place = DVec2::new(
                        x as f64 + (k % 4) as f64 / 4.0 + 0.125,
                        y as f64 + (k / 4) as f64 / 4.0 + 0.125,
                    );
                    let from = place - corner;
                    if (from.perp_dot(along) > 0.0) == (from.perp_dot(across) > 0.0) { 200.0 } else { 40.0 }
                });
                let mean: f64 = samples.sum::<f64>() / 16.0;
                *gray.at_mut(x, y) = (mean + noise * dice.normal()).round().clamp(0.0, 255.0) as u8;
            }
        }
        gray
    }

    #[test]
    fn corners_of_any_turn_are_found() {
        let mut dice = Dice::new(9);
        for noise in [0.0, 3.0] {
            let (mut sum, mut worst) = (0.0, 0.0f64);
            for _ in 0..100 {
                let corner = DVec2::new(dice.between(18.0, 22.0), dice.between(18.0, 22.0));
                let gray = picture(corner, dice.between(0.0, 3.1), dice.between(-0.5, 0.5), noise, &mut dice);
                let start = corner + DVec2::new(dice.between(-0.7, 0.7), dice.between(-0.7, 0.7));
                let error = (refine_corner(&gray, start, 6.0).unwrap() - corner).length();
                sum += error * error;
                worst = worst.max(error);
            }
            let rms = (sum / 100.0).sqrt();
            println!("noise {noise}: rms {rms:.4} px, {worst:.4} at worst");
            // Edges without any blur are the worst that there is: slopes over two pixels cannot follow them.
            assert!(rms < 0.055 + 0.01 * noise && worst < 0.2 + 0.02 * noise, "{rms} {worst}");
        }
    }

    #[test]
    fn edges_and_plain_places_are_none() {
        let edge =
            Image::from_pixels(40, 40, (0..1600).map(|i| if i % 40 < 20 { 30 } else { 220 }).collect())
                .unwrap();
        let middle = DVec2::splat(20.0);
        assert_eq!(refine_corner(&edge, middle, 6.0), None);
        assert_eq!(refine_corner(&Image::filled(40, 40, 7), middle, 6.0), None);
        assert_eq!(refine_corner(&edge, DVec2::splat(3.0), 6.0), None);
        assert_eq!(refine_corner(&edge, DVec2::splat(f64::NAN), 6.0), None);
    }
}
