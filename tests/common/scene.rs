//! A crowd animated on the GPU and its CPU reference: both get the same calls, and their plans are compared.

use crate::planned::{PlannedGroup, read_plan};
use crate::prelude::*;
use crate::twin::AnimatedReference;
use deltamorph::internals::abi::worklist::{TILE, TILE_WORDS, row_words};
use deltamorph::internals::plan::instances::InstanceState;
use deltamorph::internals::update::animated::Playbacks;
use deltamorph::internals::update::blocks::WorkList;
use deltamorph_headless::Recorded;
use std::collections::{BTreeMap, BTreeSet};

pub fn head_desc() -> HeadDesc {
    HeadDesc { vertices: 900, targets: 37, sparsity: 0.15, seed: 3 }
}

pub fn packed(format: DeltaFormat, size: u32) -> Arc<PackedMesh> {
    packed_mesh(head(&head_desc()).kept(Tolerance::default()).expect("a mesh"), format, size)
}

/// Packs the same head with tangents, texture coordinates and colours.
pub fn packed_streams(format: DeltaFormat, size: u32) -> Arc<PackedMesh> {
    let mesh = testing::with_streams(head(&head_desc()).kept(Tolerance::default()).expect("a mesh"));
    packed_mesh(mesh, format, size)
}

fn packed_mesh(mesh: KeptMesh, format: DeltaFormat, size: u32) -> Arc<PackedMesh> {
    let blocks = BlockDesc { size: Some(size), ..Default::default() };
    Arc::new(PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(format) }).expect("a mesh that packs"))
}

/// Returns a captured-like clip, a short one in which all weights change, and a constant one.
pub fn clips() -> Vec<WeightClip> {
    let clip = head_clip(&head_desc(), 40, 30.0);
    let noise = |i: usize| ((i as u32).wrapping_mul(0x9E37_79B9) >> 12) as f32 / (1 << 20) as f32 - 0.3;
    let values = |f: &dyn Fn(usize) -> f32, frames: usize| (0..frames * clip.names.len()).map(f).collect();
    let wild = WeightClip { fps: 12.0, values: values(&noise, 5), ..clip.clone() };
    let still = WeightClip { values: values(&|i| if i % 3 == 0 { 0.5 } else { 0.0 }, 1), ..clip.clone() };
    vec![clip, wild, still]
}

pub fn crowd(instances: u32, update: UpdateDesc) -> CrowdDesc {
    CrowdDesc { instances, ..CrowdDesc::new(update) }
}

pub fn blocks(mesh: &PackedMesh) -> usize {
    mesh.layout().blocks.as_ref().expect("blocks").count()
}

/// Pose formats of animated crowds.
pub const FIXED: [PoseFormat; 3] = [PoseFormat::Fixed32, PoseFormat::Fixed16, PoseFormat::Rebuilt16];

pub fn fixed(pose: PoseFormat, slots: u32) -> UpdateDesc {
    UpdateDesc { pose, slots, ..UpdateDesc::blocks() }
}

/// Makes a crowd for full evaluations on the CPU, one at a time.
pub fn full_evaluations(mesh: &Arc<PackedMesh>, update: UpdateDesc) -> CpuCrowd {
    let rebuilt = UpdateDesc { mode: UpdateMode::Rebuild, slots: 1, error_budget: 0.0, ..update };
    gpu::cpu_crowd(mesh, rebuilt, 1)
}

/// Returns the grid of an animated crowd with the update `desc`.
pub fn grid(mesh: &PackedMesh, desc: &UpdateDesc) -> PoseGrid {
    desc.grid(mesh.layout()).expect("a grid").expect("poses of integers")
}

/// The work on a block of an instance: whether it starts from the base pose, slots, entries and coefficients.
type Work = (bool, u32, u32, Vec<(u32, i32)>);
/// Work by instance and block.
pub type Plan = BTreeMap<(u32, u32), Work>;

pub struct Scene<'a> {
    /// Most instances in a tile.
    widest: u32,
    pub crowd: HeadlessCrowd<'a>,
    pub mesh: Arc<PackedMesh>,
    desc: CrowdDesc,
    heads: Playbacks,
    clips: Clips,
    reference: AnimatedReference,
    /// A crowd for full evaluations, one at a time.
    fresh: CpuCrowd,
    hidden: Vec<bool>,
}

impl<'a> Scene<'a> {
    pub fn new(headless: &'a Headless, mesh: &Arc<PackedMesh>, desc: CrowdDesc, animation: &AnimationDesc<'_>) -> Self {
        Self {
            widest: headless.caps().tuning.widest_tile,
            crowd: HeadlessCrowd::animated(headless, mesh, &desc, animation).expect("a crowd"),
            heads: Playbacks::new(desc.instances),
            clips: Clips::new(animation, mesh.layout(), grid(mesh, &desc.update)).expect("clips"),
            reference: AnimatedReference::new(desc.update, mesh.layout(), desc.instances).expect("a reference"),
            fresh: full_evaluations(mesh, desc.update),
            hidden: vec![false; desc.instances as usize],
            mesh: mesh.clone(),
            desc,
        }
    }

