//! Locations of poses and streams in buffers, for hosts that read them.

use crate::asset::streams::StreamPlace;
use crate::error::{Result, refuse};
use crate::pack::vertex::VertexOffsets;
use crate::pack::{POSE_FLOATS, PoseFormat};
use crate::update::technique::Poses;
use ash::vk;
use glam::{Mat4, Vec3};
use std::borrow::Cow;

/// Location of a pose, with numbers in its [`PoseFormat`]: value = offset + number × unit, in input units. Positions
/// are relative to [`PackedLayout::origin`](crate::PackedLayout::origin); normals are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseView {
    /// The buffer. Engine-owned ones have vertex, storage and transfer source usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex: a multiple of 256 in an engine-owned pose buffer, of 4 in a host buffer.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// Bytes per vertex.
    pub stride: u32,
    /// The pose format.
    pub format: PoseFormat,
    /// Byte offset in a vertex of each of its six components (position, then normal); `None`: not stored in the host's
    /// vertices.
    pub components: [Option<u32>; POSE_FLOATS],
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
    /// The buffer. Engine-owned ones have vertex, storage and transfer source usage.
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
            stride: poses.offsets.stride(poses.format),
            format: poses.format,
            components: poses.offsets.bytes(poses.format),
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

    /// The components of a stored pose without gaps; zeros for those that are not stored.
    pub(super) fn tight<'a>(&self, stored: &'a [u8]) -> Cow<'a, [u8]> {
        if self.components == VertexOffsets::TIGHT.bytes(self.format)
            && self.stride == VertexOffsets::TIGHT.stride(self.format)
        {
            return Cow::Borrowed(stored);
        }
        let (number, mut tight) = (self.format.number_bytes(), vec![]);
        for vertex in stored.chunks_exact(self.stride as usize) {
            for at in self.components {
                match at {
                    Some(at) => tight.extend_from_slice(&vertex[at as usize..][..number]),
                    None => tight.resize(tight.len() + number, 0),
                }
            }
        }
        Cow::Owned(tight)
    }

    /// # Errors
    /// It is not stored.
    pub(super) fn stream(self, place: StreamPlace) -> Result<StreamView> {
        let Self { buffer, stride, format, slot, .. } = self;
        let Some(at) = self.components[place.first] else {
            let text = format!("stream '{}', which the application's vertices do not contain", place.semantic);
            return refuse(text, "add it to the VertexLayout");
        };
        let components = place.components();
        let mut units = [1.0; 4];
        let mut offsets = [0.0; 4];
        units[..components.len()].copy_from_slice(&self.units[components.clone()]);
        offsets[..components.len()].copy_from_slice(&self.offsets[components.clone()]);
        let offset = self.offset + u64::from(at);
        let components = components.len() as u32;
        Ok(StreamView { buffer, offset, components, format, units, offsets, stride, slot })
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
    /// Usage flags of the buffer; empty (unknown) for a host's buffer.
    pub usage: vk::BufferUsageFlags,
    /// Byte offset and size of the poses of all instances; groups share the host's vertices.
    pub poses: (u64, u64),
}

impl PoseBuffer {
    pub(super) fn new(poses: &Poses, place: StreamPlace) -> Result<Self> {
        let pose = PoseView::new(poses, 0, 0);
        Ok(Self {
            first: pose.stream(place)?,
            pose_stride: poses.bytes,
            usage: poses.usage,
            poses: (pose.offset, poses.range_bytes(poses.instances) - poses.lead),
        })
    }
}
