//! Frames in flight: the update, the instances, the panel over them, timings, and pixels for files.

use super::device::{Device, failed};
use super::heads::{Full, Heads, IN_FLIGHT};
use super::painter::{Painter, Picture};
use super::swapchain::Swapchain;
use crate::output::Failure;
use crate::render::canvas::Canvas;
use deltamorph::UpdateStats;
use deltamorph::ash::vk;
use deltamorph_render::{Buffer, Scene};
use egui::TextureId;
use glam::Mat4;
use std::path::PathBuf;
use std::rc::Rc;
use std::slice::from_ref;

/// Timestamps of a frame: its beginning, after the update, its end, after the full evaluation.
const STAMPS: u32 = 4;

/// Measurements of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    pub stats: UpdateStats,
    /// Processor time: planning and recording, or the update on the path `cpu`.
    pub cpu_ms: f64,
    /// Device time of the update, and of the whole frame. `None` without timestamps.
    pub update_ms: Option<f64>,
    pub frame_ms: Option<f64>,
    /// A full evaluation, if the frame measured one: bytes, and device time.
    pub full: Option<(u64, Option<f64>)>,
}

/// Contents of a frame.
pub struct Wanted<'a> {
    pub weights: &'a [f32],
    /// Joints, if the mesh has any.
    pub joints: Option<Vec<f32>>,
    /// Vertices of the still parts, if joints move them.
    pub still: Option<Vec<f32>>,
    pub scene: &'a Scene,
    pub background: [f32; 4],
    pub panel: Picture,
    /// Measures a full evaluation after the frame.
    pub full: Option<&'a mut Full>,
    pub screenshot: &'a mut Option<PathBuf>,
}

/// The outcome of drawing a frame.
pub enum Drawn {
    Shown,
    /// The window has another size now: the frame, if one was drawn, is the last of the old size.
    Outgrown,
}

/// Frames in flight.
pub struct Frames {
    device: Rc<Device>,
    pub pool: vk::CommandPool,
    /// Whether pixels are in the order blue, green, red.
    blue_first: bool,
    queries: vk::QueryPool,
    mask: u64,
    frames: Vec<Frame>,
    next: usize,
    /// Finished frames that [`Frames::take_samples`] has not returned.
    samples: Vec<Sample>,
}

struct Frame {
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
    acquired: vk::Semaphore,
    running: Option<Sample>,
    /// Textures to free when the frame has finished.
    textures: Vec<TextureId>,
    picture: Option<(Buffer, vk::Extent2D, PathBuf)>,
}

