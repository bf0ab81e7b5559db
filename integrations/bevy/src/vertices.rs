//! The pass that writes a pose over the vertices of a mesh that a single entity shows, so that Bevy's shaders have no
//! targets to add.

use crate::mesh::{Morphed, Scale, VECTORS};
use crate::targets::{Writer, aligned, filled};
use bevy::prelude::Mesh;
use deltamorph::Result;

/// Bytes of a word.
const WORD: u64 = 4;
/// Marks an attribute that the mesh does not have.
const NONE: u32 = u32::MAX;

/// The vertices of a mesh, in the layout of Bevy's buffer.
pub(crate) struct Vertices {
    /// The uniform `constants` of `wgsl/vertices.wgsl`.
    constants: wgpu::Buffer,
    /// Bytes of a vertex.
    stride: u64,
}

/// The room of a mesh's vertices in one of Bevy's buffers.
pub(crate) struct VertexRoom<'a> {
    pub buffer: &'a wgpu::Buffer,
    /// The first vertex, counted in vertices.
    pub begin: u64,
}

impl Vertices {
    /// Describes the vertices of `mesh`, for poses in this scale; `None` if a vertex's size is not a multiple of 4
    /// bytes.
    pub fn new(device: &wgpu::Device, mesh: &Mesh, scale: &Scale) -> Option<Self> {
        // In Bevy's interleaving order.
        let (mut stride, mut offsets) = (0, [NONE; 3]);
        for (attribute, _) in mesh.attributes() {
            let wanted = VECTORS.iter().zip(&mut offsets).find(|(wanted, _)| wanted.id == attribute.id);
            wanted.into_iter().for_each(|(_, offset)| *offset = (stride / WORD) as u32);
            let bytes = attribute.format.size();
            if !bytes.is_multiple_of(WORD) {
                return None;
            }
            stride += bytes;
        }
        let [position, normal, tangent] = offsets;
        let counts = [mesh.count_vertices() as u32, (stride / WORD) as u32, position, normal, tangent, 0, 0, 0];
        let constants = [scale.map(f32::to_ne_bytes), counts.map(u32::to_ne_bytes)].concat().concat();
        Some(Self {
            constants: filled(device, "deltamorph constants of vertices", &constants, wgpu::BufferUsages::UNIFORM),
            stride,
        })
    }
}

impl Writer {
    /// Records the pass that writes the pose of an instance over the vertices of the mesh, or the vertices as they were
    /// without an instance.
    ///
    /// # Errors
    /// The mesh has no poses.
    pub fn write_vertices(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        vertices: &Vertices,
        room: &VertexRoom<'_>,
        instance: Option<u32>,
    ) -> Result<()> {
        let begin = room.begin * vertices.stride;
        let (lead, written) = aligned(room.buffer, begin, begin + u64::from(mesh.vertices) * vertices.stride);
        let [pose, tangents] = mesh.places(instance.unwrap_or(0))?;
        let words = [pose, tangents, lead / WORD, instance.is_some().into()];
        let words = words.map(|word| (word as u32).to_ne_bytes());
        let place = filled(device, "deltamorph move", words.as_flattened(), wgpu::BufferUsages::UNIFORM);
        self.dispatch(pass, device, mesh, [&vertices.constants, &place], (written, 1))
    }
}
