//! The table: a row per update path, with the variants to test and the expected results.

use crate::gpu::bits;
use crate::prelude::*;
use deltamorph::DeltaFormat::{Float32, Small};
use deltamorph::internals::pack::PackedGroup;
use deltamorph::reference::compare_group;

/// Tested batch sizes.
#[derive(Clone, Copy, PartialEq)]
enum Batches {
    /// Those of [`gpu::update_descs`], and fixed-point poses.
    Spread,
    /// As many as there are vertex attributes for.
    Most,
    All,
    /// Not on a device: src/cpu/tests.rs compares it with the reference.
    Host,
}

type Change = fn(&mut DeviceCaps);

pub struct Row {
    pub path: UpdatePath,
    batches: Batches,
    /// Its updates are commands, with barriers that can be left out; otherwise draws evaluate the pose.
    pub records: bool,
    /// A barrier whose absence synchronization validation reports, of an update in a format and a batch size. Layers
    /// see no hazards of transform feedback, and the blocks of an update are one dispatch.
    pub seen: Option<(usize, DeltaFormat, BatchSize)>,
    /// A feature that a device may lack, and words of the refusal there.
    pub missing: Option<(Change, &'static [&'static str])>,
    /// Limits of a device, and words of the refusal of a mesh of 1,024 padded vertices and five targets there.
    pub limits: &'static [(Change, &'static [&'static str])],
    /// It updates tangents, texture coordinates and colours.
    pub streams: bool,
}

const NO_WORKGROUPS: (Change, &[&str]) =
    (|caps| caps.max_workgroup_invocations = 32, &["32 invocations per workgroup", "'cpu'"]);

/// A technique whose updates are compute passes, with poses for every stream.
const fn row(path: UpdatePath, batches: Batches) -> Row {
    Row { path, batches, records: true, seen: None, missing: Some(NO_WORKGROUPS), limits: &[], streams: true }
}

pub static ROWS: [Row; deltamorph_baselines::PATHS.len()] = [
    Row {
        missing: Some((
            |caps| caps.transform_feedback = None,
            &["'feedback'", "VK_EXT_transform_feedback", "'compute'"],
        )),
        limits: &[(
            |caps| caps.transform_feedback.iter_mut().for_each(|caps| caps.max_buffer_bytes = 20_000),
            &["a chunk captures 24576 bytes", "allows 20000", "pack_desc"],
        )],
        ..row(UpdatePath::Feedback, Batches::Spread)
    },
    Row {
        seen: Some((1, Float32, BatchSize::Targets(4))),
        limits: &[
            (|caps| caps.max_storage_range = 10_000, &["a pose takes 24576 bytes", "allows 10000"]),
            (|caps| caps.max_storage_range = 50_000, &["a chunk of deltas takes 122880 bytes", "pack_desc"]),
            (|caps| caps.max_workgroups = 15, &["a chunk takes 16 workgroups", "allows 15", "pack_desc"]),
            (
                |caps| caps.max_allocation = 100_000,
                &["deltamorph deltas of mesh 'test_1000x5' needs 122880 bytes", "100000"],
            ),
        ],
        ..row(UpdatePath::Compute, Batches::Spread)
    },
    Row {
        limits: &[(
            |caps| caps.max_storage_range = 30_000,
            &["its deltas and base pose take", "allows 30000", "'small'"],
        )],
        ..row(UpdatePath::Blocks, Batches::Spread)
    },
    Row { records: false, missing: Some((|_| {}, &["use CpuCrowd"])), ..row(UpdatePath::Cpu, Batches::Host) },
    Row {
        seen: Some((1, Float32, BatchSize::Targets(4))),
        missing: Some((|caps| caps.vertex_stores = false, &["needs the feature vertexPipelineStoresAndAtomics"])),
        ..row(deltamorph_baselines::VERTEX_STORE, Batches::Spread)
    },
    Row {
        // Layers of 1.3.239 do not report it between atomics and the reads of the next dispatch.
        seen: Some((1, Small, BatchSize::All)),
        limits: &[(|caps| caps.max_storage_range = 30_000, &["the records of 'scatter' take", "allows 30000"])],
        streams: false,
        ..row(deltamorph_baselines::SCATTER, Batches::All)
    },
    Row { records: false, missing: None, streams: false, ..row(deltamorph_baselines::DIRECT, Batches::All) },
    Row {
        records: false,
        missing: None,
        streams: false,
        ..row(deltamorph_baselines::DIRECT_ATTRIBUTES, Batches::Most)
    },
    Row {
        missing: Some((|caps| caps.float_blending = false, &["needs blending of R32G32B32A32"])),
        ..row(deltamorph_baselines::TEXTURE, Batches::All)
    },
];