impl Frames {
    pub fn new(device: &Rc<Device>, format: vk::Format) -> Result<Self, Failure> {
        let raw = device.raw();
        let pool = vk::CommandPoolCreateInfo::default().queue_family_index(device.headless.queue().1);
        let pool = pool.flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        let queries = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP);
        let queries = queries.query_count(STAMPS * IN_FLIGHT as u32);
        // SAFETY: the device has this queue family; `drop` destroys everything.
        unsafe {
            let families = device.instance().get_physical_device_queue_family_properties(device.physical());
            let bits = families[device.headless.queue().1 as usize].timestamp_valid_bits;
            let pool = raw.create_command_pool(&pool, None).map_err(failed("vkCreateCommandPool"))?;
            let mask = u64::MAX.checked_shr(64 - bits).unwrap_or(0);
            let none = vk::QueryPool::null();
            let blue_first = format == vk::Format::B8G8R8A8_SRGB;
            let device = device.clone();
            let frames = vec![];
            let samples = vec![];
            let mut this = Self { device, pool, blue_first, queries: none, mask, frames, next: 0, samples };
            if bits > 0 {
                this.queries = raw.create_query_pool(&queries, None).map_err(failed("vkCreateQueryPool"))?;
            }
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            for _ in 0..IN_FLIGHT {
                let cmd = raw.allocate_command_buffers(&info).map_err(failed("vkAllocateCommandBuffers"))?[0];
                let fence = raw.create_fence(&vk::FenceCreateInfo::default(), None).map_err(failed("vkCreateFence"))?;
                let acquired = vk::Semaphore::null();
                let textures = vec![];
                let picture = None;
                // From here on `drop` destroys whatever has been created.
                let frame = this.frames.push_mut(Frame { cmd, fence, acquired, running: None, textures, picture });
                let acquired = raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
                frame.acquired = acquired.map_err(failed("vkCreateSemaphore"))?;
            }
            Ok(this)
        }
    }

    /// Measurements of the frames that have finished since the last call.
    pub fn take_samples(&mut self) -> Vec<Sample> {
        std::mem::take(&mut self.samples)
    }

    /// Waits for all frames.
    pub fn finish(&mut self, painter: &mut Painter) -> Result<(), Failure> {
        let first = self.next;
        (0..IN_FLIGHT).try_for_each(|i| self.wait((first + i) % IN_FLIGHT, painter))
    }

    /// Waits for a frame, and collects its results.
    fn wait(&mut self, slot: usize, painter: &mut Painter) -> Result<(), Failure> {
        let raw = self.device.raw();
        let frame = &mut self.frames[slot];
        let Some(mut sample) = frame.running.take() else { return Ok(()) };
        // SAFETY: the fence was submitted, and the queries were written before it.
        unsafe {
            raw.wait_for_fences(&[frame.fence], true, u64::MAX).map_err(failed("vkWaitForFences"))?;
            raw.reset_fences(&[frame.fence]).map_err(failed("vkResetFences"))?;
            if self.queries != vk::QueryPool::null() {
                let mut at = [0u64; STAMPS as usize];
                let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
                let read = raw.get_query_pool_results(self.queries, slot as u32 * STAMPS, &mut at, flags);
                read.map_err(failed("vkGetQueryPoolResults"))?;
                let tick = f64::from(self.device.engine().caps().timestamp_period) / 1e6;
                let ms = |from: usize, to: usize| Some((at[to].wrapping_sub(at[from]) & self.mask) as f64 * tick);
                (sample.update_ms, sample.frame_ms) = (ms(0, 1), ms(0, 2));
                sample.full = sample.full.map(|(bytes, _)| (bytes, ms(2, 3)));
            }
        }
        self.samples.push(sample);
        painter.free_textures(&std::mem::take(&mut frame.textures))?;
        let Some((pixels, extent, path)) = frame.picture.take() else { return Ok(()) };
        let size = [extent.width, extent.height];
        let mut rgba = pixels.contents()[..size[0] as usize * size[1] as usize * 4].to_vec();
        if self.blue_first {
            rgba.chunks_exact_mut(4).for_each(|pixel| pixel.swap(0, 2));
        }
        rgba.chunks_exact_mut(4).for_each(|pixel| pixel[3] = 255);
        Canvas::from(deltamorph_render::Picture { size, rgba }).save(&path)
    }

    /// Draws a frame, and presents it.
    pub fn draw(
        &mut self,
        heads: &mut Heads,
        swapchain: &mut Swapchain,
        painter: &mut Painter,
        wanted: Wanted<'_>,
    ) -> Result<Drawn, Failure> {
        let slot = self.next;
        self.wait(slot, painter)?;
        // Even if nothing is drawn: egui hands out new textures only once.
        painter.set_textures(self.pool, &wanted.panel)?;
        self.frames[slot].textures.extend(&wanted.panel.free);
        let acquired = self.frames[slot].acquired;
        let Some(index) = swapchain.acquire(acquired)? else {
            return Ok(Drawn::Outgrown);
        };
        // The frame that last used the image must have finished: its semaphore and target are reused.
        if let Some(last) = swapchain.images[index].frame.replace(slot).filter(|last| *last != slot) {
            self.wait(last, painter)?;
        }
        let device = self.device.clone();
        let cmd = self.frames[slot].cmd;
        let raw = device.raw();
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is ours, and not pending: its frame was waited for.
        unsafe { raw.begin_command_buffer(cmd, &once) }.map_err(failed("vkBeginCommandBuffer"))?;
        let sample = self.record(slot, index, heads, swapchain, painter, wanted)?;
        let stages = [vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT];
        let waits = [acquired];
        let signals = [swapchain.images[index].drawn];
        let submit = vk::SubmitInfo::default().command_buffers(from_ref(&cmd)).wait_dst_stage_mask(&stages);
        let submit = submit.wait_semaphores(&waits).signal_semaphores(&signals);
        // SAFETY: recorded above; the image was acquired with the semaphore that is waited for.
        unsafe {
            raw.end_command_buffer(cmd).map_err(failed("vkEndCommandBuffer"))?;
            let submitted = raw.queue_submit(device.headless.queue().0, &[submit], self.frames[slot].fence);
            submitted.map_err(failed("vkQueueSubmit"))?;
        }
        self.frames[slot].running = Some(sample);
        self.next = (slot + 1) % IN_FLIGHT;
        Ok(if swapchain.present(index)? { Drawn::Shown } else { Drawn::Outgrown })
    }

    fn record(
        &mut self,
        slot: usize,
        index: usize,
        heads: &mut Heads,
        swapchain: &mut Swapchain,
        painter: &mut Painter,
        wanted: Wanted<'_>,
    ) -> Result<Sample, Failure> {
        let Wanted { weights, joints, still, scene, background, panel, full, screenshot } = wanted;
        let device = self.device.clone();
        let cmd = self.frames[slot].cmd;
        let raw = device.raw();
        if self.queries != vk::QueryPool::null() {
            // SAFETY: the buffer is recording; the queries belong to this frame, and were read.
            unsafe { raw.cmd_reset_query_pool(cmd, self.queries, slot as u32 * STAMPS, STAMPS) };
        }
        self.stamp(slot, 0);
        if heads.is_skinned {
            joints.map_or(Ok(()), |joints| heads.drawn.set_joints(0, &joints))?;
            still.map_or(Ok(()), |vertices| heads.drawn.set_still_vertices(0, &vertices))?;
        }
        // SAFETY: the buffer is recording on the engine's device, outside a render pass; frames are submitted once, in
        // order, after a wait for the one `IN_FLIGHT` ago. If submission fails, the window closes.
        let took = unsafe { heads.drawn.update(device.engine(), cmd, slot, &[weights]) }?;
        self.stamp(slot, 1);
        let extent = swapchain.extent;
        let readable = swapchain.readable;
        let shown = &mut swapchain.images[index];
        // SAFETY: the buffer is recording, after the update; the target belongs to the instance, and its last frame was
        // waited for.
        unsafe { heads.drawn.record(cmd, slot, &mut shown.target, &[Mat4::IDENTITY], scene, background) }?;
        // SAFETY: as above; the framebuffer belongs to the image.
        unsafe { painter.record(cmd, shown.framebuffer, extent, &panel) }?;
        if let Some(path) = screenshot.take() {
            if !readable {
                let text = "pixels of windows cannot be copied here; `deltamorph render` writes pictures";
                return Err(Failure::Failed(format!("{}: {text}", path.display())));
            }
            let bytes = extent.width as usize * extent.height as usize * 4;
            // SAFETY: it is dropped after its frame was waited for.
            let pixels = unsafe { heads.drawn.pixels(bytes) }?;
            copy(&device, cmd, shown.image, extent, &pixels);
            self.frames[slot].picture = Some((pixels, extent, path));
        }
        self.stamp(slot, 2);
        // SAFETY: as for the update.
        let measured = full.map(|full| unsafe { full.update(&device, cmd, weights) });
        self.stamp(slot, 3);
        let full = measured.transpose()?.filter(|stats| stats.bytes_moved > 0).map(|stats| (stats.bytes_moved, None));
        Ok(Sample { stats: took.stats, cpu_ms: took.cpu_ms, update_ms: None, frame_ms: None, full })
    }

    /// Writes a timestamp when everything before it has finished, and nothing after it has begun.
    fn stamp(&self, slot: usize, number: u32) {
        if self.queries == vk::QueryPool::null() {
            return;
        }
        let raw = self.device.raw();
        let cmd = self.frames[slot].cmd;
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        let memory = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)];
        // SAFETY: the buffer is recording, outside a render pass; the query was reset in it.
        unsafe {
            let last = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
            let query = slot as u32 * STAMPS + number;
            raw.cmd_write_timestamp(cmd, last, self.queries, query);
            raw.cmd_pipeline_barrier(cmd, all, all, Default::default(), &memory, &[], &[]);
        }
    }
}

