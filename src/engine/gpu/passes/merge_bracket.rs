//! `hdr/merge_bracket` on the device, for 8-bit values and for what sensors gave. Twin: `hdr::merge_bracket`.

use crate::{
    Bracket, EngineError, SensorBracket,
    gpu::{
        buffers::{GrowingBuffer, Readback, whole_words, write_bytes},
        context::GpuContext,
        kernel::{Binding, BindingKind, BoundGroup, Built, KernelRow, source},
        params::MergeParams,
        recorder::{Gpu, GpuRecorder},
    },
    hdr::merge_bracket::{SensorTerms, weight},
    model::{image::HdrImage, response::Response},
    plan::Pass,
};

/// `hdr/merge_bracket`: one invocation for four pixels (three words of packed bytes, or six of 16 bits).
pub const KERNEL: KernelRow = KernelRow {
    pass: Pass::MergeBracket,
    sources: &[source!("hdr/merge_bracket")],
    entries: &["merge", "merge_sensor"],
    bindings: &[
        Binding::new("params", BindingKind::Uniform),
        Binding::new("pictures", BindingKind::Read),
        Binding::new("tables", BindingKind::Read),
        Binding::new("radiance", BindingKind::Write),
        Binding::new("flags", BindingKind::Write),
    ],
    structs: &[MergeParams::LAYOUT],
};

const PASS: Pass = Pass::MergeBracket;
/// Invocations of a workgroup; each merges four pixels.
const LANES: u32 = 64;
/// Workgroups in one row of a dispatch.
const ROW_GROUPS: u32 = 1024;

/// The kernel with its buffers.
pub struct MergeBracket {
    built: Built,
    pipeline: wgpu::ComputePipeline,
    sensor_pipeline: wgpu::ComputePipeline,
    params: GrowingBuffer,
    pictures: GrowingBuffer,
    tables: GrowingBuffer,
    radiance: GrowingBuffer,
    flags: GrowingBuffer,
    group: BoundGroup,
    readback: Readback,
    stamps: Readback,
    host_tables: Vec<f32>,
}

impl MergeBracket {
    /// Compiles it.
    pub fn new(context: &GpuContext) -> Result<Self, EngineError> {
        let built = Built::new(context, &KERNEL)?;
        let pipeline = built.compute(context, "merge")?;
        let sensor_pipeline = built.compute(context, "merge_sensor")?;
        Ok(Self {
            built,
            pipeline,
            sensor_pipeline,
            params: GrowingBuffer::uniform("merge params"),
            pictures: GrowingBuffer::storage("bracket"),
            tables: GrowingBuffer::storage("merge tables"),
            radiance: GrowingBuffer::storage("merged radiance"),
            flags: GrowingBuffer::storage("merged flags"),
            group: BoundGroup::default(),
            readback: Readback::new("merged picture"),
            stamps: Readback::new("pass times"),
            host_tables: Vec::new(),
        })
    }

    /// Merges a bracket that the twin would accept.
    pub fn run(
        &mut self,
        gpu: &mut Gpu,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        fill_tables(bracket, response, &mut self.host_tables);
        let pictures = bracket.pictures.iter().map(|picture| bytemuck::cast_slice(picture.pixels()));
        let size = (bracket.pictures[0].width(), bracket.pictures[0].height());
        self.merge(gpu, PictureWords { size, words_a_quad: 3 }, pictures, out)
    }

    /// The same for what sensors gave.
    pub fn run_sensor(
        &mut self,
        gpu: &mut Gpu,
        bracket: &SensorBracket<'_>,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        let terms = SensorTerms::of(bracket.pictures, bracket.exposures);
        self.host_tables.clear();
        for of in &terms[..bracket.pictures.len()] {
            let [red, green, blue] = of.factor;
            let numbers = [of.weight, of.black, of.saturated, of.fall, of.half_step, red, green, blue];
            self.host_tables.extend(numbers);
        }
        let pictures = bracket.pictures.iter().map(|picture| bytemuck::cast_slice(picture.values.pixels()));
        self.merge(gpu, PictureWords { size: bracket.pictures[0].size(), words_a_quad: 6 }, pictures, out)
    }

