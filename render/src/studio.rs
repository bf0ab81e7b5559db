//! Pictures without a window, with several frames in flight.

use crate::heads::{Heads, HeadsDesc, Updated};
use crate::parts::Part;
use crate::scene::{Scene, Show};
use crate::target::{Picture, Target};
use deltamorph::ash::vk;
use deltamorph::{Error, KeptMesh, PackedMesh, Result};
use deltamorph_headless::{Headless, wait_idle};
use glam::Mat4;
use std::collections::VecDeque;
use std::slice::from_ref;
use std::sync::Arc;

/// Draws pictures of a mesh.
pub struct Studio<'a> {
    headless: &'a Headless,
    frames: Vec<Frame>,
    /// Frames that are being drawn, the oldest first.
    pending: VecDeque<usize>,
    pool: vk::CommandPool,
    draws: [usize; 2],
    heads: Heads,
}

/// The resources of a picture.
struct Frame {
    target: Target,
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
}

impl<'a> Studio<'a> {
    /// Makes a studio for pictures of this width and height (≥ 1) of heads of `mesh`, which was packed as `packed` and
    /// consists of `parts`. As many pictures are drawn at the same time as frames may be unfinished.
    ///
    /// # Errors
    /// Those of [`Heads::new`]; pictures are larger than the device draws.
    pub fn new(
        headless: &'a Headless,
        mesh: &KeptMesh,
        packed: &Arc<PackedMesh>,
        parts: &[Part],
        size: [u32; 2],
        desc: &HeadsDesc,
    ) -> Result<Self> {
        // SAFETY: the device is that of `headless`, which outlives the studio; `drop` waits for the device, and frames
        // are dropped first.
        let heads = unsafe { Heads::new(headless, mesh, packed, parts, desc) }?;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(headless.queue().1);
        let info = info.flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device has this family; destroyed by `drop`.
        let pool = unsafe { headless.handles().2.create_command_pool(&info, None) };
        let pool = pool.map_err(Error::vulkan("vkCreateCommandPool"))?;
        let mut this = Self { headless, frames: vec![], pending: VecDeque::new(), pool, draws: [0; 2], heads };
        for _ in 0..desc.frames {
            let frame = this.frame(size)?;
            this.frames.push(frame);
        }
        Ok(this)
    }

    fn frame(&self, size: [u32; 2]) -> Result<Frame> {
        let device = self.headless.handles().2;
        // SAFETY: `drop` waits for the device.
        let target = unsafe { self.heads.target(size) }?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the pool is ours, and frees its buffers; the fence is destroyed by `drop`.
        let (cmd, fence) = unsafe {
            let cmd = device.allocate_command_buffers(&info).map_err(Error::vulkan("vkAllocateCommandBuffers"))?[0];
            let fence =
                device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(Error::vulkan("vkCreateFence"))?;
            (cmd, fence)
        };
        Ok(Frame { target, cmd, fence })
    }

    /// Draws `mesh`, made of `parts`, with each head: [`Heads::set_still`].
    ///
    /// # Errors
    /// The device fails; there is no memory.
    pub fn set_still(&mut self, mesh: &KeptMesh, parts: &[Part]) -> Result<()> {
        self.finish()?;
        self.heads.set_still(mesh, parts)
    }

