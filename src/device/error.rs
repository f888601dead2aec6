//! One error for every device. The pipeline decides by `kind`, never by text.

use std::error::Error;

/// What to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// Nothing came in time; ask again.
    Again,
    /// The device works, and has nothing to hand on yet; ask again. It is not silent.
    Working,
    /// The device went away or lost its state; open it anew.
    Reopen,
    /// There is no more.
    Ended,
    /// The request itself cannot be met.
    Refused,
}

/// Which device failed, at what, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[error("{device}: {action}{}", source.as_ref().map(|s| format!(": {s}")).unwrap_or_default())]
pub struct DeviceError {
    /// As the user named it, e.g. `replay:desk.mcap`.
    pub device: String,
    /// What was tried, and with which value.
    pub action: String,
    /// What to do about it.
    pub kind: ErrorKind,
    /// The cause below, if any.
    #[source]
    pub source: Option<Box<dyn Error + Send + Sync>>,
}

impl DeviceError {
    /// Builds an error without a deeper cause.
    pub fn new(device: impl Into<String>, action: impl Into<String>, kind: ErrorKind) -> Self {
        Self { device: device.into(), action: action.into(), kind, source: None }
    }

    /// Nothing came by the deadline. Allocates nothing: it is no failure, and whoever asked knows the device.
    pub fn again() -> Self {
        Self { device: String::new(), action: String::new(), kind: ErrorKind::Again, source: None }
    }

    /// Something came by the deadline, of which nothing can be handed on yet. Allocates nothing.
    pub fn working() -> Self {
        Self { kind: ErrorKind::Working, ..Self::again() }
    }

    /// Adds the cause.
    #[must_use]
    pub fn because(mut self, source: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        self.source = Some(source.into());
        self
    }
}
