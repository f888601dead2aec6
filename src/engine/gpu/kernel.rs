//! What a kernel is: its shader, its bindings, and how both become a pipeline.

use std::borrow::Cow;

use super::{context::GpuContext, params::StructLayout};
use crate::{EngineError, plan::Pass};

/// One WGSL file.
#[derive(Clone, Copy, Debug)]
pub struct ShaderSource {
    /// Path from the project's root.
    pub path: &'static str,
    /// Its text, built in.
    pub text: &'static str,
}

/// A file of `shaders/`, by its path there without the ending.
macro_rules! source {
    ($path:literal) => {
        $crate::gpu::kernel::ShaderSource {
            path: concat!("shaders/", $path, ".wgsl"),
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders/", $path, ".wgsl")),
        }
    };
}
pub(crate) use source;

/// What is bound in one place of bind group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// A uniform struct; a layout of that name in `params` says what is in it.
    Uniform,
    /// A uniform struct at an offset that changes from draw to draw.
    UniformAtOffset,
    /// A storage buffer, read only.
    Read,
    /// A storage buffer, read and written.
    Write,
    /// A 2D texture of floats, read texel by texel.
    Floats,
    /// A 2D texture of unsigned integers, read texel by texel.
    Uints,
    /// An array of such textures.
    UintLayers,
}

/// One place of bind group 0; its number is its position in the kernel's list.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Name of the variable in the shader.
    pub name: &'static str,
    /// What is bound.
    pub kind: BindingKind,
}

impl Binding {
    /// A row of the table.
    pub const fn new(name: &'static str, kind: BindingKind) -> Self {
        Self { name, kind }
    }
}

/// A row of the table of kernels.
#[derive(Clone, Copy, Debug)]
pub struct KernelRow {
    /// Its pass; the pass's name is the stem of shader and twin.
    pub pass: Pass,
    /// Shared functions first, the kernel's own file last.
    pub sources: &'static [ShaderSource],
    /// All entry points.
    pub entries: &'static [&'static str],
    /// Bind group 0.
    pub bindings: &'static [Binding],
    /// Layouts of the structs that the host fills (uniforms, storage elements).
    pub structs: &'static [StructLayout],
}

impl KernelRow {
    /// The whole WGSL text.
    pub fn wgsl(&self) -> String {
        self.sources.iter().flat_map(|source| [source.text, "\n"]).collect()
    }

    fn visibility(&self, kind: BindingKind) -> wgpu::ShaderStages {
        match (self.pass.draws_triangles(), kind) {
            (false, _) => wgpu::ShaderStages::COMPUTE,
            (true, BindingKind::Uniform | BindingKind::UniformAtOffset) => {
                wgpu::ShaderStages::VERTEX_FRAGMENT
            }
            (true, _) => wgpu::ShaderStages::FRAGMENT,
        }
    }

    fn layout_entry(&self, number: usize, kind: BindingKind) -> wgpu::BindGroupLayoutEntry {
        let buffer = |ty, has_dynamic_offset| wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size: None,
        };
        let ty = match kind {
            BindingKind::Uniform => buffer(wgpu::BufferBindingType::Uniform, false),
            BindingKind::UniformAtOffset => buffer(wgpu::BufferBindingType::Uniform, true),
            BindingKind::Read => buffer(wgpu::BufferBindingType::Storage { read_only: true }, false),
            BindingKind::Write => buffer(wgpu::BufferBindingType::Storage { read_only: false }, false),
            BindingKind::Floats => wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            BindingKind::Uints => wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Uint,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            BindingKind::UintLayers => wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Uint,
                view_dimension: wgpu::TextureViewDimension::D2Array,
                multisampled: false,
            },
        };
        wgpu::BindGroupLayoutEntry {
            binding: number as u32,
            visibility: self.visibility(kind),
            ty,
            count: None,
        }
    }
}

/// A kernel's shader and layouts on a device, from which its pipelines are made.
pub struct Built {
    kernel: &'static KernelRow,
    module: wgpu::ShaderModule,
    group_layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
}

