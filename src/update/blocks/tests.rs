//! Plans in blocks, carried out by the CPU twin: any history ends in the pose asked for.

use super::dispatch::{Dispatches, Dispatching};
use super::*;
use crate::abi::kernels::DeviceClass;
use crate::cpu::Memory;
use crate::cpu::workers::Workers;
use crate::pack::blocks::{BlockDesc, BlockIndex};
use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
use crate::plan::hazards::Event as Recorded;
use crate::plan::instances::Instances;
use crate::plan::steps::Steps;
use crate::plan::tests::{events, scheduled};
use crate::plan::{Accumulate, Consumers, UpdateDesc, UpdateMode, UpdateStats};
use crate::update::tests::{Planned, every_barrier_is_needed, follow};
use crate::{reference, testing};
use proptest::prelude::*;

const TARGETS: usize = 9;

/// Memory of which nothing may be read before it is written.
pub(super) fn memory(mesh: &PackedMesh, instances: usize, slots: usize) -> Memory {
    let floats = mesh.base().len();
    Memory {
        slots,
        poses: vec![vec![f32::NAN; floats]; instances * slots],
        sums: vec![vec![i32::MAX; floats]; instances],
    }
}

/// What a device records of a list of one instance: items, or tiles.
fn recorded(index: &BlockIndex, list: &WorkList, exact: bool, tiles: bool) -> Vec<Recorded> {
    let how =
        Dispatching { group: 1, widths: tiles.into(), tuning: DeviceClass::Desktop.tuning(), most: 3, texels: false };
    let mut dispatches = Dispatches::new(how, 0, index, 1, exact);
    let (mut steps, mut stats) = (Steps::new(Consumers::default()), UpdateStats::default());
    dispatches.fill(index, list, &mut stats);
    Dispatches::append(std::iter::once(&dispatches), &mut steps);
    scheduled(&[&steps], |_, works| vec![dispatches.accesses(list, works)])
}

fn packed(format: DeltaFormat, size: u32) -> PackedMesh {
    let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
    PackedMesh::pack(&testing::mesh(300, TARGETS), &PackDesc { blocks, ..PackDesc::new(format) }).unwrap()
}

/// A crowd of one instance.
struct One {
    mesh: PackedMesh,
    desc: UpdateDesc,
    planner: Planner,
    instances: Instances,
    memory: Memory,
    update: u64,
}

impl One {
    fn new(mesh: PackedMesh, desc: UpdateDesc) -> Self {
        let planner = Planner::new(desc, [mesh.layout()], 1).unwrap();
        let instances = Instances::new(1, TARGETS, desc.slots);
        Self { memory: memory(&mesh, 1, desc.slots as usize), planner, instances, desc, mesh, update: 0 }
    }

    /// The slots of pose and previous pose after an update, and what it did.
    fn step(&mut self, weights: &[f32]) -> ([Option<u32>; 2], UpdateStats) {
        self.update += 1;
        (self.update_to(self.update, weights).1, self.planner.groups[0].stats)
    }
}

impl Planned for One {
    type Memory = Memory;
    type Pose = Vec<f32>;

    fn parts(&mut self) -> (&mut Instances, &mut Memory) {
        (&mut self.instances, &mut self.memory)
    }

    fn update(&mut self, update: u64) -> Vec<Recorded> {
        self.planner.plan(&mut self.instances, update);
        let GroupPlan { index, list, stats, whole_blocks, .. } = &self.planner.groups[0];
        let exact = self.planner.exact();
        self.memory.run_list(self.mesh.surface(), &Workers::new(1).unwrap(), index, list, exact);
        assert!(!whole_blocks || list.masks.iter().all(|mask| *mask == u32::MAX));
        let weights = self.instances.requested().next().flatten().unwrap();
        let pose = self.pose(self.instances.slots_of(0).unwrap().0);
        // Weights are multiples of 1/4: on any grid.
        let error = reference::compare(&pose, &reference::evaluate(&self.mesh, weights));
        let bound = self.desc.error_budget.max(stats.bound);
        let most = f64::from(bound).max(1e-6 * f64::from(self.mesh.layout().diagonal));
        assert!(error.position <= most, "{error:?} of {stats:?}");
        let commands = recorded(index, list, exact.is_some(), *whole_blocks);
        assert_eq!(commands.is_empty(), list.items.is_empty());
        commands
    }

    fn pose(&self, slot: u32) -> Vec<f32> {
        self.mesh.layout().to_user_order(&self.memory.poses[slot as usize])
    }

    fn overwrites(&self) -> bool {
        self.desc.slots == 1
    }
}

proptest! {
    #[test]
    fn plans_reach_the_weights_without_hazards(
        format in 0..DeltaFormat::BLOCKS.len(), size in prop::sample::select(vec![32u32, 64]), exact in any::<bool>(),
        rebuild in any::<bool>(), slots in 1u32..5, budget in any::<bool>(), whole in any::<bool>(), events in events(TARGETS),
    ) {
        let exact = exact && format > 0;
        let accumulate = if exact { Accumulate::Exact } else { Accumulate::Float { tolerance: 1e-4 } };
        let mode = if rebuild { UpdateMode::Rebuild } else { UpdateMode::Incremental };
        let error_budget = if budget { 0.5 } else { 0.0 };
        let desc = UpdateDesc { mode, slots, accumulate, error_budget, ..UpdateDesc::blocks() };
        let mut one = One::new(packed(DeltaFormat::BLOCKS[format], size), desc);
        one.planner.groups[0].whole_blocks = whole;
        follow(&mut one, events);
    }
}

