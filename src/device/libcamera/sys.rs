//! libcamera itself, through the `libcamera` crate (0.3.0, which is for Debian's libcamera 0.0.3). The only file here with
//! `unsafe`: the library knows no lifetimes as long as ours, and pictures are mapped into the process.
//!
//! libcamera allows one manager in a process. It lives as long as somebody uses it.
#![allow(unsafe_code, reason = "memory is mapped, and borrows of the library outlive what the compiler sees")]

use super::device::{CompletedRequest, RequestDevice};
use super::exposure::{ExposureMetadata, RequestControls, age_ns};
use super::format::{
    self, CameraRole, GrantedStream, PlanePlace, RoleChoice, RoleOffer, SteppedSizes, StreamFormat,
};
use super::list::LibcameraSensor;
use crate::model::pixels::{PixelLayout, PixelMemory};
use crate::v4l2::node::{ENODEV, Ready};
use ::libcamera::{
    camera::{ActiveCamera, Camera, CameraConfiguration},
    camera_manager::{CameraList, CameraManager},
    control::ControlList,
    controls::{
        AeEnable, AnalogueGain, AwbEnable, DigitalGain, ExposureTime, FrameDurationLimits, SensorTimestamp,
    },
    framebuffer::{AsFrameBuffer, FrameMetadataStatus},
    framebuffer_allocator::{FrameBuffer, FrameBufferAllocator},
    geometry::Size,
    logging, pixel_format, properties,
    request::{Request, RequestStatus, ReuseFlag},
    stream::{Stream, StreamRole},
};
use rustix::ioctl::{Opcode, Setter, opcode};
use rustix::mm::{MapFlags, ProtFlags};
use std::ffi::c_void;
use std::io;
use std::mem::transmute;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::PathBuf;
use std::ptr::null_mut;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Buffers that a camera is asked for: three on their way, and one in hand.
const BUFFERS: u32 = 4;
/// More requests than any camera has buffers for: all of them fit into the queue.
const MOST_REQUESTS: usize = 64;
/// A camera is looked for after so long without a request that comes back.
const LOOK_AFTER: Duration = Duration::from_millis(500);
/// A camera whose node is gone is looked for so often, while the library may still be told.
const LOOK_AGAIN_AFTER: Duration = Duration::from_millis(50);
const MOST_LOOKS: u32 = 20;
/// `DMA_BUF_IOCTL_SYNC`: says that the processor begins or ends to read.
const DMA_BUF_SYNC: Opcode = opcode::write::<u64>(b'b', 0);
const BEGIN_READING: u64 = 1;
const END_READING: u64 = 1 | 1 << 2;

/// The one manager of the process, and how many use it.
struct SharedManager {
    manager: Option<CameraManager>,
    users: usize,
    /// One that could not be started is never freed by the crate, and a second ends the process.
    has_failed: bool,
}

// SAFETY: the manager may be called from any thread; the lock keeps the calls apart.
unsafe impl Send for SharedManager {}

static MANAGER: Mutex<SharedManager> =
    Mutex::new(SharedManager { manager: None, users: 0, has_failed: false });

/// Keeps the manager alive; the last one ends it, under the lock, so that there are never two.
pub struct ManagerUse;

impl ManagerUse {
    /// Starts the manager where none runs, which takes some 100 ms.
    pub fn begin() -> io::Result<Self> {
        let mut shared = MANAGER.lock().unwrap_or_else(PoisonError::into_inner);
        if shared.has_failed {
            return Err(io::Error::other("libcamera could not be started"));
        }
        if shared.manager.is_none() {
            // The library writes to the standard error output by itself.
            if !tracing::enabled!(tracing::Level::DEBUG) {
                let _ = logging::log_set_target(logging::LoggingTarget::None);
            }
            let started = CameraManager::new().map_err(of_library);
            shared.has_failed = started.is_err();
            shared.manager = Some(started?);
        }
        shared.users += 1;
        Ok(Self)
    }

