//! Targets of the pass that writes poses, and output buffers of the application.

use super::skin::Joints;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::pack::PackedLayout;
use ash::vk;

/// Largest alignment of storage-buffer offsets of any device.
const ALIGNMENT: u64 = 256;

/// Output of an instance's pose as float32, skinned or not; see
/// [`MorphEngine::set_output_target`](crate::MorphEngine::set_output_target).
///
/// Vertices are in pose-buffer order, without padding:
/// [`PackedLayout::vertex_count`](crate::PackedLayout::vertex_count) in total.
#[derive(Clone, Copy)]
pub struct OutputTarget<'a> {
    /// The output buffer, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Bytes per vertex, a multiple of 4; 12 if positions are contiguous.
    pub stride: u32,
    /// Bytes from a position to its normal, a multiple of 4 and at least 12; `None`: no normals. Skinned normals have
    /// unit length, others the length of the pose's.
    pub normals: Option<u32>,
    /// Second output buffer and offset, with the same stride. Updates write the two in turn, and the other one holds
    /// the [previous](OutputView::previous) output, for motion vectors, without a copy.
    pub second: Option<(vk::Buffer, u64)>,
    /// The joints that skin the pose; `None`: it is not skinned.
    pub joints: Option<Joints<'a>>,
}

impl OutputTarget<'_> {
    /// Contiguous positions from the start of the buffer, not skinned.
    pub fn new(buffer: vk::Buffer) -> Self {
        Self { buffer, offset: 0, stride: 12, normals: None, second: None, joints: None }
    }

    pub(super) fn outputs(&self) -> Vec<Output> {
        let Self { stride, normals: second, .. } = *self;
        let outputs = [Some((self.buffer, self.offset)), self.second].into_iter().flatten();
        outputs.map(|(buffer, offset)| Output { buffer, offset, stride, second }).collect()
    }
}

/// Locations of an instance's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct OutputView {
    /// Buffer, and byte offset of the first position.
    pub current: (vk::Buffer, u64),
    /// The same before the last update; equal to `current` if nothing changed, on the first update and after a reset;
    /// `None` if the update overwrote it.
    pub previous: Option<(vk::Buffer, u64)>,
}

/// An output buffer with one or two float32 triples per vertex of a mesh.
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

    /// The descriptor range, which is aligned.
    pub fn range(&self, layout: &PackedLayout) -> BufferRange {
        let last = (layout.vertex_count as u64 - 1) * u64::from(self.stride);
        let before = self.offset % ALIGNMENT;
        BufferRange::new(self.buffer, self.offset - before, before + last + self.vertex_bytes())
    }

    /// The word of the range at which the first vertex starts.
    pub fn first_word(&self) -> u32 {
        (self.offset % ALIGNMENT / 4) as u32
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
        let range = self.range(layout);
        let limit = (range.size, "bytes", device.caps.max_storage_range);
        device.caps.check_limit(&format!("{what} takes"), limit, "use a smaller stride")?;
        range.check_room(device, &what)
    }
}
