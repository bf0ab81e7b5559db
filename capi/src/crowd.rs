//! Crowds on the device: made, changed, and where their poses are.

use crate::arguments::{check_command_buffer, check_reserved, or};
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmGpuMesh, Handle, handle};
use crate::memory::{check_place, read, read_or_default, slice};
use crate::numbers::{consumers, mode, path, pose_format};
use crate::result::{DmResult, Failure, Result, enter, lock};
use crate::structs::{DmAnimationDesc, DmCrowdDesc, DmDecodeTarget, DmPlayback};
use crate::tickets::Tickets;
use deltamorph::ash::vk::{self, Handle as _};
use deltamorph::{
    AnimatedCrowd, AnimationDesc, AnyCrowd, BatchSize, CrowdDesc, DecodeTarget, KeyFormat, MorphEngine, Playback,
    PoseFormat, Repeat, Update, UpdateDesc, UpdatePath, WeightClip,
};
use std::sync::{Arc, Mutex};

/// What a `DmCrowd` names.
pub struct Crowd {
    pub(crate) state: Mutex<State>,
    pub(crate) engine: Arc<Engine>,
}

handle!(DmCrowd, 4, Crowd);

/// What its calls change.
pub(crate) struct State {
    pub(crate) kind: Kind,
    pub(crate) tickets: Tickets,
}

/// Who sets the weights.
pub(crate) enum Kind {
    Weighted(deltamorph::Crowd),
    Animated(AnimatedCrowd),
}

/// The same expression for a crowd of either kind.
macro_rules! either {
    ($state:expr, $crowd:ident => $body:expr) => {
        match $state.kind {
            Kind::Weighted(ref mut $crowd) => $body,
            Kind::Animated(ref mut $crowd) => $body,
        }
    };
}

pub(crate) use either;

impl State {
    pub(crate) fn any(&mut self) -> &mut dyn AnyCrowd {
        either!(self, crowd => crowd)
    }

    /// # Safety
    /// As [`MorphEngine::record_update`].
    pub(crate) unsafe fn record(&mut self, engine: &MorphEngine, cmd: vk::CommandBuffer) -> Result<Update> {
        // SAFETY: the caller's obligations.
        Ok(either!(self, crowd => unsafe { engine.record_update(cmd, crowd) })?)
    }

    pub(crate) fn discard(&mut self, ticket: deltamorph::Ticket) -> Result<()> {
        Ok(either!(self, crowd => crowd.discard(ticket))?)
    }

    fn animated(&mut self) -> Result<&mut AnimatedCrowd> {
        match &mut self.kind {
            Kind::Animated(crowd) => Ok(crowd),
            Kind::Weighted(_) => {
                Err(Failure::invalid("the crowd plays no clips; dm_crowd_create_animated makes one that does"))
            }
        }
    }
}

impl DmCrowdDesc {
    /// The description, where the path `default_path` and the poses `default_pose` are what zeros mean.
    pub(crate) fn crowd(&self, default_path: UpdatePath, default_pose: PoseFormat) -> Result<CrowdDesc> {
        let path = path(self.path, default_path)?;
        let batch = if self.batch == 0 { BatchSize::All } else { BatchSize::Targets(self.batch) };
        let default = UpdateDesc::new(path, batch);
        let update = default
            .mode(mode(self.mode, default.mode)?)
            .slots(or(self.slots, default.slots))
            .pose(pose_format(self.pose_format, default_pose)?)
            .tolerance(or(self.tolerance, default.tolerance))
            .weight_max((self.weight_max != 0.0).then_some(self.weight_max))
            .error_budget(self.error_budget);
        let desc = CrowdDesc::new(update);
        Ok(desc
            .instances(or(self.instances, desc.instances))
            .frames_in_flight(or(self.frames_in_flight, desc.frames_in_flight))
            .consumers(consumers(self.consumers)?))
    }
}

fn insert(kind: Kind, engine: Arc<Engine>) -> Result<DmCrowd> {
    DmCrowd::insert(Crowd { state: Mutex::new(State { kind, tickets: Tickets::default() }), engine })
}

/// Run `body` with a crowd that is locked meanwhile.
pub(crate) fn with<R>(crowd: DmCrowd, body: impl FnOnce(&mut State) -> Result<R>) -> Result<R> {
    let crowd = crowd.get()?;
    let mut state = lock(&crowd.state)?;
    body(&mut state)
}

