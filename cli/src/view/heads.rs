//! The instances in the window: their mesh on the device, and the crowd that updates their poses.

use super::device::Device;
use crate::output::Failure;
use crate::render::scenery::Subject;
use deltamorph::Bounds;
use deltamorph::after::SkinDesc;
use deltamorph::ash::vk;
use deltamorph::{
    BatchSize, CpuCrowd, Crowd, CrowdDesc, DeltaFormat, GpuMesh, MorphMesh, PackedMesh, PoseFormat, Semantic,
    UpdateDesc, UpdateMode, UpdatePath, UpdateStats,
};
use deltamorph_render::wrinkles::MaskPlace;
use deltamorph_render::{
    Buffer, Glow, Head, Masks, Model, PoseBounds, Renderer, RendererDesc, Show, Stepped, StoredPose, Target,
};
use glam::Mat4;
use std::sync::Arc;
use std::time::Instant;

/// Frames in flight.
pub const IN_FLIGHT: usize = 2;
/// Share of the glow of a written block that remains after each frame.
const AFTERGLOW: f32 = 0.88;
/// Frames between measured full evaluations while a clip plays.
const FULL_EVERY: u32 = 24;
/// Most bytes of deltas for a full evaluation.
const FULL_BYTES: usize = 1 << 30;
/// Bytes of a vertex of still parts: position and normal.
const STILL_BYTES: usize = 24;

/// The instances, all updated in the same way.
pub struct Heads {
    pub mesh: Arc<PackedMesh>,
    pub desc: UpdateDesc,
    pub renderer: Renderer,
    pub places: Vec<Mat4>,
    /// The largest weight that updates take, either sign.
    pub weight_max: f32,
    pub model: Model,
    who: Who,
    /// The skin of poses on the device.
    skin: Option<Stepped>,
    /// Vertices of the still parts of each instance that joints move, by frame in flight; the bytes of an instance.
    still: Vec<Buffer>,
    moved: usize,
    glow: Vec<Glow>,
    /// With several instances, bounds of poses, and of each instance in this frame.
    bounds: Option<(PoseBounds, Vec<Bounds>)>,
    /// With an error budget, the first instance on the processor, with it and without: what it saves.
    saving: Option<[Box<CpuCrowd>; 2]>,
    /// Location of wrinkle masks in stored poses, if they are shown.
    masks: Option<MaskPlace>,
    // Read by the model, so dropped after it.
    _uploaded: GpuMesh,
}

/// The crowd that updates the poses.
enum Who {
    Device(Box<Crowd>),
    /// The path `cpu`. A buffer for each frame in flight holds its poses, then those of the frame before, then the
    /// group with the masks, if any.
    Processor {
        crowd: Box<CpuCrowd>,
        buffers: Vec<Buffer>,
        last: Vec<u8>,
        /// Units of positions and normals, and of the group with the masks.
        units: ([f32; 2], [f32; 2]),
    },
}

/// Cost of an update.
pub struct Took {
    pub stats: UpdateStats,
    /// Processor time of weights, plan and recording; on the path `cpu`, of the whole update.
    pub cpu_ms: f64,
    /// With an error budget, bytes that an update of the first instance moves on the path `cpu`, with it and without.
    pub budget: Option<[u64; 2]>,
}

