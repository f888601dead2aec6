//! What can be wrong with a room.

use crate::model::light::MapLayout;

/// Why a room could not be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RoomError {
    /// A setting outside of its range.
    #[error("room.{setting} = {value}: must be {allowed}")]
    Setting {
        /// The setting's name in the scene file's `[room]`.
        setting: &'static str,
        /// The value as it was given.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// Nothing to divide.
    #[error(
        "room: {surfaces} surfaces without one usable face ({dropped} faces left out for want of area or finite corners): give it geometry"
    )]
    NoFaces {
        /// Surfaces that the room has.
        surfaces: usize,
        /// Faces left out, for want of area or of finite corners.
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
    /// The probe's picture cannot be read as a sphere.
    #[error(
        "room.probe: a picture of {width} x {height} pixels as {layout:?}: must be square for Angular, 1 to 6 for Cube, not empty"
    )]
    ProbePicture {
        /// Columns of the picture.
        width: usize,
        /// Rows of the picture.
        height: usize,
        /// What it was said to be.
        layout: MapLayout,
    },
    /// The probe does not stand in the room.
    #[error(
        "room.probe_position = {at:?}: from there {fronts:.0} % of all directions meet the front of a surface, {backs:.0} % a back, {nothing:.0} % nothing: must be inside of the room, not in a wall, with faces that look at it"
    )]
    ProbeOutside {
        /// Where it is said to have stood, world frame, metres.
        at: [f32; 3],
        /// Directions that meet a front first, per cent.
        fronts: f32,
        /// Directions that meet a back first, per cent.
        backs: f32,
        /// Directions that meet nothing, per cent.
        nothing: f32,
    },
    /// The picture that reflectance is read off does not belong to its lens.
    #[error(
        "room: a camera picture of {width} x {height} pixels: must be {lens_width} x {lens_height}, as its lens is"
    )]
    CameraPicture {
        /// Columns of the picture.
        width: usize,
        /// Rows of the picture.
        height: usize,
        /// Columns that the lens was calibrated for.
        lens_width: u32,
        /// Rows that the lens was calibrated for.
        lens_height: u32,
    },
    /// Nothing reflects.
    #[error("room: none of {patches} patches reflects any light: nothing can receive a shadow")]
    NoReceivers {
        /// Patches looked at.
        patches: usize,
    },
}