impl Row {
    pub fn of(path: UpdatePath) -> &'static Self {
        ROWS.iter().find(|row| row.path == path).expect("a row for each path")
    }

    /// Returns the updates that a device supports for meshes in `format`.
    pub fn updates(&self, engine: &MorphEngine, format: DeltaFormat) -> Vec<UpdateDesc> {
        let (path, caps) = (self.path, engine.caps());
        if !path.formats().contains(&format) || caps.check_path(path).is_err() {
            return vec![];
        }
        match self.batches {
            Batches::Spread => {
                let descs = gpu::update_descs(engine, format).into_iter().filter(|desc| desc.path == path);
                let descs: Vec<UpdateDesc> = descs.collect();
                assert!(!descs.is_empty(), "update_descs has no row for {path:?} with {format:?}");
                descs
            }
            Batches::Most | Batches::All => vec![UpdateDesc::new(path, self.batch(engine, format))],
            Batches::Host => vec![],
        }
    }

    /// Returns one of the batch sizes.
    pub fn batch(&self, engine: &MorphEngine, format: DeltaFormat) -> BatchSize {
        match self.batches {
            Batches::Most => BatchSize::Targets(engine.caps().batch_max(self.path, format).expect("a limit")),
            _ if self.path.takes_all_targets() => BatchSize::All,
            _ => BatchSize::Targets(1),
        }
    }
}

/// Returns the updates of every technique that a device supports for meshes in `format`.
pub fn updates(engine: &MorphEngine, format: DeltaFormat) -> Vec<UpdateDesc> {
    ROWS.iter().flat_map(|row| row.updates(engine, format)).collect()
}

/// Runs `test` on every device with `mesh` in each format, and every update of it.
pub fn for_every_update(formats: &[DeltaFormat], mesh: &KeptMesh, test: impl Fn(&Headless, &PackedMesh, UpdateDesc)) {
    gpu::on_every_device(|headless, engine| {
        for &format in formats {
            let mesh = gpu::packed(engine, mesh, format);
            updates(engine, format).into_iter().for_each(|desc| test(headless, &mesh, desc));
        }
    });
}

/// Returns every mode of the technique, with one to three slots.
pub fn variants(desc: UpdateDesc) -> impl Iterator<Item = UpdateDesc> {
    let modes = [UpdateMode::Incremental, UpdateMode::Rebuild].into_iter();
    let all = modes.flat_map(move |mode| (1..4).map(move |slots| UpdateDesc { mode, slots, ..desc }));
    all.filter(|desc| desc.check().is_ok())
}

/// Returns whether the device can read poses that draws of a direct path evaluate.
pub fn can_read(headless: &Headless, desc: &UpdateDesc) -> bool {
    let caps = headless.caps();
    !desc.path.evaluates_in_draws() || caps.transform_feedback.is_some() || caps.vertex_stores
}

/// Returns the weights of a face that rests, moves, moves slightly, stays, moves all over, exaggerates, and rests
/// again; with at most as many active as the path takes.
pub fn history(mesh: &PackedMesh, desc: &UpdateDesc, seed: u32) -> Vec<Vec<f32>> {
    let targets = mesh.layout().targets.len();
    let (a, b) = (gpu::weights(mesh, 1, seed), gpu::weights(mesh, 9, seed + 1));
    let mut nudged = a.clone();
    nudged.iter_mut().rev().take(1).for_each(|w| *w = 0.375);
    let mut one = vec![0.0; targets];
    one.iter_mut().rev().take(1).for_each(|w| *w = -0.75);
    let exaggerated = b.iter().map(|w| w * 1.9 - 0.3).collect();
    let mut frames = vec![vec![0.0; targets], a, nudged.clone(), nudged, b, exaggerated, one, vec![0.0; targets]];
    frames.iter_mut().for_each(|weights| keep_supported(weights, desc));
    frames
}

/// Clears the weights beyond those that the path takes at a time.
pub fn keep_supported(weights: &mut [f32], desc: &UpdateDesc) {
    if let (deltamorph_baselines::DIRECT_ATTRIBUTES, BatchSize::Targets(most)) = (desc.path, desc.batch) {
        weights.iter_mut().filter(|w| **w != 0.0).skip(most as usize).for_each(|w| *w = 0.0);
    }
}

