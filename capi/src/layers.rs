//! Layers of clips, mixed to one weight vector.

use crate::clip::BoundClip;
use crate::handles::Handle;
use crate::memory::{array, overlap, slice, slice_mut};
use crate::numbers::layer_blend;
use crate::result::{DmResult, Failure, Result, enter};
use crate::structs::DmClipLayer;
use deltamorph::{ClipLayer, Repeat};
use std::sync::Arc;

/// Mix layers, the first one lowest, on top of the weights that are in `weights` already: zeros, or a pose of the
/// host's. The result is for `dm_crowd_set_weights` or, with clips that are bound to the names of a set, for
/// `dm_crowds_set_weights`. With the weight w of a layer, its mask m of a target and the weight s of the target in its
/// clip, the weight v of the target becomes v x (1 - w x m) + w x m x s (`DM_LAYER_OVERRIDE`), or v + w x m x s
/// (`DM_LAYER_ADDITIVE`). A layer does not change targets that its clip has no column for.
///
/// Errors: DM_ERROR_INVALID for a clip of another number of targets than `weight_count`, a time, weight or factor of a
/// mask that is not finite, an unknown blend, a mask that overlaps `weights`. Nothing changes then.
///
/// # Safety
/// There are `count` consecutive structures, whose masks are null or have `weight_count` factors, and `weight_count`
/// weights, which can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clips_mix(
    layers: *const DmClipLayer,
    count: u32,
    weights: *mut f32,
    weight_count: u32,
) -> DmResult {
    enter("dm_clips_mix", || {
        let targets = weight_count as usize;
        // SAFETY: the caller's obligations.
        let asked = unsafe { array(layers, count) }?;
        let is_written =
            |mask: *const f32| !mask.is_null() && overlap((mask, targets), (weights.cast_const(), targets));
        if let Some(layer) = asked.iter().position(|layer| is_written(layer.mask)) {
            let text = format!("the mask of layer {layer} overlaps 'weights', which are written; copy it before");
            return Err(Failure::invalid(text));
        }
        let clips = asked.iter().map(|layer| layer.clip.get()).collect::<Result<Vec<Arc<BoundClip>>>>()?;
        let mut layers = vec![];
        for (asked, clip) in asked.iter().zip(&clips) {
            let repeat = if asked.once != 0 { Repeat::Once } else { Repeat::Loop };
            // SAFETY: as above.
            let mask = unsafe { slice(asked.mask, if asked.mask.is_null() { 0 } else { targets }, "mask") }?;
            let layer = ClipLayer::new(&clip.clip, asked.time).repeat(repeat).weight(asked.weight);
            layers.push(layer.blend(layer_blend(asked.blend)?).mask((!asked.mask.is_null()).then_some(mask)));
        }
        // SAFETY: as above; nothing else that is in use is there.
        Ok(ClipLayer::mix(&layers, unsafe { slice_mut(weights, targets, "weights") }?)?)
    })
}
