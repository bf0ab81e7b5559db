//! Documented errors of the public API that no other test causes: messages name the problem and a remedy.

use crate::prelude::*;
use deltamorph::import::csv;
use deltamorph::{Result, WeightBounds};

fn says<T>(result: Result<T>, words: &str) {
    testing::says(result, &[words, "; "]);
}

fn packed(format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(&testing::mesh(100, 4), &PackDesc::new(format)).expect("a mesh")
}

#[test]
fn what_cannot_be_written_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let clip = |names: &[&str], value: f32| WeightClip {
        names: names.iter().map(|name| (*name).into()).collect(),
        values: vec![value; names.len()],
        fps: 30.0,
        ..WeightClip::default()
    };
    let path = folder.path().join("a.csv");
    says(csv::write(&path, &clip(&[], 0.0)), "has no columns");
    says(csv::write(&path, &clip(&["a", "a"], 0.0)), "'a'");
    says(csv::write(&path, &clip(&["a", ""], 0.0)), "column name '' does not read back");
    says(csv::write(&path, &clip(&["a", " b"], 0.0)), "column name ' b' does not read back");
    says(csv::write(&path, &clip(&["a"], f32::NAN)), "NaN");
    says(csv::write(folder.path(), &clip(&["a"], 0.0)), "cannot write");
    assert!(!path.exists());
    says(packed(DeltaFormat::Small).write(folder.path()), "cannot write");
    let dense = packed(DeltaFormat::Float32);
    says(dense.to_bytes(), "block format");
    says(dense.write(folder.path().join("a.dmorph")), "block format");
    says(dense.unpack(), "has no blocks");
}

#[test]
fn what_does_not_suit_the_packed_mesh_is_refused() {
    let dense = packed(DeltaFormat::Float32);
    says(dense.layout().remap_indices(&mut [0, 100]), "index 100 for mesh");
    let integers = UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() };
    says(WeightBounds::new(&dense, &integers), "fixed16 poses of float32 deltas");
    says(integers.grid(dense.layout()), "fixed16 poses of float32 deltas");
    says(dense.layout().grid(PoseFormat::Fixed32, None), "fixed32 poses of float32 deltas");
    says(packed(DeltaFormat::Fast).layout().grid(PoseFormat::Float32, None), "float32");
    let pose = evaluate(&dense, &[0.0; 4]);
    assert_eq!(pose, evaluate(&dense, &[]), "targets without a weight");
    says(reference::normals(&pose, &gpu::faces(&[3], &[0, 1, 100]), &[]), "names vertex 100");
    let (joints, weights) = (vec![0; 400], vec![1.0; 400]);
    let skin = |influences, of_joints: &[f32], method| {
        reference::skin(
            &pose,
            &SkinDesc { influences, joint_count: 1, joints: &joints, weights: &weights },
            method,
            of_joints,
        )
    };
    says(skin(4, &[0.0; 11], SkinMethod::Linear), "11 numbers for 1 joints; hand in 12");
    says(skin(4, &[0.0; 7], SkinMethod::DualQuaternion), "7 numbers for 1 joints; hand in 8");
    says(skin(5, &[0.0; 12], SkinMethod::Linear), "use 4 or 8 influences");

    for format in [DeltaFormat::Float32, DeltaFormat::Fast] {
        let mut crowd = gpu::cpu_crowd(&Arc::new(packed(format)), UpdateDesc::blocks(), 2);
        says(crowd.add(), "all in use");
        says(crowd.set_hidden(2, true), "instance 2 of a crowd of 2");
        says(crowd.remove(2), "instance 2 of a crowd of 2");
        crowd.remove(1).expect("an instance");
        says(crowd.remove(1), "instance 1 was removed");
        says(crowd.set_hidden(1, true), "instance 1 was removed");
        for (instance, words) in [(1, "instance 1 was removed"), (u32::MAX, "instance 4294967295 of a crowd of 2")] {
            says(crowd.reset_history(instance), words);
            says(crowd.set_weights(instance, &[0.0; 4]), words);
            says(crowd.pose(instance), words);
            says(crowd.previous_pose(instance), words);
            says(crowd.stored_pose(instance, 0), words);
        }
        crowd.update();
        says(crowd.group_pose(0, 1), "count groups from 0");
        says(crowd.previous_group_pose(0, 1), "count groups from 0");
        says(crowd.stored_pose(0, 1), "count groups from 0");
    }
}

