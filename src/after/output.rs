//! Output buffers of the host.

use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::pack::PackedLayout;
use ash::vk;

/// Largest alignment of storage-buffer offsets of any device.
pub(super) const ALIGNMENT: u64 = 256;

/// An aligned descriptor range that covers the bytes, and the distance from its start to `offset`.
pub(super) fn aligned(buffer: vk::Buffer, offset: u64, size: u64) -> (BufferRange, u64) {
    let before = offset % ALIGNMENT;
    (BufferRange::new(buffer, offset - before, before + size), before)
}

/// An output with one or two float32 triples per vertex of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Output {
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex.
    pub offset: u64,
    /// Bytes per vertex.
    pub stride: u32,
    /// Byte offset of the second triple in a vertex, if there is one.
    pub second: Option<u32>,
}

impl Output {
    fn vertex_bytes(&self) -> u64 {
        12 + u64::from(self.second.unwrap_or(0))
    }

    /// The descriptor range, and the word in it at which the first vertex starts.
    pub fn range(&self, layout: &PackedLayout) -> (BufferRange, u32) {
        let last = (layout.vertex_count as u64 - 1) * u64::from(self.stride);
        let (range, before) = aligned(self.buffer, self.offset, last + self.vertex_bytes());
        (range, (before / 4) as u32)
    }

    /// Checks alignment, stride, storage range and size of the buffer; `what` names the output in errors.
    pub fn check(&self, what: &str, layout: &PackedLayout, device: &Device) -> Result<()> {
        let Self { offset, stride, second, .. } = *self;
        let words = offset.is_multiple_of(4) && stride.is_multiple_of(4) && second.is_none_or(|at| at % 4 == 0);
        let fits = words && u64::from(stride) >= self.vertex_bytes() && second.is_none_or(|at| at >= 12);
        let normals = second.map_or(String::new(), |at| format!(" and normals at {at}"));
        let text = format!("{what} at offset {offset} with stride {stride}{normals}");
        ensure!(fits, text, "use multiples of 4, and a stride with room for three floats, or six with normals");
        let what = format!("{what} for mesh '{}'", layout.name);
        let range = self.range(layout).0;
        let limit = (range.size, "bytes", device.caps.max_storage_range);
        device.caps.check_limit(&format!("{what} takes"), limit, "use a smaller stride")?;
        range.check_room(device, &what)
    }
}
