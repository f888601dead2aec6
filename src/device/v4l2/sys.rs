//! The kernel's own calls on a video node, through the types of the `v4l` crate. The only file here with `unsafe`: every call
//! hands the kernel one structure of the size that its number states.
#![allow(unsafe_code, reason = "the kernel takes pointers")]

use super::node::{
    BehindNode, ControlFacts, ControlKind, ControlNode, Filled, FrameRates, Granted, NodeFacts, Offer, Ready,
    VideoNode,
};
use super::sensor;
use crate::model::pixels::PixelMemory;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use std::ffi::c_void;
use std::io;
use std::mem::zeroed;
use std::os::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;
use v4l::v4l_sys as kernel;
use v4l::v4l2::{self, vidioc};

/// Formats, sizes and rates that are asked for: a driver that lists more is cut short.
const MOST_LISTED: u32 = 64;
const MOST_FORMATS: u32 = 256;

/// A video node of the kernel.
pub struct KernelNode {
    device: v4l::Device,
    /// `V4L2_BUF_TYPE_VIDEO_CAPTURE` or its multi-planar twin.
    kind: u32,
    /// The kernel's number of the node.
    number: u64,
}

/// A buffer of the driver, mapped into the process.
pub struct Mapping {
    at: *mut c_void,
    length: usize,
    dma_buf: Option<OwnedFd>,
    /// Keeps the node's descriptor open for as long as the memory is mapped.
    _open: std::sync::Arc<v4l::device::Handle>,
}

// SAFETY: the memory belongs to this mapping alone, and is only read.
unsafe impl Send for Mapping {}
// SAFETY: as above; the driver writes to it only while it is queued, and then nobody holds it.
unsafe impl Sync for Mapping {}

impl PixelMemory for Mapping {
    fn bytes(&self) -> &[u8] {
        // SAFETY: mapped with this length, until dropped.
        unsafe { std::slice::from_raw_parts(self.at.cast(), self.length) }
    }

    fn dma_buf(&self) -> Option<BorrowedFd<'_>> {
        self.dma_buf.as_ref().map(AsFd::as_fd)
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `mmap` with this length, and unmapped once.
        let _ = unsafe { v4l2::munmap(self.at, self.length) };
    }
}

impl KernelNode {
    /// Opens a node without waiting; an error where it is none that captures pictures.
    pub fn open(path: &Path) -> io::Result<Self> {
        let device = v4l::Device::with_path(path)?;
        let number = std::fs::metadata(path)?.rdev();
        let mut node = Self { device, kind: kernel::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE, number };
        if node.facts()?.multi_planar {
            node.kind = kernel::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
        }
        Ok(node)
    }

    fn is_multi_planar(&self) -> bool {
        self.kind == kernel::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
    }

    fn fd(&self) -> RawFd {
        self.device.handle().fd()
    }

