//! The heads of a picture: a crowd on the device or on the processor, and what is drawn of it.

use crate::cull::PoseBounds;
use crate::glow::Glow;
use crate::memory::{Buffer, buffer, write};
use crate::model::Model;
use crate::normals::Normals;
use crate::parts::Part;
use crate::renderer::Renderer;
use crate::scene::{Head, Masks, Scale, Scene, Show};
use crate::target::Target;
use crate::wrinkles::MaskPlace;
use deltamorph::ash::vk;
use deltamorph::{
    Bounds, CpuCrowd, Crowd, CrowdDesc, Error, GpuMesh, KeptMesh, MorphEngine, PackedMesh, PoseFormat, Result,
    Semantic, Ticket, UpdateDesc, UpdatePath, UpdateStats,
};
use deltamorph_headless::Headless;
use glam::Mat4;
use std::sync::Arc;

/// Options of [`Heads`].
#[derive(Clone, Copy, Debug)]
pub struct HeadsDesc<'a> {
    /// Number of heads (≥ 1).
    pub count: u32,
    /// Updates of the poses.
    pub update: UpdateDesc,
    /// Threads of the path `cpu`; 0: one per core.
    pub threads: usize,
    /// Draw normals of the morphed surface in place of sums of the targets' normal deltas, on the paths of the device.
    pub recompute_normals: bool,
    /// A mesh and its parts that are drawn with each head: it stands as it is, relative to the head, without a pose.
    pub still: Option<(&'a KeptMesh, &'a [Part])>,
    /// For [`Show::Blocks`]: the fraction of its brightness that a changed vertex keeps from one update to the next, 0
    /// to 1.
    pub afterglow: f32,
    /// Skip heads that are not in the picture. Takes some memory, and time to compute bounds.
    pub cull: bool,
}

impl HeadsDesc<'_> {
    /// One head.
    pub fn new(update: UpdateDesc) -> Self {
        Self { count: 1, update, threads: 0, recompute_normals: false, still: None, afterglow: 0.0, cull: false }
    }
}

/// A recorded update.
#[derive(Clone, Copy, Debug)]
pub struct Updated {
    /// Its counts.
    pub stats: UpdateStats,
    ticket: Option<Ticket>,
}

/// Heads of one mesh, to be drawn: on the device, from the buffers of a crowd; on the path `cpu`,
/// from buffers that the poses are copied to.
pub struct Heads {
    desc: HeadsDesc<'static>,
    poses: Poses,
    normals: Option<Normals>,
    glow: Vec<Glow>,
    /// For culling: bounds of poses, and of each head.
    bounds: Option<(PoseBounds, Vec<Bounds>)>,
    /// Location of the wrinkle masks, if the mesh has any.
    masks: Option<MaskPlace>,
    model: Model,
    pub(crate) renderer: Renderer,
    // Declared after the model, which reads it.
    _uploaded: GpuMesh,
}

/// The crowd that updates the poses.
enum Poses {
    Device(Box<Crowd>),
    Processor(Box<Processor>),
}

/// A crowd on the path `cpu`.
struct Processor {
    crowd: CpuCrowd,
    /// The poses, those of the update before, and the group with the masks, if any.
    buffer: Buffer,
    /// The poses of the last update.
    last: Vec<u8>,
    /// Of the poses, and of the group with the masks.
    scale: [Scale; 2],
}

impl Heads {
    /// Makes heads of `mesh`, which was packed as `packed` and consists of `parts`.
    ///
    /// # Errors
    /// The path has no pose buffers; the engine refuses the crowd; normals are to be recomputed on the path `cpu`, or
    /// beside wrinkle masks of integers; there is no memory.
    ///
    /// # Safety
    /// The device outlives the heads, which are dropped after their targets, and only when no commands recorded with
    /// them are still to run.
    pub unsafe fn new(
        headless: &Headless,
        mesh: &KeptMesh,
        packed: &Arc<PackedMesh>,
        parts: &[Part],
        desc: &HeadsDesc<'_>,
    ) -> Result<Self> {
        let HeadsDesc { count, update, recompute_normals, still, cull, .. } = *desc;
        let path = update.path;
        if path.evaluates_in_draws() {
            return Err(Error::invalid(
                format!("the path '{}' evaluates poses in its own draws, and has none to draw", path.name()),
                "use blocks, compute or cpu",
            ));
        }
        let masks = MaskPlace::of(packed);
        if recompute_normals && (path == UpdatePath::Cpu || masks.is_some() && update.pose.has_integers()) {
            return Err(Error::invalid(
                format!("recomputed normals of {} poses on the path '{}'", update.pose.name(), path.name()),
                "use a path on the device, and float32 poses where there are wrinkle masks",
            ));
        }
        let engine = headless.engine();
        // SAFETY: `upload` hands out a recording buffer of the engine's device, and waits for it.
        let uploaded = headless.upload(|cmd| unsafe { engine.upload(cmd, packed) })?;
        // Recomputed normals are float32.
        let pose = if recompute_normals { PoseFormat::Float32 } else { update.pose };
        // SAFETY: the device outlives the heads: the caller's obligation.
        let renderer = unsafe { Renderer::new(headless, pose, masks.is_some()) }?;
        // SAFETY: fields drop in order, the model before the mesh that it reads.
        let mut model = unsafe { Model::new(&renderer, mesh, packed.layout(), parts) }?;
        still.map_or(Ok(()), |(mesh, parts)| model.set_still(&renderer, mesh, parts))?;
        let mut normals = None;
        let poses = if path == UpdatePath::Cpu {
            Poses::Processor(Box::new(Processor::new(&renderer, packed, desc, masks)?))
        } else {
            let crowd = CrowdDesc { instances: count, frames_in_flight: 1, ..CrowdDesc::new(update) };
            let mut crowd = Box::new(engine.create_crowd(&uploaded, &crowd)?);
            if recompute_normals {
                normals = Some(Normals::new(headless, &renderer.gpu, packed, &mut crowd)?);
            }
            Poses::Device(crowd)
        };
        let bounds = if cull { Some((PoseBounds::new(packed, &update)?, vec![])) } else { None };
        Ok(Self {
            desc: HeadsDesc { still: None, ..*desc },
            poses,
            normals,
            glow: vec![Glow::new(packed.layout()); count as usize],
            bounds,
            masks,
            model,
            renderer,
            _uploaded: uploaded,
        })
    }

