//! The engine on wgpu (Vulkan and GLES 3.1).

pub mod buffers;
pub mod context;
pub mod kernel;
pub mod kernels;
pub mod params;
pub mod passes;
