//! Light onto surfaces, and virtual onto real.

pub mod carried;
pub mod composite;
pub mod geometry;
pub mod halving;
pub mod raster;
pub mod reflected;
pub mod shade_object;
pub mod shade_surface;
pub mod soft_grid;
pub mod soft_shadow;
pub mod tonemap;
pub mod transferred;
