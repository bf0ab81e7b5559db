//! A Bevy mesh that is morphed here: its packed targets, and the poses of the entities that show it.

use crate::DeltamorphSettings;
use crate::frame::{Frame, Shown};
use crate::targets::{ATTRIBUTES, check_vertices, filled};
use crate::vertices::Vertices;
use bevy::mesh::morph::MorphAttributes;
use bevy::mesh::{MeshVertexAttribute, VertexAttributeValues};
use bevy::platform::collections::HashMap;
use bevy::prelude::{AssetId, Mesh, error};
use bevy::render::sync_world::MainEntity;
use deltamorph::{
    CrowdDesc, Error, MeshArrays, PackedLayout, PoseFormat, Result, Semantic, TargetArrays, UpdateDesc, WeightBounds,
};
use deltamorph_wgpu::{Crowd, Morph, Stream};

/// Targets of an entity in Bevy's buffer, used alternately for the new pose and the previous one.
const SLOTS: u32 = 2;

/// The vectors of a vertex that targets move.
pub(crate) const VECTORS: [MeshVertexAttribute; 3] =
    [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_TANGENT];

/// Units of integers and the position of integer 0, as the uniforms of `wgsl` begin.
pub(crate) type Scale = [f32; 8];

/// A mesh that is morphed here.
pub(crate) struct Morphed {
    pub crowd: Crowd,
    pub vertices: u32,
    pub has_tangents: bool,
    /// For each vertex, its index in a pose.
    pub order: wgpu::Buffer,
    /// The uniform `constants` of `wgsl/targets.wgsl`.
    pub constants: wgpu::Buffer,
    /// The [`VECTORS`] of each vertex as they were.
    pub base: wgpu::Buffer,
    /// `None` if poses cannot be written over the vertices.
    pub vertices_of_bevy: Option<Vertices>,
    /// Poses are written over the vertices of the mesh; otherwise as targets.
    pub in_place: bool,
    /// The vertices hold a pose.
    pub is_posed: bool,
    poses: HashMap<MainEntity, EntityPose>,
    free: Vec<u32>,
    targets: usize,
    instances: u32,
    /// The log has reported refused weights.
    complained: bool,
}

/// The state of an entity's pose.
pub(crate) struct EntityPose {
    pub instance: u32,
    /// The target that has its pose.
    pub slot: u32,
    /// The target that had it in the previous frame.
    pub previous: u32,
    /// Weights of the pose in `slot`, or in the vertices of the mesh; `None` if there is none yet, or only an outdated
    /// one.
    weights: Option<Vec<f32>>,
    /// No target has its pose of the previous frame.
    is_new: bool,
    /// Its pose was last written to the other destination (vertices or a target) than the one now read.
    is_elsewhere: bool,
}

impl Morphed {
    /// Takes over the targets of `mesh`, for `instances` entities, and replaces them with room for their poses.
    /// Also returns the bounds of poses.
    ///
    /// # Errors
    /// deltamorph does not accept the mesh, or the device has no room for it.
    pub fn take(
        morph: &Morph,
        device: &wgpu::Device,
        mesh: &mut Mesh,
        instances: u32,
        settings: &DeltamorphSettings,
    ) -> Result<(Self, WeightBounds)> {
        let vertices = mesh.count_vertices();
        check_vertices(vertices, device.limits().max_compute_workgroups_per_dimension)?;
        let elements = vertices as u64 * u64::from(instances * SLOTS);
        let most = device.limits().max_storage_buffer_binding_size;
        // Bevy binds its whole buffers, which grow by half at a time.
        let bytes = elements * ATTRIBUTES * 3 / 2;
        if bytes > most {
            let text = format!("{instances} poses take {bytes} bytes, the device binds {most}");
            return Err(invalid(text, "show fewer of the mesh, or one with fewer vertices"));
        }
        let mut desc = morph.pack_desc(settings.format);
        desc.blocks.weight_max = settings.weight_max;
        desc.blocks.normal_error_degrees = settings.normal_error_degrees;
        let packed = source(mesh)?.pack(&desc)?;
        let layout = packed.layout();
        let mut order: Vec<u32> = (0..vertices as u32).collect();
        layout.remap_indices(&mut order)?;
        let update = UpdateDesc { pose: PoseFormat::Fixed32, slots: 1, ..UpdateDesc::blocks() };
        let bounds = WeightBounds::new(&packed, &update)?;
        // One more than the number of frames that a surface keeps in flight.
        let crowd = CrowdDesc { instances, frames_in_flight: 3, ..CrowdDesc::new(update) };
        let crowd = morph.create_crowd(&morph.upload(&packed)?, &crowd)?;
        let scale_of = |group: &PackedLayout| -> Result<_> {
            let grid = update.grid(group)?;
            Ok(grid.map_or(([1.0; 6], [0.0; 6]), |grid| (grid.units, grid.offsets)))
        };
        let has_tangents = mesh.contains_attribute(Mesh::ATTRIBUTE_TANGENT);
        let ([x, y, z, normal, ..], [zero_x, zero_y, zero_z, ..]) = scale_of(layout)?;
        let mut tangent = 1.0;
        for group in packed.layouts() {
            if group.streams.first().is_some_and(|stream| stream.semantic == Semantic::Tangent) {
                ([tangent, ..], _) = scale_of(group)?;
            }
        }
        let scale: Scale = [x, y, z, normal, zero_x, zero_y, zero_z, tangent];
        let counts = [vertices as u32, has_tangents.into(), 0, 0].map(u32::to_ne_bytes);
        let constants = [&scale.map(f32::to_ne_bytes)[..], &counts].concat().concat();
        let order: Vec<u8> = order.iter().flat_map(|vertex| vertex.to_ne_bytes()).collect();
        let vertices_of_bevy = Vertices::new(device, mesh, &scale);
        let base = filled(device, "deltamorph vertices", &vectors(mesh), wgpu::BufferUsages::STORAGE);
        mesh.set_morph_targets(vec![MorphAttributes::default(); elements as usize]);
        let morphed = Self {
            crowd,
            vertices: vertices as u32,
            has_tangents,
            order: filled(device, "deltamorph order", &order, wgpu::BufferUsages::STORAGE),
            constants: filled(device, "deltamorph constants", &constants, wgpu::BufferUsages::UNIFORM),
            base,
            vertices_of_bevy,
            in_place: false,
            is_posed: false,
            poses: HashMap::default(),
            free: (0..instances).rev().collect(),
            targets: layout.targets.len(),
            instances,
            complained: false,
        };
        Ok((morphed, bounds))
    }

