//! The response of a camera that runs: looked for at its start, one frame after the other (`bracket::response` does the thinking).

use super::{BracketedCamera, ExposureControl};
use crate::DeviceError;
use crate::bracket::{
    ThumbnailReader,
    response::{ResponseSearch, SearchStep},
};
use crate::developed::CaptureSource;
use crate::model::{
    frame::{Exposure, RawFrame},
    response::Response,
};
use std::sync::Arc;

/// The longest exposure of a search, seconds: a longer one slows a camera of 30 frames a second down.
const LONGEST_SEARCHED_S: f64 = 1.0 / 30.0;

impl<S: CaptureSource + ExposureControl> BracketedCamera<S> {
    /// Takes what was found of this camera before, or begins to look. One exposure alone needs no response.
    pub(super) fn know_response(&mut self) -> Result<(), DeviceError> {
        let identity = self.camera.source_mut().identity();
        let Some(found) = self.to_find.as_ref().filter(|_| self.cycle.len() > 1) else { return Ok(()) };
        match found.of(&identity) {
            Some(response) => self.use_found(response),
            None => self.begin_search()?,
        }
        Ok(())
    }

    /// Looks for the response where there is something to find and to see.
    pub(super) fn begin_search(&mut self) -> Result<(), DeviceError> {
        let Some(first) = self.cycle.get(self.cycle.len() / 2).copied() else { return Ok(()) };
        let times = self.cycle.iter().map(|e| e.time_s);
        let (shortest_s, longest_s) = times.fold((f64::INFINITY, 0.0f64), |(s, l), t| (s.min(t), l.max(t)));
        let taken = self.hold(first)?;
        let longest_s = (2.0 * longest_s).min(LONGEST_SEARCHED_S.max(longest_s));
        self.search = Some(ResponseSearch::new(taken, 0.5 * shortest_s, longest_s));
        Ok(())
    }

    /// One frame of the search.
    pub(super) fn look_for_response(&mut self, frame: &RawFrame) -> Result<(), DeviceError> {
        let Some(mut search) = self.search.take() else { return Ok(()) };
        self.counts.left_out += 1;
        let mut step = match self.camera.source_mut().states_exposures() {
            // A sensor's own values are coded here, so their response is known.
            _ if self.camera.is_coded_here() => SearchStep::Finish,
            true => search.stated_frame(&frame.pixels, &self.thumbnail, frame.exposure),
            false => search.frame(&frame.pixels, &self.thumbnail),
        };
        while let SearchStep::Write(wish) = step {
            step = search.written(self.hold(wish)?);
        }
        if step != SearchStep::Finish {
            self.search = Some(search);
            return Ok(());
        }
        match search.finish() {
            _ if self.camera.is_coded_here() => {}
            Ok(response) => self.use_found(Arc::new(response)),
            Err(why) => {
                tracing::warn!(
                    "{}: its response cannot be told from its pictures, sRGB is taken: {why}",
                    self.device
                );
                // Others that fail notice it by their brackets, which do not settle.
                if self.camera.source_mut().states_exposures() {
                    self.wait_before_trying_again();
                }
            }
        }
        self.begin_cycle()
    }

    fn use_found(&mut self, response: Arc<Response>) {
        let identity = self.camera.source_mut().identity();
        if let Some(found) = self.to_find.as_ref().filter(|_| !identity.is_empty()) {
            found.keep(identity, &response);
        }
        self.reader = ThumbnailReader::new(&response);
        self.camera.state_response(Response::clone(&response));
        self.found = Some(response);
        tracing::info!("{}: its response was found from its own exposures", self.device);
    }

    /// Asks for one exposure for all frames to come; returns what the camera took.
    fn hold(&mut self, wish: Exposure) -> Result<Exposure, DeviceError> {
        let source = self.camera.source_mut();
        if source.states_exposures() {
            let taken = source.set_exposures(&[wish])?;
            return Ok(taken.first().copied().unwrap_or(wish));
        }
        source.write_exposure(wish)
    }
}
