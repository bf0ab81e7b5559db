//! Unsupported uses of a technique are refused: the message names the technique, and a remedy.

use super::table::ROWS;
use crate::gpu::packed;
use crate::prelude::*;
use crate::testing::says;
use deltamorph::DeltaFormat::{Float32, Small};

/// Runs `test` on every driver with one limit.
fn within(limit: fn(&mut DeviceCaps), test: impl Fn(&Headless, &MorphEngine)) {
    for driver in gpu::drivers() {
        gpu::on_device_within(&driver, Some(gpu::limited(gpu::caps(&driver), limit)), &test);
    }
}

#[test]
fn descriptions_that_ask_for_what_a_technique_does_not_do() {
    for row in &ROWS {
        let (path, name) = (row.path, format!("'{}'", row.path.name()));
        let good = UpdateDesc::new(path, if path.takes_all_targets() { BatchSize::All } else { BatchSize::Targets(4) });
        assert!(good.check().is_ok(), "{name}");
        let refused = |desc: UpdateDesc, words: &[&str]| {
            says(desc.check(), &[words, &[name.as_str()]].concat());
        };
        if path.default_mode() == UpdateMode::Rebuild {
            refused(UpdateDesc { mode: UpdateMode::Incremental, ..good }, &["'rebuild'"]);
        }
        for pose in PoseFormat::ALL.into_iter().filter(|pose| !path.poses().contains(pose)) {
            let what = format!("{} poses with {name}", pose.name());
            let taken: Vec<&str> = path.poses().iter().map(|pose| pose.name()).collect();
            let remedy = format!("use {} poses here, or the path", taken.join(" or "));
            refused(UpdateDesc { pose, ..good }, &[&what, &remedy, "'blocks' or 'cpu'"]);
        }
        if path.works_in_place() {
            assert!(UpdateDesc { slots: 1, ..good }.check().is_ok(), "{name}");
        } else {
            refused(UpdateDesc { slots: 1, ..good }, &["2 to 64 slots"]);
            refused(UpdateDesc { batch: BatchSize::All, ..good }, &["use a number"]);
        }
    }
}

#[test]
fn devices_that_lack_what_a_technique_needs() {
    for row in &ROWS {
        let Some((change, words)) = row.missing else {
            on_every_device(|_, engine| assert!(engine.caps().check_path(row.path).is_ok(), "{:?}", row.path));
            continue;
        };
        within(change, |headless, _| {
            let format = row.path.formats()[0];
            let mesh = PackedMesh::pack(&testing::mesh(10, 2), &PackDesc::new(format)).expect("a mesh");
            let desc = CrowdDesc::new(UpdateDesc::new(row.path, BatchSize::Targets(1)));
            let device = if row.path == UpdatePath::Cpu { "" } else { &headless.caps().name };
            says(HeadlessCrowd::new(headless, &mesh, &desc), &[words, &[device]].concat());
        });
    }
    // Drivers have this feature, which the clamp removes.
    gpu::on_device(&gpu::one(), false, |_, engine| assert!(engine.caps().vertex_stores));
    gpu::on_device(&gpu::one(), true, |_, engine| assert!(!engine.caps().vertex_stores));
}

#[test]
fn meshes_that_a_technique_does_not_take() {
    on_every_device(|headless, engine| {
        let plain = DeltaFormat::ALL.map(|format| packed(engine, &testing::mesh(100, 40), format));
        let streams = testing::with_streams(testing::mesh(100, 4));
        for row in ROWS.iter().filter(|row| engine.caps().check_path(row.path).is_ok()) {
            let path = row.path;
            for mesh in plain.iter().filter(|mesh| !path.formats().contains(&mesh.layout().format)) {
                let names: Vec<_> = path.formats().iter().map(|format| format.name()).collect();
                let batch = row.batch(engine, path.formats()[0]);
                let most = engine.caps().batch_max(path, mesh.layout().format);
                assert!(path.takes_all_targets() || most == Some(0), "{path:?}: {most:?}");
                let made = HeadlessCrowd::new(headless, mesh, &CrowdDesc::new(UpdateDesc::new(path, batch)));
                says(made, &[path.name(), &format!("pack the mesh as {}", names.join(" or "))]);
            }
            let format = path.formats()[0];
            let mesh = plain.iter().find(|mesh| mesh.layout().format == format).expect("one of all");
            if let Some(most) = engine.caps().batch_max(path, format).filter(|_| path != UpdatePath::Cpu) {
                let desc = CrowdDesc::new(UpdateDesc::new(path, BatchSize::Targets(most + 1)));
                let what = format!("batch size {}", most + 1);
                says(HeadlessCrowd::new(headless, mesh, &desc), &[&what, &format!("use 1 to {most}")]);
            }
            if !row.streams {
                let desc = CrowdDesc::new(UpdateDesc::new(path, row.batch(engine, format)));
                let made = HeadlessCrowd::new(headless, &packed(engine, &streams, format), &desc);
                says(made, &[path.name(), "'blocks'"]);
            }
        }
    });
}

#[test]
fn limits_are_kept_or_refused_with_the_numbers() {
    for row in &ROWS {
        for &(limit, words) in row.limits {
            within(limit, |headless, engine| {
                if engine.caps().check_path(row.path).is_ok() {
                    let desc = PackDesc::new(row.path.formats()[0]);
                    let mesh = PackedMesh::pack(&testing::mesh(1000, 5), &desc).expect("a mesh");
                    let desc = CrowdDesc::new(UpdateDesc::new(row.path, BatchSize::Targets(1)));
                    says(HeadlessCrowd::new(headless, &mesh, &desc), words);
                }
            });
        }
    }
}

/// A path refuses a mesh that was uploaded for another one.
#[test]
fn uploads_of_another_technique() {
    gpu::on_device(&gpu::one(), false, |headless, engine| {
        let [scatter, texture, compute] =
            [deltamorph_baselines::SCATTER, deltamorph_baselines::TEXTURE, UpdatePath::Compute]
                .map(|p| UpdateDesc::new(p, BatchSize::All));
        for (format, uploaded, wanted) in
            [(Small, scatter, UpdateDesc::blocks()), (Float32, texture, compute), (Float32, compute, texture)]
        {
            let crowd = gpu::crowd(headless, &packed(engine, &testing::mesh(100, 4), format), uploaded);
            says(engine.create_crowd(crowd.mesh(), &CrowdDesc::new(wanted)), &["have uploads of their own"]);
        }
    });
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, &testing::mesh(10, 2), Float32);
        let desc = gpu::update_descs(engine, Float32)[0];
        for (desc, words) in [
            (CrowdDesc { instances: 0, ..CrowdDesc::new(desc) }, "0 instances"),
            (CrowdDesc { frames_in_flight: 0, ..CrowdDesc::new(desc) }, "0 frames in flight"),
            (CrowdDesc { instances: 1 << 24, ..CrowdDesc::new(desc) }, "use fewer instances"),
        ] {
            says(HeadlessCrowd::new(headless, &mesh, &desc), &[words]);
        }
        let mut crowd = gpu::crowd(headless, &mesh, desc);
        says(crowd.step(&[&[0.0, f32::NAN]]), &["target 1 ('target_1') is NaN"]);
        says(crowd.step(&[&[0.0]]), &["1 weights given, but the mesh has 2 targets"]);
        // A refused call changes nothing.
        crowd.step(&[&[0.25, 0.5]]).expect("a step");
        gpu::assert_right(&mut crowd, 0, &mesh, &[0.25, 0.5]);
    });
}
