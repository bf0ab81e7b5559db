//! Every post-morph pass, under the same tests: a rig for each, and a test for each column of the resulting table.

use crate::gpu::{bits, recorded};
use crate::hazards::{Memory, barriers_needed};
use crate::joints::{JOINTS, Joints, MIRRORED};
use crate::prelude::*;
use crate::written::Written;
use deltamorph::Result;
use deltamorph::after;
use deltamorph::internals::plan::steps::{PostMorphPass, Resource};
use glam::DVec3;

/// Largest errors of skinned positions, as a fraction of the diagonal, and of their normals, in degrees; and of
/// recomputed normals.
const SKINNED: (f64, f64) = (1e-5, 0.01);
const RECOMPUTED: f64 = 0.5;

fn head_desc() -> HeadDesc {
    HeadDesc { vertices: 900, targets: 37, sparsity: 0.05, seed: 3 }
}

/// Makes a head with a seam in its texture coordinates, at which vertices are doubled.
fn mesh() -> KeptMesh {
    let source = head(&head_desc());
    let split = source.split().expect("a split head");
    assert!(split.positions.len() > source.positions.len(), "there is a seam");
    split.kept(Tolerance::default()).expect("a mesh")
}

/// Returns weights up to 1, of which few change between frames.
fn weights(mesh: &PackedMesh, frame: u32, seed: u32) -> Vec<f32> {
    let all = gpu::weights(mesh, frame, seed).into_iter().enumerate();
    all.map(|(t, weight)| if t % 5 == 0 { weight / 2.0 } else { 0.2 }).collect()
}

/// Returns joints and weights of every vertex: from one joint to all influences, unordered.
fn influences(vertices: usize, influences: u32) -> (Vec<u16>, Vec<f32>) {
    let mut rng = Rng::new(influences.into(), 0);
    let (mut joints, mut weights) = (vec![], vec![]);
    for vertex in 0..vertices {
        let used = 1 + vertex % influences as usize;
        for i in 0..influences as usize {
            let is_used = (i + vertex) % influences as usize % 8 < used;
            joints.push(if is_used { rng.below(MIRRORED as usize) as u16 } else { u16::MAX });
            weights.push(if is_used { rng.range(1e-3, 3.0) } else { 0.0 });
        }
        if vertex % 37 == 0 {
            // Alone: a mirrored joint combined with another may leave no volume, and no normals.
            let first = joints.len() - influences as usize;
            joints[first] = MIRRORED;
            weights[first..].fill(0.0);
            weights[first] = 0.25;
        }
    }
    (joints, weights)
}

fn skin_desc(influences: u32, (joints, weights): &(Vec<u16>, Vec<f32>)) -> SkinDesc<'_> {
    SkinDesc { influences, joint_count: JOINTS, joints, weights }
}

/// Returns the largest angle between normals, in degrees.
fn apart(found: &[DVec3], expected: &[f64]) -> f64 {
    let expected = expected.as_chunks::<3>().0.iter().map(|n| DVec3::from_array(*n));
    let angles = found.iter().zip(expected).filter(|(_, expected)| expected.length() > 0.5);
    angles.map(|(found, expected)| reference::angle_degrees(*found, expected)).fold(0.0, f64::max)
}

/// What a rig tests.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Pose,
    Skinned,
    Normals,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Pose, Self::Skinned, Self::Normals];

    fn output(self) -> Resource {
        match self {
            Self::Pose | Self::Skinned => PostMorphPass::Output.output(),
            Self::Normals => PostMorphPass::Normals.output(),
        }
    }
}

/// The inputs of a skin, and the joints that move it.
struct Skinned<'a> {
    skin: GpuSkin,
    per_vertex: u32,
    influences: (Vec<u16>, Vec<f32>),
    method: SkinMethod,
    joints: Joints<'a>,
    /// Bytes of the buffer that contain joints, and the offset of the first.
    joints_at: (u64, u64),
}

