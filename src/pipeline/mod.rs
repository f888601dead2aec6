//! Layer 4: events in order of time; threads live here and nowhere else.

pub mod tracking;
