//! Every Vulkan call of every operation of the library fails, one at a time, with each error that it may return: the
//! error names the call and a remedy, nothing leaks, the same operation succeeds afterwards, and poses are right.

use crate::prelude::*;
use deltamorph::{ReadPose, Result};
use deltamorph_failing::{arm, counts};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use vk::Result as Vk;

const TARGETS: usize = 8;
const VERTICES: usize = 300;
/// Errors of calls on a device. One is lost while it works, not while commands are recorded.
const ERRORS: [Vk; 7] = [
    Vk::ERROR_OUT_OF_HOST_MEMORY,
    Vk::ERROR_OUT_OF_DEVICE_MEMORY,
    Vk::ERROR_TOO_MANY_OBJECTS,
    Vk::ERROR_MEMORY_MAP_FAILED,
    Vk::ERROR_FRAGMENTED_POOL,
    Vk::ERROR_OUT_OF_POOL_MEMORY,
    Vk::ERROR_FRAGMENTATION,
];

/// Returns the defect of an error about a call that returned `result`.
fn wrong_with(error: &Error, call: &str, result: Vk) -> Option<String> {
    let text = error.to_string();
    // The allocator does not report the call; the engine reports the purpose of the memory.
    let names = text.contains(call)
        || (["vkAllocateMemory", "vkMapMemory"].contains(&call) && text.starts_with("no memory for '"));
    let memory =
        [Vk::ERROR_OUT_OF_HOST_MEMORY, Vk::ERROR_OUT_OF_DEVICE_MEMORY, Vk::ERROR_OUT_OF_POOL_MEMORY].contains(&result);
    let fits = match memory {
        true => matches!(error, Error::OutOfMemory { .. }) && !text.contains("bug") && !text.contains("report this"),
        false => !matches!(error, Error::Io { .. } | Error::Input { .. } | Error::DeviceLost { .. }),
    };
    (!names || !fits || !text.contains("; ")).then(|| format!("{error:?}: {text}"))
}

/// Operations that fail, and their objects.
struct Lab<'a> {
    headless: &'a Headless,
    /// Its device, whose calls may fail.
    device: ash::Device,
    failures: Cell<u32>,
    wrong: RefCell<BTreeSet<String>>,
}

