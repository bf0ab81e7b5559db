//! Path `cpu`: executes the plans on threads, without Vulkan. With a block format, the fastest path on a machine
//! without a GPU.

mod blocks;
mod kernel;
mod records;
mod sums;
mod workers;

use crate::crowd::crowd_methods;
use crate::error::{Error, Result, refuse};
use crate::pack::blocks::PoseGrid;
use crate::pack::{POSE_FLOATS, PackedGroup, PackedLayout, PackedMesh, PoseFormat};
use crate::plan::instances::{InstanceState, Instances, OutputChange, check_weight, check_weights};
use crate::plan::steps::{Source, Work};
use crate::plan::{UpdateDesc, UpdateStats};
use crate::update::Runner;
use crate::update::blocks::{GroupPlan, Item, Planner};
use crate::update::crowd::CrowdDesc;
use crate::update::dense::{DensePlanner, Plan};
use std::borrow::Cow;
use std::sync::Arc;
pub(crate) use workers::Workers;

/// Instances of one mesh with poses in main memory, numbered from 0. A new crowd has all its instances, all shown. An
/// update is complete when [`update`](Self::update) returns, so there is no `discard`.
pub struct CpuCrowd {
    instances: Instances,
    /// Updates planned so far.
    updates: u64,
    mesh: Arc<PackedMesh>,
    /// By group.
    memory: Vec<Memory>,
    workers: Workers,
    planner: CpuPlanner,
}

/// Plans updates, for dense or block formats.
enum CpuPlanner {
    Dense(DensePlanner),
    Blocks(Planner),
}

/// Poses of a group.
#[derive(Clone)]
pub(crate) struct Memory {
    /// Slots per instance.
    pub slots: usize,
    /// `[instance × slots + slot]`: the words of a pose.
    pub poses: Vec<Vec<u32>>,
    format: PoseFormat,
    /// `Some` for fixed-point poses.
    grid: Option<PoseGrid>,
    /// The base pose of fixed-point poses: [`PoseFormat::base_words`].
    base: Vec<u32>,
}

/// Checks that the poses fit in memory by reserving them in one piece: exhausting memory later would abort the process.
fn check_memory(mesh: &PackedMesh, pose: PoseFormat, instances: u32, slots: u32) -> Result<()> {
    let each = mesh.layouts().map(|layout| layout.pose_bytes(pose)).sum::<u64>();
    let bytes = each.saturating_mul(slots.into()).saturating_mul(instances.into());
    let reserved = usize::try_from(bytes).ok().map(|bytes| Vec::<u8>::new().try_reserve_exact(bytes));
    reserved.and_then(Result::ok).ok_or_else(|| {
        let text = format!("the poses of {instances} instances of mesh '{}' take {bytes} bytes", mesh.layout().name);
        Error::out_of_memory(format!("{text}, more than there is memory"), "use fewer instances or slots")
    })
}

impl CpuCrowd {
    crowd_methods!();

    /// A crowd with all weights 0. Of the description only instances and updates matter: the rest is for devices.
    /// `threads`: 0 uses one per core; without the feature `threads` the calling thread does all work.
    ///
    /// # Errors
    /// Errors of [`UpdateDesc::check`]; a path other than [`UpdatePath::Cpu`](crate::plan::UpdatePath::Cpu);
    /// threads that cannot be started; not enough memory for the poses. Dense formats: an error budget, or fixed-point
    /// poses. Block formats: fixed-point poses that could overflow.
    pub fn new(mesh: Arc<PackedMesh>, desc: &CrowdDesc, threads: usize) -> Result<Self> {
        let CrowdDesc { instances, update: desc, .. } = *desc;
        desc.check_all(mesh.layout(), Runner::Cpu)?;
        let layout = mesh.layout();
        let count = instances as usize;
        check_memory(&mesh, desc.pose, instances, desc.slots)?;
        let workers = Workers::new(threads)?;
        let instances = Instances::new(count, layout.targets.len(), desc.slots, 1);
        let planner = match &layout.blocks {
            None => CpuPlanner::Dense(DensePlanner::new(desc, count)?),
            Some(_) => CpuPlanner::Blocks(Planner::new(desc, mesh.layouts(), count)?),
        };
        let memory = mesh.groups().iter().map(|group| Memory::new(group, desc, count));
        let memory = memory.collect::<Result<_>>()?;
        Ok(Self { instances, updates: 0, mesh, memory, workers, planner })
    }

