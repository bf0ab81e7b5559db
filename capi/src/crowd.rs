//! Crowds on the device: made, changed, destroyed.

use crate::arguments::{check_command_buffer, or};
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmGpuMesh, Handle, handle};
use crate::memory::{check_place, read, read_or_default, slice, text};
use crate::numbers::{consumers, mode, path, pose_format};
use crate::result::{DmResult, Failure, Result, ensure, enter, lock};
use crate::structs::{DmAnimationDesc, DmCrowdDesc, DmLevelDesc, DmPlayback};
use crate::tickets::Tickets;
use deltamorph::ash::vk;
use deltamorph::lod::Importance;
use deltamorph::{
    AnimationDesc, BatchSize, CrowdDesc, KeyFormat, Playback, PoseFormat, Repeat, UpdateDesc, WeightClip,
};
use std::sync::{Arc, Mutex, MutexGuard};

/// The object of a `DmCrowd`.
pub struct Crowd {
    pub(crate) state: Mutex<State>,
    pub(crate) engine: Arc<Engine>,
}

handle!(DmCrowd for Crowd);

/// The part that calls change.
pub(crate) struct State {
    pub(crate) crowd: deltamorph::Crowd,
    pub(crate) tickets: Tickets,
}

impl State {
    pub(crate) fn weighted(&mut self) -> Result<&mut deltamorph::Crowd> {
        let plays = self.crowd.clips().is_some();
        ensure!(!plays, "the crowd plays clips; use dm_crowd_play and dm_crowd_set_time");
        Ok(&mut self.crowd)
    }

    pub(crate) fn animated(&mut self) -> Result<&mut deltamorph::Crowd> {
        let plays = self.crowd.clips().is_some();
        ensure!(plays, "the crowd plays no clips; dm_crowd_create_animated makes one that does");
        Ok(&mut self.crowd)
    }
}

impl DmCrowdDesc {
    /// The description, with `default_pose` for zero.
    pub(crate) fn crowd(&self, default_pose: PoseFormat) -> Result<CrowdDesc> {
        let path = path(self.path)?;
        let batch = if self.batch == 0 { BatchSize::All } else { BatchSize::Targets(self.batch) };
        let default = UpdateDesc::new(path, batch);
        let update = UpdateDesc {
            mode: mode(self.mode, default.mode)?,
            slots: or(self.slots, default.slots),
            pose: pose_format(self.pose_format, default_pose)?,
            tolerance: or(self.tolerance, default.tolerance),
            weight_max: (self.weight_max != 0.0).then_some(self.weight_max),
            error_budget: self.error_budget,
            ..default
        };
        let desc = CrowdDesc::new(update);
        Ok(CrowdDesc {
            instances: or(self.instances, desc.instances),
            frames_in_flight: or(self.frames_in_flight, desc.frames_in_flight),
            consumers: consumers(self.consumers)?,
            pose_usage: vk::BufferUsageFlags::from_raw(self.pose_usage),
            ..desc
        })
    }
}

/// Reads the description of a crowd on the device.
///
/// # Safety
/// `desc` is null (the defaults) or a structure; DmCrowdDesc::queue_family is null or can be read.
pub(crate) unsafe fn crowd_desc(desc: *const DmCrowdDesc, default_pose: PoseFormat) -> Result<CrowdDesc> {
    // SAFETY: the caller's obligation.
    let asked = unsafe { read_or_default(desc) }?;
    // SAFETY: as above.
    let family = (!asked.queue_family.is_null()).then(|| unsafe { asked.queue_family.read_unaligned() });
    Ok(CrowdDesc { queue_family: family, ..asked.crowd(default_pose)? })
}

/// The order of the targets; `None`: all targets are kept.
///
/// # Safety
/// `desc` is null, or a structure with as many pins as it says.
unsafe fn level(desc: *const DmLevelDesc) -> Result<Option<Importance>> {
    if desc.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's obligation.
    let asked = unsafe { read(desc) }?;
    let mesh = asked.mesh.get()?;
    // SAFETY: as above.
    let pins = unsafe { slice(asked.pins, asked.pin_count as usize, "pins") }?;
    // SAFETY: as above.
    let pins = pins.iter().map(|&pin| unsafe { text(pin, "pins") }).collect::<Result<Vec<&str>>>()?;
    Ok(Some(Importance::of_packed(&mesh.packed, &pins)?))
}