    /// Merges pictures that the tables are filled for.
    fn merge<'a>(
        &mut self,
        gpu: &mut Gpu,
        words: PictureWords,
        pictures: impl ExactSizeIterator<Item = &'a [u8]>,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        let context = &gpu.context;
        let (width, height) = words.size;
        let pixels = width * height;
        let quads = pixels.div_ceil(4);
        let (radiance_bytes, flag_bytes) = (quads * 48, quads * 4);
        let params = MergeParams {
            quads: quads as u32,
            pictures: pictures.len() as u32,
            picture_words: quads as u32 * words.words_a_quad,
            row: LANES * ROW_GROUPS,
        };
        let picture_bytes = 4 * params.picture_words as usize;
        let bracket = self.pictures.at_least(context, picture_bytes * pictures.len()).clone();
        for (k, bytes) in pictures.enumerate() {
            write_bytes(context, &bracket, (k * picture_bytes) as u64, bytes);
        }
        let resources = [
            self.params.write(context, bytemuck::bytes_of(&params)),
            self.pictures.bind(context, 0),
            self.tables.write(context, bytemuck::cast_slice(&self.host_tables)),
            self.radiance.bind(context, radiance_bytes),
            self.flags.bind(context, flag_bytes),
        ];
        let group = self.group.of(context, &self.built, &resources);
        let pipeline = if words.words_a_quad == 3 { &self.pipeline } else { &self.sensor_pipeline };

        let mut recorder = GpuRecorder::new(context, &mut gpu.timer);
        let groups = quads.div_ceil(LANES as usize) as u32;
        recorder.compute(PASS, |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(groups.min(ROW_GROUPS), groups.div_ceil(ROW_GROUPS), 1);
        })?;
        let target = self.readback.at_least(context, radiance_bytes + flag_bytes).clone();
        let (radiance, flags) = (self.radiance.at_least(context, 0), self.flags.at_least(context, 0));
        recorder.copy(radiance, &target, 0, whole_words(radiance_bytes));
        recorder.copy(flags, &target, radiance_bytes as u64, whole_words(flag_bytes));
        let work = recorder.send(&mut self.stamps);
        gpu.finish(work, &mut self.stamps, PASS)?;

        out.radiance.reshape(width, height, [0.0; 3]);
        out.flags.reshape(width, height, 0);
        self.readback.read(&gpu.context, PASS.name(), radiance_bytes + flag_bytes, |bytes| {
            let (radiance, flags) = bytes.split_at(radiance_bytes);
            let target: &mut [u8] = bytemuck::cast_slice_mut(out.radiance.pixels_mut());
            target.copy_from_slice(&radiance[..pixels * 12]);
            out.flags.pixels_mut().copy_from_slice(&flags[..pixels]);
        })
    }
}

/// How pictures lie on the device.
struct PictureWords {
    size: (usize, usize),
    /// 32-bit words of four pixels of one picture.
    words_a_quad: u32,
}

/// For each picture, channel and value w(z) (g(z) - ln t); then for each picture and channel g(255) - ln t and
/// g(0) - ln t. The logarithms are bounded as in the twin.
fn fill_tables(bracket: &Bracket<'_>, response: &Response, out: &mut Vec<f32>) {
    out.clear();
    let log = |g: f32, log_t: f64| (f64::from(g) - log_t).clamp(-1e3, 1e3);
    for exposure in bracket.exposures {
        let log_t = exposure.effective_s().ln();
        for g in response.log_exposure() {
            out.extend((0..=255u8).map(|z| (f64::from(weight(z)) * log(g[usize::from(z)], log_t)) as f32));
        }
    }
    for exposure in bracket.exposures {
        let log_t = exposure.effective_s().ln();
        for g in response.log_exposure() {
            out.extend([log(g[255], log_t) as f32, log(g[0], log_t) as f32]);
        }
    }
}
