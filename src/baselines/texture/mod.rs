//! The `texture` path (Galanakis, "Texture-based Blendshapes in DX9"): deltas in textures, blended into textures of
//! displacements, which draws fetch.
//!
//! Each target is a few rectangles of texels (`texels`). A pass draws those of the targets that it applies, and blending
//! adds coefficient · delta to the displacement textures of an instance, positions and normals at once (`passes`): weights
//! after clearing, or delta weights on top of what is there. Draws add to the base pose what the texel of the vertex holds
//! (`draws`). Further streams of a mesh have textures of their own, two for each group: texture coordinates, for example, which
//! targets move where they stretch the skin.
//!
//! Deltas are loaded as packed: float32, or 16-bit integers times the coefficient of their step. Where every float32 delta
//! is exactly a half float, as the article has them and files of half floats are read (`file`), textures hold half floats:
//! half of the bytes, and the same numbers. Nothing is rounded to them here, since the integers are as small and keep more
//! bits. Sums are float32: they drift as those of the other paths with float32 poses do, and are wiped where rebuilding
//! takes no more targets.

#[cfg(feature = "ktx2")]
mod container;
mod draws;
#[cfg(feature = "ktx2")]
pub mod file;
mod half;
mod passes;
mod texels;

#[cfg(test)]
mod tests;

use super::draws::one_pass;
use crate::engine::{GpuMesh, MorphEngine};
use crate::error::Result;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::pack::{PackedGroup, PackedMesh};
use crate::plan::instances::Instances;
use crate::plan::steps::{Access, Resource, Source, Stage, Steps, Use, Work};
use crate::plan::{UpdatePath, UpdateStats};
use crate::update::dense::DensePlanner;
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk;
use draws::TextureDraws;
use passes::BlendPasses;
use std::ops::Range;
use std::sync::Arc;
use texels::{DeltaTexels, RECTANGLE_WORDS, Texel};

/// Bytes of a texel of both displacement textures.
const DISPLACEMENT: u64 = 32;

/// A pass: rectangles and deltas are read, displacements blended.
const BLEND: &[Use] = &[
    Use::new(Resource::Asset, Stage::VertexShader, Access::ShaderRead),
    Use::new(Resource::Asset, Stage::FragmentShader, Access::ShaderRead),
    Use::new(Resource::Poses, Stage::ColourOutput, Access::Blend),
];
/// What draws fetch, whoever else reads.
const FETCH: &[Use] = &[Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderRead)];

/// What the host knows of the textures of a group: what [`MeshBuffers::private`] holds.
#[derive(Clone, Copy)]
struct Textures<'a>(&'a [u32]);

impl<'a> Textures<'a> {
    /// First rectangle and first texel of the deltas of each target, and the numbers of all; then the size of the
    /// displacement textures, and the bytes of a delta.
    fn words(baked: &DeltaTexels, texel: Texel) -> Vec<u32> {
        let first_texel = |&first: &u32| match baked.rectangles.get(first as usize) {
            Some(rectangle) => rectangle.first,
            None => baked.covered() as u32,
        };
        baked
            .first
            .iter()
            .flat_map(|first| [*first, first_texel(first)])
            .chain(baked.size)
            .chain([2 * texel.bytes()])
            .collect()
    }

    fn of(mesh: &'a MeshBuffers) -> Self {
        Self(&mesh.private)
    }

    fn ends(self, target: u32, which: usize) -> Range<u32> {
        let at = 2 * target as usize + which;
        self.0[at]..self.0[at + 2]
    }

    /// The rectangles of a target.
    fn rectangles(self, target: u32) -> Range<u32> {
        self.ends(target, 0)
    }

    /// Texels that a target moves, with those between them.
    fn texels(self, target: u32) -> u32 {
        self.ends(target, 1).len() as u32
    }

    /// Texels of a row, and rows, of the displacement textures.
    fn size(self) -> [u32; 2] {
        [self.0[self.0.len() - 3], self.0[self.0.len() - 2]]
    }

    /// Bytes of a texel of both delta textures.
    fn delta(self) -> u64 {
        self.0[self.0.len() - 1].into()
    }

    /// Where the texels of vertices begin, behind all rectangles, in words.
    fn texels_at(self) -> u32 {
        self.0[self.0.len() - 5] * RECTANGLE_WORDS as u32
    }
}

/// The rectangles, and the texels of vertices behind them.
fn words_of(mesh: &MeshBuffers) -> BufferRange {
    let words = u64::from(Textures::of(mesh).texels_at()) + mesh.layout.padded_vertices() as u64;
    BufferRange::new(mesh.deltas.raw, 0, 4 * words)
}

