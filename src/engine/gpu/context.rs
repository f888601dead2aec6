//! Opens an adapter, says clearly why when it cannot, and waits for the device.
//!
//! Mesa's loader prints a line about `XDG_RUNTIME_DIR` where that variable is unset, and EGL one about DRI2
//! where there is no `/dev/dri`; both are harmless (`XDG_RUNTIME_DIR=/tmp EGL_LOG_LEVEL=fatal` silences them).
//! `WGPU_VALIDATION=1` asks for the driver's validation layer.

use std::sync::{Arc, Mutex, PoisonError};

use super::live::LiveList;
use crate::EngineError;

/// Which interface the GPU is driven through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Backend {
    /// The first choice where there is a driver.
    Vulkan,
    /// OpenGL 4.3 or OpenGL ES 3.1, or later.
    Gl,
}

impl Backend {
    /// All, in the order in which they are tried.
    pub const ALL: [Self; 2] = [Self::Vulkan, Self::Gl];

    /// As people call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vulkan => "Vulkan",
            Self::Gl => "GL",
        }
    }

    const fn bits(self) -> wgpu::Backends {
        match self {
            Self::Vulkan => wgpu::Backends::VULKAN,
            Self::Gl => wgpu::Backends::GL,
        }
    }
}

/// Storage buffers that a kernel may bind in one stage: what small GPUs offer.
pub const STORAGE_BUFFERS_PER_STAGE: u32 = 4;
/// Bytes of workgroup memory that a kernel may use.
pub const WORKGROUP_MEMORY_BYTES: u32 = 16 << 10;
/// Invocations of one workgroup at most.
pub const WORKGROUP_INVOCATIONS: u32 = 128;

/// The most that a pass keeps of a pixel: four words of a ratio on their way back to the host.
const BYTES_A_PIXEL: usize = 16;

/// How often the device is waited for: on GL an indefinite wait ends after 4.3 s, which a software driver on a busy
/// machine may need.
const WAITS: u32 = 15;

/// An adapter that was found, and whether it can do the work.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    /// Through which interface.
    pub backend: Backend,
    /// The adapter's name and driver.
    pub name: String,
    /// What it lacks; empty where it is usable.
    pub missing: Vec<String>,
}

/// A device with its queue.
pub struct GpuContext {
    /// Shared by all passes.
    pub device: wgpu::Device,
    /// Its only queue.
    pub queue: wgpu::Queue,
    backend: Backend,
    info: wgpu::AdapterInfo,
    timestamps: bool,
    first_error: Arc<Mutex<Option<String>>>,
    /// What lives on it.
    pub live: LiveList,
}

/// Lists every adapter of the given interface and what it lacks.
pub fn adapters(backend: Backend) -> Vec<AdapterReport> {
    found(backend)
        .iter()
        .map(|adapter| AdapterReport {
            backend,
            name: adapter_name(&adapter.get_info()),
            missing: missing(adapter),
        })
        .collect()
}

impl GpuContext {
    /// Opens the best adapter of a backend; of all backends in turn where none is named. Real hardware is
    /// preferred to software. Errors: `NoAdapter` with all that was found and what each lacks.
    pub fn new(backend: Option<Backend>) -> Result<Self, EngineError> {
        let wanted = backend.map_or_else(|| Backend::ALL.to_vec(), |one| vec![one]);
        let mut report = Vec::new();
        for backend in wanted {
            let mut adapters = found(backend);
            if adapters.is_empty() {
                report.push(format!("{}: no adapter at all", backend.name()));
            }
            adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
            for adapter in adapters {
                let lacks = missing(&adapter);
                let name = adapter_name(&adapter.get_info());
                if lacks.is_empty() {
                    match Self::open(&adapter, backend) {
                        Ok(context) => return Ok(context),
                        Err(reason) => report.push(format!("{}: {name} refused: {reason}", backend.name())),
                    }
                } else {
                    report.push(format!("{}: {name} lacks {}", backend.name(), lacks.join(", ")));
                }
            }
        }
        Err(EngineError::NoAdapter(format!(
            "{}; needed is Vulkan, OpenGL 4.3 or OpenGL ES 3.1 with compute shaders (or use the CPU engine)",
            report.join("; ")
        )))
    }

