//! The `cpu` path: the same plans, carried out by threads. Runs without Vulkan. With a mesh in a block format, the
//! fastest path where there is no GPU.

mod blocks;
mod kernel;
mod simd;
mod sums;
mod workers;

use crate::error::{Error, Result};
use crate::pack::blocks::PoseGrid;
use crate::pack::poses::{PoseStorage, with_pose};
use crate::pack::{POSE_FLOATS, PackedGroup, PackedMesh, PoseFormat};
use crate::plan::instances::{Instances, check_weight, check_weights, target_named};
use crate::plan::steps::{Source, Work};
use crate::plan::{UpdateDesc, UpdateStats};
use crate::update::Runner;
use crate::update::blocks::{GroupPlan, Item, Planner};
use crate::update::dense::{DensePlanner, Plan};
use crate::weights::delta::Coefficient;
use bytemuck::Pod;
use std::borrow::Cow;
use std::sync::Arc;
pub(crate) use workers::Workers;

/// Instances of one mesh whose poses live in main memory.
pub struct CpuCrowd {
    mesh: Arc<PackedMesh>,
    instances: Instances,
    updates: u64,
    /// Of each group.
    memory: Vec<Memory>,
    workers: Workers,
    kind: Kind,
}

/// What depends on the format.
enum Kind {
    Dense(DensePlanner),
    Blocks(Planner),
}

/// The memory of a group.
#[derive(Clone)]
pub(crate) struct Memory {
    /// Slots of an instance.
    pub slots: usize,
    /// `[instance × slots + slot]`: the words of a pose, as its format says.
    pub poses: Vec<Vec<u32>>,
    /// How they are stored.
    format: PoseFormat,
    /// The grid of integers.
    grid: Option<PoseGrid>,
}

