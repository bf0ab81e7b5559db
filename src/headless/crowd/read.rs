//! Poses, sums and what the GPU planned, read back from the device.

use super::HeadlessCrowd;
#[cfg(feature = "baselines")]
use crate::engine::Crowd;
use crate::engine::{AnimatedCrowd, AnyCrowd, PoseView};
use crate::error::Result;
use crate::headless::submit::full_barrier;
use crate::update::animated::PlannedGroup;
use ash::vk;

impl<C: AnyCrowd + 'static> HeadlessCrowd<'_, C> {
    /// Read the pose of an instance back: six floats a vertex, in the user's order of vertices, without padding. On a
    /// direct path it is captured from a draw.
    ///
    /// # Errors
    /// As [`draw`](Self::draw); a direct path on a device that cannot capture.
    pub fn read_pose(&mut self, instance: u32) -> Result<Vec<f32>> {
        #[cfg(feature = "baselines")]
        if let Some(crowd) = self.direct() {
            let engine = &self.headless.engine;
            // SAFETY: as in `step_together`.
            let view = self.headless.submitter.run(|cmd| unsafe { engine.record_capture(cmd, crowd, instance) })?;
            return self.read_view(view, 0);
        }
        self.read_view(self.crowd.base().group_pose(instance, 0)?, 0)
    }

    /// Read the previous pose of an instance back; `None` where the update had to overwrite it.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn read_previous_pose(&mut self, instance: u32) -> Result<Option<Vec<f32>>> {
        let view = self.crowd.base().previous_group_pose(instance, 0)?;
        view.map(|view| self.read_view(view, 0)).transpose()
    }

    /// Read the pose and the previous pose of an instance in a [group](crate::PackedMesh::groups) of the mesh back, as
    /// [`read_pose`](Self::read_pose) does for the first.
    ///
    /// # Errors
    /// As [`read_pose`](Self::read_pose); a group out of range.
    pub fn read_group(&mut self, instance: u32, group: usize) -> Result<(Vec<f32>, Option<Vec<f32>>)> {
        #[cfg(feature = "baselines")]
        if let Some(crowd) = self.direct() {
            let engine = &self.headless.engine;
            let capture =
                // SAFETY: as in `step_together`.
                |cmd| unsafe { engine.record_capture_of(cmd, crowd, instance, group) };
            let view = self.headless.submitter.run(capture)?;
            return Ok((self.read_view(view, group)?, None));
        }
        let base = self.crowd.base();
        let (pose, previous) = (base.group_pose(instance, group)?, base.previous_group_pose(instance, group)?);
        Ok((self.read_view(pose, group)?, previous.map(|view| self.read_view(view, group)).transpose()?))
    }

    /// Read the pose of an instance in a group back as it is stored, in the order and with the padding of pose buffers.
    ///
    /// # Errors
    /// As [`draw`](Self::draw); a path without pose buffers; a group out of range.
    pub fn read_stored(&mut self, instance: u32, group: usize) -> Result<Vec<u8>> {
        let view = self.crowd.base().group_pose(instance, group)?;
        self.read((view.buffer, view.offset, view.size))
    }

    /// Read the sums of integers that the path `scatter` keeps beside the poses of an instance back, in the order of pose
    /// buffers; `None` of other paths.
    ///
    /// # Errors
    /// A device that fails.
    pub fn read_sums(&mut self, instance: u32) -> Result<Option<Vec<i32>>> {
        let Some((buffer, offset)) = self.crowd.base().technique().sums(instance) else { return Ok(None) };
        self.read((buffer, offset, self.mesh.layout().base_bytes())).map(Some)
    }

    /// The crowd, if its draws evaluate poses.
    #[cfg(feature = "baselines")]
    pub(super) fn direct(&self) -> Option<&Crowd> {
        self.weighted().filter(|crowd| crowd.desc().update.path.evaluates_in_draws())
    }

    /// The pose of a view in a group, decoded, in the user's order of vertices.
    fn read_view(&mut self, view: PoseView, group: usize) -> Result<Vec<f32>> {
        let Self { headless, crowd, poses, .. } = self;
        headless.submitter.run(|cmd| {
            // Also after what an update did with a barrier taken out, and after captures.
            full_barrier(&headless.submitter.device, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
            // SAFETY: the buffer is recording on the engine's device; `run` waits.
            unsafe { poses.record_views(cmd, crowd.base(), &[(0, group, view)]) }
        })?;
        // SAFETY: as above.
        let mut read = unsafe { poses.decoded() }?;
        Ok(read.pop().unwrap_or_default())
    }

    /// A buffer, an offset and a size, read back.
    fn read<T: bytemuck::Pod>(&mut self, range: (vk::Buffer, u64, u64)) -> Result<Vec<T>> {
        self.readback.read(&self.headless.submitter, range)
    }
}

impl HeadlessCrowd<'_, AnimatedCrowd> {
    /// What the GPU planned for the last update.
    ///
    /// # Errors
    /// A device that fails; a crowd that is planned on the CPU.
    #[doc(hidden)]
    pub fn read_plan(&mut self) -> Result<Vec<PlannedGroup>> {
        let Self { crowd, readback, headless, .. } = self;
        crowd.animated().read_plan(|range| readback.read(&headless.submitter, range))
    }

    /// The level of detail of an instance that follows the camera, as words: targets kept in steps of 2⁻¹⁶, how many it is about
    /// to keep, epoch, and the error budget, the lower word first. Empty in a crowd in which none does.
    ///
    /// # Errors
    /// As [`read_plan`](Self::read_plan).
    #[doc(hidden)]
    pub fn read_level(&mut self, instance: u32) -> Result<Vec<u32>> {
        let range = self.crowd.animated().level_of(instance);
        range.map_or(Ok(vec![]), |range| self.read(range))
    }

    /// The weights of an instance on the GPU, in steps of the grid.
    ///
    /// # Errors
    /// As [`read_plan`](Self::read_plan).
    #[doc(hidden)]
    pub fn read_weights(&mut self, instance: u32) -> Result<Vec<i32>> {
        let range = self.crowd.animated().weights_of(instance);
        self.read(range)
    }
}
