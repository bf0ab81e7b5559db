//! Where poses and their streams are, for hosts that read them.

use crate::asset::streams::{Semantic, StreamPlace, TRIPLE, TRIPLES};
use crate::error::{Error, Result};
use crate::pack::vertex::Places;
use crate::pack::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::update::technique::Poses;
use ash::vk;
use std::borrow::Cow;

/// Where a pose is: from `offset` on, each number as its [`PoseFormat`] says. Positions are relative to
/// [`PackedLayout::origin`]; normals are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseView {
    /// The buffer; usable as vertex, storage and transfer-source buffer, if it is not the host's own.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex: a multiple of 256 of a pose in a buffer of ours, of 4 of a base pose and in a buffer
    /// of the host's.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// How numbers are stored.
    pub format: PoseFormat,
    /// Bytes from the beginning of a vertex to each of its six numbers (position, then normal); `None`: not stored, in
    /// vertices of the host's that have no place for it.
    pub components: [Option<u32>; POSE_FLOATS],
    /// Input units of integers, of each triple of a vertex (of positions and of normals): a number is that of the base
    /// pose ([`GpuMesh::base_pose`](crate::GpuMesh::base_pose)) plus integer × unit. 1 where numbers are float32. The
    /// same for all poses of a crowd.
    pub units: [f32; TRIPLES],
    /// Which slot of the instance it is; 0 of a base pose.
    pub slot: u32,
}

/// Where a stream of a pose is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreamView {
    /// The buffer; usable as vertex, storage and transfer-source buffer, if it is not the host's own.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's first component.
    pub offset: u64,
    /// Components, one after the other.
    pub components: u32,
    /// What a component is: float32; or an integer of 32 or 16 bits, signed.
    pub format: PoseFormat,
    /// Input units of integers, component by component; see [`PoseView::units`]. The component of the base pose is in
    /// [`GpuMesh::base_stream`](crate::GpuMesh::base_stream).
    pub units: [f32; 4],
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// Which slot of the instance it is; 0 of a base pose.
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

    /// [`PoseFormat::vertex_input`] of this layout: binding 0 (and that of the previous pose) has its stride,
    /// attributes their places in its vertices. What is not stored has no attribute.
    pub fn vertex_input(
        &self,
        previous: bool,
    ) -> (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>) {
        self.format.vertex_input_at(self.stride, self.components, previous)
    }

    /// The numbers of a pose from the bytes that are stored, one after the other; zeros for what is not stored.
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
            let text = format!("stream '{}', which the host's own vertices have no place for", place.semantic);
            return Err(Error::invalid(text, "name it in the VertexLayout"));
        };
        let components = place.components();
        let mut units = [1.0; 4];
        units.iter_mut().zip(components.clone()).for_each(|(unit, component)| *unit = self.units[component / TRIPLE]);
        let (offset, components) = (self.offset + u64::from(at), components.len() as u32);
        Ok(StreamView { buffer, offset, components, format, units, stride, slot })
    }
}

/// The buffer that a stream of a crowd's poses is in.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseBuffer {
    /// The stream of instance 0 in slot 0. That of instance i in slot s begins
    /// (i × [`slots`](field@crate::UpdateDesc::slots) + s) × `pose_stride` bytes later, in the same buffer.
    pub first: StreamView,
    /// Bytes from pose to pose.
    pub pose_stride: u64,
    /// What the buffer was made for; empty where it is the host's own, which knows.
    pub usage: vk::BufferUsageFlags,
    /// Where the poses of all instances begin in the buffer, and how many bytes they take; those of several groups
    /// share the host's own vertices.
    pub poses: (u64, u64),
}

impl PoseBuffer {
    pub(super) fn new(poses: &Poses, place: StreamPlace) -> Result<Self> {
        let (pose, count) = (PoseView::new(poses, 0, 0), u64::from(poses.instances) * u64::from(poses.slots));
        Ok(Self {
            first: pose.stream(place)?,
            pose_stride: poses.bytes,
            usage: poses.usage,
            poses: (pose.offset, count * poses.bytes),
        })
    }
}

/// The group that has a stream, and where.
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
