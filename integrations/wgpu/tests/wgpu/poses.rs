//! Poses are right, and ready for every kind of reader.

use crate::common::{
    ComputeReader, DrawReader, Random, assert_right, copy, messages, on_every_adapter, packed, submit_and_read,
    uploaded,
};
use crate::play::{Played, decoded, difference, play};
use crate::scene::{EDGE, Host, now};
use crate::testing;
use deltamorph::{BatchSize, CrowdDesc, DeltaFormat, PackedMesh, PoseFormat, Semantic, UpdateDesc, UpdatePath};
use deltamorph_wgpu::{Morph, VertexInput};

#[test]
fn the_example_draws_what_the_reference_says() {
    on_every_adapter(|host| {
        let neutral = play(&host, PoseFormat::Float32, 5_000, 0..1).expect("a picture").picture;
        for format in PoseFormat::ALL {
            let Played { error, picture, reference } = play(&host, format, 5_000, 38..43).expect("a picture");
            let (position, degrees) = match format {
                PoseFormat::Float32 => (1e-6, 0.01),
                PoseFormat::Fixed32 => (3e-6, 0.01),
                _ => (8e-5, 0.1),
            };
            assert!(error.within(position, degrees), "{format:?}: {error:?}");
            let differ = difference(&picture, &reference);
            assert!(differ < 5e-4, "{format:?}: {differ} of the pixels differ");
            // Neither picture is empty, and the head moves.
            assert!(difference(&picture, &neutral) > 0.02);
            assert_eq!(picture.len(), (EDGE * EDGE * 4) as usize);
        }
    });
}

#[test]
fn draws_copies_and_compute_passes_of_one_submit_read_the_pose() {
    on_every_adapter(|host| {
        let (morph, mesh, uploaded, mut weights) = uploaded(&host, DeltaFormat::Fast);
        for (format, slots) in PoseFormat::ALL.into_iter().flat_map(|format| [(format, 1), (format, 2)]) {
            let desc = CrowdDesc::new(UpdateDesc::blocks().pose(format).slots(slots));
            let mut crowd = morph.create_crowd(&uploaded, &desc).expect("a crowd");
            // With the previous pose, and after attributes of the host's own.
            let input = VertexInput::new(format, 3, slots > 1).expect("attributes");
            let second = if slots > 1 { "previous_input(in).normal" } else { "pose.normal" };
            let vertex = format!(
                "{}@vertex fn vertex(in: PoseInput) -> @builtin(position) vec4f {{
                    let pose = pose_input(in);
                    return vec4f(pose.position + {second}, 1.0);
                }}",
                input.wgsl()
            );
            let attributes = DrawReader::new(&host, &vertex, &input.layouts());
            let (mut random, mut compute, mut read) = (Random(7), None, vec![]);
            // No waits between frames but those of `update`.
            for _ in 0..8 {
                random.change(&mut weights);
                crowd.set_weights(0, &weights).expect("weights");
                let update = morph.update([&mut crowd]).expect("an update");
                assert!(update.is_some());
                let pose = crowd.pose(0).expect("a pose");
                let previous = crowd.previous_pose(0).expect("a pose");
                assert!(previous.is_some() || slots == 1);
                let previous = previous.filter(|_| slots > 1);
                let bound: Vec<_> = [Some(pose), previous].into_iter().flatten().collect();
                let compute = compute.get_or_insert_with(|| ComputeReader::new(&host, &pose.view));
                let mut encoder = host.device.create_command_encoder(&Default::default());
                attributes.record(&mut encoder, 300, &bound);
                let copied = copy(&host, &mut encoder, &pose);
                let computed = compute.record(&host, &mut encoder, &pose);
                let previous = previous.map(|pose| copy(&host, &mut encoder, &pose));
                host.queue.submit(update.into_iter().chain([encoder.finish()]));
                read.push((copied, computed, previous, pose.view, weights.clone()));
            }
            let mut before: Option<Vec<u8>> = None;
            for (copied, computed, previous, view, weights) in read {
                let copied = host.read(&copied).expect("a copy");
                assert_right(&decoded(&copied, &view), &mesh, &weights, format, "a copy");
                let computed = PoseFormat::Float32.decode(&host.read(&computed).expect("a copy"), None);
                assert_right(&computed, &mesh, &weights, format, "a compute pass");
                let previous = previous.map(|previous| host.read(&previous).expect("a copy"));
                if let (Some(previous), Some(before)) = (&previous, &before) {
                    assert_eq!(previous, before, "{format:?}");
                }
                before = Some(copied);
            }
        }
    });
}

#[test]
fn the_layers_see_a_barrier_that_is_left_out() {
    on_every_adapter(|host| {
        let (morph, _, uploaded, mut weights) = uploaded(&host, DeltaFormat::Fast);
        for left_out in [false, true] {
            let mut crowd = morph.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
            weights[0] = 1.0 - weights[0];
            crowd.set_weights(0, &weights).expect("weights");
            // SAFETY: a pose that is read before it is written is merely wrong, and its values are not used.
            let update = unsafe {
                morph.update_tampered([&mut crowd], |entries| {
                    let last = if left_out { entries.pop() } else { None };
                    assert!(!left_out || format!("{last:?}").contains("Barrier"));
                })
            };
            submit_and_read(&host, update.expect("an update"), &crowd);
            let hazards = messages().into_iter().filter(|m| m.contains("SYNC-HAZARD-READ-AFTER-WRITE")).count();
            assert_eq!(hazards > 0, left_out, "{hazards} hazards");
        }
    });
}

