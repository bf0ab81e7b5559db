//! The pass that writes a pose over the vertices of a mesh that a single entity shows, so that Bevy's shaders have no
//! targets to add.

use crate::mesh::{Morphed, Scale, VECTORS};
use crate::targets::{ALIGNMENT, WORKGROUP, filled};
use bevy::prelude::Mesh;
use deltamorph::{Result, Semantic};
use std::num::NonZero;

/// Bytes of a word.
const WORD: u64 = 4;
/// Marks an attribute that the mesh does not have.
const NONE: u32 = u32::MAX;

/// The pipeline of the pass.
pub(crate) struct VertexWriter {
    pipeline: wgpu::ComputePipeline,
}

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

impl VertexWriter {
    pub fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("../wgsl/vertices.wgsl"));
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("deltamorph vertices"),
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline }
    }

    /// Records the pass that writes the pose of an instance over the vertices of the mesh, or the vertices as they were
    /// without an instance.
    ///
    /// # Errors
    /// The mesh has no poses.
    pub fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        vertices: &Vertices,
        room: &VertexRoom<'_>,
        instance: Option<u32>,
    ) -> Result<()> {
        let pose = mesh.crowd.pose(instance.unwrap_or(0))?;
        let tangents =
            mesh.has_tangents.then(|| mesh.crowd.stream(instance.unwrap_or(0), Semantic::Tangent)).transpose()?;
        // A binding begins at an aligned offset; the shader skips the rest.
        let begin = room.begin * vertices.stride;
        let lead = begin % ALIGNMENT;
        let tangents_at = tangents.as_ref().map_or(0, |stream| stream.view.offset);
        let words = [pose.view.offset / WORD, tangents_at / WORD, lead / WORD, instance.is_some().into()];
        let words = words.map(|word| (word as u32).to_ne_bytes());
        let place = filled(device, "deltamorph move", words.as_flattened(), wgpu::BufferUsages::UNIFORM);
        let written = wgpu::BufferBinding {
            buffer: room.buffer,
            offset: begin - lead,
            size: NonZero::new(lead + u64::from(mesh.vertices) * vertices.stride),
        };
        let entries = [
            vertices.constants.as_entire_binding(),
            pose.buffer.as_entire_binding(),
            tangents.map_or(pose.buffer, |stream| stream.buffer).as_entire_binding(),
            mesh.order.as_entire_binding(),
            place.as_entire_binding(),
            mesh.base.as_entire_binding(),
            wgpu::BindingResource::Buffer(written),
        ];
        let entries: Vec<_> =
            (0..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("deltamorph vertices"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(mesh.vertices.div_ceil(WORKGROUP), 1, 1);
        Ok(())
    }
}
