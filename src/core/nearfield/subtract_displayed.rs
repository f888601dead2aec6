//! What virtual objects leave of a known room's light, taken from the picture as an 8-bit display shows it: subtractive blending
//! with intensity transfers in two sets, Section 7.1, Eq. 4 and Fig. 4 of [Gib03]. What was done before there were float
//! targets; `subtract` (the ratio form) is exact and has none of its errors. Twin:
//! `shaders/nearfield/subtract_displayed.wgsl`.
//!
//! At a pixel of shown value I_b the light is X = T^-1(I_b), T the response as a real number. Lights are sorted from strong to
//! weak over the whole room and belong to two sets by turns; the suns come first in the second one. A light that sends E of
//! all light L, after lights of its set that send P together, is worth
//!
//! S = T(X (1 - P/L)) - T(X (1 - (P + E)/L)),
//!
//! times the share of it that objects hide, rounded to whole values; the target holds what is left of I_b, not below 0.
//!
//! # How far it is off
//! * Where the hidden lights send Q together and m is what the largest set leaves: T concave and before rounding,
//!   (T'(L) - T'(m)) Q <= I - I_exact <= (T'(L - Q) - T'(L)) Q. A linear display, a single light, or one set hidden from its
//!   first light on: none. Where all n lights are hidden and carry all light: 2 T(L/2) - T(L) - T(0) too bright: 117
//!   of 255 values for a gamma of 2.2.
//! * Each S is rounded: n/2 values at worst. Many weak lights vanish altogether: of 50 that carry a tenth of the light each S is
//!   below a half, and nothing is taken instead of 12 values.
//! * What is partly hidden, as by a filtered map, loses as large a part of S, though a display is steeper in the dark: penumbrae
//!   are too dark, up to 66 values for a single light that is all there is.
//! * A saturated picture (I_b = 255) counts as just saturated: what was brighter gets too dark a shadow.

use super::{
    frame::NearFrame,
    subtract::{self, RoomPoints, SubtractFrame, TINY_LIGHT, interpolated, lanes},
};
use crate::model::response::Response;

/// A response as a display has it.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayCurve {
    response: Response,
    /// For each channel where the rounded value steps up, as in `Response::thresholds`.
    thresholds: [[f32; 256]; 3],
    /// For each channel the exposure of each value, never decreasing.
    exposures: [[f32; 256]; 3],
}

impl DisplayCurve {
    /// The curve of a camera's response.
    pub fn of(response: &Response) -> Self {
        let exposures = response.log_exposure().map(|g| g.map(|x| f64::from(x).exp() as f32));
        Self { response: response.clone(), thresholds: response.thresholds(), exposures }
    }

    /// Takes another response; free where it is the same one.
    pub fn update(&mut self, response: &Response) {
        if self.response != *response {
            *self = Self::of(response);
        }
    }

    /// The shown value of an exposure: `compose::tonemap`'s.
    pub fn shown(&self, channel: usize, exposure: f32) -> u8 {
        // The last threshold is infinite.
        let steps = self.thresholds[channel].partition_point(|t| *t <= exposure.min(f32::MAX));
        if exposure > 0.0 { steps as u8 } else { 0 }
    }

    /// The exposure of a value.
    pub fn exposure(&self, channel: usize, shown: u8) -> f32 {
        self.exposures[channel][usize::from(shown)]
    }

    /// T: the value of an exposure as a real number within 0 to 255, linear between whole values.
    pub fn value(&self, channel: usize, exposure: f32) -> f32 {
        let list = &self.exposures[channel];
        let above = list.partition_point(|x| *x <= exposure);
        match above {
            0 => 0.0,
            256 => 255.0,
            _ => (above - 1) as f32 + (exposure - list[above - 1]) / (list[above] - list[above - 1]),
        }
    }

    /// Thresholds of each channel, then exposures of each, 256 each.
    pub fn rows(&self) -> [[f32; 256]; 6] {
        let ([a, b, c], [d, e, f]) = (self.thresholds, self.exposures);
        [a, b, c, d, e, f]
    }
}

/// The lights of a frame in their two sets; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct DisplayedLights {
    order: Vec<u16>,
    second: Vec<bool>,
    /// As `NearFrame::rows`: what lights before one in its set send to each vertex.
    before: Vec<[f32; 3]>,
    vertices: usize,
}

impl DisplayedLights {
    /// Sorts the lights of a frame from strong to weak, deals them out to the sets, and adds up what comes before each.
    pub fn update(&mut self, frame: &NearFrame) {
        let (rows, lights) = (frame.rows(), frame.lights().len());
        self.vertices = rows.len().checked_div(lights).unwrap_or(0);
        let strength = |k: u16| {
            frame.intensities().get(usize::from(k)).map_or(0.0, |rgb| crate::math::color::luminance(*rgb))
        };
        self.order.clear();
        self.order.extend(0..lights as u16);
        self.order.sort_unstable_by(|a, b| strength(*b).total_cmp(&strength(*a)).then(a.cmp(b)));
        self.second.clear();
        self.second.resize(lights, false);
        self.before.clear();
        self.before.resize(rows.len(), [0.0; 3]);
        for (place, &k) in self.order.iter().enumerate() {
            self.second[usize::from(k)] = place % 2 == 1;
            // The one before it in its set stands two places earlier.
            let Some(&earlier) = place.checked_sub(2).and_then(|p| self.order.get(p)) else { continue };
            let (to, from) = (usize::from(k) * self.vertices, usize::from(earlier) * self.vertices);
            for v in 0..self.vertices {
                let (sum, own) = (self.before[from + v], rows[from + v]);
                self.before[to + v] = std::array::from_fn(|c| sum[c] + own[c]);
            }
        }
    }

