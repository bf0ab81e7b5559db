//! The hazard checker: proves each read and write of a command stream against the barriers between them.
//!
//! No validation layer sees a missing barrier around transform-feedback writes, so this does, for every path.
//! The model is Vulkan's for global memory barriers: a write must be made available and visible to a later
//! read or write (RAW, WAW), and a read must be finished before a later write (WAR); dependencies chain where
//! a barrier's first stages cover the second stages of an earlier one.

use super::Source;
use super::commands::{Access, BlocksCommand, Command, CommandList, Hazard, ScatterCommand, ScatterStep, Stage};
use crate::plan::UpdatePath;
use std::collections::HashMap;

/// A piece of memory that commands read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Resource {
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
    /// What heads play.
    Records,
    /// Weights of heads that are animated on the GPU, and which of them changed.
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

/// One access of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Use {
    /// What is accessed.
    pub resource: Resource,
    /// In which stage.
    pub stage: Stage,
    /// How.
    pub access: Access,
}

/// Two accesses that no barrier orders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The earlier access.
    pub before: Use,
    /// The later one.
    pub after: Use,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match (self.before.access.writes(), self.after.access.writes()) {
            (true, true) => "write after write",
            (true, false) => "read after write",
            _ => "write after read",
        };
        write!(
            f,
            "{kind} on {:?}: {:?} in {:?} is not ordered before {:?} in {:?}",
            self.after.resource, self.before.access, self.before.stage, self.after.access, self.after.stage
        )
    }
}

/// What is known of one resource.
#[derive(Default)]
struct Track {
    /// The last write and what it has been made visible to: `(stages, accesses)` of each barrier that did.
    write: Option<(Use, Vec<(u8, u8)>)>,
    /// Reads since, each with the stages that wait for it.
    reads: Vec<(Use, u8)>,
}

/// Walks a command stream.
#[derive(Default)]
pub struct HazardChecker {
    tracks: HashMap<Resource, Track>,
    violations: Vec<Violation>,
}

impl HazardChecker {
    /// Nothing accessed yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// An upload writes base and deltas.
    pub fn upload(&mut self) {
        for resource in [Resource::Base, Resource::Deltas] {
            self.access(Use { resource, stage: Stage::Transfer, access: Access::TransferWrite });
        }
        self.barrier(Hazard::TransferWriteToAssetRead);
    }

    /// Making a crowd that is animated on the GPU writes clips, and fills what kernels keep.
    pub fn upload_animation(&mut self) {
        for resource in [Resource::Clips, Resource::Records, Resource::Weights, Resource::History, Resource::Counters] {
            self.access(Use { resource, stage: Stage::Transfer, access: Access::TransferWrite });
        }
        self.barrier(Hazard::TransferWriteToComputeUpdate);
    }

    /// A draw of the host reads a pose, as vertex attributes and in the vertex shader.
    pub fn draw(&mut self, instance: u32, slot: u32) {
        let resource = Resource::Pose { instance, slot };
        self.access(Use { resource, stage: Stage::VertexInput, access: Access::AttributeRead });
        self.access(Use { resource, stage: Stage::VertexShader, access: Access::ShaderRead });
    }

    /// A recorded update.
    pub fn update(&mut self, list: &CommandList) {
        for command in &list.commands {
            match command {
                Command::Barrier(hazard) => self.barrier(*hazard),
                Command::Blocks(blocks) => self.blocks(blocks),
                Command::Animated(step) => {
                    let (read, written) = step.uses();
                    read.iter().for_each(|read| self.read(*read));
                    for write in written {
                        let own = read.iter().find(|read| read.resource == write.resource);
                        self.write(write, own.copied());
                    }
                }
                Command::Scatter(scatter) => self.scatter(scatter),
                Command::Pass(pass) => {
                    let (read, write) = match list.path {
                        UpdatePath::Feedback => (
                            (Stage::VertexInput, Access::AttributeRead),
                            (Stage::TransformFeedback, Access::FeedbackWrite),
                        ),
                        UpdatePath::VertexStore => {
                            ((Stage::VertexInput, Access::AttributeRead), (Stage::VertexShader, Access::ShaderWrite))
                        }
                        _ => ((Stage::Compute, Access::ShaderRead), (Stage::Compute, Access::ShaderWrite)),
                    };
                    let pose = |slot| Resource::Pose { instance: pass.instance, slot };
                    let source = match pass.source {
                        Source::Base => Resource::Base,
                        Source::Slot(slot) => pose(slot),
                    };
                    // A vertex pass that captures into the buffer it fetches from is undefined, barriers or not.
                    let aliased = !list.path.works_in_place() && source == pose(pass.destination);
                    let target = Use { resource: pose(pass.destination), stage: write.0, access: write.1 };
                    let fetch = Use { resource: source, stage: read.0, access: read.1 };
                    if aliased {
                        self.violations.push(Violation { before: fetch, after: target });
                    }
                    if !pass.coefficients.is_empty() {
                        self.access(Use { resource: Resource::Deltas, ..fetch });
                    }
                    // Within one pass each vertex is read before it is written, by the same invocation: the
                    // pass's own read is not a hazard for its own write.
                    self.read(fetch);
                    self.write(target, Some(fetch).filter(|_| list.path.works_in_place()));
                }
            }
        }
    }

