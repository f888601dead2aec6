//! One file a kernel: what it uploads, dispatches and reads back.

pub mod merge_bracket;
pub mod project_sh;
