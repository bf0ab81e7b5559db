//! Barriers around each step after the pose: a step without a row does not compile.

use crate::gpu;
use crate::joints::{JOINTS, Joints};
use crate::offscreen::Offscreen;
use crate::written::Written;
use crate::{decode, normals, skin};
use deltamorph::after::{NormalsDesc, NormalsTarget, SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk;
use deltamorph::internals::plan::after::Kind;
use deltamorph::internals::plan::hazards::{Event, HazardChecker, Memory, barriers_needed};
use deltamorph::internals::plan::schedule::asset_uploaded;
use deltamorph::{CrowdDesc, DecodeTarget, DeltaFormat, UpdateDesc};
use deltamorph_headless::HeadlessCrowd;
use std::slice::from_mut;

#[test]
fn a_missing_barrier_around_a_step_is_found() {
    let source = normals::mesh();
    let triangles = source.faces.triangles().into_flattened();
    gpu::on_every_device(|headless, engine| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let joints = Joints::new(headless, &host, SkinMethod::Linear, 1.0);
        for kind in Kind::ALL {
            // The step that reads poses of every kind alike is tried with each.
            let updates = match kind {
                Kind::Decode => gpu::updates(headless),
                _ => vec![(DeltaFormat::Fast, UpdateDesc::blocks())],
            };
            for (format, update) in updates {
                let mesh = gpu::packed(engine, &source, format);
                let vertices = mesh.layout().vertex_count;
                let written = Written::new(headless, &host, vertices, (0, 24, Some(12)));
                let buffer = written.buffer;
                type Set<'a> = Box<dyn Fn(&mut HeadlessCrowd<'_>) -> deltamorph::Result<()> + 'a>;
                // SAFETY, of all: the buffers are large enough, and live as long as the crowd; nothing is running.
                let set: Set<'_> = match kind {
                    Kind::Decode => {
                        let target = DecodeTarget::new(buffer).stride(12);
                        // SAFETY: as above.
                        Box::new(move |crowd| unsafe { crowd.set_decode_target(0, Some(&target)) })
                    }
                    Kind::Skin => {
                        let (numbers, weights) = skin::influences(vertices, 4);
                        let skin = skin::upload(headless, &mesh, &SkinDesc::new(4, JOINTS, &numbers, &weights));
                        let target = SkinTarget::new(buffer, joints.shared.buffer, 3 * Joints::STRIDE);
                        let target = target.joints_offset(16);
                        // SAFETY: as above.
                        Box::new(move |crowd| unsafe { crowd.set_skin_target(0, Some((&skin, &target))) })
                    }
                    Kind::Normals => {
                        let surface = normals::upload(headless, &mesh, &NormalsDesc::new(&triangles));
                        let target = NormalsTarget::new(buffer);
                        // SAFETY: as above.
                        Box::new(move |crowd| unsafe { crowd.set_normals_target(0, Some((&surface, &target))) })
                    }
                };
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(update)).expect("a crowd");
                let (mut updates, mut slots) = (vec![], vec![]);
                // The target comes when there is a pose: the next update carries out the step, and does nothing else.
                for frame in [0, 0, 1, 2, 3] {
                    if updates.len() == 1 {
                        set(&mut crowd).expect("a target");
                    }
                    let weights = decode::weights(&mesh, frame, 1);
                    // SAFETY: nothing is changed.
                    let step = unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], |_| {}) };
                    updates.push(step.expect("a step").1);
                    slots.push(crowd.crowd().pose(0).expect("a pose").slot);
                }
                let steps = updates[1].iter().filter(|event| matches!(event, Event::Step { .. })).count();
                assert_eq!(steps, 1, "{kind:?} {update:?}");
                let is_right = |updates: &[Vec<Event>]| {
                    let mut checker = HazardChecker::default();
                    checker.upload(asset_uploaded());
                    for (events, slot) in updates.iter().zip(&slots) {
                        checker.update(events);
                        checker.draw(0, 0, *slot);
                        checker.read_after(0, Memory::After { resource: kind.output(), instance: 0, output: 0 });
                    }
                    checker.finish().is_ok()
                };
                let found = barriers_needed(&updates, 1..updates.len(), is_right);
                assert!(found >= 10, "{kind:?} {update:?}: {found} barriers");
            }
        }
    });
}
