//! Plans in blocks, executed on the CPU: any history ends in the requested pose, and tiles match the list.

use super::dispatch::{Dispatches, Dispatching, KERNELS, Tiles};
use super::*;
use crate::abi::worklist::{ALIGN, TILE, WIDTHS, row_words};
use crate::cpu::{Memory, Workers};
use crate::gpu::tuning::{DeviceClass, DeviceTuning};
use crate::pack::blocks::BlockDesc;
use crate::pack::{DeltaFormat, PackDesc, PackedMesh, PoseFormat};
use crate::plan::hazards::{Event as Recorded, blocks};
use crate::plan::instances::Instances;
use crate::plan::steps::Steps;
use crate::plan::tests::{events, scheduled};
use crate::plan::{Consumers, UpdateDesc, UpdateMode, UpdateStats};
use crate::update::tests::{One, Planned, every_barrier_is_needed, follow};
use crate::{reference, testing};
use proptest::prelude::*;

const TARGETS: usize = 9;

/// The recorded events of one instance's list.
fn recorded(mut plan: GroupPlan) -> Vec<Recorded> {
    let tuning = DeviceClass::Desktop.tuning();
    let how = Dispatching { group: 1, widths: 1, tuning, most: 3, items: 2, texels: false };
    let mut dispatches = Dispatches::new(how, 0, &plan, 1);
    let mut steps = Steps::new(Consumers::default());
    dispatches.fill(&mut plan);
    Dispatches::append(std::iter::once(&dispatches), &mut steps);
    scheduled(&[&steps], |_, works| {
        vec![blocks(0, works.iter().flat_map(|work| dispatches.items_of(&plan.list, work)))]
    })
}

fn packed(format: DeltaFormat, size: u32) -> PackedMesh {
    let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
    PackedMesh::pack(&testing::mesh(300, TARGETS), &PackDesc { blocks, ..PackDesc::new(format) }).unwrap()
}

/// Plans a mesh.
struct Blocks {
    mesh: PackedMesh,
    planner: Planner,
}

fn one(mesh: PackedMesh, desc: UpdateDesc) -> One<Blocks> {
    let planner = Planner::new(desc, [mesh.layout()], 1).unwrap();
    // Nothing may be read before it is written.
    let mut memory = Memory::new(mesh.surface(), desc, 1).unwrap();
    memory.poses.iter_mut().for_each(|pose| pose.fill(f32::NAN.to_bits()));
    One::new(desc, TARGETS, Blocks { mesh, planner }, memory)
}

impl One<Blocks> {
    /// The statistics of an update.
    fn step(&mut self, weights: &[f32]) -> UpdateStats {
        self.update_to(weights);
        self.planner.planner.groups[0].stats
    }
}

impl Planned for Blocks {
    type Memory = Memory;
    type Pose = Vec<f32>;

    fn update(one: &mut One<Self>) -> Vec<Recorded> {
        let Blocks { mesh, planner } = &mut one.planner;
        planner.plan(&mut one.instances, one.update);
        let group = &planner.groups[0];
        let GroupPlan { list, stats, .. } = group;
        one.memory.run_list(mesh.surface(), &Workers::new(1).unwrap(), group);
        let weights = one.instances.requested().next().flatten().unwrap();
        let pose = one.memory.decode(one.instances.slots_of(0).unwrap().0 as usize);
        let pose = mesh.layout().to_user_order(&pose);
        // Multiples of 1/4 lie on any grid. The bound is that of integers: decoding rounds to float32.
        let error = reference::compare(&pose, &reference::evaluate(mesh, weights));
        let bound = one.desc.error_budget.max(stats.bound);
        let most = f64::from(bound) + 1e-6 * f64::from(mesh.layout().diagonal);
        assert!(error.position <= most, "{error:?} of {stats:?}");
        let commands = recorded(group.clone());
        assert_eq!(commands.is_empty(), list.items.is_empty());
        commands
    }