fn insert(crowd: deltamorph::Crowd, engine: Arc<Engine>) -> DmCrowd {
    DmCrowd::insert(Crowd { state: Mutex::new(State { crowd, tickets: Tickets::default() }), engine })
}

/// Runs `body` with a crowd that is locked meanwhile.
pub(crate) fn with<R>(crowd: DmCrowd, body: impl FnOnce(&mut State) -> Result<R>) -> Result<R> {
    let crowd = crowd.get()?;
    let mut state = lock(&crowd.state)?;
    body(&mut state)
}

/// Locks crowds, each named once, and returns them in the order of `handles`, whose `objects` they are.
pub(crate) fn lock_all<'a>(handles: &[DmCrowd], objects: &'a [Arc<Crowd>]) -> Result<Vec<MutexGuard<'a, State>>> {
    // All threads lock in the same order, so that no two wait for each other.
    let mut order: Vec<usize> = (0..handles.len()).collect();
    order.sort_unstable_by_key(|&at| handles[at].bits());
    let once = order.windows(2).all(|pair| handles[pair[0]].bits() != handles[pair[1]].bits());
    ensure!(once, "a crowd is named twice; name each once");
    let mut states = order.iter().map(|&at| Ok((at, lock(&objects[at].state)?))).collect::<Result<Vec<_>>>()?;
    states.sort_unstable_by_key(|(at, _)| *at);
    Ok(states.into_iter().map(|(_, state)| state).collect())
}

/// Make pose buffers and pipelines for instances of a mesh, all weights 0. The first update writes their base poses.
///
/// Errors: DM_ERROR_INVALID, DM_ERROR_UNSUPPORTED for options that the mesh or device does not support, with an
/// alternative; DM_ERROR_OUT_OF_MEMORY.
///
/// # Safety
/// `desc` is null (the defaults) or a structure, and so is DmCrowdDesc::poses, which meets the conditions in its
/// documentation; DmCrowdDesc::queue_family is null or can be read; `crowd` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_create(mesh: DmGpuMesh, desc: *const DmCrowdDesc, crowd: *mut DmCrowd) -> DmResult {
    enter("dm_crowd_create", || {
        check_place(crowd, "crowd")?;
        // SAFETY: the caller's obligation.
        let desc = unsafe { crowd_desc(desc, PoseFormat::Float32) }?;
        let mesh = mesh.get()?;
        let made = mesh.engine.morph.create_crowd(&*lock(&mesh.mesh)?, &desc)?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { crowd.write(insert(made, mesh.engine.clone())) };
        Ok(())
    })
}

/// Make a crowd whose instances play clips on the GPU, and record the upload of the clips. Instances that have played
/// no clip yet show the base pose. Any number of updates may be in flight; with post-morph passes, as many as
/// `frames_in_flight` of the description.
///
/// This records: a copy and two fills, and a barrier that makes them visible to updates (first stage TRANSFER with
/// TRANSFER_WRITE; last COMPUTE_SHADER). Call `dm_release_staging` once it has run.
///
/// Errors: those of `dm_crowd_create`; clips that do not fit the mesh; float32 poses. Nothing is recorded then.
///
/// # Safety
/// - `cmd` as in `dm_mesh_upload`, on a queue with compute. It runs exactly once, before any update of the crowd.
/// - `desc` as in `dm_crowd_create`; `animation` is a structure with as many clips as it says.
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
        let mesh = mesh.get()?;
        check_command_buffer(cmd)?;
        // SAFETY: the caller's obligations.
        let desc = unsafe { crowd_desc(desc, PoseFormat::Fixed32) }?;
        // SAFETY: as above.
        let animation = unsafe { read(animation) }?;
        // SAFETY: as above.
        let clips = unsafe { slice(animation.clips, animation.clip_count as usize, "clips") }?;
        let clips = clips.iter().map(|clip| Ok(clip.get()?.clip.clone())).collect::<Result<Vec<WeightClip>>>()?;
        let keys = match animation.key_bits {
            0 | 32 => KeyFormat::Bits32,
            16 => KeyFormat::Bits16,
            bits => return Err(Failure::invalid(format!("keys of {bits} bits; use 32 or 16"))),
        };
        // SAFETY: as above.
        let importance = unsafe { level(animation.level) }?;
        let animation =
            AnimationDesc { key_format: keys, importance: importance.as_ref(), ..AnimationDesc::new(&clips) };
        // SAFETY: the caller's obligations; `crowd` was checked.
        unsafe {
            let made = mesh.engine.morph.create_animated_crowd(cmd, &*lock(&mesh.mesh)?, &desc, &animation)?;
            crowd.write(insert(made, mesh.engine.clone()));
        }
        Ok(())
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

