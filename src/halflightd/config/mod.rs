//! Layer 5: settings. As typed is not as meant: `file` reads, `resolve` checks all keys at once, `keys` is the
//! one table of what there is.

pub mod file;
pub mod keys;
pub mod live;
pub mod manual;
pub mod presets;
pub mod range;
pub mod resolve;
pub mod rig;
pub mod settings;
mod values;

pub use resolve::{ConfigErrors, over, resolve};
pub use settings::Settings;