/// A mesh, a crowd, and the uploads of post-morph passes, all of one engine.
struct Made {
    mesh: GpuMesh,
    crowd: Crowd,
    skin: GpuSkin,
    surface: GpuNormals,
}

fn make(headless: &Headless, packed: &PackedMesh) -> Made {
    let engine = headless.engine();
    let (joints, weights) = (vec![0; 400], vec![1.0; 400]);
    let skin = SkinDesc { influences: 4, joint_count: 1, joints: &joints, weights: &weights };
    let skin = gpu::skin(headless, packed, &skin).expect("a skin");
    let surface = gpu::surface(headless, packed).expect("a surface");
    let mesh = gpu::upload(headless, engine, packed);
    let dense = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
    let update = if packed.layout().format.is_blocks() { UpdateDesc::blocks() } else { dense };
    let crowd = engine.create_crowd(&mesh, &CrowdDesc { instances: 2, ..CrowdDesc::new(update) }).expect("a crowd");
    Made { mesh, crowd, skin, surface }
}

/// Asserts that every call for an instance is refused.
fn refused_everywhere(headless: &Headless, made: &mut Made, instance: u32, words: &str) {
    let engine = headless.engine();
    let Made { crowd, skin, surface, .. } = made;
    let null = vk::Buffer::null();
    let positions = [OutputStream::new(Semantic::Position, null)];
    // SAFETY: everything is refused, so no buffer is used.
    unsafe {
        for joints in [None, Some(Joints::new(skin, null, 48))] {
            let target = OutputTarget { joints, ..OutputTarget::new(&positions) };
            says(engine.set_output_target(crowd, instance, Some(&target)), words);
        }
        let normals = [OutputStream::new(Semantic::Normal, null)];
        says(engine.set_normals_target(crowd, instance, Some((surface, &OutputTarget::new(&normals)))), words);
        let mut readback = engine.readback();
        says(headless.run(|cmd| readback.record(cmd, crowd, &[instance])), words);
    }
}

