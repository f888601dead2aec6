//! The one table of keys: name, unit, range, effect, and where the value goes.

use super::presets::PRESET_NAMES;
pub use super::range::Range;
use super::range::real;
use super::settings::{BackendKind, EngineKind, GrayWeights, RunMode, Settings};
use super::values::{integer, mains_of, mains_word, number, optional, text, texts, word};
use crate::math::sh::zonal::PhongNorm;
use crate::model::{
    blocker::Rung,
    picture::PictureView,
    quality::{Effects, NearForm, SelfShadow, SoftAt, SplitKind},
};
use crate::plan::Pass;
use toml::Value;

/// One key.
pub struct Key {
    /// `section.name`.
    pub name: &'static str,
    /// Unit, or empty.
    pub unit: &'static str,
    /// What it may hold.
    pub range: Range,
    /// What it does.
    pub effect: &'static str,
    /// Reads it from settings.
    pub read: fn(&Settings) -> Value,
    /// Writes an admitted value into settings.
    pub write: fn(&mut Settings, &Value),
}

macro_rules! key {
    ($name:literal, $unit:literal, $range:expr, $effect:literal, $read:expr, $write:expr) => {
        Key { name: $name, unit: $unit, range: $range, effect: $effect, read: $read, write: $write }
    };
}

/// A key that holds any text.
macro_rules! text_key {
    ($name:literal, $effect:literal, $field:ident) => {
        key!($name, "", Range::Text, $effect, |s| word(&s.$field), |s, v| s.$field = text(v))
    };
}

impl Key {
    /// Whether it takes effect on the next frame where it changes while the program runs. Devices, engine, tracking, the
    /// scene and the output are opened once, at the start.
    pub fn is_live(&self) -> bool {
        matches!(self.name.split_once('.'), Some(("light" | "quality" | "present", _)))
    }
}