/// Make pose buffers and pipelines for instances of a mesh, all weights 0. The first update writes their base poses.
///
/// Errors: DM_ERROR_INVALID, DM_ERROR_UNSUPPORTED for what mesh or device cannot do, with what to use instead;
/// DM_ERROR_OUT_OF_MEMORY.
///
/// # Safety
/// `desc` is null (the defaults) or a structure; `crowd` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_create(mesh: DmGpuMesh, desc: *const DmCrowdDesc, crowd: *mut DmCrowd) -> DmResult {
    enter("dm_crowd_create", || {
        check_place(crowd, "crowd")?;
        // SAFETY: the caller's obligation.
        let desc = unsafe { read_or_default(desc) }?.crowd(UpdatePath::Blocks, PoseFormat::Float32)?;
        let mesh = mesh.get()?;
        let made = mesh.engine.morph.create_crowd(&*lock(&mesh.mesh)?, &desc)?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { crowd.write(insert(Kind::Weighted(made), mesh.engine.clone())?) };
        Ok(())
    })
}

/// Make a crowd whose instances play clips on the GPU, and record the upload of the clips. Instances that have played
/// nothing yet show the base pose. Any number of updates may be in flight.
///
/// This records: a copy and two fills, and a barrier that makes them visible to updates (first stage TRANSFER with
/// TRANSFER_WRITE; last COMPUTE_SHADER). Call `dm_crowd_release_staging` once it has run.
///
/// Errors: as `dm_crowd_create`; clips that do not fit the mesh; float32 poses. Nothing is recorded then.
///
/// # Safety
/// - `cmd` as in `dm_mesh_upload`. It runs exactly once, before any update of the crowd.
/// - `desc` is null (the defaults) or a structure; `animation` is a structure with as many clips as it says.
/// - `crowd` can be written. It is destroyed only when the device no longer uses it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_create_animated(
    mesh: DmGpuMesh,
    cmd: vk::CommandBuffer,
    desc: *const DmCrowdDesc,
    animation: *const DmAnimationDesc,
    crowd: *mut DmCrowd,
) -> DmResult {
    enter("dm_crowd_create_animated", || {
        check_place(crowd, "crowd")?;
        check_command_buffer(cmd)?;
        // SAFETY: the caller's obligations.
        let (desc, animation) = unsafe { (read_or_default(desc)?, read(animation)?) };
        check_reserved("DmAnimationDesc", animation.reserved)?;
        // SAFETY: as above.
        let clips = unsafe { slice(animation.clips, animation.clip_count as usize, "clips") }?;
        let clips = clips.iter().map(|clip| Ok(clip.get()?.clip.clone())).collect::<Result<Vec<WeightClip>>>()?;
        let keys = match animation.key_bits {
            0 | 32 => KeyFormat::Bits32,
            16 => KeyFormat::Bits16,
            bits => return Err(Failure::invalid(format!("keys of {bits} bits; use 32 or 16"))),
        };
        let desc = desc.crowd(UpdatePath::Blocks, PoseFormat::Fixed32)?;
        let mesh = mesh.get()?;
        let animation = AnimationDesc::new(&clips).key_format(keys);
        // SAFETY: the caller's obligations; `crowd` was checked.
        unsafe {
            let made = mesh.engine.morph.create_animated_crowd(cmd, &*lock(&mesh.mesh)?, &desc, &animation)?;
            crowd.write(insert(Kind::Animated(made), mesh.engine.clone())?);
        }
        Ok(())
    })
}

/// Give the staging memory of an animated crowd's clips back.
///
/// Errors: DM_ERROR_INVALID for a crowd that plays no clips.
///
/// # Safety
/// The upload has run, or never will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_release_staging(crowd: DmCrowd) -> DmResult {
    enter("dm_crowd_release_staging", || {
        with(crowd, |state| {
            // SAFETY: the caller's obligation.
            unsafe { state.animated()?.release_staging() };
            Ok(())
        })
    })
}

/// Destroy a crowd, and its poses.
///
/// # Safety
/// The device no longer uses them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_destroy(crowd: DmCrowd) -> DmResult {
    enter("dm_crowd_destroy", || crowd.destroy(|_| Ok(())))
}

/// Request these weights for an instance, one per target in the mesh's order, from the next recorded update on.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a wrong number of weights, one that is not finite
/// or out of range, a crowd that plays clips. Nothing changes then.
///
/// # Safety
/// There are `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_weights(
    crowd: DmCrowd,
    instance: u32,
    weights: *const f32,
    count: u32,
) -> DmResult {
    enter("dm_crowd_set_weights", || {
        // SAFETY: the caller's obligation.
        let weights = unsafe { slice(weights, count as usize, "weights") }?;
        with(crowd, |state| match &mut state.kind {
            Kind::Weighted(crowd) => Ok(crowd.set_weights(instance, weights)?),
            Kind::Animated(_) => {
                Err(Failure::invalid("the crowd plays clips; use dm_crowd_play and dm_crowd_set_time"))
            }
        })
    })
}