    fn call<T>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
        call(self.fd(), request, argument)
    }

    /// Sizes of a format, the largest of a range alone.
    fn sizes(&self, fourcc: u32) -> Vec<[u32; 2]> {
        let mut sizes = Vec::new();
        for index in 0..MOST_LISTED {
            // SAFETY: plain numbers; zero is a value of each.
            let mut asked: kernel::v4l2_frmsizeenum = unsafe { zeroed() };
            (asked.index, asked.pixel_format) = (index, fourcc);
            if self.call(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut asked).is_err() {
                break;
            }
            // SAFETY: `type_` says which part of the union was filled.
            sizes.push(match asked.type_ {
                kernel::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE => unsafe {
                    let size = asked.__bindgen_anon_1.discrete;
                    [size.width, size.height]
                },
                _ => unsafe {
                    let size = asked.__bindgen_anon_1.stepwise;
                    [size.max_width, size.max_height]
                },
            });
            if asked.type_ != kernel::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                sizes.extend(COMMON_SIZES);
                break;
            }
        }
        sizes
    }

    fn rates(&self, fourcc: u32, [width, height]: [u32; 2]) -> FrameRates {
        let mut rates = FrameRates::default();
        for index in 0..MOST_LISTED {
            // SAFETY: plain numbers; zero is a value of each.
            let mut asked: kernel::v4l2_frmivalenum = unsafe { zeroed() };
            (asked.index, asked.pixel_format, asked.width, asked.height) = (index, fourcc, width, height);
            if self.call(vidioc::VIDIOC_ENUM_FRAMEINTERVALS, &mut asked).is_err() {
                break;
            }
            let is_discrete = asked.type_ == kernel::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE;
            // SAFETY: `type_` says which part of the union was filled.
            let shortest = unsafe {
                if is_discrete {
                    asked.__bindgen_anon_1.discrete
                } else {
                    asked.__bindgen_anon_1.stepwise.min
                }
            };
            rates.add(f64::from(shortest.denominator) / f64::from(shortest.numerator));
            if !is_discrete {
                break;
            }
        }
        rates
    }

    /// A buffer's description with room for one plane.
    fn buffer(&self, index: u32, plane: &mut kernel::v4l2_plane) -> kernel::v4l2_buffer {
        // SAFETY: plain numbers and a union of numbers and pointers; zero is a value of each.
        let mut buffer: kernel::v4l2_buffer = unsafe { zeroed() };
        buffer.index = index;
        buffer.type_ = self.kind;
        buffer.memory = kernel::v4l2_memory_V4L2_MEMORY_MMAP;
        if self.is_multi_planar() {
            buffer.m.planes = std::ptr::from_mut(plane);
            buffer.length = 1;
        }
        buffer
    }

    fn map(&self, index: u32) -> io::Result<Mapping> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut plane: kernel::v4l2_plane = unsafe { zeroed() };
        let mut buffer = self.buffer(index, &mut plane);
        self.call(vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
        // SAFETY: the kind of the buffer says which part of the unions was filled.
        let (length, offset) = unsafe {
            match self.is_multi_planar() {
                true => (plane.length, plane.m.mem_offset),
                false => (buffer.length, buffer.m.offset),
            }
        };
        let length = length as usize;
        const READ: i32 = 1;
        const SHARED: i32 = 1;
        // SAFETY: the kernel checks offset and length against the buffer; nothing else is mapped over.
        let at =
            unsafe { v4l2::mmap(std::ptr::null_mut(), length, READ, SHARED, self.fd(), i64::from(offset)) }?;
        Ok(Mapping { at, length, dma_buf: self.export(index), _open: self.device.handle() })
    }

    /// A buffer as a DMA-BUF, for a display or a GPU that takes it without a copy; `None` where the driver exports none.
    fn export(&self, index: u32) -> Option<OwnedFd> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut asked: kernel::v4l2_exportbuffer = unsafe { zeroed() };
        (asked.type_, asked.index, asked.flags) = (self.kind, index, OFlags::CLOEXEC.bits());
        self.call(vidioc::VIDIOC_EXPBUF, &mut asked).ok()?;
        // SAFETY: the kernel has just opened it for this call, and nobody else has it.
        (asked.fd >= 0).then(|| unsafe { OwnedFd::from_raw_fd(asked.fd) })
    }
}

/// Sizes that are tried where a driver offers a whole range.
const COMMON_SIZES: [[u32; 2]; 4] = [[320, 240], [640, 480], [1280, 720], [1920, 1080]];

pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

impl VideoNode for KernelNode {
    type Memory = Mapping;

