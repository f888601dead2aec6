//! An allocator that counts, for tests that nothing is allocated, and tells where an allocation came from. Include it with
//! `#[path = "support/sys.rs"] mod sys;` from a test file: it then serves that whole test program.
#![allow(unsafe_code, reason = "an allocator has to implement GlobalAlloc")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

/// Allocations that are told one by one at most.
const MOST_TOLD: usize = 64;
/// Calls kept of each, the innermost first.
const MOST_CALLS: usize = 64;
/// What is said of an allocation that no function of ours asked for.
const NOT_OURS: &str = "no function of ours";
/// Of our own functions, printed of each.
const OWN_CALLS: usize = 4;

/// What a piece of work allocated. `Display` lists each allocation: its bytes, and which of our functions asked for it.
#[derive(Debug)]
pub struct Allocated {
    /// Allocations and reallocations.
    pub count: usize,
    /// Those of them that a function of ours asked for, directly or through a library; all, where there were more than
    /// can be told one by one.
    #[allow(dead_code, reason = "only some test programs ask")]
    pub ours: usize,
    told: Vec<String>,
}

impl fmt::Display for Allocated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} allocations", self.count)?;
        self.told.iter().try_for_each(|line| write!(f, "\n  {line}"))
    }
}

/// Counts what `work` allocates, in the whole process but for the test harness: its thread, the process' first, tells of
/// tests that take over a minute, at any moment. Where it runs the test itself it counts. One at a time.
pub fn allocated(work: impl FnOnce()) -> Allocated {
    FIRST_COUNTS.store(is_first_thread(), Relaxed);
    // The unwinder makes its tables at the first walk.
    Slot::calls(|_| ());
    COUNT.store(0, Relaxed);
    COUNTS.store(true, Relaxed);
    work();
    COUNTS.store(false, Relaxed);
    let count = COUNT.load(Relaxed);
    let told: Vec<String> = SLOTS.iter().take(count).map(Slot::told).collect();
    let foreign = told.iter().filter(|line| line.ends_with(NOT_OURS)).count();
    Allocated { count, ours: if count > MOST_TOLD { count } else { count - foreign }, told }
}

unsafe extern "C" {
    safe fn getpid() -> i32;
    safe fn gettid() -> i32;
}

fn is_first_thread() -> bool {
    gettid() == getpid()
}

/// One allocation; a fixed place, so that noting it allocates nothing.
struct Slot {
    bytes: AtomicUsize,
    calls: [AtomicUsize; MOST_CALLS],
}

static SLOTS: [Slot; MOST_TOLD] =
    [const { Slot { bytes: AtomicUsize::new(0), calls: [const { AtomicUsize::new(0) }; MOST_CALLS] } };
        MOST_TOLD];
static COUNTS: AtomicBool = AtomicBool::new(false);
static COUNT: AtomicUsize = AtomicUsize::new(0);
static FIRST_COUNTS: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// This thread walks its stack: what the unwinder itself allocates is not counted.
    static WALKS: Cell<bool> = const { Cell::new(false) };
}

fn count(bytes: usize) {
    if !COUNTS.load(Relaxed) || WALKS.get() || (is_first_thread() && !FIRST_COUNTS.load(Relaxed)) {
        return;
    }
    let Some(slot) = SLOTS.get(COUNT.fetch_add(1, Relaxed)) else { return };
    slot.bytes.store(bytes, Relaxed);
    slot.calls.iter().for_each(|call| call.store(0, Relaxed));
    let mut calls = slot.calls.iter();
    Slot::calls(|at| {
        if let Some(call) = calls.next() {
            call.store(at, Relaxed);
        }
    });
}

impl Slot {
    /// Walks this thread's stack, the innermost call first.
    fn calls(mut take: impl FnMut(usize)) {
        WALKS.set(true);
        let mut left = MOST_CALLS;
        // SAFETY: no other thread's walk shares anything that is changed here: names are looked up after the work.
        unsafe {
            backtrace::trace_unsynchronized(|frame| {
                take(frame.ip() as usize);
                left -= 1;
                left > 0
            });
        }
        WALKS.set(false);
    }

    fn told(&self) -> String {
        let mut own = Vec::new();
        for call in self.calls.iter().map(|call| call.load(Relaxed)).take_while(|call| *call != 0) {
            backtrace::resolve(call as *mut std::ffi::c_void, |symbol| {
                let name = symbol.name().map(|name| format!("{name:#}")).unwrap_or_default();
                if name.contains("halflight") && !name.contains("sys::") && own.len() < OWN_CALLS {
                    let line = symbol.lineno().map(|line| format!(":{line}")).unwrap_or_default();
                    own.push(name + &line);
                }
            });
        }
        let from = if own.is_empty() { NOT_OURS.to_owned() } else { own.join(" < ") };
        format!("{} bytes: {from}", self.bytes.load(Relaxed))
    }
}

struct Counting;

// SAFETY: hands everything on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;
