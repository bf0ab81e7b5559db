//! Derives barriers from uses, and orders the steps of several crowds.
//!
//! Steps are recorded in rounds: the first steps of all crowds, then the second steps, and so on. A round is preceded
//! by a barrier if one of its uses depends on an earlier one; the barrier is the weakest that suffices.

use super::steps::{Resource, Scope, Steps, Use, Work};

/// The bits of a stage set.
const STAGES: usize = u32::BITS as usize;

/// A global memory barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Barrier {
    /// Accesses that must finish and become available.
    pub before: Scope,
    /// Accesses that wait and to which the former are visible.
    pub after: Scope,
}

impl Barrier {
    /// The barrier between the first writes of memory and its uses.
    pub fn between(written: &[Use], used: &[Use]) -> Option<Self> {
        let mut tracker = Tracker::default();
        tracker.use_all(written);
        tracker.needed(used)
    }
}

/// The barrier after an upload: any technique or draw may read base pose and deltas. All stages, so that any queue
/// supports it.
pub fn asset_uploaded() -> Barrier {
    Barrier { before: Use::copy(Resource::Asset).scope(), after: Scope::ANYTHING }
}

/// A recorded command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Entry {
    /// A memory barrier.
    Barrier(Barrier),
    /// A work.
    Work {
        /// Index of the crowd in the call.
        crowd: u32,
        /// Index of the step in its update.
        step: u32,
        /// The work.
        work: Work,
    },
}

impl Entry {
    /// Crowd and step of a work.
    pub fn step(&self) -> Option<(u32, u32)> {
        match self {
            Self::Barrier(_) => None,
            Self::Work { crowd, step, .. } => Some((*crowd, *step)),
        }
    }
}

/// The schedule of an update of one crowd or several, with reusable storage.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// The commands in order.
    pub entries: Vec<Entry>,
    trackers: Vec<Tracker>,
}

impl Schedule {
    /// Merges the steps of all `updates` into rounds, with at most one barrier between two rounds.
    ///
    /// Assumes that the previous update left memory as these steps leave it, and that its poses were read since.
    pub fn fill<'a>(&mut self, updates: impl Iterator<Item = &'a Steps> + Clone) {
        self.entries.clear();
        self.trackers.clear();
        self.trackers.extend(updates.clone().map(|steps| {
            let (mut tracker, last) = (Tracker::default(), steps.len());
            for step in 0..=last {
                let uses = steps.uses_of(step, last);
                tracker.needed(uses).iter().for_each(|barrier| tracker.wait(barrier));
                tracker.use_all(uses);
            }
            tracker
        }));
        let last = updates.clone().map(|steps| steps.len()).max().unwrap_or(0);
        for round in 0..=last {
            let uses = updates.clone().map(|steps| steps.uses_of(round, last));
            let needed = self.trackers.iter().zip(uses.clone()).filter_map(|(tracker, uses)| tracker.needed(uses));
            if let Some(barrier) =
                needed.reduce(|a, b| Barrier { before: a.before | b.before, after: a.after | b.after })
            {
                self.trackers.iter_mut().for_each(|tracker| tracker.wait(&barrier));
                self.entries.push(Entry::Barrier(barrier));
            }
            for (tracker, uses) in self.trackers.iter_mut().zip(uses) {
                tracker.use_all(uses);
            }
            for (crowd, steps) in (0..).zip(updates.clone()).filter(|(_, steps)| round < steps.len()) {
                let work = |work: &Work| Entry::Work { crowd, step: round as u32, work: work.clone() };
                self.entries.extend(steps.works_of(round).iter().map(work));
            }
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Memory {
    write: Scope,
    /// By stage: accesses to which the last write is visible.
    seen: [u32; STAGES],
    /// Stages that have read since the last write, or in its step.
    reads: u32,
    /// By reading stage: stages ordered after it.
    ordered: [u32; STAGES],
}

#[derive(Clone, Debug, Default)]
struct Tracker {
    memory: [Memory; Resource::COUNT],
}

/// The places of the bits of a set.
fn bits(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = set.trailing_zeros();
        set &= set.wrapping_sub(1);
        (lowest < u32::BITS).then_some(lowest as usize)
    })
}

impl Tracker {
    /// The weakest barrier that must precede `uses`; `None` if none is needed.
    fn needed(&self, uses: &[Use]) -> Option<Barrier> {
        let (mut before, mut after) = (Scope::default(), Scope::default());
        for u in uses {
            let memory = &self.memory[u.memory as usize];
            let unseen = memory.write.stages != 0 && memory.seen[u.stage.index()] & u.access as u32 == 0;
            let mut running = 0;
            if u.access.writes() {
                let unordered = bits(memory.reads).filter(|read| memory.ordered[*read] & u.stage as u32 == 0);
                running = unordered.fold(0, |set, read| set | 1 << read);
            }
            if running == 0 && !unseen {
                continue;
            }
            before.stages |= running;
            // Readers that have seen the last write chain it.
            if unseen && !bits(running).any(|read| memory.seen[read] != 0) {
                before = before | memory.write;
            }
            after = after | u.scope();
        }
        (after.stages != 0).then_some(Barrier { before, after })
    }

    /// Applies a recorded barrier.
    fn wait(&mut self, barrier: &Barrier) {
        let Barrier { before, after, .. } = *barrier;
        for memory in &mut self.memory {
            let chained = bits(before.stages).any(|stage| memory.seen[stage] != 0);
            if memory.write.stages != 0 && (before.contains(memory.write) || chained) {
                bits(after.stages).for_each(|stage| memory.seen[stage] |= after.accesses);
            }
            for read in bits(memory.reads) {
                if before.stages >> read & 1 != 0 || memory.ordered[read] & before.stages != 0 {
                    memory.ordered[read] |= after.stages;
                }
            }
        }
    }

    /// Applies a recorded step, after its barrier.
    fn use_all(&mut self, uses: &[Use]) {
        for u in uses.iter().filter(|u| u.access.writes()) {
            self.memory[u.memory as usize] = Memory::default();
        }
        for u in uses {
            let memory = &mut self.memory[u.memory as usize];
            if u.access.writes() {
                memory.write = memory.write | u.scope();
            } else {
                memory.reads |= u.stage as u32;
                memory.ordered[u.stage.index()] = 0;
            }
        }
    }
}
