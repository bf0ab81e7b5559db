//! The hazard checker: proves that recorded barriers order every read and write.
//!
//! Validation layers miss barriers around transform feedback, so this checks every technique. It reads works and
//! barriers as data, says itself what each work reads and writes, tracks every instance and slot, and shares no code
//! with the derivation of barriers. The model is Vulkan's for global memory barriers: a write must be available and
//! visible to later accesses (RAW, WAW), a read must finish before a later write (WAR), and dependencies chain when a
//! barrier's first stages include the second stages of an earlier one. Works of one step may run concurrently: none may
//! write what another uses.

#![allow(dead_code, reason = "each program uses some of it")]

use deltamorph::internals::plan::schedule::{Barrier, Entry};
use deltamorph::internals::plan::steps::PostMorphPass;
use deltamorph::internals::plan::steps::{Access, Owner, Resource, Scope, Source, Stage, Use, Work};
use deltamorph::internals::update::animated::{Animated, AnimatedKernel};
use deltamorph::internals::update::blocks::{BlocksTechnique, Item};
use deltamorph::{Crowd, UpdatePath};
use std::any::Any;
use std::collections::{HashMap, HashSet};

/// Memory that works access. Each group of the mesh has its own, unless `place` says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Memory {
    /// Base pose of the mesh.
    Base,
    /// Deltas of the mesh.
    Deltas,
    /// A pose slot of an instance.
    Pose { instance: u32, slot: u32 },
    /// The integer sums of an instance.
    Sums { instance: u32 },
    /// Clips, and the table of targets by block.
    Clips,
    /// Clips and times that instances play.
    Records,
    /// Weights of instances animated on the GPU, and their changes.
    Weights,
    /// The last update that touched each block.
    History,
    /// Work lists written by the GPU.
    WorkList,
    /// Item counts of work lists.
    Counters,
    /// Indirect dispatch arguments, from those counts.
    Arguments,
    /// An output of a post-morph pass.
    After {
        resource: Resource,
        instance: u32,
        /// Index of the buffer, of those written in turn.
        output: u32,
    },
}

/// Accesses of works that are dispatched together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Accesses {
    /// The group of the mesh.
    pub group: u32,
    pub uses: Vec<Use<Memory>>,
    /// Read-modify-write: memory that is both read and written is read only by the invocation that writes it, or
    /// atomically.
    pub in_place: bool,
}

impl Accesses {
    /// Compute shaders, in place, in group 0.
    pub fn compute(reads: impl IntoIterator<Item = Memory>, writes: impl IntoIterator<Item = Memory>) -> Self {
        let uses = reads.into_iter().map(Use::read).chain(writes.into_iter().map(Use::write)).collect();
        Self { group: 0, uses, in_place: true }
    }

    /// Its writes if `write`, else its reads.
    fn writing(&self, write: bool) -> impl Iterator<Item = Use<Memory>> {
        self.uses.iter().filter(move |used| used.access.writes() == write).copied()
    }
}

/// Reads and writes of the works of a step that `crowd` has planned last.
pub fn accesses(crowd: &Crowd, works: &[Work]) -> Vec<Accesses> {
    let technique: &dyn Any = crowd.technique();
    let path = crowd.desc().update.path;
    if let Owner::Pass(kind) = works[0].owner {
        return works.iter().map(|work| after(kind, work)).collect();
    }
    if technique.is::<Animated>() {
        return works.iter().map(|work| animated(work, crowd.desc().instances)).collect();
    }
    if let Some(technique) = technique.downcast_ref::<BlocksTechnique>() {
        let of = |works: &[Work]| blocks(works[0].group, works.iter().flat_map(|work| technique.items_of(work)));
        return works.chunk_by(|a, b| a.group == b.group).map(of).collect();
    }
    let of = match path.name() {
        "scatter" => scatter,
        "texture" => texture,
        _ => return works.iter().map(|work| dense(path, work)).collect(),
    };
    works.iter().map(of).collect()
}

