//! Locations of poses and streams in buffers, for hosts that read them.

use crate::asset::streams::StreamPlace;
use crate::pack::{POSE_FLOATS, PoseFormat};
use crate::update::technique::Poses;
use ash::vk;
use glam::{Mat4, Vec3};

/// Location of a pose, with numbers in its [`PoseFormat`]: value = offset + number × unit, in input units. Positions
/// are relative to [`PackedLayout::origin`](crate::PackedLayout::origin); normals are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseView {
    /// The buffer, with vertex, storage and transfer source usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex, a multiple of 256.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// Bytes per vertex.
    pub stride: u32,
    /// The pose format.
    pub format: PoseFormat,
    /// Input units per number, by component; 1 for float32. The same for all poses of a crowd.
    pub units: [f32; POSE_FLOATS],
    /// The value of number 0, by component: 0 for float32 and for directions. The same for all poses of a crowd.
    pub offsets: [f32; POSE_FLOATS],
    /// Slot of the instance.
    pub slot: u32,
}

/// Location of a stream of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreamView {
    /// The buffer, with vertex, storage and transfer source usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's first component.
    pub offset: u64,
    /// Number of consecutive components.
    pub components: u32,
    /// Type of a component: float32, or a signed integer of 32 or 16 bits.
    pub format: PoseFormat,
    /// Input units per number, by component; see [`PoseView::units`].
    pub units: [f32; 4],
    /// The value of number 0, by component.
    pub offsets: [f32; 4],
    /// Bytes per vertex.
    pub stride: u32,
    /// Slot of the instance.
    pub slot: u32,
}

impl PoseView {
    pub(super) fn new(poses: &Poses, instance: u32, slot: u32) -> Self {
        let [units, offsets] = poses.scale();
        Self {
            units,
            offsets,
            buffer: poses.buffer,
            offset: poses.offset(instance, slot),
            size: poses.bytes,
            stride: poses.format.stride() as u32,
            format: poses.format,
            slot,
        }
    }

    /// The matrix that converts the numbers that a draw fetches to a position in input units: offset + number × unit.
    /// Multiply the model matrix by it from the right. The normal matrix stays as it is, because normals are stored as
    /// directions. Identity for float32.
    pub fn matrix(&self) -> Mat4 {
        let vector = |of: [f32; POSE_FLOATS]| Vec3::from_slice(&of);
        Mat4::from_translation(vector(self.offsets)) * Mat4::from_scale(vector(self.units))
    }

    pub(super) fn stream(self, place: StreamPlace) -> StreamView {
        let Self { buffer, stride, format, slot, .. } = self;
        let components = place.components();
        let mut units = [1.0; 4];
        let mut offsets = [0.0; 4];
        units[..components.len()].copy_from_slice(&self.units[components.clone()]);
        offsets[..components.len()].copy_from_slice(&self.offsets[components.clone()]);
        let offset = self.offset + format.offset(place.first) as u64;
        let components = components.len() as u32;
        StreamView { buffer, offset, components, format, units, offsets, stride, slot }
    }
}

/// The buffer of a stream of a crowd's poses.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseBuffer {
    /// The stream of instance 0 in slot 0. That of instance i in slot s starts (i ×
    /// [`slots`](crate::UpdateDesc::slots) + s) × `pose_stride` bytes later in the same buffer.
    pub first: StreamView,
    /// Bytes from pose to pose.
    pub pose_stride: u64,
    /// Usage flags of the buffer.
    pub usage: vk::BufferUsageFlags,
    /// Byte offset and size of the poses of all instances.
    pub poses: (u64, u64),
}

impl PoseBuffer {
    pub(super) fn new(poses: &Poses, place: StreamPlace) -> Self {
        let pose = PoseView::new(poses, 0, 0);
        Self {
            first: pose.stream(place),
            pose_stride: poses.bytes,
            usage: poses.usage,
            poses: (pose.offset, poses.range_bytes(poses.instances)),
        }
    }
}
