//! Ground truth: pictures of a scene with and without its virtual objects, by ray tracing, each with its own noise.
//!
//! Nothing of the product's approximations is used here: no split of the light, no spherical harmonics, no spheres that
//! stand for bodies, no shadow maps. What is the same by intent are the scene, the lens, the materials' lobes
//! (`model::scene::Material`, f+ of the spec) and the convention of radiance. A pixel is the mean over its square.
//!
//! * Direct light by default: a surface that the camera sees, itself or in mirrors, under what shines: environment,
//!   triangles that send light out, suns. With `bounces` light is reflected diffusely so many times more; mirrors then throw
//!   light, too, but that of suns.
//! * The result depends on scene, settings and seed alone: not on threads, and not on where a trace was cut and taken up
//!   again (`sequence`).
//! * Noise is estimated from independent passes (`Traced::noise`), so it is honest about the stratified samples within one.

pub mod checkpoint;
mod emitters;
mod environment;
mod path;
mod reflect;
mod scene;
mod sequence;
mod sums;
mod world;

pub use checkpoint::CheckpointError;
pub use scene::{Emission, Environment, TraceBody, TraceScene, TraceShape, TraceSun, UNKNOWN_ALBEDO};
pub use sums::{SHADOW_BELOW, TraceNoise, Traced};

use checkpoint::TraceProgress;
use path::PreparedTrace;
use rayon::prelude::*;
use sequence::Sequence;
use sha2::{Digest, Sha256};
use sums::{PassSums, PixelSums};

/// Samples of a pixel at most.
pub const MOST_SAMPLES: u32 = 1 << 24;
/// Diffuse reflections that a setting may ask for.
pub const MOST_BOUNCES: u32 = 64;
/// Passes before noise is trusted: its own error is about 1 / sqrt(2 * 7), and less by the number of pixels.
const LEAST_PASSES: u32 = 8;

/// How a scene is traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSettings {
    /// Samples of each pixel, at most where a noise target is given; rounded up to whole passes. 1 to [`MOST_SAMPLES`].
    pub samples: u32,
    /// Samples of each pixel that are stratified together: a power of two, 1 to 4096. At least two passes are needed to know
    /// the noise.
    pub samples_a_pass: u32,
    /// How often light may be reflected diffusely beyond once: 0 is direct light. At most [`MOST_BOUNCES`].
    pub bounces: u32,
    /// Another seed, other noise.
    pub seed: u32,
    /// Only every k-th pixel of every k-th row, from the k/2-th on; 1: all.
    pub step_px: u32,
    /// Stops when `TraceNoise::shadow_relative` is below this, after at least 8 passes.
    pub shadow_noise: Option<f64>,
}

impl Default for TraceSettings {
    fn default() -> Self {
        Self { samples: 512, samples_a_pass: 64, bounces: 0, seed: 0, step_px: 1, shadow_noise: None }
    }
}

