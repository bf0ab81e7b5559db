//! A host of deltamorph with default features: `cargo test --package deltamorph-lean`.
#![cfg(test)]

use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    BatchSize, CpuCrowd, Crowd, CrowdDesc, DeltaFormat, GpuMesh, KeptMesh, MorphEngine, PackDesc, PackedMesh,
    Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_head::{HeadDesc, head};
use std::sync::Arc;

/// Hosts load on one thread and record on another.
#[test]
fn what_hosts_keep_may_change_threads() {
    fn send<T: Send>() {}
    fn send_and_sync<T: Send + Sync>() {}
    send_and_sync::<KeptMesh>();
    send_and_sync::<PackedMesh>();
    send_and_sync::<deltamorph::Error>();
    send_and_sync::<CpuCrowd>();
    send_and_sync::<MorphEngine>();
    send_and_sync::<GpuMesh>();
    send::<Crowd>();
}

#[test]
fn a_mesh_is_packed_and_played_on_the_cpu() {
    let source = head(&HeadDesc { vertices: 900, targets: 7, ..Default::default() });
    let mesh = source.kept(Tolerance::default()).expect("a mesh");
    for format in DeltaFormat::ALL {
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh that packs"));
        let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let mut crowd = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), 1).expect("a crowd");
        let weights = [0.0, 0.5, 1.0, -0.25, 0.0, 0.75, 0.125];
        crowd.set_weights(0, &weights).expect("weights that fit");
        assert_eq!(crowd.update().coefficients, 5);
        let error =
            compare(&packed.layout().to_user_order(&crowd.pose(0).expect("an instance")), &evaluate(&packed, &weights));
        assert!(error.within(1e-5 * f64::from(mesh.diagonal), 0.01), "{format:?}: {error:?}");
    }
}