    /// Makes a target for these heads, of this width and height (≥ 1).
    ///
    /// # Errors
    /// It is larger than the device draws; there is no memory.
    ///
    /// # Safety
    /// The target is dropped before the heads, and only when no commands recorded with it are still to run.
    pub unsafe fn target(&self, size: [u32; 2]) -> Result<Target> {
        Target::new(&self.renderer, size, self.desc.count)
    }

    /// Updates every head to `weights[head]`: records into `cmd`, or updates at once on the path `cpu`.
    ///
    /// # Errors
    /// Another number of weights than of heads; weights that are not valid; the device fails.
    ///
    /// # Safety
    /// - `cmd` is recording on the device of the engine, outside a render pass, on a queue with compute; it runs once,
    ///   in the order of recording, or the update is [discarded](Self::discard).
    /// - The commands of the update before, and of draws of it, have finished.
    pub unsafe fn update(
        &mut self,
        engine: &MorphEngine,
        cmd: vk::CommandBuffer,
        weights: &[impl AsRef<[f32]>],
    ) -> Result<Updated> {
        if weights.len() != self.desc.count as usize {
            return Err(Error::invalid(
                format!("{} poses for {} heads", weights.len(), self.desc.count),
                "give the weights of every head",
            ));
        }
        let (stats, ticket) = match &mut self.poses {
            Poses::Device(crowd) => {
                for (head, weights) in (0..).zip(weights) {
                    crowd.set_weights(head, weights.as_ref())?;
                }
                // SAFETY: the caller's obligations.
                let update = unsafe { engine.record_update(cmd, crowd) }?;
                (update.stats, Some(update.ticket))
            }
            Poses::Processor(processor) => {
                for (head, weights) in (0..).zip(weights) {
                    processor.crowd.set_weights(head, weights.as_ref())?;
                }
                (processor.crowd.update(), None)
            }
        };
        if let Some((bounds, heads)) = &mut self.bounds {
            bounds.updated(&stats);
            *heads = weights.iter().map(|weights| bounds.of(weights.as_ref())).collect();
        }
        for (head, glow) in (0..).zip(&mut self.glow) {
            let changed = match &mut self.poses {
                // An update that moved nothing changed nothing.
                _ if stats.bytes_moved == 0 => vec![],
                Poses::Device(crowd) => crowd.changed(head),
                Poses::Processor(processor) => processor.crowd.changed(head),
            };
            glow.update(&changed, self.desc.afterglow);
        }
        if let Poses::Processor(processor) = &mut self.poses {
            processor.write(self.desc.count, self.masks)?;
        }
        Ok(Updated { stats, ticket })
    }

    /// Takes back an update whose commands will never run.
    ///
    /// # Errors
    /// The update is that of other heads.
    pub fn discard(&mut self, updated: &Updated) -> Result<()> {
        match (&mut self.poses, updated.ticket) {
            (Poses::Device(crowd), Some(ticket)) => crowd.discard(ticket),
            _ => Ok(()),
        }
    }

    /// Whether [`Show::Motion`] has something to show: previous poses, without recomputed normals.
    ///
    /// # Errors
    /// Nothing was updated yet.
    pub fn has_previous(&self) -> Result<bool> {
        match &self.poses {
            Poses::Device(crowd) => Ok(self.normals.is_none() && crowd.previous_pose(0)?.is_some()),
            Poses::Processor(_) => Ok(true),
        }
    }

