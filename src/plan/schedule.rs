//! Barriers from uses: in which order steps are recorded, and what has to wait for what.
//!
//! The steps of one crowd or of several are recorded in rounds: the first steps of all, the second steps of all, and so
//! on, with a barrier between two rounds where a use has to wait for an earlier one, as weak as the uses allow.

use super::steps::{Resource, Scope, Steps, Use, Work};

/// As many as a set of stages has bits.
const STAGES: usize = u16::BITS as usize;

/// A global memory barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Barrier {
    /// What must be finished and made available.
    pub before: Scope,
    /// What waits, and sees it.
    pub after: Scope,
}

impl Barrier {
    /// The barrier between what was just written for the first time, and what uses it.
    pub fn between(written: &[Use], used: &[Use]) -> Option<Self> {
        let mut tracker = Tracker::default();
        tracker.use_all(written);
        tracker.needed(used)
    }
}

/// The barrier after the copies of an upload: every technique and every draw may read base pose and deltas. It names no
/// stage, so that any queue takes it.
pub fn asset_uploaded() -> Option<Barrier> {
    Some(Barrier { before: Use::copy(Resource::Asset).scope(), after: Scope::ANYTHING })
}

/// What is recorded, one after the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Entry {
    /// A memory barrier.
    Barrier(Barrier),
    /// A work.
    Work {
        /// Which crowd of the call.
        crowd: u32,
        /// Which step of its update.
        step: u32,
        /// What is done.
        work: Work,
    },
}

/// The schedule of an update of one crowd or several, with what making it takes.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// What is recorded.
    pub entries: Vec<Entry>,
    trackers: Vec<Tracker>,
}

impl Schedule {
    /// Put the steps of all `updates` into common rounds, with one barrier between two of them at most.
    ///
    /// Memory is taken to be as the update before left it, which is as these steps leave it, with the poses read since.
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

/// What is known of one resource.
#[derive(Clone, Copy, Debug, Default)]
struct Memory {
    /// The last write.
    write: Scope,
    /// By stage: accesses that see it.
    seen: [u8; STAGES],
    /// Stages that read since, and in the step of the write.
    reads: u16,
    /// By reading stage: stages that wait for it.
    ordered: [u16; STAGES],
}

/// Follows the uses of a crowd's memory.
#[derive(Clone, Debug, Default)]
struct Tracker {
    memory: [Memory; Resource::COUNT],
}

fn bits(set: u16) -> impl Iterator<Item = usize> {
    (0..STAGES).filter(move |stage| set >> stage & 1 != 0)
}

impl Tracker {
    /// The weakest barrier after which `uses` may follow.
    fn needed(&self, uses: &[Use]) -> Option<Barrier> {
        let (mut before, mut after) = (Scope::default(), Scope::default());
        for u in uses {
            let memory = &self.memory[u.memory as usize];
            let unseen = memory.write.stages != 0 && memory.seen[u.stage.index()] & u.access as u8 == 0;
            let mut running = 0;
            if u.access.writes() {
                let unordered = bits(memory.reads).filter(|read| memory.ordered[*read] & u.stage as u16 == 0);
                running = unordered.fold(0, |set, read| set | 1 << read);
            }
            if running == 0 && !unseen {
                continue;
            }
            before.stages |= running;
            // Readers that saw the last write pass it on.
            if unseen && !bits(running).any(|read| memory.seen[read] != 0) {
                before = before | memory.write;
            }
            after = after | u.scope();
        }
        (after.stages != 0).then_some(Barrier { before, after })
    }

    /// A barrier was recorded.
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

    /// A step was recorded, after the barrier that it needs.
    fn use_all(&mut self, uses: &[Use]) {
        for u in uses.iter().filter(|u| u.access.writes()) {
            self.memory[u.memory as usize] = Memory::default();
        }
        for u in uses {
            let memory = &mut self.memory[u.memory as usize];
            if u.access.writes() {
                memory.write = memory.write | u.scope();
            } else {
                memory.reads |= u.stage as u16;
                memory.ordered[u.stage.index()] = 0;
            }
        }
    }
}
