//! One file a kernel: what it uploads, dispatches and reads back.

pub mod composite;
pub mod merge_bracket;
pub mod point_maps;
pub mod project_sh;
pub mod shade_object;
pub mod shade_surface;
pub mod shadow_maps;
pub mod soft_shadow;
pub mod subtract;
mod subtract_displayed;
pub mod tonemap;
mod turns;
pub mod unwrap_ball;
