//! Which engine computes.

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
            let engine = GpuEngine::new(backend)?.with_timings(timings);
            Ok(Box::new(engine.with_cpu_kernels(cpu_kernels)?))
        }
    }
}
