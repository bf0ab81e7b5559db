//! Push constants of `glsl/level.comp`.

use super::clips::{Clips, Following};
use crate::abi::push::{AnimationPush, LevelPush};
use crate::lod::{Camera, pixels_per_unit};
use crate::pack::blocks::{BlockIndex, PoseGrid};

/// Push constants without camera and cuts, or `None` if no level of detail follows a camera. `push` and `index` are
/// those of the mesh's first group.
pub(super) fn push(clips: &Clips, push: &AnimationPush, index: &BlockIndex, grid: PoseGrid) -> Option<LevelPush> {
    let Following { desc, pinned, reaches_at } = clips.following()?;
    let [exceeded, wanted] = desc.bounds();
    let step = f64::from(index.steps()[0]) * f64::from(grid.weight_step());
    let &AnimationPush { heads, targets, words, phases_at, budget_at, .. } = push;
    Some(LevelPush {
        eye: [0.0; 3],
        // All targets are kept until there is a camera.
        unit_at_one: f32::INFINITY,
        exceeded,
        wanted,
        fade: desc.fade,
        budget: (f64::from(desc.error_budget(1.0)) / step) as f32,
        heads,
        targets,
        words,
        phases_at,
        reaches_at,
        pinned,
        budget_at,
        epoch: 0,
    })
}

/// Sets the camera of the next update, and the number of its cuts.
pub(super) fn follow(push: &mut LevelPush, (camera, cuts): (Option<Camera>, u32)) {
    push.epoch = cuts;
    if let Some(Camera { eye, height, angle }) = camera {
        (push.eye, push.unit_at_one) = (eye.to_array(), pixels_per_unit(height, angle, 1.0));
    }
}
