//! Layouts, bounds, and memory that goes back to its owner.

use super::*;
use proptest::prelude::*;

fn formats() -> Vec<PixelFormat> {
    let bayer = BayerOrder::ALL
        .iter()
        .flat_map(|order| BayerDepth::ALL.iter().map(move |depth| PixelFormat::Bayer(*order, *depth)));
    let plain = [
        PixelFormat::Rgb24,
        PixelFormat::Yuyv,
        PixelFormat::Uyvy,
        PixelFormat::Nv12,
        PixelFormat::Grey,
        PixelFormat::Mjpeg,
    ];
    plain.into_iter().chain(bayer).collect()
}

proptest! {
    /// Exactly the pictures that fit are taken, and every row of what was taken can be read.
    #[test]
    fn what_is_taken_can_be_read_and_what_is_short_is_refused(
        which in 0usize..30, width in 1usize..40, height in 1usize..20, padding in 0usize..9, missing in 0usize..3,
    ) {
        let format = formats()[which];
        let mut layout = PixelLayout::packed(format, width, height);
        layout.stride += padding;
        let least = layout.least_bytes();
        let memory: Arc<dyn PixelMemory> = Arc::new(vec![7u8; least + 5]);
        let pixels = FramePixels::new(layout, Arc::clone(&memory), least - missing);
        prop_assert_eq!(pixels.is_ok(), missing == 0);
        if let Ok(pixels) = pixels {
            prop_assert_eq!(pixels.bytes().len(), least);
            for y in 0..layout.rows_in_memory() {
                prop_assert_eq!(pixels.row(y).len(), layout.row_bytes());
            }
        }
        if format != PixelFormat::Mjpeg {
            layout.stride = layout.row_bytes() - 1;
            let is_stride = matches!(
                FramePixels::new(layout, memory, least),
                Err(PixelError::Stride { .. })
            );
            prop_assert!(is_stride);
        }
    }

    /// Packed values come back.
    #[test]
    fn packed_values_come_back(values in prop::collection::vec(0u16..=4095, 1..33)) {
        let ten: Vec<u16> = values.iter().map(|v| v >> 2).collect();
        let mut row = vec![0u8; BayerDepth::Bits10Packed.row_bytes(ten.len())];
        for (x, v) in ten.iter().enumerate() {
            row[x / 4 * 5 + x % 4] = (v >> 2) as u8;
            row[x / 4 * 5 + 4] |= ((v & 3) << (2 * (x % 4))) as u8;
        }
        for (x, v) in ten.iter().enumerate() {
            prop_assert_eq!(BayerDepth::Bits10Packed.value(&row, x), *v);
        }
        let mut row = vec![0u8; BayerDepth::Bits12Packed.row_bytes(values.len())];
        for (x, v) in values.iter().enumerate() {
            row[x / 2 * 3 + x % 2] = (v >> 4) as u8;
            row[x / 2 * 3 + 2] |= ((v & 15) << (4 * (x % 2))) as u8;
        }
        for (x, v) in values.iter().enumerate() {
            prop_assert_eq!(BayerDepth::Bits12Packed.value(&row, x), *v);
        }
    }
}

#[test]
fn errors_say_what_was_given_and_what_is_needed() {
    let memory = |n: usize| Arc::new(vec![0u8; n]);
    let text = |layout, n, used| FramePixels::new(layout, memory(n), used).unwrap_err().to_string();
    let layout = PixelLayout::packed(PixelFormat::Yuyv, 5, 2);
    assert_eq!(text(layout, 30, 23), "Yuyv, 5 x 2: 23 bytes were given, must be at least 24");
    assert_eq!(text(layout, 20, 24), "24 bytes were filled of a buffer of 20");
    let narrow = PixelLayout { stride: 11, ..layout };
    assert_eq!(text(narrow, 30, 30), "Yuyv, 5 pixels wide: the stride is 11 bytes, must be at least 12");
    let wide = PixelLayout { stride: usize::MAX / 2, ..layout };
    assert!(text(wide, 30, 30).contains("must be at least 12"));
    for (width, height) in [(0, 1), (1, 0), (usize::MAX, 1), (1, 16385)] {
        let layout = PixelLayout { width, height, ..PixelLayout::packed(PixelFormat::Grey, 1, 1) };
        assert!(text(layout, 4, 4).contains("each must be within 1..=16384"));
    }
    for row_time_s in [-1e-6, 0.1, f64::NAN] {
        assert!(text(PixelLayout { row_time_s, ..layout }, 30, 30).contains("row_time_s"));
    }
}

#[test]
fn rows_have_their_own_times() {
    let layout = PixelLayout { row_time_s: 1e-5, ..PixelLayout::packed(PixelFormat::Grey, 4, 480) };
    assert!((layout.seconds_of_row(0.0) + 239.5e-5).abs() < 1e-12);
    assert!((layout.seconds_of_row(479.0) - 239.5e-5).abs() < 1e-12);
    assert!(layout.seconds_of_row(239.5).abs() < 1e-12);
}

#[test]
fn an_image_of_ours_is_itself() {
    let image = Arc::new(Rgb8Image::filled(3, 2, [1, 2, 3]));
    let pixels = FramePixels::from(Arc::clone(&image));
    assert!(Arc::ptr_eq(pixels.as_image().unwrap(), &image));
    assert_eq!((pixels.width(), pixels.height(), pixels.bytes().len()), (3, 2, 18));
    assert_eq!(pixels.row(1), [1, 2, 3, 1, 2, 3, 1, 2, 3]);
}

#[test]
fn buffers_go_back_to_their_owner_when_the_last_holder_lets_go() {
    let layout = PixelLayout::packed(PixelFormat::Grey, 2, 2);
    let mut pool = PixelPool::new((0..3).map(|k| vec![k as u8; 4]));
    let first = pool.lend(0, layout, 4).unwrap().unwrap();
    let second = pool.lend(1, layout, 4).unwrap().unwrap();
    assert!(pool.lend(0, layout, 4).is_none() && pool.lend(9, layout, 4).is_none());
    assert!(pool.lend(2, layout, 3).unwrap().is_err(), "too short, and so not lent");
    assert_eq!(pool.take_back(), None);
    let shared = second.clone();
    drop(second);
    assert_eq!((pool.take_back(), shared.bytes()), (None, &[1u8; 4][..]));
    drop((shared, first));
    assert_eq!((pool.take_back(), pool.take_back(), pool.take_back()), (Some(0), Some(1), None));
    // Filled by the program itself: never what is still held.
    let (k, memory) = pool.free().unwrap();
    memory.fill(9);
    let held = pool.lend(k, layout, 4).unwrap().unwrap();
    let (other, _) = pool.free().unwrap();
    assert!(other != k && held.bytes() == [9; 4]);
    // A frame outlives its pool.
    drop(pool);
    assert_eq!(held.bytes(), [9; 4]);
}

#[test]
fn what_a_driver_wrote_before_the_picture_is_left_out() {
    let layout = PixelLayout::packed(PixelFormat::Grey, 3, 2);
    let held: Arc<dyn PixelMemory> = Arc::new((0u8..10).collect::<Vec<u8>>());
    let pixels = |skipped| FramePixels::new(layout, Arc::clone(&held), 9).unwrap().after(skipped);
    assert_eq!((pixels(0).unwrap().row(1), pixels(3).unwrap().row(1)), (&[3, 4, 5][..], &[6, 7, 8][..]));
    assert!(pixels(4).is_err() && pixels(usize::MAX).is_err());
    assert!(pixels(2).unwrap().after(2).is_err());
}
