//! Fixed-point poses do not depend on their history: a pose has the bits of a full evaluation of its weights, on every
//! driver and on the CPU, and the previous pose those of the pose before.

use crate::prelude::*;
use crate::scene::full_evaluations;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

const TARGETS: usize = 9;
const HEADS: usize = 9;

/// Packs a head of which every target moves a part, with blocks that nothing moves; with or without further streams.
/// `size` is the number of vertices of blocks, or of chunks of a dense format.
fn packed(format: DeltaFormat, size: u32, streams: bool) -> Arc<PackedMesh> {
    let source = head(&HeadDesc { vertices: 700, targets: TARGETS, sparsity: 0.15, seed: 5 });
    let plain = source.kept(Tolerance::default()).expect("a mesh");
    let mesh = if streams { testing::with_streams(plain) } else { plain };
    let blocks = BlockDesc { size: Some(size), ..Default::default() };
    let chunk = u64::from(size) * TARGETS as u64 * format.stride() as u64;
    let desc = PackDesc { blocks, max_chunk_bytes: chunk, ..PackDesc::new(format) };
    Arc::new(PackedMesh::pack(&mesh, &desc).expect("a mesh that packs"))
}

/// An event of an instance between two updates.
#[derive(Clone, Debug)]
enum Event {
    Weights(Vec<(usize, f32)>),
    Cut,
    HideOrShow,
}

/// The updates of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Frame {
    Once,
    /// After an update that was recorded and never runs.
    AfterALostOne,
    /// By two updates that run together, the second without changes of every other instance.
    Twice,
}

type Frames = Vec<(Frame, Vec<(usize, Event)>)>;

fn frames() -> impl Strategy<Value = Frames> {
    // On the grid and off it, none, and the largest, as fractions of the largest weight.
    let weight =
        prop_oneof![Just(0.0f32), Just(1.0), Just(-1.0), -1.0f32..=1.0, (-8i8..=8).prop_map(|w| f32::from(w) / 8.0)];
    let weights = prop::collection::vec((0..TARGETS, weight), 1..5).prop_map(Event::Weights);
    let event = prop_oneof![6 => weights, 1 => Just(Event::Cut), 1 => Just(Event::HideOrShow)];
    let frame = prop_oneof![4 => Just(Frame::Once), 1 => Just(Frame::AfterALostOne), 1 => Just(Frame::Twice)];
    prop::collection::vec((frame, prop::collection::vec((0..HEADS, event), 0..12)), 1..8)
}

/// A pose of each group, stored and decoded.
type Poses = Vec<(Vec<u8>, Vec<f32>)>;

/// The expected state of an instance.
#[derive(Clone)]
struct Head {
    asked: Vec<f32>,
    pose: Option<Poses>,
    before: Option<Poses>,
    hidden: bool,
    /// The next pose has no predecessor.
    cut: bool,
}

/// Full evaluations, and instances compared with them.
struct Expected {
    mesh: Arc<PackedMesh>,
    fresh: CpuCrowd,
    most: f32,
    heads: Vec<Head>,
}

fn poses(mesh: &PackedMesh, crowd: &CpuCrowd, instance: u32) -> Poses {
    let group = |group| {
        let decoded = mesh.layout().to_user_order(&crowd.group_pose(instance, group).expect("a pose"));
        (crowd.stored_pose(instance, group).expect("a pose").to_vec(), decoded)
    };
    (0..mesh.groups().len()).map(group).collect()
}

impl Expected {
    fn new(mesh: &Arc<PackedMesh>, desc: UpdateDesc, heads: usize) -> Self {
        let most = desc.grid(mesh.layout()).expect("a grid").expect("integers").weight_max;
        let head = Head { asked: vec![0.0; TARGETS], pose: None, before: None, hidden: false, cut: false };
        Self { mesh: mesh.clone(), fresh: full_evaluations(mesh, desc), most, heads: vec![head; heads] }
    }

    fn evaluate(&mut self, weights: &[f32]) -> Poses {
        self.fresh.set_weights(0, weights).expect("weights");
        self.fresh.update();
        poses(&self.mesh, &self.fresh, 0)
    }

    fn update(&mut self) {
        for i in (0..self.heads.len()).filter(|&i| !self.heads[i].hidden).collect::<Vec<_>>() {
            let pose = self.evaluate(&self.heads[i].asked.clone());
            let head = &mut self.heads[i];
            let cut = std::mem::take(&mut head.cut);
            head.before = head.pose.replace(pose).filter(|_| !cut).or_else(|| head.pose.clone());
        }
    }

    /// Drops the poses of an update that never runs.
    fn lose(&mut self) {
        self.heads.iter_mut().filter(|head| !head.hidden).for_each(|head| head.pose = None);
    }