impl MorphEngine {
    /// As [`upload`](Self::upload), for crowds on the path `texture`, which reads deltas from two textures: 32 bytes for
    /// each vertex that a target moves (float32), or 16 (snorm16, and float32 where every delta of a group of streams is
    /// exactly a half float), whatever [`mesh_bytes`](Self::mesh_bytes) says. The layouts of the textures are changed as part
    /// of the copies.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); a format other than `float32` and `snorm16`; textures larger than the device's images;
    /// a device that cannot blend float32.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    pub unsafe fn upload_texture(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        let (path, layout, caps) = (UpdatePath::Texture, mesh.layout(), &self.device.caps);
        caps.check_path(path)?;
        path.check_format(layout.format)?;
        self.check_not_empty(layout)?;
        let (mut groups, mut uploads) = (vec![], vec![]);
        for group in mesh.groups() {
            let (buffers, of_group) = self.texture_buffers(group)?;
            groups.push(buffers);
            uploads.extend(of_group);
        }
        // SAFETY: the caller's obligations.
        Ok(unsafe { self.upload_buffers(cmd, groups, uploads) })
    }

    /// The buffers and delta textures of a group, and what fills them.
    fn texture_buffers(&self, group: &PackedGroup) -> Result<(MeshBuffers, Vec<Upload>)> {
        let layout = group.layout();
        let baked = DeltaTexels::bake(group, self.device.caps.max_image_side)?;
        let (words, texel) = (baked.words(layout.padded_vertices()), baked.texel());
        self.check_storage(layout, "its rectangles and texels take", &words)?;
        let private = Textures::words(&baked, texel);
        let (mut buffers, upload) = MeshBuffers::new(&self.device, layout.clone(), group.base(), &words, private)?;
        let format = match texel {
            Texel::Integers => vk::Format::R16G16B16A16_SINT,
            Texel::Half => vk::Format::R16G16B16A16_SFLOAT,
            Texel::Single => vk::Format::R32G32B32A32_SFLOAT,
        };
        let mut uploads = vec![upload];
        for (what, second) in [("first", false), ("second", true)] {
            let name = format!("deltamorph deltas of the {what} triple of mesh '{}'", layout.name);
            uploads.push(buffers.add_image(&self.device, &name, format, baked.image, &baked.bytes(second, texel))?);
        }
        Ok((buffers, uploads))
    }
}

/// What a group of the mesh takes.
struct Group {
    mesh: Arc<MeshBuffers>,
    passes: BlendPasses,
    draws: TextureDraws,
}

/// A crowd with displacement textures for each instance.
pub(crate) struct TextureTechnique {
    planner: DensePlanner,
    groups: Vec<Group>,
}

impl TextureTechnique {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let group = |context: Context<'_>| {
            let passes = BlendPasses::new(context)?;
            let draws = TextureDraws::new(context, passes.displacements())?;
            Ok(Group { mesh: context.mesh.clone(), passes, draws })
        };
        Ok(Self { planner: one_pass(context.desc)?, groups: context.groups().map(group).collect::<Result<_>>()? })
    }

    /// The draws of a group.
    pub(super) fn draws(&self, group: usize) -> Option<&TextureDraws> {
        self.groups.get(group).map(|group| &group.draws)
    }
}

impl Technique for TextureTechnique {
    /// Bytes of an update: of each coefficient the texels of its deltas, and as many texels of displacements loaded and
    /// stored; of each rebuilt instance all texels cleared. The floor has each texel of displacements loaded and stored
    /// once at most. Draws are not counted, as they are not where there are pose buffers.
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
                let all = textures.size().map(u64::from).iter().product::<u64>();
                let delta = textures.delta();
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

    fn has_poses(&self) -> bool {
        false
    }

    /// The displacement textures are the pose of an instance, whatever its slots.
    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        use crate::plan::hazards::{Accesses, Memory};
        let of = |work: &Work| {
            let pose = Memory::Pose { instance: work.instance, slot: 0 };
            let uses = vec![
                Use::new(Memory::Deltas, Stage::VertexShader, Access::ShaderRead),
                Use::new(Memory::Deltas, Stage::FragmentShader, Access::ShaderRead),
                Use::new(pose, Stage::ColourOutput, Access::Blend),
            ];
            Accesses { group: work.group, uses, ..Accesses::default() }
        };
        works.iter().map(of).collect()
    }
}
