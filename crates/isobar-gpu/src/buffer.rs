//! Buffers: made within the device's limits, written, read back.

use crate::{Gpu, GpuError};
use bytemuck::Pod;
use std::ops::Range;
use std::time::Duration;

/// How long to wait for the answer to a mapping after the device is idle: the callback is running then, or never will.
const CALLBACK: Duration = Duration::from_secs(10);

/// Storage that a shader reads or writes and that can be read back.
const STORAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::COPY_DST)
    .union(wgpu::BufferUsages::COPY_SRC);

impl Gpu {
    /// Most bytes of a buffer that one shader binding may see (128 MiB on Mesa's software Vulkan).
    #[must_use]
    pub fn binding_limit(&self) -> u64 {
        let r = self.report();
        r.max_storage_binding.min(r.max_buffer)
    }

    /// A storage buffer of `bytes` bytes, zero-filled, rounded up to a multiple of 4 and at least 4 (a binding may not be empty).
    ///
    /// # Errors
    /// [`GpuError::Memory`] beyond [`Gpu::binding_limit`] or when the driver is out of memory; as [`Gpu::guard`].
    pub fn storage_empty(&self, what: &str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        self.buffer(what, bytes, self.binding_limit(), STORAGE)
    }

    /// As [`Gpu::storage_empty`], for arguments of indirect dispatches and draws too.
    ///
    /// # Errors
    /// As [`Gpu::storage_empty`].
    pub fn indirect_empty(&self, what: &str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        self.buffer(what, bytes, self.binding_limit(), STORAGE | wgpu::BufferUsages::INDIRECT)
    }

    /// A storage buffer holding `data`.
    ///
    /// # Errors
    /// As [`Gpu::storage_empty`].
    pub fn storage<T: Pod>(&self, what: &str, data: &[T]) -> Result<wgpu::Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.storage_empty(what, bytes.len() as u64)?;
        self.write(&buffer, bytes)?;
        Ok(buffer)
    }

    /// `data` in as many storage buffers as the binding limit asks for, in order; each but the last holds the same number of items,
    /// given beside them. No items: no buffers.
    ///
    /// # Errors
    /// As [`Gpu::storage_empty`].
    pub fn storage_split<T: Pod>(&self, what: &str, data: &[T]) -> Result<(usize, Vec<wgpu::Buffer>), GpuError> {
        self.storage_split_at(what, data, self.binding_limit())
    }

    /// [`Gpu::storage_split`] with buffers of at most `limit` bytes.
    fn storage_split_at<T: Pod>(&self, what: &str, data: &[T], limit: u64) -> Result<(usize, Vec<wgpu::Buffer>), GpuError> {
        let items = items_within(limit, size_of::<T>()).ok_or_else(|| GpuError::Memory {
            what: what.to_owned(),
            bytes: size_of::<T>() as u64,
            limit,
        })?;
        let buffers = data.chunks(items).map(|c| self.storage(what, c)).collect::<Result<_, _>>()?;
        Ok((items, buffers))
    }

    /// A uniform buffer holding one value.
    ///
    /// # Errors
    /// As [`Gpu::storage_empty`], with the device's limit on uniforms.
    pub fn uniform<T: Pod>(&self, what: &str, value: &T) -> Result<wgpu::Buffer, GpuError> {
        let limit = self.device().limits().max_uniform_buffer_binding_size;
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let buffer = self.buffer(what, size_of::<T>() as u64, limit, usage)?;
        self.write(&buffer, bytemuck::bytes_of(value))?;
        Ok(buffer)
    }

    /// A buffer of any usage; a size beyond `limit` is refused before the driver is asked.
    pub(crate) fn buffer(&self, what: &str, bytes: u64, limit: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
        let size = bytes.max(4).next_multiple_of(4);
        if size > limit {
            return Err(GpuError::Memory {
                what: what.to_owned(),
                bytes,
                limit,
            });
        }
        self.guard(what, size, || {
            self.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size,
                usage,
                mapped_at_creation: false,
            })
        })
    }

    /// Overwrites the front of a buffer; takes effect before the next submitted pass.
    ///
    /// # Errors
    /// As [`Gpu::guard`]; [`GpuError::Refused`] where `data` is longer than the buffer.
    pub fn write(&self, buffer: &wgpu::Buffer, data: &[u8]) -> Result<(), GpuError> {
        // Copies come in words; the tail is written as one padded word.
        let whole = data.len() & !3;
        self.guard("writing a buffer", data.len() as u64, || {
            if whole > 0 {
                self.queue().write_buffer(buffer, 0, &data[..whole]);
            }
            if whole < data.len() {
                let mut last = [0u8; 4];
                last[..data.len() - whole].copy_from_slice(&data[whole..]);
                self.queue().write_buffer(buffer, whole as u64, &last);
            }
        })
    }

    /// Reads the bytes `range` of a buffer with `COPY_SRC`, waiting for all work submitted before. Both ends are multiples of 4.
    ///
    /// # Errors
    /// As [`Gpu::guard`].
    pub fn read_bytes(&self, buffer: &wgpu::Buffer, range: Range<u64>) -> Result<Vec<u8>, GpuError> {
        self.read_with(buffer, range, <[u8]>::to_vec)
    }

    /// Reads `count` items from the front of a buffer.
    ///
    /// # Errors
    /// As [`Gpu::read_bytes`].
    pub fn read<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        let bytes = (count * size_of::<T>()) as u64;
        let padded = bytes.next_multiple_of(4);
        self.read_with(buffer, 0..padded, |b| bytemuck::pod_collect_to_vec(&b[..bytes as usize]))
    }

    /// As [`Gpu::read_bytes`], without copying the bytes: `take` sees them mapped.
    ///
    /// # Errors
    /// As [`Gpu::read_bytes`].
    pub fn read_with<R>(&self, buffer: &wgpu::Buffer, range: Range<u64>, take: impl FnOnce(&[u8]) -> R) -> Result<R, GpuError> {
        let size = range.end - range.start;
        if size == 0 {
            return Ok(take(&[]));
        }
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = self.buffer("reading back", size, self.report().max_buffer, usage)?;
        self.guard("reading back", size, || {
            let mut encoder = self
                .device()
                .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(buffer, range.start, &staging, 0, size);
            self.queue().submit([encoder.finish()]);
        })?;
        self.map(&staging, size, take)
    }

    /// Maps the front of a `MAP_READ` buffer once all submitted work is done.
    pub(crate) fn map<R>(&self, staging: &wgpu::Buffer, size: u64, take: impl FnOnce(&[u8]) -> R) -> Result<R, GpuError> {
        let refused = |reason: String| GpuError::Refused {
            what: "reading back".into(),
            reason,
        };
        let (sent, mapped) = std::sync::mpsc::channel();
        self.guard("reading back", size, || {
            staging.map_async(wgpu::MapMode::Read, 0..size, move |r| {
                let _ = sent.send(r);
            });
        })?;
        self.wait()?;
        // Another thread that waits on the same device may be the one that runs the callback, and still be at it.
        match mapped.recv_timeout(CALLBACK) {
            Ok(Ok(())) => {}
            Ok(Err(e)) => return Err(refused(e.to_string())),
            Err(_) => return Err(refused("the buffer was never mapped".into())),
        }
        let view = staging.get_mapped_range(0..size).map_err(|e| refused(e.to_string()))?;
        let out = take(&view);
        drop(view);
        staging.unmap();
        Ok(out)
    }
}

