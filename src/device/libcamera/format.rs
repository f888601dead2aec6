//! libcamera's formats in the kernel's letters, and which stream is taken. Pure: what is wanted, what an offer is worth and what
//! a layout is are V4L2's, so that a camera gives the same picture behind either door.

use crate::model::pixels::PixelLayout;
use crate::v4l2::format::{self, FormatWish};
use crate::v4l2::node::{FrameRates, Granted, Offer};

/// The modifier of MIPI's packed formats.
pub const PACKED: u64 = 11 << 56 | 1;
/// The kernel's number for the colours of JPEG: full range, BT.601.
const SPACE_JPEG: u32 = 7;

/// A format by libcamera's name: the letters of the display side of the kernel, and how the bytes are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamFormat {
    /// Four letters.
    pub fourcc: [u8; 4],
    /// 0, or [`PACKED`]; others are of no use here.
    pub modifier: u64,
}

/// libcamera's letters and modifier, and the letters that V4L2 has for the same bytes. libcamera's BGR is red first in memory.
const KNOWN: [(&[u8; 4], u64, &[u8; 4]); 30] = [
    (b"BG24", 0, b"RGB3"),
    (b"YUYV", 0, b"YUYV"),
    (b"UYVY", 0, b"UYVY"),
    (b"NV12", 0, b"NV12"),
    (b"R8  ", 0, b"GREY"),
    (b"MJPG", 0, b"MJPG"),
    (b"RGGB", 0, b"RGGB"),
    (b"GRBG", 0, b"GRBG"),
    (b"GBRG", 0, b"GBRG"),
    (b"BA81", 0, b"BA81"),
    (b"RG10", 0, b"RG10"),
    (b"BA10", 0, b"BA10"),
    (b"GB10", 0, b"GB10"),
    (b"BG10", 0, b"BG10"),
    (b"RG10", PACKED, b"pRAA"),
    (b"BA10", PACKED, b"pgAA"),
    (b"GB10", PACKED, b"pGAA"),
    (b"BG10", PACKED, b"pBAA"),
    (b"RG12", 0, b"RG12"),
    (b"BA12", 0, b"BA12"),
    (b"GB12", 0, b"GB12"),
    (b"BG12", 0, b"BG12"),
    (b"RG12", PACKED, b"pRCC"),
    (b"BA12", PACKED, b"pgCC"),
    (b"GB12", PACKED, b"pGCC"),
    (b"BG12", PACKED, b"pBCC"),
    (b"RGB6", 0, b"RG16"),
    (b"GR16", 0, b"GR16"),
    (b"GB16", 0, b"GB16"),
    (b"BYR2", 0, b"BYR2"),
];

impl StreamFormat {
    /// V4L2's letters; `None` for a format that is not read.
    pub fn kernel_letters(self) -> Option<[u8; 4]> {
        let same = |(fourcc, modifier, _): &&(&[u8; 4], u64, &[u8; 4])| {
            **fourcc == self.fourcc && *modifier == self.modifier
        };
        KNOWN.iter().find(same).map(|(_, _, letters)| **letters)
    }

    /// For people: V4L2's letters, since the option `format=` takes these; libcamera's own where it is not read.
    pub fn shown(self) -> String {
        match self.kernel_letters() {
            Some(letters) => format::shown(letters),
            None if self.modifier == 0 => format::shown(self.fourcc).replace('?', ""),
            None => format!("{} packed otherwise", format::shown(self.fourcc)),
        }
    }
}

/// What a stream is for. An image processor may give other formats for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraRole {
    /// Quick pictures, small ones too.
    Viewfinder,
    /// The best pictures.
    StillCapture,
    /// The sensor's own values, where an image processor stands before the others.
    Raw,
}

impl CameraRole {
    /// Each of them once; of equal offers the first is taken.
    pub const ALL: [Self; 3] = [Self::Viewfinder, Self::StillCapture, Self::Raw];
}

/// Sizes from the least to the most, in steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SteppedSizes {
    /// Columns and rows of the smallest.
    pub least: [u32; 2],
    /// Columns and rows of the largest.
    pub most: [u32; 2],
    /// Columns and rows between two; 0 where there is but one.
    pub step: [u32; 2],
}

impl SteppedSizes {
    /// The size nearest below a wish; `None` where the wish is out of range.
    fn near(&self, wish: [u32; 2]) -> Option<[u32; 2]> {
        let mut near = [0; 2];
        for axis in 0..2 {
            let (least, most) = (self.least[axis], self.most[axis]);
            if most == 0 || !(least..=most).contains(&wish[axis]) {
                return None;
            }
            near[axis] = least + (wish[axis] - least) / self.step[axis].max(1) * self.step[axis];
        }
        Some(near)
    }
}

/// One format that a camera offers for a role.
#[derive(Clone, Debug, PartialEq)]
pub struct RoleOffer {
    /// What for.
    pub role: CameraRole,
    /// Which.
    pub format: StreamFormat,
    /// Columns and rows of the sizes that are listed.
    pub sizes: Vec<[u32; 2]>,
    /// Those that are not, in a range.
    pub range: Option<SteppedSizes>,
}

