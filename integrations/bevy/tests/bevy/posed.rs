use bevy::asset::RenderAssetUsages;
use bevy::prelude::*;

/// Makes a mesh of a pose, for ray casts.
pub fn posed(mesh: &Mesh, weights: &[f32]) -> Option<Mesh> {
    let mut positions = mesh.attribute(Mesh::ATTRIBUTE_POSITION)?.as_float3()?.to_vec();
    let targets = mesh.morph_targets()?.chunks(positions.len().max(1));
    for (target, weight) in targets.zip(weights) {
        for (position, vertex) in positions.iter_mut().zip(target) {
            *position = (Vec3::from(*position) + *weight * vertex.position).to_array();
        }
    }
    let posed = Mesh::new(mesh.primitive_topology(), RenderAssetUsages::MAIN_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions);
    Some(match mesh.indices() {
        Some(indices) => posed.with_inserted_indices(indices.clone()),
        None => posed,
    })
}