/// Records a copy of an image to present into `pixels`.
fn copy(device: &Device, cmd: vk::CommandBuffer, image: vk::Image, extent: vk::Extent2D, pixels: &Buffer) {
    use vk::{AccessFlags as Access, ImageLayout as Layout, PipelineStageFlags as Stage};
    let range = vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR);
    let change = |from, to, read| {
        let change = vk::ImageMemoryBarrier::default().image(image).old_layout(from).new_layout(to);
        let change = change.subresource_range(range.level_count(1).layer_count(1)).dst_access_mask(read);
        change.src_queue_family_index(vk::QUEUE_FAMILY_IGNORED).dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
    };
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
    let region = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent.into())];
    let read =
        [vk::MemoryBarrier::default().src_access_mask(Access::TRANSFER_WRITE).dst_access_mask(Access::HOST_READ)];
    let raw = device.raw();
    let none = vk::DependencyFlags::empty();
    let shown = Layout::PRESENT_SRC_KHR;
    let copied = Layout::TRANSFER_SRC_OPTIMAL;
    // SAFETY: the buffer is recording, outside a render pass; the panel's pass makes the image available to transfers,
    // in the layout for presenting; the buffer has room for its pixels.
    unsafe {
        let begin = [change(shown, copied, Access::TRANSFER_READ)];
        raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::TRANSFER, none, &[], &[], &begin);
        raw.cmd_copy_image_to_buffer(cmd, image, copied, pixels.raw(), &region);
        let end = [change(copied, shown, Access::empty())];
        raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::HOST | Stage::BOTTOM_OF_PIPE, none, &read, &[], &end);
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        let raw = self.device.raw();
        // SAFETY: ours, destroyed once; the device is idle.
        unsafe {
            for frame in &self.frames {
                raw.destroy_fence(frame.fence, None);
                raw.destroy_semaphore(frame.acquired, None);
            }
            raw.destroy_query_pool(self.queries, None);
            raw.destroy_command_pool(self.pool, None);
        }
    }
}