    fn cameras<T>(&self, look: impl FnOnce(&CameraList<'_>) -> T) -> io::Result<T> {
        let shared = MANAGER.lock().unwrap_or_else(PoisonError::into_inner);
        let manager = shared.manager.as_ref().ok_or_else(|| io::Error::other("libcamera has ended"))?;
        Ok(look(&manager.cameras()))
    }
}

impl Drop for ManagerUse {
    fn drop(&mut self) {
        let mut shared = MANAGER.lock().unwrap_or_else(PoisonError::into_inner);
        shared.users -= 1;
        if shared.users == 0 {
            shared.manager = None;
        }
    }
}

/// The crate takes libcamera's errors, which are negative, as the kernel's, which are not.
fn of_library(error: io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(number) if number < 0 => io::Error::from_raw_os_error(number.saturating_neg()),
        _ => error,
    }
}

fn all<'a>(list: &'a CameraList<'_>) -> impl Iterator<Item = Camera<'a>> {
    (0..list.len()).filter_map(|k| list.get(k))
}

/// All cameras that libcamera lists.
pub fn sensors() -> io::Result<Vec<LibcameraSensor>> {
    let listed = |camera: Camera<'_>| {
        let id = camera.id().to_owned();
        let model = camera.properties().get::<properties::Model>().map_or_else(|_| id.clone(), |m| m.0);
        LibcameraSensor { id, model, offers: offers(&camera) }
    };
    ManagerUse::begin()?.cameras(|list| all(list).map(listed).collect())
}

fn stream_role(role: CameraRole) -> StreamRole {
    match role {
        CameraRole::Viewfinder => StreamRole::ViewFinder,
        CameraRole::StillCapture => StreamRole::StillCapture,
        CameraRole::Raw => StreamRole::Raw,
    }
}

fn offers(camera: &Camera<'_>) -> Vec<RoleOffer> {
    let mut offers = Vec::new();
    for role in CameraRole::ALL {
        // A camera without an image processor may have no such role.
        let Some(config) = camera.generate_configuration(&[stream_role(role)]) else { continue };
        let Some(stream) = config.get(0) else { continue };
        let formats = stream.formats();
        for named in formats.pixel_formats().into_iter() {
            let format = StreamFormat { fourcc: named.fourcc().to_le_bytes(), modifier: named.modifier() };
            let sides = |size: Size| [size.width, size.height];
            let range = formats.range(named);
            let range = SteppedSizes {
                least: sides(range.min),
                most: sides(range.max),
                step: [range.h_step, range.v_step],
            };
            let sizes = formats.sizes(named).into_iter().map(sides).collect();
            offers.push(RoleOffer { role, format, sizes, range: Some(range) });
        }
    }
    offers
}

/// Which controls a camera's requests take. The library has no binding for the list: what is not taken is not there after it was
/// written.
#[derive(Clone, Copy, Debug, Default)]
struct TakenControls {
    exposure: bool,
    gain: bool,
    frame_duration: bool,
    auto_exposure: bool,
    auto_white_balance: bool,
}

impl TakenControls {
    const EVERY: Self = Self {
        exposure: true,
        gain: true,
        frame_duration: true,
        auto_exposure: true,
        auto_white_balance: true,
    };

    fn find(list: &mut ControlList, controls: &RequestControls) -> Self {
        Self::EVERY.write(list, controls);
        Self {
            exposure: list.get::<ExposureTime>().is_ok(),
            gain: list.get::<AnalogueGain>().is_ok(),
            frame_duration: list.get::<FrameDurationLimits>().is_ok(),
            auto_exposure: list.get::<AeEnable>().is_ok(),
            auto_white_balance: list.get::<AwbEnable>().is_ok(),
        }
    }

    /// What a camera does not take is left out: the library would complain with every request.
    fn write(&self, list: &mut ControlList, controls: &RequestControls) {
        let RequestControls { exposure_us, gain, frame_us } = *controls;
        let written = [
            self.auto_exposure.then(|| list.set(AeEnable(false))),
            self.auto_white_balance.then(|| list.set(AwbEnable(false))),
            self.exposure.then(|| list.set(ExposureTime(exposure_us))),
            self.gain.then(|| list.set(AnalogueGain(gain))),
            self.frame_duration.then(|| list.set(FrameDurationLimits(frame_us))),
        ];
        // `find` tells which were taken.
        drop(written);
    }
}

