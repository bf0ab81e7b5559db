//! The `cpu` path: the same plans, carried out by threads. Runs without Vulkan. With a mesh in a block format, the
//! fastest path where there is no GPU.

pub(crate) mod blocks;
mod kernel;
#[cfg(test)]
pub(crate) mod tile;
mod workers;

use crate::error::{Error, Result};
use crate::pack::{POSE_FLOATS, PackedLayout, PackedMesh};
use crate::plan::blocks::{BlockState, Planner, check_block_weights};
use crate::plan::commands::{CommandList, PassCommand};
use crate::plan::heads::Heads;
use crate::plan::{Plan, PoseState, Source, UpdateDesc, UpdatePath, UpdateStats};
use std::sync::Arc;
use workers::Workers;

/// Instances of one mesh whose poses live in main memory.
pub struct CpuCrowd {
    mesh: Arc<PackedMesh>,
    slots: usize,
    heads: Heads,
    updates: u64,
    /// `[instance × slots + slot]`.
    poses: Vec<Vec<f32>>,
    workers: Workers,
    layout: Layout,
}

/// What depends on the format's layout.
enum Layout {
    Dense { states: Vec<PoseState>, plans: Vec<Plan>, list: CommandList },
    Blocks(Box<Blocks>),
}

struct Blocks {
    planner: Planner,
    /// Integer sums of each instance, for exact accumulation.
    sums: Vec<Vec<i32>>,
}

/// Refuse poses that there is no memory for: what cannot be reserved in one piece is not there in many, and running out
/// of it would end the process.
fn check_memory(layout: &PackedLayout, instances: usize, slots: usize) -> Result<()> {
    let bytes = layout.pose_bytes().saturating_mul(slots as u64).saturating_mul(instances as u64);
    let reserved = usize::try_from(bytes).ok().map(|bytes| Vec::<u8>::new().try_reserve_exact(bytes));
    reserved.and_then(Result::ok).ok_or_else(|| {
        let text = format!("the poses of {instances} instances of mesh '{}' take {bytes} bytes", layout.name);
        Error::out_of_memory(format!("{text}, more than there is memory"), "use fewer instances or slots")
    })
}

/// The number of an instance; one that does not fit is out of range, too.
fn number(instance: usize) -> u32 {
    u32::try_from(instance).unwrap_or(u32::MAX)
}

impl CpuCrowd {
    /// `instances` heads, all weights 0. `threads` 0 takes one per core; without the `threads` feature the
    /// caller's thread does the work.
    ///
    /// # Errors
    /// As [`UpdateDesc::check`]; a path that isn't [`UpdatePath::Cpu`]; threads that cannot be started; more poses than there
    /// is memory. Exact sums or an error budget for a dense format; for block formats, as [`BlockState::new`].
    pub fn new(mesh: Arc<PackedMesh>, desc: UpdateDesc, instances: usize, threads: usize) -> Result<Self> {
        if desc.path != UpdatePath::Cpu {
            return Err(Error::invalid(
                format!("update path '{}' for a CpuCrowd", desc.path.name()),
                "use UpdatePath::Cpu here, or MorphEngine for the GPU paths",
            ));
        }
        let (layout, slots) = (mesh.layout(), desc.slots as usize);
        check_memory(layout, instances, slots)?;
        let workers = Workers::new(threads)?;
        let targets = layout.targets.len();
        let kind = match &layout.blocks {
            None => {
                desc.check_dense(layout.format.name())?;
                let states = vec![PoseState::new(desc)?; instances];
                Layout::Dense { states, plans: vec![Plan::default(); instances], list: CommandList::new(desc.path) }
            }
            Some(index) => {
                let state = BlockState::new(desc, layout, index)?;
                let sums = if state.exact().is_some() { mesh.base().len() } else { 0 };
                Layout::Blocks(Box::new(Blocks {
                    planner: Planner::new(index, state, instances),
                    sums: vec![vec![0; sums]; instances],
                }))
            }
        };
        Ok(Self {
            heads: Heads::new(instances, targets),
            updates: 0,
            poses: vec![mesh.base().to_vec(); instances * slots],
            slots,
            layout: kind,
            mesh,
            workers,
        })
    }

    /// Names, steps and sizes of the mesh.
    pub fn layout(&self) -> &crate::pack::PackedLayout {
        self.mesh.layout()
    }

    /// Ask for these weights, one per target in the mesh's order, from the next update on.
    ///
    /// # Errors
    /// An instance out of range; a wrong number of weights; one that is not finite or out of range.
    pub fn set_weights(&mut self, instance: usize, weights: &[f32]) -> Result<()> {
        let exact = match &self.layout {
            Layout::Dense { .. } => None,
            Layout::Blocks(blocks) => blocks.planner.exact(),
        };
        check_block_weights(weights, self.mesh.layout(), exact)?;
        self.heads.set_weights(number(instance), weights)
    }

