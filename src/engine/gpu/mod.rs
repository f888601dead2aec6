//! The engine on wgpu (Vulkan and GL, down to OpenGL ES 3.1). Every kernel has a CPU twin that is the truth.

pub mod buffers;
pub mod context;
pub mod kernel;
pub mod kernels;
pub mod params;
pub mod passes;
pub mod recorder;

mod engine;

pub use context::Backend;
pub use engine::GpuEngine;