/// A buffer of the camera, mapped into the process; valid for as long as it is mapped, whatever becomes of the camera.
pub struct PlaneMapping {
    at: *mut c_void,
    begin: usize,
    end: usize,
    dma_buf: OwnedFd,
}

// SAFETY: the memory belongs to this mapping alone, and is only read.
unsafe impl Send for PlaneMapping {}
// SAFETY: as above; the camera writes to it only while its request is queued, and then nobody holds it.
unsafe impl Sync for PlaneMapping {}

impl PixelMemory for PlaneMapping {
    fn bytes(&self) -> &[u8] {
        // SAFETY: mapped up to `end`, until dropped, and `begin` is before it.
        unsafe { std::slice::from_raw_parts(self.at.cast::<u8>().add(self.begin), self.end - self.begin) }
    }

    fn dma_buf(&self) -> Option<BorrowedFd<'_>> {
        Some(self.dma_buf.as_fd())
    }
}

impl Drop for PlaneMapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `map` with this length, and unmapped once.
        let _ = unsafe { rustix::mm::munmap(self.at, self.end) };
    }
}

fn map(buffer: &FrameBuffer, layout: &PixelLayout) -> io::Result<(PlaneMapping, OwnedFd)> {
    let place = |k| {
        let planes = buffer.planes();
        let plane = planes.get(k)?;
        Some(PlanePlace { fd: plane.fd(), offset: plane.offset().unwrap_or(0), length: plane.len() })
    };
    let planes: Vec<PlanePlace> = (0..).map_while(place).collect();
    let [begin, end] = format::one_piece(&planes, layout.stride * layout.height)
        .ok_or_else(|| io::Error::other("its pictures lie in several pieces of memory"))?;
    // SAFETY: the descriptor is open for as long as the buffer is.
    let fd = unsafe { BorrowedFd::borrow_raw(planes[0].fd) };
    let (kept, dma_buf) = (fd.try_clone_to_owned()?, fd.try_clone_to_owned()?);
    // SAFETY: a new mapping at a place of the kernel's choice.
    let at = unsafe { rustix::mm::mmap(null_mut(), end, ProtFlags::READ, MapFlags::SHARED, fd, 0)? };
    Ok((PlaneMapping { at, begin, end, dma_buf }, kept))
}

/// Tells the memory's owner about the processor's reading, so that its caches are right.
fn sync(fd: &OwnedFd, what: u64) {
    // SAFETY: the number was made from the type that is handed over.
    let told = unsafe { rustix::ioctl::ioctl(fd.as_fd(), Setter::<DMA_BUF_SYNC, u64>::new(what)) };
    // Memory of another kind knows no such call, and needs none.
    let _ = told;
}

/// A camera of libcamera in the hands of this process. Its fields go in their order: requests before the camera, that before the
/// manager.
pub struct LibrarySensor {
    id: String,
    /// Those that are here, by number.
    requests: Vec<Option<Request>>,
    /// One that came while somebody waited.
    arrived: Option<Request>,
    returned: Receiver<Request>,
    memory: Vec<OwnedFd>,
    stream: Option<Stream>,
    config: Option<CameraConfiguration>,
    takes: TakenControls,
    /// How long no request has come back.
    silent: Duration,
    /// The media controllers that the library had open when the camera was taken.
    controllers: Vec<PathBuf>,
    active: Option<ActiveCamera<'static>>,
    camera: Option<Camera<'static>>,
    manager: ManagerUse,
}

// SAFETY: the library lets a camera be used from any thread, from one at a time.
unsafe impl Send for LibrarySensor {}

impl LibrarySensor {
    /// Takes a camera by libcamera's name.
    pub fn open(id: &str) -> io::Result<Self> {
        let manager = ManagerUse::begin()?;
        let found = manager.cameras(|list| {
            let camera = all(list).find(|camera| camera.id() == id)?;
            // SAFETY: the library counts who holds a camera; it must go before the manager, and does.
            Some(unsafe { transmute::<Camera<'_>, Camera<'static>>(camera) })
        })?;
        let camera = found.ok_or_else(|| io::Error::from_raw_os_error(ENODEV))?;
        let active = camera.acquire().map_err(of_library)?;
        // SAFETY: it holds the camera by itself, and must go before the manager, and does.
        let mut active = unsafe { transmute::<ActiveCamera<'_>, ActiveCamera<'static>>(active) };
        let (sender, returned) = sync_channel(MOST_REQUESTS);
        // Called in the library's thread. It lives as long as the receiver, which goes after `active`.
        active.on_request_completed(move |request| {
            let _ = sender.try_send(request);
        });
        Ok(Self {
            id: id.to_owned(),
            requests: Vec::new(),
            arrived: None,
            returned,
            memory: Vec::new(),
            stream: None,
            config: None,
            takes: TakenControls::default(),
            silent: Duration::ZERO,
            controllers: open_controllers(),
            active: Some(active),
            camera: Some(camera),
            manager,
        })
    }