    fn pose(one: &One<Self>, slot: u32) -> Vec<f32> {
        let mesh = &one.planner.mesh;
        mesh.layout().to_user_order(&one.memory.decode(slot as usize))
    }
}

proptest! {
    #[test]
    fn plans_reach_the_weights_without_hazards(
        format in 0..DeltaFormat::BLOCKS.len(), size in prop::sample::select(vec![32u32, 64]), pose in poses(),
        rebuild in any::<bool>(), slots in 1u32..5, budget in any::<bool>(), events in events(TARGETS),
    ) {
        let pose = if pose.takes(DeltaFormat::BLOCKS[format]) { pose } else { PoseFormat::Float32 };
        let mode = if rebuild { UpdateMode::Rebuild } else { UpdateMode::Incremental };
        let error_budget = if budget { 0.5 } else { 0.0 };
        let desc = UpdateDesc { mode, slots, pose, error_budget, ..float(1e-4) };
        follow(one(packed(DeltaFormat::BLOCKS[format], size), desc), events);
    }
}

fn float(tolerance: f32) -> UpdateDesc {
    UpdateDesc { tolerance, weight_max: Some(4.0), ..UpdateDesc::blocks() }
}

fn poses() -> impl Strategy<Value = PoseFormat> {
    prop::sample::select(&PoseFormat::ALL)
}

#[test]
fn every_barrier_of_blocks_is_needed() {
    for (slots, pose) in [(1, PoseFormat::Fixed16), (2, PoseFormat::Fixed32), (2, PoseFormat::Float32)] {
        let one = one(packed(DeltaFormat::Small, 32), UpdateDesc { slots, pose, ..float(1e-4) });
        every_barrier_is_needed(one, TARGETS, 2, &format!("{slots} slots"));
    }
}

#[test]
fn a_cut_to_neutral_is_cheaper_from_base() {
    let mut one = one(packed(DeltaFormat::Fast, 32), float(1e-4));
    for frame in 0..3 {
        one.step(&[0.5 + frame as f32 / 8.0; TARGETS]);
    }
    let stats = one.step(&[0.0; TARGETS]);
    assert!(stats.rebuilt_blocks > 0 && stats.rebuilt_blocks == stats.dirty_blocks, "{stats:?}");
    // One weight of nine: adding it is cheaper than all nine from base.
    one.step(&[0.5; TARGETS]);
    one.step(&[0.75; TARGETS]);
    let mut weights = [0.75; TARGETS];
    weights[0] = 1.0;
    assert_eq!(one.step(&weights).rebuilt_blocks, 0);
}

/// Updates in which one of the first `moving` weights changes: rebuilding never pays by bytes.
fn changing(one: &mut One<Blocks>, mut weights: [f32; TARGETS], moving: usize, frames: u32) -> Vec<UpdateStats> {
    let mut step = |frame: u32| {
        weights[frame as usize % moving] = 0.5 + (frame * 7 % 16) as f32 / 16.0;
        one.step(&weights)
    };
    (0..frames).map(&mut step).collect()
}

#[test]
fn blocks_are_refreshed_before_their_bound_passes_the_tolerance_and_not_all_at_once() {
    let tolerance = 2e-5;
    let mut one = one(packed(DeltaFormat::Fast, 32), float(tolerance));
    let length = tolerance * one.planner.mesh.layout().diagonal;
    let all = changing(&mut one, [0.5; TARGETS], TARGETS, 1200);
    assert!(all.iter().all(|stats| stats.bound <= length), "{all:?}");
    let rebuilt = || all[3..].iter().map(|stats| stats.rebuilt_blocks);
    assert!(rebuilt().sum::<usize>() > 10 && rebuilt().max() < Some(10), "{all:?}");
}

