//! A mesh in device memory.

use super::barriers;
use super::device::Device;
use super::memory::Buffer;
use super::statistics::MemoryKind;
use crate::error::Result;
use crate::pack::blocks::PoseGrid;
use crate::pack::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::plan::schedule::asset_uploaded;
use ash::vk::{self, BufferUsageFlags};
use std::any::Any;
use std::sync::Arc;

/// Uses of base poses and deltas: by kernels, by vertex passes and draws, and by copies.
const ASSET_USAGE: BufferUsageFlags = BufferUsageFlags::from_raw(
    BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw()
        | BufferUsageFlags::VERTEX_BUFFER.as_raw()
        | BufferUsageFlags::TRANSFER_SRC.as_raw()
        | BufferUsageFlags::TRANSFER_DST.as_raw(),
);

/// Data of a technique that keeps its own upload of a mesh.
pub type Private = Box<dyn Any + Send + Sync>;

/// The device-local part of a group of a mesh.
pub struct MeshBuffers {
    /// The layout of its data.
    pub layout: PackedLayout,
    /// The base pose (dense formats).
    pub base: Buffer,
    /// Dense formats: the deltas. Block formats: headers, deltas and base pose, the whole asset.
    pub deltas: Buffer,
    /// The base pose on the host, for base poses in integers.
    pub host: Arc<[f32]>,
    /// Uploaded for one technique, in words of its own: what that keeps with them.
    pub private: Option<Private>,
}

/// Staging memory, and the copies from it.
pub struct Upload {
    staging: Buffer,
    copies: Vec<(vk::Buffer, vk::BufferCopy)>,
}

impl MeshBuffers {
    /// Buffers of a base pose and of deltas, and what fills them.
    pub fn new(
        device: &Arc<Device>,
        layout: PackedLayout,
        base: &[f32],
        deltas: &[u32],
        private: Option<Private>,
    ) -> Result<(Self, Upload)> {
        let host = base.into();
        let (base_bytes, delta_bytes): (&[u8], &[u8]) = (bytemuck::cast_slice(base), bytemuck::cast_slice(deltas));
        let is_asset = layout.format.is_blocks() && private.is_none();
        let base_at = if is_asset { base_offset(&layout) } else { delta_bytes.len() as u64 };
        let base_size = if is_asset { 0 } else { layout.base_bytes() };
        let deltas_size = if private.is_none() { deltas_bytes(&layout) } else { base_at };
        let name = |what: &str| format!("deltamorph {what} of mesh '{}'", layout.name);
        let base = Buffer::new(device, &name("base pose"), base_size, ASSET_USAGE, MemoryKind::Meshes)?;
        let deltas = Buffer::new(device, &name("deltas"), deltas_size, ASSET_USAGE, MemoryKind::Meshes)?;
        let bytes = base_at + base_bytes.len() as u64;
        let mut staging = Buffer::staging(device, &name("upload"), bytes)?;
        let (before, after) = staging.mapped()?[..bytes as usize].split_at_mut(base_at as usize);
        let (words, padding) = before.split_at_mut(delta_bytes.len());
        words.copy_from_slice(delta_bytes);
        padding.fill(0);
        after.copy_from_slice(base_bytes);

        let region = |from: u64, size: u64| vk::BufferCopy::default().src_offset(from).size(size);
        let mut copies = match is_asset {
            true => vec![(deltas.raw, region(0, bytes))],
            false => vec![(deltas.raw, region(0, base_at)), (base.raw, region(base_at, bytes - base_at))],
        };
        copies.retain(|(_, region)| region.size > 0);
        Ok((Self { layout, base, deltas, host, private }, Upload::new(staging, copies)))
    }

    /// Makes a buffer of the base pose in the integers of a crowd's poses ([`PoseFormat::base_words`]). In memory that
    /// the host writes, so that making a crowd records nothing.
    pub(crate) fn integer_base(&self, device: &Arc<Device>, pose: PoseFormat, grid: &PoseGrid) -> Result<Buffer> {
        let words = pose.base_words(grid, &self.host, self.layout.vertex_count);
        let usage = BufferUsageFlags::STORAGE_BUFFER | BufferUsageFlags::UNIFORM_TEXEL_BUFFER;
        let name = format!("deltamorph base pose in integers of mesh '{}'", self.layout.name);
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let mut buffer = Buffer::new(device, &name, bytes.len() as u64, usage, MemoryKind::Lists)?;
        buffer.mapped()?[..bytes.len()].copy_from_slice(bytes);
        Ok(buffer)
    }
}