    /// The mesh's layout of positions and normals: names, steps and sizes.
    pub fn layout(&self) -> &PackedLayout {
        self.mesh.layout()
    }

    fn grid(&self) -> Option<PoseGrid> {
        self.memory[0].grid
    }

    fn parts(&mut self) -> (&mut Instances, &mut dyn InstanceState) {
        match &mut self.planner {
            CpuPlanner::Dense(planner) => (&mut self.instances, planner),
            CpuPlanner::Blocks(planner) => (&mut self.instances, planner),
        }
    }

    /// There are no post-morph passes.
    fn change_outputs(&mut self, _instance: u32, _change: OutputChange) {}

    /// Updates all poses to the requested weights.
    pub fn update(&mut self) -> UpdateStats {
        self.updates += 1;
        let Self { mesh, memory, workers, planner, instances, .. } = self;
        let groups = mesh.groups().iter();
        match planner {
            CpuPlanner::Dense(planner) => {
                planner.plan(instances, self.updates);
                groups
                    .clone()
                    .zip(memory)
                    .for_each(|(group, memory)| memory.run_passes(group, workers, planner.plans()));
                planner.stats(groups.map(PackedGroup::layout))
            }
            CpuPlanner::Blocks(planner) => {
                planner.plan(instances, self.updates);
                for ((group, memory), plan) in groups.zip(memory).zip(&planner.groups) {
                    memory.run_list(group, workers, plan);
                }
                planner.stats()
            }
        }
    }

    /// Memory of a group, and the indices of an instance's pose (of its first slot while it has none) and previous
    /// pose.
    fn poses(&self, instance: u32, group: usize) -> Result<(&Memory, usize, Option<usize>)> {
        let place = self.instances.check(instance)?;
        let Self { mesh, memory, .. } = self;
        let Some(poses) = memory.get(group) else {
            let text = format!("group {group} of mesh '{}', which has {}", mesh.layout().name, memory.len());
            return refuse(text, "count groups from 0");
        };
        let (slot, previous) = self.instances.slots_of(place).unwrap_or_default();
        let pose = |slot: u32| place * poses.slots + slot as usize;
        Ok((poses, pose(slot), previous.map(pose)))
    }

    /// The pose of an instance after the last update: six floats per vertex, decoded, with padding, in pose-buffer
    /// order ([`PackedLayout::to_user_order`](crate::pack::PackedLayout::to_user_order)).
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn pose(&self, instance: u32) -> Result<Cow<'_, [f32]>> {
        self.group_pose(instance, 0)
    }

    /// The pose of an instance in a [group](PackedMesh::groups) of the mesh; [`pose`](Self::pose) is group 0.
    ///
    /// # Errors
    /// An instance out of range or removed; a group out of range.
    pub fn group_pose(&self, instance: u32, group: usize) -> Result<Cow<'_, [f32]>> {
        let (memory, pose, _) = self.poses(instance, group)?;
        Ok(memory.decode(pose))
    }

    /// The pose before the last update, if it still exists; the pose itself if nothing changed.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn previous_pose(&self, instance: u32) -> Result<Option<Cow<'_, [f32]>>> {
        self.previous_group_pose(instance, 0)
    }

    /// The [previous pose](Self::previous_pose) of an instance in a group of the mesh.
    ///
    /// # Errors
    /// Those of [`group_pose`](Self::group_pose).
    #[doc(hidden)]
    pub fn previous_group_pose(&self, instance: u32, group: usize) -> Result<Option<Cow<'_, [f32]>>> {
        let (memory, _, previous) = self.poses(instance, group)?;
        Ok(previous.map(|pose| memory.decode(pose)))
    }

    /// The pose of an instance in a group of the mesh, in the bytes of its [format](PoseFormat).
    ///
    /// # Errors
    /// Those of [`group_pose`](Self::group_pose).
    #[doc(hidden)]
    pub fn stored_pose(&self, instance: u32, group: usize) -> Result<&[u8]> {
        let (memory, pose, _) = self.poses(instance, group)?;
        Ok(bytemuck::cast_slice(&memory.poses[pose]))
    }
}

