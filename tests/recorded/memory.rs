//! Memory of the engine, by what it is for, and from functions of the host's.

use crate::gpu::{self, drivers, on_device, weights};
use deltamorph::{Crowd, CrowdDesc, DeltaFormat, MorphEngine, UpdateDesc, testing};
use deltamorph_headless::HeadlessCrowd;

#[test]
fn memory_is_counted_by_what_it_is_for_and_given_back() {
    for driver in drivers() {
        on_device(&driver, false, |headless, engine| {
            let before = engine.memory();
            let (mesh, desc) = (gpu::packed(engine, &testing::mesh(300, 7), DeltaFormat::Fast), UpdateDesc::blocks());
            let desc = CrowdDesc::new(desc);
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            crowd.step(&[&weights(&mesh, 0, 9)]).expect("a step");
            let memory = engine.memory();
            for (what, used, least) in [
                ("meshes", memory.meshes, MorphEngine::mesh_bytes(&mesh)),
                ("poses", memory.poses, Crowd::pose_bytes(&mesh, &desc)),
                ("lists", memory.lists, 256),
            ] {
                assert!((least..least + 65_536).contains(&used.bytes), "{what}: {used:?}, at least {least}");
                assert!(used.allocations > 0, "{what}: {used:?}");
                let json = format!(r#""{what}": {{"bytes": {}, "allocations": {}}}"#, used.bytes, used.allocations);
                assert!(memory.to_string().contains(&json), "{memory}");
            }
            assert_eq!((memory.staging.bytes, memory.animation.bytes), (0, 0), "released, and not there");
            assert!(memory.allocated >= memory.meshes.bytes + memory.poses.bytes + memory.lists.bytes);
            drop(crowd);
            assert_eq!(engine.memory(), before);
        });
    }
}