    fn facts(&self) -> io::Result<NodeFacts> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut found: kernel::v4l2_capability = unsafe { zeroed() };
        self.call(vidioc::VIDIOC_QUERYCAP, &mut found)?;
        let has_own = found.capabilities & kernel::V4L2_CAP_DEVICE_CAPS != 0;
        let able = if has_own { found.device_caps } else { found.capabilities };
        let [single, multi] = [kernel::V4L2_CAP_VIDEO_CAPTURE, kernel::V4L2_CAP_VIDEO_CAPTURE_MPLANE];
        Ok(NodeFacts {
            driver: text(&found.driver),
            card: text(&found.card),
            bus: text(&found.bus_info),
            captures: able & (single | multi) != 0 && able & kernel::V4L2_CAP_STREAMING != 0,
            multi_planar: able & multi != 0 && able & single == 0,
        })
    }

    fn offers(&self) -> io::Result<Vec<Offer>> {
        let mut offers = Vec::new();
        for index in 0..MOST_FORMATS {
            // SAFETY: plain numbers; zero is a value of each.
            let mut asked: kernel::v4l2_fmtdesc = unsafe { zeroed() };
            (asked.index, asked.type_) = (index, self.kind);
            match self.call(vidioc::VIDIOC_ENUM_FMT, &mut asked) {
                Ok(()) => {}
                Err(error) if error.raw_os_error() == Some(super::node::EINVAL) => break,
                Err(error) => return Err(error),
            }
            let fourcc = asked.pixelformat.to_le_bytes();
            for size in self.sizes(asked.pixelformat) {
                let rates = self.rates(asked.pixelformat, size);
                offers.push(Offer { fourcc, width: size[0], height: size[1], rates });
            }
        }
        Ok(offers)
    }

    fn set_format(&mut self, fourcc: [u8; 4], width: u32, height: u32) -> io::Result<Granted> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut format: kernel::v4l2_format = unsafe { zeroed() };
        format.type_ = self.kind;
        let fourcc = u32::from_le_bytes(fourcc);
        if self.is_multi_planar() {
            // SAFETY: plain numbers; the kind says that this part of the union is meant.
            let wish = unsafe { &mut format.fmt.pix_mp };
            (wish.width, wish.height, wish.pixelformat, wish.num_planes) = (width, height, fourcc, 1);
        } else {
            // SAFETY: as above.
            let wish = unsafe { &mut format.fmt.pix };
            (wish.width, wish.height, wish.pixelformat) = (width, height, fourcc);
        }
        self.call(vidioc::VIDIOC_S_FMT, &mut format)?;
        // SAFETY: as above.
        Ok(unsafe {
            if self.is_multi_planar() {
                let got = format.fmt.pix_mp;
                let planes = got.plane_fmt;
                Granted {
                    fourcc: { got.pixelformat }.to_le_bytes(),
                    width: got.width,
                    height: got.height,
                    stride: { planes[0] }.bytesperline,
                    planes: u32::from(got.num_planes),
                    colour_space: got.colorspace,
                    encoding: u32::from(got.__bindgen_anon_1.ycbcr_enc),
                    quantization: u32::from(got.quantization),
                }
            } else {
                let got = format.fmt.pix;
                Granted {
                    fourcc: got.pixelformat.to_le_bytes(),
                    width: got.width,
                    height: got.height,
                    stride: got.bytesperline,
                    planes: 1,
                    colour_space: got.colorspace,
                    encoding: got.__bindgen_anon_1.ycbcr_enc,
                    quantization: got.quantization,
                }
            }
        })
    }

    fn set_rate(&mut self, frames_per_s: f64) -> io::Result<f64> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut wish: kernel::v4l2_streamparm = unsafe { zeroed() };
        wish.type_ = self.kind;
        wish.parm.capture.timeperframe =
            kernel::v4l2_fract { numerator: 1000, denominator: (1000.0 * frames_per_s).round() as u32 };
        self.call(vidioc::VIDIOC_S_PARM, &mut wish)?;
        // SAFETY: the kind says that the capture part was filled.
        let got = unsafe { wish.parm.capture.timeperframe };
        Ok(f64::from(got.denominator) / f64::from(got.numerator))
    }

    fn buffers(&mut self, count: u32) -> io::Result<Vec<Mapping>> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut asked: kernel::v4l2_requestbuffers = unsafe { zeroed() };
        (asked.count, asked.type_) = (count, self.kind);
        asked.memory = kernel::v4l2_memory_V4L2_MEMORY_MMAP;
        self.call(vidioc::VIDIOC_REQBUFS, &mut asked)?;
        (0..asked.count).map(|index| self.map(index)).collect()
    }

    fn queue(&mut self, index: usize) -> io::Result<()> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut plane: kernel::v4l2_plane = unsafe { zeroed() };
        let mut buffer = self.buffer(index as u32, &mut plane);
        self.call(vidioc::VIDIOC_QBUF, &mut buffer)
    }

    fn dequeue(&mut self) -> io::Result<Option<Filled>> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut plane: kernel::v4l2_plane = unsafe { zeroed() };
        let mut buffer = self.buffer(0, &mut plane);
        match self.call(vidioc::VIDIOC_DQBUF, &mut buffer) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(error),
        }
        let (used, skipped) = match self.is_multi_planar() {
            true => (plane.bytesused, plane.data_offset),
            false => (buffer.bytesused, 0),
        };
        let has = |bits: u32, mask: u32| buffer.flags & mask == bits;
        let time = buffer.timestamp;
        Ok(Some(Filled {
            index: buffer.index as usize,
            used: used as usize,
            skipped: skipped as usize,
            sequence: buffer.sequence,
            time_ns: time.tv_sec * 1_000_000_000 + time.tv_usec * 1000,
            has_error: has(kernel::V4L2_BUF_FLAG_ERROR, kernel::V4L2_BUF_FLAG_ERROR),
            is_monotonic: has(
                kernel::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
                kernel::V4L2_BUF_FLAG_TIMESTAMP_MASK,
            ),
            at_start: has(kernel::V4L2_BUF_FLAG_TSTAMP_SRC_SOE, kernel::V4L2_BUF_FLAG_TSTAMP_SRC_MASK),
        }))
    }

    fn start(&mut self) -> io::Result<()> {
        let mut kind = self.kind;
        self.call(vidioc::VIDIOC_STREAMON, &mut kind)
    }

    fn stop(&mut self) -> io::Result<()> {
        let mut kind = self.kind;
        self.call(vidioc::VIDIOC_STREAMOFF, &mut kind)
    }

    fn wait(&mut self, longest: Duration) -> io::Result<Ready> {
        // SAFETY: the descriptor is open as long as `self.device` is.
        let fd = unsafe { BorrowedFd::borrow_raw(self.fd()) };
        let mut asked = [PollFd::new(&fd, PollFlags::IN)];
        let longest = Timespec::try_from(longest).unwrap_or_default();
        match poll(&mut asked, Some(&longest)) {
            Ok(0) | Err(rustix::io::Errno::INTR) => return Ok(Ready::Nothing),
            Ok(_) => {}
            Err(error) => return Err(error.into()),
        }
        let got = asked[0].revents();
        // A camera that was pulled out reports an error as long as it is open.
        let is_gone = got.intersects(PollFlags::HUP | PollFlags::NVAL)
            || got.contains(PollFlags::ERR) && !got.contains(PollFlags::IN);
        Ok(if is_gone { Ready::Gone } else { Ready::Filled })
    }

    fn sensor(&self) -> Option<BehindNode> {
        sensor::sys::behind(self.number)
    }
}

