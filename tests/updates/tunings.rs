//! Tuning affects speed only: whatever it is, poses are right, and those of integers are the same.

use crate::prelude::*;

const HEADS: u32 = 3;
const TARGETS: usize = 12;

/// A third of the targets changes in each frame: other blocks, and other numbers of them.
fn weights(head: u32, frame: u32) -> Vec<f32> {
    (0..TARGETS as u32).map(|t| ((head * 7 + t * 13 + (frame + t) / 3 * 5) % 17) as f32 / 8.0 - 0.5).collect()
}

/// Each value of a field on its own, and those for GPUs with wide subgroups together.
fn tunings(own: DeviceTuning) -> Vec<DeviceTuning> {
    let plain = |change: &dyn Fn(&mut DeviceTuning)| {
        let mut tuning = own;
        (tuning.texels, tuning.lanes, tuning.few_registers) = (false, 1, false);
        change(&mut tuning);
        tuning
    };
    vec![
        own,
        plain(&|_| ()),
        plain(&|tuning| tuning.widest_tile = 1),
        plain(&|tuning| tuning.lanes = 64),
        plain(&|tuning| tuning.few_registers = true),
        plain(&|tuning| (tuning.lanes, tuning.few_registers) = (64, true)),
    ]
}

#[test]
fn poses_are_the_same_whatever_the_tuning() {
    // Blocks that are small enough to share a workgroup, in every format.
    let blocks = BlockDesc { size: Some(32), ..Default::default() };
    let poses = [PoseFormat::Float32, PoseFormat::Fixed32, PoseFormat::Fixed16];
    let updates = [DeltaFormat::Small, DeltaFormat::Fast].map(|format| poses.map(|pose| (format, pose)));
    let updates = updates.as_flattened();
    let desc = HeadlessDesc { device: DeviceChoice::Name(gpu::one()), validation: true, ..Default::default() };
    let own = Headless::new(&desc).expect("a device").caps().tuning;
    let (mut wrong, mut bits) = (vec![], vec![None; updates.len()]);
    for tuning in tunings(own) {
        let headless = Headless::new(&HeadlessDesc { tuning: Some(tuning), ..desc.clone() }).expect("a device");
        for (&(format, pose), bits) in updates.iter().zip(&mut bits) {
            // In place, a block that is processed twice would be wrong.
            let update = UpdateDesc { pose, slots: 1, weight_max: Some(4.0), tolerance: 1e-2, ..UpdateDesc::blocks() };
            let packing = PackDesc { blocks, ..headless.engine().pack_desc(format) };
            let mesh = PackedMesh::pack(&testing::mesh(700, TARGETS), &packing).expect("a mesh that fits");
            let crowd = CrowdDesc { instances: HEADS, frames_in_flight: 1, ..CrowdDesc::new(update) };
            let mut crowd = HeadlessCrowd::new(&headless, &mesh, &crowd).expect("a crowd");
            let mut stored = vec![];
            for frame in 0..6 {
                let weights: Vec<_> = (0..HEADS).map(|head| weights(head, frame)).collect();
                crowd.step(&weights.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a step");
                for (head, weights) in weights.iter().enumerate() {
                    let error = gpu::error(&mut crowd, head as u32, &mesh, weights);
                    if !error.within(1e-5 * f64::from(mesh.layout().diagonal), 0.02) {
                        wrong.push(format!("{tuning:?} {format:?} {pose:?} frame {frame} head {head}: {error:?}"));
                    }
                    stored.push(crowd.read_stored(head as u32, 0).expect("a pose"));
                }
            }
            if pose.has_integers() && *bits.get_or_insert_with(|| stored.clone()) != stored {
                wrong.push(format!("{tuning:?} {format:?} {pose:?}: other bits"));
            }
        }
        assert_eq!(gpu::complaints(&headless), Vec::<String>::new());
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