impl Lab<'_> {
    /// Makes each call of `operation`, on the objects of `prepare`, fail with each error. The same operation follows in
    /// the same command buffer, and `check` verifies its result after it has run.
    fn each<S, T>(
        &self,
        name: &str,
        prepare: impl Fn() -> S,
        operation: impl Fn(&mut S, vk::CommandBuffer) -> Result<T>,
        check: impl Fn(S, T),
    ) {
        let before = self.failures.get();
        for error in ERRORS {
            for at in 1.. {
                let (mut state, mut failed) = (prepare(), false);
                let done = self.headless.run(|cmd| {
                    let alive = counts().alive;
                    arm(&format!("*:{at}:{}", error.as_raw()));
                    let tried = operation(&mut state, cmd);
                    let counts = counts();
                    arm("");
                    failed = counts.failed > 0;
                    let what = format!("{name}, {} returns {error:?}", counts.call);
                    match tried {
                        Err(e) if failed => {
                            self.failures.set(self.failures.get() + 1);
                            let wrong = wrong_with(&e, &counts.call, error).map(|wrong| format!("{what}: {wrong}"));
                            self.wrong.borrow_mut().extend(wrong);
                            // Finished kernels stay with the engine, for the next crowd.
                            let kernels = name.starts_with("create") || name.starts_with("set");
                            assert!(kernels || counts.alive == alive, "{what}: {alive} objects, then {}", counts.alive);
                            operation(&mut state, cmd)
                        }
                        // Lists that prefer device memory may be in host memory.
                        Ok(_) if failed => {
                            assert!(["vkAllocateMemory", "vkMapMemory"].contains(&&*counts.call), "{what}: nothing");
                            tried
                        }
                        _ => tried,
                    }
                });
                check(state, done.unwrap_or_else(|e| panic!("{name}, call {at}, {error:?}, again: {e}")));
                if !failed {
                    break;
                }
            }
        }
        println!("{name}: {} failures", self.failures.get() - before);
    }

    fn try_engine(&self) -> Result<MorphEngine> {
        let (instance, physical, _) = self.headless.handles();
        let caps = self.headless.caps();
        let desc = DeviceDesc { caps: Some(caps.clone()), ..DeviceDesc::new(instance, physical, &self.device) };
        let desc = DeviceDesc { transform_feedback_enabled: caps.transform_feedback.is_some(), ..desc };
        // SAFETY: the handles belong together, and outlive the engine, which goes before the test ends.
        unsafe { MorphEngine::new(&desc) }
    }

    fn engine(&self) -> MorphEngine {
        self.try_engine().expect("an engine")
    }

    /// Updates a crowd, and compares its poses with the reference.
    fn verify(&self, engine: &MorphEngine, crowd: &mut Crowd, mesh: &PackedMesh, asked: &[Vec<f32>]) {
        let mut readback = engine.readback();
        let all: Vec<u32> = (0..asked.len() as u32).collect();
        // SAFETY: the buffer is recording, runs once, and is waited for.
        let ran = self.headless.run(|cmd| unsafe {
            engine.record_update(cmd, crowd)?;
            readback.record(cmd, crowd, &all)
        });
        ran.expect("an update");
        // SAFETY: it has run.
        assert_right(unsafe { readback.poses() }.expect("poses"), mesh, asked);
    }

    /// Requests other weights for each instance, and verifies.
    fn pose(&self, engine: &MorphEngine, crowd: &mut Crowd, mesh: &PackedMesh, frame: usize) {
        let asked: Vec<_> = crowd.shown().map(|i| weights(frame + i as usize)).collect();
        (0..).zip(&asked).for_each(|(i, weights)| crowd.set_weights(i, weights).expect("weights"));
        self.verify(engine, crowd, mesh, &asked);
    }
}

fn weights(frame: usize) -> Vec<f32> {
    (0..TARGETS).map(|t| ((t * 7 + frame * 3) % 5) as f32 / 5.0).collect()
}

fn assert_right(poses: Vec<ReadPose>, mesh: &PackedMesh, asked: &[Vec<f32>]) {
    assert_eq!(poses.len(), asked.len());
    for pose in poses {
        let off = compare(&pose.vertices, &evaluate(mesh, &asked[pose.instance as usize])).position;
        assert!(off <= 1e-4 * f64::from(mesh.layout().diagonal), "instance {} is off by {off}", pose.instance);
    }
}

fn packed(engine: &MorphEngine, format: DeltaFormat) -> PackedMesh {
    gpu::packed(engine, &testing::mesh(VERTICES, TARGETS), format)
}

/// Returns names, formats and updates of all kinds of crowds. Those of 16 bits have a base pose of their own.
fn kinds() -> [(&'static str, DeltaFormat, UpdateDesc); 3] {
    let dense = |path| UpdateDesc::new(path, BatchSize::Targets(3));
    [
        ("blocks", DeltaFormat::Small, UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }),
        ("compute", DeltaFormat::Float32, dense(UpdatePath::Compute)),
        ("feedback", DeltaFormat::Float32, dense(UpdatePath::Feedback)),
    ]
}

