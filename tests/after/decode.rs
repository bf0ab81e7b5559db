//! The decode step: float32 positions in buffers of the host's own are those of the poses, bit for bit; only what
//! changed is written.

use crate::gpu;
use crate::offscreen::Offscreen;
use crate::written::Written;
use deltamorph::ash::vk;
use deltamorph::{
    AnimationDesc, Consumers, CpuCrowd, CrowdDesc, DecodeTarget, DeltaFormat, PackedMesh, Playback, PoseFormat,
    Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_head::{HeadDesc, head, head_clip};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::slice::from_mut;
use std::sync::Arc;

fn head_desc() -> HeadDesc {
    HeadDesc::default().vertices(900).targets(37).sparsity(0.15).seed(3)
}

fn packed(headless: &Headless, format: DeltaFormat) -> Arc<PackedMesh> {
    let mesh = head(&head_desc()).to_mesh(Tolerance::default()).expect("a mesh");
    Arc::new(gpu::packed(headless.engine(), &mesh, format))
}

/// A target, and its buffer.
struct Decoded<'a> {
    target: DecodeTarget,
    written: Written<'a>,
}

impl<'a> Decoded<'a> {
    fn new(headless: &Headless, host: &'a Offscreen<'a>, vertices: usize, place: (u64, u32, Option<u32>)) -> Self {
        let (offset, stride, normals) = place;
        let written = Written::new(headless, host, vertices, place);
        let target = DecodeTarget::new(written.buffer).offset(offset).stride(stride).normals(normals);
        Self { target, written }
    }

    fn take(&self, headless: &Headless) -> Vec<Option<Vec<u32>>> {
        self.written.take(headless)
    }

    /// The same of a pose.
    fn expected(&self, pose: &[f32]) -> Vec<Vec<u32>> {
        let numbers = if self.target.normals.is_some() { 6 } else { 3 };
        let vertex = |vertex: &[f32]| vertex[..numbers].iter().map(|x| x.to_bits()).collect();
        pose.chunks(6).take(self.written.vertices).map(vertex).collect()
    }
}

/// Weights up to 1, of which a few change from frame to frame.
pub fn weights(mesh: &PackedMesh, frame: u32, seed: u32) -> Vec<f32> {
    gpu::weights(mesh, frame, seed).iter().map(|weight| weight / 2.0).collect()
}

#[test]
fn what_is_decoded_is_the_pose_and_only_what_changed_is_written() {
    gpu::on_every_device(|headless, _| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        for (format, update) in gpu::updates(headless) {
            let mesh = packed(headless, format);
            let vertices = mesh.layout().vertex_count;
            let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
            let desc = CrowdDesc::new(update).instances(3).consumers(consumers);
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            // The twin's bits of float32 poses may differ: there, the device's own are decoded.
            let mut twin = update
                .pose
                .has_integers()
                .then(|| CpuCrowd::new(mesh.clone(), update.path(UpdatePath::Cpu), 3, 1).expect("a crowd"));
            let plain = Decoded::new(headless, &host, vertices, (0, 12, None));
            let wide = Decoded::new(headless, &host, vertices, (268, 40, Some(16)));
            let decoded = [(0, &plain), (2, &wide)];
            let mut held: [Vec<Vec<u32>>; 2] = Default::default();
            let mut fewer = 0;
            for frame in 0..16 {
                let what = format!("{} {format:?} {update:?}, frame {frame}", headless.caps().name);
                let whole = match frame {
                    // A frame without targets, then the first with them, in which one is still.
                    1 => {
                        for (instance, decoded) in decoded {
                            // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
                            unsafe { crowd.set_decode_target(instance, Some(&decoded.target)) }.expect("a target");
                        }
                        true
                    }
                    5 => {
                        // Whatever was recorded never runs.
                        let all: Vec<Vec<f32>> = (0..3).map(|i| weights(&mesh, 40, i)).collect();
                        let (_, dropped) =
                            crowd.record(&all.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a record");
                        crowd.discard(dropped.ticket).expect("a ticket");
                        true
                    }
                    8 | 10 => {
                        (0..3).for_each(|instance| crowd.set_hidden(instance, frame == 8).expect("an instance"));
                        frame == 10
                    }
                    12 => {
                        crowd.cut(0).expect("an instance");
                        false
                    }
                    _ => false,
                };
                let hidden = (8..10).contains(&frame);
                let still = [1, 7, 13].contains(&frame);
                let all: Vec<Vec<f32>> = (0..3).map(|i| weights(&mesh, frame - u32::from(still), i)).collect();
                let all: Vec<&[f32]> = all.iter().map(Vec::as_slice).collect();
                // SAFETY: nothing is changed.
                let (_, events) =
                    unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &all, |_| {}) }.expect(&what);
                if let Some(twin) = &mut twin {
                    (0..3).for_each(|i| twin.set_hidden(i, hidden).expect("an instance"));
                    (0..).zip(&all).for_each(|(i, weights)| twin.set_weights(i, weights).expect("weights"));
                    twin.update();
                }
                if still && !whole || hidden {
                    assert_eq!(events, [], "{what}: nothing changed");
                }
                for ((instance, decoded), held) in decoded.into_iter().zip(&mut held) {
                    let pose = match &twin {
                        Some(twin) => twin.pose(instance).expect("a pose").into_owned(),
                        None => bytemuck::cast_slice(&crowd.read_stored(instance, 0).expect("a pose")).to_vec(),
                    };
                    let (expected, written) = (decoded.expected(&pose), decoded.take(headless));
                    let count = written.iter().flatten().count();
                    match (frame, whole) {
                        (0, _) => assert_eq!(count, 0),
                        (_, true) => assert_eq!(count, vertices, "{what}"),
                        (_, false) => {
                            fewer += usize::from((1..vertices).contains(&count));
                            let changed = |v: &usize| !held.is_empty() && held[*v] != expected[*v];
                            let missed = (0..vertices).filter(changed).find(|v| written[*v].is_none());
                            assert_eq!(missed, None, "{what}: instance {instance} changed and was not written");
                        }
                    }
                    let wrong =
                        (0..vertices).find(|v| written[*v].as_ref().is_some_and(|vertex| *vertex != expected[*v]));
                    assert_eq!(wrong, None, "{what}: instance {instance}");
                    *held = expected;
                }
            }
            assert_eq!(fewer > 0, format.is_blocks(), "{format:?} {update:?}: parts of a pose");
            // SAFETY: nothing is running.
            unsafe { crowd.set_decode_target(0, None) }.expect("an instance");
            crowd.remove(2).expect("an instance");
            crowd.step(&[&vec![0.5; mesh.layout().targets.len()]]).expect("a step");
            assert!(decoded.iter().all(|(_, decoded)| decoded.take(headless).iter().flatten().count() == 0));
        }
    });
}

