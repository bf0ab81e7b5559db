//! What hosts ask for after the pose: each step by its name.

use super::MorphEngine;
use super::base::AnyCrowd;
use crate::abi::steps::after_steps;
use crate::after::*;
use crate::error::Result;
use crate::pack::PackedMesh;
use ash::vk;

impl MorphEngine {
    /// Create a buffer of the joints and weights of a mesh's vertices, and record its upload: once for each mesh,
    /// whatever the number of crowds and instances. It takes 24 bytes a vertex for the base pose, and as many again for
    /// four influences, or 48 for eight; weights stay float32, since 16 bits of them would move vertices by 1e-5 of the
    /// diagonal.
    ///
    /// This records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER
    /// with TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that skins, and calling
    /// [`GpuSkin::release_staging`] once it has run.
    ///
    /// # Errors
    /// Other than 4 or 8 influences, or 1 to 65,536 joints; arrays of another length; a weight that is negative or no
    /// number; a vertex whose weights sum to 0, or one that names a joint that there is not; a mesh without vertices,
    /// or one that exceeds the device's storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on any queue.
    /// - It runs before any update that skins by the value returned, exactly once.
    /// - The value returned is dropped only when the device no longer uses it; so are the crowds that have targets of
    ///   it.
    pub unsafe fn upload_skin(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &SkinDesc<'_>,
    ) -> Result<GpuSkin> {
        // SAFETY: the caller's obligations.
        unsafe { GpuSkin::upload(&self.device, cmd, mesh, desc) }
    }

    /// Create a buffer of the triangles around each vertex of a mesh, and record its upload: once for each mesh,
    /// whatever the number of crowds and instances. It takes 36 bytes a vertex, 8 for each corner of a triangle (8 ×
    /// (n - 2) for each corner of a face of n), and on the host 4 for each pair of neighbouring pieces of 32 vertices.
    ///
    /// This records: a copy from staging memory, and a barrier that makes it visible to updates (first stage TRANSFER
    /// with TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update that recomputes normals, and calling
    /// [`GpuNormals::release_staging`] once it has run.
    ///
    /// # Errors
    /// A face of a vertex that there is not, or of fewer than three; welds of other vertices; a mesh without vertices,
    /// or one that exceeds the device's storage range; no memory. Nothing is recorded then.
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
}

/// What sets the targets of the steps.
macro_rules! target_setters {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident $public:tt ($set:ident: $target:ty) $dispatches:tt
    )*) => {
        impl MorphEngine {$(
            $(#[doc = $doc])*
            ///
            /// `None`: no longer. An instance has one target of a kind.
            ///
            /// The step follows those of the update, and is recorded with them: it writes the blocks that the update
            /// changed (dense paths and animated crowds: all of a pose that changed, or may have), and nothing where
            /// nothing changed. Everything is written first, and after the instance was hidden, or an update that wrote
            /// the target was discarded. What is written is ready for the [consumers](crate::CrowdDesc::consumers) of
            /// the crowd, and waits for their reads, as with poses. An instance that is removed loses its target.
            ///
            /// The caller is responsible for: barriers of its own, where it writes the buffers itself, or stages read
            /// them that the consumers do not name.
            ///
            /// # Errors
            /// An instance out of range or removed; a crowd that another engine made; a direct path, which has no
            /// poses; an offset or stride that does not fit; more than the device's storage range; a buffer that is too
            /// small, as far as `vkGetBufferMemoryRequirements` tells. Nothing changes then.
            ///
            /// # Safety
            /// - The buffers are of the engine's device, made for use as storage buffer. They are large enough for all
            ///   that is read and written, and live until the crowd has another target, or none, and the updates
            ///   recorded before have finished.
            /// - Joints stay as they are from the update that they were set for until they are
            ///   [set](crate::Crowd::set_joints) anew, and the updates recorded before have finished: an update that
            ///   changes blocks reads them again.
            /// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
            pub unsafe fn $set(
                &self,
                crowd: &mut (impl AnyCrowd + ?Sized),
                instance: u32,
                target: Option<$target>,
            ) -> Result<()> {
                let crowd = crowd.base_mut();
                crowd.check_device(&self.device)?;
                crowd.set_after(&self.kernels, instance, |after, place| {
                    crate::after::$module::$step::set(after, place, target)
                })
            }
        )*}
    };
}
after_steps!(target_setters());