    /// Starts at `seconds`, as if `updates` updates had been recorded.
    pub fn begin_at(&mut self, updates: u64, seconds: f64) {
        self.crowd.begin_at(updates);
        self.crowd.set_time(seconds).expect("a time");
        self.heads.begin_at(updates);
        self.heads.set_time(seconds).expect("a time");
    }

    pub fn play(&mut self, instance: u32, playback: Playback) {
        self.crowd.play(instance, &playback).expect("a clip");
        self.heads.play(instance, &playback, &self.clips).expect("a clip");
    }

    pub fn set_level(&mut self, instance: u32, level: f32) {
        self.crowd.set_level(instance, level).expect("a level");
        self.heads.set_level(instance, level, &self.clips).expect("a level");
    }

    pub fn hide(&mut self, instance: u32, hidden: bool) {
        self.crowd.set_hidden(instance, hidden).expect("an instance");
        self.heads.set_hidden(instance, hidden);
        self.hidden[instance as usize] = hidden;
    }

    pub fn reset_history(&mut self, instance: u32) {
        self.crowd.reset_history(instance).expect("an instance");
        self.heads.reset_history(instance);
    }

    pub fn remove(&mut self, instance: u32) {
        self.crowd.remove(instance).expect("an instance");
        self.heads.set_hidden(instance, true);
        self.hidden[instance as usize] = true;
    }

    pub fn add(&mut self) -> u32 {
        let instance = self.crowd.add().expect("a free place");
        self.heads.add(instance);
        self.hidden[instance as usize] = false;
        instance
    }

    /// Updates both to the time `seconds`, and compares plan and weights.
    pub fn step(&mut self, seconds: f64) -> (Plan, Vec<Entry>) {
        self.crowd.set_time(seconds).expect("a time");
        let (_, commands, _) = gpu::recorded(&mut self.crowd, &[]);
        self.update_twin(seconds);
        // A sample of many instances.
        let some = (0..self.desc.instances).step_by(1 + self.desc.instances as usize / 50);
        for instance in some.filter(|&i| !self.hidden[i as usize]) {
            let weights = self.crowd.read_weights(instance).expect("weights");
            assert_eq!(weights, self.reference.weights(instance as usize), "weights of head {instance} at {seconds}");
        }
        (self.assert_planned(), commands)
    }

    fn update_twin(&mut self, seconds: f64) {
        self.heads.set_time(seconds).expect("a time");
        let update = self.heads.update(&self.clips);
        self.reference.update(&self.clips, &self.heads, update);
    }

    /// Asserts that the plan of the last update is the reference's.
    fn assert_planned(&mut self) -> Plan {
        let plan = of_groups(&read_plan(&mut self.crowd), self.desc.update.slots, self.widest, &self.mesh);
        assert_eq!(plan, of_list(self.reference.list()), "{:?}", self.desc);
        plan
    }

    /// Records an update at `seconds` that never runs. The reference is not updated.
    pub fn drop_one(&mut self, seconds: f64) {
        self.crowd.set_time(seconds).expect("a time");
        let (_, update) = self.crowd.record(&[]).expect("a recording");
        self.crowd.discard(update.ticket).expect("a ticket of this crowd");
    }

    /// Records an update at `seconds`, for [`run`](Self::run).
    pub fn record(&mut self, seconds: f64) -> Recorded {
        self.crowd.set_time(seconds).expect("a time");
        self.update_twin(seconds);
        self.crowd.record(&[]).expect("a recording").0
    }

    /// Runs updates all at once; compares the last plan with the reference's.
    pub fn run(&mut self, recorded: Vec<Recorded>) {
        self.crowd.submit(recorded).expect("a submission");
        self.assert_planned();
    }

    /// Asserts that an instance's stored and decoded poses equal a full evaluation bit for bit.
    pub fn assert_fresh(&mut self, instance: u32) {
        let grid = grid(&self.mesh, &self.desc.update);
        let steps = self.reference.weights(instance as usize);
        let weights: Vec<f32> = steps.iter().map(|&s| s as f32 * grid.weight_step()).collect();
        self.fresh.set_weights(0, &weights).expect("weights");
        self.fresh.update();
        for group in 0..self.mesh.groups().len() {
            let what = format!("pose of head {instance}, group {group}, {:?}", self.desc);
            let stored = self.crowd.read_stored(instance, group).expect("a pose");
            assert!(stored == self.fresh.stored_pose(0, group).expect("an instance"), "stored {what}");
            let (pose, _) = self.crowd.read_group(instance, group).expect("a pose");
            let expected = self.mesh.layout().to_user_order(&self.fresh.group_pose(0, group).expect("an instance"));
            assert!(pose == expected, "{what}");
        }
        let pose = self.crowd.read_pose(instance).expect("a pose");
        let error = compare(&pose, &evaluate(&self.mesh, &weights));
        let rounding = grid.position_error(weights.iter().filter(|w| **w != 0.0).count());
        let float = 1e-6 * f64::from(self.mesh.layout().diagonal);
        let most = f64::from(rounding) + float;
        assert!(error.position <= most, "head {instance} is {error:?} off, {:?}", self.desc);
    }

