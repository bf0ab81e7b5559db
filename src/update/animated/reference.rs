//! The CPU reference of the kernels that sample and plan, `glsl/animate.comp` to `glsl/plan.comp`: the planner of the
//! block formats, with a few choices made.

use super::budget::{Budget, Deferred};
use super::clips::Clips;
use super::playback::Playbacks;
use super::sample::{HeadRecord, sample};
use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::BlockIndex;
use crate::plan::{UpdateDesc, UpdateStats};
use crate::update::Runner;
use crate::update::blocks::{BlockState, Frame, Scratch, WorkList};
use std::sync::Arc;

/// What the GPU samples and plans, worked out on the CPU.
pub struct AnimatedReference {
    index: Arc<BlockIndex>,
    states: Vec<BlockState>,
    slots: u32,
    /// Heads that some update wrote.
    known: Vec<bool>,
    /// Heads left out of the last update.
    hidden: Vec<bool>,
    /// Of each head, in steps of the grid.
    weights: Vec<Deferred>,
    budget: Option<Budget>,
    sampled: Vec<i32>,
    list: WorkList,
    scratch: Scratch,
    asked: Vec<f32>,
}

impl AnimatedReference {
    /// `heads` heads of a mesh, updated as `desc` says.
    ///
    /// # Errors
    /// As [`BlockState::new`] and [`Clips::new`].
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, heads: u32) -> Result<Self> {
        desc.check_all(Some(layout), Runner::Animated(None))?;
        let Some(index) = &layout.blocks else { unreachable!("checked") };
        let budget = Budget::new(desc.error_budget, index)?;
        // What waits is decided before, target by target: the planner gets the weights that go.
        let mut state = BlockState::new(UpdateDesc { error_budget: 0.0, ..desc }, layout, index)?;
        state.write_whole_blocks();
        let (heads, targets) = (heads as usize, layout.targets.len());
        Ok(Self {
            index: index.clone(),
            states: vec![state; heads],
            slots: desc.slots,
            known: vec![false; heads],
            hidden: vec![false; heads],
            weights: vec![Deferred::new(targets); heads],
            budget,
            sampled: vec![0; targets],
            list: WorkList::new(index, heads),
            scratch: Scratch::default(),
            asked: vec![0.0; targets],
        })
    }

    /// Sample and plan the update numbered `update`, which [`Playbacks::update`] returned last.
    pub fn update(&mut self, clips: &Clips, heads: &Playbacks, update: u64) -> &WorkList {
        self.list.clear();
        let slots = [update + u64::from(self.slots) - 1, update].map(|update| (update % u64::from(self.slots)) as u32);
        for (i, (state, record)) in self.states.iter_mut().zip(heads.records()).enumerate() {
            let hidden = record.has(HeadRecord::HIDDEN);
            let was_hidden = std::mem::replace(&mut self.hidden[i], hidden);
            if hidden {
                continue;
            }
            let known = std::mem::replace(&mut self.known[i], true);
            if was_hidden {
                state.forget_slots();
            }
            sample(clips, record, heads.now(), &mut self.sampled);
            // A head that is new or shown again has nothing to wait with.
            let budget = self.budget.as_ref().filter(|_| known && !was_hidden);
            self.weights[i].commit(&self.sampled, budget, &self.index);
            let step = state.exact().map_or(0.0, |grid| grid.weight_step());
            // Steps have fewer bits than a float32's, and the step is a power of two: exact.
            self.asked
                .iter_mut()
                .zip(self.weights[i].committed())
                .for_each(|(asked, &steps)| *asked = steps as f32 * step);
            let mut frame = Frame::new(&self.index, i, &mut self.scratch, &mut self.list);
            state.commit(&mut frame, &self.asked, known);
            // Slots rotate in every update, also where nothing changed.
            state.emit(&mut frame, slots, known, &mut UpdateStats::default());
        }
        &self.list
    }

    /// The weights that the poses of a head hold, in steps of the grid.
    pub fn weights(&self, head: usize) -> &[i32] {
        self.weights[head].committed()
    }

    /// The weights that were asked for.
    pub fn requested(&self, head: usize) -> &[i32] {
        self.weights[head].requested()
    }
}