/// How many items of `size` bytes fit into `limit` bytes when each buffer must be whole words; `None`: not one.
fn items_within(limit: u64, size: usize) -> Option<usize> {
    let limit = usize::try_from(limit & !3).unwrap_or(usize::MAX & !3);
    let items = limit / size.max(1);
    // Keep chunks of small items word-aligned.
    let step = if size.is_multiple_of(4) { 1 } else { 4 };
    Some(items / step * step).filter(|&n| n > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_adapter;

    #[test]
    fn what_is_written_is_read_back() {
        let Some(gpu) = test_adapter("what_is_written_is_read_back") else {
            return;
        };
        let data: Vec<u16> = (0..1001).collect();
        let b = gpu.storage("u16", &data).unwrap();
        assert_eq!(gpu.read::<u16>(&b, data.len()).unwrap(), data);
        assert_eq!(
            gpu.read_bytes(&b, 4..8).unwrap(),
            bytemuck::cast_slice::<u16, u8>(&data[2..4])
        );
        let none: &[f32] = &[];
        let empty = gpu.storage("nothing", none).unwrap();
        assert_eq!(empty.size(), 4);
        assert!(gpu.read::<f32>(&empty, 0).unwrap().is_empty());
    }

    #[test]
    fn splits_hold_everything_in_order() {
        let Some(gpu) = test_adapter("splits_hold_everything_in_order") else {
            return;
        };
        let data: Vec<[f32; 3]> = (0..100).map(|i| [i as f32, 0.5, -1.0]).collect();
        let (items, buffers) = gpu.storage_split_at("points", &data, 12 * 30 + 7).unwrap();
        assert_eq!((items, buffers.len()), (30, 4));
        let back: Vec<[f32; 3]> = buffers
            .iter()
            .flat_map(|b| gpu.read::<[f32; 3]>(b, b.size() as usize / 12).unwrap())
            .collect();
        assert_eq!(back, data);
        assert!(gpu.storage_split::<u8>("nothing", &[]).unwrap().1.is_empty());
        assert!(matches!(
            gpu.storage_split_at("points", &data, 8),
            Err(GpuError::Memory { bytes: 12, limit: 8, .. })
        ));
    }

    #[test]
    fn items_fill_whole_words() {
        assert_eq!(items_within(10, 1), Some(8));
        assert_eq!(items_within(11, 3), None);
        assert_eq!(items_within(12, 3), Some(4));
        assert_eq!(items_within(3, 1), None);
        assert_eq!(items_within(100, 12), Some(8));
    }

    #[test]
    fn too_large_is_memory_with_both_numbers() {
        let Some(gpu) = test_adapter("too_large_is_memory_with_both_numbers") else {
            return;
        };
        let limit = gpu.binding_limit();
        let e = gpu.storage_empty("everything", limit + 4).unwrap_err();
        assert_eq!(
            e,
            GpuError::Memory {
                what: "everything".into(),
                bytes: limit + 4,
                limit
            }
        );
        // A write past the end is refused, not undefined.
        let b = gpu.storage("small", &[1u32]).unwrap();
        assert!(matches!(gpu.write(&b, &[0; 8]), Err(GpuError::Refused { .. })));
    }
}
