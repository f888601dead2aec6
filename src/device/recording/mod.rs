//! Recordings: MCAP files that the usual viewers open. `schema` says what lies on which topic.
//!
//! Chunks are small (about 1 MiB or one second), a frame never lies in two of them, and each begins with the
//! calibration and the rig, so every whole chunk of a damaged file can be used by itself.

pub mod messages;
pub mod pictures;
pub mod reader;
pub mod schema;
pub mod wire;
pub mod writer;

pub use pictures::PictureCoding;
pub use reader::{Damage, RecordingReader};
pub use schema::Topic;
pub use writer::{RecordingWriter, Setup, Written};
