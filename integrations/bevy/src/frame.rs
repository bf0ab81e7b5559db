//! The data that the render world extracts each frame: the entities that show each mesh, with their weights.

use crate::{DeltamorphSettings, Wanted};
use bevy::camera::visibility::ViewVisibility;
use bevy::core_pipeline::prepass::MotionVectorPrepass;
use bevy::mesh::Mesh2d;
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::render::Extract;
use bevy::render::sync_world::MainEntity;
use deltamorph::WeightBounds;
use std::ops::Range;

/// The state of the main world in this frame.
#[derive(Resource, Default)]
pub(crate) struct Frame {
    /// The meshes to morph here, each with the number of entities to make room for.
    pub rooms: HashMap<AssetId<Mesh>, u32>,
    pub settings: DeltamorphSettings,
    /// The entities that show these meshes.
    pub shown: HashMap<MainEntity, Shown>,
    /// The weights of all entities.
    pub weights: Vec<f32>,
    /// The meshes whose vertices may hold a pose: a single entity shows the mesh, and no camera needs motion vectors,
    /// which require the previous pose.
    pub alone: HashSet<AssetId<Mesh>>,
    /// Bounds of meshes that were taken over, for the main world.
    pub bounds: Vec<(AssetId<Mesh>, WeightBounds)>,
}

/// An entity that shows a mesh.
pub(crate) struct Shown {
    pub mesh: AssetId<Mesh>,
    /// The range of its weights in [`Frame::weights`]; `None` if it is not visible.
    pub weights: Option<Range<usize>>,
}

pub(crate) fn extract(
    mut frame: ResMut<Frame>,
    wanted: Extract<Res<Wanted>>,
    shown: Extract<Query<(Entity, &Mesh3d, &ViewVisibility, &MeshMorphWeights)>>,
    shared: Extract<Query<&MorphWeights>>,
    others: Extract<Query<&Mesh3d, Without<MeshMorphWeights>>>,
    flat: Extract<Query<&Mesh2d>>,
    moving: Extract<Query<(), With<MotionVectorPrepass>>>,
) {
    let Frame { rooms, settings, shown: entities, weights, alone, .. } = &mut *frame;
    rooms.clone_from(&wanted.rooms);
    *settings = wanted.settings;
    entities.clear();
    weights.clear();
    alone.clear();
    for (entity, mesh, visibility, own) in &shown {
        if !rooms.contains_key(&mesh.id()) {
            continue;
        }
        // As in Bevy's own extraction: an invisible entity has no weights, and is not drawn.
        let values = weights_of(own, &shared).filter(|_| visibility.get());
        let range = values.map(|values| {
            let begin = weights.len();
            weights.extend_from_slice(values);
            begin..weights.len()
        });
        entities.insert(entity.into(), Shown { mesh: mesh.id(), weights: range });
    }
    if rooms.is_empty() || !moving.is_empty() {
        return;
    }
    let mut counts: HashMap<AssetId<Mesh>, u32> = HashMap::default();
    let others = others.iter().map(|mesh| mesh.id()).chain(flat.iter().map(|mesh| mesh.id()));
    let all = entities.values().map(|shown| shown.mesh).chain(others);
    all.filter(|id| rooms.contains_key(id)).for_each(|id| *counts.entry(id).or_default() += 1);
    alone.extend(counts.iter().filter(|(_, count)| **count == 1).map(|(id, _)| *id));
}

/// The weights that an entity names.
pub(crate) fn weights_of<'a>(own: &'a MeshMorphWeights, shared: &'a Query<&MorphWeights>) -> Option<&'a [f32]> {
    match own {
        MeshMorphWeights::Value { weights } => Some(weights),
        MeshMorphWeights::Reference(of) => shared.get(*of).ok().map(MorphWeights::weights),
    }
}