    fn assert_head(&self, i: usize, slots: u32, pose: &Poses, previous: &[Option<Vec<f32>>], what: &str) {
        let Head { pose: Some(expected), before: Some(before), hidden, .. } = &self.heads[i] else { return };
        for (group, ((stored, decoded), (expected, expected_decoded))) in pose.iter().zip(expected).enumerate() {
            assert!(stored == expected, "{what}, head {i}, group {group}: the pose");
            assert!(decoded == expected_decoded, "{what}, head {i}, group {group}: the pose, decoded");
            match &previous[group] {
                Some(previous) => {
                    assert!(*hidden || *previous == before[group].1, "{what}, head {i}, group {group}: before")
                }
                None => assert_eq!(slots, 1, "{what}"),
            }
        }
    }
}

/// Reads the pose and the previous pose of an instance on a device.
fn read(mesh: &PackedMesh, device: &mut HeadlessCrowd<'_>, i: usize) -> (Poses, Vec<Option<Vec<f32>>>) {
    let group = |group| {
        let (pose, previous) = device.read_group(i as u32, group).expect("a pose");
        ((device.read_stored(i as u32, group).expect("a pose"), pose), previous)
    };
    (0..mesh.groups().len()).map(group).unzip()
}

fn previous(mesh: &PackedMesh, crowd: &CpuCrowd, i: u32) -> Vec<Option<Vec<f32>>> {
    let group = |group| {
        let previous = crowd.previous_group_pose(i, group).expect("an instance");
        previous.map(|pose| mesh.layout().to_user_order(&pose))
    };
    (0..mesh.groups().len()).map(group).collect()
}

/// Plays `frames` on a device and on the CPU.
fn play(headless: &Headless, mesh: &Arc<PackedMesh>, desc: UpdateDesc, heads: usize, frames: &Frames) {
    let instances = CrowdDesc { instances: heads as u32, ..CrowdDesc::new(desc) };
    let mut device = HeadlessCrowd::new(headless, mesh, &instances).expect("a crowd");
    let mut cpu = gpu::cpu_crowd(mesh, desc, heads as u32);
    let mut expected = Expected::new(mesh, desc, heads);
    for (number, (frame, events)) in frames.iter().enumerate() {
        let what =
            format!("{} {:?} {desc:?}, {heads} heads, frame {number}", headless.caps().name, mesh.layout().format);
        for (i, event) in events.iter().map(|(i, event)| (i % heads, event)) {
            let head = &mut expected.heads[i];
            match event {
                Event::Weights(weights) => weights.iter().for_each(|(t, w)| head.asked[*t] = w * expected.most),
                Event::Cut => {
                    head.cut = true;
                    device.reset_history(i as u32).expect("a head");
                    cpu.reset_history(i as u32).expect("a head");
                }
                Event::HideOrShow => {
                    head.hidden = !head.hidden;
                    head.cut = true;
                    device.set_hidden(i as u32, head.hidden).expect("a head");
                    cpu.set_hidden(i as u32, head.hidden).expect("a head");
                }
            }
        }
        if *frame == Frame::AfterALostOne {
            for i in 0..heads {
                let lost: Vec<f32> = (1..=TARGETS).map(|t| expected.most * t as f32 / (i + 10) as f32 - 0.1).collect();
                device.set_weights(i as u32, &lost).expect("weights");
            }
            let (_, lost) = device.record(&[]).expect("a recording");
            device.discard(lost.ticket).expect("a ticket of this crowd");
            expected.lose();
        }
        let ask = |expected: &Expected, device: &mut HeadlessCrowd<'_>, cpu: &mut CpuCrowd| {
            for (i, head) in (0..).zip(&expected.heads) {
                device.set_weights(i, &head.asked).expect("weights");
                cpu.set_weights(i, &head.asked).expect("weights");
            }
        };
        ask(&expected, &mut device, &mut cpu);
        if *frame == Frame::Twice {
            let first = device.record(&[]).expect("a recording").0;
            cpu.update();
            expected.update();
            expected.heads.iter_mut().step_by(2).for_each(|head| head.asked.rotate_left(1));
            ask(&expected, &mut device, &mut cpu);
            let second = device.record(&[]).expect("a recording").0;
            device.submit(vec![first, second]).expect("a submission");
        } else {
            device.step(&[]).expect("a step");
        }
        cpu.update();
        expected.update();
        for i in (0..heads).filter(|&i| expected.heads[i].pose.is_some()) {
            let (pose, before) = read(mesh, &mut device, i);
            expected.assert_head(i, desc.slots, &pose, &before, &what);
            // Updates lost on the device ran here, so the previous pose differs.
            if *frame != Frame::AfterALostOne {
                let before = previous(mesh, &cpu, i as u32);
                expected.assert_head(i, desc.slots, &poses(mesh, &cpu, i as u32), &before, &format!("cpu of {what}"));
            }
        }
    }
    // The full evaluations match the definition.
    for head in expected.heads.iter().filter(|head| !head.hidden) {
        for (group, (stored, _)) in mesh.groups().iter().zip(head.pose.iter().flatten()) {
            gpu::assert_integers(group, &desc, stored, &head.asked);
        }
    }
}