    fn active(&mut self) -> io::Result<&mut ActiveCamera<'static>> {
        self.active.as_mut().ok_or_else(|| io::Error::from_raw_os_error(ENODEV))
    }

    /// Whether the library lists it: where a udevd runs, it does no more when the camera was pulled out.
    fn is_listed(&self) -> bool {
        self.manager.cameras(|list| all(list).any(|camera| camera.id() == self.id)).unwrap_or(false)
    }

    /// Whether the nodes of its controllers are there. One may be another camera's; to open this one again does no harm.
    fn has_nodes(&self) -> bool {
        self.controllers.iter().all(|node| node.exists())
    }

    /// Whether it may be stopped. libcamera 0.0.3 ends the whole process where a camera is stopped that is gone and that it still
    /// lists: its requests cannot come back.
    fn can_be_stopped(&self) -> bool {
        let waits = || {
            let _ = self.returned.recv_timeout(LOOK_AGAIN_AFTER);
        };
        for _ in 0..MOST_LOOKS {
            if self.has_nodes() || !self.is_listed() {
                return true;
            }
            waits();
        }
        false
    }
}

impl RequestDevice for LibrarySensor {
    type Memory = PlaneMapping;

    fn offers(&self) -> io::Result<Vec<RoleOffer>> {
        Ok(self.camera.as_ref().map(offers).unwrap_or_default())
    }

    fn configure(&mut self, choice: &RoleChoice) -> io::Result<GrantedStream> {
        let none = || io::Error::other("libcamera has no stream for it");
        let mut config =
            self.active()?.generate_configuration(&[stream_role(choice.role)]).ok_or_else(none)?;
        let mut stream = config.get_mut(0).ok_or_else(none)?;
        let StreamFormat { fourcc, modifier } = choice.format;
        stream.set_pixel_format(pixel_format::PixelFormat::new(u32::from_le_bytes(fourcc), modifier));
        stream.set_size(Size { width: choice.offer.width, height: choice.offer.height });
        stream.set_buffer_count(BUFFERS);
        if config.validate().is_invalid() {
            return Err(io::Error::other("libcamera refuses it"));
        }
        self.active()?.configure(&mut config).map_err(of_library)?;
        let granted = config.get(0).ok_or_else(none)?;
        let (named, size) = (granted.get_pixel_format(), granted.get_size());
        let format = StreamFormat { fourcc: named.fourcc().to_le_bytes(), modifier: named.modifier() };
        let stride = granted.get_stride();
        self.stream = granted.stream();
        self.config = Some(config);
        Ok(GrantedStream { format, width: size.width, height: size.height, stride })
    }

    fn start(&mut self, layout: &PixelLayout, controls: &RequestControls) -> io::Result<Vec<PlaneMapping>> {
        let none = || io::Error::other("libcamera has no stream for it");
        let stream = self.stream.ok_or_else(none)?;
        let mut allocator = FrameBufferAllocator::new(self.active()?);
        let mut mappings = Vec::new();
        for buffer in allocator.alloc(&stream).map_err(of_library)? {
            let (mapping, fd) = map(&buffer, layout)?;
            let number = self.requests.len() as u64;
            let mut request = self.active()?.create_request(Some(number)).ok_or_else(none)?;
            request.add_buffer(&stream, buffer).map_err(of_library)?;
            self.takes = TakenControls::find(request.controls_mut(), controls);
            self.requests.push(Some(request));
            self.memory.push(fd);
            mappings.push(mapping);
        }
        let mut first = ControlList::new();
        self.takes.write(&mut first, controls);
        self.active()?.start(Some(&first)).map_err(of_library)?;
        Ok(mappings)
    }

