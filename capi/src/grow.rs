//! Growth of crowds.

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

/// The object of a `DmOutgrown`.
pub struct Outgrown {
    _before: Before,
    pub(crate) engine: Arc<Engine>,
}

/// Make a crowd again with room for more instances: `desc` describes the new crowd, as a rule the old description with
/// more instances. The handle stays valid, and so do sets that name it. Instances keep their numbers, the weights
/// requested of them or the clips that they play, and whether they are hidden; the new numbers are free, for
/// `dm_crowd_add`. Tickets stay valid. Call it between two updates; earlier ones need not have finished. The next
/// update writes all poses again, and until it is recorded there are none.
///
/// This records nothing, and `cmd` is ignored, unless the crowd plays clips: then it records the same as
/// `dm_crowd_create_animated`; call `dm_crowd_release_staging` once that has run.
///
/// Errors: DM_ERROR_INVALID for fewer instances than there are, for instances with targets of steps after the pose,
/// which have to be removed first, for poses in the same vertices of the host's as the crowd has now; those of
/// `dm_crowd_create`, and `dm_crowd_create_animated`. Nothing changes then.
///
/// # Safety
/// - For a crowd that plays clips, `cmd` as in `dm_crowd_create_animated`.
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

/// Destroy the resources that a crowd had before it grew: pose buffers, lists, descriptor sets.
///
/// # Safety
/// The updates and draws recorded before have finished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_outgrown_destroy(outgrown: DmOutgrown) -> DmResult {
    enter("dm_outgrown_destroy", || outgrown.destroy(|_| Ok(())))
}