#[test]
fn instances_that_are_not_there_and_other_engines_are_refused() {
    gpu::on_every_device(|headless, engine| {
        let packed = packed(DeltaFormat::Fast);
        let mut made = make(headless, &packed);
        let mut readback = engine.readback();
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        says(headless.run(|cmd| unsafe { readback.record(cmd, &made.crowd, &[0]) }), "instance 0 has no pose yet");
        // SAFETY: as above.
        headless.run(|cmd| unsafe { engine.record_update(cmd, &mut made.crowd) }).expect("an update");
        refused_everywhere(headless, &mut made, 2, "instance 2 of a crowd of 2");
        says(made.crowd.add(), "all in use");
        made.crowd.remove(1).expect("an instance");
        refused_everywhere(headless, &mut made, 1, "instance 1 was removed");
        for (instance, words) in [(1, "instance 1 was removed"), (2, "instance 2 of a crowd of 2")] {
            let crowd = &mut made.crowd;
            says(crowd.reset_history(instance), words);
            says(crowd.set_hidden(instance, true), words);
            says(crowd.remove(instance), words);
            says(crowd.set_joints(instance, 0), words);
            says(crowd.output(instance), words);
            says(crowd.pose(instance), words);
            says(crowd.previous_pose(instance), words);
            says(crowd.stream(instance, Semantic::Normal), words);
            says(crowd.previous_stream(instance, Semantic::Normal), words);
            says(crowd.weights(instance), words);
            says(crowd.set_weights(instance, &[0.0; 4]), words);
        }
        says(made.crowd.output(0), "set an output target, and record an update");
        says(made.crowd.stream(0, Semantic::Color(3)), "color 3");
        says(made.crowd.previous_stream(0, Semantic::Color(3)), "color 3");
        says(made.crowd.pose_buffer(Semantic::Color(3)), "color 3");

        // A second engine, on its own device.
        let other = gpu::device(&headless.caps().name, false, None);
        let mut of_other = make(&other, &packed);
        let words = "another MorphEngine";
        refused_everywhere(&other, &mut made, 0, words);
        let null = vk::Buffer::null();
        // SAFETY: everything is refused, so no buffer is used, and nothing is recorded.
        unsafe {
            let joints = Some(Joints::new(&of_other.skin, null, 48));
            let streams = [Semantic::Position, Semantic::Normal].map(|semantic| OutputStream::new(semantic, null));
            let target = OutputTarget { joints, ..OutputTarget::new(&streams) };
            let upload = "upload it with the crowd's engine";
            says(engine.set_output_target(&mut made.crowd, 0, Some(&target)), upload);
            let target = OutputTarget::new(&streams[1..]);
            says(engine.set_normals_target(&mut made.crowd, 0, Some((&of_other.surface, &target))), upload);
            says(headless.run(|cmd| engine.record_updates(cmd, &mut [&mut made.crowd, &mut of_other.crowd])), words);
        }
        let mut crowd = of_other.crowd;
        let words = "instance 2 of a crowd of 2";
        says(crowd.reset_history(2), words);
        says(crowd.set_hidden(2, true), words);
        says(crowd.remove(2), words);
        says(crowd.add(), "all in use");
        // The state is unchanged.
        // SAFETY: as above.
        headless.run(|cmd| unsafe { engine.record_update(cmd, &mut made.crowd) }).expect("an update");
        assert!(made.crowd.pose(0).is_ok());
    });
}

#[test]
fn meshes_without_vertices_are_refused() {
    gpu::on_every_device(|headless, engine| {
        let empty = PackedMesh::pack(&KeptMesh::default(), &PackDesc::new(DeltaFormat::Fast)).expect("nothing");
        let words = "has no vertices; leave it out";
        // SAFETY: it is refused: nothing is recorded.
        says(headless.run(|cmd| unsafe { engine.upload(cmd, &empty) }), words);
        let skin = SkinDesc { influences: 4, joint_count: 1, joints: &[], weights: &[] };
        says(gpu::skin(headless, &empty, &skin), words);
        says(gpu::surface(headless, &empty), words);
    });
}

#[test]
fn what_exceeds_the_device_is_refused_with_the_numbers() {
    let limits = gpu::baseline(|caps| (caps.max_texels, caps.max_storage_range) = (2, 4096));
    gpu::on_device_within(&gpu::one(), Some(limits), |headless, _| {
        let mut packed = packed(DeltaFormat::Fast);
        packed.faces = gpu::faces(&[3; 400], &[0, 1, 2].repeat(400));
        let (joints, weights) = (vec![0; 800], vec![1.0; 800]);
        let skin = SkinDesc { influences: 8, joint_count: 1, joints: &joints, weights: &weights };
        says(gpu::skin(headless, &packed, &skin), "allows 4096");
        says(gpu::surface(headless, &packed), "allows 4096");
    });
    let limits = gpu::baseline(|caps| caps.max_texels = 2);
    gpu::on_device_within(&gpu::one(), Some(limits), |headless, engine| {
        let Made { mut crowd, skin, .. } = make(headless, &packed(DeltaFormat::Fast));
        let joints = Some(Joints::new(&skin, vk::Buffer::null(), 48));
        let streams = [OutputStream::new(Semantic::Position, vk::Buffer::null())];
        let target = OutputTarget { joints, ..OutputTarget::new(&streams) };
        // SAFETY: it is refused, so no buffer is used.
        let refused = unsafe { engine.set_output_target(&mut crowd, 0, Some(&target)) };
        says(refused, "takes 4 texels");
    });
}

