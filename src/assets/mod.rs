//! Files in, model out.

pub mod calibration;
pub mod case;
pub mod dds;
pub mod error;
pub mod gltf;
pub mod kept;
pub mod kept_room;
pub mod known_room;
pub mod mapped_probe;
pub mod normals;
pub mod obj;
pub mod pictures;
pub mod response;
pub mod room;
pub mod scene;
pub mod shapes;
pub mod spheres;
pub mod transfer;
pub mod walker;
