//! Morph targets of [`deltamorph`] in Bevy: one plugin, without other changes to the application.
//!
//! ```no_run
//! # use bevy::prelude::*;
//! # use deltamorph_bevy::DeltamorphPlugin;
//! App::new().add_plugins(DefaultPlugins).add_plugins(DeltamorphPlugin).run();
//! ```
//!
//! deltamorph then morphs entities with a [`Mesh3d`] and Bevy's own [`MeshMorphWeights`], as the glTF loader makes
//! them, by the weights that Bevy's components name ([`MorphWeights`]). Materials, shadows, prepasses, motion vectors
//! and skins remain Bevy's. [`DeltamorphSettings`] switches all meshes to Bevy's own morphing and back,
//! [`BevyMorphing`] a single mesh.
//!
//! # How
//! Bevy's vertex shaders add up all targets of a mesh, from a storage buffer with 48 bytes for each vertex of each
//! target, again in each pass. This plugin replaces the targets of the mesh by two for each entity: once a frame, for
//! weights that have changed, deltamorph computes the displacement of all vertices and writes it into one of the two.
//! Bevy's shaders are unchanged, and get weight 1 for that target; the other one holds the previous displacement, and
//! gets weight 1 where motion vectors are computed. If one entity alone shows a mesh, and no camera has motion vectors,
//! deltamorph writes the pose over the vertices of the mesh, and the shaders get no target at all.
//!
//! All of this happens in the render world: components and assets of the application are only read. An
//! [`AssetEvent::Modified`](bevy::asset::AssetEvent) makes the render world extract a mesh again. So, while a mesh is
//! morphed here, its original targets take no memory of the GPU. The one component that is written is
//! [`Aabb`](bevy::camera::primitives::Aabb), by which Bevy culls: it is a box around the pose, except of entities with
//! [`NoAutoAabb`](bevy::camera::visibility::NoAutoAabb).
//!
//! # What stays with Bevy
//! Devices that are not on Vulkan, and meshes that deltamorph does not support. The log says which, and why.

mod bounds;
mod frame;
mod mesh;
mod targets;
mod update;
mod vertices;

pub use deltamorph::{self, DeltaFormat};

use bevy::asset::{AssetEventSystems, RenderAssetUsages};
use bevy::camera::visibility::VisibilitySystems;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::pbr::{prepare_morph_descriptors, write_morph_buffers};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::render::mesh::allocator::{MeshAllocatorSettings, allocate_and_free_meshes};
use bevy::render::render_resource::BufferUsages;
use bevy::render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems};
use deltamorph::WeightBounds;
use std::sync::Arc;

/// Morphs meshes with deltamorph, as the [crate's documentation](crate) describes.
#[derive(Clone, Copy, Debug, Default)]
pub struct DeltamorphPlugin;

/// Settings of the morphing. May be changed at any time: meshes are then prepared again, which takes as long as at
/// loading.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct DeltamorphSettings {
    /// `false`: Bevy morphs all meshes itself.
    pub enabled: bool,
    /// The delta format in which targets are stored: one of [`DeltaFormat::BLOCKS`].
    pub format: DeltaFormat,
    /// Largest absolute weight (above 0, up to 255): entities with a larger one keep their current shape. A smaller
    /// limit makes the grid of displacements finer.
    pub weight_max: f32,
    /// Largest error of a normal or tangent by one target at weight 1, in degrees (above 0; entries of
    /// [`DeltaFormat::Fast`] may exceed it). Errors of targets add up, so a face with many
    /// large weights may show them: a smaller one takes more memory.
    pub normal_error_degrees: f32,
}

impl Default for DeltamorphSettings {
    /// Enabled, in the format `fast`, weights up to 4, normals within 0.5°.
    fn default() -> Self {
        Self { enabled: true, format: DeltaFormat::Fast, weight_max: 4.0, normal_error_degrees: 0.5 }
    }
}

/// Marks an entity: Bevy itself morphs its mesh, for all entities that show the same [`Mesh`].
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct BevyMorphing;

/// The meshes to morph here.
#[derive(Resource, Default)]
struct Wanted {
    /// The number of entities that each mesh has room for.
    rooms: HashMap<AssetId<Mesh>, u32>,
    /// The bounds of poses, from the render world, which packs the meshes.
    bounds: HashMap<AssetId<Mesh>, Arc<WeightBounds>>,
    /// Meshes that stay with Bevy and were reported to the log.
    refused: HashSet<AssetId<Mesh>>,
    settings: DeltamorphSettings,
}

impl Plugin for DeltamorphPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DeltamorphSettings>().init_resource::<Wanted>();
        let boxes = bounds::update.after(VisibilitySystems::CalculateBounds).before(VisibilitySystems::CheckVisibility);
        // Runs before the events of this frame are sent, so that the render world sees the change in the same frame.
        app.add_systems(PostUpdate, (choose.before(AssetEventSystems), boxes));
        let Some(render) = app.get_sub_app_mut(RenderApp) else { return };
        // Allows poses to be written over vertices.
        let mut allocator = render.world_mut().get_resource_or_init::<MeshAllocatorSettings>();
        allocator.extra_buffer_usages |= BufferUsages::STORAGE;
        render.init_resource::<frame::Frame>();
        render.init_gpu_resource::<update::Engine>();
        render.add_systems(ExtractSchedule, (frame::extract, bounds::share));
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

/// Chooses the meshes to morph here, and has them extracted again if that changes.
fn choose(
    settings: Res<DeltamorphSettings>,
    shown: Query<(&Mesh3d, Has<BevyMorphing>), With<MeshMorphWeights>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut wanted: ResMut<Wanted>,
) {
    let Wanted { rooms, bounds, refused, settings: before } = &mut *wanted;
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
        // A mesh that is still loading is checked again in the next frame.
        let Some(mesh) = meshes.get(id) else { continue };
        let mut needed = count.filter(|_| settings.enabled).unwrap_or(0);
        // `None`: the targets have moved to the render world, as with all data of a mesh that is only for it.
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
            // Doubles the room when it grows, since each growth prepares the mesh again.
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
    bounds.retain(|id, _| rooms.contains_key(id));
    for id in changed {
        if let Some(mesh) = meshes.get_mut(id) {
            mesh.into_inner();
        }
    }
}
