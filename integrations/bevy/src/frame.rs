//! What the render world is told of the main world in each frame: who shows which mesh, with which weights.

use crate::{DeltamorphSettings, Wanted};
use bevy::camera::visibility::ViewVisibility;
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::platform::collections::HashMap;
use bevy::prelude::{AssetId, Entity, Mesh, Mesh3d, Query, Res, ResMut, Resource};
use bevy::render::Extract;
use bevy::render::sync_world::MainEntity;
use std::ops::Range;

/// The main world in this frame.
#[derive(Resource, Default)]
pub(crate) struct Frame {
    /// The meshes to be morphed here, and for how many entities each is to have room.
    pub rooms: HashMap<AssetId<Mesh>, u32>,
    pub settings: DeltamorphSettings,
    /// The entities that show one of them.
    pub shown: HashMap<MainEntity, Shown>,
    /// The weights of all of them.
    pub weights: Vec<f32>,
}

/// An entity that shows a mesh.
pub(crate) struct Shown {
    pub mesh: AssetId<Mesh>,
    /// Where its weights are in [`Frame::weights`]; `None` where it is not seen.
    pub weights: Option<Range<usize>>,
}

pub(crate) fn extract(
    mut frame: ResMut<Frame>,
    wanted: Extract<Res<Wanted>>,
    shown: Extract<Query<(Entity, &Mesh3d, &ViewVisibility, &MeshMorphWeights)>>,
    shared: Extract<Query<&MorphWeights>>,
) {
    let Frame { rooms, settings, shown: entities, weights } = &mut *frame;
    rooms.clone_from(&wanted.rooms);
    *settings = wanted.settings;
    entities.clear();
    weights.clear();
    for (entity, mesh, visibility, own) in &shown {
        if !rooms.contains_key(&mesh.id()) {
            continue;
        }
        // As Bevy's own extraction does: what is not seen has no weights, and is drawn by nobody.
        let values = match own {
            _ if !visibility.get() => None,
            MeshMorphWeights::Value { weights } => Some(weights.as_slice()),
            MeshMorphWeights::Reference(of) => shared.get(*of).ok().map(MorphWeights::weights),
        };
        let range = values.map(|values| {
            let begin = weights.len();
            weights.extend_from_slice(values);
            begin..weights.len()
        });
        entities.insert(entity.into(), Shown { mesh: mesh.id(), weights: range });
    }
}
