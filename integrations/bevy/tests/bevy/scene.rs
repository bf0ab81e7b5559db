//! Lit heads in Bevy, with shadows, without a window.

use crate::heads;
use bevy::app::PluginsState;
use bevy::asset::{AssetPlugin, RenderAssetUsages, UnapprovedPathMode};
use bevy::camera::RenderTarget;
use bevy::core_pipeline::prepass::{DepthPrepass, MotionVectorPrepass};
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap};
use bevy::log::LogPlugin;
use bevy::mesh::VertexAttributeValues;
use bevy::mesh::morph::{MeshMorphWeights, MorphAttributes, MorphWeights};
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::gpu_readback::{Readback, ReadbackComplete};
use bevy::render::render_resource::{Extent3d, PollType, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::renderer::RenderDevice;
use bevy::render::settings::{Backends, InstanceFlags, WgpuSettings};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use deltamorph_bevy::deltamorph::{KeptMesh, Tolerance, WeightClip};
use deltamorph_bevy::{DeltamorphPlugin, DeltamorphSettings};
use deltamorph_head as sample;

/// Frames until a change is drawn and read back: the render world is a frame behind, and so is the GPU.
const SETTLE: usize = 5;

/// Description of a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneDesc {
    pub heads: usize,
    /// Width and height of the picture: a multiple of 64, for reading rows back.
    pub edge: u32,
    /// Use a normal map, with tangents that morph.
    pub tangents: bool,
    /// Add a prepass with motion vectors.
    pub motion: bool,
    /// Validation layers or not.
    pub flags: InstanceFlags,
}

/// A face, and the rows of weights that it plays.
pub struct Face {
    pub morphs: KeptMesh,
    pub clip: Vec<Vec<f32>>,
}

impl Face {
    /// Makes the built-in head with its clip. `sparsity`: the mean fraction of the vertices that a target moves.
    pub fn head(vertices: usize, targets: usize, sparsity: f32) -> Result<Self> {
        let head = sample::HeadDesc { vertices, targets, sparsity, ..Default::default() };
        let morphs = sample::head(&head).split()?.kept(Tolerance::default())?;
        Self::new(morphs, &sample::head_clip(&head, 120, 30.0))
    }

    /// Makes a face, and binds a clip to its targets.
    pub fn new(morphs: KeptMesh, clip: &WeightClip) -> Result<Self> {
        let names: Vec<&str> = morphs.targets.iter().map(|target| target.name.as_str()).collect();
        let clip = clip.bind(&names)?.frames().collect();
        Ok(Self { morphs, clip })
    }
}

/// A Bevy application with heads.
pub struct Scene {
    pub app: App,
    pub heads: Vec<Entity>,
    pub mesh: Handle<Mesh>,
    /// The mesh without targets.
    still: Handle<Mesh>,
    /// A row of weights per frame.
    pub clip: Vec<Vec<f32>>,
    picture: Handle<Image>,
}

/// The last picture that was read back.
#[derive(Resource, Default)]
struct Picture(Vec<u8>);

impl Scene {
    /// Makes the scene. `add` adds the caller's plugins after Bevy's.
    pub fn new(desc: &SceneDesc, face: &Face, add: impl FnOnce(&mut App)) -> Result<Self> {
        let windows = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
        let settings = WgpuSettings { backends: Some(Backends::VULKAN), instance_flags: desc.flags, ..default() };
        let render =
            RenderPlugin { render_creation: settings.into(), synchronous_pipeline_compilation: true, ..default() };
        let mut app = App::new();
        // Logging is left to the caller. Tests load files from their own folders.
        let assets = AssetPlugin { unapproved_path_mode: UnapprovedPathMode::Allow, ..default() };
        let plugins = DefaultPlugins.set(windows).set(render).set(assets);
        app.add_plugins(plugins.disable::<LogPlugin>().disable::<WinitPlugin>());
        app.add_plugins(DeltamorphPlugin).init_resource::<Picture>();
        app.insert_resource(DirectionalLightShadowMap { size: 2 * desc.edge as usize });
        add(&mut app);
        while app.plugins_state() == PluginsState::Adding {
            bevy::tasks::tick_global_task_pools_on_main_thread();
        }
        app.finish();
        app.cleanup();

        let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
        let (mut still, mut targets) = (heads::mesh(&face.morphs), heads::targets(&face.morphs));
        if desc.tangents {
            add_tangents(&mut still, &mut targets);
        }
        let mesh = meshes.add(still.clone().with_morph_targets(targets));
        let still = meshes.add(still);
        let picture = target(app.world_mut(), desc.edge);
        let mut scene = Self { app, heads: vec![], mesh, still, clip: face.clip.clone(), picture };
        scene.populate(desc, &face.morphs);
        scene.show(0);
        Ok(scene)
    }

