//! What a camera that stands on another one asks of that: all that it does not do by itself. A method that is forgotten would
//! fall back to the trait's default and say nothing; so each is named here once.

/// Hands the named methods of `FrameSource` on to the field `source`.
macro_rules! ask_source {
    (@ set_exposures) => {
        fn set_exposures(
            &mut self,
            exposures: &[$crate::model::frame::Exposure],
        ) -> Result<Vec<$crate::model::frame::Exposure>, $crate::DeviceError> {
            self.source.set_exposures(exposures)
        }
    };
    (@ rig) => {
        fn rig(&self) -> Option<$crate::model::rig::Rig> {
            self.source.rig()
        }
    };
    (@ response) => {
        fn response(&self) -> Option<$crate::model::response::Response> {
            self.source.response()
        }
    };
    (@ frames_left) => {
        fn frames_left(&self) -> Option<u64> {
            self.source.frames_left()
        }
    };
    (@ truth) => {
        fn truth(&mut self) -> Option<$crate::Truth> {
            self.source.truth()
        }
    };
    (@ scene) => {
        fn scene(&self) -> Option<String> {
            self.source.scene()
        }
    };
    (@ delivers_at_once) => {
        fn delivers_at_once(&self) -> bool {
            self.source.delivers_at_once()
        }
    };
    (@ pixel_format) => {
        fn pixel_format(&self) -> Option<$crate::model::pixels::PixelFormat> {
            self.source.pixel_format()
        }
    };
    (@ bracket_report) => {
        fn bracket_report(&self) -> Option<$crate::bracket::Report> {
            self.source.bracket_report()
        }
    };
    ($($method:ident)+) => {
        $(ask_source!(@ $method);)+
    };
}
pub(crate) use ask_source;
