//! A mesh of Bevy's that is morphed here: its targets, packed, and where the entities that show it have their poses.

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
    CrowdDesc, Error, MeshArrays, MorphSource, PackedMesh, PoseFormat, Result, Semantic, TargetArrays, Tolerance,
    UpdateDesc,
};
use deltamorph_wgpu::{Crowd, Morph};

/// Targets of an entity in Bevy's buffer: the new pose and the previous one, in turns.
const SLOTS: u32 = 2;

/// A mesh that is morphed here.
pub(crate) struct Morphed {
    pub crowd: Crowd,
    pub vertices: u32,
    pub has_tangents: bool,
    /// Where each vertex is in a pose.
    pub order: wgpu::Buffer,
    /// What `wgsl/targets.wgsl` calls so.
    pub constants: wgpu::Buffer,
    /// `None`: poses cannot be written over them.
    pub vertices_of_bevy: Option<Vertices>,
    /// Poses are written over the vertices of the mesh; otherwise as targets.
    pub in_place: bool,
    /// The vertices are not those of the base pose.
    pub is_posed: bool,
    places: HashMap<MainEntity, Place>,
    free: Vec<u32>,
    targets: usize,
    instances: u32,
    /// The log has been told of weights that were not taken.
    complained: bool,
}

/// What an entity has.
pub(crate) struct Place {
    pub instance: u32,
    /// The target that has its pose.
    pub slot: u32,
    /// The one that had it in the last frame.
    pub previous: u32,
    /// Of the pose in `slot`, or of the vertices of the mesh; `None`: it has none yet, or an old one.
    weights: Option<Vec<f32>>,
    /// No target has its pose of the frame before.
    is_new: bool,
    /// Its pose is not where it is read: it has been written over vertices, or as a target.
    is_elsewhere: bool,
}

impl Morphed {
    /// Take over the targets of `mesh`, for `instances` entities, and leave room for their poses in place of them.
    ///
    /// # Errors
    /// A mesh that deltamorph does not take, or that has no room on the device.
    pub fn take(
        morph: &Morph,
        device: &wgpu::Device,
        mesh: &mut Mesh,
        instances: u32,
        settings: &DeltamorphSettings,
    ) -> Result<Self> {
        let vertices = mesh.count_vertices();
        check_vertices(vertices, device.limits().max_compute_workgroups_per_dimension)?;
        let elements = vertices as u64 * u64::from(instances * SLOTS);
        let most = device.limits().max_storage_buffer_binding_size;
        // Bevy binds whole buffers of its own, which it makes larger by half at a time.
        let bytes = elements * ATTRIBUTES * 3 / 2;
        if bytes > most {
            let text = format!("{instances} poses take {bytes} bytes, the device binds {most}");
            return Err(invalid(text, "show fewer of the mesh, or one with fewer vertices"));
        }
        let mut desc = morph.pack_desc(settings.format);
        desc.blocks = desc.blocks.weight_max(settings.weight_max);
        let packed = PackedMesh::pack(&source(mesh)?.to_mesh(Tolerance::default())?, &desc)?;
        let layout = packed.layout();
        let mut order: Vec<u32> = (0..vertices as u32).collect();
        layout.remap_indices(&mut order)?;
        let update = UpdateDesc::blocks().pose(PoseFormat::Fixed32).slots(1);
        // One more than the frames that a surface keeps in flight.
        let crowd = CrowdDesc::new(update).instances(instances).frames_in_flight(3);
        let crowd = morph.create_crowd(&morph.upload(&packed)?, &crowd)?;
        let grid =
            |group: &deltamorph::PackedLayout| update.grid(group).map(|grid| grid.map_or([1.0; 2], |grid| grid.units));
        let has_tangents = mesh.contains_attribute(Mesh::ATTRIBUTE_TANGENT);
        let [position, normal] = grid(layout)?;
        let mut tangent = 1.0;
        for group in packed.groups() {
            if group.layout().streams.first().is_some_and(|place| place.semantic == Semantic::Tangent) {
                [tangent, _] = grid(group.layout())?;
            }
        }
        let units = [position, normal, tangent, 0.0].map(f32::to_ne_bytes);
        let counts = [vertices as u32, has_tangents.into(), 0, 0].map(u32::to_ne_bytes);
        let constants = [units, counts].concat().concat();
        let order: Vec<u8> = order.iter().flat_map(|vertex| vertex.to_ne_bytes()).collect();
        let vertices_of_bevy = Vertices::new(device, mesh, [position, normal, tangent]);
        mesh.set_morph_targets(vec![MorphAttributes::default(); elements as usize]);
        Ok(Self {
            crowd,
            vertices: vertices as u32,
            has_tangents,
            order: filled(device, "deltamorph order", &order, wgpu::BufferUsages::STORAGE),
            constants: filled(device, "deltamorph constants", &constants, wgpu::BufferUsages::UNIFORM),
            vertices_of_bevy,
            in_place: false,
            is_posed: false,
            places: HashMap::default(),
            free: (0..instances).rev().collect(),
            targets: layout.targets.len(),
            instances,
            complained: false,
        })
    }