/// Runs `test` with the validation layer below, and checks that nothing leaks.
fn in_lab(test: impl Fn(&Lab<'_>)) {
    let headless = gpu::device("llvmpipe", true, None);
    let (instance, _, device) = headless.handles();
    // SAFETY: both are alive, and belong together; what an engine of the lab makes, it destroys.
    let device = unsafe { deltamorph_failing::device(instance, device.handle()) };
    let lab = Lab { headless: &headless, device, failures: Cell::new(0), wrong: RefCell::default() };
    test(&lab);
    let counts = counts();
    assert_eq!((counts.alive, counts.unknown), (0, 0));
    assert!(lab.failures.get() > 0);
    let messages = gpu::complaints(&headless);
    assert!(messages.is_empty(), "{}", messages.join("\n"));
    let wrong: Vec<String> = lab.wrong.into_inner().into_iter().collect();
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
    println!("{} failures in all", lab.failures.get());
}

#[test]
fn engines_meshes_and_crowds_are_made_or_not() {
    in_lab(|lab| {
        lab.each("MorphEngine::new", || (), |(), _| lab.try_engine(), |(), _| ());
        for (kind, format, update) in kinds() {
            crowds(lab, kind, format, update);
        }
    });
}

fn crowds(lab: &Lab<'_>, kind: &str, format: DeltaFormat, update: UpdateDesc) {
    let engine = &lab.engine();
    let mesh = &packed(engine, format);
    lab.each(
        &format!("upload, {kind}"),
        || (),
        // SAFETY: the buffer is recording, runs once, and is waited for; so below.
        |(), cmd| unsafe { engine.upload(cmd, mesh) },
        |(), gpu| {
            let mut crowd = engine.create_crowd(&gpu, &CrowdDesc::new(update)).expect("a crowd");
            lab.pose(engine, &mut crowd, mesh, 1);
        },
    );
    let desc = CrowdDesc { instances: 3, ..CrowdDesc::new(update) };
    lab.each(
        &format!("create_crowd, {kind}"),
        || {
            // A new engine, which has no kernels yet.
            let engine = lab.engine();
            (gpu::upload(lab.headless, &engine, mesh), engine)
        },
        |(gpu, engine), _| engine.create_crowd(gpu, &desc),
        |(_, engine), mut crowd| lab.pose(&engine, &mut crowd, mesh, 2),
    );
    let gpu = gpu::upload(lab.headless, engine, mesh);
    let crowd = || {
        let mut crowd = engine.create_crowd(&gpu, &desc).expect("a crowd");
        lab.pose(engine, &mut crowd, mesh, 3);
        crowd
    };
    lab.each(
        &format!("readback, {kind}"),
        crowd,
        |crowd, cmd| {
            let mut readback = engine.readback();
            // SAFETY: as above.
            unsafe { readback.record(cmd, crowd, &[0, 1, 2]) }.map(|()| readback)
        },
        |_, mut readback| {
            // SAFETY: it has run.
            let poses = unsafe { readback.poses() }.expect("poses");
            assert_right(poses, mesh, &[weights(3), weights(4), weights(5)]);
        },
    );
    // Updates, even of several crowds together, make no calls that may fail.
    let none = lab.failures.get();
    lab.each(
        &format!("record_updates, {kind}"),
        || [crowd(), crowd()],
        |[a, b], cmd| {
            (0..3).try_for_each(|i| a.set_weights(i, &weights(6)).and(b.set_weights(i, &weights(7))))?;
            // SAFETY: as above.
            unsafe { engine.record_updates(cmd, &mut [a, b]) }
        },
        |crowds, _| crowds.into_iter().for_each(|mut crowd| lab.pose(engine, &mut crowd, mesh, 8)),
    );
    assert_eq!(lab.failures.get(), none);
}

#[test]
fn steps_after_the_pose_are_set_or_not() {
    in_lab(steps);
}

fn steps(lab: &Lab<'_>) {
    let (_, format, update) = kinds()[0];
    let (engine, host) = (&lab.engine(), Buffers::new(lab.headless));
    let mesh = &packed(engine, format);
    let (joints, shares) = (vec![0; 4 * VERTICES], [1.0, 0.0, 0.0, 0.0].repeat(VERTICES));
    let skin = SkinDesc { influences: 4, joint_count: 1, joints: &joints, weights: &shares };
    // SAFETY: the buffer is recording, runs once, and is waited for.
    let upload_normals = |cmd| unsafe { engine.upload_normals(cmd, mesh) };
    // SAFETY: as above.
    let upload_skin = |cmd| unsafe { engine.upload_skin(cmd, mesh, &skin) };
    lab.each("upload_normals", || (), |(), cmd| upload_normals(cmd), |(), _| ());
    lab.each("upload_skin", || (), |(), cmd| upload_skin(cmd), |(), _| ());
    let normals = lab.headless.run(upload_normals).expect("an upload");
    let skin = lab.headless.run(upload_skin).expect("an upload");
    let buffer = host.shared(1 << 16).buffer;
    let set = |name: &str, set: &dyn Fn(&MorphEngine, &mut Crowd) -> Result<()>| {
        lab.each(
            name,
            || {
                // A new engine, without kernels, for the pass that needs no objects of another engine.
                let own = (name == "set_output_target").then(|| lab.engine());
                let engine = own.as_ref().unwrap_or(engine);
                let gpu = gpu::upload(lab.headless, engine, mesh);
                let mut crowd = engine.create_crowd(&gpu, &CrowdDesc::new(update)).expect("a crowd");
                lab.pose(engine, &mut crowd, mesh, 1);
                (crowd, own)
            },
            |(crowd, own), _| set(own.as_ref().unwrap_or(engine), crowd),
            |(mut crowd, own), ()| {
                let engine = own.as_ref().unwrap_or(engine);
                lab.pose(engine, &mut crowd, mesh, 2);
                lab.pose(engine, &mut crowd, mesh, 3);
            },
        );
    };
    // SAFETY: the buffer is large enough, and dropped after the crowds; nothing is running. So below.
    let streams = [Semantic::Position, Semantic::Normal].map(|semantic| OutputStream::new(semantic, buffer));
    let target = OutputTarget::new(&streams[..1]);
    // SAFETY: as above.
    set("set_output_target", &|e, crowd| unsafe { e.set_output_target(crowd, 0, Some(&target)) });
    let target = OutputTarget::new(&streams[1..]);
    // SAFETY: as above.
    set("set_normals_target", &|e, crowd| unsafe { e.set_normals_target(crowd, 0, Some((&normals, &target))) });
    let joints = host.shared(48).buffer;
    let joints = Some(Joints::new(&skin, joints, 48));
    let target = OutputTarget { joints, ..OutputTarget::new(&streams[..1]) };
    // SAFETY: as above.
    set("set_output_target with joints", &|e, crowd| unsafe { e.set_output_target(crowd, 0, Some(&target)) });
}

#[test]
fn animated_crowds_are_made_or_not() {
    in_lab(animated);
}

fn animated(lab: &Lab<'_>) {
    let mesh = &packed(&lab.engine(), DeltaFormat::Fast);
    let clips = [gpu::clip(mesh, 1.0, (0..4).flat_map(weights).collect())];
    let animation = AnimationDesc::new(&clips);
    let desc =
        CrowdDesc { instances: 2, ..CrowdDesc::new(UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }) };
    lab.each(
        "create_animated_crowd",
        || {
            let engine = lab.engine();
            (gpu::upload(lab.headless, &engine, mesh), engine)
        },
        // SAFETY: the buffer is recording, runs once, and is waited for.
        |(gpu, engine), cmd| unsafe { engine.create_animated_crowd(cmd, gpu, &desc, &animation) },
        |(_, engine), mut crowd| {
            crowd.release_staging();
            (0..2).for_each(|i| crowd.play(i, &Playback::new(0)).expect("a clip"));
            for frame in 1..3 {
                crowd.set_time(frame as f64).expect("a time");
                lab.verify(&engine, &mut crowd, mesh, &vec![weights(frame); 2]);
            }
        },
    );
}
