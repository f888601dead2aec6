//! Lights that are saturated in every exposure: where they are on the ball, and how their light spreads over their
//! pixels. How much it is, [`super::surface::SurfaceFit`] reads from their shadow.

use crate::model::{image::LOWER_BOUND, light::RadianceSamples};
use glam::Vec3;

/// Saturated lights that are measured one by one; the faintest beyond stay at their lower bound.
pub const MOST_LIGHTS: usize = 4;
/// Cells into which their pixels are gathered at most.
const MOST_CELLS: usize = 256;
/// A channel of a flagged pixel counts as saturated from this share of the largest value among flagged pixels on.
const AT_THE_TOP: f32 = 0.999;

/// Some neighbouring saturated pixels of one light.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClippedCell {
    /// Which light, below [`MOST_LIGHTS`].
    pub light: usize,
    /// Unit centroid.
    pub direction: Vec3,
    /// Angular radius of a disc of its size, radians.
    pub radius_rad: f32,
    /// For each channel: solid angle x z of its pixels that are saturated there.
    pub weight: [f64; 3],
    /// Share of the light's missing radiance, relative to the other cells.
    pub density: f64,
}

/// One saturated sample.
#[derive(Clone, Copy, Debug)]
struct ClippedSample {
    key: u64,
    sample: u32,
    cell: u32,
    saturated: [bool; 3],
}

/// The saturated lights of one picture; keeps its memory.
#[derive(Debug, Default)]
pub struct ClippedLights {
    members: Vec<ClippedSample>,
    label_of_pixel: Vec<u32>,
    stack: Vec<u32>,
    energies: Vec<f32>,
    pub(super) cells: Vec<ClippedCell>,
}

impl ClippedLights {
    /// Gathers the samples flagged `LOWER_BOUND` into lights (groups of touching pixels). `pixel_of_sample`: pixel
    /// number, in a region of `width` columns, of the first samples; later samples belong to no pixel.
    pub(super) fn find(&mut self, width: usize, pixel_of_sample: &[u32], samples: &RadianceSamples) {
        self.members.clear();
        self.cells.clear();
        self.energies.clear();
        let flagged = |sample: usize| samples.radiance[sample][3] as u8 & LOWER_BOUND != 0;
        let count = pixel_of_sample.iter().max().map_or(0, |last| *last as usize + 1);
        if !(0..pixel_of_sample.len()).any(flagged) {
            return;
        }
        // 0: nothing; 1: flagged; 2 + k: light k.
        self.label_of_pixel.clear();
        self.label_of_pixel.resize(count, 0);
        let mut top = [0.0f32; 3];
        for (sample, pixel) in pixel_of_sample.iter().enumerate().filter(|(sample, _)| flagged(*sample)) {
            self.label_of_pixel[*pixel as usize] = 1;
            for (top, c) in top.iter_mut().zip(samples.radiance[sample]) {
                *top = top.max(c);
            }
        }
        for pixel in 0..count {
            if self.label_of_pixel[pixel] == 1 {
                let label = 2 + self.energies.len() as u32;
                self.flood(pixel, width, label);
                self.energies.push(0.0);
            }
        }
        for (sample, pixel) in pixel_of_sample.iter().enumerate().filter(|(sample, _)| flagged(*sample)) {
            let light = self.label_of_pixel[*pixel as usize] as usize - 2;
            let (d, c) = (samples.directions[sample], samples.radiance[sample]);
            self.energies[light] += (c[0] + c[1] + c[2]) * d[3] * d[2].max(0.0);
        }
        // Rank of each light by its energy; the first MOST_LIGHTS stay.
        let rank = |light: usize| {
            let mine = self.energies[light];
            let before = |(k, e): (usize, &f32)| *e > mine || (*e == mine && k < light);
            self.energies.iter().enumerate().filter(|k| before(*k)).count()
        };
        for (sample, pixel) in pixel_of_sample.iter().enumerate().filter(|(sample, _)| flagged(*sample)) {
            let light = rank(self.label_of_pixel[*pixel as usize] as usize - 2);
            let (d, c) = (samples.directions[sample], samples.radiance[sample]);
            if light < MOST_LIGHTS && d[2] > 0.0 {
                let saturated = std::array::from_fn(|k| c[k] >= AT_THE_TOP * top[k]);
                let (x, y) = (*pixel as usize % width, *pixel as usize / width);
                let key = ((light as u64) << 48) | ((y as u64) << 24) | x as u64;
                self.members.push(ClippedSample { key, sample: sample as u32, cell: 0, saturated });
            }
        }
        self.gather_cells(samples);
    }

