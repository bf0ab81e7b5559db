//! Levels of detail of crowds that are animated on the GPU.

use crate::arguments::{built, or};
use crate::crowd::with;
use crate::handles::{DmCrowd, Handle};
use crate::memory::{read, slice, text};
use crate::result::{DmResult, Result, enter};
use crate::structs::{DmCamera, DmLevelDesc, DmPlace};
use deltamorph::lod::{Camera, Importance, LevelDesc, Place};

/// The order of the targets, and how levels are chosen; `None`: all targets are kept.
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

/// Keep only `level` targets of an instance, in the order of their importance, from the next recorded update on; for an
/// animated crowd made with DmAnimationDesc::level. If the instance has a position (`dm_crowd_set_place`), this is the
/// most that is kept. A number at or above the number of targets keeps all.
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

/// Set the camera that levels of detail follow from the next recorded update on, for instances that have a position
/// (`dm_crowd_set_place`). Without a camera they keep all targets.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `level`; DM_ERROR_INVALID for an invalid
/// camera; those of `dm_crowd_set_level`.
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

/// Tell that the camera cuts with the next recorded update: levels of detail need not fade.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `level`; DM_ERROR_INVALID for a crowd that
/// plays no clips.
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

/// Set the position of an instance from the next recorded update on. From its first position on, its level of detail
/// follows the camera: the GPU computes how many targets it keeps, and fades them; with `dm_crowd_cut` they change at
/// once. With DmCrowdDesc::error_budget the instance also has an error budget of its own: half of DmLevelDesc::pixels,
/// as a length at its distance, or the crowd's if that is less.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `level`; DM_ERROR_INVALID for an invalid
/// position; those of `dm_crowd_set_level`.
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
