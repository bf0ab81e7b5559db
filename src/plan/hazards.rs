//! The hazard checker: proves each read and write of what is recorded against the barriers between them.
//!
//! No validation layer sees a missing barrier around transform-feedback writes, so this does, for every technique. It
//! reads works and barriers as data, follows every instance and slot, and does not know how barriers are derived. The
//! model is Vulkan's for global memory barriers: a write must be made available and visible to a later read or write
//! (RAW, WAW), and a read must be finished before a later write (WAR); dependencies chain where a barrier's first
//! stages cover the second stages of an earlier one. Works of one step may run at the same time: none may write what
//! another uses.

use super::schedule::{Barrier, Entry};
use super::steps::{Access, Resource, Scope, Stage, Use, Work};
use std::collections::HashMap;

/// A piece of memory that works read or write. What belongs to a group of the mesh, each group has for itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Memory {
    /// Base pose of the mesh.
    Base,
    /// Deltas of the mesh.
    Deltas,
    /// A pose slot of an instance.
    Pose {
        /// The instance.
        instance: u32,
        /// The slot.
        slot: u32,
    },
    /// The integer sums of an instance.
    Sums {
        /// The instance.
        instance: u32,
    },
    /// Clips, and which targets touch which blocks.
    Clips,
    /// What instances play.
    Records,
    /// Weights of instances that are animated on the GPU, and which of them changed.
    Weights,
    /// Which updates touched their blocks.
    History,
    /// Work lists that the GPU writes.
    WorkList,
    /// How many items they have.
    Counters,
    /// The same as arguments of dispatches.
    Arguments,
    /// What a step after the pose writes for an instance.
    After {
        /// All that it writes of the kind.
        resource: Resource,
        /// The instance.
        instance: u32,
        /// Which of the places that are written in turn.
        output: u32,
    },
}

/// What works that are carried out as one read and write.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Accesses {
    /// The group of the mesh.
    pub group: u32,
    /// Reads and writes.
    pub uses: Vec<Use<Memory>>,
    /// Memory that is read and written is read by the invocation that writes it, and by no other (or atomically).
    pub in_place: bool,
}

impl Accesses {
    /// Of compute shaders that read and write in place, in the first group.
    pub fn compute(reads: impl IntoIterator<Item = Memory>, writes: impl IntoIterator<Item = Memory>) -> Self {
        let uses = reads.into_iter().map(Use::read).chain(writes.into_iter().map(Use::write)).collect();
        Self { group: 0, uses, in_place: true }
    }

    /// Its writes, or its reads.
    fn writing(&self, write: bool) -> impl Iterator<Item = Use<Memory>> {
        self.uses.iter().filter(move |used| used.access.writes() == write).copied()
    }
}

/// What was recorded, as the checker sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A barrier.
    Barrier(Barrier),
    /// A step of a crowd.
    Step {
        /// Which crowd of the recording.
        crowd: u32,
        /// Its works, as far as they are independent of each other.
        works: Vec<Accesses>,
    },
}

/// `entries` as events; `accesses` says what the works of a crowd's step do.
pub fn trace(entries: &[Entry], mut accesses: impl FnMut(u32, &[Work]) -> Vec<Accesses>) -> Vec<Event> {
    let of_step = |entry: &Entry| match entry {
        Entry::Barrier(_) => None,
        Entry::Work { crowd, step, work } => Some(((*crowd, *step), work.clone())),
    };
    let same = |a: &Entry, b: &Entry| of_step(a).zip(of_step(b)).is_some_and(|((a, _), (b, _))| a == b);
    let event = |run: &[Entry]| match &run[0] {
        Entry::Barrier(barrier) => Event::Barrier(*barrier),
        Entry::Work { crowd, .. } => {
            let (_, works): (Vec<_>, Vec<Work>) = run.iter().filter_map(of_step).unzip();
            Event::Step { crowd: *crowd, works: accesses(*crowd, &works) }
        }
    };
    entries.chunk_by(same).map(event).collect()
}