    pub fn instances(&self) -> std::ops::Range<u32> {
        0..self.desc.instances
    }

    pub fn is_hidden(&self, instance: u32) -> bool {
        self.hidden[instance as usize]
    }
}

/// Converts the CPU planner's list. Coefficients of 0 are not listed.
fn of_list(list: &WorkList) -> Plan {
    let mut plan = Plan::new();
    for item in &list.items {
        let elements = list.elements_of(item).iter().map(|e| (e.entry, e.coefficient as i32)).collect();
        let source = item.source.unwrap_or(0);
        let work = (item.source.is_none(), source, item.destination, elements);
        assert!(plan.insert((item.instance, item.block), work).is_none());
    }
    plan
}

/// Converts the plan in the GPU's lists, and checks their form.
fn of_groups(groups: &[PlannedGroup], slots: u32, widest: u32, mesh: &PackedMesh) -> Plan {
    let (mut plan, mut tiles) = (Plan::new(), BTreeSet::new());
    let entries = mesh.layout().blocks.as_ref().map_or(0, |index| index.entry_count());
    // Lists contain every block exactly once.
    let mut planned: Vec<_> = groups.iter().filter(|group| group.instances.0 == 0).map(|group| &group.blocks).collect();
    planned.sort_by_key(|blocks| blocks.start);
    assert!(planned.windows(2).all(|two| two[0].end == two[1].start) && planned[0].start == 0);
    assert_eq!(planned.last().map(|last| last.end), Some(blocks(mesh)));
    for group in groups {
        for (size, &count) in group.counts.iter().enumerate() {
            let width = 1usize << size;
            for i in 0..count as usize {
                let item = &group.words[(size * group.capacity + i) * TILE_WORDS..][..TILE_WORDS];
                let (block, first, rows, rebuilt) = (item[0], item[1] as usize, item[2] as usize, item[3]);
                let poses: Vec<[u32; 2]> = item[4..].iter().map(|w| [w & 0xffff, w >> 16]).collect();
                let stride = row_words(width.ilog2() as usize);
                let rows = group.words[first..][..rows * stride].chunks_exact(stride);
                let rows: Vec<&[u32]> = rows.map(|row| &row[..=width]).collect();
                assert!(rows.iter().all(|row| (row[0] as usize) < entries), "entries that exist");
                // There is at least one.
                let idle = rows.len() == 1 && rows[0][1..].iter().all(|c| *c == 0);
                let mut rows = rows[usize::from(idle)..].to_vec();
                rows.sort_unstable();
                assert!(idle || !rows.is_empty());
                let is_planned = group.blocks.contains(&(block as usize));
                assert!(is_planned && rows.windows(2).all(|w| w[0][0] < w[1][0]), "each entry once");
                assert!(rows.iter().all(|row| row[1..].iter().any(|c| *c != 0)), "no row is idle");
                let mut used = width;
                while used > 1 && poses[used - 1] == poses[used - 2] {
                    used -= 1;
                }
                assert!(used.next_power_of_two() == width, "the narrowest width: {used} in {width}");
                for place in used..TILE {
                    assert_eq!((poses[place], rebuilt >> place & 1), (poses[used - 1], rebuilt >> (used - 1) & 1));
                    assert!(place >= width || rows.iter().all(|row| row[1 + place] == row[used]));
                }
                let tile = poses[0][1] / slots / widest;
                assert!(tiles.insert((group.instances.0, tile, block)), "one item for a block of a tile");
                for (place, [source, destination]) in poses[..used].iter().enumerate() {
                    let instance = destination / slots;
                    assert_eq!((source / slots, instance / widest), (instance, tile));
                    assert!(instance < group.instances.1);
                    let from_base = rebuilt >> place & 1 != 0;
                    let elements = rows.iter().filter(|row| row[1 + place] != 0);
                    let elements = elements.map(|row| (row[0], row[1 + place] as i32)).collect();
                    let source = if from_base { 0 } else { source % slots };
                    let work = (from_base, source, destination % slots, elements);
                    assert!(plan.insert((group.instances.0 + instance, block), work).is_none());
                }
            }
        }
    }
    plan
}
