//! The `texture` path (Galanakis, "Texture-based Blendshapes in DX9"): deltas in textures, blended into displacement
//! textures, which draws fetch.
//!
//! Each target is a few rectangles of texels (`texels`). A pass draws those of the targets that it applies, and
//! blending adds coefficient · delta to the displacement textures of an instance, positions and normals at once
//! (`passes`): weights after clearing, or delta weights on top of the existing displacements. Draws add the texel of
//! the vertex to the base pose (`draws`). Further streams of a mesh have their own textures, two for each group:
//! texture coordinates, for example, which targets move when they stretch the skin.
//!
//! Deltas are loaded as packed: float32, or 16-bit integers times the coefficient of their step, in place of the
//! article's half floats, which are as large and keep fewer bits. Sums are float32: they drift like those of the other
//! paths with float32 poses, and are cleared when rebuilding takes no more targets.

mod blending;
mod draws;
mod images;
mod passes;
mod texels;

#[cfg(test)]
mod tests;

use crate::draws::one_pass;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::pack::PackedMesh;
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::steps::{Access, Resource, Source, Stage, Steps, Use, Work};
use crate::update::dense::DensePlanner;
use crate::update::technique::{Context, PoseDraws, Technique, UpdateId};
use crate::{check_storage, private};
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph_headless::{Image, ImageDesc};
use draws::TextureDraws;
use passes::BlendPasses;
use std::ops::Range;
use std::sync::Arc;
use texels::{DeltaTexels, RECTANGLE_WORDS};

/// Bytes of a texel of both displacement textures.
const DISPLACEMENT: u64 = 32;

/// A pass: rectangles and deltas are read, displacements blended.
const BLEND: &[Use] = &[
    Use::new(Resource::Asset, Stage::VertexShader, Access::ShaderRead),
    Use::new(Resource::Asset, Stage::FragmentShader, Access::ShaderRead),
    Use::new(Resource::Poses, Stage::ColourOutput, Access::Blend),
];
/// Reads by draws, for all consumers.
const FETCH: &[Use] = &[Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderRead)];

/// The delta textures of a group, and their layout on the host.
struct Textures {
    /// First rectangle and first texel of the deltas of each target, then their total numbers.
    first: Vec<[u32; 2]>,
    /// Columns and rows of the displacement textures.
    size: [u32; 2],
    /// Bytes of a texel of both delta textures.
    delta: u64,
    /// The textures of both triples, each with a view.
    images: Vec<Image>,
}

impl Textures {
    fn new(baked: &DeltaTexels, images: Vec<Image>) -> Self {
        let first_texel = |&first: &u32| match baked.rectangles.get(first as usize) {
            Some(rectangle) => rectangle.first,
            None => baked.covered() as u32,
        };
        let first = baked.first.iter().map(|first| [*first, first_texel(first)]).collect();
        Self { first, size: baked.size, delta: if baked.is_integer { 16 } else { 32 }, images }
    }

    fn of(mesh: &MeshBuffers) -> &Self {
        private(mesh)
    }

    fn range(&self, target: u32, which: usize) -> Range<u32> {
        self.first[target as usize][which]..self.first[target as usize + 1][which]
    }

    /// Returns the rectangles of a target.
    fn rectangles(&self, target: u32) -> Range<u32> {
        self.range(target, 0)
    }

    /// Returns the number of texels drawn for a target, including unmoved ones within its rectangles.
    fn texels(&self, target: u32) -> u32 {
        self.range(target, 1).len() as u32
    }

    /// Returns the offset in words of the texels of vertices, which follow all rectangles.
    fn texels_at(&self) -> u32 {
        self.first.last().map_or(0, |[rectangles, _]| *rectangles) * RECTANGLE_WORDS as u32
    }
}

/// Returns the rectangles, followed by the texels of vertices.
fn words_of(mesh: &MeshBuffers) -> BufferRange {
    let words = u64::from(Textures::of(mesh).texels_at()) + mesh.layout.padded_vertices() as u64;
    BufferRange::new(mesh.deltas.raw, 0, 4 * words)
}

