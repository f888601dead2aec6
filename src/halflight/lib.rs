//! half-light: measures the light of a real place through a camera, splits it into a hard and a soft
//! half, and draws virtual objects into the picture with shadows that agree with the real ones.
//!
//! # Frames and names
//! `p_world = world_from_camera * p_camera`: transforms are named `to_from_from` so that names meet.
//! World: right-handed, z up, metres; the surface that things stand on is z = 0 and the tag lies in it.
//! Camera: x right, y down, z forward (OpenCV). Pixel (i, j) covers [i, i+1) x [j, j+1), centre +0.5.
//! Directions are unit vectors that point away from the shaded point (towards the light).
//! Equirectangular maps: theta = pi v from +z, phi = 2 pi u - pi from +x towards +y.
//!
//! # Radiometry
//! Radiance is linear RGB, channels independent. Reflectance lobes `f+` contain the normalisation and
//! the foreshortening. `E_d` is the irradiance of the directional light on a plane that faces it.
//! Spherical harmonics: real, orthonormal, Condon-Shortley phase, index l(l+1)+m; "order n" = bands 0..n-1.
//!
//! # Keys
//! * [Now11] Nowrouzezahrai et al., "Light Factorization for Mixed-Frequency Shadows in Augmented Reality", ISMAR 2011.
//! * [Gib03] Gibson et al., "Rapid Shadow Generation in Real-World Lighting Environments", EGSR 2003.
//! * [DM97] Debevec and Malik, "Recovering High Dynamic Range Radiance Maps from Photographs", SIGGRAPH 1997.
//! * [Slo08] Sloan, "Stupid Spherical Harmonics (SH) Tricks", GDC 2008.
//! * [Ols11] Olson, "AprilTag: A robust and flexible visual fiducial system", ICRA 2011.
//!
//! `src/README.md` is the map.

pub use halflight_core::{
    animate, calibrate, compose, hdr, light, model, nearfield, plan, sources, track, visibility,
};
pub use halflight_device as device;
pub use halflight_engine as engine;
pub use halflight_lab as lab;
pub use halflight_lab::{reference, stress};
pub use halflight_math as math;
pub use halflightd::{config, daemon, pipeline, present};

pub mod cli;

/// Files in, model out, with the formats that only the tool reads.
pub mod assets {
    pub use halflight_assets::*;
    pub use halflight_lab::case;

    /// Pictures, OpenEXR too.
    pub mod pictures {
        pub use halflight_assets::pictures::*;
        pub use halflight_lab::open_exr::{decode_radiance, load_radiance, load_raw, save_exr_f32};
    }

    /// Known rooms, reference cases too.
    pub mod room {
        pub use halflight_assets::room::*;
        pub use halflight_lab::case::load_room;
    }
}
