//! Targets of post-morph passes, and uploads for them.

use super::MorphEngine;
use super::base::Crowd;
use crate::after::{After, GpuNormals, GpuSkin, OutputTarget, SkinDesc, TargetContext};
use crate::error::Result;
use crate::pack::PackedMesh;
use crate::plan::steps::PostMorphPass;
use ash::vk;

impl MorphEngine {
    /// Creates a buffer of the joints and weights of a mesh's vertices, and records its upload: once per mesh, for any
    /// number of crowds and instances. Takes 24 bytes per vertex for four influences, or 48 for eight. (Weights are
    /// float32: 16-bit weights would move vertices by 1e-5 of the diagonal.)
    ///
    /// Records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that skins, and calling
    /// [`GpuSkin::release_staging`] once it has finished.
    ///
    /// # Errors
    /// Not 4 or 8 influences, or not 1 to 65,536 joints; arrays of the wrong length; a weight that is negative or not
    /// finite; a vertex whose weights sum to 0; a joint out of range; a mesh without vertices, or beyond the device's
    /// storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on any queue.
    /// - It runs exactly once, before any update that skins by the returned value.
    /// - The staging memory is released only when `cmd` has finished, or if it never runs.
    /// - The returned value, and crowds with targets of it, are dropped only when the device no longer uses them.
    pub unsafe fn upload_skin(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &SkinDesc<'_>,
    ) -> Result<GpuSkin> {
        // SAFETY: the caller's obligations.
        unsafe { GpuSkin::upload(&self.device, cmd, mesh, desc) }
    }

    /// Creates a buffer of the triangles around each vertex of a mesh, from its [faces](PackedMesh::faces) and
    /// [welds](PackedMesh::welds), and records its upload: once per mesh, for any number of crowds and instances. A
    /// polygon's area counts at all its corners, as on import; welded vertices get bit-equal normals.
    ///
    /// Takes 36 bytes per vertex and 8 per corner of a triangle (8 × (n - 2) per corner of an n-gon); on the host, 4
    /// bytes per pair of neighbouring pieces of 32 vertices.
    ///
    /// Records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that recomputes normals, and calling
    /// [`GpuNormals::release_staging`] once it has finished.
    ///
    /// # Errors
    /// Faces or welds that were changed and do not match the mesh; a mesh without vertices, or beyond the device's
    /// storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// Those of [`upload_skin`](Self::upload_skin).
    pub unsafe fn upload_normals(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuNormals> {
        // SAFETY: the caller's obligations.
        unsafe { GpuNormals::upload(&self.device, cmd, mesh) }
    }

    /// Writes streams of an instance's pose into vertices of the application, from the next recorded update on, skinned
    /// if the target names [joints](OutputTarget::joints): for any pose format, any path with poses, and both kinds of
    /// crowd. Draws, ray tracing and picking then read the application's buffers. `None` removes the target. See
    /// [`after`](crate::after) for what is written when.
    ///
    /// ```no_run
    /// # use deltamorph::after::{OutputStream, OutputTarget};
    /// # use deltamorph::{ash::vk, Crowd, MorphEngine, Result, Semantic};
    /// /// Position, normal and texture coordinates in vertices of 32 bytes, in the order of the mesh.
    /// fn morph_vertices(engine: &MorphEngine, crowd: &mut Crowd, vertices: vk::Buffer) -> Result<()> {
    ///     let of = |semantic, offset| OutputStream { offset, stride: 32, ..OutputStream::new(semantic, vertices) };
    ///     let streams = [of(Semantic::Position, 0), of(Semantic::Normal, 12)];
    ///     // SAFETY: the buffer is a storage buffer with room for all vertices, and outlives the crowd.
    ///     unsafe { engine.set_output_target(crowd, 0, Some(&OutputTarget::new(&streams))) }
    /// }
    /// ```
    ///
    /// All vertices are written after joints moved ([`Crowd::set_joints`]). To build acceleration structures from the
    /// output, add [`ACCELERATION_STRUCTURES`](crate::Consumers::ACCELERATION_STRUCTURES) to the consumers.
    ///
    /// The caller is responsible for: barriers of its own if it writes the buffers itself, or reads them in stages that
    /// the consumers do not include; joints that are written, and visible to compute shader reads, when an update that
    /// skins runs.
    ///
    /// # Errors
    /// An instance out of range or removed; a crowd of another engine; a direct path, which has no poses; a stream that
    /// the mesh does not have; an invalid format, offset or stride; skinned tangents; a range beyond the device's
    /// storage range, or beyond the end of the buffer as far as `vkGetBufferMemoryRequirements` tells; more pieces of
    /// 32 vertices, or in the order of the mesh more vertices, than a texel buffer of the device holds (at least
    /// 65,536); a skin of another engine or mesh, or of another packing of the mesh; joints beyond the end of their
    /// buffer. Nothing changes then.
    ///
    /// # Safety
    /// - The buffers belong to the engine's device and have storage buffer usage. They are large enough for everything
    ///   that is read and written, and live until the target is replaced or removed and all updates recorded before
    ///   that have finished.
    /// - Joints stay unchanged from the update they were set for until others are [set](Crowd::set_joints) and all
    ///   updates recorded before that have finished: an update that changes blocks reads them again.
    /// - All updates of the crowd recorded with an earlier target of the instance have finished.
    pub unsafe fn set_output_target(
        &self,
        crowd: &mut Crowd,
        instance: u32,
        target: Option<&OutputTarget<'_>>,
    ) -> Result<()> {
        self.set_target(crowd, instance, PostMorphPass::Output, target, After::set_output)
    }

    /// Computes the normals of an instance's pose from its morphed surface into vertices of the application, from the
    /// next recorded update on: area-weighted as on import, equal for welded vertices, of unit length. The target has
    /// one stream, [`Semantic::Normal`](crate::Semantic::Normal), and no joints; `None` removes it. See
    /// [`after`](crate::after) for what is written when.
    ///
    /// A vertex whose triangles all have zero area gets its base normal. Pieces of 32 vertices that share a triangle
    /// with changed ones are written too.
    ///
    /// # Errors
    /// Those of [`set_output_target`](Self::set_output_target); a surface of another engine or mesh, or of another
    /// packing of the mesh. Nothing changes then.
    ///
    /// # Safety
    /// Those of [`set_output_target`](Self::set_output_target).
    pub unsafe fn set_normals_target(
        &self,
        crowd: &mut Crowd,
        instance: u32,
        target: Option<(&GpuNormals, &OutputTarget<'_>)>,
    ) -> Result<()> {
        self.set_target(crowd, instance, PostMorphPass::Normals, target, After::set_normals)
    }

    fn set_target<T>(
        &self,
        crowd: &mut Crowd,
        instance: u32,
        kind: PostMorphPass,
        target: Option<T>,
        set: impl FnOnce(&mut After, &TargetContext<'_>, T) -> Result<()>,
    ) -> Result<()> {
        crowd.check_device(&self.device)?;
        crowd.instances.check(instance)?;
        crowd.check_has_poses()?;
        let Crowd { after, groups, steps, desc, .. } = crowd;
        let (device, kernels, frames) = (&self.device, &self.kernels, desc.frames_in_flight);
        match target {
            Some(target) => set(after, &TargetContext { device, kernels, groups, frames, instance }, target)?,
            None => after.unset(kind, instance),
        }
        steps.read_besides(after.outputs());
        Ok(())
    }
}
