//! Pictures without a window: drawn into an image of its own, with several frames in flight.

use crate::cull::PoseBounds;
use crate::glow::Glow;
use crate::memory::{Buffer, Image, ImageDesc, failed};
use crate::model::Model;
use crate::parts::Part;
use crate::passes::RendererDesc;
use crate::poses::{Poses, StoredPose};
use crate::renderer::Renderer;
use crate::scene::{Head, Masks, Scene, Show};
use crate::step::{Step, Stepped};
use crate::target::Target;
use crate::wrinkles::MaskPlace;
use bytemuck::cast_slice;
use deltamorph::ash::vk;
use deltamorph::{
    Crowd, CrowdDesc, Error, GpuMesh, MorphMesh, PackedMesh, PoseFormat, Result, Semantic, Ticket, UpdateDesc,
    UpdatePath,
};
use deltamorph_headless::{Headless, wait_idle};
use glam::Mat4;
use std::collections::VecDeque;
use std::slice::from_ref;

/// Shaders write linear colours, and the image stores sRGB.
const FORMAT: vk::Format = vk::Format::R8G8B8A8_SRGB;

/// Options of a [`Studio`].
#[derive(Clone, Copy, Debug)]
pub struct StudioDesc {
    /// Width and height of a picture, in pixels (≥ 1).
    pub size: [u32; 2],
    /// Heads in a picture (≥ 1).
    pub heads: u32,
    /// Most pictures that are drawn at the same time (≥ 1).
    pub in_flight: u32,
    /// Updates of the poses. With the path `cpu`, the host provides poses ([`Poses::Stored`]).
    pub update: UpdateDesc,
    /// For [`Show::Blocks`]: the fraction of its brightness that a changed vertex keeps from one picture to the next, 0
    /// to 1.
    pub afterglow: f32,
    /// Skip heads that are not in the picture. Takes some memory, and time to compute bounds.
    pub cull: bool,
}

/// A picture: red, green, blue and opacity of each pixel in sRGB, row by row from the top. Colours are multiplied by
/// the opacity before encoding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Four bytes per pixel.
    pub rgba: Vec<u8>,
}

/// Draws pictures of a mesh.
pub struct Studio<'a> {
    headless: &'a Headless,
    desc: StudioDesc,
    frames: Vec<Frame>,
    /// Frames that are being drawn, the oldest first.
    pending: VecDeque<usize>,
    pool: vk::CommandPool,
    crowd: Option<Crowd>,
    stepped: Option<Stepped>,
    /// Vertices of still parts that joints move.
    still: Option<StillPoses>,
    /// The glow of each head.
    glow: Vec<Glow>,
    /// Bounds of the crowd's poses, for culling.
    bounds: Option<PoseBounds>,
    draws: [usize; 2],
    /// Location of the wrinkle masks in stored poses, if the mesh has masks.
    masks: Option<MaskPlace>,
    /// The host's poses of the previous picture.
    last: Vec<u8>,
    model: Model,
    renderer: Renderer,
    // Declared after the model, which reads it.
    _uploaded: GpuMesh,
}

/// Vertices of still parts where joints have them: those of each head, and a buffer for each frame.
struct StillPoses {
    vertices: Vec<Vec<f32>>,
    buffers: Vec<Buffer>,
}

/// The resources of a picture.
struct Frame {
    target: Target,
    image: Image,
    pixels: Buffer,
    /// The host's poses: those of all heads, then those of the previous picture, then the groups with the masks.
    poses: Option<Buffer>,
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
}

impl<'a> Studio<'a> {
    /// Makes a studio for poses of `mesh`, which was packed as `packed` and consists of `parts`.
    ///
    /// # Errors
    /// The path has no pose buffers; [`create_crowd`](deltamorph::MorphEngine::create_crowd) fails; pictures are larger
    /// than the device draws; or there is no memory.
    pub fn new(
        headless: &'a Headless,
        mesh: &MorphMesh,
        packed: &PackedMesh,
        parts: &[Part],
        desc: StudioDesc,
    ) -> Result<Self> {
        Self::with_step(headless, mesh, packed, parts, desc, &Step::None)
    }

