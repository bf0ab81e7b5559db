//! The pass that writes poses as morph targets into the buffer that Bevy's shaders read.

use crate::mesh::{Morphed, invalid};
use deltamorph::{Result, Semantic};
use std::num::NonZero;
use wgpu::util::DeviceExt;

/// Vertices per workgroup.
pub(crate) const WORKGROUP: u32 = 64;
/// Offsets of storage-buffer bindings must be multiples of this on some devices.
pub(crate) const ALIGNMENT: u64 = 256;
/// Bytes of `MorphAttributes`.
pub(crate) const ATTRIBUTES: u64 = 48;

/// The pipeline of the pass.
pub(crate) struct TargetWriter {
    pipeline: wgpu::ComputePipeline,
}

/// The room of a mesh for targets: elements of `MorphAttributes` in one of Bevy's buffers.
pub(crate) struct Room<'a> {
    pub buffer: &'a wgpu::Buffer,
    pub begin: u64,
    pub end: u64,
}

impl TargetWriter {
    pub fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("../wgsl/targets.wgsl"));
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("deltamorph targets"),
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline }
    }

    /// Records the pass that writes the poses of these instances, each into one of its two targets in the room.
    ///
    /// # Errors
    /// The mesh has no poses.
    pub fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        room: &Room<'_>,
        instances: &[(u32, u32)],
    ) -> Result<()> {
        let most = device.limits().max_compute_workgroups_per_dimension.max(1) as usize;
        instances.chunks(most).try_for_each(|instances| self.dispatch(pass, device, mesh, room, instances))
    }

    /// Dispatches as many instances at a time as one dispatch can take.
    fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        room: &Room<'_>,
        instances: &[(u32, u32)],
    ) -> Result<()> {
        let Some((first, _)) = instances.first() else { return Ok(()) };
        // A binding begins at an aligned offset; the shader skips the rest.
        let lead = (room.begin * ATTRIBUTES) % ALIGNMENT;
        let tangents = |instance| mesh.has_tangents.then(|| mesh.crowd.stream(instance, Semantic::Tangent)).transpose();
        let mut moves: Vec<u8> = Vec::with_capacity(16 * instances.len());
        for &(instance, slot) in instances {
            let pose = mesh.crowd.pose(instance)?.view.offset / 4;
            let tangents = tangents(instance)?.map_or(0, |stream| stream.view.offset / 4);
            let to = lead / 16 + mesh.target(instance, slot) * (ATTRIBUTES / 16);
            let words = [pose, tangents, to, 0].map(|word| (word as u32).to_ne_bytes());
            moves.extend_from_slice(words.as_flattened());
        }
        let pose = mesh.crowd.pose(*first)?;
        let tangents = tangents(*first)?.map_or(pose.buffer, |stream| stream.buffer);
        let moves = filled(device, "deltamorph moves", &moves, wgpu::BufferUsages::STORAGE);
        let begin = room.begin * ATTRIBUTES - lead;
        let targets = wgpu::BufferBinding {
            buffer: room.buffer,
            offset: begin,
            size: NonZero::new(room.end * ATTRIBUTES - begin),
        };
        let entries = [
            mesh.constants.as_entire_binding(),
            pose.buffer.as_entire_binding(),
            tangents.as_entire_binding(),
            mesh.order.as_entire_binding(),
            moves.as_entire_binding(),
            mesh.base.as_entire_binding(),
            wgpu::BindingResource::Buffer(targets),
        ];
        let entries: Vec<_> =
            (0..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("deltamorph targets"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(mesh.vertices.div_ceil(WORKGROUP), instances.len() as u32, 1);
        Ok(())
    }
}

/// Checks that a dispatch of `most` workgroups can process the vertices.
pub(crate) fn check_vertices(vertices: usize, most: u32) -> Result<()> {
    let room = most as usize * WORKGROUP as usize;
    if vertices <= room {
        return Ok(());
    }
    let text = format!("{vertices} vertices, more than the {room} that a dispatch of the device takes");
    Err(invalid(text, "split the mesh"))
}

/// Makes a buffer with these bytes.
pub(crate) fn filled(device: &wgpu::Device, label: &str, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
}

#[cfg(test)]
mod tests {
    use super::check_vertices;

    #[test]
    fn vertices_are_those_of_a_dispatch() {
        assert!(check_vertices(0, 65_535).is_ok() && check_vertices(65_535 * 64, 65_535).is_ok());
        let text = check_vertices(65_535 * 64 + 1, 65_535).expect_err("too many").to_string();
        assert!(text.contains("4194241 vertices, more than the 4194240"), "{text}");
    }
}