const MESHES: [(DeltaFormat, u32, bool); 4] = [
    (DeltaFormat::Fast, 64, true),
    (DeltaFormat::Small, 32, false),
    (DeltaFormat::Fast, 128, false),
    (DeltaFormat::Small, 64, true),
];

/// What is checked of frames played by a number of heads.
type Check = fn(&Headless, &Arc<PackedMesh>, UpdateDesc, usize, &Frames);

/// On every device, with each mesh and pose format. Both checks in one test: most of its time the driver compiles their
/// kernels.
#[test]
fn any_history_leaves_the_bits_of_a_full_evaluation() {
    let meshes = MESHES.map(|(format, size, streams)| (packed(format, size, streams), size));
    gpu::on_every_driver(|headless, _| {
        let all = gpu::runs_all(headless);
        for ((mesh, size), desc) in meshes.iter().flat_map(|mesh| gpu::fixed().map(|desc| (mesh, desc))) {
            // Each tile width is a pipeline: elsewhere all widths with one block size only.
            let most = if all || *size == 64 { HEADS } else { 1 };
            // All batch sizes of blocks.
            let batch = prop_oneof![Just(BatchSize::All), (1..=TARGETS as u32).prop_map(BatchSize::Targets)];
            let strategy = (1u32..=4, batch, 1..=most, any::<bool>(), frames());
            let checks: [(u32, Check); 2] = [(5, play), (3, play_with_a_budget)];
            for (cases, check) in checks {
                let config = Config { cases, failure_persistence: None, ..Config::default() };
                let run = TestRunner::new(config).run(&strategy, |(slots, batch, heads, default, frames)| {
                    // 1 for 16 bits, 4 for 32; or 4.
                    let weight_max = desc.weight_max.filter(|_| !default);
                    let desc = UpdateDesc { slots, batch, weight_max, ..desc };
                    check(headless, mesh, desc, heads, &frames);
                    Ok(())
                });
                run.unwrap_or_else(|e| panic!("{}: {e}", headless.caps().name));
            }
        }
    });
}

/// With an error budget, which blocks have: the same bits on devices and the CPU, no vertex beyond the budget, and,
/// once the same weights are requested again, the bits of a full evaluation.
fn play_with_a_budget(headless: &Headless, mesh: &Arc<PackedMesh>, desc: UpdateDesc, heads: usize, frames: &Frames) {
    let budget = 0.02 * mesh.layout().diagonal;
    let desc = UpdateDesc { error_budget: budget, ..desc };
    let grid = desc.grid(mesh.layout()).expect("a grid").expect("integers");
    let allowed = f64::from(budget + grid.position_error(TARGETS) + 1e-6 * mesh.layout().diagonal);
    let instances = CrowdDesc { instances: heads as u32, ..CrowdDesc::new(desc) };
    let mut device = HeadlessCrowd::new(headless, mesh, &instances).expect("a crowd");
    let mut cpu = gpu::cpu_crowd(mesh, desc, heads as u32);
    let mut expected = Expected::new(mesh, desc, heads);
    let step = |device: &mut HeadlessCrowd<'_>, cpu: &mut CpuCrowd| {
        device.step(&[]).expect("a step");
        cpu.update();
    };
    for (_, events) in frames {
        for (i, event) in events {
            if let Event::Weights(weights) = event {
                let i = i % heads;
                let asked = &mut expected.heads[i].asked;
                // Small changes, too.
                weights.iter().for_each(|(t, w)| asked[*t] = asked[*t] * 0.95 + 0.05 * w * expected.most);
                device.set_weights(i as u32, asked).expect("weights");
                cpu.set_weights(i as u32, asked).expect("weights");
            }
        }
        step(&mut device, &mut cpu);
        for i in 0..heads {
            let pose = read(mesh, &mut device, i).0;
            assert!(pose == poses(mesh, &cpu, i as u32), "{} {desc:?}: head {i}", headless.caps().name);
            let asked: Vec<f32> = expected.heads[i].asked.iter().map(|w| grid.round(*w)).collect();
            let error = compare(&pose[0].1, &evaluate(mesh, &asked));
            assert!(error.position <= allowed, "{desc:?}: {error:?} of {allowed:e}");
        }
    }
    // Settled, and then idle.
    step(&mut device, &mut cpu);
    step(&mut device, &mut cpu);
    for i in 0..heads {
        let (pose, before) = read(mesh, &mut device, i);
        assert!(pose == expected.evaluate(&expected.heads[i].asked.clone()), "{desc:?}: head {i} has not settled");
        assert!(before.iter().zip(&pose).all(|(before, pose)| before.as_ref() == Some(&pose.1)), "{desc:?}: still");
    }
}
