//! `halflight calibrate`: what a rig file needs to know of a camera.

mod board;
mod camera;
mod latency;
mod response;

use super::{CliError, GlobalOptions};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Measure a camera: its lens, its response, the delay of its exposure control.\n\n\
camera: the lens, from pictures of a chessboard or of a board of AprilTags. response: what light its 8-bit values mean, from its own \
exposures, for camera.response. latency: how many frames later a written exposure is in force, how often writes are \
altered, how far an exposure is from what it says.\n\n\
Examples:\n\n\
  halflight calibrate camera board-*.png --board chessboard:9x6,size=0.025 --out lens.yml\n\
  halflight calibrate camera board-*.png --board apriltag:6x6,size=0.088,spacing=0.3 --out lens.yml\n\
  halflight calibrate response v4l2:/dev/video0 --out response.json\n\
  halflight calibrate latency v4l2:/dev/video0 --frames 300";

/// Arguments of `halflight calibrate`.
#[derive(clap::Args, Debug)]
pub struct CalibrateArguments {
    /// What is measured.
    #[command(subcommand)]
    measured: CalibrationVerb,
}

impl CalibrateArguments {
    /// Whether a device is measured, which a signal ends in its own way.
    pub fn measures_a_device(&self) -> bool {
        !matches!(self.measured, CalibrationVerb::Camera(_))
    }
}

/// What is measured.
#[derive(clap::Subcommand, Debug)]
enum CalibrationVerb {
    /// The lens, from pictures of a chessboard or of a board of AprilTags.
    Camera(camera::CameraArguments),
    /// What light the camera's 8-bit values mean.
    Response(response::ResponseArguments),
    /// The delay of the camera's exposure control.
    Latency(latency::LatencyArguments),
}

/// Runs `halflight calibrate`.
pub fn run(arguments: CalibrateArguments, global: &GlobalOptions) -> Result<(), CliError> {
    match arguments.measured {
        CalibrationVerb::Camera(a) => camera::run(a, global),
        CalibrationVerb::Response(a) => response::run(a, global),
        CalibrationVerb::Latency(a) => latency::run(a, global),
    }
}

/// A result that was stopped before there was any.
fn interrupted() -> CliError {
    CliError("interrupted: nothing is measured".into()).with_status(crate::daemon::exit::INTERRUPTED)
}
