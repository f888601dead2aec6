//! The scene file: camera, light, rig, real surfaces and virtual objects, in TOML.
//!
//! ```toml
//! # All lengths in metres, in the world frame: z up, the surface that things stand on is z = 0.
//! [camera]                           # only for stills; a recording brings its own
//! lens = { width = 640, height = 480, fx = 650.0, fy = 650.0, cx = 320.0, cy = 240.0 }
//! # or: calibration = "camera.yaml"  # OpenCV or ROS; lens.distortion = [k1, k2, p1, p2, k3] or lens.fisheye = [k1, k2, k3, k4]
//! position = [0.0, -0.6, 0.4]
//! look_at = [0.0, 0.0, 0.0]          # or: world_from_camera = four rows of four numbers
//! pictures = ["a.jpg", "b.jpg"]      # the place as it is: the background, merged if there are several
//! exposures_s = [0.01, 0.04]
//! response = "srgb"                  # or "solve" (from the pictures), or a JSON file
//!
//! [light]                            # one of: measure, file, constant (with or without to_light)
//! measure = "ball"                   # from light.pictures, taken by the same camera with the ball in place
//! pictures = ["ball_a.jpg", "ball_b.jpg"]
//! exposures_s = [0.01, 0.04]
//! # file = "room.hdr", layout = "equirect" | "angular" | "cube", up = "z" | "y", rotation_deg = 30.0
//! # constant = [0.3, 0.3, 0.3], to_light = [0.5, 0.0, 0.8], irradiance_rgb = [3.0, 3.0, 2.8]
//! # below = "given"                # of file or constant, light from below the horizon: as given (default), "dark" (none),
//!                                    # or "surface" (what z = 0 sends up; surface_albedo_rgb = [0.5, 0.5, 0.5])
//!
//! [room]                             # known geometry of the real place: near light and its shadows
//! file = "room.glb"                  # glTF (emissive parts shine), or a reference case
//! light = "probe"                    # "given" (what the file's surfaces emit; default), or read off a probe:
//! probe = "room.hdr"                 # an environment picture taken inside; layout, up, rotation_deg as in [light]
//! probe_position = [0.0, 0.0, 0.4]   # where
//! sun = true                         # small strong lights that it sees become suns that shine in (default)
//! patch_m = 0.2                      # mean size of a patch (default: 1500 patches)
//! probe_rows = 128                   # rows that the probe's picture is reduced to, about; left out: as it is
//! power_share = 0.7                  # share of the power of all patches that the sources of shadows have
//! neglected_share = 0.005            # share of the light at each corner that may be neglected
//! rays = 1                           # from each corner to each source: 1, 4, 9, .. 64
//!
//! [ball]
//! centre = [-0.2, 0.04, 0.06]
//! radius_m = 0.06
//! reflectance_rgb = [0.95, 0.95, 0.95]
//! on_surface = true                  # what it sees below the horizon is replaced by the unshadowed surface
//! surface_radius_m = 0.5             # the surface is flat and of one kind this far around it (default: 12 radii)
//!
//! [[tag]]
//! id = 0
//! side_m = 0.1
//! position = [0.0, 0.0, 0.0]         # lies flat; its upright picture's upper edge points to +y, turned by yaw_deg
//! yaw_deg = 0.0
//!
//! [[surface]]                        # real: receives virtual shadows, hides what lies behind it
//! shape = "plane"                    # plane (half_extent, at position), box, sphere, cylinder, quad (corners), or file = "x.obj"
//! half_extent = 0.5
//! receives_shadow = true
//!
//! [[object]]                         # virtual; stands with its lowest point at position
//! shape = "pawn"                     # pawn, pawn_with_ring, vase, sphere, box, cylinder, capsule, torus, torus_knot, or file = "x.glb"
//! height_m = 0.12
//! position = [0.1, 0.0, 0.0]
//! yaw_deg = 30.0
//! material = { kind = "lambert", albedo_rgb = [0.8, 0.7, 0.5] }   # or phong (specular_rgb, exponent), mirror (reflectance_rgb)
//! spheres = 16                       # how many stand for it where it blocks soft light, 4 to 64
//!
//! [[object]]                         # something that a hand carries: time_s, x, y, z of its lowest point, smooth between them
//! shape = "vase"
//! height_m = 0.2
//! carry = [[0.0, -0.4, -0.7, -0.7], [1.5, -0.2, -0.6, -0.3], [4.0, 0.1, 0.1, -0.7]]
//!
//! [[object]]                         # a figure that walks
//! file = "walker.glb"
//! height_m = 0.2
//! animation = "Walk"                 # one of the file's; without this key it stands as its file's nodes say
//! animation_speed = 1.0              # seconds of the clip in a second
//! animation_start_s = 0.25           # where in the clip it begins
//! path = [[0.1, 0.0], [0.3, 0.1], [0.1, 0.2]]   # closed, corners rounded; it faces its way (plus yaw_deg)
//! path_speed_m_s = 0.1
//! ```
//! Paths are relative to the scene file.