#[test]
fn crowds_are_updated_together_and_nothing_is_recorded_where_nothing_changed() {
    on_every_adapter(|host| {
        let morph = Morph::new(&host.device, &host.queue).expect("a device with compute");
        let formats = [(DeltaFormat::Small, UpdateDesc::blocks()), (DeltaFormat::Snorm16, dense())];
        let mut heads: Vec<_> = formats
            .map(|(format, update)| {
                let (mesh, weights) = packed(&morph, format);
                let crowd = morph.create_crowd(&morph.upload(&mesh).expect("an upload"), &CrowdDesc::new(update));
                (mesh, weights, crowd.expect("a crowd"))
            })
            .into();
        let mut random = Random(3);
        for _ in 0..5 {
            for (_, weights, crowd) in &mut heads {
                random.change(weights);
                crowd.set_weights(0, weights).expect("weights");
            }
            let mut update = morph.update(heads.iter_mut().map(|(.., crowd)| crowd)).expect("an update");
            assert!(update.is_some());
            for (mesh, weights, crowd) in &heads {
                let pose = submit_and_read(&host, update.take(), crowd);
                let pose = decoded(&pose, &crowd.pose(0).expect("a pose").view);
                assert_right(&pose, mesh, weights, PoseFormat::Float32, "one of two");
            }
        }
        assert!(morph.update(heads.iter_mut().map(|(.., crowd)| crowd)).expect("an update").is_none());
        assert!(morph.update([]).expect("an update of nobody").is_none());
    });
}

/// Returns dense passes with poses of their own technique.
pub fn dense() -> UpdateDesc {
    UpdateDesc::new(UpdatePath::Compute, BatchSize::All)
}

#[test]
fn streams_have_buffers_of_their_own() {
    on_every_adapter(|host| {
        let morph = Morph::new(&host.device, &host.queue).expect("a device with compute");
        let mesh = testing::with_streams(testing::mesh(300, 23));
        let mesh = PackedMesh::pack(&mesh, &morph.pack_desc(DeltaFormat::Fast)).expect("a mesh that fits");
        let uploaded = morph.upload(&mesh).expect("an upload");
        let mut crowd = morph.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        assert!(crowd.stream(0, Semantic::Tangent).is_err());
        let update = morph.update([&mut crowd]).expect("an update");
        let tangents = crowd.stream(0, Semantic::Tangent).expect("tangents");
        assert_ne!(tangents.buffer, crowd.pose(0).expect("a pose").buffer);
        assert!(crowd.previous_stream(0, Semantic::Tangent).expect("tangents").is_some());
        // All weights are 0, so the pose is the base pose.
        let mut encoder = host.device.create_command_encoder(&Default::default());
        let (first, size) = (tangents.view.offset, tangents.buffer.size());
        let copy = host.readback(size);
        encoder.copy_buffer_to_buffer(tangents.buffer, 0, &copy, 0, size);
        host.queue.submit(update.into_iter().chain([encoder.finish()]));
        let bytes = host.read(&copy).expect("a copy");
        let group = mesh.groups().iter().find(|g| g.layout().streams.iter().any(|s| s.semantic == Semantic::Tangent));
        let group = group.expect("tangents");
        let stride = tangents.view.stride as usize;
        let at = |vertex: usize| {
            f32::from_ne_bytes(*bytes[first as usize + vertex * stride..].first_chunk().expect("a word"))
        };
        let place = group.layout().streams.iter().find(|s| s.semantic == Semantic::Tangent).expect("tangents").first;
        (0..300).for_each(|vertex| assert_eq!(at(vertex), group.base()[vertex * stride / 4 + place]));
        assert!((0..300).any(|vertex| at(vertex) != 0.0));
    });
}

#[test]
fn what_cannot_be_used_is_refused() {
    // A device of another backend than Vulkan.
    let mut desc = wgpu::InstanceDescriptor::new_without_display_handle();
    desc.backends = wgpu::Backends::NOOP;
    desc.backend_options.noop.enable = true;
    let adapter =
        now(wgpu::Instance::new(desc).request_adapter(&Default::default())).expect("the backend of no device");
    let noop = Host::new(&adapter).expect("a device");
    let refused = Morph::new(&noop.device, &noop.queue).err().expect("an error").to_string();
    assert!(refused.contains("not on Vulkan"), "{refused}");

    on_every_adapter(|host| {
        let [morph, other] = [0, 1].map(|_| Morph::new(&host.device, &host.queue).expect("a device with compute"));
        let (mesh, _) = packed(&morph, DeltaFormat::Fast);
        let uploaded = morph.upload(&mesh).expect("an upload");
        let desc = CrowdDesc::new(UpdateDesc::blocks());
        assert!(other.create_crowd(&uploaded, &desc).is_err());
        let mut crowd = morph.create_crowd(&uploaded, &desc).expect("a crowd");
        assert!(crowd.pose(0).is_err(), "no update was made");
        assert!(other.update([&mut crowd]).is_err());
        assert!(crowd.set_weights(0, &[0.0]).is_err());
        // None of these errors did any harm.
        let update = morph.update([&mut crowd]).expect("an update");
        submit_and_read(&host, update, &crowd);
    });
}
