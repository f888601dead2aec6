//! The calls of the kernel that the standard library lacks: ioctl, mmap, poll.
#![allow(unsafe_code, reason = "system calls")]

use std::ffi::{c_int, c_long, c_short, c_ulong, c_void};
use std::fs::File;
use std::io::{Error, Result};
use std::os::fd::AsRawFd;

unsafe extern "C" {
    fn ioctl(fd: c_int, request: c_ulong, ...) -> c_int;
    fn mmap(
        at: *mut c_void,
        length: usize,
        protection: c_int,
        flags: c_int,
        fd: c_int,
        offset: c_long,
    ) -> *mut c_void;
    fn munmap(at: *mut c_void, length: usize) -> c_int;
    fn poll(files: *mut PollFile, count: c_ulong, timeout_ms: c_int) -> c_int;
}

#[repr(C)]
struct PollFile {
    fd: c_int,
    events: c_short,
    found: c_short,
}

/// What `ready` finds.
pub const POLL_IN: c_short = 1;
/// The device is gone.
pub const POLL_GONE: c_short = 0x18;

/// A request of a driver: direction (1 = in, 2 = out, 3 = both), its letter and number; its size is that of its bytes.
#[derive(Clone, Copy)]
pub struct Request {
    pub direction: u32,
    pub letter: u8,
    pub number: u32,
}

/// Sends a request with its structure, which the driver may change.
pub fn request(file: &File, request: Request, bytes: &mut [u8]) -> Result<()> {
    let code = request.direction << 30
        | (bytes.len() as u32) << 16
        | u32::from(request.letter) << 8
        | request.number;
    // SAFETY: the driver reads and writes as many bytes as the code says, which is the slice's length.
    let result = unsafe { ioctl(file.as_raw_fd(), c_ulong::from(code), bytes.as_mut_ptr()) };
    if result < 0 { Err(Error::last_os_error()) } else { Ok(()) }
}

/// Waits until a file can be read or its device is gone; 0 where neither came in time.
pub fn ready(file: &File, timeout_ms: i32) -> Result<c_short> {
    let mut one = PollFile { fd: file.as_raw_fd(), events: POLL_IN, found: 0 };
    // SAFETY: one structure, which lives through the call.
    match unsafe { poll(&raw mut one, 1, timeout_ms) } {
        0.. => Ok(one.found),
        _ => Err(Error::last_os_error()),
    }
}

/// A buffer of a driver in this process' memory.
pub struct Mapping {
    at: *mut c_void,
    length: usize,
}

impl Mapping {
    pub fn new(file: &File, offset: u32, length: usize) -> Result<Self> {
        // SAFETY: a new mapping for reading, shared with the driver.
        let at = unsafe { mmap(std::ptr::null_mut(), length, 1, 1, file.as_raw_fd(), c_long::from(offset)) };
        if at as isize == -1 { Err(Error::last_os_error()) } else { Ok(Self { at, length }) }
    }

    /// The buffer; only while the driver does not fill it.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: the mapping lives as long as this value, and is as long as this.
        unsafe { std::slice::from_raw_parts(self.at.cast(), self.length) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: the mapping was made by `new` and nothing borrows it any more.
        unsafe { munmap(self.at, self.length) };
    }
}
