//! Shadows of near light in a known room, Sections 3 to 8 of [Gib03] as corrected: patches, transfers, the sets of
//! sources and receivers, the hierarchy of shafts between them, and what a moving object may hide in a frame.
//! `sources` cuts the marked sources into representatives.
//!
//! # One n
//! A frame has n lights with shadow maps of the objects, and what they are of is one choice: the patches that shine are the
//! leaves of one tree (`field`), the suns those of another (`sun_sources`), and each frame both are expanded together, the node
//! first whose splitting takes most error away (`sources::expand`). Light is in one unit, the mean irradiance on the receivers
//! that may lose some, so a sun that the room itself hides, or of which no object hides anything that is seen, takes none of n;
//! several suns become one light where n is small. With a single light for both trees, the one that sends less loses nothing: its
//! shadows are missing. On objects a sun without a map of its own shines as if nothing hid it.
//!
//! # What is taken away at a point
//! With the rows E_k of `Representatives::light_rows` (light k's L T, the room's own visibility in it) and `gathered_rgb`,
//! both interpolated between the corners of the point's triangle, and the share M_k of light k that moving objects hide,
//!
//! I = T(T^-1(I_b) (1 - min(1, sum_k E_k M_k / E_gathered)))
//!
//! M_k from one place (`centre_world`: a hard shadow), or from places p_i on the parallelogram `middle_world` +- its
//! half axes, each weighed by what its part sends: w_i = max(0, n.d) max(0, -n_k.d) / |d|^4, d = p_i - x. Weights take a
//! sixth off the error of ten lights, for wide lights send unevenly.
//!
//! A static shadow map for each light in the place of E_k's own visibility was tried and is worse: from one place it draws a
//! real table's shadow with a hard edge, while what is interpolated is as soft as the light is wide (F3, under the table:
//! an error of 0.59 with it and 0.28 without at ten lights, of 0.29 and 0.19 at 50). What interpolation gets wrong is cured by smaller patches at the
//! edges of the room's own shadows (`Subdivision::edges`), and mostly drops out of the ratio, whose denominator is
//! interpolated alike (0.52 without the ratio, 0.19 with it).

pub mod error;
pub mod faces;
pub mod field;
pub mod fill;
pub mod form_factor;
pub mod frame;
pub mod intensity;
pub mod irradiance;
pub mod marks;
pub mod objects;
pub mod octree;
pub mod packed;
pub mod patches;
pub mod prepare;
pub mod probe;
pub mod reflectance;
pub mod representatives;
pub mod sent;
pub mod sets;
pub mod shadow_edges;
pub mod shaft;
pub mod shafts;
pub mod soundness;
pub mod subtract;
pub mod subtract_displayed;
pub mod sums;
pub mod sun_blockers;
pub mod sun_shadows;
pub mod sun_sources;
pub mod suns;
pub mod transfer;
pub mod two_sets;

#[cfg(test)]
mod fixture;
