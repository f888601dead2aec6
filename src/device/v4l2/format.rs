//! Which formats we read, what a driver says of their colours, and which of its offers is taken.

use super::node::{Granted, Offer};
use crate::model::pixels::{BayerDepth, BayerOrder, PixelFormat, PixelLayout, YuvMatrix, YuvRange};

/// The kernel's four letters, and what they mean to us. Green of a Bayer sensor's "G" letters stands first in its row.
const KNOWN: [(&[u8; 4], PixelFormat); 31] = {
    use BayerDepth::{Bits8, Bits10, Bits10Packed, Bits12, Bits12Packed, Bits16};
    use BayerOrder::{Bggr, Gbrg, Grbg, Rggb};
    const fn bayer(order: BayerOrder, depth: BayerDepth) -> PixelFormat {
        PixelFormat::Bayer(order, depth)
    }
    [
        (b"RGB3", PixelFormat::Rgb24),
        (b"YUYV", PixelFormat::Yuyv),
        (b"UYVY", PixelFormat::Uyvy),
        (b"NV12", PixelFormat::Nv12),
        (b"GREY", PixelFormat::Grey),
        (b"MJPG", PixelFormat::Mjpeg),
        (b"JPEG", PixelFormat::Mjpeg),
        (b"RGGB", bayer(Rggb, Bits8)),
        (b"GRBG", bayer(Grbg, Bits8)),
        (b"GBRG", bayer(Gbrg, Bits8)),
        (b"BA81", bayer(Bggr, Bits8)),
        (b"RG10", bayer(Rggb, Bits10)),
        (b"BA10", bayer(Grbg, Bits10)),
        (b"GB10", bayer(Gbrg, Bits10)),
        (b"BG10", bayer(Bggr, Bits10)),
        (b"pRAA", bayer(Rggb, Bits10Packed)),
        (b"pgAA", bayer(Grbg, Bits10Packed)),
        (b"pGAA", bayer(Gbrg, Bits10Packed)),
        (b"pBAA", bayer(Bggr, Bits10Packed)),
        (b"RG12", bayer(Rggb, Bits12)),
        (b"BA12", bayer(Grbg, Bits12)),
        (b"GB12", bayer(Gbrg, Bits12)),
        (b"BG12", bayer(Bggr, Bits12)),
        (b"pRCC", bayer(Rggb, Bits12Packed)),
        (b"pgCC", bayer(Grbg, Bits12Packed)),
        (b"pGCC", bayer(Gbrg, Bits12Packed)),
        (b"pBCC", bayer(Bggr, Bits12Packed)),
        (b"RG16", bayer(Rggb, Bits16)),
        (b"GR16", bayer(Grbg, Bits16)),
        (b"GB16", bayer(Gbrg, Bits16)),
        (b"BYR2", bayer(Bggr, Bits16)),
    ]
};

/// What four letters mean; `None` for a format that is not read.
pub fn pixel_format(fourcc: [u8; 4]) -> Option<PixelFormat> {
    KNOWN.iter().find(|(letters, _)| **letters == fourcc).map(|(_, format)| *format)
}

/// Four letters for people.
pub fn shown(fourcc: [u8; 4]) -> String {
    fourcc.iter().map(|b| if b.is_ascii_graphic() { char::from(*b) } else { '?' }).collect()
}

/// What somebody wants of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FormatWish {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames a second.
    pub frames_per_s: f64,
    /// The kernel's four letters; `None`: the best of those we read.
    pub fourcc: Option<[u8; 4]>,
}

impl Default for FormatWish {
    fn default() -> Self {
        Self { width: 640, height: 480, frames_per_s: 30.0, fourcc: None }
    }
}

/// Points for what a picture of a format is worth: whole colours before halved ones, and JPEG's losses last but for gray.
fn worth(format: PixelFormat) -> f64 {
    match format {
        PixelFormat::Rgb24 => 22.0,
        PixelFormat::Nv12 | PixelFormat::Yuyv | PixelFormat::Uyvy => 20.0,
        // Linear and deep, but its colours are only as good as the white balance that the rig states.
        PixelFormat::Bayer(..) => 14.0,
        PixelFormat::Mjpeg => 10.0,
        PixelFormat::Grey => 0.0,
    }
}

/// Points of an offer, more are better; `None` where it is of no use. The size counts by how many times larger or smaller it
/// is than wanted, 20 points for each factor of two (a smaller one twice); the rate where it is lower than wanted, 20 points
/// for each factor of two.
pub fn score(offer: &Offer, wish: &FormatWish) -> Option<f64> {
    let format = pixel_format(offer.fourcc)?;
    if wish.fourcc.is_some_and(|wanted| wanted != offer.fourcc) {
        return None;
    }
    let side = |a: u32, b: u32| (f64::from(a) / f64::from(b.max(1))).log2();
    let [wide, high] = [side(offer.width, wish.width), side(offer.height, wish.height)];
    let lost = |factor: f64| if factor < 0.0 { -2.0 * factor } else { factor };
    let size = 20.0 * (lost(wide) + lost(high));
    // A driver that lists no rates is believed to keep up.
    let rate = offer.rates.highest().map_or(0.0, |most| 20.0 * (wish.frames_per_s / most).log2().max(0.0));
    let points = worth(format) - size - rate;
    points.is_finite().then_some(points)
}

/// The best offer with its points; of equals the first.
pub fn best<'a>(offers: &'a [Offer], wish: &FormatWish) -> Option<(&'a Offer, f64)> {
    let mut best: Option<(&Offer, f64)> = None;
    for offer in offers {
        let Some(points) = score(offer, wish) else { continue };
        if best.is_none_or(|(_, most)| points > most) {
            best = Some((offer, points));
        }
    }
    best
}

