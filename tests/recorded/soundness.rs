//! Safe code without undefined behaviour: threads, tickets, recorded updates, failing steps, and memory limits.

use crate::gpu::{self, drivers, on_every_device, single, update_descs, weights};
use crate::testing;
use deltamorph::mesh::SourceTarget;
use deltamorph::reference::{evaluate, evaluate_unpacked};
use deltamorph::{
    BlockDesc, CpuCrowd, Crowd, DeltaFormat, ErrorKind, GpuMesh, MorphEngine, MorphSource, PackDesc, PackedMesh,
    PoseFormat, Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::slice::from_mut;
use std::sync::Arc;

#[test]
fn what_may_be_shared_between_threads_and_what_may_not() {
    fn shared<T: Send + Sync>() {}
    fn sent<T: Send>() {}
    shared::<MorphEngine>();
    shared::<GpuMesh>();
    sent::<Crowd>();
    sent::<Headless>();

    /// Ambiguous, and so a compile error, for a type that is `Sync`.
    trait NotSync<Which> {
        fn check() {}
    }
    impl<T: ?Sized> NotSync<()> for T {}
    impl<T: ?Sized + Sync> NotSync<u8> for T {}
    <Headless as NotSync<_>>::check();
    <HeadlessCrowd<'static> as NotSync<_>>::check();
}

/// Two devices of the same driver, with a crowd on each.
#[test]
fn a_step_that_fails_half_way_leaves_every_crowd_as_it_was() {
    for driver in drivers() {
        let devices = [(); 2].map(|()| gpu::device(&driver, false, None));
        let mesh = gpu::packed(devices[0].engine(), &testing::mesh(300, 8), DeltaFormat::Fast);
        let mut both = devices.each_ref().map(|headless| gpu::crowd(headless, &mesh, UpdateDesc::blocks()));
        let asked = [0.7; 8];
        both[0].step(&[&[0.0; 8]]).expect("a step");
        let error = HeadlessCrowd::step_together(&mut both, &[&asked, &asked], 0).expect_err("two devices");
        assert!(error.to_string().contains("several devices"), "{error}");
        both[0].step(&[&asked]).expect("a step");
        gpu::assert_right(&mut both[0], 0, &mesh, &asked);
    }
}

#[test]
fn a_panic_between_planning_and_recording_takes_the_update_back() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(300, 8), DeltaFormat::Fast);
        let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::blocks());
        crowd.step(&[&[0.0; 8]]).expect("a step");
        let asked = [0.7; 8];
        // SAFETY: the commands are not changed; the caller catches the panic.
        let failed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| unsafe {
            HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&asked], |_| panic!("between planning and recording"))
        }));
        assert!(failed.is_err());
        assert!(crowd.crowd().pose(0).is_err(), "what was planned is not taken as done");
        crowd.step(&[&asked]).expect("a step");
        gpu::assert_right(&mut crowd, 0, &mesh, &asked);
    });
}

#[test]
fn what_an_engine_made_outlives_its_headless() {
    for driver in drivers() {
        let headless = gpu::device(&driver, true, None);
        let mesh = gpu::packed(headless.engine(), &testing::mesh(64, 4), DeltaFormat::Fast);
        let crowd = {
            let owner = gpu::crowd(&headless, &mesh, UpdateDesc::blocks());
            headless.engine().create_crowd(owner.mesh(), &single(UpdateDesc::blocks())).expect("a crowd")
        };
        drop(headless);
        assert_eq!(crowd.desc().instances, 1);
        drop(crowd);
    }
}

/// A mesh of 64 vertices and a crowd of it, with the engine's own allocator.
#[test]
fn a_small_mesh_takes_little_memory() {
    on_every_device(|headless, engine| {
        let before = engine.allocated_bytes();
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let mesh = gpu::packed(engine, &testing::mesh(64, 20), format);
            for update in update_descs(engine, format) {
                let mut crowd = gpu::crowd(headless, &mesh, update);
                crowd.step(&[&weights(&mesh, 0, 9)]).expect("a step");
                let taken = engine.allocated_bytes() - before;
                assert!(taken > 0 && taken <= 1 << 20, "{} {update:?}: {taken} bytes", headless.caps().name);
                drop(crowd);
                assert_eq!(engine.allocated_bytes(), before, "{update:?}: all of it is given back");
            }
        }
    });
}

#[test]
fn many_buffers_share_blocks() {
    on_every_device(|headless, engine| {
        let before = engine.allocated_bytes();
        let mesh = gpu::packed(engine, &testing::mesh(64, 4), DeltaFormat::Fast);
        let first = HeadlessCrowd::new(headless, &mesh, &single(UpdateDesc::blocks())).expect("a crowd");
        let more: Vec<_> = (0..60).map(|_| first.another(&single(UpdateDesc::blocks())).expect("a crowd")).collect();
        let taken = engine.allocated_bytes() - before;
        assert!(taken > 4 << 20 && taken < 16 << 20, "{}: {taken} bytes", headless.caps().name);
        drop((first, more));
        let kept = engine.allocated_bytes() - before;
        assert!(kept <= 16 << 20, "one block of each type of memory: {kept} bytes");
    });
}