    /// Records draws of all heads, at `places`, into `target`, in front of `background` (linear red, green, blue, and
    /// opacity; colours are multiplied by it): a pass into the target's shadow map, and one into its image, ready for
    /// copies (`TRANSFER`) and for draws over it (`COLOR_ATTACHMENT_OUTPUT`). Returns the numbers of recorded and of
    /// skipped draws.
    ///
    /// # Errors
    /// Another number of places than of heads; wrinkles of a mesh without masks; nothing was updated yet.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer that is recording on the device, outside a render pass, on a queue with
    ///   graphics, after the last [update](Self::update).
    /// - The target was made with these heads, and no commands recorded with it before are still to run.
    pub unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        target: &mut Target,
        places: &[Mat4],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<[usize; 2]> {
        if places.len() != self.desc.count as usize {
            return Err(Error::invalid(
                format!("{} places for {} heads", places.len(), self.desc.count),
                "give one for every head",
            ));
        }
        if scene.show == Show::Wrinkles && self.masks.is_none() {
            return Err(Error::invalid(
                "wrinkles of a mesh without masks",
                "add masks with wrinkles::add before the mesh is packed",
            ));
        }
        if scene.show == Show::Blocks {
            for (head, glow) in self.glow.iter().enumerate() {
                // SAFETY: the caller's obligations.
                unsafe { target.set_glow(head, glow) }?;
            }
        }
        let heads = places.iter().enumerate().map(|(i, place)| self.head(i, *place));
        let heads = heads.collect::<Result<Vec<_>>>()?;
        // SAFETY: the caller's obligations; model and target are the renderer's; the poses are of the mesh, and ready:
        // the update has a barrier, and writes of the host are visible to later submissions.
        unsafe { self.renderer.record(cmd, target, &self.model, &heads, scene, background) }
    }

    /// Returns a head to draw.
    fn head(&self, number: usize, place: Mat4) -> Result<Head> {
        let bounds = self.bounds.as_ref().map(|(_, heads)| heads[number]);
        let crowd = match &self.poses {
            Poses::Device(crowd) => crowd,
            Poses::Processor(processor) => return Ok(Head { bounds, ..processor.head(number, place, self) }),
        };
        let pose = crowd.pose(number as u32)?;
        let previous = crowd.previous_pose(number as u32)?.unwrap_or(pose);
        let stream = self.masks.map(|_| crowd.stream(number as u32, Semantic::Mask)).transpose()?;
        let head = Head {
            buffer: pose.buffer,
            offset: pose.offset,
            scale: Scale { scale: pose.units, offsets: pose.offsets },
            place,
            previous: (previous.buffer, previous.offset),
            masks: stream.map(|stream| Masks {
                buffer: stream.buffer,
                offset: stream.offset,
                scale: {
                    let [x, y, ..] = stream.units;
                    [x, y, stream.offsets[0], stream.offsets[1]]
                },
            }),
            bounds,
        };
        Ok(self.normals.as_ref().map_or(head, |normals| normals.head(number, head)))
    }
}

impl Processor {
    fn new(
        renderer: &Renderer,
        packed: &Arc<PackedMesh>,
        desc: &HeadsDesc<'_>,
        masks: Option<MaskPlace>,
    ) -> Result<Self> {
        let HeadsDesc { count, update, threads, .. } = *desc;
        let crowd = CpuCrowd::new(packed.clone(), &CrowdDesc { instances: count, ..CrowdDesc::new(update) }, threads)?;
        let bytes = count as usize * crowd.stored_pose(0, 0)?.len();
        let bytes = bytes * if masks.is_some() { 3 } else { 2 };
        let scale = |group: usize| -> Result<Scale> {
            let grid = update.grid(packed.groups()[group].layout())?;
            Ok(grid.map_or(Scale::ONE, |grid| Scale { scale: grid.units, offsets: grid.offsets }))
        };
        Ok(Self {
            crowd,
            buffer: buffer(&renderer.gpu, bytes, vk::BufferUsageFlags::VERTEX_BUFFER)?,
            last: vec![],
            scale: [scale(0)?, scale(masks.map_or(0, |place| place.group))?],
        })
    }

    /// Copies the poses to the buffer.
    fn write(&mut self, heads: u32, masks: Option<MaskPlace>) -> Result<()> {
        let mut poses = vec![];
        let mut folds = vec![];
        for head in 0..heads {
            poses.extend_from_slice(self.crowd.stored_pose(head, 0)?);
            if let Some(place) = masks {
                folds.extend_from_slice(self.crowd.stored_pose(head, place.group)?);
            }
        }
        // The first poses have no previous ones.
        let before = if self.last.is_empty() { &poses } else { &self.last };
        write(&mut self.buffer, 0, &[&poses, before, &folds].map(Vec::as_slice).concat())?;
        self.last = poses;
        Ok(())
    }

    fn head(&self, number: usize, place: Mat4, heads: &Heads) -> Head {
        let buffer = self.buffer.raw;
        let all = self.last.len() as u64;
        let offset = number as u64 * (all / u64::from(heads.desc.count));
        let masks = heads.masks.map(|place| Masks {
            buffer,
            offset: offset + 2 * all + place.offset(heads.desc.update.pose),
            scale: self.scale[1].of_masks(place.first),
        });
        Head { buffer, offset, scale: self.scale[0], place, previous: (buffer, offset + all), masks, bounds: None }
    }
}