/// A pass of an instance: its target, and its outputs.
struct Rig<'a> {
    kind: Kind,
    mesh: Arc<PackedMesh>,
    source: &'a KeptMesh,
    streams: Vec<OutputStream>,
    /// The order of vertices in outputs: that of poses, or of the mesh.
    pose_order: bool,
    /// Written in turn, if there are two.
    outputs: Vec<Written<'a>>,
    /// The current contents, in the order of the packed mesh.
    held: Vec<Vec<f32>>,
    /// The previous output.
    before: Vec<f32>,
    skinned: Option<Skinned<'a>>,
    surface: Option<GpuNormals>,
}

impl<'a> Rig<'a> {
    /// Makes one of two targets of a step, which differ in all options.
    fn new(
        kind: Kind,
        which: usize,
        headless: &'a Headless,
        host: &'a Buffers<'a>,
        (source, mesh): (&'a KeptMesh, &Arc<PackedMesh>),
    ) -> Self {
        let vertices = mesh.layout().vertex_count;
        let (offset, stride, normals) = match (kind, which) {
            (Kind::Pose | Kind::Normals, 0) => (0, 12, None),
            (Kind::Normals, _) => (20, 28, None),
            (Kind::Skinned, 0) => (0, 24, Some(12)),
            _ => (268, 40, Some(16)),
        };
        let mut outputs = vec![Written::new(host, vertices, (offset, stride, normals))];
        // Two buffers of the same stride in turn, or one.
        if which == 0 && kind != Kind::Normals {
            outputs.push(Written::new(host, vertices, (offset + 4, stride, normals)));
        }
        let second = outputs.get(1).map(|other| (other.buffer, offset + 4));
        let stream = |semantic, at: u32| {
            let second = second.map(|(buffer, offset)| (buffer, offset + u64::from(at)));
            let offset = offset + u64::from(at);
            OutputStream { offset, stride, second, ..OutputStream::new(semantic, outputs[0].buffer) }
        };
        let streams = match kind {
            Kind::Normals => vec![stream(Semantic::Normal, 0)],
            Kind::Pose | Kind::Skinned => {
                let normals = normals.map(|at| stream(Semantic::Normal, at));
                [stream(Semantic::Position, 0)].into_iter().chain(normals).collect()
            }
        };
        let skinned = (kind == Kind::Skinned).then(|| {
            let method = [SkinMethod::Linear, SkinMethod::DualQuaternion][which];
            let few = (mesh.layout().format == DeltaFormat::Fast) == (which == 0);
            let per_vertex = if few { 4 } else { 8 };
            let influences = influences(vertices, per_vertex);
            let skin = gpu::skin(headless, mesh, &skin_desc(per_vertex, &influences)).expect("a skin");
            let joints = Joints::new(host, method, mesh.layout().diagonal);
            let joints_at = (3 * Joints::STRIDE, joints.offset());
            Skinned { skin, per_vertex, influences, method, joints, joints_at }
        });
        let surface = (kind == Kind::Normals).then(|| gpu::surface(headless, mesh).expect("a surface"));
        let held = outputs.iter().map(|_| vec![]).collect();
        let pose_order = which == 0;
        Self { kind, mesh: mesh.clone(), source, streams, pose_order, outputs, held, before: vec![], skinned, surface }
    }

    fn try_set(&self, crowd: &mut HeadlessCrowd<'_>, instance: u32, streams: &[OutputStream]) -> Result<()> {
        let joints = self.skinned.as_ref().map(|Skinned { skin, method, joints, joints_at, .. }| {
            let (bytes, offset) = *joints_at;
            after::Joints { offset, method: *method, ..after::Joints::new(skin, joints.shared.buffer, bytes) }
        });
        let target = OutputTarget { pose_order: self.pose_order, joints, ..OutputTarget::new(streams) };
        // SAFETY: the buffers are large enough, or it is refused; they live as long as the crowd; nothing is running.
        unsafe {
            match &self.surface {
                None => crowd.set_output_target(instance, Some(&target)),
                Some(surface) => crowd.set_normals_target(instance, Some((surface, &target))),
            }
        }
    }

    fn set(&self, crowd: &mut HeadlessCrowd<'_>, instance: u32) {
        self.try_set(crowd, instance, &self.streams).expect("a target");
    }

    fn unset(&self, crowd: &mut HeadlessCrowd<'_>, instance: u32) {
        // SAFETY: nothing is running.
        let unset = unsafe {
            match self.kind {
                Kind::Pose | Kind::Skinned => crowd.set_output_target(instance, None),
                Kind::Normals => crowd.set_normals_target(instance, None),
            }
        };
        unset.expect("an instance");
    }

    /// Moves the joints, if any, in some frames; returns whether all vertices are then to be written.
    fn move_joints(&mut self, crowd: &mut HeadlessCrowd<'_>, instance: u32, frame: u32) -> bool {
        let Some(skinned) = self.skinned.as_mut().filter(|_| [3, 11, 13].contains(&frame)) else { return false };
        // In one of them the same joints are set again.
        if frame != 11 {
            skinned.joints.turn(frame.into());
        }
        crowd.set_joints(instance, skinned.joints.offset()).expect("joints");
        true
    }

    /// Takes the written vertices into `held`, and counts them by output.
    fn take(&mut self) -> Vec<usize> {
        let Self { mesh, pose_order, .. } = self;
        let outputs = self.outputs.iter().zip(&mut self.held);
        let taken = outputs.map(|(output, held)| {
            let vertices = output.take();
            let width = if output.place.2.is_some() { 6 } else { 3 };
            held.resize(vertices.len() * width, f32::NAN);
            for (packed, held) in held.chunks_exact_mut(width).enumerate() {
                let at = if *pose_order { packed } else { mesh.layout().user_vertex(packed).expect("a vertex") };
                vertices[at].iter().flatten().zip(held).for_each(|(word, held)| *held = f32::from_bits(*word));
            }
            vertices.iter().flatten().count()
        });
        taken.collect()
    }

    /// Asserts that the output matches the pose, given as numbers in the order of the packed mesh, and the reference.
    fn assert_right(&self, output: usize, pose: &[f32], reference: &[f64], what: &str) {
        let (held, layout) = (&self.held[output], self.mesh.layout());
        match (self.kind, &self.skinned) {
            (Kind::Pose, _) => {
                let width = 3 * self.streams.len();
                for (held, pose) in held.chunks_exact(width).zip(pose.chunks_exact(6)) {
                    assert_eq!(bits(&held[..3]), bits(&pose[..3]), "{what}: not the pose");
                    let unit = glam::Vec3::from_slice(&pose[3..]).normalize_or_zero();
                    let is_unit = width == 3 || (glam::Vec3::from_slice(&held[3..]) - unit).length() < 1e-6;
                    assert!(is_unit, "{what}: {held:?} for {pose:?}");
                }
            }
            (Kind::Skinned, Some(Skinned { per_vertex, influences, method, joints, .. })) => {
                let desc = skin_desc(*per_vertex, influences);
                let expected = reference::skin(reference, &desc, *method, &joints.numbers).expect("a skinned pose");
                let mut padded = held.clone();
                padded.resize(layout.padded_vertices() * 6, f32::NAN);
                let error = compare(&layout.to_user_order(&padded), &expected);
                assert!(error.within(SKINNED.0 * f64::from(layout.diagonal), SKINNED.1), "{what}: {error:?}");
            }
            (Kind::Normals, _) | (Kind::Skinned, None) => {
                let Self { source, .. } = self;
                let expected = reference::normals(reference, &source.faces, &source.welds).expect("normals");
                let mut found = vec![DVec3::NAN; layout.vertex_count];
                for (packed, normal) in held.chunks_exact(3).enumerate() {
                    found[layout.user_vertex(packed).expect("a vertex")] = glam::Vec3::from_slice(normal).as_dvec3();
                }
                let off = apart(&found, &expected);
                assert!(off <= RECOMPUTED, "{what}: {off} degrees");
                assert!(found.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-5), "{what}: unit length");
                let welded = (0..found.len()).find(|v| found[*v] != found[self.source.welds[*v] as usize]);
                assert_eq!(welded, None, "{what}: a seam shows");
            }
        }
    }

