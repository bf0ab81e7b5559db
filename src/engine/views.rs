//! Where poses and their streams are, for hosts that read them.

use crate::asset::streams::{Semantic, StreamPlace, TRIPLE, TRIPLES};
use crate::error::{Error, Result};
use crate::pack::{PackedLayout, PoseFormat};
use ash::vk;

/// Where a pose is: from `offset` on, each vertex as its [`PoseFormat`] says. Normals are not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseView {
    /// The buffer; usable as vertex, storage and transfer-source buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex: a multiple of 256 of a pose, of 4 of a base pose.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// How vertices are stored.
    pub format: PoseFormat,
    /// Input units of integers, of each triple of a vertex (of positions and of normals): a number is that of the base
    /// pose ([`GpuMesh::base_pose`](crate::GpuMesh::base_pose)) plus integer × unit. 1 where numbers are float32. The same
    /// for all poses of a crowd.
    pub units: [f32; TRIPLES],
    /// Which slot of the instance it is; 0 of a base pose.
    pub slot: u32,
}

/// Where a stream of a pose is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreamView {
    /// The buffer; usable as vertex, storage and transfer-source buffer.
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
    pub(super) fn stream(self, place: StreamPlace) -> StreamView {
        let Self { buffer, offset, stride, format, slot, .. } = self;
        let components = place.components();
        let mut units = [1.0; 4];
        units.iter_mut().zip(components.clone()).for_each(|(unit, component)| *unit = self.units[component / TRIPLE]);
        let (offset, components) = (offset + format.offset(place.first) as u64, components.len() as u32);
        StreamView { buffer, offset, components, format, units, stride, slot }
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