/// Dense passes.
pub fn dense(path: UpdatePath, work: &Work) -> Accesses {
    let (read, write) = match path.name() {
        "feedback" => ((Stage::VertexInput, Access::AttributeRead), (Stage::TransformFeedback, Access::FeedbackWrite)),
        "vertex-store" => ((Stage::VertexInput, Access::AttributeRead), (Stage::VertexShader, Access::ShaderWrite)),
        _ => ((Stage::Compute, Access::ShaderRead), (Stage::Compute, Access::ShaderWrite)),
    };
    let instance = work.instance;
    let source = match work.source {
        Source::Base => Memory::Base,
        Source::Slot(slot) => Memory::Pose { instance, slot },
    };
    let deltas = (!work.items.is_empty()).then_some(Memory::Deltas);
    let reads = deltas.into_iter().chain([source]).map(|memory| Use::new(memory, read.0, read.1));
    let destination = Memory::Pose { instance, slot: work.destination };
    let uses = reads.chain([Use::new(destination, write.0, write.1)]).collect();
    Accesses { group: work.group, uses, in_place: path.works_in_place() }
}

/// Blocks. A block of an instance occurs in one item, so all works of a group count as one.
pub fn blocks<'a>(group: u32, items: impl IntoIterator<Item = &'a Item>) -> Accesses {
    let mut uses = HashSet::new();
    for &Item { instance, source, destination, .. } in items {
        let source = source.map_or(Memory::Base, |slot| Memory::Pose { instance, slot });
        let pose = Memory::Pose { instance, slot: destination };
        uses.extend(Accesses::compute([Memory::Deltas, source], [pose]).uses);
    }
    Accesses { group, in_place: true, uses: uses.into_iter().collect() }
}

/// Works of an update that the GPU plans, of a crowd of `instances`.
pub fn animated(work: &Work, instances: u32) -> Accesses {
    use AnimatedKernel as K;
    use Memory as M;
    let accesses = match AnimatedKernel::ALL[work.kernel as usize] {
        K::Records => Accesses { uses: vec![Use::copy(M::Records)], ..Accesses::default() },
        K::Sample => Accesses::compute([M::Clips, M::Records, M::Weights], [M::Weights]),
        // Counters are atomic.
        K::Plan => {
            Accesses::compute([M::Clips, M::Weights, M::History, M::Counters], [M::History, M::WorkList, M::Counters])
        }
        K::Arguments => Accesses::compute([M::Counters], [M::Counters, M::Arguments, M::WorkList]),
        K::Blocks => {
            let pose = |slot| (0..instances).map(move |instance| M::Pose { instance, slot });
            let Source::Slot(source) = work.source else { panic!("blocks are read from a slot") };
            let reads = [M::WorkList, M::Deltas].into_iter().chain(pose(source));
            let mut all = Accesses::compute(reads, pose(work.destination));
            all.uses.push(Use::new(M::Arguments, Stage::Indirect, Access::IndirectRead));
            all
        }
    };
    Accesses { group: work.group, ..accesses }
}

/// A post-morph pass.
fn after(kind: PostMorphPass, work: &Work) -> Accesses {
    let instance = work.instance;
    let Source::Slot(slot) = work.source else { panic!("post-morph passes read a slot") };
    // Of the asset, steps read only the base pose.
    let memory = |resource| match resource {
        Resource::Asset => Memory::Base,
        Resource::Poses => Memory::Pose { instance, slot },
        _ => Memory::After { resource, instance, output: work.destination },
    };
    let uses = kind.uses().iter().map(|used| Use::new(memory(used.memory), used.stage, used.access)).collect();
    Accesses { group: 0, uses, in_place: true }
}

/// The baseline `scatter`: clears sums, adds to them, turns them into poses. Atomics commute: those of one work need no
/// order.
fn scatter(work: &Work) -> Accesses {
    let instance = work.instance;
    let sums = Memory::Sums { instance };
    match work.kernel {
        0 => Accesses { uses: vec![Use::copy(sums)], ..Accesses::default() },
        1 => Accesses::compute([Memory::Deltas, sums], [sums]),
        _ => Accesses::compute([Memory::Base, sums], [Memory::Pose { instance, slot: work.destination }]),
    }
}

/// The baseline `texture`: displacement textures are an instance's pose, for any number of slots.
fn texture(work: &Work) -> Accesses {
    let pose = Memory::Pose { instance: work.instance, slot: 0 };
    let uses = vec![
        Use::new(Memory::Deltas, Stage::VertexShader, Access::ShaderRead),
        Use::new(Memory::Deltas, Stage::FragmentShader, Access::ShaderRead),
        Use::new(pose, Stage::ColourOutput, Access::Blend),
    ];
    Accesses { group: work.group, uses, ..Accesses::default() }
}

