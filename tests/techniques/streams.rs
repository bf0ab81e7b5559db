//! Streams besides positions and normals: tangents, texture coordinates and colours with every technique, on real
//! drivers and on the CPU, against the float64 reference.

use super::table::{Row, assert_pose, check, for_every_update, variants};
use crate::gpu::weights;
use crate::prelude::*;

const TARGETS: usize = 11;
const HEADS: usize = 3;

/// Makes a mesh with every kind of stream; target 2 moves nothing, and the last one only tangents.
fn source() -> KeptMesh {
    let mut mesh = testing::with_streams(testing::mesh(300, TARGETS));
    let last = &mut mesh.targets[TARGETS - 1];
    (last.vertices, last.positions, last.normals) = Default::default();
    last.streams[1..].iter_mut().for_each(|stream| *stream = Default::default());
    mesh
}

fn packed(desc: &PackDesc) -> PackedMesh {
    let packed = PackedMesh::pack(&source(), desc).expect("a mesh that fits");
    assert_eq!(packed.groups().len(), 3, "position and normal; tangent and texture coordinates; colours and masks");
    packed
}

/// Every stream, or positions and normals on techniques that support only these.
#[test]
fn every_technique_updates_every_stream_of_a_crowd() {
    for (mesh, with_streams) in [(source(), true), (testing::mesh(300, TARGETS), false)] {
        for_every_update(&DeltaFormat::ALL, &mesh, |headless, mesh, desc| {
            if Row::of(desc.path).streams == with_streams {
                variants(desc).filter(|v| v.mode == desc.mode).for_each(|desc| check(headless, mesh, desc, HEADS, 8));
            }
        });
    }
}

#[test]
fn an_error_budget_holds_back_positions_and_nothing_else() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Fast, DeltaFormat::Small] {
            let mesh = packed(&engine.pack_desc(format));
            for desc in update_descs(engine, format) {
                check(headless, &mesh, UpdateDesc { error_budget: 0.3 * mesh.layout().diagonal, ..desc }, HEADS, 8);
            }
        }
    });
}

/// The proptest of src/cpu, and for integers tests/updates/integers.rs, play histories.
#[test]
fn the_cpu_updates_every_stream() {
    for format in DeltaFormat::ALL {
        let mesh = Arc::new(packed(&PackDesc::new(format)));
        let desc = UpdateDesc { tolerance: 1e-2, path: UpdatePath::Cpu, ..UpdateDesc::blocks() };
        let mut crowd = gpu::cpu_crowd(&mesh, desc, HEADS as u32);
        for frame in 0..12 {
            let asked = [0, 1, 2].map(|head| weights(&mesh, frame, head));
            (0..).zip(&asked).for_each(|(head, asked)| crowd.set_weights(head, asked).expect("weights"));
            crowd.update();
            for (head, asked) in (0..).zip(&asked) {
                for (number, group) in mesh.groups().iter().enumerate() {
                    let what = format!("{format:?} frame {frame} head {head} group {number}");
                    let pose = mesh.layout().to_user_order(&crowd.group_pose(head, number).expect("a pose"));
                    assert_pose(group, &desc, &pose, asked, &what);
                }
            }
        }
        testing::says(crowd.group_pose(0, 3), &["group 3", "has 3"]);
    }
}
