//! Experiments of the papers, done again.

pub mod displayed_values;
pub mod profiles;
