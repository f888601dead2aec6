//! A detector of tags whose border is wider than the library's own family has it.
#![allow(unsafe_code, reason = "the C library takes pointers")]

use apriltag::Detector;
use apriltag_sys as library;

/// A detector of family tag36h11 whose black border is two cells wide, as Kalibr prints it. The codes are the same; they lie one
/// cell farther inside.
pub fn two_cell_border(mended_bits: u32) -> Option<Detector> {
    // SAFETY: both are made here and belong to nobody else. The family is changed before the detector knows it: its places are a
    // list of as many numbers as it has bits. As with the library's own builder the family lives as long as the program.
    unsafe {
        let family = library::tag36h11_create().as_mut()?;
        let bits = family.nbits as usize;
        for places in [family.bit_x, family.bit_y] {
            if places.is_null() {
                return None;
            }
            std::slice::from_raw_parts_mut(places, bits).iter_mut().for_each(|place| *place += 1);
        }
        family.width_at_border += 2;
        family.total_width += 2;
        let detector = library::apriltag_detector_create();
        if detector.is_null() {
            return None;
        }
        library::apriltag_detector_add_family_bits(detector, family, mended_bits as i32);
        Some(Detector::from_raw(detector))
    }
}
