//! Locations of poses and streams in buffers, for hosts that read them.

use crate::asset::streams::{Semantic, StreamPlace, TRIPLE, TRIPLES};
use crate::error::{Error, Result};
use crate::pack::vertex::Places;
use crate::pack::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::update::technique::Poses;
use ash::vk;
use std::borrow::Cow;

/// Location of a pose, with numbers in its [`PoseFormat`]. Positions are relative to [`PackedLayout::origin`]; normals
/// are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseView {
    /// The buffer. Engine-owned ones have vertex, storage and transfer source usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex: a multiple of 256 in an engine-owned pose buffer, of 4 in a host buffer and for
    /// a base pose.
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
    /// Input units per integer, by triple of a vertex (positions, normals): a component is that of the base pose
    /// ([`GpuMesh::base_pose`](crate::GpuMesh::base_pose)) plus integer × unit. 1 for float32. The same for all poses
    /// of a crowd.
    pub units: [f32; TRIPLES],
    /// Slot of the instance; 0 for a base pose.
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
    /// Input units per integer, by component; see [`PoseView::units`]. Base pose:
    /// [`GpuMesh::base_stream`](crate::GpuMesh::base_stream).
    pub units: [f32; 4],
    /// Bytes per vertex.
    pub stride: u32,
    /// Slot of the instance; 0 for a base pose.
    pub slot: u32,
}

impl PoseView {
    pub(super) fn new(poses: &Poses, instance: u32, slot: u32) -> Self {
        Self {
            units: poses.units(),
            buffer: poses.buffer,
            offset: poses.offset(instance, slot),
            size: poses.bytes,
            stride: poses.places.stride(poses.format),
            format: poses.format,
            components: poses.places.bytes(poses.format),
            slot,
        }
    }

    /// [`PoseFormat::vertex_input`] for this layout: binding 0 (and that of the previous pose) has its stride,
    /// attributes its offsets. Components that are not stored have no attribute.
    pub fn vertex_input(
        &self,
        previous: bool,
    ) -> (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>) {
        self.format.vertex_input_at(self.stride, self.components, previous)
    }

    /// The components of a stored pose without gaps; zeros for those that are not stored.
    pub(super) fn tight<'a>(&self, stored: &'a [u8]) -> Cow<'a, [u8]> {
        if self.components == Places::TIGHT.bytes(self.format) && self.stride == Places::TIGHT.stride(self.format) {
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
            let text = format!("stream '{}', which the host's vertices have no place for", place.semantic);
            return Err(Error::invalid(text, "add it to the VertexLayout"));
        };
        let components = place.components();
        let mut units = [1.0; 4];
        units.iter_mut().zip(components.clone()).for_each(|(unit, component)| *unit = self.units[component / TRIPLE]);
        let offset = self.offset + u64::from(at);
        let components = components.len() as u32;
        Ok(StreamView { buffer, offset, components, format, units, stride, slot })
    }
}

/// The buffer of a stream of a crowd's poses.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseBuffer {
    /// The stream of instance 0 in slot 0. That of instance i in slot s starts (i ×
    /// [`slots`](field@crate::UpdateDesc::slots) + s) × `pose_stride` bytes later in the same buffer.
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

/// The group that contains a stream, and the stream's place in it.
pub(super) fn place<'a>(
    layouts: impl Iterator<Item = &'a PackedLayout> + Clone,
    semantic: Semantic,
) -> Result<(usize, StreamPlace)> {
    let streams = layouts.clone().enumerate();
    let streams = streams.flat_map(|(group, layout)| layout.streams.iter().map(move |place| (group, place)));
    let found = streams.clone().find(|(_, place)| place.semantic == semantic);
    found.map(|(group, place)| (group, *place)).ok_or_else(|| {
        let names: Vec<String> = streams.map(|(_, place)| place.semantic.to_string()).collect();
        let mesh = layouts.map(|layout| &*layout.name).next().unwrap_or_default();
        let text = format!("stream '{semantic}' of mesh '{mesh}'");
        Error::invalid(text, format!("it has {}", names.join(", ")))
    })
}