#[test]
fn a_tolerance_that_a_rebuild_exceeds_does_not_cause_rebuilds_in_every_update() {
    let fresh = || one(packed(DeltaFormat::Fast, 32), float(1e-9));
    let least = fresh().step(&[1.5; TARGETS]).bound;
    let all = changing(&mut fresh(), [1.5; TARGETS], TARGETS, 600);
    assert!(all.iter().all(|stats| stats.bound > 0.0 && stats.bound <= 2.0 * least), "{least} at the least: {all:?}");
    let sum = |of: fn(&UpdateStats) -> usize| all.iter().map(of).sum::<usize>();
    let (rebuilt, written) = (sum(|stats| stats.rebuilt_blocks), sum(|stats| stats.dirty_blocks));
    assert!(rebuilt > 0 && 4 * rebuilt < written, "{rebuilt} of {written}");
}

#[test]
fn a_tolerance_is_kept_again_once_rebuilds_keep_it() {
    let fresh = |weights: &[f32; TARGETS]| one(packed(DeltaFormat::Fast, 32), float(1e-9)).step(weights).bound;
    let few = std::array::from_fn(|target| if target < 4 { 0.5 } else { 0.0 });
    let length = (fresh(&few) + fresh(&[1.5; TARGETS])) / 2.0;
    let mesh = packed(DeltaFormat::Fast, 32);
    let tolerance = length / mesh.layout().diagonal;
    let mut one = one(mesh, float(tolerance));
    one.step(&[1.5; TARGETS]);
    assert!(one.step(&[1.4; TARGETS]).bound > length, "it cannot be kept");
    let all = changing(&mut one, few, 1, 2000);
    assert!(all.iter().all(|stats| stats.bound <= length), "{length}: {all:?}");
}

proptest! {
    #[test]
    fn tiles_do_what_the_list_says(
        format in 0..DeltaFormat::BLOCKS.len(), size in prop::sample::select(vec![32u32, 64]), pose in poses(),
        slots in 1u32..4, instances in 1usize..21, widest in 0usize..WIDTHS, shared in 1usize..3,
        frames in prop::collection::vec(prop::collection::vec(prop::option::weighted(0.4, -2i8..5), 20 * TARGETS), 1..6),
    ) {
        let mesh = packed(DeltaFormat::BLOCKS[format], size);
        let index = mesh.layout().blocks.clone().unwrap();
        let pose = if pose.takes(DeltaFormat::BLOCKS[format]) { pose } else { PoseFormat::Float32 };
        let desc = UpdateDesc { slots, pose, ..float(1e-5) };
        let mut planner = Planner::new(desc, [mesh.layout()], instances).unwrap();
        let tuning = DeviceTuning { widest_tile: 1 << widest, ..DeviceClass::Desktop.tuning() };
        let mut tiles = Tiles::new(&index, instances, tuning, 0);
        let mut crowd = Instances::new(instances, TARGETS, slots, 1);
        let mut weights = vec![[0.0; TARGETS]; instances];
        for (update, changes) in frames.iter().enumerate() {
            for (weight, change) in weights.iter_mut().flatten().zip(changes) {
                *weight = change.map_or(*weight, |w| f32::from(w) * 0.25);
            }
            for (i, weights) in weights.iter().enumerate() {
                crowd.set_weights(i as u32, weights).unwrap();
            }
            planner.plan(&mut crowd, update as u64 + 1);
            let list = &planner.groups[0].list;
            tiles.clear();
            tiles.sort(&index, list, 0..list.items.len());
            tiles.fill(&index, list);
            let made = tiles.counts();
            tiles.fill_workgroups([0; KERNELS], shared);
            for (tiles, made) in tiles.items.iter().zip(made) {
                prop_assert!(tiles.len().is_multiple_of(shared) && tiles.len() < made + shared);
                prop_assert!((0..).zip(tiles).all(|(i, tile)| (tile.count > 0) == (i < made)), "rows, or a filler");
            }
            let (mut seen, mut bytes) = (vec![], 0);
            for (width, tile) in tiles.iter().filter(|(_, tile)| tile.count > 0) {
                let (stride, members) = (row_words(width), tile.members(width));
                let rows = &tiles.rows[tile.first as usize..][..tile.count as usize * stride];
                prop_assert!(width <= widest && (tile.first as usize).is_multiple_of(ALIGN) && stride > members.len());
                // Its header, items and rows (an entry each), the source and destination poses of each instance, or one
                // base pose.
                let entries = rows.chunks_exact(stride).map(|row| row[0] as usize);
                let written = pose.stride() * members.len();
                let read = if tile.rebuilt != 0 { pose.base_stride() } else { written };
                bytes += 4 * (4 + members.len() + rows.len()) + index.size() * (written + read);
                bytes += entries.map(|entry| index.costs[entry].bytes as usize).sum::<usize>();
                for (place, &i) in members.iter().enumerate() {
                    let item = &list.items[i as usize];
                    prop_assert_eq!((item.block, item.source.is_none()), (tile.block, tile.rebuilt >> place & 1 != 0));
                    // Coefficients of 0, in rows that other instances need and in padding, change nothing.
                    let added = rows.chunks_exact(stride).map(|row| (row[0], row[1 + place])).filter(|row| row.1 != 0);
                    let listed = list.elements_of(item).iter().map(|e| (e.entry, e.coefficient)).filter(|e| e.1 != 0);
                    prop_assert!(added.eq(listed));
                }
                seen.extend_from_slice(members);
            }
            seen.sort_unstable();
            prop_assert!(seen.iter().copied().eq(0..list.items.len() as u32), "every item is in one tile");
            prop_assert_eq!(tiles.bytes(&index, pose)[0], bytes as u64);
            prop_assert!(tiles.rows.len() <= Tiles::words_max(&index, instances));
        }
    }
}