/// Refuse poses that there is no memory for: what cannot be reserved in one piece is not there in many, and running out
/// of it would end the process.
fn check_memory(mesh: &PackedMesh, pose: PoseFormat, instances: usize, slots: usize) -> Result<()> {
    let layout = mesh.layout();
    let each = mesh.groups().iter().map(|group| group.layout().pose_bytes(pose)).sum::<u64>();
    let bytes = each.saturating_mul(slots as u64).saturating_mul(instances as u64);
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
    /// As [`UpdateDesc::check`]; a path that isn't [`UpdatePath::Cpu`](crate::plan::UpdatePath::Cpu); threads that
    /// cannot be started; more poses than there is memory. Poses of integers or an error budget for a dense format; for
    /// block formats, poses of integers that could overflow, or a tolerance that rounding alone exceeds.
    pub fn new(mesh: Arc<PackedMesh>, desc: UpdateDesc, instances: usize, threads: usize) -> Result<Self> {
        desc.check_all(mesh.layout(), Runner::Cpu)?;
        let (layout, slots) = (mesh.layout(), desc.slots as usize);
        check_memory(&mesh, desc.pose, instances, slots)?;
        let workers = Workers::new(threads)?;
        let targets = layout.targets.len();
        let kind = match &layout.blocks {
            None => Kind::Dense(DensePlanner::new(desc, desc.grid(layout)?, instances)?),
            Some(_) => Kind::Blocks(Planner::new(desc, mesh.groups().iter().map(PackedGroup::layout), instances)?),
        };
        let memory = mesh.groups().iter().map(|group| Memory::new(group, desc, instances));
        let memory = memory.collect::<Result<_>>()?;
        let instances = Instances::new(instances, targets, desc.slots, 1);
        Ok(Self { instances, updates: 0, memory, kind, mesh, workers })
    }

    /// Names, steps and sizes of the mesh.
    pub fn layout(&self) -> &crate::pack::PackedLayout {
        self.mesh.layout()
    }

    /// Request these weights, one per target in the mesh's order, from the next update on.
    ///
    /// # Errors
    /// An instance out of range; a wrong number of weights; one that is not finite or out of range.
    pub fn set_weights(&mut self, instance: usize, weights: &[f32]) -> Result<()> {
        check_weights(weights, self.mesh.layout(), self.grid())?;
        self.instances.set_weights(number(instance), weights)
    }

    /// Request the weight of one target, from the next update on; the others stay as requested. `target` counts in the
    /// mesh's order, as [`PackedLayout::target_index`](crate::PackedLayout::target_index) does.
    ///
    /// # Errors
    /// An instance out of range or removed; a target out of range; a weight that is not finite or out of range. Nothing
    /// changes then.
    pub fn set_weight(&mut self, instance: usize, target: usize, weight: f32) -> Result<()> {
        check_weight(target, weight, self.mesh.layout(), self.grid())?;
        self.instances.set_weight(number(instance), target, weight).map(drop)
    }

    /// How far a vertex of `instance` may be from where the requested weights would put it, as
    /// [`Crowd::set_error_budget`](crate::Crowd::set_error_budget) says.
    ///
    /// # Errors
    /// An instance out of range or removed; a number that is not from 0 to the crowd's budget; a dense format.
    pub fn set_error_budget(&mut self, instance: usize, budget: f32) -> Result<()> {
        self.instances.check(number(instance))?;
        match &mut self.kind {
            Kind::Blocks(planner) => planner.set_error_budget(instance, budget),
            Kind::Dense(_) => {
                let what = format!("an error budget of {budget} for a mesh in a dense format");
                Err(Error::invalid(what, "pack it in a block format"))
            }
        }
    }

    /// Request the weight of the target called `name`, of several the first: as [`set_weight`](Self::set_weight), after a
    /// search through the names.
    ///
    /// # Errors
    /// No such target, with the one that was probably meant; else as [`set_weight`](Self::set_weight).
    pub fn set_weight_by_name(&mut self, instance: usize, name: &str, weight: f32) -> Result<()> {
        let target = target_named(name, self.mesh.layout())?;
        self.set_weight(instance, target, weight)
    }

    fn grid(&self) -> Option<PoseGrid> {
        match &self.kind {
            Kind::Dense(planner) => planner.grid(),
            Kind::Blocks(planner) => planner.grid(),
        }
    }

    /// The next pose of `instance` has no predecessor (it was hidden, or teleported): its previous pose will be the
    /// pose itself.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn cut(&mut self, instance: usize) -> Result<()> {
        self.instances.cut(number(instance))
    }

    /// Hide `instance`, or show it again: a hidden one is left out of updates and keeps its pose; the first pose after
    /// it has itself as previous pose.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: usize, hidden: bool) -> Result<()> {
        self.instances.set_hidden(number(instance), hidden).map(drop)
    }

    /// Add a head in a place that [`remove`](Self::remove) freed: shown, all weights 0, with the crowd's error budget.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<usize> {
        let instance = self.instances.add()? as usize;
        if let Kind::Blocks(planner) = &mut self.kind {
            planner.add(instance);
        }
        Ok(instance)
    }

    /// Take a head out of the crowd.
    ///
    /// # Errors
    /// An instance out of range, or removed before.
    pub fn remove(&mut self, instance: usize) -> Result<()> {
        self.instances.remove(number(instance))
    }

    /// Bring all poses to the weights requested.
    pub fn update(&mut self) -> UpdateStats {
        self.updates += 1;
        let Self { mesh, workers, memory, instances, .. } = self;
        let groups = mesh.groups();
        match &mut self.kind {
            Kind::Dense(planner) => {
                planner.plan(instances, self.updates);
                for (group, memory) in groups.iter().zip(memory) {
                    memory.run_passes(group, workers, planner.plans());
                }
                planner.stats(groups.iter().map(PackedGroup::layout))
            }
            Kind::Blocks(planner) => {
                planner.plan(instances, self.updates);
                for ((group, planner), memory) in groups.iter().zip(&planner.groups).zip(memory) {
                    memory.run_list(group, workers, planner);
                }
                planner.stats()
            }
        }
    }

    /// As [`Crowd::changed`](crate::Crowd::changed).
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub fn changed(&self, instance: usize) -> Vec<std::ops::Range<u32>> {
        let mut changed = vec![];
        match &self.kind {
            Kind::Blocks(planner) => planner.groups[0].changed(number(instance), &mut changed),
            Kind::Dense(_) => {
                let place = self.instances.check(number(instance)).ok();
                let written = place.map_or(0, |place| self.instances.written_by(place));
                changed.extend((written > 0 && written == self.updates).then_some(0..u32::MAX));
            }
        }
        changed
    }

    /// The memory and mesh of a group, and which poses in it are that of an instance (that in the first slot while there
    /// is none) and its previous pose.
    fn poses(&self, instance: usize, group: usize) -> Result<(&Memory, &PackedGroup, usize, Option<usize>)> {
        let place = self.instances.check(number(instance))?;
        let (Some(memory), Some(mesh)) = (self.memory.get(group), self.mesh.groups().get(group)) else {
            let text = format!("group {group} of mesh '{}', which has {}", self.mesh.layout().name, self.memory.len());
            return Err(Error::invalid(text, "count groups from 0"));
        };
        let (slot, previous) = self.instances.slots_of(place).unwrap_or_default();
        let pose = |slot: u32| place * memory.slots + slot as usize;
        Ok((memory, mesh, pose(slot), previous.map(pose)))
    }

    /// The pose of an instance after the last update: six floats a vertex, with padding, in the order of pose buffers
    /// ([`PackedLayout::to_user_order`](crate::pack::PackedLayout::to_user_order)). Integers are decoded.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn pose(&self, instance: usize) -> Result<Cow<'_, [f32]>> {
        self.group_pose(instance, 0)
    }

    /// The pose of an instance in a [group](PackedMesh::groups) of the mesh; [`pose`](Self::pose) is that of the first.
    ///
    /// # Errors
    /// An instance out of range or removed; a group out of range.
    pub fn group_pose(&self, instance: usize, group: usize) -> Result<Cow<'_, [f32]>> {
        let (memory, mesh, pose, _) = self.poses(instance, group)?;
        Ok(memory.decode(mesh, pose))
    }

    /// The pose before the last update, where it is still there; the pose itself when nothing changed.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn previous_pose(&self, instance: usize) -> Result<Option<Cow<'_, [f32]>>> {
        self.previous_group_pose(instance, 0)
    }

    /// The [previous pose](Self::previous_pose) of an instance in a group of the mesh.
    ///
    /// # Errors
    /// As [`group_pose`](Self::group_pose).
    pub fn previous_group_pose(&self, instance: usize, group: usize) -> Result<Option<Cow<'_, [f32]>>> {
        let (memory, mesh, _, previous) = self.poses(instance, group)?;
        Ok(previous.map(|pose| memory.decode(mesh, pose)))
    }

    /// The pose of an instance in a group of the mesh, as its [format](PoseFormat) stores it.
    ///
    /// # Errors
    /// As [`group_pose`](Self::group_pose).
    pub fn stored_pose(&self, instance: usize, group: usize) -> Result<&[u8]> {
        let (memory, _, pose, _) = self.poses(instance, group)?;
        Ok(bytemuck::cast_slice(&memory.poses[pose]))
    }
}

