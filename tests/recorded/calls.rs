//! Logged calls, made again on other drivers and on the processor.

use crate::gpu::{self, drivers, on_device};
use deltamorph::calls::{Call, Calls};
use deltamorph::{CpuCrowd, CrowdDesc, DeltaFormat, PoseFormat, UpdateDesc, UpdatePath, testing};
use deltamorph_head::Rng;
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::path::Path;
use std::sync::Arc;

const TARGETS: usize = 6;

/// Makes random calls on three instances, and discards some of the updates. Returns the log, taken in parts, which
/// begins in frame `begin`, and the integers of the poses at the end.
fn make_calls(headless: &Headless, format: DeltaFormat, update: UpdateDesc, begin: usize) -> (String, Vec<Vec<i32>>) {
    let mesh = gpu::packed(headless.engine(), &testing::mesh(200, TARGETS), format);
    let desc = CrowdDesc::new(update).instances(3).frames_in_flight(2);
    let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
    let (mut rng, mut text) = (Rng::new(3, begin as u64), String::new());
    // The third instance is removed at first: part of the state that a log begins with, as is one that is hidden.
    crowd.crowd_mut().remove(2).expect("an instance");
    for frame in 0..60 {
        if frame == begin {
            crowd.crowd_mut().log_calls();
        }
        let weights: Vec<f32> = (0..TARGETS).map(|_| rng.below(5) as f32 / 4.0 - 0.3).collect();
        let (calls, one) = (crowd.crowd_mut(), rng.below(2) as u32);
        match rng.below(8) {
            0 => calls.cut(one).expect("an instance"),
            1 => calls.set_hidden(one, rng.below(2) == 0).expect("an instance"),
            2 => {
                calls.remove(one).expect("an instance");
                assert_eq!(calls.add().expect("a place"), one);
            }
            3 => calls.set_weight(one, 2, weights[2]).expect("a weight"),
            _ => calls.set_weights(one, &weights).expect("weights"),
        }
        let (recorded, update) = crowd.record(&[]).expect("an update");
        match rng.below(4) {
            0 => crowd.discard(update.ticket).expect("it waits"),
            _ => crowd.submit(vec![recorded]).expect("it runs"),
        }
        text += &crowd.crowd_mut().take_calls();
    }
    // What a crowd has before any update is not logged: an instance that was hidden since then has no pose.
    (0..2).for_each(|i| crowd.crowd_mut().set_hidden(i, false).expect("an instance"));
    crowd.step(&[]).expect("an update");
    text += &crowd.crowd_mut().take_calls();
    let poses = (0..2).map(|i| update.pose.integers(&crowd.read_stored(i, 0).expect("a pose"))).collect();
    (text, poses)
}

fn read(folder: &Path, text: &str) -> deltamorph::Result<Calls> {
    let file = folder.join("calls");
    std::fs::write(&file, text).expect("a file");
    Calls::read(&file)
}

#[test]
fn logged_calls_lead_to_the_same_integers_elsewhere() {
    let folder = tempfile::tempdir().expect("a folder");
    for (format, pose) in [(DeltaFormat::Small, PoseFormat::Fixed16), (DeltaFormat::Fast, PoseFormat::Fixed32)] {
        for begin in [0, 30] {
            let (mut text, mut expected) = (String::new(), vec![]);
            let update = UpdateDesc::blocks().pose(pose).weight_max(Some(1.0)).slots(1 + u32::from(begin > 0));
            on_device(&drivers()[0], false, |headless, _| {
                (text, expected) = make_calls(headless, format, update, begin);
            });
            let calls = read(folder.path(), &text).expect("what was logged");
            assert_eq!((calls.update, calls.format, calls.instances), (update, format, 3));
            let discarded = text.lines().filter(|line| line.starts_with("discard")).count();
            let updates = calls.calls.iter().filter(|call| **call == Call::Update).count();
            assert_eq!((discarded > 5, updates), (true, 61 - begin - discarded), "those that ran");
            for driver in drivers() {
                on_device(&driver, false, |headless, engine| {
                    let mesh = gpu::packed(engine, &testing::mesh(200, TARGETS), calls.format);
                    calls.check(mesh.layout()).expect("the same mesh");
                    let desc = CrowdDesc::new(calls.update).instances(calls.instances);
                    let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
                    for call in &calls.calls {
                        match call {
                            Call::Update => drop(crowd.step(&[]).expect("an update")),
                            call => crowd.crowd_mut().repeat(call).expect("a call that was possible"),
                        }
                    }
                    for (i, expected) in (0..).zip(&expected) {
                        assert_eq!(pose.integers(&crowd.read_stored(i, 0).expect("a pose")), *expected, "{driver}");
                    }
                    // On the processor.
                    let update = calls.update.path(UpdatePath::Cpu);
                    let mut crowd = CpuCrowd::new(Arc::new(mesh), update, calls.instances, 1).expect("a crowd");
                    for call in &calls.calls {
                        match call {
                            Call::Update => drop(crowd.update()),
                            call => crowd.repeat(call).expect("a call that was possible"),
                        }
                    }
                    for (i, expected) in (0..).zip(&expected) {
                        assert_eq!(pose.integers(crowd.stored_pose(i, 0).expect("a pose")), *expected, "cpu");
                    }
                });
            }
        }
    }
}

#[test]
fn a_log_that_is_damaged_or_of_another_mesh_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mesh = |targets| {
        let desc = deltamorph::PackDesc::new(DeltaFormat::Fast);
        Arc::new(deltamorph::PackedMesh::pack(&testing::mesh(40, targets), &desc).expect("a mesh"))
    };
    let mut crowd =
        CpuCrowd::new(mesh(3), UpdateDesc::new(UpdatePath::Cpu, Default::default()), 1, 1).expect("a crowd");
    crowd.log_calls();
    crowd.set_weights(0, &[0.1, 0.0, -0.5]).expect("weights");
    crowd.set_weights(0, &[0.1, 0.0, -0.25]).expect("weights");
    crowd.update();
    let text = crowd.take_calls();
    assert_eq!(text.lines().skip(2).collect::<Vec<_>>(), ["weights 0 0=0.1 2=-0.5", "weights 0 2=-0.25", "update"]);
    assert_eq!(crowd.take_calls(), "", "taken");
    let calls = read(folder.path(), &text).expect("a log");
    calls.check(mesh(3).layout()).expect("the same");
    let error = calls.check(mesh(2).layout()).expect_err("another mesh").to_string();
    assert!(error.contains("another mesh") && error.contains("packed file"), "{error}");
    for (from, to, line) in [
        ("calls 1", "calls 2", "line 1"),
        ("slots=2", "slots=two", "line 2"),
        ("path=cpu", "path=gpu", "line 2"),
        ("2=-0.5", "2=", "line 3"),
        ("2=-0.25", "2=-0.25 3", "line 4"),
        ("update", "update 3", "line 5"),
        ("update", "redo", "line 5"),
    ] {
        let error = read(folder.path(), &text.replace(from, to)).expect_err(to).to_string();
        assert!(error.contains(line) && error.contains("take_calls"), "{error}");
    }
    for cut in 0..text.len() {
        // Cut off in the middle of a line it is refused or means less; nothing panics.
        drop(read(folder.path(), &text[..cut]));
    }
    let error = crowd.repeat(&Call::Update).expect_err("the caller updates").to_string();
    assert!(error.contains("update the crowd"), "{error}");
}
