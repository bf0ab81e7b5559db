//! The CPU twin of the kernels that sample and plan (`glsl/animate.comp`, `glsl/plan.glsl`): the planner of block
//! formats, with the choices of the GPU.

#![allow(dead_code, reason = "unit tests use less of it")]

use deltamorph::internals::abi::numbers::{HIDDEN, LOOP, PLAYING, REVERSED};
use deltamorph::internals::update::animated::{PlaybackRecord, Playbacks};
use deltamorph::internals::update::blocks::{BlockState, GroupPlan, WorkList};
use deltamorph::{Clips, PackedLayout, Result, UpdateDesc};

/// Samples and plans like the GPU, on the CPU.
pub struct AnimatedReference {
    group: GroupPlan,
    slots: u32,
    instances: Vec<Instance>,
}

#[derive(Clone)]
struct Instance {
    state: BlockState,
    /// Weights, in steps of the grid.
    weights: Vec<i32>,
    /// The last update wrote its pose.
    known: bool,
}

impl AnimatedReference {
    /// `heads` instances of a mesh.
    ///
    /// # Errors
    /// Errors of [`GroupPlan::new`].
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, heads: u32) -> Result<Self> {
        let group = GroupPlan::new(desc, layout, heads as usize)?;
        let instance =
            Instance { state: BlockState::new(&group), weights: vec![0; layout.targets.len()], known: false };
        Ok(Self { group, slots: desc.slots, instances: vec![instance; heads as usize] })
    }

    /// Samples and plans update `update`, which [`Playbacks::update`] has just returned.
    pub fn update(&mut self, clips: &Clips, heads: &Playbacks, update: u64) {
        self.group.clear();
        let slots = [update + u64::from(self.slots) - 1, update].map(|update| (update % u64::from(self.slots)) as u32);
        for (i, (instance, record)) in self.instances.iter_mut().zip(heads.records()).enumerate() {
            let Instance { state, weights, known } = instance;
            // Slots keep rotating while it is hidden: its slots become invalid.
            if record.has(HIDDEN) {
                *known = false;
                continue;
            }
            let known = std::mem::replace(known, true);
            *weights = sample(clips, record, heads.now());
            let step = self.group.grid().map_or(0.0, |grid| grid.weight_step());
            // Exact: steps fit the mantissa of a float32, and the step is a power of two.
            let weights: Vec<f32> = weights.iter().map(|&steps| steps as f32 * step).collect();
            state.commit(&mut self.group, i, &weights, known);
            // Slots rotate in every update, even without changes.
            state.emit(&mut self.group, i, slots, known);
        }
    }

    /// The work of the last update.
    pub fn list(&self) -> &WorkList {
        &self.group.list
    }

    /// The weights of an instance, in steps of the grid.
    pub fn weights(&self, head: usize) -> &[i32] {
        &self.instances[head].weights
    }
}

/// Frames of a clip around tick `now`, and the fraction: `(frame, next, f)` with f in 2⁻¹⁶.
fn between(record: &PlaybackRecord, frames: u32, now: u32) -> (u32, u32, u32) {
    let position = record.position(frames, (now.wrapping_sub(record.start) as i32).max(0).into());
    let (frame, f, last) = ((position >> 32) as u32, (position >> 16) as u32 & 0xffff, frames - 1);
    let at_end = if record.has(LOOP) { 0 } else { last };
    let next = if frame < last { frame + 1 } else { at_end };
    if record.has(REVERSED) { (last - frame, last - next, f) } else { (frame, next, f) }
}

/// k0 + (k1 − k0) · f · 2⁻¹⁶, rounded to nearest.
pub fn interpolate(k0: i32, k1: i32, f: u32) -> i32 {
    let product = i64::from(k1 - k0) * i64::from(f);
    k0 + ((product + 0x8000) >> 16) as i32
}

/// The weights of an instance at tick `now`, in steps of the grid, as in `glsl/animate.comp`.
pub fn sample(clips: &Clips, record: &PlaybackRecord, now: u32) -> Vec<i32> {
    if !record.has(PLAYING) {
        return vec![0; clips.targets()];
    }
    let clip = record.clip as usize;
    let (frame, next, f) = between(record, clips.words()[4 * clip + 1], now);
    let key = |frame, target| key(clips, clip, frame, target);
    let weight = |target| interpolate(key(frame, target), key(next, target), f);
    (0..clips.targets()).map(|target| interpolate(0, weight(target), factor(clips, record, target))).collect()
}

/// A key of a clip, in steps of the grid.
pub fn key(clips: &Clips, clip: usize, frame: u32, target: usize) -> i32 {
    let [first, _, shift, bits] = clips.words().as_chunks().0[clip];
    let at = frame as usize * clips.targets() + target;
    if bits == 32 {
        return clips.words()[first as usize + at] as i32;
    }
    let word = clips.words()[first as usize + at / 2];
    i32::from((word >> (16 * (at % 2))) as u16 as i16) << shift
}

/// The factor of a target at the record's level of detail, in 2⁻¹⁶.
fn factor(clips: &Clips, record: &PlaybackRecord, target: usize) -> u32 {
    if record.ranks_at == 0 {
        return 1 << 16;
    }
    let rank = clips.words()[record.ranks_at as usize + target];
    u64::from(record.level).saturating_sub(u64::from(rank) << 16).min(1 << 16) as u32
}