    /// Makes a studio with `step` after the poses.
    ///
    /// # Errors
    /// Those of [`new`](Self::new); a step that the engine refuses, or with poses of the host; fixed-point wrinkle
    /// masks with a step.
    pub fn with_step(
        headless: &'a Headless,
        mesh: &MorphMesh,
        packed: &PackedMesh,
        parts: &[Part],
        desc: StudioDesc,
        step: &Step<'_>,
    ) -> Result<Self> {
        let StudioDesc { size: [width, height], heads, in_flight, update, .. } = desc;
        if update.path.evaluates_in_draws() {
            return Err(Error::Invalid {
                what: format!(
                    "the path '{}' evaluates poses in its own draws, and has none to draw",
                    update.path.name()
                ),
                remedy: "use blocks, compute or cpu".into(),
            });
        }
        let engine = headless.engine();
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits for it.
        let mut uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, packed) })?;
        // SAFETY: the upload has run.
        unsafe { uploaded.release_staging() };
        let crowd = CrowdDesc::new(update).instances(heads).frames_in_flight(in_flight.max(1));
        let on_device = update.path != UpdatePath::Cpu;
        let mut crowd = if on_device { Some(engine.create_crowd(&uploaded, &crowd)?) } else { None };

        let (instance, physical, device) = headless.handles();
        let (place, layout) = (MaskPlace::of(packed), vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
        let is_stepped = *step != Step::None;
        if is_stepped && (!on_device || place.is_some() && update.pose.has_integers()) {
            return Err(Error::Invalid {
                what: format!("a step after {} poses on the path '{}'", update.pose.name(), update.path.name()),
                remedy: "use a path on the device, and float32 poses where there are wrinkle masks".into(),
            });
        }
        // Steps write float32.
        let pose = if is_stepped { PoseFormat::Float32 } else { update.pose };
        let renderer = RendererDesc { format: FORMAT, layout, pose, masks: place.is_some() };
        // SAFETY: the handles are those of `headless`, which outlives the studio; `drop` waits for the device.
        let renderer = unsafe { Renderer::new(instance, physical, device, &renderer) }?;
        let most = renderer.gpu.limits.max_image_dimension2_d.min(renderer.gpu.limits.max_framebuffer_width);
        if width == 0 || height == 0 || width.max(height) > most {
            return Err(Error::Invalid {
                what: format!("a picture of {width} × {height} pixels"),
                remedy: format!("{} draws 1 to {most} pixels across and down", headless.caps().name),
            });
        }
        // SAFETY: the model is dropped before the uploaded mesh.
        let model = unsafe { Model::new(&renderer, mesh, packed.layout(), &uploaded, parts) }?;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(headless.queue().1);
        let info = info.flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device has this family; destroyed by `drop`.
        let pool = unsafe { device.create_command_pool(&info, None) }.map_err(failed("vkCreateCommandPool"))?;
        let (frames, pending) = (vec![], VecDeque::new());
        let (glow, last) = (vec![Glow::new(packed.layout()); heads as usize], vec![]);
        let _uploaded = uploaded;
        let frames_in_flight = in_flight.max(1) as usize;
        let stepped =
            crowd.as_mut().map(|crowd| Stepped::new((headless, &renderer.gpu), packed, crowd, step, frames_in_flight));
        let stepped = stepped.transpose()?.flatten();
        let bounds = if desc.cull && on_device { Some(PoseBounds::new(packed, &update)?) } else { None };
        let mut this = Self {
            headless,
            desc,
            frames,
            pending,
            pool,
            crowd,
            stepped,
            still: None,
            glow,
            bounds,
            draws: [0; 2],
            masks: place,
            last,
            model,
            renderer,
            _uploaded,
        };
        for _ in 0..frames_in_flight {
            let frame = this.frame(packed)?;
            this.frames.push(frame);
        }
        Ok(this)
    }

    fn frame(&self, packed: &PackedMesh) -> Result<Frame> {
        let ([width, height], gpu) = (self.desc.size, &self.renderer.gpu);
        let (extent, device) = (vk::Extent2D { width, height }, &gpu.device);
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC;
        let (samples, aspect) = (vk::SampleCountFlags::TYPE_1, vk::ImageAspectFlags::COLOR);
        let image = Image::new(gpu, &ImageDesc { extent, format: FORMAT, samples, usage, aspect })?;
        // SAFETY: the view's image lives as long as the target, and has the stated size and format.
        let target = unsafe { Target::new(&self.renderer, image.view, extent, self.desc.heads) }?;
        let bytes = width as usize * height as usize * 4;
        let pixels = Buffer::new(gpu, bytes, vk::BufferUsageFlags::TRANSFER_DST, true)?;
        let poses = match self.crowd {
            Some(_) => None,
            None => {
                let poses = 2 + usize::from(self.masks.is_some());
                let bytes = poses * stored_bytes(packed, self.desc.update.pose) * self.desc.heads as usize;
                Some(Buffer::new(gpu, bytes.max(4), vk::BufferUsageFlags::VERTEX_BUFFER, false)?)
            }
        };
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the pool is ours, and frees its buffers; the fence is destroyed by `drop`.
        let (cmd, fence) = unsafe {
            let cmd = device.allocate_command_buffers(&info).map_err(failed("vkAllocateCommandBuffers"))?[0];
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(failed("vkCreateFence"))?;
            (cmd, fence)
        };
        Ok(Frame { target, image, pixels, poses, cmd, fence })
    }

    /// Begins a picture of all heads, at `places`, in front of `background` (linear red, green, blue, and opacity;
    /// colours are multiplied by it). If [`StudioDesc::in_flight`] pictures are being drawn already, it waits for the
    /// oldest and returns it: pictures come in the order in which they were begun.
    ///
    /// # Errors
    /// The numbers of poses, places and heads differ; weights are not valid; or the device fails. The picture is not
    /// drawn then; after a device has failed, no other is.
    pub fn draw(
        &mut self,
        poses: Poses<'_>,
        places: &[Mat4],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<Option<Picture>> {
        let count = match poses {
            Poses::Weights(weights) => weights.len(),
            Poses::Stored(stored) => stored.len(),
        };
        if count != self.desc.heads as usize || places.len() != count {
            return Err(Error::Invalid {
                what: format!("{count} poses and {} places for {} heads", places.len(), self.desc.heads),
                remedy: "give one of each for every head".into(),
            });
        }
        let full = self.pending.len() == self.frames.len();
        let finished = if full { self.next_finished()? } else { None };
        let Some(slot) = (0..self.frames.len()).find(|i| !self.pending.contains(i)) else { return Ok(finished) };
        self.set_poses(slot, poses)?;
        let cmd = self.frames[slot].cmd;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let device = self.headless.handles().2;
        // SAFETY: the buffer is ours, and not pending: its fence has been waited for.
        unsafe { device.begin_command_buffer(cmd, &info) }.map_err(failed("vkBeginCommandBuffer"))?;
        let mut ticket = None;
        let recorded = self.record(slot, poses, places, scene, background, &mut ticket);
        // SAFETY: begun above.
        let ended = unsafe { device.end_command_buffer(cmd) }.map_err(failed("vkEndCommandBuffer"));
        let submitted = recorded.and(ended).and_then(|()| self.submit(slot));
        if let (Err(_), Some(crowd), Some(ticket)) = (&submitted, &mut self.crowd, ticket) {
            crowd.discard(ticket)?;
        }
        submitted?;
        self.pending.push_back(slot);
        Ok(finished)
    }

    /// Sets the joints of a head from the next picture on, in a studio with [`Step::Skin`]: the first three rows of
    /// each joint's matrix. Initially they are the identity.
    ///
    /// # Errors
    /// [`Error::Invalid`] if there is no such head, no skin, or another number of joints.
    pub fn set_joints(&mut self, head: usize, joints: &[f32]) -> Result<()> {
        if self.stepped.as_mut().is_some_and(|stepped| stepped.set_joints(head, joints)) {
            return Ok(());
        }
        let what = format!("{} numbers for joints of head {head}", joints.len());
        Err(Error::Invalid { what, remedy: "give twelve for each joint of the skin".into() })
    }

    /// Draws `mesh`, made of `parts`, with each head: it stands as it is, relative to the head, without a pose.
    ///
    /// # Errors
    /// There is no memory.
    pub fn set_still(&mut self, mesh: &MorphMesh, parts: &[Part]) -> Result<()> {
        self.finish()?;
        self.still = None;
        self.model.set_still(&self.renderer, mesh, parts)
    }

    /// Sets where joints have the still parts of a head from the next picture on, in a studio with [`Step::Skin`]:
    /// position and normal of each vertex. Heads for which none are set have them as they stand.
    ///
    /// # Errors
    /// [`Error::Invalid`] if there is no such head, no skin, or another number of vertices; there is no memory.
    pub fn set_still_vertices(&mut self, head: usize, vertices: &[f32]) -> Result<()> {
        let expected = self.model.still.as_ref().zip(self.stepped.as_ref()).map(|(still, _)| still.standing_vertices());
        let Some(expected) = expected.filter(|all| all.len() == vertices.len() && head < self.desc.heads as usize)
        else {
            let what = format!("{} numbers for still vertices of head {head}", vertices.len());
            return Err(Error::Invalid { what, remedy: "give six for each vertex of the still parts".into() });
        };
        if self.still.is_none() {
            let heads = self.desc.heads as usize;
            let buffer = |_: &Frame| {
                let bytes = (heads * expected.len() * size_of::<f32>()).max(4);
                Buffer::new(&self.renderer.gpu, bytes, vk::BufferUsageFlags::VERTEX_BUFFER, false)
            };
            let buffers = self.frames.iter().map(buffer).collect::<Result<_>>()?;
            self.still = Some(StillPoses { vertices: vec![expected; heads], buffers });
        }
        if let Some(still) = &mut self.still {
            still.vertices[head].copy_from_slice(vertices);
        }
        Ok(())
    }

    fn set_poses(&mut self, slot: usize, poses: Poses<'_>) -> Result<()> {
        if let (Some(stepped), Some(crowd)) = (&mut self.stepped, &mut self.crowd) {
            stepped.write(slot, crowd)?;
        }
        if let Some(StillPoses { vertices, buffers }) = &mut self.still {
            let size = size_of_val(&*vertices[0]);
            vertices.iter().enumerate().for_each(|(i, head)| buffers[slot].write(i * size, cast_slice(head)));
        }
        match (poses, &mut self.crowd, &mut self.frames[slot].poses) {
            (Poses::Weights(weights), Some(crowd), _) => {
                for (i, weights) in (0..).zip(weights) {
                    crowd.set_weights(i, weights)?;
                }
            }
            (Poses::Stored(stored), None, Some(buffer)) => {
                let poses = 2 + usize::from(self.masks.is_some());
                let room = buffer.contents().len() / poses / stored.len().max(1);
                for (i, StoredPose { pose, masks, .. }) in stored.iter().enumerate() {
                    let masks = masks.filter(|_| self.masks.is_some());
                    let masks = masks.map(|(masks, _)| (masks, 2 * stored.len() + i));
                    for (bytes, at) in std::iter::once((*pose, i)).chain(masks) {
                        if bytes.len() > room {
                            return Err(Error::Invalid {
                                what: format!("a pose of {} bytes, {room} expected", bytes.len()),
                                remedy: "give poses of the mesh, as CpuCrowd::stored_pose returns them".into(),
                            });
                        }
                        buffer.write(at * room, bytes);
                    }
                }
                // The first picture has no previous poses.
                if self.last.is_empty() {
                    self.last = buffer.contents()[..room * stored.len()].to_vec();
                }
                buffer.write(room * stored.len(), &self.last);
                self.last.copy_from_slice(&buffer.contents()[..room * stored.len()]);
            }
            _ => {
                return Err(Error::Invalid {
                    what: "poses of another kind than the studio was made for".into(),
                    remedy: "give stored poses on the path cpu, otherwise weights".into(),
                });
            }
        }
        Ok(())
    }

    fn record(
        &mut self,
        slot: usize,
        poses: Poses<'_>,
        places: &[Mat4],
        scene: &Scene,
        background: [f32; 4],
        ticket: &mut Option<Ticket>,
    ) -> Result<()> {
        let Self { headless, frames, crowd, stepped, still, glow, bounds, masks, model, renderer, desc, .. } = self;
        let Frame { target, image, pixels, poses: stored, cmd, .. } = &mut frames[slot];
        let (cmd, device) = (*cmd, &renderer.gpu.device);
        if let Some(crowd) = crowd {
            // SAFETY: `cmd` is recording on the engine's device, outside a render pass; it is submitted once, in order,
            // or the ticket is discarded; at most `in_flight` of the recorded updates are unfinished; everything lives
            // until `drop`.
            let update = unsafe { headless.engine().record_update(cmd, crowd) }?;
            *ticket = Some(update.ticket);
            bounds.iter_mut().for_each(|bounds| bounds.updated(&update.stats));
        }
        for (i, glow) in glow.iter_mut().enumerate() {
            match (&*crowd, poses) {
                (Some(crowd), _) => glow.update(&crowd.changed(i as u32), desc.afterglow),
                (None, Poses::Stored(stored)) => glow.update(stored[i].changed, desc.afterglow),
                (None, Poses::Weights(_)) => {}
            }
            if scene.show == Show::Blocks {
                // SAFETY: the target's last picture has been waited for.
                unsafe { target.set_glow(i, glow) }?;
            }
        }
        let place_of = |(i, place): (usize, &Mat4)| match (&*crowd, &*stored, poses) {
            (Some(crowd), _, _) => {
                let previous = crowd.previous_pose(i as u32)?;
                if let (Some(_), Show::Motion(_)) = (&stepped, scene.show) {
                    return Err(Error::Invalid {
                        what: "motion of what a step after the pose writes".into(),
                        remedy: "show the motion of poses, without a step".into(),
                    });
                }
                if let (None, Show::Motion(_)) = (&previous, scene.show) {
                    return Err(Error::Invalid {
                        what: "the previous pose, which the update has overwritten".into(),
                        remedy: "use two slots or more; three on the path feedback".into(),
                    });
                }
                let masks = masks.map(|_| crowd.stream(i as u32, Semantic::Mask)).transpose()?;
                let head = Head::new(&crowd.pose(i as u32)?, *place).previous(previous.as_ref());
                let bounds = bounds.as_ref().map(|bounds| Ok::<_, Error>(bounds.of(crowd.weights(i as u32)?)));
                let head = head.masks(masks.as_ref().map(Masks::new)).bounds(bounds.transpose()?);
                let still = still.as_ref().map(|still| (still.buffers[slot].raw, i * size_of_val(&*still.vertices[0])));
                let head = Head { still: still.map(|(buffer, offset)| (buffer, offset as u64)), ..head };
                Ok(stepped.as_ref().map_or(head, |stepped| stepped.head(i, head)))
            }
            (None, Some(buffer), Poses::Stored(stored)) => {
                let all = buffer.contents().len() / (2 + usize::from(masks.is_some()));
                let (buffer, offset, all) = (buffer.raw, (i * (all / places.len())) as u64, all as u64);
                let StoredPose { units, masks: own, .. } = stored[i];
                let masks = masks.zip(own).map(|(place, (_, units))| {
                    let offset = offset + 2 * all + place.offset(desc.update.pose);
                    Masks { buffer, offset, units: place.units(units) }
                });
                let previous = (buffer, offset + all);
                Ok(Head { buffer, offset, units, place: *place, previous, masks, bounds: None, still: None })
            }
            (None, ..) => Err(Error::Invalid { what: "no poses".into(), remedy: "give stored poses".into() }),
        };
        let heads = places.iter().enumerate().map(place_of).collect::<Result<Vec<_>>>()?;
        // SAFETY: `cmd` is recording; model and target are the renderer's, and the target's last picture has been
        // waited for; the poses are of the mesh, ready (the update has a barrier, and host writes are visible to later
        // submissions), and alive until `drop`.
        self.draws = unsafe { renderer.record(cmd, target, model, &heads, scene, background) }?;
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let extent = vk::Extent3D { width: desc.size[0], height: desc.size[1], depth: 1 };
        let region = [vk::BufferImageCopy::default().image_subresource(layer).image_extent(extent)];
        let read = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ)];
        let (copy, host) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::HOST);
        // SAFETY: the image is in this layout after the pass, and has as many pixels as the buffer.
        unsafe {
            let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            device.cmd_copy_image_to_buffer(cmd, image.raw, layout, pixels.raw, &region);
            device.cmd_pipeline_barrier(cmd, copy, host, Default::default(), &read, &[], &[]);
        }
        Ok(())
    }

    fn submit(&self, slot: usize) -> Result<()> {
        let (device, Frame { cmd, fence, .. }) = (self.headless.handles().2, &self.frames[slot]);
        let info = vk::SubmitInfo::default().command_buffers(from_ref(cmd));
        // SAFETY: recorded above; the fence is not in use; `Headless` is used by one thread at a time.
        unsafe {
            device.reset_fences(from_ref(fence)).map_err(failed("vkResetFences"))?;
            device.queue_submit(self.headless.queue().0, from_ref(&info), *fence).map_err(failed("vkQueueSubmit"))
        }
    }

    /// Waits for the oldest picture that is being drawn.
    fn next_finished(&mut self) -> Result<Option<Picture>> {
        let Some(&slot) = self.pending.front() else { return Ok(None) };
        let frame = &self.frames[slot];
        // SAFETY: the fence was submitted.
        let waited = unsafe { self.headless.handles().2.wait_for_fences(&[frame.fence], true, u64::MAX) };
        waited.map_err(failed("vkWaitForFences"))?;
        self.pending.pop_front();
        Ok(Some(Picture { size: self.desc.size, rgba: frame.pixels.contents().to_vec() }))
    }

    /// Returns the numbers of draws of the last picture begun: recorded, and skipped by culling ([`StudioDesc::cull`]).
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

/// Returns the bytes of a stored pose, padding included.
fn stored_bytes(packed: &PackedMesh, pose: PoseFormat) -> usize {
    packed.layout().base_bytes() as usize / PoseFormat::Float32.stride() * pose.stride()
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
