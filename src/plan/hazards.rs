//! The hazard checker: proves each read and write of what is recorded against the barriers between them.
//!
//! No validation layer sees a missing barrier around transform-feedback writes, so this does, for every technique. It
//! reads works and barriers as data, follows every instance and slot, and does not know how barriers are derived. The
//! model is Vulkan's for global memory barriers: a write must be made available and visible to a later read or write
//! (RAW, WAW), and a read must be finished before a later write (WAR); dependencies chain where a barrier's first
//! stages cover the second stages of an earlier one. Works of one step may run at the same time: none may write what
//! another uses.

use super::schedule::{Barrier, Entry};
use super::steps::{Access, Stage, Work};
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
}

impl Memory {
    /// Whether all groups have it in common.
    const fn is_common(self) -> bool {
        matches!(self, Self::Clips | Self::Records | Self::Weights)
    }
}

/// One access of a work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryUse {
    /// Of which group; 0 for what all groups have in common.
    pub group: u32,
    /// What is accessed.
    pub memory: Memory,
    /// In which stage.
    pub stage: Stage,
    /// How.
    pub access: Access,
}

impl MemoryUse {
    /// A compute shader reads.
    pub const fn read(memory: Memory) -> Self {
        Self { group: 0, memory, stage: Stage::Compute, access: Access::ShaderRead }
    }

    /// A compute shader writes.
    pub const fn write(memory: Memory) -> Self {
        Self { group: 0, memory, stage: Stage::Compute, access: Access::ShaderWrite }
    }
}

/// What works that are carried out as one read and write.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Accesses {
    /// What is read.
    pub reads: Vec<MemoryUse>,
    /// What is written.
    pub writes: Vec<MemoryUse>,
    /// Memory that is read and written is read by the invocation that writes it, and by no other (or atomically).
    pub in_place: bool,
}

impl Accesses {
    /// Of compute shaders that read and write in place.
    pub fn compute(reads: impl IntoIterator<Item = Memory>, writes: impl IntoIterator<Item = Memory>) -> Self {
        Self {
            reads: reads.into_iter().map(MemoryUse::read).collect(),
            writes: writes.into_iter().map(MemoryUse::write).collect(),
            in_place: true,
        }
    }

    /// What a work of `group` does: all memory that groups do not have in common is its own.
    pub fn of_group(mut self, group: u32) -> Self {
        let own = |access: &&mut MemoryUse| !access.memory.is_common();
        self.reads.iter_mut().chain(&mut self.writes).filter(own).for_each(|access| access.group = group);
        self
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
        Entry::Work { crowd, step, .. } => Some((*crowd, *step)),
    };
    let runs = entries.chunk_by(|a, b| of_step(a).is_some() && of_step(a) == of_step(b));
    let event = |run: &[Entry]| match &run[0] {
        Entry::Barrier(barrier) => Event::Barrier(*barrier),
        Entry::Work { crowd, .. } => {
            let works = run.iter().filter_map(|entry| match entry {
                Entry::Work { work, .. } => Some(work.clone()),
                Entry::Barrier(_) => None,
            });
            Event::Step { crowd: *crowd, works: accesses(*crowd, &works.collect::<Vec<_>>()) }
        }
    };
    runs.map(event).collect()
}

/// Two accesses that no barrier orders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The earlier access.
    pub before: MemoryUse,
    /// The later one.
    pub after: MemoryUse,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match (self.before.access.writes(), self.after.access.writes()) {
            (true, true) => "write after write",
            (true, false) => "read after write",
            (false, true | false) => "write after read",
        };
        write!(
            f,
            "{kind} on {:?}: {:?} in {:?} is not ordered before {:?} in {:?}",
            self.after.memory, self.before.access, self.before.stage, self.after.access, self.after.stage
        )
    }
}

/// What is known of a piece of memory.
#[derive(Default)]
struct Track {
    /// The last write and what it has been made visible to: `(stages, accesses)` of each barrier that did.
    write: Option<(MemoryUse, Vec<(u8, u8)>)>,
    /// Reads since, each with the stages that wait for it.
    reads: Vec<(MemoryUse, u8)>,
}

/// Walks what is recorded.
#[derive(Default)]
pub struct HazardChecker {
    /// By crowd; the mesh is that of all.
    tracks: HashMap<(u32, u32, Memory), Track>,
    violations: Vec<Violation>,
}

impl HazardChecker {
    /// Nothing accessed yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// An upload writes the asset, and this barrier is recorded behind it.
    pub fn upload(&mut self, barrier: Option<Barrier>) {
        self.copy(0, &[Memory::Base, Memory::Deltas], barrier);
    }