    /// The next pose of `instance` has no predecessor (it was hidden, or teleported): its previous pose will be the
    /// pose itself.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn cut(&mut self, instance: usize) -> Result<()> {
        let instance = self.heads.check(number(instance))?;
        match &mut self.layout {
            Layout::Dense { states, .. } => states[instance].cut(),
            Layout::Blocks(blocks) => blocks.planner.states[instance].cut(),
        }
        Ok(())
    }

    /// Hide `instance`, or show it again: a hidden one is left out of updates and keeps its pose; the first pose after it
    /// has itself as previous pose.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: usize, hidden: bool) -> Result<()> {
        if self.heads.set_hidden(number(instance), hidden)? { self.cut(instance) } else { Ok(()) }
    }

    /// Add a head in a place that [`remove`](Self::remove) freed: shown, all weights 0.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<usize> {
        let instance = self.heads.add()? as usize;
        match &mut self.layout {
            Layout::Dense { states, .. } => states[instance].forget(),
            Layout::Blocks(blocks) => blocks.planner.states[instance].forget(),
        }
        Ok(instance)
    }

    /// Take a head out of the crowd.
    ///
    /// # Errors
    /// An instance out of range, or removed before.
    pub fn remove(&mut self, instance: usize) -> Result<()> {
        self.heads.remove(number(instance))
    }

    /// Bring all poses to the weights asked for.
    pub fn update(&mut self) -> UpdateStats {
        self.updates += 1;
        match &mut self.layout {
            Layout::Dense { states, plans, list } => {
                for ((state, asked), plan) in states.iter_mut().zip(self.heads.asked()).zip(&mut *plans) {
                    match asked {
                        Some(weights) => state.plan(weights, self.updates, plan),
                        None => plan.clear(),
                    }
                }
                list.fill(plans);
                let stats = UpdateStats::new(self.mesh.layout(), list, plans);
                let list = std::mem::replace(list, CommandList::new(UpdatePath::Cpu));
                self.run_dense(&list);
                if let Layout::Dense { list: place, .. } = &mut self.layout {
                    *place = list;
                }
                stats
            }
            Layout::Blocks(blocks) => {
                let stats = blocks.planner.plan(&self.heads, self.updates);
                blocks.run(&self.mesh, &self.workers, &mut self.poses, self.slots);
                stats
            }
        }
    }

    fn run_dense(&mut self, list: &CommandList) {
        for pass in list.passes() {
            let at = pass.instance as usize * self.slots;
            let mut destination = std::mem::take(&mut self.poses[at + pass.destination as usize]);
            let source = match pass.source {
                Source::Base => Some(self.mesh.base()),
                Source::Slot(slot) if slot == pass.destination => None,
                Source::Slot(slot) => Some(self.poses[at + slot as usize].as_slice()),
            };
            self.run_pass(list, pass, source, &mut destination);
            self.poses[at + pass.destination as usize] = destination;
        }
    }

    /// Slots of the pose and of the previous pose.
    fn slots_of(&self, instance: usize) -> (u32, Option<u32>) {
        match &self.layout {
            Layout::Dense { plans, .. } => (plans[instance].result, plans[instance].previous),
            Layout::Blocks(blocks) => {
                let plan = blocks.planner.plans[instance];
                (plan.result, plan.previous)
            }
        }
    }

    /// The pose of an instance after the last update: six floats a vertex, with padding, in the order of pose buffers
    /// ([`PackedLayout::to_user_order`](crate::pack::PackedLayout::to_user_order)).
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn pose(&self, instance: usize) -> Result<&[f32]> {
        let instance = self.heads.check(number(instance))?;
        Ok(&self.poses[instance * self.slots + self.slots_of(instance).0 as usize])
    }

    /// The pose before the last update, where it is still there; the pose itself when nothing changed.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn previous_pose(&self, instance: usize) -> Result<Option<&[f32]>> {
        let instance = self.heads.check(number(instance))?;
        Ok(self.slots_of(instance).1.map(|slot| self.poses[instance * self.slots + slot as usize].as_slice()))
    }

    /// The integer sums of an instance, in the order of pose buffers; `None` unless it accumulates exactly.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn sums(&self, instance: usize) -> Result<Option<&[i32]>> {
        let instance = self.heads.check(number(instance))?;
        Ok(match &self.layout {
            Layout::Dense { .. } => None,
            Layout::Blocks(blocks) => Some(blocks.sums[instance].as_slice()).filter(|sums| !sums.is_empty()),
        })
    }

    fn run_pass(&self, list: &CommandList, pass: &PassCommand, source: Option<&[f32]>, destination: &mut [f32]) {
        let coefficients = &list.coefficients[pass.coefficients.clone()];
        let mesh = &*self.mesh;
        let mut rest = destination;
        for (first, vertices) in mesh.layout().chunks() {
            let (chunk, tail) = rest.split_at_mut(vertices * POSE_FLOATS);
            rest = tail;
            self.workers.for_each_piece(chunk, |at, out| {
                let first = first + at / POSE_FLOATS;
                let source = source.map(|s| &s[first * POSE_FLOATS..][..out.len()]);
                kernel::dense(mesh.surface(), coefficients, first, source, out);
            });
        }
    }
}

impl Blocks {
    fn run(&mut self, mesh: &PackedMesh, workers: &Workers, poses: &mut [Vec<f32>], slots: usize) {
        let Planner { index, list, .. } = &self.planner;
        let exact = self.planner.exact();
        let mut first = 0;
        for run in list.items.chunk_by(|a, b| a.instance == b.instance) {
            let instance = run[0].instance as usize;
            let range = first..first + run.len();
            first = range.end;
            let (at, to) = (instance * slots, run[0].destination as usize);
            let mut destination = std::mem::take(&mut poses[at + to]);
            // Items of one instance read one slot, but for those that start from base.
            let from = run.iter().find_map(|item| item.source).filter(|&s| s as usize != to);
            let source = from.map(|slot| poses[at + slot as usize].as_slice());
            let sums = exact.map(|grid| (self.sums[instance].as_mut_slice(), grid));
            let buffers = blocks::Buffers { source, destination: &mut destination, sums };
            blocks::run(workers, mesh.surface(), index, list, range, buffers);
            poses[at + to] = destination;
        }
    }
}

#[cfg(test)]
mod tests;