    fn blocks(&mut self, blocks: &BlocksCommand) {
        let pose = |slot| Resource::Pose { instance: blocks.instance, slot };
        let read = |resource| Use { resource, stage: Stage::Compute, access: Access::ShaderRead };
        let write = |resource| Use { resource, stage: Stage::Compute, access: Access::ShaderWrite };
        self.read(read(Resource::Deltas));
        if blocks.reads_base {
            self.read(read(Resource::Base));
        }
        // As in a dense pass: an invocation reads what it writes, and nobody else does.
        let source = blocks.source.map(|slot| read(pose(slot)));
        source.into_iter().for_each(|source| self.read(source));
        self.write(write(pose(blocks.destination)), source);
        if blocks.exact {
            let sums = Resource::Sums { instance: blocks.instance };
            self.read(read(sums));
            self.write(write(sums), Some(read(sums)));
        }
    }

    fn scatter(&mut self, scatter: &ScatterCommand) {
        let sums = Resource::Sums { instance: scatter.instance };
        let read = |resource| Use { resource, stage: Stage::Compute, access: Access::ShaderRead };
        let write = |resource| Use { resource, stage: Stage::Compute, access: Access::ShaderWrite };
        match scatter.step {
            ScatterStep::Clear => {
                self.access(Use { resource: sums, stage: Stage::Transfer, access: Access::TransferWrite })
            }
            ScatterStep::Add => {
                self.read(read(Resource::Deltas));
                // Atomics of one step need no order among themselves.
                self.read(read(sums));
                self.write(write(sums), Some(read(sums)));
            }
            ScatterStep::Resolve => {
                self.read(read(Resource::Base));
                self.read(read(sums));
                let slot = scatter.destination;
                self.access(write(Resource::Pose { instance: scatter.instance, slot }));
            }
        }
    }

    /// What was found.
    pub fn finish(self) -> Result<(), Vec<Violation>> {
        if self.violations.is_empty() { Ok(()) } else { Err(self.violations) }
    }

    /// A barrier between what came before and what follows.
    pub fn barrier(&mut self, hazard: Hazard) {
        let (before, after) = hazard.scopes();
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

    fn access(&mut self, access: Use) {
        if access.access.writes() { self.write(access, None) } else { self.read(access) }
    }

    fn read(&mut self, read: Use) {
        let track = self.tracks.entry(read.resource).or_default();
        if let Some((write, visible)) = &track.write
            && !sees(visible, read)
        {
            self.violations.push(Violation { before: *write, after: read });
        }
        track.reads.push((read, 0));
    }

    fn write(&mut self, write: Use, own_read: Option<Use>) {
        let track = self.tracks.entry(write.resource).or_default();
        if let Some((earlier, visible)) = &track.write
            && !sees(visible, write)
        {
            self.violations.push(Violation { before: *earlier, after: write });
        }
        if let Some(own) = own_read.filter(|r| r.resource == write.resource) {
            track.reads.pop_if(|(last, _)| *last == own);
        }
        for (read, ordered) in track.reads.drain(..) {
            if ordered & write.stage as u8 == 0 {
                self.violations.push(Violation { before: read, after: write });
            }
        }
        track.write = Some((write, vec![]));
    }
}

fn sees(visible: &[(u8, u8)], access: Use) -> bool {
    visible.iter().any(|(stages, accesses)| stages & access.stage as u8 != 0 && accesses & access.access as u8 != 0)
}
