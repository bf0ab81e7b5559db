//! Poses in interleaved host vertices: bit for bit equal to those in the engine's buffers, with as many passes and
//! barriers; nothing else of a vertex is written.

use crate::prelude::*;
use deltamorph::StreamView;

/// Initial bytes of the host's buffer.
const POISON: u8 = 0xff;
/// The host's bytes after the poses.
const BEHIND: usize = 52;
fn head_desc() -> HeadDesc {
    HeadDesc { vertices: 500, targets: 37, sparsity: 0.15, seed: 3 }
}

fn packed(headless: &Headless, format: DeltaFormat, with_streams: bool) -> Arc<PackedMesh> {
    let mesh = head(&head_desc()).kept(Tolerance::default()).expect("a mesh");
    let mesh = if with_streams { testing::with_streams(mesh) } else { mesh };
    Arc::new(gpu::packed(headless.engine(), &mesh, format))
}

fn weights(mesh: &PackedMesh, frame: u32, seed: u32) -> Vec<f32> {
    gpu::weights(mesh, frame, seed).iter().map(|weight| weight / 2.0).collect()
}

/// Vertices of 4-byte numbers: that of the issue, normals first with an odd stride, positions alone, and five streams
/// in a vertex of 80 bytes, of which one is left out.
fn vertices(with_streams: bool) -> Vec<(VertexLayout, u64)> {
    use Semantic::*;
    let wide = VertexLayout::new(48).stream(Position, 0).stream(Normal, 12);
    match with_streams {
        false => vec![
            (wide, 0),
            (VertexLayout::new(28).stream(Normal, 0).stream(Position, 16), 268),
            (VertexLayout::new(16).stream(Position, 4), 4),
        ],
        true => vec![
            (wide.stream(Tangent, 24).stream(TexCoord(0), 40), 48),
            (VertexLayout::new(80).stream(Color(0), 0).stream(Position, 20).stream(Tangent, 40).stream(Normal, 64), 0),
        ],
    }
}

/// Vertices of `fixed16` numbers, which stay together.
fn vertices_of_halves(with_streams: bool) -> Vec<(VertexLayout, u64)> {
    use Semantic::*;
    let wide = VertexLayout::new(48).stream(Position, 4).stream(Normal, 10);
    match with_streams {
        false => vec![(wide, 0), (VertexLayout::new(12).stream(Position, 0), 8)],
        true => vec![(wide.stream(Tangent, 32).stream(TexCoord(0), 40), 260)],
    }
}

/// The host's buffer, poisoned, and the poses in it.
struct Host<'a> {
    host: &'a Buffers<'a>,
    shared: Shared,
    poses: HostPoses,
}

impl<'a> Host<'a> {
    fn new(host: &'a Buffers<'a>, (vertex, offset): (VertexLayout, u64), bytes: u64) -> Self {
        let shared = host.shared((offset + bytes) as usize + BEHIND);
        host.fill(&shared, u32::from_ne_bytes([POISON; 4]));
        // SAFETY: it is large enough, lives as long as all crowds here, and nothing else uses it while an update runs.
        let poses = unsafe { HostPoses::new(shared.buffer, offset, vertex) };
        Self { host, shared, poses }
    }

    fn contents(&self) -> Vec<u8> {
        self.host.contents(&self.shared)
    }

    /// Asserts that bytes between streams and around poses are unchanged; `fixed16` groups are written whole.
    fn assert_guarded(&self, mut bytes: Vec<u8>, mesh: &PackedMesh, pose: PoseFormat, what: &str) {
        let (vertex, offset) = (self.poses.vertex(), self.poses.offset() as usize);
        let end = bytes.len() - BEHIND;
        for of_vertex in bytes[offset..end].chunks_mut(vertex.stride() as usize) {
            for group in mesh.groups() {
                for place in &group.layout().streams {
                    let Some(at) = vertex.offset(place.semantic) else { continue };
                    let (at, count) = (at as usize, place.semantic.components());
                    match pose == PoseFormat::Fixed16 {
                        true => of_vertex[at - 2 * place.first..][..12].fill(POISON),
                        false => of_vertex[at..][..4 * count].fill(POISON),
                    }
                }
            }
        }
        let written = bytes.iter().position(|byte| *byte != POISON);
        assert_eq!(written, None, "{what}: a byte of the host's was written");
    }
}

/// Returns the numbers of a stream of a pose of `vertices` vertices, decoded as a host would.
fn numbers(bytes: &[u8], view: &StreamView, vertices: usize) -> Vec<u32> {
    let components = view.components as usize;
    let size = if view.format == PoseFormat::Fixed16 { 2 } else { 4 };
    let number = |i: usize| {
        let (vertex, component) = (i / components, i % components);
        let at = view.offset as usize + vertex * view.stride as usize + component * size;
        let unit = view.units[component];
        let offset = view.offsets[component];
        match view.format {
            PoseFormat::Fixed16 => offset + f32::from(i16::from_ne_bytes(bytes[at..at + 2].try_into().unwrap())) * unit,
            PoseFormat::Fixed32 => offset + i32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap()) as f32 * unit,
            _ => f32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap()),
        }
    };
    (0..vertices * components).map(|i| number(i).to_bits()).collect()
}