/// A recorded step or barrier.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    Barrier(Barrier),
    /// Works of a crowd between two barriers.
    Step {
        /// Index of the crowd in the recording.
        crowd: u32,
        /// Independent of each other.
        works: Vec<Accesses>,
    },
}

/// Converts `entries` to events; `accesses(crowd, works)` gives the accesses of a step.
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

/// Two accesses without a barrier that orders them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    pub before: Use<Memory>,
    pub after: Use<Memory>,
}

#[derive(Default)]
struct Track {
    /// The last write, and the scopes it is visible to.
    write: Option<(Use<Memory>, Vec<Scope>)>,
    /// Reads since then, each with the stages ordered after it.
    reads: Vec<(Use<Memory>, u32)>,
}

/// Crowd, group and memory.
type Place = (u32, u32, Memory);

/// All crowds share the mesh; all groups share clips, times and weights.
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

/// Checks a recording, event by event.
#[derive(Default)]
pub struct HazardChecker {
    tracks: HashMap<Place, Track>,
    violations: Vec<Violation>,
}

impl HazardChecker {
    /// An upload of the mesh, followed by `barrier`.
    pub fn upload(&mut self, barrier: Barrier) {
        self.copy(0, &[Memory::Base, Memory::Deltas], Some(barrier));
    }

    /// Copies or fills of a crowd's memory, followed by `barrier`.
    pub fn copy(&mut self, crowd: u32, written: &[Memory], barrier: Option<Barrier>) {
        written.iter().for_each(|&memory| self.write(place(crowd, 0, memory), Use::copy(memory), None));
        barrier.iter().for_each(|barrier| self.barrier(barrier));
    }

    /// [`Self::draw_group`] of group 0.
    pub fn draw(&mut self, crowd: u32, instance: u32, slot: u32) {
        self.draw_group(crowd, 0, instance, slot);
    }

    /// The host draws a pose: reads it as vertex attributes and in the vertex shader.
    pub fn draw_group(&mut self, crowd: u32, group: u32, instance: u32, slot: u32) {
        let memory = Memory::Pose { instance, slot };
        self.read(place(crowd, group, memory), Use::new(memory, Stage::VertexInput, Access::AttributeRead));
        self.read(place(crowd, group, memory), Use::new(memory, Stage::VertexShader, Access::ShaderRead));
    }

    /// The host reads an output of a post-morph pass as vertex attributes.
    pub fn read_after(&mut self, crowd: u32, memory: Memory) {
        self.read(place(crowd, 0, memory), Use::new(memory, Stage::VertexInput, Access::AttributeRead));
    }

    /// A semaphore between queues: events before it are visible to every access in stages `waiting` after it.
    pub fn semaphore(&mut self, waiting: &[Stage]) {
        let stages = waiting.iter().fold(0, |stages, stage| stages | *stage as u32);
        self.barrier(&Barrier { before: Scope::ANYTHING, after: Scope { stages, ..Scope::ANYTHING } });
    }

    /// Checks the events of an update.
    pub fn update(&mut self, events: &[Event]) {
        for event in events {
            match event {
                Event::Barrier(barrier) => self.barrier(barrier),
                Event::Step { crowd, works } => self.step(*crowd, works),
            }
        }
    }

    /// Ends the check; the error has the accesses that no barrier orders.
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
                let direct = has(before, *write);
                // Already available: a later barrier extends visibility if its first stages include the earlier
                // barrier's second stages.
                let chained = visible.iter().any(|scope| scope.stages & before.stages != 0);
                if direct || chained {
                    visible.push(after);
                }
            }
            for (read, ordered) in &mut track.reads {
                if before.stages & read.stage as u32 != 0 || *ordered & before.stages != 0 {
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
        let running = reads.into_iter().filter(|(_, ordered)| ordered & after.stage as u32 == 0);
        let earlier = unseen.map(|(earlier, _)| earlier).into_iter().chain(running.map(|(read, _)| read));
        self.violations.extend(earlier.map(|before| Violation { before, after }));
    }
}

/// Whether a scope has the stage and the access of a use.
fn has(scope: Scope, used: Use<Memory>) -> bool {
    scope.stages & used.stage as u32 != 0 && scope.accesses & used.access as u32 != 0
}

fn sees(visible: &[Scope], access: Use<Memory>) -> bool {
    visible.iter().any(|scope| has(*scope, access))
}

/// Counts the barriers of the updates `of`, and asserts that each is needed: without it, `is_right` must return false.
/// Adjacent barriers count as one (an update without works of a technique has such).
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
