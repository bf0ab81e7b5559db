//! Places of poses, known before the first update; additional usages; refused calls.

use crate::gpu::weights;
use crate::host::Host;
use crate::prelude::*;

fn packed(engine: &MorphEngine, format: DeltaFormat, with_streams: bool) -> PackedMesh {
    let mesh = testing::mesh(300, 11);
    let mesh: KeptMesh = if with_streams { testing::with_streams(mesh) } else { mesh };
    gpu::packed(engine, &mesh, format)
}

#[test]
fn where_poses_are_is_known_before_the_first_update() {
    on_every_device(|headless, engine| {
        for (format, update) in [
            (DeltaFormat::Fast, UpdateDesc::blocks()),
            (DeltaFormat::Fast, UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }),
            (DeltaFormat::Snorm16, UpdateDesc { slots: 3, ..UpdateDesc::new(UpdatePath::Compute, BatchSize::All) }),
        ] {
            let mesh = packed(engine, format, true);
            let desc =
                CrowdDesc { instances: 3, pose_usage: vk::BufferUsageFlags::INDIRECT_BUFFER, ..CrowdDesc::new(update) };
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            let semantics = [Semantic::Position, Semantic::Normal, Semantic::TexCoord(0), Semantic::Color(0)];
            let known = semantics.map(|semantic| crowd.crowd().pose_buffer(semantic).expect("a stream"));
            assert_eq!(known[0].first.buffer, known[1].first.buffer, "streams of a group share a buffer");
            assert_eq!(known[0].poses.1, known[0].pose_stride * 3 * u64::from(update.slots));
            let usage = vk::BufferUsageFlags::VERTEX_BUFFER | vk::BufferUsageFlags::INDIRECT_BUFFER;
            assert!(known.iter().all(|buffer| buffer.usage.contains(usage)));
            for frame in 0..3 {
                let asked =
                    [0, 1, 2].map(|seed| weights(&mesh, frame, seed).iter().map(|w| w / 2.0).collect::<Vec<_>>());
                crowd.step(&asked.each_ref().map(Vec::as_slice)).expect("a step");
                for (instance, (semantic, known)) in
                    (0..3).flat_map(|i| semantics.into_iter().zip(known).map(move |s| (i, s)))
                {
                    let view = crowd.crowd().stream(instance, semantic).expect("a stream");
                    let number = u64::from(instance * update.slots + view.slot);
                    let expected = known.first.offset + number * known.pose_stride;
                    assert_eq!((view.offset, view.buffer), (expected, known.first.buffer), "{semantic} {update:?}");
                    assert_eq!((view.stride, view.units), (known.first.stride, known.first.units));
                }
            }
            assert!(crowd.crowd().pose_buffer(Semantic::Tangent).is_ok());
            testing::says(crowd.crowd().pose_buffer(Semantic::TexCoord(3)), &["texcoord 3", "it has position"]);
        }
    });
}

#[test]
fn usages_that_the_device_was_not_said_to_allow_are_refused() {
    use vk::BufferUsageFlags as Usage;
    on_device(&gpu::one(), false, |headless, engine| {
        let mesh = packed(engine, DeltaFormat::Fast, false);
        let desc = CrowdDesc::new(UpdateDesc::blocks());
        for (usage, words) in [
            (Usage::SHADER_DEVICE_ADDRESS, "DeviceDesc::buffer_device_address"),
            (Usage::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR, "enable bufferDeviceAddress"),
            (Usage::VIDEO_DECODE_SRC_KHR, "MorphEngine::set_output_target"),
        ] {
            let text = HeadlessCrowd::new(headless, &mesh, &CrowdDesc { pose_usage: usage, ..desc })
                .err()
                .expect(words)
                .to_string();
            assert!(text.contains(words), "{text}");
        }
        // More than the device's largest buffer: its own limit is in the message.
        let most = engine.caps().max_allocation.min(engine.caps().max_buffer);
        let instances = (most / mesh.layout().pose_bytes(PoseFormat::Float32) + 1).min(u32::MAX.into()) as u32;
        testing::says(
            HeadlessCrowd::new(headless, &mesh, &CrowdDesc { instances, ..desc }),
            &[&format!("allocates at most {most}")],
        );
    });
}

/// Pose buffers with device addresses, from the engine's allocator and from the host's.
#[test]
fn pose_buffers_have_addresses_where_the_host_enabled_them() {
    for driver in gpu::drivers() {
        on_device(&driver, false, |headless, _| {
            let (instance, physical, _) = headless.handles();
            let name = ash::khr::buffer_device_address::NAME;
            // SAFETY: instance and physical device are alive.
            let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }.expect("extensions");
            if !extensions.iter().any(|found| found.extension_name_as_c_str() == Ok(name)) {
                eprintln!("{driver} has no {name:?}");
                assert_ne!(driver, "llvmpipe");
                return;
            }
            let host = Host::with(headless, true);
            for allocator in [None, Some(host.allocator(headless))] {
                let desc =
                    DeviceDesc { buffer_device_address: true, ..DeviceDesc::new(instance, physical, &host.device) };
                // SAFETY: the handles belong together, and outlive the engine; the device has the feature.
                let engine = unsafe { MorphEngine::new(&DeviceDesc { allocator, ..desc }) }.expect("an engine");
                let mesh = packed(&engine, DeltaFormat::Fast, true);
                let uploaded = host.upload(&engine, &mesh);
                let desc = CrowdDesc {
                    pose_usage: vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS,
                    ..CrowdDesc::new(UpdateDesc::blocks())
                };
                let crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                let functions = ash::khr::buffer_device_address::Device::new(instance, &host.device);
                for semantic in [Semantic::Position, Semantic::Tangent] {
                    let buffer = crowd.pose_buffer(semantic).expect("a stream").first.buffer;
                    let info = vk::BufferDeviceAddressInfo::default().buffer(buffer);
                    // SAFETY: the buffer is alive, and has the usage.
                    assert_ne!(unsafe { functions.get_buffer_device_address(&info) }, 0, "{driver} {semantic}");
                }
            }
        });
    }
}