    /// Begins a picture of all heads, with these weights and at `places`, in front of `background` (linear red, green,
    /// blue, and opacity; colours are multiplied by it). If as many pictures are being drawn already as may be, it
    /// waits for the oldest and returns it: pictures come in the order in which they were begun.
    ///
    /// # Errors
    /// The numbers of weights, places and heads differ; weights are not valid; or the device fails. The picture is not
    /// drawn then; after a device has failed, no other is.
    pub fn draw(
        &mut self,
        weights: &[impl AsRef<[f32]>],
        places: &[Mat4],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<Option<Picture>> {
        let full = self.pending.len() == self.frames.len();
        let finished = if full { self.next_finished()? } else { None };
        let Some(slot) = (0..self.frames.len()).find(|i| !self.pending.contains(i)) else { return Ok(finished) };
        let cmd = self.frames[slot].cmd;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let device = self.headless.handles().2;
        // SAFETY: the buffer is ours, and not pending: its fence has been waited for.
        unsafe { device.begin_command_buffer(cmd, &info) }.map_err(Error::vulkan("vkBeginCommandBuffer"))?;
        // SAFETY: as above; the buffer is submitted once, in order, or the update is discarded.
        let updated = unsafe { self.heads.update(self.headless.engine(), cmd, slot, weights) };
        let recorded = match &updated {
            Ok(_) => self.record(slot, places, scene, background),
            Err(_) => Ok(()),
        };
        // SAFETY: begun above.
        let ended = unsafe { device.end_command_buffer(cmd) }.map_err(Error::vulkan("vkEndCommandBuffer"));
        let updated: Updated = updated?;
        let submitted = recorded.and(ended).and_then(|()| self.submit(slot));
        if submitted.is_err() {
            self.heads.discard(&updated)?;
        }
        submitted?;
        self.pending.push_back(slot);
        Ok(finished)
    }

    fn record(&mut self, slot: usize, places: &[Mat4], scene: &Scene, background: [f32; 4]) -> Result<()> {
        if scene.show == Show::Motion && !self.heads.has_previous()? {
            return Err(Error::Invalid {
                what: "the previous pose, which the update has overwritten, or which has recomputed normals".into(),
                remedy: "use two slots or more, three on the path feedback, and the normals of targets".into(),
            });
        }
        let Frame { target, cmd, .. } = &mut self.frames[slot];
        // SAFETY: `cmd` is recording, after the update; the target is that of the heads, and its last picture has been
        // waited for.
        self.draws = unsafe { self.heads.record(*cmd, slot, target, places, scene, background) }?;
        // SAFETY: `cmd` is recording, after the draws.
        unsafe { target.copy_pixels(*cmd) };
        Ok(())
    }

    fn submit(&self, slot: usize) -> Result<()> {
        let device = self.headless.handles().2;
        let Frame { cmd, fence, .. } = &self.frames[slot];
        let info = vk::SubmitInfo::default().command_buffers(from_ref(cmd));
        // SAFETY: recorded above; the fence is not in use; `Headless` is used by one thread at a time.
        unsafe {
            device.reset_fences(from_ref(fence)).map_err(Error::vulkan("vkResetFences"))?;
            device
                .queue_submit(self.headless.queue().0, from_ref(&info), *fence)
                .map_err(Error::vulkan("vkQueueSubmit"))
        }
    }

    /// Waits for the oldest picture that is being drawn.
    fn next_finished(&mut self) -> Result<Option<Picture>> {
        let Some(&slot) = self.pending.front() else { return Ok(None) };
        let frame = &mut self.frames[slot];
        // SAFETY: the fence was submitted.
        let waited = unsafe { self.headless.handles().2.wait_for_fences(&[frame.fence], true, u64::MAX) };
        waited.map_err(Error::vulkan("vkWaitForFences"))?;
        self.pending.pop_front();
        Ok(Some(frame.target.picture()?))
    }

    /// Returns the numbers of draws of the last picture begun: recorded, and skipped by culling ([`HeadsDesc::cull`]).
    pub fn draws(&self) -> [usize; 2] {
        self.draws
    }

    /// Waits for all pictures that are being drawn, and returns them in the order in which they were begun.
    ///
    /// # Errors
    /// The device fails.
    pub fn finish(&mut self) -> Result<Vec<Picture>> {
        let mut finished = vec![];
        while let Some(picture) = self.next_finished()? {
            finished.push(picture);
        }
        Ok(finished)
    }
}

impl Drop for Studio<'_> {
    fn drop(&mut self) {
        let device = self.headless.handles().2;
        // SAFETY: everything is ours, destroyed once, and not in use after the wait (a lost device uses nothing).
        unsafe {
            let _ = wait_idle(device);
            self.frames.iter().for_each(|frame| device.destroy_fence(frame.fence, None));
            device.destroy_command_pool(self.pool, None);
        }
    }
}