    /// Checks the views of an output and the previous one, the former in the buffer that is returned; 0 for normals.
    /// `is_first`: there is no previous output.
    fn assert_view(&mut self, crowd: &Crowd, instance: u32, counts: &[usize], is_first: bool, what: &str) -> usize {
        if self.kind == Kind::Normals {
            return 0;
        }
        let view = crowd.output(instance).expect("an output");
        let places: Vec<_> = self.outputs.iter().map(|output| (output.buffer, output.place.0)).collect();
        let now = places.iter().position(|place| *place == view.current).expect("one of ours");
        let other = 1 - now;
        assert!(counts.get(other).is_none_or(|count| *count == 0), "{what}: {counts:?}");
        if is_first || counts.iter().all(|count| *count == 0) {
            assert_eq!(view.previous, Some(view.current), "{what}");
        } else {
            assert_eq!(view.previous, places.get(other).copied(), "{what}");
            assert!(places.len() == 1 || bits(&self.held[other]) == bits(&self.before), "{what}: previous");
        }
        self.before.clone_from(&self.held[now]);
        now
    }
}

#[test]
fn each_writes_the_reference_and_only_what_changed() {
    let source = mesh();
    gpu::on_every_driver(|headless, engine| {
        let host = Buffers::new(headless);
        for (kind, (format, update)) in
            Kind::ALL.into_iter().flat_map(|k| gpu::updates(headless).into_iter().map(move |u| (k, u)))
        {
            let mesh = Arc::new(gpu::packed(engine, &source, format));
            let vertices = mesh.layout().vertex_count;
            let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
            let desc = CrowdDesc { instances: 3, consumers, ..CrowdDesc::new(update) };
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            // Float32 poses may differ in bits from the twin's: compared with the device's own.
            let integers = update.pose.has_integers();
            let mut twin = gpu::cpu_crowd(&mesh, update, 3);
            let mut rigs =
                [0, 1].map(|which| (which * 2, Rig::new(kind, which as usize, headless, &host, (&source, &mesh))));
            let mut fewer = 0;
            for frame in 0..16 {
                let what = format!("{} {kind:?} {format:?} {update:?}, frame {frame}", headless.caps().name);
                match frame {
                    // A frame without targets, then the first with them, in which nothing moves.
                    1 => rigs.iter().for_each(|(instance, rig)| rig.set(&mut crowd, *instance)),
                    5 => {
                        // The recorded update never runs.
                        let (_, dropped) = crowd.record(&[&[0.1; 37][..]; 3]).expect("a record");
                        crowd.discard(dropped.ticket).expect("a ticket");
                        assert!(crowd.crowd().output(0).is_err());
                    }
                    8 | 10 => (0..3).for_each(|i| crowd.set_hidden(i, frame == 8).expect("an instance")),
                    12 => (0..3).for_each(|i| crowd.reset_history(i).expect("an instance")),
                    _ => {}
                }
                let (hidden, still) = ((8..10).contains(&frame), [1, 7, 13].contains(&frame));
                let mut whole = [1, 5, 10].contains(&frame);
                for (instance, rig) in &mut rigs {
                    whole |= rig.move_joints(&mut crowd, *instance, frame);
                }
                let all: Vec<Vec<f32>> = (0..3).map(|i| weights(&mesh, frame - u32::from(still), i)).collect();
                let all: Vec<&[f32]> = all.iter().map(Vec::as_slice).collect();
                let (.., events) = recorded(&mut crowd, &all);
                (0..3).for_each(|i| twin.set_hidden(i, hidden).expect("an instance"));
                (0..).zip(&all).for_each(|(i, weights)| twin.set_weights(i, weights).expect("weights"));
                twin.update();
                if still && !whole || hidden {
                    assert_eq!(events, [], "{what}: nothing changed");
                }
                for (instance, rig) in &mut rigs {
                    let (counts, what) = (rig.take(), format!("{what}, instance {instance}"));
                    let count: usize = counts.iter().sum();
                    match (frame, hidden || still, whole) {
                        (0, ..) | (_, true, false) => assert_eq!(count, 0, "{what}"),
                        (.., true) => assert_eq!(count, vertices, "{what}"),
                        (.., false) => fewer += usize::from((1..vertices).contains(&count)),
                    }
                    if frame == 0 || hidden {
                        assert!(frame > 0 || crowd.crowd().output(*instance).is_err());
                        continue;
                    }
                    let is_first = [1, 5, 10, 12].contains(&frame);
                    let output = rig.assert_view(crowd.crowd(), *instance, &counts, is_first, &what);
                    let pose = match integers {
                        true => twin.pose(*instance).expect("a pose").into_owned(),
                        false => bytemuck::cast_slice(&crowd.read_stored(*instance, 0).expect("a pose")).to_vec(),
                    };
                    let reference = gpu::reference(&mesh, &update, all[*instance as usize]);
                    rig.assert_right(output, &pose, &reference, &what);
                }
            }
            assert_eq!(fewer > 0, format.is_blocks(), "{kind:?} {format:?} {update:?}: parts of a pose");
            rigs[0].1.unset(&mut crowd, 0);
            crowd.remove(2).expect("an instance");
            crowd.step(&[&[0.5; 37]]).expect("a step");
            assert!(rigs.iter_mut().all(|(_, rig)| rig.take().iter().all(|count| *count == 0)));
        }
    });
}

