//! An allocator that counts, for tests that nothing is allocated. Include it with
//! `#[path = "support/sys.rs"] mod sys;` from a test file: it then serves that whole test program.
#![allow(unsafe_code, reason = "an allocator has to implement GlobalAlloc")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicIsize, AtomicUsize, Ordering};

/// Allocations and reallocations so far, of the whole process but for the test harness: its thread, the process' first, tells of
/// tests that take over a minute, at any moment. Where it runs the test itself it counts.
#[allow(dead_code, reason = "not every test that counts bytes asks for it")]
pub fn allocations() -> usize {
    if is_first_thread() {
        FIRST_COUNTS.store(true, Ordering::Relaxed);
    }
    ALLOCATIONS.load(Ordering::Relaxed)
}

/// Bytes that are allocated now, by all threads.
#[allow(dead_code, reason = "not every test that counts allocations asks for it")]
pub fn live_bytes() -> isize {
    LIVE_BYTES.load(Ordering::Relaxed)
}

unsafe extern "C" {
    safe fn getpid() -> i32;
    safe fn gettid() -> i32;
}

fn is_first_thread() -> bool {
    gettid() == getpid()
}

fn count() {
    if FIRST_COUNTS.load(Ordering::Relaxed) || !is_first_thread() {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
    }
}

struct Counting;
static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);
static LIVE_BYTES: AtomicIsize = AtomicIsize::new(0);
static FIRST_COUNTS: AtomicBool = AtomicBool::new(false);

// SAFETY: hands everything on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        LIVE_BYTES.fetch_add(layout.size() as isize, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        LIVE_BYTES.fetch_sub(layout.size() as isize, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        LIVE_BYTES.fetch_add(size as isize - layout.size() as isize, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;