impl Memory {
    /// The base pose in every slot.
    pub(crate) fn new(mesh: &PackedGroup, desc: UpdateDesc, instances: usize) -> Result<Self> {
        let (grid, slots) = (desc.grid(mesh.layout())?, desc.slots as usize);
        let pose = match grid {
            Some(_) => vec![0; mesh.layout().pose_bytes(desc.pose) as usize / size_of::<u32>()],
            None => bytemuck::cast_slice(mesh.base()).to_vec(),
        };
        Ok(Self { slots, poses: vec![pose; instances * slots], format: desc.pose, grid })
    }

    /// A pose as floats.
    pub(crate) fn decode(&self, mesh: &PackedGroup, pose: usize) -> Cow<'_, [f32]> {
        let words = &self.poses[pose];
        match self.grid {
            None => Cow::Borrowed(bytemuck::cast_slice(words)),
            Some(grid) => Cow::Owned(self.format.decode(bytemuck::cast_slice(words), mesh.base(), grid.units)),
        }
    }

    /// Carry the dense passes of all instances out.
    fn run_passes(&mut self, mesh: &PackedGroup, workers: &Workers, plans: &[Plan]) {
        match self.grid {
            Some(grid) => with_pose!(self.format, P => self.run_integers::<P>(mesh, workers, plans, grid)),
            None => self.run_numbers(mesh, workers, plans, Some(mesh.base()), |coefficients, first, source, out| {
                kernel::dense(mesh, coefficients, first, source, out);
            }),
        }
    }

    fn run_integers<P: PoseStorage>(&mut self, mesh: &PackedGroup, workers: &Workers, plans: &[Plan], grid: PoseGrid) {
        // Nothing is displaced from the base pose.
        self.run_numbers::<P::Number>(mesh, workers, plans, None, |coefficients, first, source, out| {
            kernel::rounded::<P>(mesh, coefficients, grid, first, source, out);
        });
    }

    /// Carry the passes out, by `run`, a piece of the mesh after the other: its deltas are in the cache for the second
    /// instance on. `None` as base pose: zeros.
    fn run_numbers<T: Pod + Send + Sync>(
        &mut self,
        mesh: &PackedGroup,
        workers: &Workers,
        plans: &[Plan],
        base: Option<&[T]>,
        run: impl Fn(&[Coefficient], usize, Option<&[T]>, &mut [T]) + Sync,
    ) {
        let changed =
            || (0..).step_by(self.slots).zip(plans).filter_map(|(at, plan)| Some((at, plan, plan.passes.first()?)));
        let places: Vec<_> = changed().map(|(at, _, pass)| at + pass.destination as usize).collect();
        let mut poses: Vec<_> = places.iter().map(|&place| std::mem::take(&mut self.poses[place])).collect();
        let source = |at: usize, pass: &Work| match pass.source {
            Source::Base => base,
            Source::Slot(slot) if slot == pass.destination => None,
            Source::Slot(slot) => Some(bytemuck::cast_slice(&self.poses[at + slot as usize])),
        };
        let updates: Vec<_> = changed().map(|(at, plan, pass)| (plan, source(at, pass))).collect();
        let piece = workers.piece_vertices(mesh.layout().padded_vertices(), updates.len());
        let mut pieces = mesh.layout().chunks().flat_map(|(first, vertices)| {
            (0..vertices).step_by(piece).map(move |at| (first + at, piece.min(vertices - at)))
        });
        let mut rest: Vec<&mut [T]> = poses.iter_mut().map(|pose| bytemuck::cast_slice_mut(pose)).collect();
        let jobs = std::iter::from_fn(|| {
            let (first, vertices) = pieces.next()?;
            let words = ..vertices * POSE_FLOATS;
            Some((first, rest.iter_mut().filter_map(|pose| pose.split_off_mut(words)).collect::<Vec<_>>()))
        });
        workers.for_each(jobs, |(first, parts)| {
            for (&(plan, source), out) in updates.iter().zip(parts) {
                // Later passes run in place.
                if plan.rebuilt && base.is_none() {
                    out.fill(T::zeroed());
                }
                let mut source = source.map(|s| &s[first * POSE_FLOATS..][..out.len()]);
                for pass in &plan.passes {
                    run(plan.coefficients_of(pass), first, source.take(), out);
                }
            }
        });
        places.into_iter().zip(poses).for_each(|(place, pose)| self.poses[place] = pose);
    }

    /// Carry the work list of a group out.
    pub fn run_list(&mut self, mesh: &PackedGroup, workers: &Workers, plan: &GroupPlan) {
        let instances = || plan.list.items.chunk_by(|a, b| a.instance == b.instance);
        let first = |items: &[Item]| items[0].instance as usize * self.slots;
        let places: Vec<_> = instances().map(|items| first(items) + items[0].destination as usize).collect();
        let mut poses: Vec<_> = places.iter().map(|&place| std::mem::take(&mut self.poses[place])).collect();
        let mut end = 0;
        let runs = instances().zip(&mut poses).map(|(items, destination)| {
            // Items of one instance read one slot, but for those that start from base.
            let from = items.iter().find_map(|item| item.source).filter(|&slot| slot != items[0].destination);
            let source = from.map(|slot| self.poses[first(items) + slot as usize].as_slice());
            let start = end;
            end += items.len();
            blocks::Run { items: start..end, source, destination }
        });
        blocks::run(workers, mesh, plan, runs.collect());
        places.into_iter().zip(poses).for_each(|(place, pose)| self.poses[place] = pose);
    }
}

#[cfg(test)]
mod tests;