impl Heads {
    /// Creates an instance at each of `places`, drawn into images of `format`; `skin` moves poses that are on the device.
    pub fn new(
        device: &Device,
        pool: vk::CommandPool,
        format: vk::Format,
        (mesh, subject): (&MorphMesh, &Subject),
        (packed, desc, skin): (Arc<PackedMesh>, UpdateDesc, Option<SkinDesc<'_>>),
        threads: usize,
        places: Vec<Mat4>,
    ) -> Result<Self, Failure> {
        if desc.path.evaluates_in_draws() {
            let path = desc.path.name();
            let text = format!("the path '{path}' evaluates in draws of its own, and has no pose to draw; use blocks");
            return Err(Failure::Usage(text));
        }
        let uploaded = upload(device, pool, &packed)?;
        let layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        let skin = skin.filter(|_| desc.path != UpdatePath::Cpu);
        let masks = MaskPlace::of(&packed).filter(|_| skin.is_none());
        // Skinning writes float32.
        let pose = if skin.is_some() { PoseFormat::Float32 } else { desc.pose };
        let renderer = RendererDesc { format, layout, pose, masks: masks.is_some() };
        // SAFETY: the handles belong together; the window waits, and drops the instances before the device.
        let renderer = unsafe { Renderer::new(device.instance(), device.physical(), device.raw(), &renderer) }?;
        // SAFETY: fields drop in order, the model before the mesh that it reads.
        let mut model = unsafe { Model::new(&renderer, mesh, packed.layout(), &uploaded, &subject.parts) }?;
        if let Some(still) = &subject.still {
            model.set_still(&renderer, &still.mesh, &still.parts)?;
        }
        let (mut skinned, mut still) = (None, vec![]);
        let who = if desc.path == UpdatePath::Cpu {
            let crowd = Box::new(CpuCrowd::new(packed.clone(), desc, places.len() as u32, threads)?);
            let poses = 2 + usize::from(masks.is_some());
            let bytes = places.len() * crowd.stored_pose(0, 0)?.len();
            // SAFETY: a buffer is written after its frame was waited for, and dropped after all were.
            let buffer = |_| unsafe { renderer.buffer(poses * bytes, vk::BufferUsageFlags::VERTEX_BUFFER) };
            let buffers = (0..IN_FLIGHT).map(buffer).collect::<deltamorph::Result<_>>()?;
            let units = StoredPose::new(&crowd, 0, (&packed, &desc), &[])?;
            let units = (units.units, units.masks.map_or([1.0; 2], |(_, units)| units));
            Who::Processor { crowd, buffers, last: vec![], units }
        } else {
            let crowd = CrowdDesc::new(desc).instances(places.len() as u32).frames_in_flight(IN_FLIGHT as u32);
            let mut crowd = Box::new(device.engine.create_crowd(&uploaded, &crowd)?);
            if let Some(desc) = skin {
                // SAFETY: `run` passes a recording buffer of the engine's device, and waits for it.
                let mut skin = device.run(pool, |cmd| unsafe { device.engine.upload_skin(cmd, &packed, &desc) })?;
                let joints = desc.joint_count;
                // SAFETY: the upload has finished; no update is running, and the window waits before it drops heads.
                skinned = Some(unsafe {
                    skin.release_staging();
                    renderer.skinned(&device.engine, &packed, &mut crowd, (&skin, joints), IN_FLIGHT)
                }?);
                let vertices = subject.still.as_ref().map_or(0, |still| still.mesh.vertex_count());
                let bytes = (places.len() * vertices * STILL_BYTES).max(4);
                // SAFETY: a buffer is written after its frame was waited for, and dropped after all were.
                let buffer = |_| unsafe { renderer.buffer(bytes, vk::BufferUsageFlags::VERTEX_BUFFER) };
                still = (0..IN_FLIGHT).map(buffer).collect::<deltamorph::Result<_>>()?;
            }
            Who::Device(crowd)
        };
        let glow = vec![Glow::new(packed.layout()); places.len()];
        let bounds = if places.len() > 1 { Some((PoseBounds::new(&packed, &desc)?, vec![])) } else { None };
        let twin = |budget| {
            let desc = desc.path(UpdatePath::Cpu).error_budget(budget);
            CpuCrowd::new(packed.clone(), desc, 1, threads).map(Box::new)
        };
        let saving = (desc.error_budget > 0.0).then(|| Ok::<_, Failure>([twin(desc.error_budget)?, twin(0.0)?]));
        let saving = saving.transpose()?;
        // Poses of floats have no grid, and take what the library takes.
        let weight_max = packed.layout().grid(desc.pose, desc.weight_max).map_or(1e6, |grid| grid.weight_max);
        Ok(Self {
            saving,
            weight_max,
            mesh: packed,
            desc,
            renderer,
            places,
            model,
            who,
            skin: skinned,
            still,
            moved: 0,
            glow,
            bounds,
            masks,
            _uploaded: uploaded,
        })
    }

    /// Updates every instance to `weights[head]`; if poses are skinned, to `joints[head]`, with still parts at
    /// `still[head]`. Records into `cmd` for frame in
    /// flight `frame`, which was waited for.
    pub fn update(
        &mut self,
        device: &Device,
        cmd: vk::CommandBuffer,
        frame: usize,
        [weights, joints, still]: [&[Vec<f32>]; 3],
    ) -> Result<Took, Failure> {
        let start = Instant::now();
        let stats = match &mut self.who {
            Who::Device(crowd) => {
                if let Some(skin) = &mut self.skin {
                    joints.iter().enumerate().for_each(|(head, joints)| _ = skin.set_joints(head, joints));
                    skin.write(frame, crowd)?;
                    self.moved = still.first().map_or(0, |vertices| size_of_val(&**vertices));
                    for (head, vertices) in still.iter().enumerate() {
                        let bytes: Vec<u8> = vertices.iter().flat_map(|number| number.to_ne_bytes()).collect();
                        self.still[frame].write(head * self.moved, &bytes);
                    }
                }
                for (head, weights) in (0..).zip(weights) {
                    crowd.set_weights(head, weights)?;
                }
                // SAFETY: `cmd` is recording on the engine's device, outside a render pass; frames are submitted once,
                // in order, after a wait for the one `IN_FLIGHT` ago. If submission fails, the window closes.
                unsafe { device.engine.record_update(cmd, &mut **crowd) }?.stats
            }
            Who::Processor { crowd, .. } => {
                for (head, weights) in (0..).zip(weights) {
                    crowd.set_weights(head, weights)?;
                }
                crowd.update()
            }
        };
        let cpu_ms = start.elapsed().as_secs_f64() * 1e3;
        if let Some((bounds, heads)) = &mut self.bounds {
            bounds.updated(&stats);
            *heads = weights.iter().map(|weights| bounds.of(weights)).collect();
        }
        for (head, glow) in (0..).zip(&mut self.glow) {
            let changed = match &self.who {
                // An update that recorded nothing changed nothing.
                _ if stats.bytes_moved == 0 => vec![],
                Who::Device(crowd) => crowd.changed(head),
                Who::Processor { crowd, .. } => crowd.changed(head),
            };
            glow.update(&changed, AFTERGLOW);
        }
        if let Who::Processor { crowd, buffers, last, .. } = &mut self.who {
            let (mut poses, mut masks) = (vec![], vec![]);
            for head in 0..weights.len() as u32 {
                poses.extend_from_slice(crowd.stored_pose(head, 0)?);
                if let Some(place) = self.masks {
                    masks.extend_from_slice(crowd.stored_pose(head, place.group)?);
                }
            }
            let before = if last.is_empty() { &poses } else { &*last };
            buffers[frame].write(poses.len(), before);
            buffers[frame].write(0, &poses);
            buffers[frame].write(2 * poses.len(), &masks);
            *last = poses;
        }
        let moved = |crowd: &mut Box<CpuCrowd>| -> Result<u64, Failure> {
            crowd.set_weights(0, &weights[0])?;
            Ok(crowd.update().bytes_moved)
        };
        let budget = self.saving.as_mut().map(|[with, without]| Ok::<_, Failure>([moved(with)?, moved(without)?]));
        Ok(Took { stats, cpu_ms, budget: budget.transpose()? })
    }

    /// The instances to draw in frame in flight `frame`, into a target whose last frame was waited for.
    pub fn drawn(&self, frame: usize, target: &mut Target, show: Show) -> Result<Vec<Head>, Failure> {
        if show == Show::Blocks {
            for (head, glow) in self.glow.iter().enumerate() {
                // SAFETY: the target's last frame was waited for: the caller's obligation.
                unsafe { target.set_glow(head, glow) }?;
            }
        }
        let bounds = |head: usize| self.bounds.as_ref().map(|(_, heads)| heads[head]);
        let head = |(i, place): (usize, &Mat4)| match &self.who {
            Who::Device(crowd) => {
                let previous = crowd.previous_pose(i as u32)?;
                let masks = self.masks.map(|_| crowd.stream(i as u32, Semantic::Mask)).transpose()?;
                let head = Head::new(&crowd.pose(i as u32)?, *place).previous(previous.as_ref());
                let head = head.masks(masks.as_ref().map(Masks::new)).bounds(bounds(i));
                let still = self.still.get(frame).filter(|_| self.moved > 0);
                let head = Head { still: still.map(|buffer| (buffer.raw(), (i * self.moved) as u64)), ..head };
                Ok(self.skin.as_ref().map_or(head, |skin| skin.head(i, head)))
            }
            Who::Processor { buffers, last, units: (units, mask_units), .. } => {
                let (buffer, stride) = (buffers[frame].raw(), last.len() / self.places.len());
                let (offset, previous) = ((i * stride) as u64, (last.len() + i * stride) as u64);
                let masks = self.masks.map(|place| {
                    let offset = offset + 2 * last.len() as u64 + place.offset(self.desc.pose);
                    Masks { buffer, offset, units: place.units(*mask_units) }
                });
                let (previous, bounds) = ((buffer, previous), bounds(i));
                Ok(Head { buffer, offset, units: *units, place: *place, previous, masks, bounds, still: None })
            }
        };
        self.places.iter().enumerate().map(head).collect()
    }
}

/// Evaluates one instance in full, all active targets from the base pose in float32, as other engines do each frame.
pub struct Full {
    crowd: Crowd,
    /// Weights of the last evaluation, and frames since then.
    last: (Vec<f32>, u32),
    _uploaded: GpuMesh,
}

impl Full {
    /// `None` if the device lacks the path, or the deltas are too large to hold twice.
    pub fn new(device: &Device, pool: vk::CommandPool, mesh: &MorphMesh) -> Result<Option<Self>, Failure> {
        let bytes = mesh.vertex_count().saturating_mul(mesh.targets.len()).saturating_mul(24);
        let path = UpdatePath::Compute;
        if bytes > FULL_BYTES || mesh.targets.is_empty() || device.engine.caps().check_path(path).is_err() {
            return Ok(None);
        }
        let format = DeltaFormat::Float32;
        let batch = if path.takes_all_targets() {
            BatchSize::All
        } else {
            device.engine.caps().batch_max(path, format).map_or(BatchSize::All, BatchSize::Targets)
        };
        let packed = PackedMesh::pack(mesh, &device.engine.pack_desc(format))?;
        let uploaded = upload(device, pool, &packed)?;
        let update = UpdateDesc::new(path, batch).mode(UpdateMode::Rebuild);
        let desc = CrowdDesc::new(update).frames_in_flight(IN_FLIGHT as u32);
        let crowd = device.engine.create_crowd(&uploaded, &desc)?;
        Ok(Some(Self { crowd, last: (vec![], 0), _uploaded: uploaded }))
    }

