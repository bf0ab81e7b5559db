//! Crowds that get more places.

use crate::arguments::check_command_buffer;
use crate::crowd::{Kind, crowd_desc};
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmOutgrown, Handle};
use crate::memory::check_place;
use crate::result::{DmResult, enter, lock};
use crate::structs::DmCrowdDesc;
use deltamorph::ash::vk;
use deltamorph::{Outgrown as Before, PoseFormat};
use std::sync::Arc;

/// What a `DmOutgrown` names.
pub struct Outgrown {
    _before: Before,
    pub(crate) engine: Arc<Engine>,
}

/// Make a crowd anew with more places: `desc` says how, as a rule as it was made, with more instances. The handle
/// stays, and so do sets that name it. Instances keep their numbers, what is requested of them or what they play, and
/// whether they are hidden; the new places are free, for `dm_crowd_add`. Tickets stay good. Called between two
/// updates, whether the earlier ones have finished or not; the next update writes all poses anew, and until it is
/// recorded there are none.
///
/// This records: nothing, and `cmd` is not looked at; for a crowd that plays clips what `dm_crowd_create_animated`
/// does: call `dm_crowd_release_staging` once that has run.
///
/// Errors: DM_ERROR_INVALID for fewer places than there are, for instances with targets of steps after the pose, which
/// have to be taken away first, for poses in the host's vertices that the crowd has now; as `dm_crowd_create`, and
/// `dm_crowd_create_animated`. Nothing changes then.
///
/// # Safety
/// - `cmd`, of a crowd that plays clips, as in `dm_crowd_create_animated`.
/// - `desc` as in `dm_crowd_create`; `outgrown` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_grow(
    crowd: DmCrowd,
    cmd: vk::CommandBuffer,
    desc: *const DmCrowdDesc,
    outgrown: *mut DmOutgrown,
) -> DmResult {
    enter("dm_crowd_grow", || {
        check_place(outgrown, "outgrown")?;
        let object = crowd.get()?;
        let (mut state, engine) = (lock(&object.state)?, object.engine.clone());
        // SAFETY: the caller's obligations; `outgrown` was checked.
        unsafe {
            let before = match &mut state.kind {
                Kind::Weighted(crowd) => engine.morph.grow_crowd(crowd, &crowd_desc(desc, PoseFormat::Float32)?)?,
                Kind::Animated(crowd) => {
                    check_command_buffer(cmd)?;
                    engine.morph.grow_animated_crowd(cmd, crowd, &crowd_desc(desc, PoseFormat::Fixed32)?)?
                }
            };
            outgrown.write(DmOutgrown::insert(Outgrown { _before: before, engine })?);
        }
        Ok(())
    })
}

/// Destroy what a crowd had before it grew: pose buffers, lists, descriptor sets.
///
/// # Safety
/// The updates and draws recorded before have finished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_outgrown_destroy(outgrown: DmOutgrown) -> DmResult {
    enter("dm_outgrown_destroy", || outgrown.destroy(|_| Ok(())))
}
