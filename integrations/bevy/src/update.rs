//! The work of the render world each frame: taking over meshes, making poses, and pointing Bevy's shaders to them.

use crate::frame::Frame;
use crate::mesh::{EntityPose, Morphed};
use crate::targets::{Room, Writer};
use crate::vertices::{VertexRoom, Vertices};
use bevy::ecs::world::{FromWorld, World};
use bevy::log::{error_once, warn};
use bevy::pbr::{MorphIndices, MorphUniforms, skins_use_uniform_buffers};
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::mesh::RenderMesh;
use bevy::render::mesh::allocator::MeshAllocator;
use bevy::render::render_asset::ExtractedAssets;
use bevy::render::renderer::{PendingCommandBuffers, RenderDevice, RenderQueue};
use bevy::render::sync_world::MainEntity;
use deltamorph::Result;
use deltamorph_wgpu::Morph;

/// Morphing on Bevy's device; `None` if the device is not on Vulkan.
#[derive(Resource)]
pub(crate) struct Engine(Option<Inner>);

struct Inner {
    meshes: HashMap<AssetId<Mesh>, Morphed>,
    target_writer: Writer,
    vertex_writer: Writer,
    /// Position of the weights 1 0 1 in Bevy's buffer of the last frame.
    weights_before: Option<u32>,
    // Declared last, so that it is dropped last: the other fields are destroyed on its device.
    morph: Morph,
}

impl FromWorld for Engine {
    fn from_world(world: &mut World) -> Self {
        let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
        if skins_use_uniform_buffers(&device.limits()) {
            warn!("deltamorph: all meshes stay with Bevy's own morphing: the device has no storage buffers for it");
            return Self(None);
        }
        match Morph::new(device.wgpu_device(), queue) {
            Ok(morph) => {
                let device = device.wgpu_device();
                let target_writer = Writer::new(device, wgpu::include_wgsl!("../wgsl/targets.wgsl"));
                let vertex_writer = Writer::new(device, wgpu::include_wgsl!("../wgsl/vertices.wgsl"));
                let meshes = HashMap::default();
                Self(Some(Inner { meshes, target_writer, vertex_writer, weights_before: None, morph }))
            }
            Err(why) => {
                warn!("deltamorph: all meshes stay with Bevy's own morphing: {why}");
                Self(None)
            }
        }
    }
}

/// Takes over the targets of new and changed meshes, before Bevy makes buffers for them.
pub(crate) fn take_meshes(
    mut engine: ResMut<Engine>,
    mut extracted: ResMut<ExtractedAssets<RenderMesh>>,
    mut frame: ResMut<Frame>,
    device: Res<RenderDevice>,
) {
    let Some(Inner { meshes, morph, .. }) = &mut engine.0 else { return };
    extracted.removed.iter().chain(&extracted.modified).for_each(|id| drop(meshes.remove(id)));
    for (id, mesh) in &mut extracted.extracted {
        meshes.remove(id);
        let Some(room) = frame.rooms.get(id) else { continue };
        match Morphed::take(morph, device.wgpu_device(), mesh, *room, &frame.settings) {
            Ok((morphed, bounds)) => {
                meshes.insert(*id, morphed);
                frame.bounds.push((*id, bounds));
            }
            Err(why) => warn!("deltamorph: mesh {id} stays with Bevy's own morphing: {why}"),
        }
    }
}

/// Makes the poses of this frame, and points Bevy's shaders to them.
pub(crate) fn update(
    mut engine: ResMut<Engine>,
    frame: Res<Frame>,
    allocator: Res<MeshAllocator>,
    indices: Res<MorphIndices>,
    mut uniforms: ResMut<MorphUniforms>,
    mut pending: ResMut<PendingCommandBuffers>,
    device: Res<RenderDevice>,
) {
    let Some(engine) = &mut engine.0 else { return };
    let Inner { meshes, .. } = engine;
    // A mesh for which Bevy has not made room yet is tried again in the next frame.
    let ready = meshes.iter_mut().filter(|(id, mesh)| room_of(&allocator, id, mesh).is_some());
    let changed = ready.map(|(id, mesh)| {
        let may = frame.alone.contains(id) && vertices_of(&allocator, id, mesh).is_some();
        mesh.write_in_place(may);
        (*id, mesh.request(*id, &frame))
    });
    let changed: HashMap<_, _> = changed.collect();
    let made = engine.make_poses(&changed, &allocator, device.wgpu_device());
    let is_written = made.is_ok();
    match made {
        Ok(commands) => pending.push(commands),
        Err(why) => error_once!("deltamorph: meshes keep their current shapes: {why}"),
    }
    for (id, changed) in &changed {
        engine.meshes.get_mut(id).into_iter().for_each(|mesh| mesh.turn(changed, is_written));
    }

    // Of the weights 1 0 1, the pair from the first on selects target 0, the pair from the second on target 1.
    let MorphUniforms { current_buffer: weights, descriptors_buffer, .. } = &mut *uniforms;
    let begin = weights.len() as u32;
    [1.0, 0.0, 1.0].into_iter().for_each(|weight| _ = weights.push(weight));
    let before = engine.weights_before.replace(begin);
    let Some(descriptors) = descriptors_buffer else { return };
    for (id, mesh) in &engine.meshes {
        let Some(room) = room_of(&allocator, id, mesh) else { continue };
        for (entity, EntityPose { instance, slot, previous, .. }) in mesh.seen(&frame) {
            let Some(index) = indices.morph_descriptor_index(entity) else { continue };
            let Some(mut descriptor) = descriptors.get(*index).copied() else { continue };
            descriptor.targets_offset = (room.begin + mesh.target(*instance, 0)) as u32;
            descriptor.weight_count = if mesh.in_place { 0 } else { 2 };
            descriptor.current_weights_offset = begin + slot;
            // Bevy decides whether there is a previous pass; otherwise this offset is not read.
            descriptor.prev_weights_offset = before.map_or(!0, |before| before + previous);
            descriptors.set(*index, descriptor);
        }
    }
}

