//! What hosts ask for after the pose: each step by its name.

use super::MorphEngine;
use super::base::AnyCrowd;
use crate::after::bounds::TightBounds;
use crate::after::normals::Recomputed;
use crate::after::skin::Skin;
use crate::after::{
    BoundsTarget, Decode, DecodeTarget, GpuNormals, GpuSkin, NormalsDesc, NormalsTarget, SkinDesc, SkinTarget,
};
use crate::error::Result;
use crate::pack::PackedMesh;
use ash::vk;

impl MorphEngine {
    /// Have positions of an instance written as float32 into a buffer of the host's own, from the next recorded update on:
    /// for ray tracing, picking, or a shader that cannot decode poses. `None`: no longer. An instance has one target.
    ///
    /// The step follows those of the update, and is recorded with them: it writes the blocks that the update changed (dense
    /// paths and animated crowds: all of a pose that changed, or may have), and nothing where none did. Everything is written
    /// first, and after the instance was hidden, or an update that wrote the target was discarded. What is written is ready
    /// for the [consumers](crate::CrowdDesc::consumers) of the crowd, and waits for their reads, as with poses; for builds of
    /// acceleration structures name [`ACCELERATION_STRUCTURES`](crate::Consumers::ACCELERATION_STRUCTURES). An instance that
    /// is removed loses its target.
    ///
    /// The caller is responsible for: barriers of its own, where it writes the buffer itself, or stages read it that the
    /// consumers do not name.
    ///
    /// # Errors
    /// An instance out of range or removed; a crowd that another engine made; a direct path, which has no poses; an offset or
    /// stride that does not fit; more than the device's storage range; a buffer that is too small, as far as
    /// `vkGetBufferMemoryRequirements` tells. Nothing changes then.
    ///
    /// # Safety
    /// - The buffer is one of the engine's device, made for use as storage buffer. It is large enough for all that is
    ///   written, and lives until the crowd has another target, or none, and the updates recorded before have finished.
    /// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
    pub unsafe fn set_decode_target(
        &self,
        crowd: &mut (impl AnyCrowd + ?Sized),
        instance: u32,
        target: Option<&DecodeTarget>,
    ) -> Result<()> {
        let crowd = crowd.base_mut();
        crowd.check_device(&self.device)?;
        crowd.set_after(&self.kernels, instance, |after, place| Decode::set(after, place, target))
    }

    /// Create a buffer of the joints and weights of a mesh's vertices, and record its upload: once for each mesh, whatever
    /// the number of crowds and instances. It takes 24 bytes a vertex for the base pose, and as many again for four
    /// influences, or 48 for eight; weights stay float32, since 16 bits of them would move vertices by 1e-5 of the diagonal.
    ///
    /// This records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that skins, and calling
    /// [`GpuSkin::release_staging`] once it has run.
    ///
    /// # Errors
    /// Other than 4 or 8 influences, or 1 to 65,536 joints; arrays of another length; a weight that is negative or no
    /// number; a vertex whose weights sum to 0, or one that names a joint that there is not; a mesh without vertices, or one
    /// that exceeds the device's storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on any queue.
    /// - It runs before any update that skins by the value returned, exactly once.
    /// - The value returned is dropped only when the device no longer uses it; so are the crowds that have targets of it.
    pub unsafe fn upload_skin(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &SkinDesc<'_>,
    ) -> Result<GpuSkin> {
        // SAFETY: the caller's obligations.
        unsafe { GpuSkin::upload(&self.device, cmd, mesh, desc) }
    }

    /// Have an instance skinned into a buffer of the host's own, from the next recorded update on, from poses of any format
    /// and of either kind of crowd. `None`: no longer. An instance has one target.
    ///
    /// The step follows those of the update, and is recorded with them. Where joints moved
    /// ([`Crowd::set_joints`](crate::Crowd::set_joints)), it writes all vertices; where only weights changed, the blocks
    /// that the update changed (dense paths and animated crowds: all); and nothing where nothing changed. Everything is
    /// written first, and after the instance was hidden, or an update that wrote the target was discarded. What is written
    /// is ready for the [consumers](crate::Consumers) of the crowd, and waits for their reads, as with poses. An instance
    /// that is removed loses its target.
    ///
    /// The caller is responsible for: joints that are written, and visible to reads of compute shaders, when an update runs
    /// that skins; barriers of its own, where it writes the buffers itself, or stages read them that the consumers do not
    /// name.
    ///
    /// # Errors
    /// An instance out of range or removed; a crowd or skin of another engine; a skin of another mesh, or of one packed
    /// otherwise; a direct path, which has no poses; an offset or stride that does not fit; joints that reach beyond their
    /// buffer; more than the device's storage range, or than its texel buffers have room for pieces of 32 vertices (on any
    /// device 65,536 of them); a buffer that is too small, as far as `vkGetBufferMemoryRequirements` tells. Nothing changes
    /// then.
    ///
    /// # Safety
    /// - The buffers are of the engine's device, made for use as storage buffers. They are large enough for all that is
    ///   read and written, and live until the crowd has another target, or none, and the updates recorded before have
    ///   finished.
    /// - Joints stay as they are from the update that they were set for until another [`set_joints`] of the instance, and
    ///   the updates recorded before have finished: an update that changes blocks reads the joints again.
    /// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
    ///
    /// [`set_joints`]: crate::Crowd::set_joints
    pub unsafe fn set_skin_target(
        &self,
        crowd: &mut (impl AnyCrowd + ?Sized),
        instance: u32,
        target: Option<(&GpuSkin, &SkinTarget)>,
    ) -> Result<()> {
        let crowd = crowd.base_mut();
        crowd.check_device(&self.device)?;
        crowd.set_after(&self.kernels, instance, |after, place| Skin::set(after, place, target))
    }