fn float(tolerance: f32) -> UpdateDesc {
    UpdateDesc { accumulate: Accumulate::Float { tolerance }, ..UpdateDesc::blocks() }
}

#[test]
fn every_barrier_of_blocks_is_needed() {
    for (slots, accumulate) in [(1, Accumulate::Exact), (2, Accumulate::Exact), (2, Accumulate::default())] {
        let mut one = One::new(packed(DeltaFormat::Small, 32), UpdateDesc { slots, accumulate, ..float(1e-4) });
        every_barrier_is_needed(&mut one, TARGETS, 2, &format!("{slots} slots"));
    }
}

#[test]
fn a_still_face_is_no_work_and_a_change_touches_its_blocks_only() {
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(1e-4));
    let mut weights = [0.25; TARGETS];
    let ([first, previous], stats) = one.step(&weights);
    assert_eq!((previous, stats.dirty_blocks), (first, 10));
    // The other slot was never written: it takes the whole pose once.
    weights[1] = 0.5;
    assert_eq!(one.step(&weights).1.dirty_blocks, 10);
    weights[1] = 0.75;
    let index = one.mesh.layout().blocks.clone().unwrap();
    let ([moved, previous], stats) = one.step(&weights);
    assert_eq!(stats.dirty_blocks, index.incidence(1).len());
    assert_ne!(previous, moved);
    let (still, stats) = one.step(&weights);
    assert_eq!(still, [moved, moved]);
    assert_eq!(stats, UpdateStats { bound: stats.bound, ..UpdateStats::default() });
    // Target 2 is empty: its weight changes no pose.
    weights[2] = 1.0;
    assert_eq!(one.step(&weights).1.dirty_blocks, 0);
}

#[test]
fn a_cut_to_neutral_is_cheaper_from_base() {
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(1e-4));
    for frame in 0..3 {
        one.step(&[0.5 + frame as f32 / 8.0; TARGETS]);
    }
    let (_, stats) = one.step(&[0.0; TARGETS]);
    assert!(stats.rebuilt_blocks > 0 && stats.rebuilt_blocks == stats.dirty_blocks, "{stats:?}");
    // One weight of nine: adding it is cheaper than all nine from base.
    one.step(&[0.5; TARGETS]);
    one.step(&[0.75; TARGETS]);
    let mut weights = [0.75; TARGETS];
    weights[0] = 1.0;
    assert_eq!(one.step(&weights).1.rebuilt_blocks, 0);
}

#[test]
fn blocks_are_refreshed_before_their_bound_passes_the_tolerance_and_not_all_at_once() {
    let tolerance = 2e-5;
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(tolerance));
    let length = tolerance * one.mesh.layout().diagonal;
    let (mut rebuilt, mut most) = (0, 0);
    let mut weights = [0.5; TARGETS];
    for frame in 0..1200u32 {
        // One of nine targets changes: rebuilding never pays by bytes.
        weights[frame as usize % TARGETS] = 0.5 + (frame * 7 % 16) as f32 / 16.0;
        let (_, stats) = one.step(&weights);
        assert!(stats.bound <= length, "{stats:?}");
        if frame > 2 {
            rebuilt += stats.rebuilt_blocks;
            most = most.max(stats.rebuilt_blocks);
        }
    }
    assert!(rebuilt > 10 && most < 10, "{rebuilt} rebuilds, {most} at once");
}

#[test]
fn small_changes_wait_and_settle() {
    let budget = 0.05;
    let mut one = One::new(packed(DeltaFormat::Small, 32), UpdateDesc { error_budget: budget, ..float(1e-4) });
    one.step(&[0.5; TARGETS]);
    one.step(&[0.75; TARGETS]);
    let mut weights = [0.75; TARGETS];
    weights[0] += 0.01;
    assert_eq!(one.step(&weights).1.dirty_blocks, 0, "it waits");
    assert!(one.step(&weights).1.dirty_blocks > 0, "a still face settles");
    assert_eq!(one.step(&weights).1.dirty_blocks, 0);
    weights[0] += 0.5;
    assert!(one.step(&weights).1.dirty_blocks > 0, "a large change does not wait");
}

#[test]
fn a_cut_is_spent_on_a_still_frame_too() {
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(1e-4));
    one.step(&[0.25; TARGETS]);
    let ([still, _], _) = one.step(&[0.5; TARGETS]);
    one.instances.cut(0).unwrap();
    one.step(&[0.5; TARGETS]);
    let ([_, previous], _) = one.step(&[0.75; TARGETS]);
    assert_eq!(previous, still);
    one.instances.cut(0).unwrap();
    let ([moved, previous], _) = one.step(&[1.0; TARGETS]);
    assert_eq!(previous, moved);
}