/// Why nothing was traced.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// A setting is outside its range.
    #[error("{key} = {value}: must be {allowed}")]
    Setting {
        /// Which.
        key: &'static str,
        /// As given.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// A body is not sound.
    #[error("body {name}: {what}")]
    Body {
        /// As the scene calls it.
        name: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// A checkpoint cannot be taken up.
    #[error("the checkpoint {0}")]
    Checkpoint(#[from] CheckpointError),
}

fn setting(
    key: &'static str,
    value: impl ToString,
    sound: bool,
    allowed: impl Into<String>,
) -> Result<(), TraceError> {
    match sound {
        true => Ok(()),
        false => Err(TraceError::Setting { key, value: value.to_string(), allowed: allowed.into() }),
    }
}

/// A trace in progress, pass by pass.
#[derive(Debug)]
pub struct Tracer {
    prepared: PreparedTrace,
    settings: TraceSettings,
    /// Of the whole picture.
    full_width: u32,
    width: usize,
    digest: [u8; 32],
    done: TraceProgress,
}

impl Tracer {
    /// Makes a scene ready.
    ///
    /// # Errors
    /// A setting out of range, a picture without pixels, a body whose lists do not fit each other.
    pub fn new(scene: &TraceScene, settings: &TraceSettings) -> Result<Self, TraceError> {
        check(scene, settings)?;
        let step = settings.step_px;
        let (width, height) =
            (sums::traced_px(scene.lens.width, step), sums::traced_px(scene.lens.height, step));
        setting("step_px", step, width * height > 0, "so small that a pixel is left")?;
        let mut hash = Sha256::new();
        hash.update(scene.digest());
        for number in [settings.samples_a_pass, settings.bounces, settings.seed, step] {
            hash.update(number.to_le_bytes());
        }
        Ok(Self {
            prepared: PreparedTrace::new(scene, settings.bounces),
            settings: *settings,
            full_width: scene.lens.width,
            width,
            digest: hash.finalize().into(),
            done: TraceProgress { passes: 0, dropped: 0, sums: vec![PixelSums::default(); width * height] },
        })
    }

    /// Takes up what an earlier trace of the same scene and settings left (`checkpoint`). It may have had another number of
    /// samples to do.
    ///
    /// # Errors
    /// The bytes are not such, were cut or changed, or belong to another scene or settings.
    pub fn resume(&mut self, bytes: &[u8]) -> Result<(), TraceError> {
        self.done = TraceProgress::from_bytes(bytes, &self.digest, self.done.sums.len())?;
        Ok(())
    }

    /// All that is needed to go on later.
    pub fn checkpoint(&self) -> Vec<u8> {
        self.done.to_bytes(&self.digest)
    }

    /// Asks for another number of samples of each pixel than the settings did.
    ///
    /// # Errors
    /// It is out of range.
    pub fn aim_at(&mut self, samples: u32) -> Result<(), TraceError> {
        check_samples(samples)?;
        self.settings.samples = samples;
        Ok(())
    }

    /// Samples of each pixel so far.
    pub fn samples(&self) -> u32 {
        self.done.passes * self.settings.samples_a_pass
    }

    /// Pixels that are traced.
    pub fn pixels(&self) -> usize {
        self.done.sums.len()
    }

    /// Whether there are enough samples, or the noise is below its target.
    pub fn is_done(&self) -> bool {
        self.samples() >= self.settings.samples
            || self
                .settings
                .shadow_noise
                .is_some_and(|bound| self.done.passes >= LEAST_PASSES && self.noise().shadow_relative < bound)
    }

    /// The noise so far.
    pub fn noise(&self) -> TraceNoise {
        sums::noise(&self.done.sums, self.done.passes, self.done.dropped)
    }

    /// Traces one pass more, on the threads of the caller's pool.
    pub fn pass(&mut self) {
        let Self { prepared, settings, full_width, width, done, .. } = self;
        let (step, pass) = (settings.step_px, done.passes);
        let dropped: u64 = done
            .sums
            .par_chunks_mut(*width)
            .enumerate()
            .map(|(j, row)| {
                let y = step / 2 + j as u32 * step;
                let mut dropped = 0;
                for (i, sums) in row.iter_mut().enumerate() {
                    let x = step / 2 + i as u32 * step;
                    let mut sum = PassSums::default();
                    for sample in 0..settings.samples_a_pass {
                        let numbers = Sequence::new(settings.seed, y * *full_width + x, pass, sample);
                        sum.add(&prepared.sample(x, y, &numbers));
                    }
                    sums.add(&sum, settings.samples_a_pass);
                    dropped += u64::from(sum.dropped);
                }
                dropped
            })
            .sum();
        done.passes += 1;
        done.dropped += dropped;
    }

    /// The pictures so far; the trace can go on.
    pub fn so_far(&self) -> Traced {
        let size = [self.width as u32, self.settings.step_px];
        Traced::new(size, self.done.sums.clone(), self.done.passes, self.samples(), self.done.dropped)
    }

    /// The pictures.
    pub fn finish(self) -> Traced {
        let samples = self.samples();
        let size = [self.width as u32, self.settings.step_px];
        Traced::new(size, self.done.sums, self.done.passes, samples, self.done.dropped)
    }
}

/// Looks at what is to be traced and how, before anything is.
///
/// # Errors
/// As [`Tracer::new`].
pub fn check(scene: &TraceScene, settings: &TraceSettings) -> Result<(), TraceError> {
    let TraceSettings { samples, samples_a_pass, bounces, step_px, shadow_noise, .. } = *settings;
    let within = |low: u32, high: u32| format!("within {low}..={high}");
    check_samples(samples)?;
    let sound = samples_a_pass.is_power_of_two() && samples_a_pass <= 4096;
    setting("samples_a_pass", samples_a_pass, sound, "a power of two within 1..=4096")?;
    setting("bounces", bounces, bounces <= MOST_BOUNCES, within(0, MOST_BOUNCES))?;
    setting("step_px", step_px, step_px >= 1, "at least 1")?;
    if let Some(bound) = shadow_noise {
        setting("shadow_noise", bound, bound > 0.0 && bound.is_finite(), "above 0")?;
    }
    for body in scene.real.iter().chain(&scene.objects) {
        let wrong = |what| Err(TraceError::Body { name: body.name.clone(), what });
        match &body.shape {
            TraceShape::Mesh(mesh) => {
                let count = mesh.positions.len();
                let fits = |list: usize| list == 0 || list == count;
                if !fits(mesh.normals.len()) || !fits(mesh.tints_rgb.len()) {
                    return wrong("has not one normal and one tint for each vertex");
                }
                if mesh.triangles.iter().flatten().any(|&i| i as usize >= count) {
                    return wrong("has a triangle with a corner that there is not");
                }
            }
            TraceShape::Sphere { centre, radius_m } => {
                if !(centre.is_finite() && radius_m.is_finite() && *radius_m > 0.0) {
                    return wrong("is a sphere without a finite centre and a radius above 0");
                }
            }
        }
    }
    Ok(())
}

fn check_samples(samples: u32) -> Result<(), TraceError> {
    let sound = (1..=MOST_SAMPLES).contains(&samples);
    setting("samples", samples, sound, format!("within 1..={MOST_SAMPLES}"))
}

/// Traces a scene until it is done. `progress` is told the share of the samples done after each pass, on the caller's
/// thread.
///
/// # Errors
/// As of [`Tracer::new`].
pub fn trace(
    scene: &TraceScene,
    settings: &TraceSettings,
    progress: &dyn Fn(f32),
) -> Result<Traced, TraceError> {
    let mut tracer = Tracer::new(scene, settings)?;
    while !tracer.is_done() {
        tracer.pass();
        progress((tracer.samples() as f32 / settings.samples as f32).min(1.0));
    }
    Ok(tracer.finish())
}

#[cfg(test)]
mod tests;