impl Memory {
    /// All slots hold the base pose.
    pub fn new(mesh: &PackedGroup, desc: UpdateDesc, instances: usize) -> Result<Self> {
        let grid = desc.grid(mesh.layout())?;
        let slots = desc.slots as usize;
        let vertices = mesh.layout().vertex_count;
        let (pose, base) = match grid {
            Some(grid) => {
                (desc.pose.base_pose(&grid, mesh.base(), vertices), desc.pose.base_words(&grid, mesh.base(), vertices))
            }
            None => (bytemuck::cast_slice(mesh.base()).to_vec(), vec![]),
        };
        Ok(Self { slots, poses: vec![pose; instances * slots], format: desc.pose, grid, base })
    }

    pub fn decode(&self, pose: usize) -> Cow<'_, [f32]> {
        let words = &self.poses[pose];
        match &self.grid {
            None => Cow::Borrowed(bytemuck::cast_slice(words)),
            grid => Cow::Owned(self.format.decode(bytemuck::cast_slice(words), grid.as_ref())),
        }
    }

    /// Executes the passes over float32 poses, one piece of the mesh at a time: from the second instance on its deltas
    /// are cached.
    fn run_passes(&mut self, mesh: &PackedGroup, workers: &Workers, plans: &[Plan]) {
        let changed =
            || (0..).step_by(self.slots).zip(plans).filter_map(|(at, plan)| Some((at, plan, plan.passes.first()?)));
        let places: Vec<_> = changed().map(|(at, _, pass)| at + pass.destination as usize).collect();
        let mut poses: Vec<_> = places.iter().map(|&place| std::mem::take(&mut self.poses[place])).collect();
        let source = |at: usize, pass: &Work| match pass.source {
            Source::Base => Some(mesh.base()),
            Source::Slot(slot) if slot == pass.destination => None,
            Source::Slot(slot) => Some(bytemuck::cast_slice(&self.poses[at + slot as usize])),
        };
        let updates: Vec<_> = changed().map(|(at, plan, pass)| (plan, source(at, pass))).collect();
        let piece = workers.piece_vertices(mesh.layout().padded_vertices(), updates.len());
        let mut pieces = mesh.layout().chunks().flat_map(|(first, vertices)| {
            (0..vertices).step_by(piece).map(move |at| (first + at, piece.min(vertices - at)))
        });
        let mut rest: Vec<&mut [f32]> = poses.iter_mut().map(|pose| bytemuck::cast_slice_mut(pose)).collect();
        let jobs = std::iter::from_fn(|| {
            let (first, vertices) = pieces.next()?;
            let words = ..vertices * POSE_FLOATS;
            Some((first, rest.iter_mut().filter_map(|pose| pose.split_off_mut(words)).collect::<Vec<_>>()))
        });
        workers.for_each(jobs, |(first, parts)| {
            for (&(plan, source), out) in updates.iter().zip(parts) {
                // Later passes run in place.
                let mut source = source.map(|s| &s[first * POSE_FLOATS..][..out.len()]);
                for pass in &plan.passes {
                    kernel::dense(mesh, plan.coefficients_of(pass), first, source.take(), out);
                }
            }
        });
        places.into_iter().zip(poses).for_each(|(place, pose)| self.poses[place] = pose);
    }

    /// Executes the work list of a group.
    pub fn run_list(&mut self, mesh: &PackedGroup, workers: &Workers, plan: &GroupPlan) {
        let instances = || plan.list.items.chunk_by(|a, b| a.instance == b.instance);
        let first = |items: &[Item]| items[0].instance as usize * self.slots;
        let places: Vec<_> = instances().map(|items| first(items) + items[0].destination as usize).collect();
        let mut poses: Vec<_> = places.iter().map(|&place| std::mem::take(&mut self.poses[place])).collect();
        let mut end = 0;
        let runs = instances().zip(&mut poses).map(|(items, destination)| {
            // All items of an instance read the same slot, or the base pose. In place, the pose was taken as a
            // destination.
            let source = items.iter().find_map(|item| item.source).filter(|slot| *slot != items[0].destination);
            let source = source.map(|slot| self.poses[first(items) + slot as usize].as_slice());
            let start = end;
            end += items.len();
            blocks::Run { items: start..end, source, destination }
        });
        let base = if self.grid.is_some() { &self.base } else { bytemuck::cast_slice(mesh.base()) };
        blocks::run(workers, (mesh, base), plan, runs.collect());
        places.into_iter().zip(poses).for_each(|(place, pose)| self.poses[place] = pose);
    }
}

#[cfg(test)]
mod tests;