/// The next pose of an instance has no predecessor: its previous pose will be the pose itself.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_cut(crowd: DmCrowd, instance: u32) -> DmResult {
    enter("dm_crowd_cut", || with(crowd, |state| Ok(either!(state, crowd => crowd.cut(instance))?)))
}

/// Hide an instance (not 0), or show it again (0). A hidden one is left out of updates and keeps its pose.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_hidden(crowd: DmCrowd, instance: u32, hidden: u32) -> DmResult {
    let body = |state: &mut State| Ok(either!(state, crowd => crowd.set_hidden(instance, hidden != 0))?);
    enter("dm_crowd_set_hidden", || with(crowd, body))
}

/// Add an instance, in a place that `dm_crowd_remove` freed: shown, with all weights 0.
///
/// Errors: DM_ERROR_INVALID where no place is free.
///
/// # Safety
/// `instance` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_add(crowd: DmCrowd, instance: *mut u32) -> DmResult {
    enter("dm_crowd_add", || {
        check_place(instance, "instance")?;
        let added = with(crowd, |state| Ok(either!(state, crowd => crowd.add())?))?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { instance.write(added) };
        Ok(())
    })
}

/// Take an instance out of a crowd.
///
/// Errors: DM_ERROR_INVALID for an instance out of range, or removed before.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_remove(crowd: DmCrowd, instance: u32) -> DmResult {
    enter("dm_crowd_remove", || with(crowd, |state| Ok(either!(state, crowd => crowd.remove(instance))?)))
}

/// Play a clip of an animated crowd from the next recorded update on.
///
/// Errors: DM_ERROR_INVALID for an instance or clip out of range, a speed or start that is no number or too large, a
/// crowd that plays no clips.
///
/// # Safety
/// `playback` is a structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_play(crowd: DmCrowd, instance: u32, playback: *const DmPlayback) -> DmResult {
    enter("dm_crowd_play", || {
        // SAFETY: the caller's obligation.
        let asked = unsafe { read(playback) }?;
        check_reserved("DmPlayback", asked.reserved)?;
        let repeat = if asked.once != 0 { Repeat::Once } else { Repeat::Loop };
        let playback = Playback::new(asked.clip).start(asked.start).speed(or(asked.speed, 1.0)).repeat(repeat);
        with(crowd, |state| Ok(state.animated()?.play(instance, &playback)?))
    })
}

/// The clock of an animated crowd is at `seconds` when the next recorded update runs.
///
/// Errors: DM_ERROR_INVALID for no number, or one too large; for a crowd that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_time(crowd: DmCrowd, seconds: f64) -> DmResult {
    enter("dm_crowd_set_time", || with(crowd, |state| Ok(state.animated()?.set_time(seconds)?)))
}

/// Have positions of an instance written as float32 into a buffer of the host's, from the next recorded update on;
/// null: no longer. What is written is ready for the crowd's consumers.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, an offset or stride that does not fit. Nothing
/// changes then.
///
/// # Safety
/// - `target` is null or a structure. Its buffer is one of the engine's device, made for use as storage buffer; it is
///   large enough for all that is written, and lives until the instance has another target, or none, and the updates
///   recorded before have finished.
/// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_decode_target(
    crowd: DmCrowd,
    instance: u32,
    target: *const DmDecodeTarget,
) -> DmResult {
    enter("dm_crowd_set_decode_target", || {
        let target = match target.is_null() {
            true => None,
            // SAFETY: the caller's obligation.
            false => Some(decode_target(&unsafe { read(target) }?)?),
        };
        let crowd = crowd.get()?;
        let (mut state, engine) = (lock(&crowd.state)?, &crowd.engine.morph);
        // SAFETY: the caller's obligations.
        Ok(either!(state, crowd => unsafe { engine.set_decode_target(crowd, instance, target.as_ref()) })?)
    })
}

fn decode_target(asked: &DmDecodeTarget) -> Result<DecodeTarget> {
    check_reserved("DmDecodeTarget", asked.reserved)?;
    if asked.buffer.is_null() {
        return Err(Failure::invalid("'buffer' is null; hand in a buffer, or a null pointer for no target"));
    }
    let target = DecodeTarget::new(asked.buffer).offset(asked.offset);
    let normals = (asked.normals != 0).then_some(asked.normals);
    Ok(target.stride(or(asked.stride, target.stride)).normals(normals))
}
