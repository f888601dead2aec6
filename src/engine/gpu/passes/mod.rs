//! One file a kernel: its row of THE TABLE, and what it uploads, dispatches and reads back.

mod composite;
pub mod merge_bracket;
mod point_maps;
pub mod project_sh;
mod shade_object;
mod shade_surface;
mod shadow_maps;
mod soft_shadow;
mod subtract;
mod subtract_displayed;
mod tonemap;
mod turns;
pub mod unwrap_ball;

use super::{
    context::GpuContext, device_scene::DeviceScene, exchange::Exchange, kernel::KernelRow,
    point_pages::MapSpread, recorder::GpuRecorder,
};
use crate::{
    EngineError,
    frame::{FrameJob, FrameState},
    plan::Pass,
};

/// What a pass of a frame runs with.
pub struct DeviceFrame<'a> {
    /// Takes the work.
    pub recorder: GpuRecorder<'a>,
    /// What is to be drawn, and with what.
    pub job: &'a FrameJob<'a>,
    /// The host's side of it.
    pub state: &'a mut FrameState,
    /// The device's.
    pub scene: &'a mut DeviceScene,
    /// How near lights are spread over passes.
    pub spread: MapSpread,
}

/// A pass of a frame on the device.
pub trait DevicePass: Send {
    /// Does the host's part; returns whether the device can hold the rest, else the twin runs the whole pass. What the pass
    /// reads may still be on the host.
    fn prepare(&mut self, _frame: &mut DeviceFrame<'_>, _exchange: &Exchange) -> bool {
        true
    }

    /// Records the pass. What it reads is on the device, and its product goes to the exchange.
    fn run(&mut self, frame: &mut DeviceFrame<'_>, exchange: &mut Exchange) -> Result<(), EngineError>;
}

/// Declares the kernels in the order of `Pass::ALL`: files of those that measure, files and passes of those that draw.
macro_rules! kernels {
    (measure: [$($measuring:ident,)*] draw: [$($drawing:ident: $pass:ident,)*]) => {
        /// THE TABLE: one row a kernel, in the order of `Pass::ALL`. `tests/shaders.rs` checks every row without a GPU.
        pub const TABLE: [&KernelRow; Pass::ALL.len()] = [$(&$measuring::KERNEL,)* $(&$drawing::KERNEL,)*];

        /// Compiles the kernel of a pass that draws.
        pub fn compile(pass: Pass, context: &GpuContext) -> Result<Box<dyn DevicePass>, EngineError> {
            match pass {
                $(Pass::$pass => Ok(Box::new($drawing::$pass::new(context)?)),)*
                _ => Err(EngineError::Input(format!("{} is no pass of a frame", pass.name()))),
            }
        }
    };
}

kernels! {
    measure: [merge_bracket, unwrap_ball, project_sh,]
    draw: [
        shadow_maps: ShadowMaps,
        soft_shadow: SoftShadow,
        point_maps: PointMaps,
        subtract: Subtract,
        subtract_displayed: SubtractDisplayed,
        shade_object: ShadeObject,
        shade_surface: ShadeSurface,
        composite: Composite,
        tonemap: Tonemap,
    ]
}