mod figure;
pub mod keys;
mod place;
mod rig;
mod room;
mod walk;

pub use room::{RoomLightSource, RoomSource};

use super::error::{AssetError, TextPosition, read_text};
use crate::light::below::BelowHorizon;
use crate::math::{lens::Lens, pose::Pose};
use crate::model::limits::MAX_TIME_S;
use crate::model::{
    rig::{MirrorBall, Rig, TagPlacement},
    scene::{RealSurface, Scene},
};
use glam::Affine3A;
use std::path::{Path, PathBuf};
use toml::de::DeTable;
use walk::{Mistakes, Section, number};

/// Triangles by which the ball hides what lies behind it: 20 * 4^4.
const BALL_SUBDIVISIONS: u32 = 4;

/// A camera for stills.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneCamera {
    /// From the calibration's file or from numbers.
    pub lens: Lens,
    /// Where it stands.
    pub world_from_camera: Pose,
    /// The place as it is; empty where there is no picture.
    pub pictures: Pictures,
}

/// Pictures of one bracket, as files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    /// Resolved paths.
    pub files: Vec<PathBuf>,
    /// One for each file.
    pub exposures_s: Vec<f64>,
    /// "srgb", "solve", or a JSON file's path.
    pub response: String,
}

/// Where the light comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSource {
    /// The file does not say: the pipeline measures it, a still has none.
    Unstated,
    /// Read off the ball in these pictures.
    Ball(Pictures),
    /// An environment picture.
    File {
        /// Resolved path.
        file: PathBuf,
        /// How its texels cover the sphere.
        layout: crate::model::light::MapLayout,
        /// Whether its up is +y (else +z).
        y_up: bool,
        /// Turned about the world's z axis, counter-clockwise seen from above.
        rotation_deg: f64,
    },
    /// Stated in numbers.
    Stated {
        /// Radiance of the uniform part.
        constant_rgb: [f32; 3],
        /// Unit direction and E_d of the directional part.
        direct: Option<([f32; 3], [f32; 3])>,
    },
}

/// A scene file, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// Where it was read; relative paths start from its folder.
    pub file: PathBuf,
    /// Virtual objects and real surfaces.
    pub scene: Scene,
    /// The camera for stills.
    pub camera: Option<SceneCamera>,
    /// What `[light]` says.
    pub light: LightSource,
    /// Which light comes from below the horizon.
    pub light_below: BelowHorizon,
    /// What `[room]` says; not loaded yet.
    pub room: Option<RoomSource>,
    /// Tags whose places are known.
    pub tags: Vec<TagPlacement>,
    /// The mirror ball's place and size.
    pub ball: Option<MirrorBall>,
    /// Whether the ball stands on the surface.
    pub ball_on_surface: bool,
}

impl SceneFile {
    /// The rig for the pipeline: what this file states wins over what the device knows.
    ///
    /// # Errors
    /// Neither knows the lens.
    pub fn rig_over(&self, device: Option<Rig>) -> Result<Rig, AssetError> {
        let lens = match (&self.camera, &device) {
            (Some(camera), _) => camera.lens,
            (None, Some(rig)) => rig.lens,
            (None, None) => {
                return Err(
                    AssetError::new(&self.file, "camera").allowed("given: the device does not know its lens")
                );
            }
        };
        let (device_tags, device_ball) = device.map_or((Vec::new(), None), |rig| (rig.tags, rig.ball));
        let tags = if self.tags.is_empty() { device_tags } else { self.tags.clone() };
        Ok(Rig { lens, tags, ball: self.ball.or(device_ball) })
    }

