//! Weights one at a time and by name.

use crate::gpu::{fixed, packed};
use crate::prelude::*;
use crate::testing::says;

#[test]
fn weights_are_set_one_at_a_time_and_read_back() {
    let mesh = PackedMesh::pack(&testing::mesh(200, 9), &PackDesc::new(DeltaFormat::Small)).expect("a mesh that packs");
    let mesh = Arc::new(mesh);
    let name = |target: usize| mesh.layout().targets[target].name.clone();
    assert_eq!(mesh.layout().target_index(&name(4)), Some(4));
    assert_eq!(mesh.layout().target_index("no such target"), None);
    let [mut one, mut other] = [(); 2].map(|()| gpu::cpu_crowd(&mesh, fixed()[0], 2));
    let mut asked: Vec<f32> = (0..9).map(|target| target as f32 / 8.0).collect();
    one.set_weights(1, &asked).expect("weights");
    (asked[2], asked[4]) = (0.625, -0.5);
    one.set_weight(1, 2, 0.625).expect("a weight");
    one.set_weight(1, 4, -0.5).expect("a weight");
    for (weight, words) in [(f32::NAN, "is NaN"), (f32::INFINITY, "is inf"), (5.0, "use a larger weight_max")] {
        says(one.set_weight(1, 2, weight), &["the weight of target 2", words]);
    }
    says(one.set_weight(1, 9, 0.0), &["target 9 of mesh", "which has 9; count targets from 0"]);
    says(one.set_weight(2, 0, 0.0), &["instance 2 of a crowd of 2"]);
    says(one.weights(2), &["instance 2 of a crowd of 2"]);
    assert_eq!((one.weights(0).unwrap(), one.weights(1).unwrap()), (&[0.0; 9][..], &asked[..]));
    other.set_weights(1, &asked).expect("weights");
    let [pose, expected] = [&mut one, &mut other].map(|crowd| {
        crowd.update();
        crowd.pose(1).expect("a pose").into_owned()
    });
    assert_eq!(pose, expected, "the pose of the same weights, set at once");
    one.remove(1).expect("an instance");
    says(one.set_weight(1, 0, 0.0), &["instance 1 was removed"]);
}

#[test]
fn a_weight_that_makes_too_many_active_is_refused_alone() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, &testing::mesh(64, 4), DeltaFormat::Float32);
        let desc = UpdateDesc::new(deltamorph_baselines::DIRECT_ATTRIBUTES, BatchSize::Targets(2));
        let host = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(desc)).expect("a crowd");
        let mut crowd = engine.create_crowd(host.mesh(), &CrowdDesc::new(desc)).expect("a crowd");
        crowd.set_weights(0, &[0.5, 0.0, 0.5, 0.0]).expect("two active");
        says(crowd.set_weight(0, 1, 0.5), &["3 active", "attributes for 2"]);
        assert_eq!(crowd.weights(0).unwrap(), [0.5, 0.0, 0.5, 0.0]);
        crowd.set_weight(0, 2, 0.0).expect("one active");
        crowd.set_weight(0, 1, 0.5).expect("two active");
    });
}