/// Two accesses that no barrier orders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The earlier access.
    pub before: Use<Memory>,
    /// The later one.
    pub after: Use<Memory>,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { before, after } = self;
        let kind = |used: &Use<Memory>| if used.access.writes() { "write" } else { "read" };
        write!(f, "{} after {} on {:?}: ", kind(after), kind(before), after.memory)?;
        write!(f, "{:?} in {:?} is not ordered before ", before.access, before.stage)?;
        write!(f, "{:?} in {:?}", after.access, after.stage)
    }
}

/// What is known of a piece of memory.
#[derive(Default)]
struct Track {
    /// The last write, and the second sides of the barriers that have made it visible.
    write: Option<(Use<Memory>, Vec<Scope>)>,
    /// Reads since, each with the stages that wait for it.
    reads: Vec<(Use<Memory>, u16)>,
}

/// Crowd, group and memory.
type Place = (u32, u32, Memory);

/// The mesh belongs to all crowds; what instances play and their weights, to all groups.
const fn place(crowd: u32, group: u32, memory: Memory) -> Place {
    match memory {
        Memory::Base | Memory::Deltas => (0, group, memory),
        Memory::Clips | Memory::Records | Memory::Weights => (crowd, 0, memory),
        Memory::Pose { .. }
        | Memory::Sums { .. }
        | Memory::History
        | Memory::WorkList
        | Memory::Counters
        | Memory::Arguments
        | Memory::After { .. } => (crowd, group, memory),
    }
}

/// Walks what is recorded.
#[derive(Default)]
pub struct HazardChecker {
    tracks: HashMap<Place, Track>,
    violations: Vec<Violation>,
}

impl HazardChecker {
    /// An upload writes the asset, and this barrier follows it.
    pub fn upload(&mut self, barrier: Option<Barrier>) {
        self.copy(0, &[Memory::Base, Memory::Deltas], barrier);
    }

    /// Copies and fills write memory of a crowd, and this barrier follows them.
    pub fn copy(&mut self, crowd: u32, written: &[Memory], barrier: Option<Barrier>) {
        written.iter().for_each(|&memory| self.write(place(crowd, 0, memory), Use::copy(memory), None));
        barrier.iter().for_each(|barrier| self.barrier(barrier));
    }

    /// A draw of the host reads a pose of the first group.
    pub fn draw(&mut self, crowd: u32, instance: u32, slot: u32) {
        self.draw_group(crowd, 0, instance, slot);
    }

    /// A draw of the host reads a pose, as vertex attributes and in the vertex shader.
    pub fn draw_group(&mut self, crowd: u32, group: u32, instance: u32, slot: u32) {
        let memory = Memory::Pose { instance, slot };
        self.read(place(crowd, group, memory), Use::new(memory, Stage::VertexInput, Access::AttributeRead));
        self.read(place(crowd, group, memory), Use::new(memory, Stage::VertexShader, Access::ShaderRead));
    }

    /// The host reads what a step after the pose wrote, as vertex attributes.
    pub fn read_after(&mut self, crowd: u32, memory: Memory) {
        self.read(place(crowd, 0, memory), Use::new(memory, Stage::VertexInput, Access::AttributeRead));
    }

    /// A queue signals a semaphore after all that was submitted to it so far; another waits for it, in these stages and
    /// for any access. What follows, of whichever queue, comes after the wait.
    pub fn semaphore(&mut self, waiting: &[Stage]) {
        let stages = waiting.iter().fold(0, |stages, stage| stages | *stage as u16);
        self.barrier(&Barrier { before: Scope::ANYTHING, after: Scope { stages, ..Scope::ANYTHING } });
    }

    /// A recorded update.
    pub fn update(&mut self, events: &[Event]) {
        for event in events {
            match event {
                Event::Barrier(barrier) => self.barrier(barrier),
                Event::Step { crowd, works } => self.step(*crowd, works),
            }
        }
    }

    /// What was found.
    ///
    /// # Errors
    /// Accesses that no barrier orders.
    pub fn finish(self) -> Result<(), Vec<Violation>> {
        if self.violations.is_empty() { Ok(()) } else { Err(self.violations) }
    }

