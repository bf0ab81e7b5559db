//! The pass that writes poses as morph targets into the buffer that Bevy's shaders read.

use crate::mesh::{Morphed, invalid};
use deltamorph::Result;
use std::num::NonZero;
use wgpu::util::DeviceExt;

/// Vertices per workgroup.
const WORKGROUP: u32 = 64;
/// Offsets of storage-buffer bindings must be multiples of this on some devices.
const ALIGNMENT: u64 = 256;
/// Bytes of `MorphAttributes`.
pub(crate) const ATTRIBUTES: u64 = 48;

/// The room of a mesh for targets: elements of `MorphAttributes` in one of Bevy's buffers.
pub(crate) struct Room<'a> {
    pub buffer: &'a wgpu::Buffer,
    pub begin: u64,
    pub end: u64,
}

/// A pass that writes poses of a mesh, an invocation per vertex.
pub(crate) struct Writer(wgpu::ComputePipeline);

impl Writer {
    pub fn new(device: &wgpu::Device, shader: wgpu::ShaderModuleDescriptor<'_>) -> Self {
        Self(device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("deltamorph poses"),
            layout: None,
            module: &device.create_shader_module(shader),
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        }))
    }

    /// Records the pass that writes the poses of these instances, each into one of its two targets in the room.
    ///
    /// # Errors
    /// The mesh has no poses.
    pub fn write_targets(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        room: &Room<'_>,
        instances: &[(u32, u32)],
    ) -> Result<()> {
        let (lead, targets) = aligned(room.buffer, room.begin * ATTRIBUTES, room.end * ATTRIBUTES);
        // As many instances at a time as one dispatch can take.
        for instances in instances.chunks(device.limits().max_compute_workgroups_per_dimension.max(1) as usize) {
            let mut moves: Vec<u8> = Vec::with_capacity(16 * instances.len());
            for &(instance, slot) in instances {
                let [pose, tangents] = mesh.places(instance)?;
                let to = lead / 16 + mesh.target(instance, slot) * (ATTRIBUTES / 16);
                let words = [pose, tangents, to, 0].map(|word| (word as u32).to_ne_bytes());
                moves.extend_from_slice(words.as_flattened());
            }
            let moves = filled(device, "deltamorph moves", &moves, wgpu::BufferUsages::STORAGE);
            let count = instances.len() as u32;
            self.dispatch(pass, device, mesh, [&mesh.constants, &moves], (targets.clone(), count))?;
        }
        Ok(())
    }

    /// Dispatches `count` instances per vertex, with these constants and moves.
    pub fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        device: &wgpu::Device,
        mesh: &Morphed,
        [constants, moves]: [&wgpu::Buffer; 2],
        (written, count): (wgpu::BufferBinding<'_>, u32),
    ) -> Result<()> {
        // One buffer has the poses of all instances.
        let pose = mesh.crowd.pose(0)?.buffer;
        let tangents = mesh.tangents(0)?.map_or(pose, |stream| stream.buffer);
        let buffers = [constants, pose, tangents, &mesh.order, moves, &mesh.base];
        let entries = buffers.map(wgpu::Buffer::as_entire_binding).into_iter();
        let entries = (0..).zip(entries.chain([wgpu::BindingResource::Buffer(written)]));
        let entries: Vec<_> = entries.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("deltamorph poses"),
            layout: &self.0.get_bind_group_layout(0),
            entries: &entries,
        });
        pass.set_pipeline(&self.0);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(mesh.vertices.div_ceil(WORKGROUP), count, 1);
        Ok(())
    }
}

/// A binding of these bytes of a buffer, which begins at an aligned offset; and how many bytes before them the shader
/// skips.
pub(crate) fn aligned(buffer: &wgpu::Buffer, begin: u64, end: u64) -> (u64, wgpu::BufferBinding<'_>) {
    let lead = begin % ALIGNMENT;
    let offset = begin - lead;
    (lead, wgpu::BufferBinding { buffer, offset, size: NonZero::new(end - offset) })
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