    fn takes_exposures(&self) -> bool {
        self.takes.exposure
    }

    fn queue(&mut self, index: usize, controls: &RequestControls) -> io::Result<()> {
        let none = || io::Error::other("libcamera still has this request");
        let mut request = self.requests.get_mut(index).and_then(Option::take).ok_or_else(none)?;
        sync(&self.memory[index], END_READING);
        request.reuse(ReuseFlag::REUSE_BUFFERS);
        self.takes.write(request.controls_mut(), controls);
        self.active()?.queue_request(request).map_err(of_library)
    }

    fn completed(&mut self) -> Option<CompletedRequest> {
        let request = self.arrived.take().or_else(|| self.returned.try_recv().ok())?;
        self.silent = Duration::ZERO;
        let index = request.cookie() as usize;
        let mut completed = CompletedRequest { index, has_error: true, ..CompletedRequest::default() };
        let buffer: Option<&FrameBuffer> = self.stream.and_then(|stream| request.buffer(&stream));
        let told =
            buffer.and_then(FrameBuffer::metadata).filter(|_| request.status() == RequestStatus::Complete);
        if let Some(told) = told {
            completed.has_error = told.status() != FrameMetadataStatus::Success;
            completed.used = told.planes().into_iter().map(|plane| plane.bytes_used as usize).sum();
            completed.sequence = told.sequence();
        }
        let stated = request.metadata();
        completed.metadata = ExposureMetadata {
            exposure_us: stated.get::<ExposureTime>().ok().map(|time| time.0),
            analogue_gain: stated.get::<AnalogueGain>().ok().map(|gain| gain.0),
            digital_gain: stated.get::<DigitalGain>().ok().map(|gain| gain.0),
        };
        let stamp_ns = stated.get::<SensorTimestamp>().ok().map(|stamp| stamp.0);
        completed.age_ns =
            stamp_ns.and_then(|stamp| age_ns(stamp, crate::clock::monotonic_ns(), since_boot_ns()));
        sync(self.memory.get(index)?, BEGIN_READING);
        *self.requests.get_mut(index)? = Some(request);
        Some(completed)
    }

    fn wait(&mut self, longest: Duration) -> io::Result<Ready> {
        if self.arrived.is_none() {
            match self.returned.recv_timeout(longest) {
                Ok(request) => self.arrived = Some(request),
                Err(RecvTimeoutError::Disconnected) => return Ok(Ready::Gone),
                Err(RecvTimeoutError::Timeout) => {
                    self.silent = self.silent.saturating_add(longest);
                    if self.silent < LOOK_AFTER {
                        return Ok(Ready::Nothing);
                    }
                    self.silent = Duration::ZERO;
                    // Requests of a camera that was pulled out never come back, and nobody says so.
                    let is_there = self.has_nodes() && self.is_listed();
                    return Ok(if is_there { Ready::Nothing } else { Ready::Gone });
                }
            }
        }
        Ok(Ready::Filled)
    }
}

impl Drop for LibrarySensor {
    fn drop(&mut self) {
        let can_be_stopped = self.can_be_stopped();
        let Some(mut active) = self.active.take() else { return };
        if !can_be_stopped {
            tracing::warn!(
                "libcamera does not see that {} was pulled out: no udevd runs; it stays open",
                self.id
            );
            // All that belongs to it stays, and the manager with it.
            self.requests.drain(..).for_each(std::mem::forget);
            std::mem::forget((active, self.config.take(), self.camera.take(), ManagerUse::begin()));
            return;
        }
        let _ = active.stop();
        // All requests come back when it stops; they go before the camera is let go.
        while self.returned.try_recv().is_ok() {}
        self.arrived = None;
        self.requests.clear();
    }
}

/// Media controllers that this process has open.
fn open_controllers() -> Vec<PathBuf> {
    let open = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let nodes = open.filter_map(|fd| std::fs::read_link(fd.path()).ok());
    nodes.filter(|node| node.to_string_lossy().starts_with("/dev/media") && node.exists()).collect()
}

/// Time since the machine was started, with that in which it slept.
fn since_boot_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec)
}