    fn step(&mut self, crowd: u32, works: &[Accesses]) {
        let mut users: HashMap<Place, (usize, Use<Memory>)> = HashMap::new();
        for (number, work) in works.iter().enumerate() {
            for after in work.writing(true).chain(work.writing(false)) {
                let first = users.entry(place(crowd, work.group, after.memory)).or_insert((number, after));
                let (user, before) = *first;
                if user != number && (before.access.writes() || after.access.writes()) {
                    self.violations.push(Violation { before, after });
                }
            }
        }
        for work in works {
            work.writing(false).for_each(|read| self.read(place(crowd, work.group, read.memory), read));
        }
        for work in works {
            for write in work.writing(true) {
                let own = work.writing(false).find(|read| work.in_place && read.memory == write.memory);
                self.write(place(crowd, work.group, write.memory), write, own);
            }
        }
    }

    fn barrier(&mut self, barrier: &Barrier) {
        let Barrier { before, after } = *barrier;
        for track in self.tracks.values_mut() {
            if let Some((write, visible)) = &mut track.write {
                let direct = before.has_stage(write.stage) && before.has_access(write.access);
                // Available already: a later barrier passes it on where its first stages wait for the second
                // stages of the one that made it so.
                let chained = visible.iter().any(|scope| scope.stages & before.stages != 0);
                if direct || chained {
                    visible.push(after);
                }
            }
            for (read, ordered) in &mut track.reads {
                if before.has_stage(read.stage) || *ordered & before.stages != 0 {
                    *ordered |= after.stages;
                }
            }
        }
    }

    fn read(&mut self, place: Place, after: Use<Memory>) {
        let track = self.tracks.entry(place).or_default();
        track.reads.push((after, 0));
        let unseen = track.write.iter().filter(|(_, visible)| !sees(visible, after));
        self.violations.extend(unseen.map(|&(before, _)| Violation { before, after }));
    }

    fn write(&mut self, place: Place, after: Use<Memory>, own_read: Option<Use<Memory>>) {
        let track = self.tracks.entry(place).or_default();
        let unseen = track.write.replace((after, vec![])).filter(|(_, visible)| !sees(visible, after));
        let mut reads = std::mem::take(&mut track.reads);
        if let Some(at) = own_read.and_then(|own| reads.iter().rposition(|(read, _)| *read == own)) {
            reads.remove(at);
        }
        let running = reads.into_iter().filter(|(_, ordered)| ordered & after.stage as u16 == 0);
        let earlier = unseen.map(|(earlier, _)| earlier).into_iter().chain(running.map(|(read, _)| read));
        self.violations.extend(earlier.map(|before| Violation { before, after }));
    }
}

fn sees(visible: &[Scope], access: Use<Memory>) -> bool {
    visible.iter().any(|scope| scope.has_stage(access.stage) && scope.has_access(access.access))
}

/// Counts the barriers of the updates numbered `of`, and asserts that each is needed: without it `is_right`, which says
/// whether updates have no hazard, is false. Barriers with nothing between them count as one: an update without works
/// of a technique has such.
///
/// # Panics
/// The updates have a hazard as they are; a barrier is not needed.
pub fn barriers_needed(
    updates: &[Vec<Event>],
    of: impl IntoIterator<Item = usize>,
    is_right: impl Fn(&[Vec<Event>]) -> bool,
) -> usize {
    assert!(is_right(updates));
    let same = |a: &Event, b: &Event| matches!((a, b), (Event::Barrier(_), Event::Barrier(_)));
    let mut found = 0;
    for update in of {
        let mut runs: Vec<&[Event]> = updates[update].chunk_by(same).collect();
        for at in 0..runs.len() {
            let dropped = std::mem::take(&mut runs[at]);
            if matches!(dropped[0], Event::Barrier(_)) {
                let mut faulty = updates.to_vec();
                faulty[update] = runs.concat();
                assert!(!is_right(&faulty), "update {update}: dropped {dropped:?}");
                found += 1;
            }
            runs[at] = dropped;
        }
    }
    found
}
