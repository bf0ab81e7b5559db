//! Levels of detail of crowds that are animated on the GPU.

use crate::arguments::{built, or};
use crate::crowd::with;
use crate::handles::{DmCrowd, Handle};
use crate::memory::{read, slice, text};
use crate::result::{DmResult, Result, enter};
use crate::structs::{DmCamera, DmLevelDesc, DmPlace};
use deltamorph::lod::{Camera, Importance, LevelDesc, Place};

/// The order of the targets, and how levels are chosen; `None`: they are all kept.
///
/// # Safety
/// `desc` is null, or a structure with as many pins as it says.
pub(crate) unsafe fn level(desc: *const DmLevelDesc) -> Result<Option<(Importance, LevelDesc)>> {
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
    let importance = Importance::of_packed(&mesh.asset.mesh, &pins)?;
    let default = LevelDesc::default();
    let level = default.pixels(or(asked.pixels, default.pixels)).fade(or(asked.fade, default.fade));
    Ok(Some((importance, level)))
}

/// Keep only so many targets of an instance of an animated crowd that was made with DmAnimationDesc::level, in the
/// order of their importance, from the next recorded update on. Where the instance has a place this is the most that
/// is kept. As many as there are, or more, are all of them.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `level`; DM_ERROR_INVALID for an
/// instance out of range, a number below 0 or none, a crowd without levels of detail or one that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_level(crowd: DmCrowd, instance: u32, level: f32) -> DmResult {
    enter("dm_crowd_set_level", || {
        built!("level", "levels of detail");
        with(crowd, |state| Ok(state.animated()?.set_level(instance, level)?))
    })
}

/// Levels of detail follow this camera from the next recorded update on: of instances that have a place. Before there
/// is one, they keep all targets.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `level`; DM_ERROR_INVALID for a camera
/// that there cannot be; as `dm_crowd_set_level`.
///
/// # Safety
/// `camera` is a structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_camera(crowd: DmCrowd, camera: *const DmCamera) -> DmResult {
    enter("dm_crowd_set_camera", || {
        built!("level", "levels of detail");
        // SAFETY: the caller's obligation.
        let DmCamera { height, angle, eye, .. } = unsafe { read(camera) }?;
        with(crowd, |state| Ok(state.animated()?.set_camera(&Camera { eye: eye.into(), height, angle })?))
    })
}

/// The camera of the next recorded update looks at something else than before: levels of detail need not fade.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `level`; DM_ERROR_INVALID for a crowd
/// that plays no clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_cut_camera(crowd: DmCrowd) -> DmResult {
    enter("dm_crowd_cut_camera", || {
        built!("level", "levels of detail");
        with(crowd, |state| {
            state.animated()?.cut_camera();
            Ok(())
        })
    })
}

/// Where an instance is from the next recorded update on. With its first place its level of detail begins to follow
/// the camera: the GPU works out how many targets it keeps, and fades them; `dm_crowd_cut` lets it be there at once.
/// With DmCrowdDesc::error_budget it has a budget of its own besides, of its pixels, or the crowd's where that is less.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `level`; DM_ERROR_INVALID for a place
/// that there cannot be; as `dm_crowd_set_level`.
///
/// # Safety
/// `place` is a structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_place(crowd: DmCrowd, instance: u32, place: *const DmPlace) -> DmResult {
    enter("dm_crowd_set_place", || {
        built!("level", "levels of detail");
        // SAFETY: the caller's obligation.
        let DmPlace { radius, scale, centre, .. } = unsafe { read(place) }?;
        let place = Place { centre: centre.into(), radius, scale: or(scale, 1.0) };
        with(crowd, |state| Ok(state.animated()?.set_place(instance, &place)?))
    })
}