/// Every key, in the order of `config/default.toml`.
pub const KEYS: &[Key] = &[
    text_key!(
        "device.camera",
        "Where frames come from: \"auto\" = the best camera there is, \"v4l2:/dev/video0,size=640x480,fps=30\", \"v4l2:card=TEXT\", \"libcamera:ID\" = a sensor behind libcamera, \"synthetic:frames=90,seed=1\" = a virtual room, \"replay:FILE.mcap\".",
        camera
    ),
    key!(
        "device.mode",
        "",
        Range::Choice(&["realtime", "lockstep"]),
        "realtime: as time passes, the newest frame wins. lockstep: every frame, as fast as it goes, same result every time.",
        |s| word(if s.mode == RunMode::Lockstep { "lockstep" } else { "realtime" }),
        |s, v| s.mode = if text(v) == "lockstep" { RunMode::Lockstep } else { RunMode::Realtime }
    ),
    key!(
        "device.frames",
        "frames",
        Range::Integer(0, i64::MAX),
        "Stop after this many; 0 = when the source ends.",
        |s| Value::Integer(s.frames as i64),
        |s, v| s.frames = integer(v) as u64
    ),
    text_key!(
        "device.imu",
        "Inertial sensor: empty = the camera's own where it has one, \"serial:/dev/ttyUSB0,protocol=rvc,baud=115200\", \"hid:2833:0021\", \"iio:name=gyro_3d\" (docs/imu.md).",
        imu
    ),
    text_key!(
        "device.imu_file",
        "TOML file whose [imu] table describes the inertial sensor: protocol, axes, mounting (docs/imu.md); empty = nothing more is known.",
        imu_file
    ),
    text_key!(
        "device.rig",
        "Rig file (TOML, config/rig-example.toml; `halflight rig` makes one): camera, its response and lens, inertial sensor, where the settings leave them open; empty = none.",
        rig
    ),
    text_key!(
        "device.display",
        "Where pictures are shown: empty = nowhere, \"null:hz=60\" = a screen that nobody sees.",
        display
    ),
    key!(
        "device.see_through",
        "",
        Range::Switch,
        "The display is looked through, as glasses are: objects are posed for the moment at which they are seen, not for the camera's.",
        |s| Value::Boolean(s.is_see_through),
        |s, v| s.is_see_through = v.as_bool().unwrap_or(false)
    ),
    text_key!(
        "device.link",
        "Where commands come from: empty = nowhere, \"stdio\" = lines on standard input, replies on standard output (try \"help\").",
        link
    ),
    key!(
        "camera.exposures_s",
        "s",
        Range::Reals(0.000_02, 1.0),
        "Exposure times that the camera goes through in turn, at first. Spread them by 4 to 8 (two to three stops) each; the shortest must not saturate in the light's reflection.",
        |s| Value::Array(s.exposures_s.iter().map(|&t| Value::Float(t)).collect()),
        |s, v| s.exposures_s = v.as_array().into_iter().flatten().map(number).collect()
    ),
    key!(
        "camera.replan",
        "",
        Range::Switch,
        "Fit the exposures to the scene while the camera runs: the longest lifts the shadows above noise, the shortest keeps the light's reflection. Off: exposures_s stays. Recordings have what they have.",
        |s| Value::Boolean(s.replan),
        |s, v| s.replan = v.as_bool().unwrap_or(true)
    ),
    key!(
        "camera.mains",
        "",
        Range::Choice(&["any", "50 Hz", "60 Hz"]),
        "Mains whose lamps must not flicker in the pictures: exposures of about 1/100 s (1/120 s) and more are made multiples of it. \"any\" = no care is taken.",
        |s| word(mains_word(s.mains)),
        |s, v| s.mains = mains_of(&text(v))
    ),
    key!(
        "camera.gain",
        "",
        Range::Real(1.0, 64.0),
        "Analogue gain for every exposure.",
        |s| Value::Float(s.gain),
        |s, v| s.gain = number(v)
    ),
    text_key!(
        "camera.response",
        "How exposure becomes 8 bits: \"device\" = as the device states (a camera that states nothing finds it from its own exposures at the start), \"srgb\", or a JSON file written by `halflight calibrate response` or `halflight hdr --save-response`.",
        response
    ),
    text_key!(
        "camera.calibration",
        "Lens of the camera: a calibration file (`halflight calibrate camera`; OpenCV or ROS YAML); a scene file's own wins; empty = what the camera states.",
        calibration
    ),
    key!(
        "engine.kind",
        "",
        Range::Choice(&["cpu", "gpu"]),
        "Which engine computes: the CPU twins of all shaders, or the GPU.",
        |s| word(if s.engine == EngineKind::Gpu { "gpu" } else { "cpu" }),
        |s, v| s.engine = if text(v) == "gpu" { EngineKind::Gpu } else { EngineKind::Cpu }
    ),
    key!(
        "engine.backend",
        "",
        Range::Choice(&["auto", "vulkan", "gl"]),
        "Which GPU interface; auto = Vulkan, else GL.",
        |s| word(match s.backend {
            BackendKind::Auto => "auto",
            BackendKind::Vulkan => "vulkan",
            BackendKind::Gl => "gl",
        }),
        |s, v| s.backend = match text(v).as_str() {
            "vulkan" => BackendKind::Vulkan,
            "gl" => BackendKind::Gl,
            _ => BackendKind::Auto,
        }
    ),
    key!(
        "engine.threads",
        "threads",
        Range::Integer(0, 256),
        "Threads of the CPU engine; 0 = one for each core. Results do not depend on it.",
        |s| Value::Integer(s.threads as i64),
        |s, v| s.threads = integer(v) as usize
    ),
    key!(
        "engine.cpu_kernels",
        "",
        Range::Words(&Pass::NAMES),
        "Kernels that run on their CPU twin although the engine is the GPU: finds GPU bugs.",
        |s| texts(&s.cpu_kernels),
        |s, v| s.cpu_kernels = v.as_array().into_iter().flatten().map(text).collect()
    ),
    key!(
        "track.decimate",
        "",
        Range::Integer(1, 8),
        "Tags are searched in a picture reduced by this factor; larger is faster and misses small tags.",
        |s| Value::Integer(i64::from(s.decimate)),
        |s, v| s.decimate = integer(v) as u32
    ),
    key!(
        "track.quad_sigma_px",
        "px",
        Range::Real(0.0, 2.0),
        "Blur before tags are searched; helps in noise.",
        |s| Value::Float(s.quad_sigma_px),
        |s, v| s.quad_sigma_px = number(v)
    ),
    key!(
        "track.search_ahead",
        "",
        Range::Switch,
        "Tags are looked for in the next frame while the one before it is drawn; pictures are the same.",
        |s| Value::Boolean(s.search_ahead),
        |s, v| s.search_ahead = v.as_bool().unwrap_or(true)
    ),
    key!(
        "light.order",
        "",
        Range::Integer(2, 6),
        "Order of the spherical harmonics: bands 0..order-1.",
        |s| Value::Integer(s.quality.sh_order as i64),
        |s, v| s.quality.sh_order = integer(v) as usize
    ),
    key!(
        "light.threshold",
        "",
        Range::Real(1e-6, 0.5),
        "Anisotropy below which no direction dominates; the directional light fades in up to 4 times this.",
        |s| Value::Float(s.light_threshold),
        |s, v| s.light_threshold = number(v)
    ),
    key!(
        "light.split",
        "",
        Range::Choice(&SplitKind::NAMES),
        "How much of the light is hard. compact: up to 4 lights with their extent, found in the picture of the environment; paper: one light by net flux, as [Now11] has it (a broad sky draws a hard shadow); bounded: the same, but no more than every band of the harmonics allows; sh: none.",
        |s| word(s.quality.split.name()),
        |s, v| s.quality.split = SplitKind::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "light.lights",
        "lights",
        Range::Integer(1, 4),
        "Compact lights that are looked for, the brightest first; what is not found stays in the soft half.",
        |s| Value::Integer(s.quality.lights as i64),
        |s, v| s.quality.lights = integer(v) as usize
    ),
    key!(
        "light.dering",
        "",
        Range::Switch,
        "Damp the soft half of the light, each colour for itself, until it shines negatively on no surface, and no more. Its flux stays; what the damping takes of its contrast is a tenth for a point light, nothing for most skies.",
        |s| Value::Boolean(s.quality.dering),
        |s, v| s.quality.dering = v.as_bool().unwrap_or(false)
    ),
    key!(
        "light.gray",
        "",
        Range::Choice(&["rec601", "rec709"]),
        "Weights from RGB to gray that the light's direction is taken from.",
        |s| word(match s.gray {
            GrayWeights::Rec601 => "rec601",
            GrayWeights::Rec709 => "rec709",
        }),
        |s, v| s.gray = if text(v) == "rec709" { GrayWeights::Rec709 } else { GrayWeights::Rec601 }
    ),
    key!(
        "light.filter_tau_s",
        "s",
        Range::Real(0.0, 10.0),
        "Time constant of the light's filter; 0 = none. Longer is steadier and lags behind switches.",
        |s| Value::Float(s.filter_tau_s),
        |s, v| s.filter_tau_s = number(v)
    ),
    key!(
        "light.ball_on_surface",
        "",
        Range::Switch,
        "Whether the mirror ball stands on the surface: what it sees below the horizon is then replaced by the unshadowed surface.",
        |s| Value::Boolean(s.ball_on_surface),
        |s, v| s.ball_on_surface = v.as_bool().unwrap_or(true)
    ),
    text_key!(
        "scene.file",
        "Scene file with virtual objects and real surfaces; empty = only the surface z = 0 and no objects.",
        scene_file
    ),
    key!(
        "quality.preset",
        "",
        Range::Choice(&PRESET_NAMES),
        "A point of the measured front of error against time (quality.front): draft is the cheapest, reference the most accurate; balanced takes away half of what lies between their errors, fine nine tenths. Keys that are typed too win over it. none: no preset.",
        |s| word(&s.preset),
        |s, v| s.preset = text(v)
    ),
    text_key!(
        "quality.front",
        "The measured front: \"bundled\", or a file front.json that `halflight tradeoff` wrote, for example on the device itself.",
        front
    ),
    key!(
        "quality.budget_ms",
        "ms",
        Range::Optional(0.1, 10_000.0),
        "A frame may take so long, from the camera's picture to the shown one: the governor walks along the front to the settings that err least within it, and corrects what it knows of their cost by every frame.",
        |s| optional(s.budget_ms),
        |s, v| s.budget_ms = real(v)
    ),
    key!(
        "quality.target_fps",
        "pictures/s",
        Range::Optional(0.1, 1000.0),
        "The same as a rate. With both, the shorter time counts.",
        |s| optional(s.target_fps),
        |s, v| s.target_fps = real(v)
    ),
    key!(
        "quality.max_error",
        "",
        Range::Optional(0.000_1, 10.0),
        "The error of shadows may be so large (relative RMSE, as measured for the front): the cheapest settings of the front that keep it; with a budget, no more accuracy than this is bought.",
        |s| optional(s.max_error),
        |s, v| s.max_error = real(v)
    ),
    key!(
        "quality.brackets",
        "frames",
        Range::Integer(1, 9),
        "Newest frames of different exposure that are merged into one HDR picture.",
        |s| Value::Integer(s.quality.brackets as i64),
        |s, v| s.quality.brackets = integer(v) as usize
    ),
    key!(
        "quality.light_every",
        "frames",
        Range::Integer(1, 60),
        "The light is measured on every n-th frame.",
        |s| Value::Integer(i64::from(s.quality.light_every)),
        |s, v| s.quality.light_every = integer(v) as u32
    ),
    key!(
        "quality.rung",
        "",
        Range::Choice(&["dc", "linear", "hybrid", "squared", "chain", "directions"]),
        "How the visibility of many spheres is put together where virtual bodies block soft light, cheapest first; directions is the only one that overlapping spheres cannot harm.",
        |s| word(s.quality.rung.name()),
        |s, v| s.quality.rung = Rung::parse(&text(v)).unwrap_or(Rung::Directions)
    ),
    key!(
        "quality.self_shadow",
        "",
        Range::Choice(&SelfShadow::NAMES),
        "The shadow of what never moves on itself and its like in soft light: by the share of the hemisphere that each vertex leaves open, or by transfer precomputed with rays (kept in the cache folder; 32 bytes a vertex at order 4, twice that where it is glossy). What moves uses the openness.",
        |s| word(s.quality.self_shadow.name()),
        |s, v| s.quality.self_shadow = SelfShadow::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "quality.phong_norm",
        "",
        Range::Choice(&PhongNorm::NAMES),
        "How glossy lobes are scaled: so that no light is made, or as in the paper, which is brighter by (s+2)/(s+1).",
        |s| word(s.quality.phong_norm.name()),
        |s, v| s.quality.phong_norm = PhongNorm::from_name(&text(v)).unwrap_or(PhongNorm::EnergySafe)
    ),
    key!(
        "quality.spheres",
        "spheres",
        Range::Integer(0, 64),
        "Spheres that stand for every body where it blocks soft light, 4 to 64 (1 to 3 count as 4); 0 = as many as the scene file says. They are fitted when first asked for, which takes a moment, and kept in the cache folder.",
        |s| Value::Integer(s.quality.spheres as i64),
        |s, v| s.quality.spheres = integer(v) as usize
    ),
    key!(
        "quality.directions",
        "directions",
        Range::Integer(32, 256),
        "How many directions the rung `directions` tests.",
        |s| Value::Integer(s.quality.directions as i64),
        |s, v| s.quality.directions = integer(v) as usize
    ),
    key!(
        "quality.effects",
        "",
        Range::Choice(&Effects::NAMES),
        "Which effects a frame has: those that scene, light and view call for, what has not changed being kept; or all that there is anything for, made anew in every frame. `halflight explain` tells why.",
        |s| word(s.quality.effects.name()),
        |s, v| s.quality.effects = Effects::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "quality.soft_at",
        "",
        Range::Choice(&SoftAt::NAMES),
        "Where soft shadows on real surfaces are evaluated: for pixels, or at the vertices of the surfaces, which are cut as finely as the shadow asks, and interpolated.",
        |s| word(s.quality.soft_at.name()),
        |s, v| s.quality.soft_at = SoftAt::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "quality.soft_step_px",
        "px",
        Range::IntegerChoice(&[1, 2, 4]),
        "Soft shadows on real surfaces are drawn on every n-th pixel of every n-th row, and carried up along the surface.",
        |s| Value::Integer(i64::from(s.quality.soft_step_px)),
        |s, v| s.quality.soft_step_px = integer(v) as u32
    ),
    key!(
        "quality.shadow_maps",
        "maps",
        Range::Integer(1, 256),
        "Shadow maps that all lights share: more make the shadows of wide lights softer. Each costs time. Compact lights take up to 64; from 5 maps on each has half, from 17 a quarter of shadow_map_texels. A known room's suns, lamps and walls share up to 256, each where it takes most error away; a sun of which objects hide nothing takes none. Those of its near lights have a quarter of shadow_map_texels.",
        |s| Value::Integer(s.quality.shadow_maps as i64),
        |s, v| s.quality.shadow_maps = integer(v) as usize
    ),
    key!(
        "quality.near_width_deg",
        "deg",
        Range::Real(0.0, 90.0),
        "In a known room, how wide its near lights may be, on average, seen from the objects. While they are wider, more are drawn than quality.shadow_maps, up to four times as many. 90: never.",
        |s| Value::Float(f64::from(s.quality.near_width_deg)),
        |s, v| s.quality.near_width_deg = number(v) as f32
    ),
    key!(
        "quality.shadow_map_texels",
        "texels",
        Range::Integer(64, 4096),
        "Side of the shadow map.",
        |s| Value::Integer(i64::from(s.quality.shadow_map_texels)),
        |s, v| s.quality.shadow_map_texels = integer(v) as u32
    ),
    key!(
        "quality.pcf_taps",
        "taps",
        Range::Integer(1, 8),
        "Side of the percentage-closer filter: 4 = 4x4 taps. In a known room each light casts its shadow from 4x4 places on it.",
        |s| Value::Integer(i64::from(s.quality.pcf_taps)),
        |s, v| s.quality.pcf_taps = integer(v) as u32
    ),
    key!(
        "quality.near_form",
        "",
        Range::Choice(&NearForm::NAMES),
        "How what objects hide of a known room's light is taken from the picture: `ratio` in linear light, exact; `ldr` from 8-bit values, light by light, as [Gib03] did: shadows of many weak lights vanish (each is rounded), and where nearly all light is hidden they are up to half of the range too bright.",
        |s| word(s.quality.near_form.name()),
        |s, v| s.quality.near_form = NearForm::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "quality.coverage_samples",
        "samples",
        Range::IntegerChoice(&[1, 4]),
        "Coverage samples for each pixel at the edges of objects.",
        |s| Value::Integer(i64::from(s.quality.coverage_samples)),
        |s, v| s.quality.coverage_samples = integer(v) as u32
    ),
    key!(
        "present.exposure_s",
        "s",
        Range::Real(0.0, 1.0),
        "Exposure of the shown picture; 0 = the one of the cycle that exposes the place best.",
        |s| Value::Float(s.shown_exposure_s),
        |s, v| s.shown_exposure_s = number(v)
    ),
    key!(
        "present.view",
        "",
        Range::Choice(&PictureView::NAMES),
        "What is shown. final: the picture. light: the light, as measured and in its halves; direct, global: objects and gray surfaces in one half of it; cast: what objects leave of the light on surfaces; self: what they hide from themselves; lambert, phong, mirror: every object of one material; blockers: the spheres that stand for objects; maps: the shadow maps.",
        |s| word(s.view.name()),
        |s, v| s.view = PictureView::from_name(&text(v)).unwrap_or_default()
    ),
    key!(
        "present.hud",
        "",
        Range::Switch,
        "Lay text over the picture: each effect of the frame, whether it is on, kept from an earlier frame or off, and why.",
        |s| Value::Boolean(s.hud),
        |s, v| s.hud = v.as_bool().unwrap_or(false)
    ),
    text_key!(
        "output.pictures",
        "Folder that every shown picture is written to as PNG; empty = none.",
        pictures_folder
    ),
    key!(
        "cache.max_mib",
        "MiB",
        Range::Integer(0, 1_048_576),
        "How large the cache folder may become ($CACHE_DIRECTORY under systemd, else $XDG_CACHE_HOME/halflight or ~/.cache/halflight). What was not used for the longest time is removed; 0 = nothing is kept.",
        |s| Value::Integer(s.cache_max_mib as i64),
        |s, v| s.cache_max_mib = integer(v) as u64
    ),
];
