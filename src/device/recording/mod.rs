//! Recordings: MCAP files that the usual viewers open. `schema` says what lies on which topic.
//!
//! Chunks are small (about 1 MiB or one second), a frame never lies in two of them, and each begins with the
//! calibration and the rig, so every whole chunk of a damaged file can be used by itself. A metadata record at the start says who
//! made the file (`notes`).
//!
//! What others write is read as well: messages outside of chunks, Foxglove's schemas in JSON and protobuf, ROS 2's bags.

mod cdr;
pub mod channels;
pub(crate) mod clock;
pub mod descriptor;
mod exif;
mod foxglove;
pub mod foxglove_types;
pub mod frames;
mod lens;
pub mod messages;
pub mod notes;
pub mod pictures;
mod places;
mod raw;
pub mod reader;
mod records;
mod rig;
pub mod schema;
pub mod wire;
pub mod writer;

pub use channels::{Message, TopicNames};
pub use notes::RecordingOrigin;
pub use pictures::PictureCoding;
pub use places::LARGEST_CHUNK;
pub use reader::{Damage, RecordingReader};
pub use schema::Topic;
pub use writer::{RecordingWriter, Setup, Written};