impl Inner {
    /// Makes the commands that compute the poses of these entities and write them as targets.
    ///
    /// # Errors
    /// Those of deltamorph.
    fn make_poses(
        &mut self,
        changed: &HashMap<AssetId<Mesh>, Vec<MainEntity>>,
        allocator: &MeshAllocator,
        device: &wgpu::Device,
    ) -> Result<Vec<wgpu::CommandBuffer>> {
        let is_left = |mesh: &Morphed| mesh.is_posed && !mesh.in_place;
        if changed.values().all(Vec::is_empty) && !self.meshes.values().any(is_left) {
            return Ok(vec![]);
        }
        let are_new = |id: &AssetId<Mesh>| changed.get(id).is_some_and(|changed| !changed.is_empty());
        let crowds = self.meshes.iter_mut().filter(|(id, _)| are_new(id)).map(|(_, mesh)| &mut mesh.crowd);
        let poses = self.morph.update(crowds)?;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("deltamorph") });
        let mut pass = encoder.begin_compute_pass(&Default::default());
        for (id, mesh) in self.meshes.iter().filter(|(id, _)| are_new(id)) {
            let next = mesh.next(&changed[id]);
            if mesh.in_place {
                let Some((vertices, room)) = vertices_of(allocator, id, mesh) else { continue };
                let instance = next.first().map(|(instance, _)| *instance);
                self.vertex_writer.write_vertices(&mut pass, device, mesh, vertices, &room, instance)?;
            } else {
                let Some(room) = room_of(allocator, id, mesh) else { continue };
                self.target_writer.write_targets(&mut pass, device, mesh, &room, &next)?;
            }
        }
        let mut restored = vec![];
        for (id, mesh) in self.meshes.iter().filter(|(_, mesh)| is_left(mesh)) {
            let Some((vertices, room)) = vertices_of(allocator, id, mesh) else { continue };
            self.vertex_writer.write_vertices(&mut pass, device, mesh, vertices, &room, None)?;
            restored.push(*id);
        }
        drop(pass);
        for (id, mesh) in &mut self.meshes {
            mesh.is_posed = (mesh.is_posed && !restored.contains(id)) || (mesh.in_place && are_new(id));
        }
        Ok(poses.into_iter().chain([encoder.finish()]).collect())
    }
}

/// Returns the room that Bevy has made for the targets of a mesh.
fn room_of<'a>(allocator: &'a MeshAllocator, id: &AssetId<Mesh>, mesh: &Morphed) -> Option<Room<'a>> {
    let slice = allocator.mesh_morph_target_slice(id)?;
    let (begin, end) = (u64::from(slice.range.start), u64::from(slice.range.end));
    (end - begin >= mesh.elements()).then_some(Room { buffer: slice.buffer, begin, end })
}

/// Returns the vertices of a mesh and their room in Bevy's buffer; `None` if poses cannot be written over them.
fn vertices_of<'a>(
    allocator: &'a MeshAllocator,
    id: &AssetId<Mesh>,
    mesh: &'a Morphed,
) -> Option<(&'a Vertices, VertexRoom<'a>)> {
    let slice = allocator.mesh_vertex_slice(id)?;
    let room = VertexRoom { buffer: slice.buffer, begin: slice.range.start.into() };
    let is_written = room.buffer.usage().contains(wgpu::BufferUsages::STORAGE);
    is_written.then_some((mesh.vertices_of_bevy.as_ref()?, room))
}