#[test]
fn each_follows_heads_that_play_clips() {
    let source = mesh();
    let clips = [head_clip(&head_desc(), 40, 30.0)];
    gpu::on_every_device(|headless, engine| {
        let host = Buffers::new(headless);
        let mesh = Arc::new(gpu::packed(engine, &source, DeltaFormat::Fast));
        for (kind, pose) in
            Kind::ALL.into_iter().flat_map(|k| [PoseFormat::Fixed32, PoseFormat::Fixed16].map(|p| (k, p)))
        {
            let desc = CrowdDesc { instances: 9, ..CrowdDesc::new(UpdateDesc { pose, ..UpdateDesc::blocks() }) };
            let animation = AnimationDesc::new(&clips);
            let mut crowd = HeadlessCrowd::animated(headless, &mesh, &desc, &animation).expect("a crowd");
            (0..9).for_each(|i| {
                crowd.play(i, &Playback { start: f64::from(i) * -0.1, ..Playback::new(0) }).expect("a clip")
            });
            let mut rig = Rig::new(kind, 1, headless, &host, (&source, &mesh));
            rig.set(&mut crowd, 8);
            for frame in 0..5 {
                let what = format!("{kind:?} {pose:?}, frame {frame}");
                crowd.set_time(f64::from(frame) / 30.0).expect("a time");
                crowd.set_hidden(8, frame == 3).expect("an instance");
                crowd.step(&[]).expect("a step");
                let hidden = frame == 3;
                assert_eq!(rig.take(), [if hidden { 0 } else { mesh.layout().vertex_count }], "{what}");
                if !hidden {
                    let stored = crowd.read_stored(8, 0).expect("a pose");
                    let decoded = pose.decode(&stored, Some(&crate::scene::grid(&mesh, &desc.update)));
                    let reference: Vec<f64> = crowd.read_pose(8).expect("a pose").into_iter().map(f64::from).collect();
                    rig.assert_right(0, &decoded, &reference, &what);
                }
            }
        }
    });
}

