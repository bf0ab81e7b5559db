//! Morph targets of [`deltamorph`] in Bevy: a plugin, and nothing else to change.
//!
//! ```no_run
//! # use bevy::prelude::*;
//! # use deltamorph_bevy::DeltamorphPlugin;
//! App::new().add_plugins(DefaultPlugins).add_plugins(DeltamorphPlugin).run();
//! ```
//!
//! Entities with a [`Mesh3d`] and Bevy's own [`MeshMorphWeights`], as the glTF loader makes them, are morphed by
//! deltamorph from then on, from the weights that Bevy's components name
//! ([`MorphWeights`](bevy::mesh::morph::MorphWeights)). Materials, shadows, prepasses, motion vectors and skins are
//! Bevy's, and stay as they are. [`DeltamorphSettings`] switches all of them to Bevy's own morphing and back,
//! [`BevyMorphing`] those of a mesh.
//!
//! # How
//! Bevy's vertex shaders add up all targets of a mesh, from a storage buffer that has 48 bytes for each vertex of each
//! target, in each pass again. Here the mesh has two targets for each entity in their place, which no file has made:
//! deltamorph computes the displacement of all vertices once a frame, where weights have changed, and writes it into
//! one of the two. The shaders are Bevy's, unchanged, and are told that it has weight 1; the other is the previous one,
//! with weight 1 where motion vectors are computed. Where one entity alone shows a mesh, and no camera has motion vectors,
//! deltamorph writes the pose over the vertices of the mesh, and the shaders are told of no target at all.
//!
//! All of it is in the render world: components and assets of the
//! application are only read. An [`AssetEvent::Modified`](bevy::asset::AssetEvent) has a mesh extracted anew. So the
//! targets themselves take no memory of the GPU, as long as a mesh is morphed here.
//!
//! # What stays with Bevy
//! Devices other than Vulkan's, and meshes that deltamorph cannot take. The log says which, and why.

mod frame;
mod mesh;
mod targets;
mod update;
mod vertices;

pub use deltamorph::{self, DeltaFormat};

use bevy::asset::{AssetEventSystems, RenderAssetUsages};
use bevy::ecs::schedule::IntoScheduleConfigs;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::pbr::{prepare_morph_descriptors, write_morph_buffers};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::{
    App, AssetId, Assets, Component, Has, Mesh, Mesh3d, Plugin, PostUpdate, Query, Res, ResMut, Resource, With, warn,
};
use bevy::render::mesh::allocator::{MeshAllocatorSettings, allocate_and_free_meshes};
use bevy::render::render_resource::BufferUsages;
use bevy::render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems};

/// Morphs meshes with deltamorph: see the [crate's description](crate).
#[derive(Clone, Copy, Debug, Default)]
pub struct DeltamorphPlugin;

/// Who morphs, and how. May be changed at any time: meshes are prepared anew then, which takes as long as when they
/// were loaded.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct DeltamorphSettings {
    /// false: Bevy morphs all meshes itself.
    pub enabled: bool,
    /// How targets are stored: one of [`DeltaFormat::BLOCKS`].
    pub format: DeltaFormat,
    /// The largest weight, either sign (above 0, up to 255): entities with a larger one keep the shape that they have.
    /// The smaller, the finer the grid that displacements lie on.
    pub weight_max: f32,
}

impl Default for DeltamorphSettings {
    /// Enabled, in the format `fast`, weights up to 4.
    fn default() -> Self {
        Self { enabled: true, format: DeltaFormat::Fast, weight_max: 4.0 }
    }
}

/// On an entity: Bevy morphs its mesh itself, of all entities that show the same [`Mesh`].
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct BevyMorphing;

/// The meshes to be morphed here.
#[derive(Resource, Default)]
struct Wanted {
    /// For how many entities each is to have room.
    rooms: HashMap<AssetId<Mesh>, u32>,
    /// Those that stay with Bevy, which the log has been told.
    refused: HashSet<AssetId<Mesh>>,
    settings: DeltamorphSettings,
}

impl Plugin for DeltamorphPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DeltamorphSettings>().init_resource::<Wanted>();
        // Before the events of this frame are sent, so that the render world hears of it at once.
        app.add_systems(PostUpdate, choose.before(AssetEventSystems));
        let Some(render) = app.get_sub_app_mut(RenderApp) else { return };
        // Poses may be written over vertices.
        let mut allocator = render.world_mut().get_resource_or_init::<MeshAllocatorSettings>();
        allocator.extra_buffer_usages |= BufferUsages::STORAGE;
        render.init_resource::<frame::Frame>();
        render.init_gpu_resource::<update::Engine>();
        render.add_systems(ExtractSchedule, frame::extract);
        let update = update::update.after(prepare_morph_descriptors).before(write_morph_buffers);
        render.add_systems(
            Render,
            (
                update::take_meshes.in_set(RenderSystems::PrepareAssets).before(allocate_and_free_meshes),
                update.in_set(RenderSystems::PrepareResources),
            ),
        );
    }
}

/// Choose which meshes are to be morphed here, and have them extracted anew where that changes.
fn choose(
    settings: Res<DeltamorphSettings>,
    shown: Query<(&Mesh3d, Has<BevyMorphing>), With<MeshMorphWeights>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut wanted: ResMut<Wanted>,
) {
    let Wanted { rooms, refused, settings: before } = &mut *wanted;
    rooms.retain(|id, _| meshes.contains(*id));
    refused.retain(|id| meshes.contains(*id));
    let mut counts: HashMap<AssetId<Mesh>, Option<u32>> = HashMap::default();
    for (mesh, is_bevys) in &shown {
        let count = counts.entry(mesh.id()).or_insert(Some(0));
        *count = if is_bevys { None } else { count.map(|count| count + 1) };
    }
    let mut changed = vec![];
    if *before != *settings {
        changed.extend(rooms.keys().copied());
        *before = *settings;
    }
    for (id, count) in counts {
        // What is still being loaded is asked for again in the next frame.
        let Some(mesh) = meshes.get(id) else { continue };
        let mut needed = count.filter(|_| settings.enabled).unwrap_or(0);
        // None: they have gone to the render world, as all of a mesh that is for it alone.
        let has_targets = mesh.try_has_morph_targets().ok();
        if needed > 0 && has_targets != Some(false) && !mesh.asset_usage.contains(RenderAssetUsages::MAIN_WORLD) {
            if refused.insert(id) {
                warn!(
                    "deltamorph: mesh {id} stays with Bevy's own morphing: its targets leave the main world (load it \
                     with RenderAssetUsages::default())"
                );
            }
            needed = 0;
        }
        if has_targets != Some(true) {
            needed = 0;
        }
        let room = rooms.get(&id).copied().unwrap_or(0);
        let fitting = match needed {
            0 => 0,
            _ if needed <= room => room,
            // With room for more where it grows, since each time the mesh is prepared anew.
            _ => needed.max(2 * room),
        };
        if fitting != room {
            changed.push(id);
            match fitting {
                0 => rooms.remove(&id),
                _ => rooms.insert(id, fitting),
            };
        }
    }
    for id in changed {
        if let Some(mesh) = meshes.get_mut(id) {
            mesh.into_inner();
        }
    }
}