    /// Copies and fills write memory of a crowd, and this barrier is recorded behind them.
    pub fn copy(&mut self, crowd: u32, written: &[Memory], barrier: Option<Barrier>) {
        for &memory in written {
            self.access(crowd, MemoryUse { group: 0, memory, stage: Stage::Transfer, access: Access::TransferWrite });
        }
        barrier.iter().for_each(|barrier| self.barrier(barrier));
    }

    /// A draw of the host reads a pose of the first group.
    pub fn draw(&mut self, crowd: u32, instance: u32, slot: u32) {
        self.draw_group(crowd, 0, instance, slot);
    }

    /// A draw of the host reads a pose, as vertex attributes and in the vertex shader.
    pub fn draw_group(&mut self, crowd: u32, group: u32, instance: u32, slot: u32) {
        let memory = Memory::Pose { instance, slot };
        self.access(crowd, MemoryUse { group, memory, stage: Stage::VertexInput, access: Access::AttributeRead });
        self.access(crowd, MemoryUse { group, memory, stage: Stage::VertexShader, access: Access::ShaderRead });
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
    pub fn finish(self) -> Result<(), Vec<Violation>> {
        if self.violations.is_empty() { Ok(()) } else { Err(self.violations) }
    }

    fn step(&mut self, crowd: u32, works: &[Accesses]) {
        let mut users: HashMap<(u32, Memory), (usize, MemoryUse)> = HashMap::new();
        for (work, accesses) in works.iter().enumerate() {
            for &access in accesses.writes.iter().chain(&accesses.reads) {
                let (user, earlier) = *users.entry((access.group, access.memory)).or_insert((work, access));
                if user != work && (earlier.access.writes() || access.access.writes()) {
                    self.violations.push(Violation { before: earlier, after: access });
                }
            }
        }
        works.iter().flat_map(|work| &work.reads).for_each(|read| self.read(crowd, *read));
        for work in works {
            for write in &work.writes {
                let own = work
                    .reads
                    .iter()
                    .find(|read| work.in_place && (read.group, read.memory) == (write.group, write.memory));
                self.write(crowd, *write, own.copied());
            }
        }
    }

    fn barrier(&mut self, barrier: &Barrier) {
        let Barrier { before, after, .. } = *barrier;
        for track in self.tracks.values_mut() {
            if let Some((write, visible)) = &mut track.write {
                let direct = before.has_stage(write.stage) && before.has_access(write.access);
                // Available already: a later barrier passes it on where its first stages wait for the second
                // stages of the one that made it so.
                let chained = visible.iter().any(|(stages, _)| stages & before.stages != 0);
                if direct || chained {
                    visible.push((after.stages, after.accesses));
                }
            }
            for (read, ordered) in &mut track.reads {
                if before.has_stage(read.stage) || *ordered & before.stages != 0 {
                    *ordered |= after.stages;
                }
            }
        }
    }

    fn track(&mut self, crowd: u32, MemoryUse { group, memory, .. }: MemoryUse) -> &mut Track {
        let crowd = if matches!(memory, Memory::Base | Memory::Deltas) { 0 } else { crowd };
        self.tracks.entry((crowd, group, memory)).or_default()
    }

    fn access(&mut self, crowd: u32, access: MemoryUse) {
        if access.access.writes() { self.write(crowd, access, None) } else { self.read(crowd, access) }
    }

    fn read(&mut self, crowd: u32, read: MemoryUse) {
        let track = self.track(crowd, read);
        let unseen = track.write.as_ref().filter(|(_, visible)| !sees(visible, read)).map(|(write, _)| *write);
        track.reads.push((read, 0));
        self.violations.extend(unseen.map(|before| Violation { before, after: read }));
    }

    fn write(&mut self, crowd: u32, write: MemoryUse, own_read: Option<MemoryUse>) {
        let track = self.track(crowd, write);
        let unseen = track.write.replace((write, vec![])).filter(|(_, visible)| !sees(visible, write));
        let mut reads = std::mem::take(&mut track.reads);
        if let Some(at) = own_read.and_then(|own| reads.iter().rposition(|(read, _)| *read == own)) {
            reads.remove(at);
        }
        let running = reads.into_iter().filter(|(_, ordered)| ordered & write.stage as u8 == 0);
        let earlier = unseen.map(|(earlier, _)| earlier).into_iter().chain(running.map(|(read, _)| read));
        self.violations.extend(earlier.map(|before| Violation { before, after: write }));
    }
}

fn sees(visible: &[(u8, u8)], access: MemoryUse) -> bool {
    visible.iter().any(|(stages, accesses)| stages & access.stage as u8 != 0 && accesses & access.access as u8 != 0)
}
