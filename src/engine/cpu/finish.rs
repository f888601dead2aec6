//! The last two passes of a frame: objects over what is left of the place, and the way back to 8 bits.

use super::Twins;
use crate::compose::{composite, tonemap::ToneTable};
use crate::frame::{FrameJob, FrameState};
use crate::model::{image::RadianceImage, picture::Picture};
use crate::plan::Product;
use rayon::prelude::*;

impl Twins {
    /// Objects over what is left of the place.
    pub(super) fn composite(job: &FrameJob<'_>, state: &FrameState, out: &mut RadianceImage) {
        let background = &job.input.background.radiance;
        let (objects, ratios) = (job.uses.make(Product::ObjectLayer), job.uses.make(Product::Ratios));
        let width = background.width();
        out.reshape(width, background.height(), [0.0; 3]);
        let (layer, ratio) = (state.results.object_layer.pixels(), state.results.ratios.pixels());
        let rows = out.pixels_mut().par_chunks_mut(width.max(1));
        rows.zip(background.pixels().par_chunks(width.max(1))).enumerate().for_each(|(y, (out, row))| {
            for (x, (out, &below)) in out.iter_mut().zip(row).enumerate() {
                let i = y * width + x;
                let ratio = if ratios { ratio[i] } else { [1.0; 3] };
                let object = if objects { layer[i] } else { [0.0; 4] };
                *out = composite::over(below, ratio, object);
            }
        });
    }

    /// The way back to 8 bits.
    pub(super) fn tonemap(&mut self, job: &FrameJob<'_>, out: &mut Picture) {
        let input = job.input;
        let table = self.tone.get_or_insert_with(|| ToneTable::of(input.response));
        table.update(input.response);
        let (width, height) = (out.radiance.width(), out.radiance.height());
        out.display.reshape(width, height, [0; 3]);
        let exposure_s = input.shown_exposure.effective_s() as f32;
        let rows = out.display.pixels_mut().par_chunks_mut(width.max(1));
        rows.zip(out.radiance.pixels().par_chunks(width.max(1))).for_each(|(display, radiance)| {
            for (display, radiance) in display.iter_mut().zip(radiance) {
                *display = std::array::from_fn(|c| table.value(c, radiance[c] * exposure_s));
            }
        });
    }
}