/// Asserts that a pose of a group is within the project's error limits.
pub fn assert_pose(group: &PackedGroup, desc: &UpdateDesc, pose: &[f32], weights: &[f32], what: &str) {
    let (layout, reference) = (group.layout(), gpu::reference_group(group, desc, weights));
    let error = compare_group(&layout.streams, pose, &reference);
    let length = gpu::POSITION * f64::from(layout.diagonal.max(1.0)) + f64::from(desc.error_budget);
    // The budget is one of positions; normals are deferred with them.
    let degrees =
        if desc.error_budget > 0.0 && layout.streams[0].semantic == Semantic::Position { 180.0 } else { NORMAL };
    assert!(error.within(length, degrees) && error.absolute <= 1e-5, "{what}: {error:?}");
    for stream in layout.streams.iter().filter(|stream| stream.semantic == Semantic::Tangent) {
        let (w, base) = (stream.components().end - 1, layout.to_user_order(group.base()));
        for (pose, base) in pose.chunks_exact(6).zip(base.chunks_exact(6)) {
            assert_eq!(pose[w].to_bits(), base[w].to_bits(), "{what}: handedness");
        }
    }
}

/// Plays frames of histories: poses are those of the reference, and previous poses the poses before. The second
/// instance is hidden for a while, and shown with the weights requested meanwhile; an update is lost.
pub fn check(headless: &Headless, mesh: &PackedMesh, desc: UpdateDesc, heads: usize, frames: usize) {
    let crowd_desc = CrowdDesc { instances: heads as u32, ..CrowdDesc::new(desc) };
    let mut crowd = HeadlessCrowd::new(headless, mesh, &crowd_desc).expect("a crowd");
    let name = &headless.caps().name;
    let histories: Vec<_> = (0..heads as u32).map(|head| history(mesh, &desc, 5 + head)).collect();
    let (mut shown, mut before) = (vec![vec![]; heads], vec![None; heads]);
    for frame in 0..frames {
        let hidden = |frame: usize| (2..4).contains(&frame);
        if heads > 1 {
            crowd.set_hidden(1, hidden(frame)).expect("an instance");
        }
        let asked: Vec<&[f32]> = histories.iter().map(|history| &history[frame][..]).collect();
        if frame == 5 {
            let (_, lost) = crowd.record(&vec![&histories[0][1][..]; heads]).expect("a recording");
            crowd.discard(lost.ticket).expect("a ticket of this crowd");
        }
        crowd.step(&asked).expect("a step");
        crowd.draw(Draws { copies: 1, passes: 2 }).expect("a draw");
        if !can_read(headless, &desc) {
            testing::says(crowd.read_pose(0), &["vertexPipelineStoresAndAtomics", "transform_feedback"]);
        }
        for (head, asked) in asked.iter().enumerate().filter(|(head, _)| *head != 1 || !hidden(frame)) {
            shown[head] = asked.to_vec();
        }
        for head in (0..heads).filter(|_| can_read(headless, &desc)) {
            let mut poses = vec![];
            for (number, group) in mesh.groups().iter().enumerate() {
                let what =
                    format!("{name} {desc:?} {:?} frame {frame} head {head} group {number}", group.layout().format);
                let (pose, previous) = crowd.read_group(head as u32, number).expect("a pose");
                assert_pose(group, &desc, &pose, &shown[head], &what);
                let has_past = !(frame == 0 || frame == 5 || head == 1 && (2..5).contains(&frame));
                match (previous, &before[head]) {
                    (Some(previous), Some(before)) if has_past => {
                        let before: &Vec<Vec<f32>> = before;
                        assert_eq!(bits(&previous), bits(&before[number]), "{what}: the previous pose");
                    }
                    (Some(_), _) => {}
                    (None, _) => {
                        let is_lost = desc.slots == 1 || desc.slots == 2 && !desc.path.works_in_place();
                        assert!(desc.path.evaluates_in_draws() || is_lost, "{what}");
                    }
                }
                poses.push(pose);
            }
            before[head] = Some(poses);
        }
    }
    if desc.pose.has_integers() && desc.error_budget == 0.0 {
        // After any history: bit for bit a full evaluation.
        let mut fresh = crowd.another(&crowd_desc).expect("a crowd");
        let asked: Vec<&[f32]> = shown.iter().map(Vec::as_slice).collect();
        fresh.step(&asked).expect("a step");
        for (head, before) in before.iter().enumerate() {
            for (number, pose) in before.iter().flatten().enumerate() {
                let (full, _) = fresh.read_group(head as u32, number).expect("a pose");
                assert_eq!(bits(&full), bits(pose), "{name} {desc:?} head {head} group {number}");
            }
        }
    }
}
