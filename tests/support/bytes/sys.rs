//! An allocator that knows how many bytes are allocated now. Include it with `#[path = "support/bytes/sys.rs"] mod sys;` from a
//! test file: it then serves that whole test program.
#![allow(unsafe_code, reason = "an allocator has to implement GlobalAlloc")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, Ordering::Relaxed};

/// Bytes that are allocated now, by all threads.
pub fn live_bytes() -> isize {
    LIVE_BYTES.load(Relaxed)
}

/// The most bytes that were allocated at once since [`forget_peak`].
#[allow(dead_code, reason = "not every program asks")]
pub fn peak_bytes() -> isize {
    PEAK_BYTES.load(Relaxed)
}

/// The peak begins anew, at what is allocated now.
#[allow(dead_code, reason = "not every program asks")]
pub fn forget_peak() {
    PEAK_BYTES.store(live_bytes(), Relaxed);
}

struct Weighing;
static LIVE_BYTES: AtomicIsize = AtomicIsize::new(0);
static PEAK_BYTES: AtomicIsize = AtomicIsize::new(0);

fn add(bytes: isize) {
    let live = LIVE_BYTES.fetch_add(bytes, Relaxed) + bytes;
    PEAK_BYTES.fetch_max(live, Relaxed);
}

// SAFETY: hands everything on to the system's allocator.
unsafe impl GlobalAlloc for Weighing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: as the caller promises. The system's own: pages that nobody writes to cost nothing.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        LIVE_BYTES.fetch_sub(layout.size() as isize, Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        add(size as isize - layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Weighing = Weighing;