    /// Elements of the room for its targets.
    pub fn elements(&self) -> u64 {
        self.target(self.instances, 0)
    }

    /// Elements from the beginning of the room to a target.
    pub fn target(&self, instance: u32, slot: u32) -> u64 {
        u64::from(self.vertices) * u64::from(instance * SLOTS + slot)
    }

    /// From now on write poses over the vertices, or as targets: all of them are made anew where that changes.
    pub fn write_in_place(&mut self, in_place: bool) {
        if self.in_place != in_place {
            self.in_place = in_place;
            self.places.values_mut().for_each(|place| (place.is_elsewhere, place.is_new) = (true, true));
        }
    }

    /// The entities that are seen, and where their poses are.
    pub fn seen<'a>(&'a self, frame: &'a Frame) -> impl Iterator<Item = (MainEntity, &'a Place)> {
        let seen = |entity| frame.shown.get(entity).is_some_and(|shown| shown.weights.is_some());
        self.places.iter().filter(move |(entity, _)| seen(*entity)).map(|(entity, place)| (*entity, place))
    }

    /// Request what entities of this frame have for weights. Returns those whose poses change.
    pub fn request(&mut self, id: AssetId<Mesh>, frame: &Frame) -> Vec<MainEntity> {
        let of_us = |shown: &Shown| shown.mesh == id;
        let free = &mut self.free;
        self.places.retain(|entity, place| {
            place.previous = place.slot;
            let keep = frame.shown.get(entity).is_some_and(of_us);
            if !keep {
                free.push(place.instance);
            }
            keep
        });
        let mut changed = vec![];
        for (entity, shown) in frame.shown.iter().filter(|(_, shown)| of_us(shown)) {
            let Some(range) = &shown.weights else { continue };
            let Some(place) = place_of(&mut self.places, free, *entity) else { continue };
            // As Bevy's shaders do: targets without a weight have 0, weights without a target do nothing.
            let mut weights = frame.weights[range.clone()].to_vec();
            weights.resize(self.targets, 0.0);
            if place.weights.as_ref() != Some(&weights) {
                match self.crowd.set_weights(place.instance, &weights) {
                    Ok(()) => {
                        place.weights = Some(weights);
                        place.is_elsewhere = true;
                    }
                    Err(why) if !self.complained => {
                        error!("deltamorph: mesh {id}: an entity keeps the shape that it has: {why}");
                        self.complained = true;
                    }
                    Err(_) => {}
                }
            }
            if place.is_elsewhere && place.weights.is_some() {
                changed.push(*entity);
            }
        }
        changed
    }

    /// The instances of these entities, and the target of each that is not in use.
    pub fn next(&self, changed: &[MainEntity]) -> Vec<(u32, u32)> {
        changed.iter().map(|entity| &self.places[entity]).map(|place| (place.instance, 1 - place.slot)).collect()
    }

    /// The new poses of these entities are written, or will not be.
    pub fn turn(&mut self, changed: &[MainEntity], is_written: bool) {
        for entity in changed {
            let Some(place) = self.places.get_mut(entity) else { continue };
            if is_written {
                place.slot = 1 - place.slot;
                place.is_elsewhere = false;
                if std::mem::take(&mut place.is_new) {
                    place.previous = place.slot;
                }
            } else {
                place.weights = None;
            }
        }
    }
}

/// The place of an entity; a free one for one that is new.
fn place_of<'a>(
    places: &'a mut HashMap<MainEntity, Place>,
    free: &mut Vec<u32>,
    entity: MainEntity,
) -> Option<&'a mut Place> {
    if !places.contains_key(&entity) {
        places.insert(
            entity,
            Place { instance: free.pop()?, slot: 0, previous: 0, weights: None, is_new: true, is_elsewhere: false },
        );
    }
    places.get_mut(&entity)
}

/// Base pose and targets of a mesh.
///
/// # Errors
/// Attributes that are compressed, or targets of another number of vertices.
fn source(mesh: &Mesh) -> Result<MorphSource> {
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
        // Nobody reads them: any that targets leave alone.
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
    let mut source = MorphSource::from_arrays(&MeshArrays {
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
