//! The engine on wgpu (Vulkan and GL, down to OpenGL ES 3.1). Every kernel has a CPU twin that is the truth.

mod buffers;
pub mod context;
mod device_scene;
mod exchange;
mod extents;
pub mod kernel;
pub mod live;
mod params;
mod passes;
mod point_pages;
mod recorder;
mod relight;
mod room_lights;
mod room_mesh;
mod scene;
mod surroundings;
mod textures;
mod view;

mod engine;

pub use context::Backend;
pub use engine::GpuEngine;
pub use passes::TABLE;
pub use point_pages::MapSpread;