// The kernel's numbers: `v4l2_colorspace`, `v4l2_ycbcr_encoding`, `v4l2_quantization`.
const SPACE_REC709: u32 = 3;
const SPACE_JPEG: u32 = 7;
const ENCODING_601: u32 = 1;
const ENCODING_709: u32 = 2;
const ENCODING_XV709: u32 = 4;
const QUANTIZATION_FULL: u32 = 1;
const QUANTIZATION_LIMITED: u32 = 2;

/// The layout of the pictures that a driver granted; `None` for a format that is not read, or one in several pieces of
/// memory. What the driver leaves open follows the kernel's own rule: limited range but for JPEG's and for gray, BT.601 but for
/// the colours of high definition.
pub fn layout(granted: &Granted) -> Option<PixelLayout> {
    let format = pixel_format(granted.fourcc).filter(|_| granted.planes == 1)?;
    let packed = PixelLayout::packed(format, granted.width as usize, granted.height as usize);
    let stride = match granted.stride as usize {
        0 => packed.stride,
        stated => stated,
    };
    let range = match granted.quantization {
        QUANTIZATION_FULL => YuvRange::Full,
        QUANTIZATION_LIMITED => YuvRange::Limited,
        _ if granted.colour_space == SPACE_JPEG || format == PixelFormat::Grey => YuvRange::Full,
        _ => YuvRange::Limited,
    };
    let matrix = match granted.encoding {
        ENCODING_709 | ENCODING_XV709 => YuvMatrix::Bt709,
        ENCODING_601 => YuvMatrix::Bt601,
        _ if granted.colour_space == SPACE_REC709 => YuvMatrix::Bt709,
        _ => YuvMatrix::Bt601,
    };
    Some(PixelLayout { stride, range, matrix, ..packed })
}

#[cfg(test)]
mod tests {
    use super::super::node::FrameRates;
    use super::*;
    use proptest::prelude::*;

    fn offer(fourcc: &[u8; 4], width: u32, height: u32, rate: f64) -> Offer {
        let mut rates = FrameRates::default();
        rates.add(rate);
        Offer { fourcc: *fourcc, width, height, rates }
    }

    #[test]
    fn a_webcam_gives_jpeg_only_where_its_wires_are_too_slow_for_more() {
        let webcam = [
            offer(b"YUYV", 640, 480, 30.0),
            offer(b"YUYV", 1280, 720, 10.0),
            offer(b"MJPG", 640, 480, 30.0),
            offer(b"MJPG", 1280, 720, 30.0),
            offer(b"H264", 1280, 720, 30.0),
        ];
        let taken = |width, height| {
            let wish = FormatWish { width, height, ..FormatWish::default() };
            let (offer, _) = best(&webcam, &wish).unwrap();
            (offer.fourcc, offer.width)
        };
        assert_eq!(taken(640, 480), (*b"YUYV", 640));
        assert_eq!(taken(1280, 720), (*b"MJPG", 1280));
        assert_eq!(taken(333, 250), (*b"YUYV", 640));
        let wish = FormatWish { fourcc: Some(*b"MJPG"), ..FormatWish::default() };
        assert_eq!(best(&webcam, &wish).unwrap().0.fourcc, *b"MJPG");
        let wish = FormatWish { fourcc: Some(*b"H264"), ..FormatWish::default() };
        assert_eq!(best(&webcam, &wish), None);
    }

    #[test]
    fn colours_are_as_the_driver_states_them() {
        let granted = Granted { fourcc: *b"YUYV", width: 640, height: 480, planes: 1, ..Granted::default() };
        let of = |granted: Granted| layout(&granted).map(|l| (l.range, l.matrix, l.stride));
        assert_eq!(of(granted), Some((YuvRange::Limited, YuvMatrix::Bt601, 1280)));
        let jpeg = Granted { colour_space: SPACE_JPEG, stride: 1344, ..granted };
        assert_eq!(of(jpeg), Some((YuvRange::Full, YuvMatrix::Bt601, 1344)));
        let hd = Granted { colour_space: SPACE_REC709, quantization: QUANTIZATION_FULL, ..granted };
        assert_eq!(of(hd), Some((YuvRange::Full, YuvMatrix::Bt709, 1280)));
        assert_eq!(of(Granted { encoding: ENCODING_601, ..hd }).unwrap().1, YuvMatrix::Bt601);
        assert_eq!(of(Granted { planes: 2, ..granted }), None);
        assert_eq!(of(Granted { fourcc: *b"H264", ..granted }), None);
    }

    proptest! {
        #[test]
        fn any_offer_and_wish_have_points_or_none(
            fourcc in any::<[u8; 4]>(), width in any::<u32>(), height in any::<u32>(), rate in any::<f64>(),
            known in 0..KNOWN.len(), is_known in any::<bool>(), wide in any::<u32>(), high in any::<u32>(),
        ) {
            let fourcc = if is_known { *KNOWN[known].0 } else { fourcc };
            let wish = FormatWish { width: wide, height: high, frames_per_s: rate, fourcc: None };
            let points = score(&offer(&fourcc, width, height, rate), &wish);
            prop_assert!(points.is_none_or(f64::is_finite));
            let granted = Granted { fourcc, width, height, stride: wide, planes: 1, ..Granted::default() };
            if let Some(layout) = layout(&granted) {
                let _ = layout.check();
            }
        }
    }
}