/// With one output or two in turn, if a step has the choice, and with moving joints, if it has joints.
#[test]
fn a_missing_barrier_around_each_is_found() {
    let source = mesh();
    gpu::on_every_device(|headless, engine| {
        let host = Buffers::new(headless);
        for (kind, which) in Kind::ALL.into_iter().flat_map(|kind| [0, 1].map(|which| (kind, which))) {
            // The pass without other inputs is tested with all kinds of poses.
            let updates = match kind {
                Kind::Pose => gpu::updates(headless),
                Kind::Skinned | Kind::Normals => vec![(DeltaFormat::Fast, UpdateDesc::blocks())],
            };
            for (format, update) in updates {
                let mesh = Arc::new(gpu::packed(engine, &source, format));
                let mut rig = Rig::new(kind, which, headless, &host, (&source, &mesh));
                let mut crowd = gpu::crowd(headless, &mesh, update);
                let (mut updates, mut read) = (vec![], vec![]);
                // The target is set when there is a pose: the next update runs only the step; so does one in which only
                // joints move.
                for frame in [0, 0, 1, 2, 2, 3] {
                    match updates.len() {
                        1 => rig.set(&mut crowd, 0),
                        4 => _ = rig.move_joints(&mut crowd, 0, 13),
                        _ => {}
                    }
                    updates.push(recorded(&mut crowd, &[&weights(&mesh, frame, 1)]).2);
                    let slot = crowd.crowd().pose(0).expect("a pose").slot;
                    let output = |(buffer, _)| u32::from(buffer != rig.outputs[0].buffer);
                    let view =
                        crowd.crowd().output(0).map(|view| [Some(output(view.current)), view.previous.map(output)]);
                    read.push((slot, view.unwrap_or([Some(0), None])));
                }
                let steps = updates[1].iter().filter(|event| matches!(event, Event::Step { .. })).count();
                assert_eq!(steps, 1, "{kind:?} {update:?}");
                let is_right = |updates: &[Vec<Event>]| {
                    let mut checker = HazardChecker::default();
                    checker.upload(asset_uploaded());
                    for (events, (slot, outputs)) in updates.iter().zip(&read) {
                        checker.update(events);
                        checker.draw(0, 0, *slot);
                        for output in outputs.iter().copied().flatten() {
                            checker.read_after(0, Memory::After { resource: kind.output(), instance: 0, output });
                        }
                    }
                    checker.finish().is_ok()
                };
                // With two outputs, the slot and the output that the third update writes have not been read before.
                let (which, least) = match (rig.outputs.len(), kind) {
                    (1, _) => (vec![1, 2, 3, 4, 5], 10),
                    // Without joints, the fourth update records nothing.
                    (_, Kind::Pose) => (vec![1, 3, 5], 8),
                    _ => (vec![1, 3, 4, 5], 9),
                };
                let found = barriers_needed(&updates, which, is_right);
                assert!(found >= least, "{kind:?} {update:?}: {found} barriers");
            }
        }
    });
}

