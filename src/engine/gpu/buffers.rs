//! Device memory that is kept from frame to frame and grows only when sizes change.

use super::{context::GpuContext, kernel::Resource, live::Lease};
use crate::EngineError;
use std::sync::mpsc::{Receiver, sync_channel};

/// Copies and uploads come in units of this many bytes.
const WORD: u64 = wgpu::COPY_BUFFER_ALIGNMENT;

/// Bytes, rounded up to whole words; never zero, which no buffer may be.
pub fn whole_words(bytes: usize) -> u64 {
    (bytes as u64).div_ceil(WORD).max(1) * WORD
}

/// A buffer that grows.
pub struct GrowingBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    buffer: Option<(wgpu::Buffer, Lease)>,
}

impl GrowingBuffer {
    /// A storage buffer; can be uploaded to and copied from.
    pub const fn storage(label: &'static str) -> Self {
        Self::new(label, wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC))
    }

    /// A uniform buffer.
    pub const fn uniform(label: &'static str) -> Self {
        Self::new(label, wgpu::BufferUsages::UNIFORM)
    }

    /// A buffer of any usage (upload is always allowed).
    pub const fn new(label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage: usage.union(wgpu::BufferUsages::COPY_DST), buffer: None }
    }

    /// The buffer, of at least that many bytes. What it held is lost when it has to grow.
    pub fn at_least(&mut self, context: &GpuContext, bytes: usize) -> &wgpu::Buffer {
        let size = whole_words(bytes);
        if self.buffer.as_ref().is_some_and(|(buffer, lease)| buffer.size() < size || !lease.is_live()) {
            self.buffer = None;
        }
        let (buffer, _) = self.buffer.get_or_insert_with(|| {
            let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(self.label),
                size,
                usage: self.usage,
                mapped_at_creation: false,
            });
            let lease = context.live.buffer(self.label, &buffer);
            (buffer, lease)
        });
        buffer
    }

    /// Whether what was written is still there.
    pub fn is_live(&self) -> bool {
        self.buffer.as_ref().is_some_and(|(_, lease)| lease.is_live())
    }

    /// Uploads at the start of the buffer, which grows to hold it all.
    pub fn write(&mut self, context: &GpuContext, bytes: &[u8]) -> Resource {
        let buffer = self.at_least(context, bytes.len()).clone();
        write_bytes(context, &buffer, 0, bytes);
        Resource::Buffer(buffer)
    }

    /// The buffer, of at least that many bytes, to bind.
    pub fn bind(&mut self, context: &GpuContext, bytes: usize) -> Resource {
        Resource::Buffer(self.at_least(context, bytes).clone())
    }
}

/// Uploads bytes to a multiple of 4; the last word is padded with zeros.
pub fn write_bytes(context: &GpuContext, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
    let whole = bytes.len() - bytes.len() % WORD as usize;
    if whole > 0 {
        context.queue.write_buffer(buffer, offset, &bytes[..whole]);
    }
    if whole < bytes.len() {
        let mut last = [0; WORD as usize];
        last[..bytes.len() - whole].copy_from_slice(&bytes[whole..]);
        context.queue.write_buffer(buffer, offset + whole as u64, &last);
    }
}

/// A mappable buffer that results are copied to and read from.
pub struct Readback {
    label: &'static str,
    buffer: Option<(wgpu::Buffer, Lease)>,
    /// What has become of the last request.
    answer: Option<Receiver<Result<(), wgpu::BufferAsyncError>>>,
}

impl Readback {
    /// Empty.
    pub const fn new(label: &'static str) -> Self {
        Self { label, buffer: None, answer: None }
    }

    /// The target of copies, of at least that many bytes.
    pub fn at_least(&mut self, context: &GpuContext, bytes: usize) -> &wgpu::Buffer {
        let size = whole_words(bytes);
        if self.buffer.as_ref().is_some_and(|(buffer, lease)| buffer.size() < size || !lease.is_live()) {
            self.buffer = None;
        }
        let (buffer, _) = self.buffer.get_or_insert_with(|| {
            let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(self.label),
                size,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let lease = context.live.buffer(self.label, &buffer);
            (buffer, lease)
        });
        buffer
    }

    /// Waits for the device and hands the first `bytes` bytes to `read`. The copy must have been submitted.
    pub fn read<R>(
        &mut self,
        context: &GpuContext,
        pass: &'static str,
        bytes: usize,
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, EngineError> {
        self.request(context, bytes);
        context.wait(pass)?;
        self.take(pass, bytes, read)
    }

    /// Asks for the first `bytes` bytes; the copy must have been submitted.
    pub fn request(&mut self, context: &GpuContext, bytes: usize) {
        let (sender, receiver) = sync_channel(1);
        self.at_least(context, bytes).slice(..whole_words(bytes)).map_async(
            wgpu::MapMode::Read,
            move |outcome| {
                // Nobody asks any more where the wait has failed.
                let _ = sender.send(outcome);
            },
        );
        self.answer = Some(receiver);
    }

    /// Hands what was requested to `read`, after the device was waited for.
    pub fn take<R>(
        &mut self,
        pass: &'static str,
        bytes: usize,
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, EngineError> {
        let label = self.label;
        let failed = |reason: &str| EngineError::Gpu { pass, reason: format!("mapping {label}: {reason}") };
        let answer = self.answer.take().ok_or_else(|| failed("nothing was requested"))?;
        match answer.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(failed(&error.to_string())),
            Err(_) => return Err(failed("the device never answered")),
        }
        let (buffer, _) = self.buffer.as_ref().ok_or_else(|| failed("it was freed"))?;
        let view = buffer
            .slice(..whole_words(bytes))
            .get_mapped_range()
            .map_err(|error| failed(&error.to_string()))?;
        let result = read(&view[..bytes]);
        drop(view);
        buffer.unmap();
        Ok(result)
    }
}
