//! Device pictures that are kept from frame to frame and made anew only when their size changes.

use super::{
    buffers::{Readback, whole_words},
    context::GpuContext,
    kernel::Resource,
    live::Lease,
};
use crate::EngineError;

/// What stands in a binding that has to be filled where there is nothing to bind.
pub const ONE_TEXEL: &str = "one texel";

/// A 2D texture of one format.
pub struct KeptTexture {
    label: &'static str,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
    made: Option<(wgpu::Texture, wgpu::TextureView, Lease)>,
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

    /// Something that only the host fills (formats that a device may not draw to).
    pub const fn uploaded(label: &'static str, format: wgpu::TextureFormat) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING.union(wgpu::TextureUsages::COPY_DST);
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
        if !self.made.as_ref().is_some_and(|(texture, _, lease)| fits(texture) && lease.is_live()) {
            self.made = None;
        }
        let name = if (width, height) == (1, 1) { ONE_TEXEL } else { self.label };
        let (_, view, _) = self.made.get_or_insert_with(|| {
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
            let lease = context.live.texture(name, &texture);
            (texture, view, lease)
        });
        view
    }

    /// The texture as it is (one texel where it was never sized), to bind.
    pub fn bind(&mut self, context: &GpuContext) -> Resource {
        let (width, height) = self.size();
        Resource::View(self.sized(context, width, height, 1).clone())
    }

    /// Frees it.
    pub fn free(&mut self) {
        self.made = None;
    }

    /// Whether what it held is still there.
    pub fn is_live(&self) -> bool {
        self.made.as_ref().is_some_and(|(_, _, lease)| lease.is_live())
    }

    /// Columns and rows; 1 where it was never sized.
    pub fn size(&self) -> (u32, u32) {
        let live = self.made.as_ref().filter(|(_, _, lease)| lease.is_live());
        live.map_or((1, 1), |(texture, ..)| (texture.width(), texture.height()))
    }

    fn texel_bytes(&self) -> u32 {
        self.format.block_copy_size(None).unwrap_or(1)
    }

    /// Fills the texture from texels row by row.
    pub fn upload(&mut self, context: &GpuContext, width: u32, height: u32, texels: &[u8]) {
        self.sized(context, width, height, 1);
        let texel_bytes = self.texel_bytes();
        if let Some((texture, ..)) = &self.made {
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
        if let Some((texture, ..)) = &self.made {
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

/// An array of square textures of one format: one layer for each hard light.
pub struct KeptLayers {
    label: &'static str,
    format: wgpu::TextureFormat,
    made: Option<Layers>,
}

struct Layers {
    texture: wgpu::Texture,
    all: wgpu::TextureView,
    each: Vec<wgpu::TextureView>,
    lease: Lease,
}

impl KeptLayers {
    /// Something to draw to, layer by layer, that later passes or the host read.
    pub const fn result(label: &'static str, format: wgpu::TextureFormat) -> Self {
        Self { label, format, made: None }
    }

    /// Makes room for `count` layers of `side` texels a side; what they held is lost when these change.
    pub fn sized(&mut self, context: &GpuContext, side: u32, count: u32) {
        // The GL backend takes one layer for a plain texture, and six (or twelve..) square ones for a cube map.
        let mut layers = count.max(2);
        if layers.is_multiple_of(6) {
            layers += 1;
        }
        let side = side.max(1);
        let fits = |made: &Layers| {
            let texture = &made.texture;
            texture.width() == side && texture.depth_or_array_layers() >= layers && made.lease.is_live()
        };
        if self.made.as_ref().is_some_and(fits) {
            return;
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::COPY_DST;
        let texture = context.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(self.label),
            size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage,
            view_formats: &[],
        });
        let all = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let each = (0..layers).map(|layer| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: layer,
                array_layer_count: Some(1),
                ..Default::default()
            })
        });
        let each = each.collect();
        let name = if side == 1 { ONE_TEXEL } else { self.label };
        let lease = context.live.texture(name, &texture);
        self.made = Some(Layers { texture, all, each, lease });
    }

    /// Whether what they held is still there.
    pub fn is_live(&self) -> bool {
        self.made.as_ref().is_some_and(|made| made.lease.is_live())
    }

    /// All layers (two of one texel where it was never sized), to bind.
    pub fn bind(&mut self, context: &GpuContext) -> Option<Resource> {
        if !self.is_live() {
            self.sized(context, 1, 2);
        }
        self.made.as_ref().map(|made| Resource::View(made.all.clone()))
    }

    /// One layer, to draw to, where there is such a layer.
    pub fn layer(&self, layer: usize) -> Option<&wgpu::TextureView> {
        self.made.as_ref().and_then(|made| made.each.get(layer))
    }

    /// Fills one layer from texels row by row, after `sized`.
    pub fn upload(&mut self, context: &GpuContext, layer: u32, texels: &[u8]) {
        let Some(made) = &self.made else { return };
        let side = made.texture.width();
        let row = side * self.format.block_copy_size(None).unwrap_or(1);
        context.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                ..made.texture.as_image_copy()
            },
            texels,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
            wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
        );
    }

    /// All texels of one layer row by row; waits for the device.
    pub fn download(
        &mut self,
        context: &GpuContext,
        layer: u32,
        pass: &'static str,
    ) -> Result<Vec<u8>, EngineError> {
        context.wait(pass)?;
        let Some(made) = &self.made else { return Ok(Vec::new()) };
        let side = made.texture.width();
        let row = (side * self.format.block_copy_size(None).unwrap_or(1)) as usize;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let bytes = padded * side as usize;
        let mut readback = Readback::new(self.label);
        let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                ..made.texture.as_image_copy()
            },
            wgpu::TexelCopyBufferInfo {
                buffer: readback.at_least(context, whole_words(bytes) as usize),
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded as u32),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
        );
        context.queue.submit([encoder.finish()]);
        readback.read(context, pass, bytes, |bytes| {
            bytes.chunks_exact(padded).flat_map(|padded| &padded[..row]).copied().collect()
        })
    }
}
