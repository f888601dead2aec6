//! Device pictures that are kept from frame to frame and made anew only when their size changes.

use super::{
    buffers::{Readback, whole_words},
    context::GpuContext,
    kernel::Resource,
};
use crate::engine::EngineError;

/// A 2D texture of one format.
pub struct KeptTexture {
    label: &'static str,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
    made: Option<(wgpu::Texture, wgpu::TextureView)>,
}

impl KeptTexture {
    /// Something to draw to that later passes or the host read.
    pub const fn result(label: &'static str, format: wgpu::TextureFormat) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            .union(wgpu::TextureUsages::TEXTURE_BINDING)
            .union(wgpu::TextureUsages::COPY_SRC)
            .union(wgpu::TextureUsages::COPY_DST);
        Self { label, format, usage, made: None }
    }

    /// Something to draw to that is forgotten after the pass.
    pub const fn scratch(label: &'static str, format: wgpu::TextureFormat) -> Self {
        Self { label, format, usage: wgpu::TextureUsages::RENDER_ATTACHMENT, made: None }
    }

    /// The texture with these sizes and samples a pixel; what it held is lost when they change.
    pub fn sized(
        &mut self,
        context: &GpuContext,
        width: u32,
        height: u32,
        samples: u32,
    ) -> &wgpu::TextureView {
        let (width, height) = (width.max(1), height.max(1));
        let fits = |texture: &wgpu::Texture| {
            (texture.width(), texture.height(), texture.sample_count()) == (width, height, samples)
        };
        if !self.made.as_ref().is_some_and(|(texture, _)| fits(texture)) {
            self.made = None;
        }
        let (_, view) = self.made.get_or_insert_with(|| {
            let texture = context.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(self.label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format: self.format,
                usage: self.usage,
                view_formats: &[],
            });
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            (texture, view)
        });
        view
    }

    /// The texture as it is (one texel where it was never sized), to bind.
    pub fn bind(&mut self, context: &GpuContext) -> Resource {
        let (width, height) = self.size();
        Resource::View(self.sized(context, width, height, 1).clone())
    }

    fn size(&self) -> (u32, u32) {
        self.made.as_ref().map_or((1, 1), |(texture, _)| (texture.width(), texture.height()))
    }

    fn texel_bytes(&self) -> u32 {
        self.format.block_copy_size(None).unwrap_or(1)
    }

    /// Fills the texture from texels row by row.
    pub fn upload(&mut self, context: &GpuContext, width: u32, height: u32, texels: &[u8]) {
        self.sized(context, width, height, 1);
        let texel_bytes = self.texel_bytes();
        if let Some((texture, _)) = &self.made {
            context.queue.write_texture(
                texture.as_image_copy(),
                texels,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(width * texel_bytes),
                    rows_per_image: None,
                },
                texture.size(),
            );
        }
    }

    /// All texels row by row. Waits for the device; for tests and for kernels whose neighbours run on the host.
    pub fn download(&mut self, context: &GpuContext, pass: &'static str) -> Result<Vec<u8>, EngineError> {
        // Mesa's llvmpipe on GL copies tiles that it is still drawing (seen in 1 of 50 frames): let it finish first.
        context.wait(pass)?;
        let (width, height) = self.size();
        let row = (width * self.texel_bytes()) as usize;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let mut readback = Readback::new(self.label);
        let bytes = padded * height as usize;
        let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if let Some((texture, _)) = &self.made {
            encoder.copy_texture_to_buffer(
                texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo {
                    buffer: readback.at_least(context, whole_words(bytes) as usize),
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(padded as u32),
                        rows_per_image: None,
                    },
                },
                texture.size(),
            );
        }
        context.queue.submit([encoder.finish()]);
        readback.read(context, pass, bytes, |bytes| {
            bytes.chunks_exact(padded).flat_map(|padded| &padded[..row]).copied().collect()
        })
    }
}