#[test]
fn a_direct_path_has_no_poses_for_what_comes_after() {
    gpu::on_every_device(|headless, engine| {
        let update = UpdateDesc::new(deltamorph_baselines::DIRECT, BatchSize::All);
        if engine.caps().check_path(update.path).is_err() {
            return;
        }
        let packed = gpu::packed(engine, &testing::mesh(100, 4), DeltaFormat::Float32);
        let (mut made, update) =
            (make(headless, &packed), UpdateDesc { mode: deltamorph::UpdateMode::Rebuild, ..update });
        made.crowd =
            engine.create_crowd(&made.mesh, &CrowdDesc { instances: 2, ..CrowdDesc::new(update) }).expect("a crowd");
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
        headless.run(|cmd| unsafe { engine.record_update(cmd, &mut made.crowd) }).expect("an update");
        refused_everywhere(headless, &mut made, 0, "direct");
        says(made.crowd.pose(0), "direct");
        says(made.crowd.pose_buffer(Semantic::Position), "direct");
        says(made.crowd.stream(0, Semantic::Normal), "direct");
    });
}

/// Vulkan reports the memory that a buffer needs, and so its largest size.
#[test]
fn buffers_that_are_too_small_are_refused_with_both_sizes() {
    gpu::on_every_device(|headless, engine| {
        let packed = packed(DeltaFormat::Fast);
        let Made { mut crowd, skin, surface, .. } = make(headless, &packed);
        let (_, _, device) = headless.handles();
        let buffer = |bytes| {
            let info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::STORAGE_BUFFER);
            // SAFETY: the device is alive; destroyed below.
            unsafe { device.create_buffer(&info, None) }.expect("a buffer")
        };
        let (small, large) = (buffer(1000), buffer(1 << 14));
        let end = |bytes: u32| format!("to byte {bytes} of a host buffer of at most 10");
        // SAFETY: everything is refused, so no buffer is used.
        unsafe {
            let normals = [OutputStream::new(Semantic::Normal, small)];
            says(engine.set_normals_target(&mut crowd, 0, Some((&surface, &OutputTarget::new(&normals)))), &end(1200));
            let positions = |buffer| OutputStream { stride: 24, ..OutputStream::new(Semantic::Position, buffer) };
            for (stream, joints, bytes) in [
                (OutputStream::new(Semantic::Position, small), None, 1200),
                (positions(small), Some((large, 48)), 2388),
                (OutputStream { second: Some((small, 4)), ..positions(large) }, Some((large, 48)), 2392),
                (positions(large), Some((small, 4096)), 4096),
            ] {
                let joints = joints.map(|(buffer, bytes)| Joints::new(&skin, buffer, bytes));
                let streams = [stream];
                let target = OutputTarget { joints, ..OutputTarget::new(&streams) };
                says(engine.set_output_target(&mut crowd, 0, Some(&target)), &end(bytes));
            }
            device.destroy_buffer(small, None);
            device.destroy_buffer(large, None);
        }
    });
}

#[test]
fn numbers_of_a_tuning_that_there_are_no_kernels_for_are_refused() {
    gpu::on_device(&gpu::one(), false, |headless, _| {
        let (instance, physical, device) = headless.handles();
        let made = |change: &dyn Fn(&mut DeviceTuning)| {
            let caps = gpu::limited(headless.caps().clone(), |caps| change(&mut caps.tuning));
            // SAFETY: the handles belong together, and outlive the engine.
            unsafe { MorphEngine::new(&DeviceDesc { caps: Some(caps), ..DeviceDesc::new(instance, physical, device) }) }
        };
        for width in [0, 3, 16] {
            says(made(&|tuning| tuning.widest_tile = width), "use 1, 2, 4 or 8 for widest_tile");
        }
        for lanes in [0, 129] {
            says(made(&|tuning| tuning.lanes = lanes), "1 to 128 for lanes");
        }
        says(made(&|tuning| tuning.load_cost = u32::MAX), "at most 1000 for load_cost");
        made(&|tuning| (tuning.widest_tile, tuning.lanes, tuning.load_cost) = (2, 128, 0)).expect("an engine");
    });
}