/// Creates and fills the buffers of a mesh, which was checked for the path, with two textures of deltas for each group:
/// 32 bytes for each vertex that a target moves (float32), or 16 (snorm16). Records the copies to the textures, and the
/// changes of their layouts.
///
/// # Errors
/// Textures larger than the device's images; more rectangles than a descriptor covers; out of memory. Nothing is
/// recorded then.
///
/// # Safety
/// The conditions of [`UploadFor`](deltamorph::internals::update::technique::UploadFor).
pub unsafe fn upload(
    device: &Arc<Device>,
    cmd: vk::CommandBuffer,
    mesh: &PackedMesh,
) -> Result<(Vec<MeshBuffers>, Vec<Upload>)> {
    let (mut groups, mut uploads, mut copies) = (vec![], vec![], vec![]);
    for group in mesh.groups() {
        let layout = group.layout();
        let baked = DeltaTexels::bake(group, device.caps.max_image_side)?;
        let words = baked.words(layout.padded_vertices());
        check_storage(device, layout, "its rectangles and texels take", &words)?;
        let format = if baked.is_integer { vk::Format::R16G16B16A16_SINT } else { vk::Format::R32G32B32A32_SFLOAT };
        let mut images = vec![];
        for (what, second) in [("first", false), ("second", true)] {
            let name = format!("deltamorph deltas of the {what} triple of mesh '{}'", layout.name);
            let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
            let samples = vk::SampleCountFlags::TYPE_1;
            let desc = ImageDesc { size: baked.image, layers: 1, format, samples, usage };
            let mut image = Image::new(device, &name, &desc)?;
            image.view(0..1, false)?;
            let staging = images::staging(device, &baked.bytes(second))?;
            copies.push(((image.raw, baked.image), staging.raw));
            uploads.push(Upload::new(staging, vec![]));
            images.push(image);
        }
        let private = Box::new(Textures::new(&baked, images));
        let (buffers, upload) = MeshBuffers::new(device, layout.clone(), group.base(), &words, Some(private))?;
        groups.push(buffers);
        uploads.push(upload);
    }
    for (image, staging) in copies {
        // SAFETY: the caller's obligations; the image is new, and the staging memory has all its texels.
        unsafe { images::record_filling(device, cmd, image, staging) };
    }
    Ok((groups, uploads))
}

/// The resources of a group of the mesh.
struct Group {
    mesh: Arc<MeshBuffers>,
    passes: BlendPasses,
    draws: TextureDraws,
}

/// A crowd with displacement textures per instance.
pub struct TextureTechnique {
    planner: DensePlanner,
    groups: Vec<Group>,
}

impl TextureTechnique {
    pub fn new(context: Context<'_>) -> Result<Self> {
        let group = |context: Context<'_>| {
            let passes = BlendPasses::new(context)?;
            let draws = TextureDraws::new(context, passes.displacements())?;
            Ok(Group { mesh: context.mesh.clone(), passes, draws })
        };
        Ok(Self { planner: one_pass(context.desc)?, groups: context.groups().map(group).collect::<Result<_>>()? })
    }
}

impl InstanceState for TextureTechnique {}

impl Technique for TextureTechnique {
    fn state(&mut self) -> &mut dyn InstanceState {
        self
    }

    /// Bytes of an update: for each coefficient the texels of its deltas, and as many texels of displacements loaded
    /// and stored; for each rebuilt instance all texels cleared. In the floor, each displacement texel is loaded and
    /// stored at most once. Draws are not counted, as with pose buffers.
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        self.planner.fill(self.groups.len(), BLEND, steps);
        if !steps.is_empty() {
            steps.step(FETCH);
        }
        let mut stats = UpdateStats::default();
        for plan in self.planner.plans().iter().filter(|plan| !plan.passes.is_empty()) {
            stats.coefficients += plan.coefficients.len();
            stats.passes += 1;
            stats.rebuilt += usize::from(plan.rebuilt);
            for mesh in self.groups.iter().map(|group| &group.mesh) {
                let textures = Textures::of(mesh);
                let all = textures.size.map(u64::from).iter().product::<u64>();
                let delta = textures.delta;
                let texels: u64 = plan.coefficients.iter().map(|c| u64::from(textures.texels(c.target))).sum();
                let cleared = if plan.rebuilt { all * DISPLACEMENT } else { 0 };
                stats.bytes_moved += cleared + texels * (delta + 2 * DISPLACEMENT);
                stats.bytes_floor += texels * delta + texels.min(all) * 2 * DISPLACEMENT;
            }
        }
        Ok(stats)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work) {
        let (cleared, coefficients) = (work.source == Source::Base, self.planner.coefficients(work));
        let passes = &self.groups[work.group as usize].passes;
        // SAFETY: the caller's obligations; the coefficients are of targets of the mesh.
        unsafe { passes.record(cmd, work.instance, cleared, coefficients) };
    }

    fn draws(&self, group: usize) -> Option<&dyn PoseDraws> {
        self.groups.get(group).map(|group| &group.draws as &dyn PoseDraws)
    }
}