    /// Returns the number of elements in the room for its targets.
    pub fn elements(&self) -> u64 {
        self.target(self.instances, 0)
    }

    /// Returns the offset of a target, in elements from the beginning of the room.
    pub fn target(&self, instance: u32, slot: u32) -> u64 {
        u64::from(self.vertices) * u64::from(instance * SLOTS + slot)
    }

    /// The tangents of an instance's pose, if the mesh has any.
    pub fn tangents(&self, instance: u32) -> Result<Option<Stream<'_>>> {
        self.has_tangents.then(|| self.crowd.stream(instance, Semantic::Tangent)).transpose()
    }

    /// Where the pose of an instance and its tangents begin in their buffers, in words.
    pub fn places(&self, instance: u32) -> Result<[u64; 2]> {
        let tangents = self.tangents(instance)?.map_or(0, |stream| stream.view.offset);
        Ok([self.crowd.pose(instance)?.view.offset, tangents].map(|offset| offset / 4))
    }

    /// Switches between writing poses over the vertices and writing them as targets; a change invalidates all of them.
    pub fn write_in_place(&mut self, in_place: bool) {
        if self.in_place != in_place {
            self.in_place = in_place;
            self.poses.values_mut().for_each(|pose| (pose.is_elsewhere, pose.is_new) = (true, true));
        }
    }

    /// Iterates over the visible entities and the state of their poses.
    pub fn seen<'a>(&'a self, frame: &'a Frame) -> impl Iterator<Item = (MainEntity, &'a EntityPose)> {
        let seen = |entity| frame.shown.get(entity).is_some_and(|shown| shown.weights.is_some());
        self.poses.iter().filter(move |(entity, _)| seen(*entity)).map(|(entity, pose)| (*entity, pose))
    }

    /// Requests the weights of this frame's entities. Returns the entities whose poses change.
    pub fn request(&mut self, id: AssetId<Mesh>, frame: &Frame) -> Vec<MainEntity> {
        let of_us = |shown: &Shown| shown.mesh == id;
        let free = &mut self.free;
        self.poses.retain(|entity, pose| {
            pose.previous = pose.slot;
            let keep = frame.shown.get(entity).is_some_and(of_us);
            if !keep {
                free.push(pose.instance);
            }
            keep
        });
        let mut changed = vec![];
        for (entity, shown) in frame.shown.iter().filter(|(_, shown)| of_us(shown)) {
            let Some(range) = &shown.weights else { continue };
            let Some(pose) = entity_pose(&mut self.poses, free, *entity) else { continue };
            // As in Bevy's shaders: targets without a weight have 0, and surplus weights do nothing.
            let mut weights = frame.weights[range.clone()].to_vec();
            weights.resize(self.targets, 0.0);
            if pose.weights.as_ref() != Some(&weights) {
                match self.crowd.set_weights(pose.instance, &weights) {
                    Ok(()) => {
                        pose.weights = Some(weights);
                        pose.is_elsewhere = true;
                    }
                    Err(why) if !self.complained => {
                        error!("deltamorph: mesh {id}: an entity keeps its current shape: {why}");
                        self.complained = true;
                    }
                    Err(_) => {}
                }
            }
            if pose.is_elsewhere && pose.weights.is_some() {
                changed.push(*entity);
            }
        }
        changed
    }

    /// Returns the instances of these entities, each with its unused target.
    pub fn next(&self, changed: &[MainEntity]) -> Vec<(u32, u32)> {
        changed.iter().map(|entity| &self.poses[entity]).map(|pose| (pose.instance, 1 - pose.slot)).collect()
    }

    /// Switches targets after the new poses of these entities have been written, or could not be.
    pub fn turn(&mut self, changed: &[MainEntity], is_written: bool) {
        for entity in changed {
            let Some(pose) = self.poses.get_mut(entity) else { continue };
            if is_written {
                pose.slot = 1 - pose.slot;
                pose.is_elsewhere = false;
                if std::mem::take(&mut pose.is_new) {
                    pose.previous = pose.slot;
                }
            } else {
                pose.weights = None;
            }
        }
    }
}

