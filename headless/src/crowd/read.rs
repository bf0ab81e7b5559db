//! Readback of poses, sums and GPU plans.

use super::HeadlessCrowd;
use crate::abi::push::AnimationPush;
use crate::wait::full_barrier;
use deltamorph::ash::vk;
use deltamorph::{Error, PoseView, Result};

impl HeadlessCrowd<'_> {
    /// Reads an instance's pose back: six floats per vertex, in the user's vertex order, without padding. On a direct
    /// path it is captured from a draw.
    ///
    /// # Errors
    /// Those of [`draw`](Self::draw); a direct path on a device that cannot capture.
    pub fn read_pose(&mut self, instance: u32) -> Result<Vec<f32>> {
        self.read_group_pose(instance, 0)
    }

    /// Reads an instance's previous pose back; `None` if the update had to overwrite it.
    ///
    /// # Errors
    /// Those of [`draw`](Self::draw).
    pub fn read_previous_pose(&mut self, instance: u32) -> Result<Option<Vec<f32>>> {
        let view = self.crowd.previous_group_pose(instance, 0)?;
        view.map(|view| self.read_view(view, 0)).transpose()
    }

    /// Reads the pose and the previous pose of an instance back, in a [group](deltamorph::PackedMesh::groups) of the
    /// mesh and in the layout of [`read_pose`](Self::read_pose).
    ///
    /// # Errors
    /// Those of [`read_pose`](Self::read_pose); a group out of range.
    pub fn read_group(&mut self, instance: u32, group: usize) -> Result<(Vec<f32>, Option<Vec<f32>>)> {
        let pose = self.read_group_pose(instance, group)?;
        let previous = self.crowd.previous_group_pose(instance, group)?;
        Ok((pose, previous.map(|view| self.read_view(view, group)).transpose()?))
    }

    /// Reads an instance's pose in a group back as stored, in the order and with the padding of pose buffers.
    ///
    /// # Errors
    /// Those of [`draw`](Self::draw); a path without pose buffers; a group out of range.
    pub fn read_stored(&mut self, instance: u32, group: usize) -> Result<Vec<u8>> {
        let view = self.crowd.group_pose(instance, group)?;
        self.read((view.buffer, view.offset, view.size))
    }

    /// Reads an instance's integer sums on the path `scatter` back, in the order of pose buffers; `None` for other
    /// paths.
    ///
    /// # Errors
    /// The device fails.
    pub fn read_sums(&mut self, instance: u32) -> Result<Option<Vec<i32>>> {
        let Some((buffer, offset)) = self.crowd.sums(instance) else { return Ok(None) };
        self.read((buffer, offset, self.mesh.layout().base_bytes())).map(Some)
    }

    /// Reads the pose of an instance back, in a [group](deltamorph::PackedMesh::groups) of the mesh and in the layout
    /// of [`read_pose`](Self::read_pose).
    ///
    /// # Errors
    /// Those of [`read_pose`](Self::read_pose); a group out of range.
    pub fn read_group_pose(&mut self, instance: u32, group: usize) -> Result<Vec<f32>> {
        let base = &self.crowd;
        let view = match base.draws(group) {
            Some(draws) => {
                base.slots_of(instance)?;
                // SAFETY: as in `step_together`.
                self.headless.submitter.run(|cmd| unsafe { draws.capture(cmd, instance) })?;
                base.view(0, 0, group)
            }
            None => base.group_pose(instance, group)?,
        };
        self.read_view(view, group)
    }

    /// Reads the pose of a view in a group back, decoded, in the user's vertex order.
    fn read_view(&mut self, view: PoseView, group: usize) -> Result<Vec<f32>> {
        let Self { headless, crowd, poses, .. } = self;
        headless.submitter.run(|cmd| {
            // Also used after captures, and after updates from which a test removed a barrier.
            full_barrier(&headless.submitter.device, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
            // SAFETY: the buffer is recording on the engine's device; `run` waits.
            unsafe { poses.record_views(cmd, crowd, &[(0, group, view)]) }
        })?;
        // SAFETY: as above.
        let mut read = unsafe { poses.decoded() }?;
        Ok(read.pop().unwrap_or_default())
    }

    /// Reads bytes of a buffer back: buffer, offset and size.
    ///
    /// # Errors
    /// The device fails.
    #[doc(hidden)]
    pub fn read<T: bytemuck::Pod>(&mut self, range: (vk::Buffer, u64, u64)) -> Result<Vec<T>> {
        self.readback.read(&self.headless.submitter, range)
    }

    /// Reads an instance's weights on the GPU, in steps of the grid.
    ///
    /// # Errors
    /// A crowd that plays no clips; the device fails.
    #[doc(hidden)]
    pub fn read_weights(&mut self, instance: u32) -> Result<Vec<i32>> {
        let none = || Error::invalid("a crowd that plays no clips", "make it with create_animated_crowd");
        let animated = self.crowd.animated().ok_or_else(none)?;
        let AnimationPush { weights_at, targets, .. } = animated.groups[0].layout.push;
        let first = u64::from(weights_at) + u64::from(instance) * u64::from(targets);
        self.read((animated.state.raw, 4 * first, 4 * u64::from(targets)))
    }
}