#[test]
fn heads_that_play_clips_are_decoded() {
    gpu::on_every_device(|headless, _| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        for pose in [PoseFormat::Fixed32, PoseFormat::Fixed16] {
            let mesh = packed(headless, DeltaFormat::Fast);
            let desc = CrowdDesc::new(UpdateDesc::blocks().pose(pose)).instances(9);
            let clips = [head_clip(&head_desc(), 40, 30.0)];
            let animation = AnimationDesc::new(&clips);
            let mut crowd = HeadlessCrowd::animated(headless, &mesh, &desc, &animation).expect("a crowd");
            (0..9).for_each(|i| crowd.play(i, &Playback::new(0).start(f64::from(i) * -0.1)).expect("a clip"));
            let decoded = Decoded::new(headless, &host, mesh.layout().vertex_count, (4, 24, Some(12)));
            // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
            unsafe { crowd.set_decode_target(8, Some(&decoded.target)) }.expect("a target");
            for frame in 0..5 {
                crowd.set_time(f64::from(frame) / 30.0).expect("a time");
                crowd.set_hidden(8, frame == 3).expect("an instance");
                crowd.step(&[]).expect("a step");
                let view = crowd.crowd().pose(8).expect("a pose");
                let stored = crowd.read_stored(8, 0).expect("a pose");
                let expected = decoded.expected(&pose.decode(&stored, mesh.base(), view.units));
                let written: Vec<_> = decoded.take(headless).into_iter().flatten().collect();
                assert!(written == if frame == 3 { vec![] } else { expected }, "{pose:?}, frame {frame}");
            }
        }
    });
}

#[test]
fn targets_that_do_not_fit_are_refused() {
    gpu::on_every_device(|headless, _| {
        let mesh = packed(headless, DeltaFormat::Fast);
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        let target = Decoded::new(headless, &host, mesh.layout().vertex_count, (0, 24, Some(12))).target;
        let mut refused = |instance, target: DecodeTarget| {
            // SAFETY: it is refused.
            unsafe { crowd.set_decode_target(instance, Some(&target)) }.expect_err("a refusal").to_string()
        };
        assert!(refused(1, target).contains("instance 1"));
        for wrong in
            [target.offset(2), target.stride(20), target.stride(26), target.normals(Some(8)), target.normals(Some(14))]
        {
            assert!(refused(0, wrong).contains("multiples of 4"), "{wrong:?}");
        }
        assert!(refused(0, target.stride(1 << 30)).contains("use a smaller stride"));
        // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
        unsafe { crowd.set_decode_target(0, Some(&target)) }.expect("a target");
    });
}
