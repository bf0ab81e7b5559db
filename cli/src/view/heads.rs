//! The instance in the window: its mesh on the device, and what updates and draws it; and a full evaluation beside it.

use super::device::Device;
use crate::output::Failure;
use crate::render::scenery::Subject;
use deltamorph::after::SkinDesc;
use deltamorph::ash::vk;
use deltamorph::{
    BatchSize, Crowd, CrowdDesc, DeltaFormat, GpuMesh, MorphMesh, PackedMesh, UpdateDesc, UpdateMode, UpdatePath,
    UpdateStats,
};
use deltamorph_headless::Headless;
use deltamorph_render::{self as render, HeadsDesc, Step};
use std::sync::Arc;

/// Frames in flight.
pub const IN_FLIGHT: usize = 2;
/// Share of the glow of a written block that remains after each frame.
const AFTERGLOW: f32 = 0.88;
/// Frames between measured full evaluations while a clip plays.
const FULL_EVERY: u32 = 24;
/// Most bytes of deltas for a full evaluation.
const FULL_BYTES: usize = 1 << 30;

/// The instance.
pub struct Heads {
    pub mesh: Arc<PackedMesh>,
    pub desc: UpdateDesc,
    /// The largest weight that updates take, either sign.
    pub weight_max: f32,
    pub drawn: render::Heads,
    /// Whether joints move its poses.
    pub is_skinned: bool,
}

impl Heads {
    /// Creates the instance, drawn into images of `format`; `skin` moves poses that are on the device.
    pub fn new(
        headless: &Headless,
        format: vk::Format,
        (mesh, subject): (&MorphMesh, &Subject),
        (packed, desc): (Arc<PackedMesh>, UpdateDesc),
        skin: Option<SkinDesc<'_>>,
        threads: usize,
    ) -> Result<Self, Failure> {
        let skin = skin.filter(|_| desc.path != UpdatePath::Cpu);
        let heads = HeadsDesc {
            frames: IN_FLIGHT,
            threads,
            step: skin.map_or(Step::None, Step::Skin),
            afterglow: AFTERGLOW,
            ..HeadsDesc::new(desc)
        };
        let layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        // SAFETY: the window waits, and drops targets and then the instance before the device.
        let drawn = unsafe { render::Heads::new(headless, (format, layout), mesh, &packed, &subject.parts, &heads) };
        let mut drawn = drawn?;
        if let Some(still) = &subject.still {
            drawn.set_still(&still.mesh, &still.parts)?;
        }
        // Poses of floats have no grid, and take what the library takes.
        let weight_max = packed.layout().grid(desc.pose, desc.weight_max).map_or(1e6, |grid| grid.weight_max);
        Ok(Self { mesh: packed, desc, weight_max, drawn, is_skinned: skin.is_some() })
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
    pub fn new(headless: &Headless, mesh: &MorphMesh) -> Result<Option<Self>, Failure> {
        let engine = headless.engine();
        let bytes = mesh.vertex_count().saturating_mul(mesh.targets.len()).saturating_mul(24);
        let path = UpdatePath::Compute;
        if bytes > FULL_BYTES || mesh.targets.is_empty() || engine.caps().check_path(path).is_err() {
            return Ok(None);
        }
        let format = DeltaFormat::Float32;
        let batch = if path.takes_all_targets() {
            BatchSize::All
        } else {
            engine.caps().batch_max(path, format).map_or(BatchSize::All, BatchSize::Targets)
        };
        let packed = PackedMesh::pack(mesh, &engine.pack_desc(format))?;
        // SAFETY: `upload` passes a recording buffer of the engine's device, and waits for it.
        let uploaded = headless.upload(|cmd| unsafe { engine.upload(cmd, &packed) })?;
        let update = UpdateDesc::new(path, batch).mode(UpdateMode::Rebuild);
        let desc = CrowdDesc::new(update).frames_in_flight(IN_FLIGHT as u32);
        let crowd = engine.create_crowd(&uploaded, &desc)?;
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

    /// Evaluates.
    ///
    /// # Safety
    /// `cmd` is recording on the engine's device, outside a render pass; frames are submitted once, in order, after a
    /// wait for the one `IN_FLIGHT` ago.
    pub unsafe fn update(
        &mut self,
        device: &Device,
        cmd: vk::CommandBuffer,
        weights: &[f32],
    ) -> Result<UpdateStats, Failure> {
        self.crowd.set_weights(0, weights)?;
        // SAFETY: the caller's obligations.
        Ok(unsafe { device.engine().record_update(cmd, &mut self.crowd) }?.stats)
    }
}
