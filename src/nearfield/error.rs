//! What can be wrong with a room.

/// Why a room could not be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RoomError {
    /// A setting outside of its range.
    #[error("room.{setting} = {value}: must be {allowed}")]
    Setting {
        /// Its name.
        setting: &'static str,
        /// As given.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// Nothing to divide.
    #[error(
        "room: {surfaces} surfaces without one usable face ({dropped} faces left out for want of area or finite corners): give it geometry"
    )]
    NoFaces {
        /// Surfaces given.
        surfaces: usize,
        /// Faces left out.
        dropped: usize,
    },
    /// Nothing shines: no shadow can be drawn.
    #[error(
        "room: none of {patches} patches has a radiance above zero: measure its light, or give a lamp or window some"
    )]
    NoLight {
        /// Patches looked at.
        patches: usize,
    },
    /// Nothing reflects.
    #[error("room: none of {patches} patches reflects any light: nothing can receive a shadow")]
    NoReceivers {
        /// Patches looked at.
        patches: usize,
    },
}