impl Built {
    /// Compiles the shader. Errors: `Gpu` with what the compiler said.
    pub fn new(context: &GpuContext, kernel: &'static KernelRow) -> Result<Self, EngineError> {
        let name = kernel.pass.name();
        let device = &context.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(Cow::Owned(kernel.wgsl())),
        });
        let entries: Vec<_> = kernel
            .bindings
            .iter()
            .enumerate()
            .map(|(number, binding)| kernel.layout_entry(number, binding.kind))
            .collect();
        let group_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(name),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&group_layout)],
            immediate_size: 0,
        });
        context.check(name)?;
        Ok(Self { kernel, module, group_layout, pipeline_layout })
    }

    /// The kernel's name.
    pub fn name(&self) -> &'static str {
        self.kernel.pass.name()
    }

    /// A pipeline that draws with depth.
    pub fn drawing(
        &self,
        context: &GpuContext,
        drawing: &Drawing<'_>,
    ) -> Result<wgpu::RenderPipeline, EngineError> {
        self.blending(context, drawing, None)
    }

    /// The same; with `blend`, over what is of the same depth, which stays.
    pub fn blending(
        &self,
        context: &GpuContext,
        drawing: &Drawing<'_>,
        blend: Option<wgpu::BlendState>,
    ) -> Result<wgpu::RenderPipeline, EngineError> {
        let options = || wgpu::PipelineCompilationOptions {
            constants: drawing.constants,
            ..wgpu::PipelineCompilationOptions::default()
        };
        let buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: drawing.stride,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: drawing.attributes,
        })];
        let targets =
            [Some(wgpu::ColorTargetState { format: drawing.color, blend, write_mask: drawing.write })];
        let pipeline = context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.name()),
            layout: Some(&self.pipeline_layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some(drawing.vertex),
                compilation_options: options(),
                buffers: &buffers,
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(blend.is_none()),
                depth_compare: Some(drawing.nearer),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState { count: drawing.samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some(drawing.fragment),
                compilation_options: options(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        });
        context.check(self.name())?;
        Ok(pipeline)
    }

    /// A compute pipeline of one entry point. Workgroup memory starts undefined: every kernel writes before it
    /// reads, and clearing it costs GL drivers a minute of compiling (it is written out number by number).
    pub fn compute(&self, context: &GpuContext, entry: &str) -> Result<wgpu::ComputePipeline, EngineError> {
        let pipeline = context.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(self.name()),
            layout: Some(&self.pipeline_layout),
            module: &self.module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        context.check(self.name())?;
        Ok(pipeline)
    }
}

/// How a kernel draws. Triangles are drawn whichever way they face; counter-clockwise is the front.
#[derive(Clone, Copy)]
pub struct Drawing<'a> {
    /// Entry point of the vertex stage.
    pub vertex: &'a str,
    /// Entry point of the fragment stage.
    pub fragment: &'a str,
    /// Bytes from vertex to vertex.
    pub stride: u64,
    /// Where the vertex stage's inputs lie.
    pub attributes: &'a [wgpu::VertexAttribute],
    /// The colour target.
    pub color: wgpu::TextureFormat,
    /// Which of its channels are written.
    pub write: wgpu::ColorWrites,
    /// How the depth of what is nearer compares.
    pub nearer: wgpu::CompareFunction,
    /// Samples a pixel.
    pub samples: u32,
    /// Values of the shader's `override`s.
    pub constants: &'a [(&'a str, f64)],
}

/// A resource to bind; compares equal while it is the same object.
#[derive(Clone, Debug, PartialEq)]
pub enum Resource {
    /// A whole buffer.
    Buffer(wgpu::Buffer),
    /// The first bytes of a buffer, at an offset given with each draw.
    Window(wgpu::Buffer, u64),
    /// Read by the shader, or written as storage.
    View(wgpu::TextureView),
}

/// The bind group of the last call, made anew only when a resource has changed.
#[derive(Default)]
pub struct BoundGroup {
    resources: Vec<Resource>,
    group: Option<wgpu::BindGroup>,
}

impl BoundGroup {
    /// The bind group of these resources, in the order of the kernel's bindings.
    pub fn of(&mut self, context: &GpuContext, built: &Built, resources: &[Resource]) -> &wgpu::BindGroup {
        if self.resources != resources {
            self.group = None;
            self.resources = resources.to_vec();
        }
        self.group.get_or_insert_with(|| {
            let entries: Vec<_> = resources
                .iter()
                .enumerate()
                .map(|(number, resource)| wgpu::BindGroupEntry {
                    binding: number as u32,
                    resource: match resource {
                        Resource::Buffer(buffer) => buffer.as_entire_binding(),
                        Resource::Window(buffer, bytes) => {
                            wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                                buffer,
                                offset: 0,
                                size: wgpu::BufferSize::new(*bytes),
                            })
                        }
                        Resource::View(view) => wgpu::BindingResource::TextureView(view),
                    },
                })
                .collect();
            context.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(built.name()),
                layout: &built.group_layout,
                entries: &entries,
            })
        })
    }
}
