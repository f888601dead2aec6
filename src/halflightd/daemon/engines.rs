//! Which engine computes, and which packages it comes with.

use crate::config::settings::{BackendKind, EngineKind};
use crate::engine::{
    Engine, EngineError, Timings,
    cpu::CpuEngine,
    gpu::{Backend, GpuEngine},
};

/// Opens an engine. `cpu_kernels` names kernels that run on their CPU twin although the engine is the GPU; `timings` is how
/// passes on a GPU are timed.
pub fn open(
    kind: EngineKind,
    backend: BackendKind,
    threads: usize,
    cpu_kernels: &[String],
    timings: Timings,
) -> Result<Box<dyn Engine>, EngineError> {
    let threads = (threads > 0).then_some(threads);
    match kind {
        EngineKind::Cpu => Ok(Box::new(CpuEngine::new(threads)?)),
        EngineKind::Gpu => {
            let backend = match backend {
                BackendKind::Auto => None,
                BackendKind::Vulkan => Some(Backend::Vulkan),
                BackendKind::Gl => Some(Backend::Gl),
            };
            let engine = gpu(backend)?.with_timings(timings);
            Ok(Box::new(engine.with_cpu_kernels(cpu_kernels)?))
        }
    }
}

/// Opens the GPU. Where there is no adapter, the packages of Debian that bring a driver are named.
///
/// # Errors
/// There is none, or it cannot do the work.
pub fn gpu(backend: Option<Backend>) -> Result<GpuEngine, EngineError> {
    GpuEngine::new(backend).map_err(|error| match error {
        EngineError::NoAdapter(why) => EngineError::NoAdapter(format!("{why}; {}", packages(backend))),
        other => other,
    })
}

/// What to install where a driver is missing.
fn packages(backend: Option<Backend>) -> String {
    const VULKAN: &str = "libvulkan1 mesa-vulkan-drivers";
    const GL: &str = "libegl1 libegl-mesa0 libgles2 libgl1-mesa-dri";
    let names = match backend {
        Some(Backend::Vulkan) => VULKAN.to_owned(),
        Some(Backend::Gl) => GL.to_owned(),
        None => format!("{VULKAN}, or {GL}"),
    };
    format!("on Debian the driver is in {names}")
}
