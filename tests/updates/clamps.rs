//! The limits of weak devices, on real drivers: an engine with these limits keeps to them in every call; its poses
//! match the float64 reference, and its steps run.

use crate::gpu::baseline;
use crate::prelude::*;
use crate::watched::{log, watched};
use crate::written::Written;

/// Largest alignment of storage-buffer offsets on phones (`minStorageBufferOffsetAlignment`).
const ALIGNMENT: u64 = 256;
/// Most allocations alive at a time; Vulkan guarantees 4,096 (`maxMemoryAllocationCount`), which the host needs, too.
const ALLOCATIONS: usize = 48;

/// Limits, by source.
fn clamps() -> [(&'static str, DeviceCaps); 4] {
    [
        // They agree on the checked limits.
        ("VP_ANDROID_baseline_2021 and _2022", baseline(|_| {})),
        (
            "VP_ANDROID_vulkan_profile_2025",
            baseline(|caps| (caps.max_storage_buffers, caps.max_workgroup_invocations) = (35, 256)),
        ),
        ("allocations of 64 MiB", baseline(|caps| (caps.max_allocation, caps.max_buffer) = (64 << 20, 64 << 20))),
        // As small for this head as the others are for a large one: dense deltas are split into chunks.
        (
            "small",
            baseline(|caps| {
                (caps.max_storage_range, caps.max_workgroups) = (160 << 10, 50);
                (caps.max_allocation, caps.max_buffer) = (1 << 20, 1 << 20);
            }),
        ),
    ]
}

/// The most allocations that were alive at a time in these calls, each of which has to keep the limits.
fn most_alive(calls: &[String], limits: &DeviceCaps, what: &str) -> usize {
    let (mut alive, mut most) = (0, 0);
    for call in calls {
        let (before, _) = call.split_once(':').unwrap_or((call, ""));
        let numbers: Vec<u64> = before.split(' ').filter_map(|number| number.parse().ok()).collect();
        let kept = match (before.split(' ').next().unwrap_or_default(), &numbers[..]) {
            ("allocate", [bytes]) => {
                alive += 1;
                most = most.max(alive);
                *bytes <= limits.max_allocation && alive <= ALLOCATIONS
            }
            ("free", []) => {
                alive -= 1;
                true
            }
            ("buffer", [bytes]) => *bytes <= limits.max_buffer,
            ("set", [buffers]) => *buffers <= limits.max_storage_buffers.into(),
            ("descriptors", ranges) => {
                ranges.chunks(2).all(|range| range[0].is_multiple_of(ALIGNMENT) && range[1] <= limits.max_storage_range)
            }
            ("bind", offsets) => offsets.iter().all(|offset| offset.is_multiple_of(ALIGNMENT)),
            ("dispatch", counts) => counts.iter().all(|count| *count <= limits.max_workgroups.into()),
            ("push", [at, bytes]) => at + bytes <= limits.max_push_constants.into(),
            _ => true,
        };
        assert!(kept, "{what}: {call}");
    }
    assert_eq!(alive, 0, "{what}: memory that was not given back");
    most
}

/// Makes an engine within limits whose calls are written down.
fn engine(headless: &Headless, limits: &DeviceCaps) -> MorphEngine {
    let (_, physical, _) = headless.handles();
    let (instance, device) = watched(headless);
    let desc = DeviceDesc { caps: Some(limits.clone()), ..DeviceDesc::new(&instance, physical, &device) };
    // SAFETY: the handles belong together, and outlive the engine.
    unsafe { MorphEngine::new(&desc) }.expect("an engine")
}

/// Two instances, with post-morph passes: decoded; skinned, and normals of the surface.
fn check(headless: &Headless, engine: &MorphEngine, mesh: &KeptMesh, (format, update): (DeltaFormat, UpdateDesc)) {
    let what = format!("{} {format:?} {update:?}", headless.caps().name);
    let packed = gpu::packed(engine, mesh, format);
    let (vertices, diagonal) = (packed.layout().vertex_count, f64::from(packed.layout().diagonal));
    let host = Buffers::new(headless);
    let joint = [1.0f32, 0.0, 0.0, 7.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let joints = host.shared(48);
    let places = [(268, 40, Some(16)), (0, 24, Some(12)), (4, 12, None)];
    let outputs = places.map(|place| Written::new(&host, vertices, place));
    host.write(&joints, 0, &joint);
    let (names, shares) = (vec![0u16; 4 * vertices], [1.0f32, 0.0, 0.0, 0.0].repeat(vertices));
    // SAFETY: buffers are recording, run once and are waited for; everything they use lives until then.
    unsafe {
        let (mut uploaded, mut skin, mut surface) = headless
            .run(|cmd| {
                let skin = engine.upload_skin(
                    cmd,
                    &packed,
                    &SkinDesc { influences: 4, joint_count: 1, joints: &names, weights: &shares },
                )?;
                let surface = engine.upload_normals(cmd, &packed)?;
                Ok((engine.upload(cmd, &packed)?, skin, surface))
            })
            .expect(&what);
        uploaded.release_staging();
        skin.release_staging();
        surface.release_staging();
        let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
        let desc = CrowdDesc { instances: 2, consumers, ..CrowdDesc::new(update) };
        let mut crowd = engine.create_crowd(&uploaded, &desc).expect(&what);
        let stream = |output: usize, semantic, at| {
            let (offset, stride, _) = places[output];
            OutputStream { offset: offset + at, stride, ..OutputStream::new(semantic, outputs[output].buffer) }
        };
        let streams = [stream(0, Semantic::Position, 0), stream(0, Semantic::Normal, 16)];
        let decode = OutputTarget::new(&streams);
        engine.set_output_target(&mut crowd, 0, Some(&decode)).expect(&what);
        let joints = Some(Joints::new(&skin, joints.buffer, 48));
        let streams = [stream(1, Semantic::Position, 0), stream(1, Semantic::Normal, 12)];
        let target = OutputTarget { joints, ..OutputTarget::new(&streams) };
        engine.set_output_target(&mut crowd, 1, Some(&target)).expect(&what);
        let normals = [stream(2, Semantic::Normal, 0)];
        let recomputed = OutputTarget::new(&normals);
        engine.set_normals_target(&mut crowd, 1, Some((&surface, &recomputed))).expect(&what);
        let mut readback = engine.readback();
        for frame in 0..3 {
            let weights = [0, 1].map(|seed| -> Vec<f32> {
                gpu::weights(&packed, frame, seed).iter().map(|weight| weight / 2.0).collect()
            });
            (0..).zip(&weights).for_each(|(i, weights)| crowd.set_weights(i, weights).expect(&what));
            headless.run(|cmd| engine.record_update(cmd, &mut crowd).map(drop)).expect(&what);
            headless.run(|cmd| readback.record(cmd, &crowd, &[0, 1])).expect(&what);
            for (pose, weights) in readback.poses().expect(&what).iter().zip(&weights) {
                let error = compare(&pose.vertices, &gpu::reference(&packed, &update, weights));
                assert!(error.within(1e-5 * diagonal, NORMAL), "{what}, frame {frame}: {error:?}");
            }
            let taken = outputs.each_ref().map(|output| output.take().iter().flatten().count());
            assert!(taken.iter().all(|count| *count > 0), "{what}, frame {frame}: {taken:?} vertices are written");
        }
    }
}

#[test]
fn every_call_keeps_to_the_limits_and_poses_are_right() {
    let mesh = head(&HeadDesc { vertices: 900, targets: 37, sparsity: 0.15, seed: 3 });
    let mesh = mesh.kept(Tolerance::default()).expect("a mesh");
    let dense = |batch| (DeltaFormat::Float32, UpdateDesc::new(UpdatePath::Compute, batch));
    let updates = [
        (DeltaFormat::Fast, UpdateDesc::blocks()),
        (DeltaFormat::Small, UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }),
        dense(BatchSize::Targets(3)),
        dense(BatchSize::All),
    ];
    for (index, driver) in gpu::drivers().iter().enumerate() {
        let headless = gpu::device(driver, true, None);
        for (clamp, limits) in clamps() {
            // The limits decide the recorded commands, which one driver shows.
            if index > 0 && clamp != "small" {
                continue;
            }
            let limits = gpu::limited(headless.caps().clone(), |caps| caps.clamp_to(&limits));
            let engine = engine(&headless, &limits);
            for update in updates {
                check(&headless, &engine, &mesh, update);
            }
            if clamp == "allocations of 64 MiB" {
                let packed = gpu::packed(&engine, &mesh, DeltaFormat::Fast);
                let uploaded = gpu::upload(&headless, &engine, &packed);
                let desc = CrowdDesc { instances: 4000, ..CrowdDesc::new(UpdateDesc::blocks()) };
                crate::testing::says(engine.create_crowd(&uploaded, &desc), &["67108864"]);
            }
            drop(engine);
            let (calls, what) = (log(), format!("{}, {clamp}", headless.caps().name));
            let most = most_alive(&calls, &limits, &what);
            println!("{what}: {} calls, {most} allocations at most", calls.len());
            assert!(calls.len() > 100, "the calls are looked at");
        }
        assert_eq!(gpu::complaints(&headless), [""; 0], "{driver}");
    }
}