    /// Create a buffer of the triangles around each vertex of a mesh, and record its upload: once for each mesh, whatever
    /// the number of crowds and instances. It takes 36 bytes a vertex, 8 for each corner of a triangle (8 × (n - 2) for each
    /// corner of a face of n), and on the host 4 for each pair of neighbouring pieces of 32 vertices.
    ///
    /// This records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that recomputes normals, and calling
    /// [`GpuNormals::release_staging`] once it has run.
    ///
    /// # Errors
    /// A face of a vertex that there is not, or of fewer than three; welds of other vertices; a mesh without vertices, or
    /// one that exceeds the device's storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// As [`upload_skin`](Self::upload_skin).
    pub unsafe fn upload_normals(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &NormalsDesc<'_>,
    ) -> Result<GpuNormals> {
        // SAFETY: the caller's obligations.
        unsafe { GpuNormals::upload(&self.device, cmd, mesh, desc) }
    }

    /// Have the normals of an instance's pose computed from its morphed surface, into a buffer of the host's own, from the
    /// next recorded update on: area-weighted, as on import, welded vertices alike, with unit length. A vertex whose
    /// triangles have no area has its normal of the base pose. `None`: no longer. An instance has one target.
    ///
    /// The step follows those of the update, and is recorded with them: it writes the pieces of 32 vertices that the update
    /// changed and those that share a triangle with them (dense paths and animated crowds: all), and nothing where nothing
    /// changed. Everything is written first, and after the instance was hidden, or an update that wrote the target was
    /// discarded. What is written is ready for the [consumers](crate::Consumers) of the crowd, and waits for their reads, as
    /// with poses. An instance that is removed loses its target.
    ///
    /// The caller is responsible for: barriers of its own, where it writes the buffer itself, or stages read it that the
    /// consumers do not name.
    ///
    /// # Errors
    /// An instance out of range or removed; a crowd or surface of another engine; a surface of another mesh, or of one
    /// packed otherwise; a direct path, which has no poses; an offset or stride that does not fit; more than the device's
    /// storage range; a buffer that is too small, as far as `vkGetBufferMemoryRequirements` tells. Nothing changes then.
    ///
    /// # Safety
    /// As [`set_decode_target`](Self::set_decode_target).
    pub unsafe fn set_normals_target(
        &self,
        crowd: &mut (impl AnyCrowd + ?Sized),
        instance: u32,
        target: Option<(&GpuNormals, &NormalsTarget)>,
    ) -> Result<()> {
        let crowd = crowd.base_mut();
        crowd.check_device(&self.device)?;
        crowd.set_after(&self.kernels, instance, |after, place| Recomputed::set(after, place, target))
    }

    /// Have the bounds of an instance's pose written into a buffer of the host's own, from the next recorded update on:
    /// the least and greatest coordinates of all its vertices, exactly those of the pose as it is decoded. `None`: no
    /// longer. An instance has one target.
    ///
    /// The step follows those of the update, and is recorded with them: two dispatches for each target, one of the parts of
    /// 256 vertices that the update changed (dense paths and animated crowds: all), and one workgroup for what all parts
    /// have in common; nothing where nothing changed. All is done first, and after the instance was hidden, or an update
    /// that wrote the target was discarded. What is written is ready for the [consumers](crate::Consumers) of the crowd, and
    /// waits for their reads, as with poses. An instance that is removed loses its target. It takes 24 bytes of device
    /// memory for each part.
    ///
    /// These are bounds of the morphed pose: a skinned one has others. Without a GPU:
    /// [`WeightBounds`](crate::after::WeightBounds).
    ///
    /// The caller is responsible for: barriers of its own, where it writes the buffer itself, or stages read it that the
    /// consumers do not name.
    ///
    /// # Errors
    /// An instance out of range or removed; a crowd that another engine made; a direct path, which has no poses; an offset
    /// that is no multiple of 4; more than the device's storage range; a buffer that is too small, as far as
    /// `vkGetBufferMemoryRequirements` tells. Nothing changes then.
    ///
    /// # Safety
    /// As [`set_decode_target`](Self::set_decode_target).
    pub unsafe fn set_bounds_target(
        &self,
        crowd: &mut (impl AnyCrowd + ?Sized),
        instance: u32,
        target: Option<&BoundsTarget>,
    ) -> Result<()> {
        let crowd = crowd.base_mut();
        crowd.check_device(&self.device)?;
        crowd.set_after(&self.kernels, instance, |after, place| TightBounds::set(after, place, target))
    }
}