    fn populate(&mut self, desc: &SceneDesc, morphs: &KeptMesh) {
        let world = self.app.world_mut();
        let (low, high) = morphs
            .positions
            .iter()
            .fold((morphs.positions[0], morphs.positions[0]), |(low, high), p| (low.min(*p), high.max(*p)));
        let (size, middle) = ((high - low).to_array(), ((high + low) / 2.0).to_array());
        let columns = (desc.heads as f32).sqrt().ceil() as usize;
        let rows = desc.heads.div_ceil(columns);
        let step = [size[0] * 1.25, size[1] * 1.1];
        let normal_map = desc.tangents.then(|| world.resource_mut::<Assets<Image>>().add(bumps()));
        let materials: Vec<_> = [Color::srgb(0.85, 0.65, 0.55), Color::srgb(0.5, 0.6, 0.85)]
            .into_iter()
            .map(|base_color| {
                let material = StandardMaterial {
                    base_color,
                    perceptual_roughness: 0.6,
                    normal_map_texture: normal_map.clone(),
                    ..default()
                };
                world.resource_mut::<Assets<StandardMaterial>>().add(material)
            })
            .collect();
        for i in 0..desc.heads {
            let at = [i % columns, i / columns].map(|at| at as f32);
            let place = Vec3::new(
                (at[0] - (columns - 1) as f32 / 2.0) * step[0] - middle[0],
                (at[1] - (rows - 1) as f32 / 2.0) * step[1] - middle[1],
                -middle[2],
            );
            let turn = Quat::from_rotation_y(0.3 * ((i % 3) as f32 - 1.0));
            let drawn = (
                Mesh3d(self.mesh.clone()),
                MeshMaterial3d(materials[i % 2].clone()),
                Transform::from_translation(place).with_rotation(turn),
            );
            let weights = vec![0.0; morphs.targets.len()];
            // Both ways to attach weights in Bevy.
            let head = if i % 2 == 0 {
                world.spawn((drawn, MeshMorphWeights::Value { weights })).id()
            } else {
                let Ok(weights) = MorphWeights::new(weights, None) else { continue };
                let head = world.spawn((drawn, weights)).id();
                world.entity_mut(head).insert(MeshMorphWeights::Reference(head));
                head
            };
            self.heads.push(head);
        }
        // A background for the shadows, which also fills the picture's corners.
        let extent = (columns as f32 * step[0]).max(rows as f32 * step[1]);
        let wall = world.resource_mut::<Assets<Mesh>>().add(Rectangle::new(3.0 * extent, 3.0 * extent));
        world.spawn((
            Mesh3d(wall),
            MeshMaterial3d(materials[1].clone()),
            Transform::from_xyz(0.0, 0.0, -0.7 * size[2]),
        ));
        let light = DirectionalLight { illuminance: 6_000.0, shadow_maps_enabled: true, ..default() };
        let from = Vec3::new(0.6, 0.8, 1.0) * 2.0 * extent;
        let cascades = CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 6.0 * extent, ..default() };
        world.spawn((light, cascades.build(), Transform::from_translation(from).looking_at(Vec3::ZERO, Vec3::Y)));
        let camera = world
            .spawn((
                Camera3d::default(),
                RenderTarget::Image(self.picture.clone().into()),
                Projection::from(PerspectiveProjection { near: 0.05 * extent, far: 8.0 * extent, ..default() }),
                Tonemapping::None,
                DebandDither::Disabled,
                Msaa::Off,
                AmbientLight { brightness: 200.0, ..default() },
                Transform::from_xyz(0.0, 0.0, 1.4 * extent),
            ))
            .id();
        if desc.motion {
            world.entity_mut(camera).insert((DepthPrepass, MotionVectorPrepass));
        }
    }

    /// Sets the weights of a frame of the clip, each head slightly later than the one before.
    pub fn show(&mut self, frame: usize) {
        for (i, head) in self.heads.iter().enumerate() {
            let row = &self.clip[(frame + 7 * i) % self.clip.len()];
            let mut head = self.app.world_mut().entity_mut(*head);
            if let Some(mut weights) = head.get_mut::<MorphWeights>() {
                weights.weights_mut().copy_from_slice(row);
            } else if let Some(mut weights) = head.get_mut::<MeshMorphWeights>() {
                *weights = MeshMorphWeights::Value { weights: row.clone() };
            }
        }
    }

    /// Chooses who morphs.
    pub fn morph_by_bevy(&mut self, is_bevys: bool) {
        self.app.world_mut().resource_mut::<DeltamorphSettings>().enabled = !is_bevys;
    }

    /// Shows the mesh with or without its targets.
    pub fn with_targets(&mut self, with: bool) {
        let mesh = if with { &self.mesh } else { &self.still };
        for head in &self.heads {
            self.app.world_mut().entity_mut(*head).insert(Mesh3d(mesh.clone()));
        }
    }

    /// Runs until all changes are on the screen.
    pub fn settle(&mut self) {
        (0..SETTLE).for_each(|_| self.app.update());
        self.wait();
    }

    /// Waits for the GPU.
    pub fn wait(&self) {
        let _ = self.app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
    }

    /// Returns the picture: red, green, blue and opacity of each pixel.
    pub fn picture(&mut self) -> Result<Vec<u8>> {
        self.settle();
        let take = |complete: On<ReadbackComplete>, mut picture: ResMut<Picture>| picture.0.clone_from(&complete.data);
        let reader = self.app.world_mut().spawn(Readback::texture(self.picture.clone())).observe(take).id();
        self.settle();
        self.app.world_mut().despawn(reader);
        let picture = std::mem::take(&mut self.app.world_mut().resource_mut::<Picture>().0);
        if picture.is_empty() {
            return Err("Bevy drew nothing: its log says why".into());
        }
        Ok(picture)
    }
}

