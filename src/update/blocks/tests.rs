//! Plans in blocks, carried out by the CPU twin: any history ends in the pose asked for.

use super::plan::{Dispatches, Dispatching};
use super::*;
use crate::abi::kernels::DeviceClass;
use crate::cpu::blocks::Block;
use crate::pack::blocks::BlockDesc;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
use crate::plan::hazards::Event as Recorded;
use crate::plan::instances::Instances;
use crate::plan::steps::Steps;
use crate::plan::tests::{Event, assert_barriers_needed, checker, events, scheduled};
use crate::plan::{Accumulate, BatchSize, Consumers, UpdateDesc, UpdateMode, UpdatePath, UpdateStats};
use crate::{reference, testing};
use proptest::prelude::*;

const TARGETS: usize = 9;

/// The memory that updates work on.
#[derive(Clone)]
struct Device {
    slots: Vec<Vec<f32>>,
    sums: Vec<i32>,
}

/// Carry `list` out on `device`.
fn run(mesh: &PackedMesh, index: &BlockIndex, exact: Option<ExactGrid>, list: &WorkList, device: &mut Device) {
    let floats = index.size() * 6;
    for (i, item) in list.items.iter().enumerate() {
        let part = item.block as usize * floats..(item.block as usize + 1) * floats;
        let source =
            item.source.filter(|&s| s != item.destination).map(|s| device.slots[s as usize][part.clone()].to_vec());
        let block = Block::new(mesh.surface(), index, list, i, source.as_deref());
        let sums = exact.map(|grid| (&mut device.sums[part.clone()], grid));
        block.run(&mut device.slots[item.destination as usize][part], sums, &mut ());
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
    planner: Planner,
    instances: Instances,
    update: u64,
}

impl One {
    fn new(mesh: PackedMesh, desc: UpdateDesc) -> Self {
        let planner = Planner::new(desc, [mesh.layout()], 1).unwrap();
        Self { planner, instances: Instances::new(1, TARGETS, desc.slots), mesh, update: 0 }
    }

    /// Plan the next update; the slots of pose and previous pose.
    fn step(&mut self, weights: &[f32]) -> ((u32, Option<u32>), UpdateStats) {
        self.update += 1;
        self.instances.set_weights(0, weights).unwrap();
        self.planner.plan(&mut self.instances, self.update);
        (self.instances.slots_of(0).unwrap(), self.planner.groups[0].stats)
    }

    /// What a device records of the last update.
    fn recorded(&self, exact: bool, tiles: bool) -> Vec<Recorded> {
        let group = &self.planner.groups[0];
        recorded(&group.index, &group.list, exact, tiles)
    }
}

proptest! {
    /// Any sequence of updates, cuts and discarded updates: the result slot holds the pose asked for, the previous
    /// slot the one before, and no access is unordered.
    #[test]
    fn plans_reach_the_weights_without_hazards(
        format in 0..DeltaFormat::BLOCKS.len(), size in prop::sample::select(vec![32u32, 64]), exact in any::<bool>(),
        rebuild in any::<bool>(), slots in 1u32..5, budget in any::<bool>(), whole in any::<bool>(), events in events(TARGETS),
    ) {
        let mesh = packed(DeltaFormat::BLOCKS[format], size);
        let index = mesh.layout().blocks.clone().unwrap();
        let exact = exact && format > 0;
        let accumulate = if exact { Accumulate::Exact } else { Accumulate::Float { tolerance: 1e-4 } };
        let mode = if rebuild { UpdateMode::Rebuild } else { UpdateMode::Incremental };
        let error_budget = if budget { 0.5 } else { 0.0 };
        let desc = UpdateDesc { mode, slots, accumulate, error_budget, ..UpdateDesc::blocks() };
        let mut one = One::new(mesh, desc);
        if whole {
            one.planner.groups[0].write_whole_blocks();
        }
        let mesh = one.mesh.clone();
        let mut device = Device {
            // Nothing may be read before it is written.
            slots: vec![vec![f32::NAN; mesh.base().len()]; slots as usize],
            sums: vec![i32::MAX; mesh.base().len()],
        };
        let mut ran: Vec<(u64, Vec<Recorded>, Vec<u32>, Device)> = vec![];
        let mut last = None::<Vec<f32>>;
        for event in events {
            match event {
                Event::DiscardLast(n) => {
                    // They never ran: memory is what it was before the first of them.
                    let kept = ran.len().saturating_sub(n as usize);
                    for (number, list, _, before) in ran.drain(kept..).rev() {
                        one.instances.discard_from(number);
                        if !list.is_empty() {
                            last = None;
                        }
                        device = before;
                    }
                }
                Event::Cut => { one.instances.cut(0).unwrap(); last = None; }
                Event::Update(weights) => {
                    let known = one.instances.slots_of(0).is_some();
                    let ((result, previous), stats) = one.step(&weights);
                    let commands = one.recorded(exact, whole);
                    let list = &one.planner.groups[0].list;
                    prop_assert_eq!(commands.is_empty(), list.items.is_empty());
                    prop_assert!(!whole || list.masks.iter().all(|m| *m == u32::MAX));
                    let before = device.clone();
                    run(&mesh, &index, one.planner.exact(), list, &mut device);
                    let pose = mesh.layout().to_user_order(&device.slots[result as usize]);
                    // Weights are multiples of 1/4: on any grid.
                    let error = reference::compare(&pose, &reference::evaluate(&mesh, &weights));
                    let most = f64::from(error_budget.max(stats.bound)).max(1e-6 * f64::from(mesh.layout().diagonal));
                    prop_assert!(error.position <= most, "{:?} of {:?}", error, stats);
                    match (previous, &last) {
                        (Some(slot), Some(last)) => {
                            prop_assert_eq!(&mesh.layout().to_user_order(&device.slots[slot as usize]), last);
                        }
                        (Some(slot), None) => prop_assert!(slot == result || (known && list.items.is_empty())),
                        (None, _) => prop_assert_eq!(slots, 1),
                    }
                    let drawn = previous.into_iter().chain([result]).collect();
                    ran.push((one.update, commands, drawn, before));
                    last = Some(pose);
                }
            }
        }
        let mut checker = checker();
        for (_, list, drawn, _) in &ran {
            checker.update(list);
            drawn.iter().for_each(|&slot| checker.draw(0, 0, slot));
        }
        prop_assert_eq!(checker.finish(), Ok(()));
    }
}

fn float(tolerance: f32) -> UpdateDesc {
    UpdateDesc { accumulate: Accumulate::Float { tolerance }, ..UpdateDesc::blocks() }
}

/// Take any one barrier of a running animation out, and the checker says so.
#[test]
fn every_barrier_is_needed() {
    for (slots, accumulate) in [(1, Accumulate::Exact), (2, Accumulate::Exact), (2, Accumulate::default())] {
        let mut one = One::new(packed(DeltaFormat::Small, 32), UpdateDesc { slots, accumulate, ..float(1e-4) });
        let mut frames = vec![];
        for frame in 0..5usize {
            let weight = |i: usize| if i % 3 == frame % 3 { 2.0 + frame as f32 / 4.0 } else { 1.0 };
            let ((result, previous), _) = one.step(&(0..TARGETS).map(weight).collect::<Vec<f32>>());
            frames.push((one.recorded(accumulate == Accumulate::Exact, false), [Some(result), previous]));
        }
        assert_barriers_needed(&frames, 2, &format!("{slots} slots"));
    }
}

#[test]
fn a_still_face_is_no_work_and_a_change_touches_its_blocks_only() {
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(1e-4));
    let mut weights = [0.25; TARGETS];
    let ((first, previous), stats) = one.step(&weights);
    assert_eq!((previous, stats.dirty_blocks), (Some(first), 10));
    // The other slot was never written: it takes the whole pose once.
    weights[1] = 0.5;
    assert_eq!(one.step(&weights).1.dirty_blocks, 10);
    weights[1] = 0.75;
    let index = one.mesh.layout().blocks.clone().unwrap();
    let ((moved, previous), stats) = one.step(&weights);
    assert_eq!(stats.dirty_blocks, index.incidence(1).len());
    assert_ne!(previous, Some(moved));
    let (still, stats) = one.step(&weights);
    assert_eq!(still, (moved, Some(moved)));
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
fn unusable_descriptions_are_refused() {
    for (desc, words) in [
        (float(0.0), "a tolerance of 0"),
        (UpdateDesc { error_budget: -1.0, ..float(1e-5) }, "an error budget of -1"),
        (UpdateDesc { error_budget: 1.0, ..UpdateDesc::new(UpdatePath::Compute, BatchSize::All) }, "with 'compute'"),
    ] {
        let text = desc.check().unwrap_err().to_string();
        assert!(text.contains(words), "{text}");
    }
}

#[test]
fn a_cut_is_spent_on_a_still_frame_too() {
    let mut one = One::new(packed(DeltaFormat::Fast, 32), float(1e-4));
    one.step(&[0.25; TARGETS]);
    let ((still, _), _) = one.step(&[0.5; TARGETS]);
    one.instances.cut(0).unwrap();
    one.step(&[0.5; TARGETS]);
    let ((_, previous), _) = one.step(&[0.75; TARGETS]);
    assert_eq!(previous, Some(still));
    one.instances.cut(0).unwrap();
    let ((moved, previous), _) = one.step(&[1.0; TARGETS]);
    assert_eq!(previous, Some(moved));
}
