//! Poses and sums, read back from the device.

use super::HeadlessCrowd;
use super::kinds::Kind;
#[cfg(feature = "baselines")]
use crate::engine::Crowd;
use crate::engine::PoseView;
use crate::error::Result;
use crate::headless::submit::{full_barrier, host_barrier};
use ash::vk;

impl<C: Kind> HeadlessCrowd<'_, C> {
    /// Read the pose of an instance back: six floats a vertex, in the user's order of vertices, without padding. On a
    /// direct path it is captured from a draw.
    ///
    /// # Errors
    /// As [`draw`](Self::draw); a direct path on a device that cannot capture.
    pub fn read_pose(&mut self, instance: u32) -> Result<Vec<f32>> {
        #[cfg(feature = "baselines")]
        if let Some(crowd) = self.direct() {
            let engine = self.headless.engine();
            // SAFETY: as in `step_together`.
            let view = self.headless.submitter().run(|cmd| unsafe { engine.record_capture(cmd, crowd, instance) })?;
            let pose = self.read_view(view)?;
            return Ok(self.mesh.layout().to_user_order(&pose));
        }
        let view = self.crowd.base().group_pose(instance, 0)?;
        let pose = self.read_view(view)?;
        Ok(self.mesh.layout().to_user_order(&pose))
    }

    /// Read the previous pose of an instance back; `None` where the update had to overwrite it.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn read_previous_pose(&mut self, instance: u32) -> Result<Option<Vec<f32>>> {
        let Some(view) = self.crowd.base().previous_group_pose(instance, 0)? else { return Ok(None) };
        let pose = self.read_view(view)?;
        Ok(Some(self.mesh.layout().to_user_order(&pose)))
    }

    /// Read the pose and the previous pose of an instance in a [group](crate::PackedMesh::groups) of the mesh back, as
    /// [`read_pose`](Self::read_pose) does for the first.
    ///
    /// # Errors
    /// As [`draw`](Self::draw); a path without pose buffers.
    ///
    /// # Panics
    /// When the mesh has no such group.
    pub fn read_group(&mut self, instance: u32, group: usize) -> Result<(Vec<f32>, Option<Vec<f32>>)> {
        let (pose, previous) =
            (self.crowd.base().group_pose(instance, group)?, self.crowd.base().previous_group_pose(instance, group)?);
        let pose = self.read_view(pose)?;
        let previous = previous.map(|view| self.read_view(view)).transpose()?;
        let user = |pose: Vec<f32>| self.mesh.layout().to_user_order(&pose);
        Ok((user(pose), previous.map(user)))
    }

    /// Read the integer sums of an instance back, as [`CpuCrowd::sums`](crate::cpu::CpuCrowd::sums) has them; `None`
    /// unless it accumulates exactly.
    ///
    /// # Errors
    /// A device that fails.
    pub fn read_sums(&mut self, instance: u32) -> Result<Option<Vec<i32>>> {
        let Some((buffer, offset)) = self.crowd.base().sums(instance) else { return Ok(None) };
        let bytes = self.read(buffer, offset, self.mesh.layout().base_bytes())?;
        Ok(Some(bytes.chunks_exact(4).map(|b| i32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect()))
    }

    /// The crowd, if its draws evaluate poses.
    #[cfg(feature = "baselines")]
    pub(super) fn direct(&self) -> Option<&Crowd> {
        self.crowd.weighted().filter(|crowd| crowd.desc().update.path.evaluates_in_draws())
    }

    fn read_view(&mut self, view: PoseView) -> Result<Vec<f32>> {
        let bytes = self.read(view.buffer, view.offset, view.size)?;
        Ok(view.format.decode(bytes))
    }

    pub(super) fn read(&mut self, buffer: vk::Buffer, offset: u64, size: u64) -> Result<&[u8]> {
        let submitter = self.headless.submitter();
        let region = [vk::BufferCopy { src_offset: offset, dst_offset: 0, size }];
        submitter.run(|cmd| {
            full_barrier(submitter.device(), cmd);
            // SAFETY: the buffer is recording; the region lies within both buffers, which are alive.
            unsafe { submitter.device().cmd_copy_buffer(cmd, buffer, self.readback.raw, &region) };
            host_barrier(submitter.device(), cmd);
            Ok(())
        })?;
        Ok(&self.readback.mapped()?[..size as usize])
    }
}