    fn open(adapter: &wgpu::Adapter, backend: Backend) -> Result<Self, String> {
        let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let required_features =
            if timestamps { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() };
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("halflight"),
            required_features,
            required_limits: limits(&adapter.limits()),
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| error.to_string())?;
        let first_error = Arc::new(Mutex::new(None));
        let slot = Arc::clone(&first_error);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
            slot.get_or_insert_with(|| error.to_string());
        }));
        let lost = Arc::clone(&first_error);
        device.set_device_lost_callback(move |reason, message| {
            let mut slot = lost.lock().unwrap_or_else(PoisonError::into_inner);
            slot.get_or_insert_with(|| format!("device lost ({reason:?}): {message}"));
        });
        Ok(Self {
            device,
            queue,
            backend,
            info: adapter.get_info(),
            timestamps,
            first_error,
            live: LiveList::new(),
        })
    }

    /// Which interface is in use.
    pub fn backend(&self) -> Backend {
        self.backend
    }

    /// Backend, adapter and driver in one line.
    pub fn description(&self) -> String {
        format!("{}, {}", self.backend.name(), adapter_name(&self.info))
    }

    /// Whether passes can be timed on the device itself.
    pub fn has_timestamps(&self) -> bool {
        self.timestamps
    }

    /// Whether the device takes a buffer of so many bytes in one piece.
    pub fn binds(&self, bytes: usize) -> bool {
        let limits = self.device.limits();
        let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
        bytes as u64 <= most
    }

    /// Whether the device can draw a picture of that size: its textures, and three floats a pixel in one piece.
    pub fn draws(&self, width: usize, height: usize) -> bool {
        let side = self.device.limits().max_texture_dimension_2d as usize;
        width <= side && height <= side && self.binds(width * height * BYTES_A_PIXEL)
    }

    /// The first error that the device reported since the last call, as an error of `pass`.
    pub fn check(&self, pass: &'static str) -> Result<(), EngineError> {
        let mut slot = self.first_error.lock().unwrap_or_else(PoisonError::into_inner);
        match slot.take() {
            Some(reason) => Err(EngineError::Gpu { pass, reason }),
            None => Ok(()),
        }
    }

    /// Waits until all submitted work is done; about a minute at most on GL.
    pub fn wait(&self, pass: &'static str) -> Result<(), EngineError> {
        self.wait_for(pass, None)
    }

    /// Waits until a submission and all before it are done; `None`: all.
    pub fn wait_for(
        &self,
        pass: &'static str,
        submission: Option<&wgpu::SubmissionIndex>,
    ) -> Result<(), EngineError> {
        let mut outcome = Err(wgpu::PollError::Timeout);
        for _ in 0..WAITS {
            outcome = self
                .device
                .poll(wgpu::PollType::Wait { submission_index: submission.cloned(), timeout: None });
            if !matches!(outcome, Err(wgpu::PollError::Timeout)) {
                break;
            }
        }
        outcome.map_err(|error| EngineError::Gpu { pass, reason: error.to_string() })?;
        self.check(pass)
    }
}

fn found(backend: Backend) -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: backend.bits(),
        flags: wgpu::InstanceFlags::empty().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(backend.bits()))
}

fn adapter_name(info: &wgpu::AdapterInfo) -> String {
    let driver = format!("{} {}", info.driver, info.driver_info);
    format!("{} ({})", info.name, driver.trim())
}

fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// What every kernel stays within, and large pictures and buffers as far as the adapter goes.
fn limits(adapter: &wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits {
        max_storage_buffers_per_shader_stage: STORAGE_BUFFERS_PER_STAGE,
        max_compute_workgroup_storage_size: WORKGROUP_MEMORY_BYTES,
        max_compute_invocations_per_workgroup: WORKGROUP_INVOCATIONS,
        max_compute_workgroup_size_x: WORKGROUP_INVOCATIONS,
        max_compute_workgroup_size_y: WORKGROUP_INVOCATIONS,
        max_texture_dimension_1d: adapter.max_texture_dimension_1d,
        max_texture_dimension_2d: adapter.max_texture_dimension_2d,
        max_storage_buffer_binding_size: adapter.max_storage_buffer_binding_size,
        max_buffer_size: adapter.max_buffer_size,
        ..wgpu::Limits::downlevel_defaults()
    }
    .or_worse_values_from(adapter)
}

fn missing(adapter: &wgpu::Adapter) -> Vec<String> {
    let flags = adapter.get_downlevel_capabilities().flags;
    let limits = adapter.limits();
    let mut lacks = Vec::new();
    let mut need = |met: bool, what: String| {
        if !met {
            lacks.push(what);
        }
    };
    need(flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS), "compute shaders".into());
    let at_least = [
        ("storage buffers a stage", limits.max_storage_buffers_per_shader_stage, STORAGE_BUFFERS_PER_STAGE),
        ("bytes of workgroup memory", limits.max_compute_workgroup_storage_size, WORKGROUP_MEMORY_BYTES),
        ("invocations a workgroup", limits.max_compute_invocations_per_workgroup, WORKGROUP_INVOCATIONS),
        ("texels of texture size", limits.max_texture_dimension_2d, 2048),
        ("sampled textures a stage", limits.max_sampled_textures_per_shader_stage, 6),
    ];
    for (what, has, needed) in at_least {
        need(has >= needed, format!("{needed} {what} (it has {has})"));
    }
    let formats = [
        (wgpu::TextureFormat::R32Uint, wgpu::TextureUsages::RENDER_ATTACHMENT, false),
        (wgpu::TextureFormat::Rgba16Float, wgpu::TextureUsages::RENDER_ATTACHMENT, true),
        (wgpu::TextureFormat::Depth32Float, wgpu::TextureUsages::RENDER_ATTACHMENT, true),
    ];
    for (format, usage, four_samples) in formats {
        let features = adapter.get_texture_format_features(format);
        need(features.allowed_usages.contains(usage), format!("rendering to {format:?}"));
        let multisampled = features.flags.sample_count_supported(4);
        need(!four_samples || multisampled, format!("four samples a pixel in {format:?}"));
    }
    lacks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_never_exceed_the_adapter() {
        let mut small = wgpu::Limits::downlevel_defaults();
        small.max_texture_dimension_2d = 4096;
        small.max_uniform_buffer_binding_size = 8 << 10;
        let asked = limits(&small);
        assert_eq!(asked.max_texture_dimension_2d, 4096);
        assert_eq!(asked.max_uniform_buffer_binding_size, 8 << 10);
        assert!(asked.check_limits(&small));
    }

    #[test]
    fn hardware_is_preferred_to_software() {
        assert!(rank(wgpu::DeviceType::DiscreteGpu) < rank(wgpu::DeviceType::IntegratedGpu));
        assert!(rank(wgpu::DeviceType::IntegratedGpu) < rank(wgpu::DeviceType::Cpu));
    }
}
