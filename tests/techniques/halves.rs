//! Deltas that are half floats are kept as half floats on the device.

use super::poses::check;
use super::table::{can_read, history};
use crate::gpu::packed;
use crate::prelude::*;
use deltamorph::mesh::{KeptTarget, StreamDeltas};
use glam::Vec3;

/// Returns `mesh` with its deltas cut to half floats: 10 bits after the first, and steps of 2^-24 below 2^-14.
fn of_halves(mut mesh: KeptMesh) -> KeptMesh {
    let cut = |value: f32| match value.abs() < 2f32.powi(-14) {
        true => (value * 2f32.powi(24)).trunc() * 2f32.powi(-24),
        false => f32::from_bits(value.to_bits() & !0x1fff),
    };
    for target in &mut mesh.targets {
        for delta in target.positions.iter_mut().chain(&mut target.normals) {
            *delta = delta.map(cut);
        }
        target.streams.iter_mut().flat_map(|stream| &mut stream.deltas).for_each(|delta| *delta = cut(*delta));
    }
    mesh
}

/// Returns a mesh with a first target that moves each vertex.
fn reaching(mut mesh: KeptMesh) -> KeptMesh {
    let vertices = mesh.vertex_count() as u32;
    mesh.targets[0].vertices = (0..vertices).collect();
    // Below 2^-14 half floats have fewer bits; this detects hardware that flushes them to 0.
    mesh.targets[0].positions =
        (0..vertices).map(|v| Vec3::new(0.125, (v + 1) as f32 * 2f32.powi(-24), -0.01)).collect();
    mesh.targets[0].normals = vec![Vec3::Y; vertices as usize];
    of_halves(mesh)
}

#[test]
fn half_floats_are_kept_as_such_and_give_the_same_poses() {
    let half = reaching(testing::with_streams(testing::mesh(400, 9)));
    let mut wide = half.clone();
    // A target without a weight, with a delta in each group that is no half float: all are kept in 32 bits.
    let third = 1.0 / 3.0;
    let streams = half
        .streams
        .iter()
        .map(|stream| StreamDeltas { vertices: vec![0], deltas: vec![third; stream.semantic.morphing_components()] });
    wide.targets.push(KeptTarget {
        name: "a third".into(),
        vertices: vec![0],
        positions: vec![Vec3::splat(third)],
        normals: vec![Vec3::splat(third)],
        streams: streams.collect(),
    });
    on_every_device(|headless, engine| {
        let [half, wide] = [&half, &wide].map(|mesh| packed(engine, mesh, DeltaFormat::Float32));
        let desc = UpdateDesc::new(deltamorph_baselines::TEXTURE, BatchSize::All);
        if engine.caps().check_path(desc.path).is_err() || !can_read(headless, &desc) {
            return;
        }
        check(headless, &half, desc, 8);
        let [mut kept, mut wide] =
            [&half, &wide].map(|mesh| HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd"));
        let bits = |crowd: &mut HeadlessCrowd<'_>| {
            let groups = (0..half.groups().len()).map(|g| crowd.read_group(0, g).expect("a pose").0);
            groups.flatten().map(f32::to_bits).collect::<Vec<_>>()
        };
        for weights in history(&half, &desc, 8) {
            kept.step(&[&weights]).expect("a step");
            wide.step(&[&[&weights[..], &[0.0]].concat()]).expect("a step");
            assert!(bits(&mut kept) == bits(&mut wide), "{}: {weights:?}", headless.caps().name);
        }
        // Only the first target, in each group, whose texels are loaded once: 8 bytes each instead of 16 from each of
        // two textures, and 32 blended twice.
        let mut weights = vec![0.0; 10];
        kept.step(&[&weights[..9]]).expect("a step");
        wide.step(&[&weights]).expect("a step");
        weights[0] = 0.5;
        let stats = [kept.step(&[&weights[..9]]), wide.step(&[&weights])].map(|r| r.expect("a step").update.stats);
        let floor = stats.map(|stats| stats.bytes_floor);
        assert_eq!((floor[0] % 80, floor[1] % 96, floor[0] / 80), (0, 0, floor[1] / 96), "{stats:?}");
        assert!(floor[0] >= 400 * 80, "{stats:?}");
    });
}