/// Every target moves vertex 0 of a box of diagonal 1 along x: changes of very different sizes are deferred in one
/// block.
#[test]
fn an_error_budget_holds_after_a_large_change() {
    let n = 57;
    let mut state = 12_345u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut source = MorphSource { name: "box".into(), ..Default::default() };
    let side = |i: usize| i as f32 / 3.0 * 0.577_35;
    source.positions = (0..64).map(|i| [side(i % 4), side(i / 4 % 4), side(i / 16)].into()).collect();
    source.normals = Some(vec![[0.0, 0.0, 1.0].into(); 64]);
    source.targets = (0..n)
        .map(|t| {
            let d = if t % 2 == 0 { 0.03 + 0.04 * random() } else { 0.0006 + 0.0008 * random() };
            let positions = vec![(0, [d as f32, 0.0, 0.0].into())];
            SourceTarget { name: format!("t{t}"), positions, normals: Some(vec![]), ..Default::default() }
        })
        .collect();
    let mesh = source.to_mesh(Tolerance::ZERO).expect("a mesh");
    let (most, budget) = (4.0, 2e-5);
    let blocks = BlockDesc::default().position_error(1e-6).weight_max(most);
    let pack = PackDesc::new(DeltaFormat::Fast).blocks(blocks);
    let mesh = Arc::new(PackedMesh::pack(&mesh, &pack).expect("a mesh that fits"));
    let desc = UpdateDesc::blocks().path(UpdatePath::Cpu).pose(PoseFormat::Fixed32).error_budget(budget);
    let grid = desc.grid(mesh.layout()).expect("a grid").expect("integers");
    let mut worst = 0.0f64;
    for _ in 0..6_000 {
        let mut crowd = CpuCrowd::new(mesh.clone(), desc, 1, 1).expect("a crowd");
        crowd.set_weights(0, &vec![0.0; n]).expect("weights");
        crowd.update();
        let asked: Vec<f32> =
            (0..n)
                .map(|t| {
                    if t % 2 == 0 {
                        random() as f32 * most
                    } else {
                        (random() * 6.0).floor() as f32 * grid.weight_step()
                    }
                })
                .collect();
        crowd.set_weights(0, &asked).expect("weights");
        crowd.update();
        let asked: Vec<f32> = asked.iter().map(|w| grid.round(*w)).collect();
        let pose = mesh.layout().to_user_order(&crowd.pose(0).expect("an instance"));
        worst = worst.max((f64::from(pose[0]) - evaluate(&mesh, &asked)[0]).abs());
    }
    // Decoding a pose to float32 has its own error bound.
    assert!(worst <= f64::from(budget) * 1.007, "{worst:e} of {budget:e}");
}

#[test]
fn running_out_of_memory_is_an_error_of_its_own() {
    let mesh = PackedMesh::pack(&testing::mesh(1000, 4), &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
    // More than the address space.
    let desc = UpdateDesc::blocks().path(UpdatePath::Cpu).slots(64);
    let error = CpuCrowd::new(Arc::new(mesh), desc, u32::MAX, 1).err().expect("no memory");
    assert_eq!(error.kind(), ErrorKind::OutOfMemory, "{error}");
}

#[test]
fn what_does_not_fit_is_refused_or_comes_out_as_nan() {
    let mesh = testing::mesh(100, 4);
    let refused = |change: &dyn Fn(&mut deltamorph::MorphMesh), words: &str| {
        let mut bad = mesh.clone();
        change(&mut bad);
        testing::says(PackedMesh::pack(&bad, &PackDesc::new(DeltaFormat::Fast)), &[words]);
        assert!(evaluate_unpacked(&bad, &[1.0; 4]).iter().all(|number| number.is_nan()), "{words}");
    };
    refused(&|mesh| mesh.normals.truncate(99), "99 normals for 100 vertices");
    refused(&|mesh| mesh.targets[1].positions.truncate(1), "do not fit");
    refused(&|mesh| mesh.targets[1].normals.truncate(1), "do not fit");
    refused(&|mesh| mesh.targets[1].vertices[0] = 100, "do not fit");
    for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh");
        let kept = packed.layout().to_user_order(&packed.base()[..6 * 10]);
        assert_eq!(kept.iter().filter(|number| number.is_nan()).count(), 6 * 90, "{format:?}");
        packed.for_each_delta(4, |_, _| panic!("there is no such target"));
        assert!(packed.measure_error(&mesh).within(1.0, 180.0));
        for other in [testing::mesh(99, 4), testing::mesh(100, 3)] {
            assert!(!packed.measure_error(&other).within(f64::INFINITY, f64::INFINITY));
        }
    }
    let headless = gpu::device(&drivers()[0], false, None);
    let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
    let mut crowd = gpu::crowd(&headless, &packed, UpdateDesc::blocks());
    crowd.step(&[&[0.5; 4]]).expect("a step");
    let text = crowd.read_group(0, 1).expect_err("refused").to_string();
    assert!(text.contains("which has 1; count groups from 0") && crowd.read_stored(0, 1).is_err(), "{text}");
}

/// A command buffer recorded while another is being recorded is a different one.
#[test]
fn runs_may_be_nested() {
    on_every_device(|headless, _| {
        let mut ran = vec![];
        let nested = headless.run(|outer| {
            headless.run(|inner| {
                ran.push(inner != outer);
                Ok(())
            })
        });
        nested.expect("both run");
        headless.run(|_| Ok(())).expect("and another");
        assert_eq!(ran, [true]);
    });
}
