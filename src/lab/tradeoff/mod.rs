//! What accuracy costs in time: every setting of accuracy by itself, and the front of all together.

pub mod axes;
pub mod errors;
pub mod measure;
mod page;
mod plot;
mod search;
pub mod study;
pub mod subject;
mod telling;
mod truth;
pub mod writing;

pub use study::{Bench, StudyPlan, StudyResults, StudyWatch, study};
pub use subject::{StudySubject, SubjectChoice};