/// Returns the state of an entity; a new entity gets a free instance.
fn entity_pose<'a>(
    poses: &'a mut HashMap<MainEntity, EntityPose>,
    free: &mut Vec<u32>,
    entity: MainEntity,
) -> Option<&'a mut EntityPose> {
    if !poses.contains_key(&entity) {
        poses.insert(
            entity,
            EntityPose {
                instance: free.pop()?,
                slot: 0,
                previous: 0,
                weights: None,
                is_new: true,
                is_elsewhere: false,
            },
        );
    }
    poses.get_mut(&entity)
}

/// The [`VECTORS`] of each vertex of a mesh that [`source`] takes, in bytes; zeros for one that it does not have.
fn vectors(mesh: &Mesh) -> Vec<u8> {
    let mut all = vec![[[0.0f32; 3]; 3]; mesh.count_vertices()];
    for (i, attribute) in VECTORS.iter().enumerate() {
        match mesh.attribute(attribute.id) {
            Some(VertexAttributeValues::Float32x3(values)) => {
                all.iter_mut().zip(values).for_each(|(vectors, value)| vectors[i] = *value);
            }
            Some(VertexAttributeValues::Float32x4(values)) => {
                all.iter_mut().zip(values).for_each(|(vectors, [x, y, z, _])| vectors[i] = [*x, *y, *z]);
            }
            _ => {}
        }
    }
    all.as_flattened().as_flattened().iter().flat_map(|value| value.to_ne_bytes()).collect()
}

/// Makes a source of the base pose and the targets of a mesh.
///
/// # Errors
/// The attributes are compressed, or targets have another number of vertices.
fn source(mesh: &Mesh) -> Result<deltamorph::Mesh> {
    let count = mesh.count_vertices();
    let floats = |attribute: MeshVertexAttribute| {
        let text = format!("{} are not of float32", attribute.name);
        invalid(text, "do not compress the attributes of meshes with targets")
    };
    let positions = match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(values)) => values,
        _ => return Err(floats(Mesh::ATTRIBUTE_POSITION)),
    };
    let normals = match mesh.attribute(Mesh::ATTRIBUTE_NORMAL) {
        Some(VertexAttributeValues::Float32x3(values)) => values.clone(),
        // Any normals will do: they are not read, and targets do not change them.
        None => vec![[0.0, 0.0, 1.0]; count],
        Some(_) => return Err(floats(Mesh::ATTRIBUTE_NORMAL)),
    };
    let tangents: &[[f32; 4]] = match mesh.attribute(Mesh::ATTRIBUTE_TANGENT) {
        Some(VertexAttributeValues::Float32x4(values)) => values,
        None => &[],
        Some(_) => return Err(floats(Mesh::ATTRIBUTE_TANGENT)),
    };
    let attributes = mesh.try_morph_targets().map_err(|why| invalid(why.to_string(), "load it anew"))?;
    if count == 0 || !attributes.len().is_multiple_of(count) {
        let text = format!("targets of {} vertices for a mesh of {count}", attributes.len());
        return Err(invalid(text, "give one for each target and vertex"));
    }
    let vectors = |of: fn(&MorphAttributes) -> [f32; 3], is_there: bool| -> Vec<Vec<[f32; 3]>> {
        let target = |target: &[MorphAttributes]| if is_there { target.iter().map(of).collect() } else { vec![] };
        attributes.chunks_exact(count).map(target).collect()
    };
    let has_normals = mesh.contains_attribute(Mesh::ATTRIBUTE_NORMAL);
    let still = vec![[0.0; 3]; count];
    let moved = vectors(|vertex| vertex.position.to_array(), true);
    let turned = vectors(|vertex| vertex.normal.to_array(), has_normals);
    let twisted = vectors(|vertex| vertex.tangent.to_array(), !tangents.is_empty());
    let target = |((positions, normals), tangents)| TargetArrays {
        name: "",
        positions,
        normals: if has_normals { normals } else { &still },
        tangents,
    };
    let arrays = moved.iter().map(Vec::as_slice).zip(turned.iter().map(Vec::as_slice));
    let targets: Vec<_> = arrays.zip(twisted.iter().map(Vec::as_slice)).map(target).collect();
    let name = "of Bevy";
    let mut source = deltamorph::Mesh::from_arrays(&MeshArrays {
        name,
        positions,
        normals: &normals,
        tangents,
        targets: &targets,
        ..Default::default()
    })?;
    source.weld()?;
    Ok(source)
}

pub(crate) fn invalid(what: impl Into<String>, remedy: impl Into<String>) -> Error {
    Error::Invalid { what: what.into(), remedy: remedy.into() }
}