    /// What the lights before light `k` in its set send to a vertex.
    pub fn before(&self, k: usize, vertex: u32) -> [f32; 3] {
        self.before.get(k * self.vertices + vertex as usize).copied().unwrap_or([0.0; 3])
    }

    /// Whether light `k` is in the second set.
    pub fn is_second(&self, k: usize) -> bool {
        self.second.get(k).is_some_and(|second| *second)
    }
}

/// Everything that the pixels of one frame share.
#[derive(Clone, Copy)]
pub struct DisplayedFrame<'a> {
    /// The room, its lights and suns.
    pub with: SubtractFrame<'a>,
    /// The lights in their sets.
    pub lights: &'a DisplayedLights,
    /// How the display makes values of light.
    pub curve: &'a DisplayCurve,
}

/// The intensity transfer of one light in a channel, as an 8-bit target takes it: `shares` of all light before it in its set,
/// and with it, `exposure` X, and the share of it that is `hidden`.
pub fn transfer(
    curve: &DisplayCurve,
    channel: usize,
    exposure: f32,
    [before, with]: [f32; 2],
    hidden: f32,
) -> f32 {
    let at = |share: f32| curve.value(channel, exposure * (1.0 - share).max(0.0));
    (hidden * (at(before) - at(with)) + 0.5).floor()
}

/// As `subtract::at_points`; `exposures` gives the exposure of the camera's picture at a point. The ratio shows what is left
/// in the 8-bit target: the picture times it, through the response, is that value, and never more than before.
pub fn at_points<const N: usize>(
    shared: &DisplayedFrame<'_>,
    run: &RoomPoints<'_, N>,
    weights: impl Fn(usize) -> [f32; 3],
    exposures: impl Fn(usize) -> [f32; 3],
    out: &mut [[f32; 3]],
) {
    let DisplayedFrame { with, lights, curve } = *shared;
    let count = out.len().min(N);
    let out = &mut out[..count];
    let lit = run.corners.map(|v| with.field.gathered_rgb.get(v as usize).copied().unwrap_or([0.0; 3]));
    let weights = lanes(count, weights);
    let between = |of: &[[f32; 3]; 3], i: usize| -> [f32; 3] {
        std::array::from_fn(|c| interpolated(&of.map(|of| of[c]), &weights, i))
    };
    let (mut whole, mut suns, mut taken) = ([[0.0f32; 3]; N], [[0.0f32; 3]; N], [[0.0f32; 3]; N]);
    let mut shown = [[0u8; 3]; N];
    let linear = |i: usize, shown: &[[u8; 3]; N]| -> [f32; 3] {
        std::array::from_fn(|c| curve.exposure(c, shown[i][c]))
    };
    for i in 0..count {
        let background = exposures(i);
        shown[i] = std::array::from_fn(|c| curve.shown(c, background[c]));
        let gathered = between(&lit, i);
        let mut hidden = [0.0; 3];
        if !with.suns.is_empty() {
            let point = run.points_world.map(|axis| axis[i]).into();
            let maps = with.frame.sun_maps();
            [suns[i], hidden] = with.suns.at(point, run.normal, maps, with.sun_shadows, with.taps);
        }
        let x = linear(i, &shown);
        for c in 0..3 {
            whole[i][c] = suns[i][c] + gathered[c];
            if whole[i][c] > TINY_LIGHT && hidden[c] > 0.0 {
                let share = suns[i][c] / whole[i][c];
                taken[i][c] = transfer(curve, c, x[c], [0.0, share], hidden[c] / suns[i][c]);
            }
        }
    }
    subtract::each_hidden(&with, run, &|| &weights, |light, visible| {
        let sent = run.corners.map(|v| with.frame.sent(light, v));
        let before = run.corners.map(|v| lights.before(light, v));
        for i in (0..count).filter(|&i| visible[i] < 1.0) {
            let (sent, before) = (between(&sent, i), between(&before, i));
            let x = linear(i, &shown);
            for c in (0..3).filter(|&c| whole[i][c] > TINY_LIGHT) {
                let earlier = if lights.is_second(light) { before[c] + suns[i][c] } else { before[c] };
                let shares = [earlier / whole[i][c], (earlier + sent[c]) / whole[i][c]];
                taken[i][c] += transfer(curve, c, x[c], shares, 1.0 - visible[i]);
            }
        }
    });
    for (i, out) in out.iter_mut().enumerate() {
        let background = if taken[i] == [0.0; 3] { [0.0; 3] } else { exposures(i) };
        *out = std::array::from_fn(|c| {
            let left = f32::from(shown[i][c]) - taken[i][c];
            ratio(curve, c, background[c], left.max(0.0) as u8, shown[i][c])
        });
    }
}

/// What makes `left` of an exposure that is shown as `shown`; of an infinite one nothing is taken.
fn ratio(curve: &DisplayCurve, channel: usize, exposure: f32, left: u8, shown: u8) -> f32 {
    if left >= shown || !exposure.is_finite() {
        1.0
    } else if left == 0 {
        0.0
    } else {
        (curve.exposure(channel, left) / exposure).min(1.0)
    }
}

#[cfg(test)]
mod tests;