    /// Labels all flagged pixels that touch `first`, corners included.
    fn flood(&mut self, first: usize, width: usize, label: u32) {
        self.stack.clear();
        self.stack.push(first as u32);
        self.label_of_pixel[first] = label;
        while let Some(pixel) = self.stack.pop() {
            let (x, y) = (pixel as usize % width, pixel as usize / width);
            for y in y.saturating_sub(1)..y + 2 {
                for x in x.saturating_sub(1)..(x + 2).min(width) {
                    let neighbour = y * width + x;
                    if self.label_of_pixel.get(neighbour) == Some(&1) {
                        self.label_of_pixel[neighbour] = label;
                        self.stack.push(neighbour as u32);
                    }
                }
            }
        }
    }

    fn gather_cells(&mut self, samples: &RadianceSamples) {
        let mut side = 1;
        loop {
            // Cells of side x side pixels; members of one cell stand together after sorting.
            for member in &mut self.members {
                let (light, y, x) =
                    (member.key >> 48, (member.key >> 24) & 0xff_ffff, member.key & 0xff_ffff);
                member.cell = ((light << 30) | ((y / side) << 15) | (x / side)) as u32;
            }
            self.members.sort_unstable_by_key(|member| (member.cell, member.sample));
            let cells = self.members.chunk_by(|a, b| a.cell == b.cell).count();
            if cells <= MOST_CELLS {
                break;
            }
            side += 1;
        }
        let (mut last, mut moment, mut omega) = (None, Vec3::ZERO, 0.0f32);
        for member in &mut self.members {
            if last != Some(member.cell) {
                last = Some(member.cell);
                (moment, omega) = (Vec3::ZERO, 0.0);
                let light = (member.key >> 48) as usize;
                self.cells.push(ClippedCell { light, density: 1.0, ..ClippedCell::default() });
            }
            let index = self.cells.len() - 1;
            member.cell = index as u32;
            let d = samples.directions[member.sample as usize];
            let cell = &mut self.cells[index];
            moment += Vec3::new(d[0], d[1], d[2]) * d[3];
            omega += d[3];
            cell.direction = moment.normalize_or_zero();
            cell.radius_rad = (omega / std::f32::consts::PI).sqrt();
            for (weight, saturated) in cell.weight.iter_mut().zip(member.saturated) {
                *weight += if saturated { f64::from(d[3] * d[2]) } else { 0.0 };
            }
        }
    }

    /// Irradiance, on a surface that faces up, of each light's saturated pixels as they were read.
    pub(super) fn known_irradiance(&self, samples: &RadianceSamples) -> [[f64; 3]; MOST_LIGHTS] {
        let mut known = [[0.0; 3]; MOST_LIGHTS];
        for member in &self.members {
            let (d, c) =
                (samples.directions[member.sample as usize], samples.radiance[member.sample as usize]);
            let light = &mut known[self.cells[member.cell as usize].light];
            (0..3).for_each(|k| light[k] += f64::from(c[k] * d[3] * d[2]));
        }
        known
    }

    /// Takes a light's reading in one channel as it is.
    pub(super) fn trust(&mut self, light: usize, channel: usize) {
        for member in &mut self.members {
            if self.cells[member.cell as usize].light == light {
                member.saturated[channel] = false;
            }
        }
        for cell in self.cells.iter_mut().filter(|cell| cell.light == light) {
            cell.weight[channel] = 0.0;
        }
    }

    /// Adds missing light to the samples. `missing[light][channel]`: irradiance, on a surface that faces up, that the
    /// light lacks in that channel; it is spread over the light's saturated pixels by the cells' densities.
    pub(super) fn add_missing(&self, missing: &[[f64; 3]; MOST_LIGHTS], samples: &mut RadianceSamples) {
        let mut whole = [[0.0; 3]; MOST_LIGHTS];
        for cell in &self.cells {
            for (whole, weight) in whole[cell.light].iter_mut().zip(cell.weight) {
                *whole += cell.density * weight;
            }
        }
        for member in &self.members {
            let cell = &self.cells[member.cell as usize];
            for c in 0..3 {
                if member.saturated[c] && whole[cell.light][c] > 0.0 {
                    let radiance = missing[cell.light][c] * cell.density / whole[cell.light][c];
                    samples.radiance[member.sample as usize][c] += radiance as f32;
                }
            }
        }
    }
}
