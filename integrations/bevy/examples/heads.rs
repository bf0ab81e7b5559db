//! Three heads in Bevy, morphed by deltamorph: the plugin is all that it takes.
//!
//!     cargo run --ignore-rust-version --example heads

use bevy::asset::RenderAssetUsages;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::mesh::morph::{MeshMorphWeights, MorphAttributes};
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use deltamorph_bevy::DeltamorphPlugin;
use deltamorph_bevy::deltamorph::{KeptMesh, Tolerance, glam};
use deltamorph_head::{HeadDesc, head, head_clip};

fn main() -> AppExit {
    App::new()
        .add_plugins((DefaultPlugins, DeltamorphPlugin))
        .add_systems(Startup, spawn)
        .add_systems(Update, animate)
        .run()
}

/// The weights of all targets, for each frame.
#[derive(Resource)]
struct Clip(Vec<Vec<f32>>);

fn spawn(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) -> Result {
    let desc = HeadDesc { vertices: 20_000, ..Default::default() };
    let head = head(&desc).split()?.kept(Tolerance::default())?;
    let names: Vec<&str> = head.targets.iter().map(|target| target.name.as_str()).collect();
    commands.insert_resource(Clip(head_clip(&desc, 120, 30.0).bind(&names)?.frames().collect()));

    // The glTF loader makes such meshes and components, too.
    let mesh = meshes.add(mesh(&head).with_morph_targets(targets(&head)));
    let material = materials.add(Color::srgb(0.85, 0.65, 0.55));
    for x in [-20.0, 0.0, 20.0] {
        let weights = MeshMorphWeights::Value { weights: vec![0.0; names.len()] };
        let drawn = (Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()));
        commands.spawn((drawn, weights, Transform::from_xyz(x, 0.0, 0.0)));
    }
    let light = Transform::from_xyz(3.0, 4.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((DirectionalLight::default(), light));
    // Bevy's default needs its feature `tonemapping_luts`.
    commands.spawn((Camera3d::default(), Tonemapping::AcesFitted, Transform::from_xyz(0.0, 0.0, 60.0)));
    Ok(())
}

/// Plays the clip, each head slightly later than the one before.
fn animate(time: Res<Time>, clip: Res<Clip>, mut heads: Query<&mut MeshMorphWeights>) {
    let frame = (30.0 * time.elapsed_secs()) as usize;
    for (i, mut head) in heads.iter_mut().enumerate() {
        let weights = clip.0[(frame + 7 * i) % clip.0.len()].clone();
        *head = MeshMorphWeights::Value { weights };
    }
}

/// Makes Bevy's mesh, without targets.
pub fn mesh(head: &KeptMesh) -> Mesh {
    let mut uvs = vec![[0.0; 2]; head.vertex_count()];
    for corner in head.faces.iter().flatten() {
        let uv = corner.texcoord.map(|at| head.texcoords[at as usize].to_array());
        uvs[corner.position as usize] = uv.unwrap_or_default();
    }
    let vectors = |of: &[glam::Vec3]| of.iter().map(glam::Vec3::to_array).collect::<Vec<_>>();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vectors(&head.positions))
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vectors(&head.normals))
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
        .with_inserted_indices(Indices::U32(head.faces.triangles(&head.positions).into_flattened()))
}

/// Returns targets in Bevy's form: all attributes of all vertices, for each target.
pub fn targets(head: &KeptMesh) -> Vec<MorphAttributes> {
    let count = head.vertex_count();
    let mut attributes = vec![MorphAttributes::default(); count * head.targets.len()];
    for (all, target) in attributes.chunks_exact_mut(count).zip(&head.targets) {
        for (i, v) in target.vertices.iter().enumerate() {
            let [position, normal] = [target.positions[i], target.normals[i]].map(|d| Vec3::from(d.to_array()));
            all[*v as usize] = MorphAttributes::new(position, normal, Vec3::ZERO);
        }
    }
    attributes
}
