//! Layer 3, the door to computing: the CPU twins in order, or wgpu. Coarse on purpose: no GPU handle crosses it.

use halflight_core::{animate, compose, hdr, light, model, nearfield, plan, visibility};
use halflight_math as math;

pub mod cpu;
mod door;
mod frame;
pub mod gpu;

use crate::animate::posed::Posed;
use crate::light::unwrap_ball::BallShot;
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    environment::EnvironmentPicture,
    estimate::LightFlags,
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    light::{EnvironmentMap, Lights, RadianceSamples, RadianceSh},
    picture::Picture,
    quality::Quality,
    response::Response,
    scene::Scene,
    sensor::SensorImage,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{Foresight, FramePlan, Pass, PassTiming};
use std::sync::Arc;

/// How passes on a device are timed. Passes on the host are timed but for `Off`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timings {
    /// Not at all.
    Off,
    /// By timestamp queries, where the device has them; no pass is awaited before the picture is.
    #[default]
    Stamps,
    /// The same; where the device has none, each pass is submitted and awaited by itself. For benchmarks: frames take longer.
    Fenced,
}

/// What went wrong in an engine.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// No adapter can do the work; says what was found and what is needed.
    #[error("no usable GPU adapter: {0}")]
    NoAdapter(String),
    /// The device was lost or refused; says in which pass.
    #[error("GPU failed in {pass}: {reason}")]
    Gpu {
        /// As `Pass::name` has it.
        pass: &'static str,
        /// What the driver said.
        reason: String,
    },
    /// The input does not fit together (sizes, counts).
    #[error("{0}")]
    Input(String),
}

/// One bracket: the same view at several exposures, all of one size.
#[derive(Clone, Copy)]
pub struct Bracket<'a> {
    /// 1 to 9 pictures.
    pub pictures: &'a [&'a Rgb8Image],
    /// One for each picture.
    pub exposures: &'a [Exposure],
}

/// One bracket as its sensor gave it: the same view at several exposures, all of one size.
#[derive(Clone, Copy)]
pub struct SensorBracket<'a> {
    /// 1 to 9 pictures.
    pub pictures: &'a [&'a SensorImage],
    /// One for each picture.
    pub exposures: &'a [Exposure],
}

/// Where the light is to be read from.
pub enum LightJob<'a> {
    /// A mirror ball in an HDR picture.
    Ball(BallShot<'a>),
    /// An environment picture whose axes are the world's.
    Map(&'a EnvironmentMap),
}

/// Light as an engine measured it: not filtered, not split.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredLight {
    /// World frame, order `quality.sh_order`.
    pub total: RadianceSh,
    /// What was missing.
    pub flags: LightFlags,
}

/// All that one frame is drawn from.
pub struct RelightInput<'a> {
    /// The camera's picture, linear.
    pub background: &'a HdrImage,
    /// Intrinsics and distortion, pixels.
    pub lens: &'a Lens,
    /// Takes points of the camera's frame to the world, metres.
    pub world_from_camera: &'a Pose,
    /// Hard lights, and the rest as harmonics, world frame.
    pub light: &'a Lights,
    /// What mirrors and sharp gloss see; `None`: SH stands in.
    pub environment: Option<&'a EnvironmentPicture>,
    /// Where the scene's objects are now, and the spheres that stand for them; `None`: as loaded, and no spheres.
    pub posed: Option<&'a Posed>,
    /// Response for the way back to 8 bits.
    pub response: &'a Response,
    /// Exposure of the shown picture (radiance times `effective_s` goes through the response).
    pub shown_exposure: Exposure,
    /// Time of the frame.
    pub t: crate::model::time::Timestamp,
}

/// Memory that an engine holds for its passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LiveMemory {
    /// What it is.
    pub name: &'static str,
    /// How large.
    pub bytes: u64,
}

/// How many lights a frame's near light was cut into, and how wide they were.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NearChoice {
    /// Near lights, each with its own shadow map.
    pub lights: usize,
    /// Suns of the room with a map of the objects.
    pub suns: usize,
    /// How wide the lights are, on average, seen from the objects, radians.
    pub width_rad: f32,
}

/// The CPU twins in order, or the GPU.
pub trait Engine: Send {
    /// One line for people: engine, backend, adapter.
    fn description(&self) -> String;
    /// Takes the known room of the scenes to come that stand in one (`Scene::room`), or none. Before [`Engine::load_scene`].
    fn load_room(&mut self, room: Option<Arc<KnownRoom>>) -> Result<(), EngineError>;
    /// Takes the scene; the next frames are drawn with it.
    fn load_scene(&mut self, scene: &Scene) -> Result<(), EngineError>;
    /// Merges one bracket to linear radiance (twin: `hdr::merge_bracket`).
    fn merge_bracket(
        &mut self,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError>;
    /// The same for what a sensor gave, which needs no response (twin: `hdr::merge_bracket::merge_sensor`).
    fn merge_sensor(&mut self, bracket: &SensorBracket<'_>, out: &mut HdrImage) -> Result<(), EngineError>;
    /// Reads the light (twins: `light::unwrap_ball`, `light::project_sh`).
    fn estimate_light(&mut self, job: &LightJob<'_>, quality: &Quality)
    -> Result<MeasuredLight, EngineError>;
    /// The weighted directions behind the newest estimate, world frame; empty before the first.
    fn measured_samples(&self) -> &RadianceSamples;
    /// Looks at a frame before it is planned: which results of earlier frames would come out the same to the last bit, and
    /// which shadows are seen. The frame itself may follow, or another.
    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError>;
    /// Draws one frame: allocates and dispatches exactly the plan's passes. A result that the plan keeps and that is not
    /// held after all is made.
    fn relight(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError>;
    /// Says whether `Picture::radiance` is wanted of the frames to come. At first it is not, and an engine on a device leaves it
    /// empty where it composes there; an engine on the processor fills it in any case.
    fn ask_for_linear(&mut self, _wanted: bool) {}
    /// The near lights that the last frame of a known room was drawn with; `None` outside of one.
    fn near_choice(&self) -> Option<NearChoice> {
        None
    }
    /// The passes that the last frame dispatched, in order.
    fn dispatched(&self) -> &[Pass];
    /// What lives for the last frame, by name: on the device its buffers and textures, on the CPU the pictures and maps that
    /// passes make. What is made for passes that a frame does not use is freed when it begins.
    fn live(&self, out: &mut Vec<LiveMemory>);
    /// Time of each pass since the last call of `take_timings`, in order.
    fn take_timings(&mut self, out: &mut Vec<PassTiming>);
}