    /// Whether to measure an evaluation: if weights have changed; while a clip plays, only every `FULL_EVERY` frames.
    pub fn is_due(&mut self, weights: &[f32], playing: bool) -> bool {
        let (last, frames) = &mut self.last;
        *frames += 1;
        let moves = weights.iter().any(|weight| *weight != 0.0);
        let due = moves && last != weights && (!playing || *frames >= FULL_EVERY || last.is_empty());
        if due {
            self.last = (weights.to_vec(), 0);
        }
        due
    }

    /// Evaluates, under the same conditions as [`Heads::update`].
    pub fn update(&mut self, device: &Device, cmd: vk::CommandBuffer, weights: &[f32]) -> Result<UpdateStats, Failure> {
        self.crowd.set_weights(0, weights)?;
        // SAFETY: as in `Heads::update`.
        Ok(unsafe { device.engine.record_update(cmd, &mut self.crowd) }?.stats)
    }
}

fn upload(device: &Device, pool: vk::CommandPool, packed: &PackedMesh) -> Result<GpuMesh, Failure> {
    // SAFETY: `run` passes a recording buffer of the engine's device, and waits for it.
    let mut uploaded = device.run(pool, |cmd| unsafe { device.engine.upload(cmd, packed) })?;
    // SAFETY: the upload has finished.
    unsafe { uploaded.release_staging() };
    Ok(uploaded)
}