/// Widths of the tiles of eight instances; `changed(instance, target)` says which targets changed.
fn widths_of(tuning: DeviceTuning, changed: impl Fn(usize, usize) -> bool) -> [usize; WIDTHS] {
    let mesh = packed(DeltaFormat::Fast, 64);
    let index = mesh.layout().blocks.clone().unwrap();
    let desc = UpdateDesc::blocks();
    let mut planner = Planner::new(desc, [mesh.layout()], TILE).unwrap();
    let mut tiles = Tiles::new(&index, TILE, tuning, 0);
    let mut crowd = Instances::new(TILE, TARGETS, desc.slots, 1);
    for update in 1..4 {
        for instance in 0..TILE {
            let weight = |t| if changed(instance, t) { 0.25 * update as f32 } else { 0.25 };
            crowd.set_weights(instance as u32, &std::array::from_fn::<f32, TARGETS, _>(weight)).unwrap();
        }
        planner.plan(&mut crowd, update);
    }
    let list = &planner.groups[0].list;
    tiles.sort(&index, list, 0..list.items.len());
    tiles.fill(&index, list);
    std::array::from_fn(|width| tiles.iter().filter(|(w, _)| *w == width).count())
}

#[test]
fn instances_share_a_tile_where_they_share_entries() {
    let wide = DeviceTuning { widest_tile: TILE as u32, ..DeviceClass::Desktop.tuning() };
    let widths = |changed: &dyn Fn(usize, usize) -> bool| widths_of(wide, changed);
    let [singles @ .., blocks] = widths(&|_, _| true);
    assert!(blocks > 1 && singles == [0; 3], "all change: one tile of eight a block");
    assert_eq!(widths(&|instance, t| t == instance)[2..], [0, 0], "instances with nothing in common share no tile");
    let most = |instance: usize, t: usize| t % 5 != instance / 4;
    let cheap = DeviceTuning { load_cost: 0, ..wide };
    let (shared, alone) = (widths_of(wide, most)[3], widths_of(cheap, most)[3]);
    assert!(alone < shared, "where loading costs nothing, tiles are halved for less: {alone} of {shared} are whole");
}
