//! `synthetic:` a virtual room, ray traced, with known truth. Equal options give equal pixels for any
//! number of threads.
//!
//! World: z up, metres, the table's top is z = 0; tag36h11 number 0 lies at the origin, its upright picture
//! seen from above with its upper edge towards +y; the mirror ball stands on the table beside it. All
//! surfaces but the ball are Lambertian. The light of lamp and window is baked with its shadows, and three
//! bounces between all surfaces; light that the ball throws onto other things is left out.

mod bake;
pub mod film;
mod furnish;
pub mod motion;
pub mod options;
mod paint;
mod picture;
pub(crate) mod random;
mod room;
mod rough;
mod shapes;
mod truth;

use super::{DeviceError, ErrorKind, FrameSource, Truth};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    frame::{Exposure, RawFrame},
    light::{EnvironmentMap, RadianceSh},
    response::Response,
    rig::{Rig, TagPlacement},
    time::Timestamp,
};
use glam::{DMat3, DVec3};
pub use motion::SyntheticImu;
use motion::Trajectory;
pub use options::{SyntheticOptions, SyntheticSubject};
pub use paint::{PAPER_SIDE_M, TAG_SIDE_M};
use std::sync::{Arc, Mutex, PoisonError};

/// Time of the first frame.
pub const START_S: f64 = 1.0;
/// The IMU starts so much earlier and ends so much later than the frames.
const IMU_MARGIN_S: f64 = 0.2;
/// Focal length in widths of the picture.
const FOCAL_WIDTHS: f64 = 1.02;
/// The same of the wider lens for the whole room.
const ROOM_FOCAL_WIDTHS: f64 = 0.70;

/// The virtual room's camera.
pub struct SyntheticSource {
    options: SyntheticOptions,
    device: String,
    lens: Lens,
    place: Arc<BakedRoom>,
    trajectory: Arc<Trajectory>,
    response: Response,
    quantiser: film::Quantiser,
    next: u64,
    truth: Option<Truth>,
}

/// The room with its light, and the truth that follows from it.
struct BakedRoom {
    room: room::SyntheticRoom,
    light: RadianceSh,
}

impl BakedRoom {
    fn new(texel_mm: f64, view: SyntheticSubject) -> Arc<Self> {
        let fineness = bake::Fineness { table_texel_m: texel_mm * 1e-3, seed: 0x5eed };
        let room = room::SyntheticRoom::new(view, fineness);
        Arc::new(Self { light: truth::light_at_ball(&room), room })
    }

    /// The place as computed before in this process, if it was; it depends on nothing but the texel.
    fn shared(texel_mm: f64, view: SyntheticSubject) -> Arc<Self> {
        static MADE: Mutex<Vec<(f64, SyntheticSubject, Arc<BakedRoom>)>> = Mutex::new(Vec::new());
        let made = || MADE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((.., place)) = made().iter().find(|(texel, of, _)| *texel == texel_mm && *of == view) {
            return Arc::clone(place);
        }
        // Not under the lock: computing uses the thread pool, which may run other work that opens a room.
        let place = Self::new(texel_mm, view);
        let mut list = made();
        list.truncate(1);
        list.insert(0, (texel_mm, view, Arc::clone(&place)));
        place
    }
}

/// Opens the room's camera and its IMU. The first call takes a second or two to compute the light.
pub fn open(options: &SyntheticOptions) -> (SyntheticSource, SyntheticImu) {
    assemble(options, BakedRoom::shared(options.texel_mm, options.view))
}

/// The same with all light computed anew.
pub fn open_anew(options: &SyntheticOptions) -> (SyntheticSource, SyntheticImu) {
    assemble(options, BakedRoom::new(options.texel_mm, options.view))
}

fn assemble(options: &SyntheticOptions, place: Arc<BakedRoom>) -> (SyntheticSource, SyntheticImu) {
    let trajectory = Arc::new(Trajectory::new(options.seed, options.motion, options.view));
    let response = film::film();
    let (width, height) = options.size;
    let focal_widths = match options.view {
        SyntheticSubject::Desk => FOCAL_WIDTHS,
        SyntheticSubject::Room => ROOM_FOCAL_WIDTHS,
    };
    let focal = focal_widths * f64::from(width);
    let end_s = START_S + options.frames as f64 / options.fps;
    let source = SyntheticSource {
        device: format!("synthetic:seed={}", options.seed),
        lens: Lens::pinhole(width, height, focal, focal, f64::from(width) / 2.0, f64::from(height) / 2.0),
        quantiser: film::Quantiser::new(&response),
        options: options.clone(),
        place,
        trajectory: Arc::clone(&trajectory),
        response,
        next: 0,
        truth: None,
    };
    let span = (START_S - IMU_MARGIN_S, end_s + IMU_MARGIN_S);
    let imu = SyntheticImu::new(trajectory, options.seed, options.noise, options.imu_offset_s, span);
    (source, imu)
}

/// Where the tag lies: its picture's x along the world's x, its y along -y, its z into the table.
pub fn world_from_tag() -> Pose {
    Pose::from_matrix(DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z), DVec3::ZERO)
}