#[test]
fn targets_that_do_not_fit_are_refused() {
    let source = mesh();
    gpu::on_every_device(|headless, engine| {
        let host = Buffers::new(headless);
        let mesh = Arc::new(gpu::packed(engine, &source, DeltaFormat::Fast));
        for kind in Kind::ALL {
            let mut rig = Rig::new(kind, 1, headless, &host, (&source, &mesh));
            let (fours, smaller) = ("multiples of 4", "use a smaller stride");
            let first = rig.streams[0];
            let mut refused = vec![
                (OutputStream { offset: 2, ..first }, fours),
                (OutputStream { stride: 8, ..first }, fours),
                (OutputStream { stride: 26, ..first }, fours),
                (OutputStream { second: Some((first.buffer, 2)), ..first }, fours),
                (OutputStream { stride: 1 << 30, ..first }, smaller),
                (OutputStream { offset: u64::MAX - 3, ..first }, "of a host buffer of at most"),
                (OutputStream { format: vk::Format::R32G32_SFLOAT, ..first }, "in the format R32G32_SFLOAT"),
                (OutputStream { format: vk::Format::R8G8B8A8_UNORM, ..first }, "A2B10G10R10_SNORM_PACK32"),
            ];
            if kind == Kind::Normals {
                refused.push((OutputStream { semantic: Semantic::Position, ..first }, "Semantic::Normal"));
            } else {
                refused.push((OutputStream { format: vk::Format::R8G8B8A8_SNORM, ..first }, "use a float32 format"));
                refused.push((OutputStream { semantic: Semantic::Tangent, ..first }, "it has position, normal"));
            }
            let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::blocks());
            let text = |result: Result<()>| result.expect_err("a refusal").to_string();
            let apart = [first, OutputStream { second: Some((first.buffer, 0)), ..first }];
            let expected = if kind == Kind::Normals { "Semantic::Normal" } else { "to all streams, or to none" };
            assert!(text(rig.try_set(&mut crowd, 0, &apart)).contains(expected));
            assert!(text(rig.try_set(&mut crowd, 0, &[])).contains("streams"));
            for (stream, words) in refused {
                let found = text(rig.try_set(&mut crowd, 0, &[stream]));
                assert!(found.contains(words), "{kind:?}: {found}");
            }
            for (at, words) in [(16, "room for all joints"), (8, "multiple of 16"), (0, "")] {
                let Some(skinned) = &mut rig.skinned else { break };
                // Dual quaternions: room for them alone.
                skinned.joints_at = (u64::from(JOINTS) * 32, at);
                if at > 0 {
                    assert!(text(rig.try_set(&mut crowd, 0, &rig.streams)).contains(words));
                }
            }
            assert!(text(rig.try_set(&mut crowd, 1, &rig.streams)).contains("instance 1"));
            assert!(text(crowd.set_joints(0, 0)).contains("not skinned"));
            rig.set(&mut crowd, 0);
            if rig.skinned.is_some() {
                assert!(text(crowd.set_joints(0, 16)).contains("room for all joints"));
            }
            if rig.skinned.is_some() || rig.surface.is_some() {
                // Another packing of the same mesh has another order of vertices.
                let other = gpu::packed(engine, &source, DeltaFormat::Float32);
                let dense = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
                let refused = text(rig.try_set(&mut gpu::crowd(headless, &other, dense), 0, &rig.streams));
                assert!(refused.contains("the packed mesh that the crowd was made of"), "{refused}");
            }
        }
    });
}

