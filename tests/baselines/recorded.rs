//! The techniques of others: what they record, what they discard, and what they refuse.

use crate::baselines::{can_read, for_every_desc, history};
use crate::gpu::{self, NORMAL, POSITION, hazards, on_every_device, packed, single};
use deltamorph::internals::plan::Source;
use deltamorph::internals::plan::hazards::Event;
use deltamorph::internals::plan::schedule::Entry;
use deltamorph::reference::{compare, evaluate};
use deltamorph::{BatchSize, DeltaFormat, PackedMesh, PoseFormat, UpdateDesc, UpdateMode, UpdatePath, testing};
use deltamorph_headless::HeadlessCrowd;
use std::slice::from_mut;

/// Synchronization validation sees the same fault in the real command buffer; but not, in 1.3.239, between atomics and
/// the reads of the next dispatch.
#[test]
fn validation_sees_a_dropped_barrier() {
    for (path, batch, format, dropped) in [
        (UpdatePath::Scatter, BatchSize::All, DeltaFormat::Small, 1),
        (UpdatePath::VertexStore, BatchSize::Targets(4), DeltaFormat::Float32, 1),
    ] {
        gpu::assert_validation_sees_dropped(dropped, UpdateDesc::new(path, batch), format);
    }
}

#[test]
fn what_is_recorded_has_no_hazard_and_a_dropped_barrier_has_one() {
    on_every_device(|headless, engine| {
        for_every_desc(engine, &testing::mesh(500, 20), |mesh, desc| {
            let records = !desc.path.evaluates_in_draws() || desc.path == UpdatePath::Texture;
            if !records || mesh.layout().format == DeltaFormat::Snorm16 {
                return;
            }
            let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
            let mut lists = vec![];
            for frame in 0..5 {
                let weights = gpu::weights(mesh, frame, 1);
                // SAFETY: nothing is changed.
                let (_, events) =
                    unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], |_| {}) }.expect("a step");
                // Displacement textures have no slots.
                lists.push((events, crowd.crowd().pose(0).map_or(0, |pose| pose.slot)));
            }
            assert_eq!(hazards(&lists), Ok(()), "{desc:?}");
            for at in 0..lists[3].0.len() {
                // The first barrier of a pass is covered by those of the frame before where the slot is one that
                // no draw reads any more; src/plan/tests.rs has it with both slots drawn. Sums are always in use.
                let covered = at == 0 && desc.path == UpdatePath::VertexStore;
                if covered || !matches!(lists[3].0[at], Event::Barrier(_)) {
                    continue;
                }
                let mut faulty = lists.clone();
                let dropped = faulty[3].0.remove(at);
                assert!(hazards(&faulty).is_err(), "{desc:?}: dropped {dropped:?}");
            }
        });
    });
}

#[test]
fn a_discarded_update_is_rebuilt_and_recorded_ones_run_later() {
    on_every_device(|headless, engine| {
        for_every_desc(engine, &testing::mesh(300, 13), |mesh, desc| {
            let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
            let frames = history(mesh, &desc, 4);
            crowd.step(&[&frames[1]]).expect("a step");
            let (_, dropped) = crowd.record(&[&frames[4]]).expect("a recording");
            crowd.discard(dropped.ticket).expect("a ticket of this crowd");
            let late = crowd.draw(1).err().map(|e| e.to_string());
            assert!(late.is_none_or(|text| text.contains("no pose yet")), "{desc:?}");
            let (first, _) = crowd.record(&[&frames[5]]).expect("a recording");
            let (second, _) = crowd.record(&[&frames[4]]).expect("a recording");
            crowd.submit(vec![first, second]).expect("a submission");
            if can_read(headless, &desc) {
                let reference = gpu::reference(mesh, &desc, &frames[4]);
                let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                assert!(error.within(POSITION * f64::from(mesh.layout().diagonal), NORMAL), "{desc:?}: {error:?}");
            }
        });
    });
}

/// What Godot's compatibility renderer does: from base, a pass for each active target.
#[test]
fn feedback_rebuilt_at_batch_one_is_a_pass_per_active_target_from_base() {
    gpu::on_device("llvmpipe", false, |headless, engine| {
        let mesh = packed(engine, &testing::mesh(200, 9), DeltaFormat::Float32);
        let update = UpdateDesc::new(UpdatePath::Feedback, BatchSize::Targets(1));
        let desc = update.mode(UpdateMode::Rebuild);
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
        let mut weights = [0.5, 0.0, 1.0, -0.5, 0.0, 0.0, 0.25, 0.0, 0.0];
        for changed in [0.5, 0.75] {
            weights[0] = changed;
            let mut passes = vec![];
            let keep = |entries: &mut Vec<Entry>| {
                passes.extend(entries.iter().filter_map(|entry| match entry {
                    Entry::Work { work, .. } => Some(work.clone()),
                    Entry::Barrier(_) => None,
                }));
            };
            // SAFETY: nothing is changed.
            let (step, _) =
                unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], keep) }.expect("a step");
            assert_eq!(step.update.stats.passes, 4, "one weight changed, four are active");
            assert_eq!(passes[0].source, Source::Base);
            assert!(passes.len() == 4 && passes.iter().all(|pass| pass.items.len() == 1));
            let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(&mesh, &weights));
            assert!(error.within(POSITION * f64::from(mesh.layout().diagonal), NORMAL), "{error:?}");
        }
    });
}

