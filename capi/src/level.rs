//! Levels of detail of crowds that are animated on the GPU.

use crate::arguments::built;
use crate::crowd::with;
use crate::handles::{DmCrowd, Handle};
use crate::memory::{read, slice, text};
use crate::result::{DmResult, Result, enter};
use crate::structs::DmLevelDesc;
use deltamorph::lod::Importance;

/// The order of the targets; `None`: all targets are kept.
///
/// # Safety
/// `desc` is null, or a structure with as many pins as it says.
pub(crate) unsafe fn level(desc: *const DmLevelDesc) -> Result<Option<Importance>> {
    if desc.is_null() {
        return Ok(None);
    }
    built!("level", "levels of detail");
    // SAFETY: the caller's obligation.
    let asked = unsafe { read(desc) }?;
    let mesh = asked.mesh.get()?;
    // SAFETY: as above.
    let pins = unsafe { slice(asked.pins, asked.pin_count as usize, "pins") }?;
    // SAFETY: as above.
    let pins = pins.iter().map(|&pin| unsafe { text(pin, "pins") }).collect::<Result<Vec<&str>>>()?;
    Ok(Some(Importance::of_packed(&mesh.asset.mesh, &pins)?))
}

/// Keep only `level` targets of an instance, in the order of their importance, from the next recorded update on; for an
/// animated crowd made with DmAnimationDesc::level. A number at or above the number of targets keeps all.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `level`; DM_ERROR_INVALID for an instance
/// out of range, a level below 0 or not a number, a crowd without levels of detail or one that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_level(crowd: DmCrowd, instance: u32, level: f32) -> DmResult {
    enter("dm_crowd_set_level", || {
        built!("level", "levels of detail");
        with(crowd, |state| Ok(state.animated()?.set_level(instance, level)?))
    })
}