impl RoleOffer {
    /// The offer in V4L2's terms, one for each size. libcamera lists no rates.
    pub fn sized(&self, wish: &FormatWish) -> Vec<Offer> {
        let Some(fourcc) = self.format.kernel_letters() else { return Vec::new() };
        let stepped = self.range.and_then(|range| range.near([wish.width, wish.height]));
        let mut sizes = self.sizes.clone();
        sizes.extend(stepped.filter(|size| !self.sizes.contains(size)));
        let offer = |[width, height]: [u32; 2]| Offer { fourcc, width, height, rates: FrameRates::default() };
        sizes.into_iter().map(offer).collect()
    }
}

/// The stream that is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct RoleChoice {
    /// What for.
    pub role: CameraRole,
    /// By libcamera's name.
    pub format: StreamFormat,
    /// In V4L2's terms.
    pub offer: Offer,
}

/// The stream with the highest score of V4L2's list; of equals the first.
pub fn choose(offers: &[RoleOffer], wish: &FormatWish) -> Option<RoleChoice> {
    let mut best: Option<(RoleChoice, f64)> = None;
    for RoleOffer { role, format, .. } in offers.iter().filter(|o| o.format.kernel_letters().is_some()) {
        let sized = offers.iter().filter(|o| o.role == *role && o.format == *format);
        let sized: Vec<Offer> = sized.flat_map(|o| o.sized(wish)).collect();
        let Some((offer, points)) = format::best(&sized, wish) else { continue };
        if best.as_ref().is_none_or(|(_, most)| points > *most) {
            best = Some((RoleChoice { role: *role, format: *format, offer: offer.clone() }, points));
        }
    }
    best.map(|(choice, _)| choice)
}

/// All formats for people, each once.
pub fn listed(offers: &[RoleOffer]) -> String {
    let mut names: Vec<String> = Vec::new();
    for name in offers.iter().map(|offer| offer.format.shown()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    if names.is_empty() { "no format".to_owned() } else { names.join(", ") }
}

/// What libcamera made of a choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GrantedStream {
    /// Which format.
    pub format: StreamFormat,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from one row to the next; 0 where it states none.
    pub stride: u32,
}

/// The layout of its pictures; `None` for a format that is not read. libcamera 0.0.3 has no binding for colour spaces: an image
/// processor gives JPEG's colours for these roles, a USB camera what V4L2 takes it to give.
pub fn layout(granted: &GrantedStream, is_usb: bool) -> Option<PixelLayout> {
    let GrantedStream { format, width, height, stride } = *granted;
    let fourcc = format.kernel_letters()?;
    let colour_space = if is_usb { 0 } else { SPACE_JPEG };
    format::layout(&Granted { fourcc, width, height, stride, planes: 1, colour_space, ..Granted::default() })
}

/// Where a plane of a picture lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanePlace {
    /// Number of its memory.
    pub fd: i32,
    /// First byte.
    pub offset: usize,
    /// Bytes.
    pub length: usize,
}

/// First and last byte of a picture whose planes follow each other in one piece of memory; `None` for others. `first_length` is
/// what the first of several planes must have for the second to be where the layout has it.
pub fn one_piece(planes: &[PlanePlace], first_length: usize) -> Option<[usize; 2]> {
    let (first, last) = (planes.first()?, planes.last()?);
    let follows = |pair: &[PlanePlace]| {
        pair[1].fd == pair[0].fd && Some(pair[1].offset) == pair[0].offset.checked_add(pair[0].length)
    };
    let is_one = planes.windows(2).all(follows) && (planes.len() == 1 || first.length == first_length);
    let end = last.offset.checked_add(last.length)?;
    (is_one && end > first.offset).then_some([first.offset, end])
}