impl ControlNode for KernelNode {
    fn control_facts(&self, id: u32) -> Option<ControlFacts> {
        control_facts(self.fd(), id)
    }

    fn control(&self, id: u32) -> io::Result<i32> {
        control(self.fd(), id)
    }

    fn wide_control(&self, id: u32) -> io::Result<i64> {
        wide_control(self.fd(), id)
    }

    fn set_control(&self, id: u32, value: i32) -> io::Result<i32> {
        set_control(self.fd(), id, value)
    }
}

/// Hands the kernel one structure.
pub(super) fn call<T>(fd: RawFd, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
    // SAFETY: each caller pairs the request with the structure that its number was made from.
    unsafe { v4l2::ioctl(fd, request, std::ptr::from_mut(argument).cast()) }
}

/// The range of a control.
pub(super) fn control_facts(fd: RawFd, id: u32) -> Option<ControlFacts> {
    // SAFETY: plain numbers; zero is a value of each.
    let mut asked: kernel::v4l2_queryctrl = unsafe { zeroed() };
    asked.id = id;
    call(fd, vidioc::VIDIOC_QUERYCTRL, &mut asked).ok()?;
    let has = |flag: u32| asked.flags & flag != 0;
    Some(ControlFacts {
        id,
        name: text(&asked.name),
        kind: match asked.type_ {
            kernel::v4l2_ctrl_type_V4L2_CTRL_TYPE_MENU => ControlKind::Menu,
            kernel::v4l2_ctrl_type_V4L2_CTRL_TYPE_BOOLEAN => ControlKind::Switch,
            _ => ControlKind::Number,
        },
        least: asked.minimum,
        most: asked.maximum,
        step: asked.step.max(1),
        default: asked.default_value,
        can_be_set: !has(kernel::V4L2_CTRL_FLAG_READ_ONLY) && !has(kernel::V4L2_CTRL_FLAG_DISABLED),
    })
}

/// The value of a control.
pub(super) fn control(fd: RawFd, id: u32) -> io::Result<i32> {
    let mut control = kernel::v4l2_control { id, value: 0 };
    call(fd, vidioc::VIDIOC_G_CTRL, &mut control).map(|()| control.value)
}

/// The value of a control of 64 bits.
pub(super) fn wide_control(fd: RawFd, id: u32) -> io::Result<i64> {
    // SAFETY: plain numbers and unions of numbers and pointers; zero is a value of each.
    let (mut one, mut all): (kernel::v4l2_ext_control, kernel::v4l2_ext_controls) =
        unsafe { (zeroed(), zeroed()) };
    one.id = id;
    (all.count, all.controls) = (1, std::ptr::from_mut(&mut one));
    call(fd, vidioc::VIDIOC_G_EXT_CTRLS, &mut all)?;
    // SAFETY: callers ask for controls of 64 bits, for which this part of the union is filled; it is 0 for others.
    Ok(unsafe { one.__bindgen_anon_1.value64 })
}

/// Writes a control; returns what was taken.
pub(super) fn set_control(fd: RawFd, id: u32, value: i32) -> io::Result<i32> {
    let mut control = kernel::v4l2_control { id, value };
    call(fd, vidioc::VIDIOC_S_CTRL, &mut control).map(|()| control.value)
}
