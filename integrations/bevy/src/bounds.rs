//! Boxes of entities, by which Bevy culls them and tests rays: those of their poses.

use crate::Wanted;
use crate::frame::{Frame, weights_of};
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::{NoAutoAabb, NoFrustumCulling};
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::mesh::skinning::SkinnedMesh;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::MainWorld;
use deltamorph::WeightBounds;
use std::sync::Arc;

/// Takes bounds from the render world, which packs the meshes.
pub(crate) fn share(mut frame: ResMut<Frame>, mut main: ResMut<MainWorld>) {
    for (id, bounds) in frame.bounds.drain(..) {
        main.resource_mut::<Wanted>().bounds.insert(id, bounds.into());
    }
}

/// The boxes of an entity.
pub(crate) struct Boxes {
    bounds: Arc<WeightBounds>,
    weights: Vec<f32>,
    pose: Aabb,
    /// An upper bound of the displacement of any vertex.
    reach: f32,
    /// The box that Bevy or the application has written.
    before: Aabb,
}

/// Sets the boxes of entities with these meshes, after Bevy has written its own.
pub(crate) fn update(
    wanted: Res<Wanted>,
    mut shown: Query<
        (Entity, &Mesh3d, Option<&MeshMorphWeights>, Has<SkinnedMesh>, Ref<ViewVisibility>, &mut Aabb),
        (Without<NoFrustumCulling>, Without<NoAutoAabb>),
    >,
    shared: Query<&MorphWeights>,
    mut all: Local<HashMap<Entity, Boxes>>,
) {
    let mut old = std::mem::take(&mut *all);
    for (entity, mesh, own, is_skinned, visibility, mut aabb) in &mut shown {
        let Some(bounds) = wanted.bounds.get(&mesh.id()) else { continue };
        let weights = own.and_then(|own| weights_of(own, &shared)).unwrap_or_default();
        // An entity whose weights are refused keeps its pose.
        let is_refused = !weights.iter().all(|weight| weight.abs() <= wanted.settings.weight_max);
        let old = old.remove(&entity);
        let before = match &old {
            Some(old) if !aabb.is_changed() => old.before,
            _ => *aabb,
        };
        let new = match old {
            Some(old) if Arc::ptr_eq(&old.bounds, bounds) && (is_refused || old.weights == weights) => {
                Boxes { before, ..old }
            }
            _ => {
                let pose = bounds.of(weights, 0.0);
                let pose = Aabb::from_min_max(pose.min.into(), pose.max.into());
                // The bounds of a cluster of vertices are those of its base pose and, on either side, what targets add.
                let clusters = bounds.of_clusters(weights, 0.0).zip(bounds.of_clusters(&[], 0.0));
                let reach = clusters.fold(0.0, |reach, (pose, base)| {
                    let low = Vec3::from(pose.min) - Vec3::from(base.min);
                    let high = Vec3::from(pose.max) - Vec3::from(base.max);
                    low.abs().max(high.abs()).length().max(reach)
                });
                Boxes { bounds: bounds.clone(), weights: weights.to_vec(), pose, reach, before }
            }
        };
        aabb.set_if_neq(if is_skinned {
            Aabb { half_extents: before.half_extents + new.reach, ..before }
        } else {
            new.pose
        });
        // Bevy 0.20 draws what becomes visible without targets, until anything of it changes.
        if visibility.is_changed() {
            aabb.set_changed();
        }
        all.insert(entity, new);
    }
}
