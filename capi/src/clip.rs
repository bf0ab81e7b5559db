//! Clips of weights, and clips bound to the targets of a mesh.

use crate::handles::{DmBoundClip, DmClip, DmMesh, Handle, handle};
use crate::memory::{Place, Versioned, check_place, fill, read, slice, text, text_or_empty};
use crate::result::{DmResult, Result, ensure, enter};
use crate::structs::{DmClipArrays, DmClipInfo};
use deltamorph::WeightClip;
use deltamorph::import::open_clip;
use std::ffi::c_char;
use std::path::Path;

/// The object of a `DmClip`.
pub struct Clip {
    pub(crate) clip: WeightClip,
}

handle!(DmClip for Clip);

/// The object of a `DmBoundClip`.
pub struct BoundClip {
    pub(crate) clip: deltamorph::BoundClip,
}

handle!(DmBoundClip for BoundClip);

/// Read a clip of weights: a CSV file (.csv; feature `csv`), or a glTF file (feature `gltf`), from which its only
/// animation of weights is read, or the animation NAME with `FILE#NAME`. `fps` is its frame rate; 0: the rate stated in
/// the file or in its name, or else 30.
///
/// Errors: DM_ERROR_IO, DM_ERROR_INPUT with the file, the position in it and a remedy, also if the library was built
/// without the feature that reads it.
///
/// # Safety
/// `path` is a UTF-8 string; `clip` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clip_open(path: *const c_char, fps: f32, clip: *mut DmClip) -> DmResult {
    enter("dm_clip_open", || {
        check_place(clip, "clip")?;
        // SAFETY: the caller's obligations; `clip` was checked.
        unsafe {
            let path = Path::new(text(path, "path")?);
            clip.write(DmClip::insert(Clip { clip: open_clip(path, (fps != 0.0).then_some(fps))? }));
        }
        Ok(())
    })
}

/// Make a clip from arrays. The weights are checked by the functions that take the clip.
///
/// Errors: DM_ERROR_INVALID for null names or values, a frame rate that is not above 0.
///
/// # Safety
/// `arrays` is a structure whose arrays have the elements that it says; `clip` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clip_from_arrays(arrays: *const DmClipArrays, clip: *mut DmClip) -> DmResult {
    enter("dm_clip_from_arrays", || {
        check_place(clip, "clip")?;
        // SAFETY: the caller's obligations; `clip` was checked.
        unsafe {
            let arrays = read(arrays)?;
            let fps = arrays.fps;
            ensure!(fps.is_finite() && fps > 0.0, "{fps} frames per second; use a number above 0");
            let columns = arrays.column_count as usize;
            let name = text_or_empty(arrays.name, "name")?;
            let names = slice(arrays.names, columns, "names")?;
            let names = names.iter().map(|name| Ok(text(*name, "name of a column")?.to_owned()));
            let count = columns.saturating_mul(arrays.frame_count as usize);
            let made = WeightClip {
                name: if name.is_empty() { "unnamed" } else { name }.to_owned(),
                names: names.collect::<Result<_>>()?,
                fps,
                values: slice(arrays.values, count, "values")?.to_vec(),
                notes: vec![],
            };
            clip.write(DmClip::insert(Clip { clip: made }));
        }
        Ok(())
    })
}

/// Write the size and rate of a clip.
///
/// # Safety
/// `info` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clip_info(clip: DmClip, info: *mut DmClipInfo) -> DmResult {
    enter("dm_clip_info", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(info) }?;
        let Clip { clip } = &*clip.get()?;
        place.write(DmClipInfo {
            frame_count: clip.frame_count() as u32,
            column_count: clip.names.len() as u32,
            fps: clip.fps,
            ..DmClipInfo::zeroed()
        });
        Ok(())
    })
}

/// Destroy a clip. Objects made from it stay.
#[unsafe(no_mangle)]
pub extern "C" fn dm_clip_destroy(clip: DmClip) -> DmResult {
    enter("dm_clip_destroy", || clip.destroy(|_| Ok(())))
}

/// Bind the columns of a clip to the targets of a mesh, by name, regardless of case, separators, the spelling of sides
/// (`_L`, `Left`) and prefixes that programs add. Columns that name no target are left out: time, head angles, targets
/// of other meshes. Targets without a column have the weight 0.
///
/// Errors: DM_ERROR_INVALID if no column names a target, with the most similar name; two columns of one name; a weight
/// that is not finite.
///
/// # Safety
/// `bound` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clip_bind(clip: DmClip, mesh: DmMesh, bound: *mut DmBoundClip) -> DmResult {
    enter("dm_clip_bind", || {
        check_place(bound, "bound")?;
        let clip = clip.get()?;
        let mesh = mesh.get()?;
        let names: Vec<&str> = mesh.layout().targets.iter().map(|target| target.name.as_str()).collect();
        let made = BoundClip { clip: clip.clip.bind(&names)? };
        // SAFETY: the caller's obligation; it was checked.
        unsafe { bound.write(DmBoundClip::insert(made)) };
        Ok(())
    })
}

/// Write the weights of a bound clip at `frame`, one for each target of the mesh, for `dm_crowd_set_weights`: linearly
/// interpolated between two frames; the first frame's before it, and the last frame's after it.
///
/// Errors: DM_ERROR_INVALID for a clip without frames, a frame that is not a number, too little room.
///
/// # Safety
/// There is room for `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_bound_clip_sample(
    clip: DmBoundClip,
    frame: f64,
    weights: *mut f32,
    count: u32,
) -> DmResult {
    enter("dm_bound_clip_sample", || {
        let BoundClip { clip } = &*clip.get()?;
        let frames = clip.frame_count();
        ensure!(frames > 0, "clip '{}' has no frames; bind one that has", clip.name);
        ensure!(!frame.is_nan(), "a frame that is no number; count frames from 0");
        let at = frame.clamp(0.0, (frames - 1) as f64);
        let from = at as usize;
        let part = at.fract() as f32;
        let mut sampled = clip.frame(from)?;
        if part > 0.0 {
            for (weight, next) in sampled.iter_mut().zip(clip.frame(from + 1)?) {
                *weight += part * (next - *weight);
            }
        }
        // SAFETY: the caller's obligation.
        unsafe { fill(weights, count as usize, &sampled, "weights") }
    })
}

/// Destroy a bound clip.
#[unsafe(no_mangle)]
pub extern "C" fn dm_bound_clip_destroy(clip: DmBoundClip) -> DmResult {
    enter("dm_bound_clip_destroy", || clip.destroy(|_| Ok(())))
}