#[test]
fn skins_and_surfaces_that_do_not_fit_are_refused() {
    let source = mesh();
    gpu::on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &source, DeltaFormat::Fast);
        let (joints, weights) = influences(mesh.layout().vertex_count, 4);
        let changed = |at: std::ops::Range<usize>, to: f32| {
            let mut wrong = weights.clone();
            wrong[at].fill(to);
            wrong
        };
        for (per_vertex, count, weights, words) in [
            (5, JOINTS, &weights, "use 4 or 8 influences"),
            (4, 0, &weights, "1 to 65536 joints"),
            (8, JOINTS, &weights, "hand in 7"),
            (4, 3, &weights, "names joint"),
            (4, JOINTS, &changed(5..6, -0.5), "vertex 1 has the weight -0.5"),
            (4, JOINTS, &changed(5..6, f32::NAN), "vertex 1 has the weight NaN"),
            (4, JOINTS, &changed(8..12, 0.0), "vertex 2 has weights that sum to 0"),
        ] {
            let desc = SkinDesc { influences: per_vertex, joint_count: count, joints: &joints, weights };
            crate::testing::says(gpu::skin(headless, &mesh, &desc), &[words]);
        }
        let refused = |sizes: &[u32], corners: &[u32], welds: &[u32], words: &str| {
            let mut mesh = mesh.clone();
            (mesh.faces, mesh.welds) = (gpu::faces(sizes, corners), welds.to_vec());
            let text = gpu::surface(headless, &mesh).err().expect("a refusal").to_string();
            assert!(text.contains(words), "{text}");
            text
        };
        refused(&[3, 3], &[0, 1, 2, 0, 1, u32::MAX], &[], "names vertex 4294967295");
        refused(&[3, 2], &[0; 5], &[], "face 1 has 2 corners");
        refused(&[u32::MAX, 7], &[0; 6], &[], "the corner list has 6");
        refused(&[3], &[0; 3], &[0], "1 welds for");
        // One polygon, whose fans take the square of its corners: counted before they are made.
        let sides = 10 + (headless.caps().max_storage_range as f64 / 8.0).sqrt() as u32;
        let polygon: Vec<u32> = (0..sides).map(|i| i % mesh.layout().vertex_count as u32).collect();
        let mut mesh = mesh.clone();
        mesh.faces = gpu::faces(&[sides], &polygon);
        let mut text = String::new();
        let memory = allocation_counter::measure(|| {
            text = gpu::surface(headless, &mesh).err().expect("a refusal").to_string();
        });
        assert!(text.starts_with("surface of mesh '") && text.contains("split the mesh"), "{text}");
        assert!(memory.bytes_max < 1 << 20, "{} bytes for a polygon of {sides} corners", memory.bytes_max);
    });
}