#[test]
fn what_a_baseline_cannot_do_is_refused_by_name() {
    for (desc, words) in [
        (UpdateDesc::new(UpdatePath::Scatter, BatchSize::All), "'scatter'"),
        (UpdateDesc::new(UpdatePath::Direct, BatchSize::All), "'direct'"),
        (UpdateDesc::new(UpdatePath::DirectAttributes, BatchSize::Targets(4)), "'direct-attributes'"),
    ] {
        assert!(desc.check().is_ok());
        let incremental = desc.mode(UpdateMode::Incremental);
        let text = incremental.check().expect_err("refused").to_string();
        assert!(text.contains(words) && text.contains("'rebuild'"), "{text}");
    }
    let fixed = UpdateDesc::new(UpdatePath::Scatter, BatchSize::All).pose(PoseFormat::Fixed16);
    let text = fixed.check().expect_err("refused").to_string();
    assert!(text.contains("fixed16 poses with 'scatter'") && text.contains("use float32 poses here"), "{text}");
    let one_slot = UpdateDesc::new(UpdatePath::VertexStore, BatchSize::Targets(1)).slots(1);
    assert!(one_slot.check().expect_err("refused").to_string().contains("2 to 64 slots"));

    on_every_device(|headless, engine| {
        let float32 = packed(engine, &testing::mesh(100, 40), DeltaFormat::Float32);
        let small = packed(engine, &testing::mesh(100, 40), DeltaFormat::Small);
        let refused = |mesh: &PackedMesh, path, batch| {
            let desc = single(UpdateDesc::new(path, batch));
            HeadlessCrowd::new(headless, mesh, &desc).err().expect("refused").to_string()
        };
        let one = BatchSize::Targets(1);
        assert!(refused(&float32, UpdatePath::Scatter, BatchSize::All).contains("pack the mesh as small"));
        assert!(refused(&small, UpdatePath::Direct, BatchSize::All).contains("pack the mesh as float32 or snorm16"));
        if engine.caps().float_blending {
            assert!(
                refused(&small, UpdatePath::Texture, BatchSize::All).contains("pack the mesh as float32 or snorm16")
            );
        } else {
            assert!(refused(&float32, UpdatePath::Texture, BatchSize::All).contains("needs blending of R32G32B32A32"));
        }
        let most = engine.caps().batch_max(UpdatePath::DirectAttributes, DeltaFormat::Float32).expect("a limit");
        let text = refused(&float32, UpdatePath::DirectAttributes, BatchSize::Targets(most + 1));
        assert!(text.contains(&format!("use 1 to {most}")), "{text}");
        let desc = single(UpdateDesc::new(UpdatePath::DirectAttributes, BatchSize::Targets(most)));
        let mut crowd = HeadlessCrowd::new(headless, &float32, &desc).expect("a crowd");
        let text = crowd.step(&[&[1.0; 40]]).expect_err("refused").to_string();
        assert!(text.contains("40 active") && text.contains(&format!("attributes for {most}")), "{text}");
        if !engine.caps().vertex_stores {
            let text = refused(&float32, UpdatePath::VertexStore, one);
            assert!(text.contains("needs the feature vertexPipelineStoresAndAtomics"), "{text}");
        }
    });
    gpu::on_device("llvmpipe", true, |_, engine| assert!(!engine.caps().vertex_stores, "the clamp takes it away"));
    gpu::on_device("llvmpipe", false, |headless, engine| {
        assert!(engine.caps().vertex_stores);
        // What one path was uploaded for, another does not take.
        let small = packed(engine, &testing::mesh(100, 4), DeltaFormat::Small);
        let scatter = single(UpdateDesc::new(UpdatePath::Scatter, BatchSize::All));
        let crowd = HeadlessCrowd::new(headless, &small, &scatter).expect("a crowd");
        let text = engine.create_crowd(crowd.mesh(), &single(UpdateDesc::blocks())).err().expect("refused").to_string();
        assert!(text.contains("have uploads of their own"), "{text}");
        let float32 = packed(engine, &testing::mesh(100, 4), DeltaFormat::Float32);
        let texture = single(UpdateDesc::new(UpdatePath::Texture, BatchSize::All));
        let crowd = HeadlessCrowd::new(headless, &float32, &texture).expect("a crowd");
        let compute = single(UpdateDesc::new(UpdatePath::Compute, BatchSize::All));
        let text = engine.create_crowd(crowd.mesh(), &compute).err().expect("refused").to_string();
        assert!(text.contains("have uploads of their own"), "{text}");
        let crowd = HeadlessCrowd::new(headless, &float32, &compute).expect("a crowd");
        let text = engine.create_crowd(crowd.mesh(), &texture).err().expect("refused").to_string();
        assert!(text.contains("have uploads of their own"), "{text}");
    });
}