/// Where the tag on the board is in the view of the room: its picture's x along the board, its y down, its z into the board.
pub fn world_from_board() -> Pose {
    let (foot, degrees) = furnish::BOARD;
    let (s, c) = degrees.to_radians().sin_cos();
    let (along, into) = (DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0));
    let front = DVec3::from(foot) + DVec3::Z * (paint::BOARD_SIDE_M / 2.0) - into * 0.01;
    Pose::from_matrix(DMat3::from_cols(along, -DVec3::Z, into), front)
}

/// The room as somebody would measure it with a tape: its walls, what stands on the floor, the window and the lamp.
pub fn rough_room(view: SyntheticSubject) -> crate::model::room::Room {
    rough::room(&furnish::furnish(view))
}

impl SyntheticSource {
    /// What a probe at a place of the room sees: an equirectangular picture of the whole sphere, twice as wide as `height`.
    pub fn probe(&self, position_world: DVec3, height: usize) -> EnvironmentMap {
        rough::probe(&self.place.room, position_world, height)
    }

    /// The camera's pose at a true time, seconds.
    pub fn world_from_camera(&self, t: f64) -> Pose {
        self.trajectory.world_from_camera(t)
    }

    /// Exact mean radiance over one pixel as seen from a pose: the noise-free answer.
    pub fn radiance_at(&self, world_from_camera: Pose, x: usize, y: usize) -> [f64; 3] {
        self.shot(world_from_camera, self.options.exposures[0], 0).pixel(x, y).to_array()
    }

    /// Exact radiance that reaches the ball's centre from a unit direction, as the true light defines it.
    pub fn truth_radiance(&self, direction: DVec3) -> [f64; 3] {
        truth::radiance(&self.place.room, self.place.room.ball().centre_world, direction).to_array()
    }

    fn shot(&self, world_from_camera: Pose, exposure: Exposure, frame: u64) -> picture::Shot<'_> {
        picture::Shot {
            room: &self.place.room,
            lens: &self.lens,
            world_from_camera,
            exposure,
            noise: self.options.noise,
            key: [self.options.seed ^ 0xca3e7a, frame],
            samples: self.options.samples,
        }
    }
}

impl FrameSource for SyntheticSource {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        if self.next >= self.options.frames {
            let action = format!("frame {}: there are {} frames", self.next, self.options.frames);
            return Err(DeviceError::new(&self.device, action, ErrorKind::Ended));
        }
        let sequence = self.next;
        let seconds = START_S + sequence as f64 / self.options.fps;
        let t_mid = Timestamp::from_seconds(seconds);
        if t_mid > deadline {
            return Err(DeviceError::again());
        }
        self.next += 1;
        let exposure = self.options.exposures[(sequence % self.options.exposures.len() as u64) as usize];
        let world_from_camera = self.trajectory.world_from_camera(seconds);
        let pixels = self.shot(world_from_camera, exposure, sequence).take(&self.quantiser);
        self.truth = Some(Truth {
            pose: PoseEstimate {
                t: t_mid,
                world_from_camera,
                provenance: Provenance::Measured,
                sigma_position_m: 0.0,
                sigma_rotation_rad: 0.0,
            },
            light: self.place.light,
            to_light_world: truth::dominant_direction(&self.place.light),
        });
        let pixels = Arc::new(pixels);
        Ok(RawFrame { sequence, t_mid, exposure, pixels, sensor: None, row_time_s: 0.0, response: None })
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        let longest = 1.0 / self.options.fps;
        let good = |e: &Exposure| {
            (options::SHORTEST_S..=longest).contains(&e.time_s) && (1.0..=16.0).contains(&e.gain)
        };
        if !(1..=9).contains(&exposures.len()) || !exposures.iter().all(good) {
            let action = format!(
                "exposures {exposures:?}: must be 1 to 9, time_s within {}..={longest:.6}, gain within 1..=16",
                options::SHORTEST_S
            );
            return Err(DeviceError::new(&self.device, action, ErrorKind::Refused));
        }
        self.options.exposures = exposures.to_vec();
        Ok(exposures.to_vec())
    }

    fn rig(&self) -> Option<Rig> {
        let tag = |side_m, world_from_tag| vec![TagPlacement { id: 0, side_m, world_from_tag }];
        let (tags, ball) = match self.options.view {
            SyntheticSubject::Desk => (tag(TAG_SIDE_M, world_from_tag()), Some(self.place.room.ball())),
            // The ball is too small in the picture to read light from.
            SyntheticSubject::Room => (tag(paint::BOARD_TAG_SIDE_M, world_from_board()), None),
        };
        Some(Rig { lens: self.lens, tags, ball })
    }

    fn response(&self) -> Option<Response> {
        Some(self.response.clone())
    }

    fn frames_left(&self) -> Option<u64> {
        Some(self.options.frames - self.next)
    }

    fn truth(&mut self) -> Option<Truth> {
        self.truth.clone()
    }

    fn scene(&self) -> Option<String> {
        let view = match self.options.view {
            SyntheticSubject::Desk => "desk",
            SyntheticSubject::Room => "room",
        };
        Some(format!("synthetic room, view {view}"))
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
}