/// Asserts that the streams of all poses in the host's buffer equal those of a crowd with the engine's buffers, and
/// that nothing else is written. `views`: of an instance in the host's buffer, now and before.
fn assert_equal(
    (mesh, heads): (&PackedMesh, u32),
    (host, pose_format): (&Host<'_>, PoseFormat),
    ours: &mut HeadlessCrowd<'_>,
    views: impl Fn(u32, Semantic) -> (deltamorph::Result<StreamView>, Option<StreamView>),
    what: &str,
) {
    let bytes = host.contents();
    let all = (0..heads).flat_map(|i| mesh.groups().iter().enumerate().map(move |group| (i, group)));
    for (instance, (number, group)) in all {
        let (pose, previous) = ours.read_group(instance, number).expect("a pose");
        for place in &group.layout().streams {
            let what = format!("{what}, instance {instance}, {}", place.semantic);
            let (view, before) = views(instance, place.semantic);
            let vertex = host.poses.vertex();
            let is_named = |semantic| vertex.offset(semantic).is_some();
            // `fixed16` numbers stay together.
            let together =
                pose_format == PoseFormat::Fixed16 && group.layout().streams.iter().any(|p| is_named(p.semantic));
            if !is_named(place.semantic) && !together {
                assert!(view.expect_err("no place").to_string().contains("VertexLayout"), "{what}");
                continue;
            }
            let view = view.expect("a stream");
            assert_eq!(view.stride, host.poses.vertex().stride(), "{what}");
            let of = |numbers: &[f32]| -> Vec<f32> {
                numbers.chunks_exact(6).flat_map(|vertex| vertex[place.components()].to_vec()).collect()
            };
            // In the host's buffer, poses are in the order of pose buffers.
            let in_order = |pose: &[f32]| {
                let mut packed = group.base().to_vec();
                for vertex in 0..group.layout().padded_vertices() {
                    if let Some(user) = group.layout().user_vertex(vertex) {
                        packed[6 * vertex..][..6].copy_from_slice(&pose[6 * user..][..6]);
                    }
                }
                of(&packed[..6 * group.layout().vertex_count]).iter().map(|x| x.to_bits()).collect::<Vec<_>>()
            };
            let vertices = group.layout().vertex_count;
            assert!(numbers(&bytes, &view, vertices) == in_order(&pose), "{what}");
            assert_eq!(before.is_some(), previous.is_some(), "{what}: the previous pose");
            if let (Some(before), Some(previous)) = (before, &previous) {
                let before = numbers(&bytes, &before, vertices);
                assert!(before == in_order(previous), "{what}: the previous pose");
            }
        }
    }
    host.assert_guarded(bytes, mesh, pose_format, what);
}

/// Runs `test` on devices without texels, whose sums have another order: with masks for single instances; clamped,
/// without them.
fn on_devices(test: impl Fn(&Headless)) {
    for driver in gpu::drivers() {
        let plain = gpu::limited(gpu::caps(&driver), |caps| caps.int64 = false);
        for limits in [plain, DeviceCaps::android_baseline()] {
            gpu::on_device_within(&driver, Some(limits), |headless, _| test(headless));
        }
    }
}

/// Makes a crowd with poses in the engine's buffers and one in the host's, runs `step` on both for some frames, and
/// compares. Float32, or decoded: the first instance has an output target, too, if `decodes` says so.
fn assert_alike<'a>(
    (host, mesh): (&Buffers<'_>, &PackedMesh),
    (place, desc): ((VertexLayout, u64), CrowdDesc),
    (frames, decodes): (u32, bool),
    make: impl Fn(&CrowdDesc) -> HeadlessCrowd<'a>,
    step: impl Fn(&mut HeadlessCrowd<'a>, u32) -> (Vec<Entry>, deltamorph::UpdateStats),
) {
    let CrowdDesc { instances, update, .. } = desc;
    let bytes = place.0.pose_bytes(mesh.layout()) * u64::from(instances * update.slots);
    let in_host = Host::new(host, place, bytes);
    let desc_of_host = CrowdDesc { poses: Some(in_host.poses), ..desc };
    assert_eq!(Crowd::pose_bytes(mesh, &desc_of_host), bytes);
    let (mut ours, mut theirs) = (make(&desc), make(&desc_of_host));
    let vertices = mesh.layout().vertex_count;
    let targets = [(); 2].map(|()| host.shared(24 * vertices));
    let decodes = decodes && place.0.offset(Semantic::Normal).is_some();
    for (crowd, target) in [&mut ours, &mut theirs].into_iter().zip(&targets).filter(|_| decodes) {
        let target = OutputTarget { stride: 24, normals: Some(12), ..OutputTarget::new(target.buffer) };
        // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
        unsafe { crowd.set_output_target(0, Some(&target)) }.expect("a target");
    }
    for frame in 0..frames {
        let what = format!("{update:?} {place:?}, frame {frame}");
        let [first, second] = [&mut ours, &mut theirs].map(|crowd| step(crowd, frame));
        assert!(first == second, "{what}: {first:?}, {second:?}");
        let views = |i, semantic| {
            let crowd = theirs.crowd();
            (crowd.stream(i, semantic), crowd.previous_stream(i, semantic).unwrap_or(None))
        };
        assert_equal((mesh, instances), (&in_host, update.pose), &mut ours, views, &what);
        for (semantic, first) in [(Semantic::Position, 0), (Semantic::Normal, 3)].into_iter().filter(|_| decodes) {
            let view = theirs.crowd().stream(0, semantic).expect("a stream");
            let expected = numbers(&in_host.contents(), &view, vertices);
            for target in &targets {
                let found = host.contents::<u32>(target);
                let found = found.chunks_exact(6).flat_map(|vertex| &vertex[first..first + 3]);
                assert!(expected.iter().eq(found), "{what}: {semantic}, decoded");
            }
        }
    }
}

#[test]
fn poses_in_the_hosts_vertices_are_ours_bit_for_bit_in_the_same_passes() {
    on_devices(|headless| {
        let host = Buffers::new(headless);
        let blocks =
            |format, pose, slots| (format, UpdateDesc { pose, slots, tolerance: 1e-2, ..UpdateDesc::blocks() });
        let cases = [
            (blocks(DeltaFormat::Fast, PoseFormat::Float32, 2), 3, false),
            (blocks(DeltaFormat::Small, PoseFormat::Float32, 1), 1, false),
            (blocks(DeltaFormat::Fast, PoseFormat::Float32, 2), 1, true),
            (blocks(DeltaFormat::Small, PoseFormat::Float32, 3), 2, true),
            (blocks(DeltaFormat::Fast, PoseFormat::Fixed32, 2), 3, true),
            (blocks(DeltaFormat::Small, PoseFormat::Fixed16, 2), 2, false),
            (blocks(DeltaFormat::Fast, PoseFormat::Fixed16, 2), 3, true),
        ];
        for ((format, update), heads, with_streams) in cases {
            let mesh = packed(headless, format, with_streams);
            let layouts = match update.pose {
                PoseFormat::Fixed16 => vertices_of_halves(with_streams),
                _ => vertices(with_streams),
            };
            let make = |desc: &CrowdDesc| HeadlessCrowd::new(headless, &mesh, desc).expect("a crowd");
            let step = |crowd: &mut HeadlessCrowd<'_>, frame: u32| {
                let asked: Vec<Vec<f32>> =
                    (0..heads).map(|i| weights(&mesh, frame - u32::from(frame == 6), i)).collect();
                crowd.set_hidden(heads - 1, heads > 1 && (2..4).contains(&frame)).expect("an instance");
                if frame == 5 {
                    let other = vec![0.5; mesh.layout().targets.len()];
                    let (_, lost) = crowd.record(&vec![&other[..]; heads as usize]).expect("a recording");
                    crowd.discard(lost.ticket).expect("a ticket");
                }
                if frame == 7 {
                    crowd.reset_history(0).expect("an instance");
                }
                let (step, commands, _) = gpu::recorded(crowd, &asked.iter().map(Vec::as_slice).collect::<Vec<_>>());
                (commands, step.update.stats)
            };
            for place in layouts {
                let desc = CrowdDesc { instances: heads, ..CrowdDesc::new(update) };
                assert_alike((&host, &mesh), (place, desc), (9, true), make, step);
            }
        }
    });
}

#[test]
fn heads_that_play_clips_are_written_into_the_hosts_vertices() {
    on_devices(|headless| {
        let host = Buffers::new(headless);
        let clips = [head_clip(&head_desc(), 40, 30.0)];
        for (pose, places) in [
            (PoseFormat::Fixed32, vertices(true)),
            (PoseFormat::Fixed16, vertices_of_halves(true)),
            (PoseFormat::Fixed32, vertices(false)),
        ] {
            for place in places {
                let mesh = packed(headless, DeltaFormat::Fast, place.0.offset(Semantic::Tangent).is_some());
                let make = |desc: &CrowdDesc| {
                    let animation = AnimationDesc::new(&clips);
                    let mut crowd = HeadlessCrowd::animated(headless, &mesh, desc, &animation).expect("a crowd");
                    (0..3).for_each(|i| {
                        crowd.play(i, &Playback { start: f64::from(i) * -0.1, ..Playback::new(0) }).expect("a clip")
                    });
                    crowd
                };
                let step = |crowd: &mut HeadlessCrowd<'_>, frame| {
                    crowd.set_time(f64::from(frame) / 30.0).expect("a time");
                    crowd.set_hidden(2, frame == 3).expect("an instance");
                    let (step, commands, _) = gpu::recorded(crowd, &[]);
                    (commands, step.update.stats)
                };
                let desc = CrowdDesc { instances: 3, ..CrowdDesc::new(UpdateDesc { pose, ..UpdateDesc::blocks() }) };
                assert_alike((&host, &mesh), (place, desc), (5, false), make, step);
            }
        }
    });
}