/// Makes an image to draw into.
fn target(world: &mut World, edge: u32) -> Handle<Image> {
    let mut image = Image::new_target_texture(edge, edge, TextureFormat::Rgba8UnormSrgb, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    world.resource_mut::<Assets<Image>>().add(image)
}

/// Makes a normal map.
fn bumps() -> Image {
    const EDGE: u32 = 64;
    let texel = |i: u32| {
        let slope = |x: u32| (128.0 + 60.0 * (x as f32 * std::f32::consts::TAU / 16.0).sin()) as u8;
        [slope(i % EDGE), slope(i / EDGE), 230, 255]
    };
    let texels: Vec<u8> = (0..EDGE * EDGE).flat_map(texel).collect();
    let size = Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: 1 };
    Image::new(size, TextureDimension::D2, texels, TextureFormat::Rgba8Unorm, RenderAssetUsages::default())
}

/// Adds tangents across the normals, and others for each target: not those of a surface, but as different.
fn add_tangents(mesh: &mut Mesh, targets: &mut [MorphAttributes]) {
    let Some(VertexAttributeValues::Float32x3(normals)) = mesh.attribute(Mesh::ATTRIBUTE_NORMAL) else { return };
    let across = |n: &[f32; 3]| {
        let t = Vec3::Y.cross(Vec3::from(*n)).try_normalize().unwrap_or(Vec3::X);
        [t.x, t.y, t.z, 1.0]
    };
    let tangents: Vec<_> = normals.iter().map(across).collect();
    mesh.insert_attribute(Mesh::ATTRIBUTE_TANGENT, tangents);
    for target in targets {
        let normal = target.normal;
        target.tangent = Vec3::new(normal.z, 2.0 * normal.x, normal.y);
    }
}

/// Returns the difference of two pictures: the largest difference of a channel, in units of 1/255, and the fraction of
/// pixels that differ by more than `allowed`.
pub fn difference(a: &[u8], b: &[u8], allowed: u8) -> (u8, f64) {
    let pixels = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0);
    let largest = pixels.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0));
    let largest: Vec<u8> = largest.collect();
    let beyond = largest.iter().filter(|d| **d > allowed).count();
    (largest.iter().copied().max().unwrap_or(0), beyond as f64 / largest.len().max(1) as f64)
}