/// Reset the history of an instance (which was teleported, for example): the previous pose of its next pose will be
/// that pose itself, so that motion vectors are zero. `dm_crowd_set_hidden` implies this.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_reset_history(crowd: DmCrowd, instance: u32) -> DmResult {
    enter("dm_crowd_reset_history", || with(crowd, |state| Ok(state.crowd.reset_history(instance)?)))
}

/// Hide an instance (not 0), or show it again (0). Updates leave a hidden instance out, and it keeps its pose. When it
/// is shown again, the next update brings it up to date, and its previous pose is the pose itself then.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_hidden(crowd: DmCrowd, instance: u32, hidden: u32) -> DmResult {
    let body = |state: &mut State| Ok(state.crowd.set_hidden(instance, hidden != 0)?);
    enter("dm_crowd_set_hidden", || with(crowd, body))
}

/// Add an instance, with a number that `dm_crowd_remove` freed: shown, with all weights 0.
///
/// Errors: DM_ERROR_INVALID if no number is free.
///
/// # Safety
/// `instance` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_add(crowd: DmCrowd, instance: *mut u32) -> DmResult {
    enter("dm_crowd_add", || {
        check_place(instance, "instance")?;
        let added = with(crowd, |state| Ok(state.crowd.add()?))?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { instance.write(added) };
        Ok(())
    })
}

/// Remove an instance from a crowd.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or already removed.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_remove(crowd: DmCrowd, instance: u32) -> DmResult {
    enter("dm_crowd_remove", || with(crowd, |state| Ok(state.crowd.remove(instance)?)))
}

/// Play a clip of an animated crowd from the next recorded update on.
///
/// Errors: DM_ERROR_INVALID for an instance or clip out of range, a speed or start that is not a number or too large, a
/// crowd that plays no clips.
///
/// # Safety
/// `playback` is a structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_play(crowd: DmCrowd, instance: u32, playback: *const DmPlayback) -> DmResult {
    enter("dm_crowd_play", || {
        // SAFETY: the caller's obligation.
        let asked = unsafe { read(playback) }?;
        let repeat = if asked.once != 0 { Repeat::Once } else { Repeat::Loop };
        let playback =
            Playback { start: asked.start, speed: or(asked.speed, 1.0), repeat, ..Playback::new(asked.clip) };
        with(crowd, |state| Ok(state.animated()?.play(instance, &playback)?))
    })
}

/// Set the clock of an animated crowd: it is at `seconds` when the next recorded update runs.
///
/// Errors: DM_ERROR_INVALID for a time that is not a number or too large; for a crowd that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_time(crowd: DmCrowd, seconds: f64) -> DmResult {
    enter("dm_crowd_set_time", || with(crowd, |state| Ok(state.animated()?.set_time(seconds)?)))
}

/// Keep only `level` targets of an instance, in the order of their importance, from the next recorded update on; for an
/// animated crowd made with DmAnimationDesc::level. A number at or above the number of targets keeps all.
///
/// Errors: DM_ERROR_INVALID for an instance out of range, a level below 0 or not a number, a crowd without levels of
/// detail or one that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_level(crowd: DmCrowd, instance: u32, level: f32) -> DmResult {
    enter("dm_crowd_set_level", || with(crowd, |state| Ok(state.animated()?.set_level(instance, level)?)))
}