/// Returns whether a camera's name is one of USB: it ends with the numbers of its maker and product.
pub fn is_usb(id: &str) -> bool {
    let is_number = |text: &str| text.len() == 4 && text.bytes().all(|b| b.is_ascii_hexdigit());
    id.rsplit_once('-')
        .and_then(|(_, numbers)| numbers.split_once(':'))
        .is_some_and(|(maker, product)| is_number(maker) && is_number(product))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::pixels::{PixelFormat, YuvRange};
    use proptest::prelude::*;

    fn offer(role: CameraRole, fourcc: &[u8; 4], modifier: u64, sizes: &[[u32; 2]]) -> RoleOffer {
        let format = StreamFormat { fourcc: *fourcc, modifier };
        RoleOffer { role, format, sizes: sizes.to_vec(), range: None }
    }

    #[test]
    fn every_format_is_one_that_is_read_and_no_two_are_the_same() {
        for (k, (fourcc, modifier, letters)) in KNOWN.iter().enumerate() {
            assert!(format::pixel_format(**letters).is_some(), "{}", format::shown(**letters));
            let before = &KNOWN[..k];
            assert!(!before.iter().any(|(f, m, l)| (f, m) == (fourcc, modifier) || l == letters));
        }
        let blue_first = StreamFormat { fourcc: *b"RG24", modifier: 0 };
        assert_eq!(blue_first.kernel_letters(), None);
        assert_eq!(StreamFormat { fourcc: *b"BG10", modifier: PACKED }.shown(), "pBAA");
        assert_eq!(StreamFormat { fourcc: *b"RG10", modifier: 13 << 56 }.kernel_letters(), None);
    }

    #[test]
    fn whole_colours_come_before_raw_values_and_the_first_role_before_others() {
        use CameraRole::{Raw, StillCapture, Viewfinder};
        let sensor = [
            offer(Viewfinder, b"NV12", 0, &[[640, 480], [1280, 720]]),
            offer(Viewfinder, b"XR24", 0, &[[640, 480]]),
            offer(StillCapture, b"NV12", 0, &[[640, 480]]),
            offer(StillCapture, b"BG24", 0, &[[1280, 720]]),
            offer(Raw, b"BG10", PACKED, &[[3280, 2464]]),
        ];
        let taken =
            |wish: FormatWish| choose(&sensor, &wish).map(|c| (c.role, c.offer.fourcc, c.offer.width));
        assert_eq!(taken(FormatWish::default()), Some((Viewfinder, *b"NV12", 640)));
        let large = FormatWish { width: 1280, height: 720, ..FormatWish::default() };
        assert_eq!(taken(large), Some((StillCapture, *b"RGB3", 1280)));
        let raw = FormatWish { fourcc: Some(*b"pBAA"), ..FormatWish::default() };
        assert_eq!(taken(raw), Some((Raw, *b"pBAA", 3280)));
        assert_eq!(taken(FormatWish { fourcc: Some(*b"MJPG"), ..FormatWish::default() }), None);
        assert_eq!(listed(&sensor), "NV12, XR24, RGB3, pBAA");
    }

    #[test]
    fn a_range_of_sizes_gives_the_wish_on_its_steps() {
        let range = SteppedSizes { least: [32, 32], most: [3280, 2464], step: [16, 2] };
        let ranged =
            RoleOffer { range: Some(range), ..offer(CameraRole::Viewfinder, b"YUYV", 0, &[[3280, 2464]]) };
        let wish = FormatWish { width: 333, height: 251, ..FormatWish::default() };
        let choice = choose(&[ranged], &wish).unwrap();
        assert_eq!((choice.offer.width, choice.offer.height), (320, 250));
    }

    #[test]
    fn colours_are_full_range_behind_an_image_processor() {
        let granted = GrantedStream {
            format: StreamFormat { fourcc: *b"NV12", modifier: 0 },
            width: 640,
            height: 480,
            stride: 704,
        };
        let of = |is_usb| layout(&granted, is_usb).map(|l| (l.format, l.stride, l.range));
        assert_eq!(of(false), Some((PixelFormat::Nv12, 704, YuvRange::Full)));
        assert_eq!(of(true), Some((PixelFormat::Nv12, 704, YuvRange::Limited)));
        assert!(is_usb(r"\_SB_.PCI0.S08_-1:1.0-1d6b:0102"));
        assert!(!is_usb("/base/soc/i2c0mux/i2c@1/imx219@10") && !is_usb("") && !is_usb("a-b:c"));
    }

    #[test]
    fn planes_must_follow_each_other() {
        let plane = |fd, offset, length| PlanePlace { fd, offset, length };
        assert_eq!(one_piece(&[plane(5, 16, 100)], 0), Some([16, 116]));
        assert_eq!(one_piece(&[plane(5, 0, 100), plane(5, 100, 50)], 100), Some([0, 150]));
        assert_eq!(one_piece(&[plane(5, 0, 100), plane(5, 100, 50)], 96), None);
        assert_eq!(one_piece(&[plane(5, 0, 100), plane(6, 0, 50)], 100), None);
        assert_eq!(one_piece(&[plane(5, 0, 100), plane(5, 128, 50)], 100), None);
        assert_eq!(one_piece(&[], 0), None);
        assert_eq!(one_piece(&[plane(5, usize::MAX, 2)], 0), None);
    }

    proptest! {
        #[test]
        fn whatever_is_offered_a_choice_is_made_or_not(
            wide in any::<u32>(), high in any::<u32>(), numbers in any::<[u32; 6]>(), known in 0..KNOWN.len(),
        ) {
            let [a, b, c, d, e, f] = numbers;
            let range = Some(SteppedSizes { least: [a, b], most: [c, d], step: [e, f] });
            let format = StreamFormat { fourcc: *KNOWN[known].0, modifier: KNOWN[known].1 };
            let offer = RoleOffer { role: CameraRole::Raw, format, sizes: vec![[a, d]], range };
            let wish = FormatWish { width: wide, height: high, ..FormatWish::default() };
            if let Some(choice) = choose(&[offer], &wish) {
                let granted = GrantedStream { format, width: choice.offer.width, height: choice.offer.height, stride: f };
                let _ = layout(&granted, false).map(|layout| layout.check());
            }
        }
    }
}