impl Upload {
    /// Copies from `staging`, which is kept as long as they may run.
    pub fn new(staging: Buffer, copies: Vec<(vk::Buffer, vk::BufferCopy)>) -> Self {
        Self { staging, copies }
    }

    /// Makes a storage buffer of these lists, one after the other, and the upload that fills it.
    pub(crate) fn of(device: &Arc<Device>, name: &str, lists: &[&[u8]]) -> Result<(Buffer, Self)> {
        let bytes = lists.iter().map(|list| list.len() as u64).sum();
        let usage = BufferUsageFlags::STORAGE_BUFFER | BufferUsageFlags::TRANSFER_DST;
        let buffer = Buffer::new(device, name, bytes, usage, MemoryKind::Meshes)?;
        let mut staging = Buffer::staging(device, "deltamorph upload", bytes)?;
        let mut mapped = staging.mapped()?;
        for list in lists {
            let (here, rest) = mapped.split_at_mut(list.len());
            here.copy_from_slice(list);
            mapped = rest;
        }
        let copies = vec![(buffer.raw, vk::BufferCopy::default().size(bytes))];
        Ok((buffer, Self::new(staging, copies)))
    }

    /// Records the copies.
    ///
    /// # Safety
    /// Those of [`record_uploads`]; the caller records a barrier after the copies.
    unsafe fn record(&self, device: &Device, cmd: vk::CommandBuffer) {
        for copies in self.copies.chunk_by(|a, b| a.0 == b.0) {
            let regions: Vec<vk::BufferCopy> = copies.iter().map(|(_, region)| *region).collect();
            // SAFETY: the caller's obligations; regions lie within both buffers, and overlap nowhere.
            unsafe { device.raw.cmd_copy_buffer(cmd, self.staging.raw, copies[0].0, &regions) };
        }
    }
}

/// Records the upload of all groups of a mesh, or of other data for it, and one barrier after it.
///
/// # Safety
/// - `cmd` is in the recording state on `device`, outside a render pass, on any queue.
/// - The uploads and their meshes are dropped only when the device no longer uses them.
pub(crate) unsafe fn record_uploads(device: &Device, cmd: vk::CommandBuffer, uploads: &[Upload]) {
    for upload in uploads {
        // SAFETY: the caller's obligations.
        unsafe { upload.record(device, cmd) };
    }
    // SAFETY: the caller's obligations.
    unsafe { barriers::record(&device.raw, cmd, &asset_uploaded()) };
}

/// Returns the bytes of the largest chunk of deltas.
pub(crate) fn chunk_bytes(layout: &PackedLayout) -> u64 {
    (layout.chunk_vertices * layout.targets.len() * layout.format.stride()) as u64
}

/// Returns the byte offset of the base pose of a mesh in blocks, which follows headers and deltas in one buffer.
/// Without entries, zeros take their place: tiles have at least one row, which names an entry.
pub(crate) fn base_offset(layout: &PackedLayout) -> u64 {
    let empty = layout.blocks.as_ref().filter(|index| index.entry_count() == 0);
    let no_entry = empty.map_or(0, |index| index.size() * POSE_FLOATS * size_of::<f32>());
    (layout.index_bytes() + layout.delta_bytes() + no_entry as u64).next_multiple_of(16)
}

/// Returns the bytes of the buffer of deltas. For dense formats it holds whole chunks, so that one descriptor range
/// fits at every chunk's offset; for block formats, headers, deltas and base pose.
pub(crate) fn deltas_bytes(layout: &PackedLayout) -> u64 {
    match layout.format.is_blocks() {
        true => base_offset(layout) + layout.base_bytes(),
        false => (chunk_bytes(layout) * layout.chunks().count() as u64).max(16),
    }
}

/// Returns the bytes that a descriptor of dense deltas covers.
pub fn delta_range(layout: &PackedLayout) -> u64 {
    chunk_bytes(layout).max(16)
}