    /// The scene with the real ball in it: it hides virtual objects behind it and receives no shadow.
    pub fn scene_with_ball(&self, ball: Option<&MirrorBall>) -> Scene {
        let mut scene = self.scene.clone();
        if let Some(ball) = ball {
            let sphere = super::shapes::icosphere(ball.radius_m, BALL_SUBDIVISIONS);
            let place = Affine3A::from_translation(ball.centre_world.as_vec3());
            let mesh = super::shapes::transformed(&sphere, &place);
            scene.surfaces.push(RealSurface {
                name: "mirror ball".into(),
                mesh,
                receives_shadow: false,
                albedo_rgb: None,
            });
        }
        scene
    }
}

/// Reads and checks a scene file with all that it names.
///
/// # Errors
/// All mistakes of the file at once, each with its line and column, key, value and what is allowed; or a file it names that cannot be read.
pub fn load(file: &Path) -> Result<SceneFile, AssetError> {
    parse(file, &read_text(file)?)
}

/// Checks a scene file's text; `file` is for messages and tells where other files are.
///
/// # Errors
/// As `load`.
pub fn parse(file: &Path, text: &str) -> Result<SceneFile, AssetError> {
    let document = DeTable::parse(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        let mistake = AssetError::new(file, "is not valid TOML").at(TextPosition::of(text, at));
        mistake.cause(error.message().to_owned())
    })?;
    let mistakes = Mistakes::new(file, text);
    let root = Section::new("", document.get_ref(), 0, &mistakes);
    let folder = file.parent().unwrap_or(Path::new(""));
    let camera = root.table("camera").and_then(|s| rig::camera(&s, folder, &mistakes));
    let (light, light_below) = root
        .table("light")
        .map_or((LightSource::Unstated, BelowHorizon::AsGiven), |s| rig::light(&s, folder));
    let room = root.table("room").and_then(|s| room::room(&s, folder));
    let (ball, ball_on_surface) = root.table("ball").map_or((None, true), |s| rig::ball(&s));
    let tags = root.tables("tag").iter().filter_map(rig::tag).collect();
    let surfaces: Vec<RealSurface> = root
        .tables("surface")
        .iter()
        .enumerate()
        .filter_map(|(i, s)| place::surface(s, i, folder, &mistakes))
        .collect();
    let mut scene = Scene { surfaces, ..Scene::default() };
    for (i, section) in root.tables("object").iter().enumerate() {
        let Some((objects, mut figure)) = place::objects(section, i, folder, &mistakes) else { continue };
        figure.parts.iter_mut().for_each(|part| part.object += scene.objects.len());
        scene.objects.extend(objects);
        scene.figures.push(figure);
    }
    root.finish();
    match mistakes.into_error() {
        Some(error) => Err(error),
        None => {
            let file = file.to_owned();
            Ok(SceneFile { file, scene, camera, light, light_below, room, tags, ball, ball_on_surface })
        }
    }
}

/// A path of the file, resolved against its folder.
fn resolved(folder: &Path, name: &str) -> PathBuf {
    folder.join(name)
}

/// `pictures`, `exposures_s` and `response` of a section.
fn pictures(section: &Section<'_>, folder: &Path) -> Pictures {
    let files: Vec<PathBuf> = section
        .read("pictures", "a list of file names", |v| {
            v.as_array()?.iter().map(|f| f.as_str().map(|f| resolved(folder, f))).collect()
        })
        .unwrap_or_default();
    let exposures_s: Vec<f64> = section
        .read("exposures_s", "a list of numbers above 0, at most 1e5, one for each of the pictures", |v| {
            let list: Vec<f64> = v.as_array()?.iter().map(number).collect::<Option<_>>()?;
            (list.len() == files.len() && list.iter().all(|&t| t > 1e-9 && t <= MAX_TIME_S)).then_some(list)
        })
        .unwrap_or_else(|| vec![1.0; files.len()]);
    if !section.has("exposures_s") && files.len() > 1 {
        section.refuse("exposures_s", "given: several pictures need one exposure time each");
    }
    let response = match section.text("response") {
        None => "srgb".to_owned(),
        Some(word @ ("srgb" | "solve")) => word.to_owned(),
        Some(name) => crate::model::path_text::to_text(&resolved(folder, name)),
    };
    Pictures { files, exposures_s, response }
}
