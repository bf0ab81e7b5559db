//! Poses are right, and ready for every kind of reader.

use crate::common::{
    ComputeReader, DrawReader, Host, assert_right, change, copy, decoded, messages, on_every_adapter, packed,
    submit_and_read, uploaded,
};
use crate::{head, testing};
use deltamorph::{BatchSize, CrowdDesc, DeltaFormat, PackedMesh, PoseFormat, Semantic, UpdateDesc, UpdatePath};
use deltamorph_head::Rng;
use deltamorph_wgpu::Morph;

#[test]
fn the_example_draws_a_moving_head() {
    on_every_adapter(|host| {
        let [first, last] = [1, 43].map(|frames| head::draw(&host.device, &host.queue, frames).expect("a picture"));
        let pixels = |picture: &[u8]| picture.as_chunks::<4>().0.to_vec();
        let (first, last) = (pixels(&first), pixels(&last));
        let fraction = |count: usize| count as f64 / first.len() as f64;
        let drawn = fraction(last.iter().filter(|pixel| pixel[0] > 0).count());
        assert!((0.2..0.8).contains(&drawn), "{drawn} of the pixels show the head");
        let moved = fraction(first.iter().zip(&last).filter(|(a, b)| a[0].abs_diff(b[0]) > 2).count());
        assert!(moved > 0.005, "{moved} of the pixels differ");
    });
}

#[test]
fn draws_copies_and_compute_passes_of_one_submit_read_the_pose() {
    on_every_adapter(|host| {
        let (morph, mesh, uploaded, mut weights) = uploaded(&host, DeltaFormat::Fast);
        for (format, slots) in PoseFormat::ALL.into_iter().flat_map(|format| [(format, 1), (format, 2)]) {
            let desc = CrowdDesc::new(UpdateDesc { pose: format, slots, ..UpdateDesc::blocks() });
            let mut crowd = morph.create_crowd(&uploaded, &desc).expect("a crowd");
            let (mut rng, mut readers, mut read) = (Rng::new(7, 0), None, vec![]);
            // No waits between frames but those of `update`.
            for _ in 0..8 {
                change(&mut rng, &mut weights);
                crowd.set_weights(0, &weights).expect("weights");
                let update = morph.update([&mut crowd]).expect("an update");
                assert!(update.is_some());
                let pose = crowd.pose(0).expect("a pose");
                let previous = crowd.previous_pose(0).expect("a pose");
                assert!(previous.is_some() || slots == 1);
                let bound: Vec<_> = [Some(pose), previous.filter(|_| slots > 1)].into_iter().flatten().collect();
                let (draw, compute) = readers.get_or_insert_with(|| {
                    (DrawReader::new(&host, &pose.view, slots > 1), ComputeReader::new(&host, &pose.view))
                });
                let mut encoder = host.device.create_command_encoder(&Default::default());
                let drawn = draw.record(&host, &mut encoder, &bound);
                let copied = copy(&host, &mut encoder, &pose);
                let computed = compute.record(&host, &mut encoder, &pose);
                host.queue.submit(update.into_iter().chain([encoder.finish()]));
                read.push((drawn, copied, computed, pose.view, weights.clone()));
            }
            let mut before = None::<Vec<f32>>;
            for (drawn, copied, computed, view, weights) in read {
                let copied = decoded(&host.read(&copied), &view);
                assert_right(&copied, &mesh, &weights, format, "a copy");
                let [computed, drawn] = [&computed, &drawn].map(|it| PoseFormat::Float32.decode(&host.read(it), None));
                assert_right(&computed, &mesh, &weights, format, "a compute pass");
                assert_right(&drawn[..copied.len()], &mesh, &weights, format, "a draw");
                // With one slot the previous pose is not kept.
                if let Some(before) = before.replace(weights).filter(|_| slots > 1) {
                    assert_right(&drawn[copied.len()..], &mesh, &before, format, "the previous pose of a draw");
                }
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
        let mut rng = Rng::new(3, 0);
        for _ in 0..5 {
            for (_, weights, crowd) in &mut heads {
                change(&mut rng, weights);
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
        let bytes = host.read(&copy);
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
    let adapter = pollster::block_on(wgpu::Instance::new(desc).request_adapter(&Default::default()));
    let noop = Host::new(&adapter.expect("the backend of no device"));
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
