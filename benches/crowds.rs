//! Crowds on a device: what the GPU's planning costs, and thousands of heads. Medians.
//!
//! `./with-vulkan cargo bench -p deltamorph-benches --bench crowds [-- DEVICE]`

use deltamorph::{
    AnimatedCrowd, AnimationDesc, CrowdDesc, DeltaFormat, PackedMesh, Playback, PoseFormat, Tolerance, UpdateDesc,
    WeightClip,
};
use deltamorph_benches::{median, noise};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc, Step};
use std::time::Instant;

fn packed(headless: &Headless, desc: &HeadDesc) -> PackedMesh {
    let mesh = head(desc).to_mesh(Tolerance::default()).expect("the built-in head");
    PackedMesh::pack(&mesh, &headless.engine().pack_desc(DeltaFormat::Fast)).expect("a mesh that packs")
}

fn desc(instances: u32, update: UpdateDesc) -> CrowdDesc {
    CrowdDesc::new(update).instances(instances).frames_in_flight(1)
}

/// Clips of the face: one in which nothing moves, one in which a third of the weights change from frame to frame, and
/// one in which all do.
fn clips(mesh: &PackedMesh) -> Vec<WeightClip> {
    let names: Vec<String> = mesh.layout().targets.iter().map(|t| t.name.clone()).collect();
    let targets = names.len();
    let clip = |frames: usize, weight: &dyn Fn(usize, usize) -> f32| WeightClip {
        names: names.clone(),
        fps: 30.0,
        values: (0..frames).flat_map(|f| (0..targets).map(move |t| weight(f, t))).collect(),
        ..WeightClip::default()
    };
    vec![
        clip(1, &|_, t| noise(t)),
        clip(60, &|f, t| if (t + f) % 3 == 0 { noise(f * 71 + t) } else { noise(t) }),
        clip(60, &|f, t| noise(f * 71 + t)),
    ]
}

/// A crowd that plays `clip`, its heads a seventh of a second apart.
fn crowd<'a>(
    headless: &'a Headless,
    mesh: &PackedMesh,
    heads: u32,
    slots: u32,
    clip: u32,
) -> HeadlessCrowd<'a, AnimatedCrowd> {
    let update = UpdateDesc::blocks().pose(PoseFormat::Fixed16).slots(slots);
    let clips = clips(mesh);
    let animation = AnimationDesc::new(&clips);
    let mut crowd = HeadlessCrowd::animated(headless, mesh, &desc(heads, update), &animation).expect("a crowd");
    for head in 0..heads {
        let start = -f64::from(head) / 7.0;
        crowd.play(head, &Playback::new(clip).start(start)).expect("a clip");
    }
    crowd
}

/// Frames of a crowd that plays, the first few left out.
fn play(crowd: &mut HeadlessCrowd<'_, AnimatedCrowd>, frames: u32) -> Vec<Step> {
    let steps = (0..frames + 4).map(|frame| {
        crowd.set_time(f64::from(frame) / 60.0).expect("a time");
        crowd.step(&[]).expect("a step")
    });
    steps.skip(4).collect()
}

fn planned_on_the_gpu(headless: &Headless, mesh: &PackedMesh) {
    println!("animated on the GPU, 2,700 vertices, 52 targets, 17% sparse, fixed16 poses:");
    for (clip, what) in ["no weight changes", "a third change", "all change"].into_iter().enumerate() {
        let mut crowd = crowd(headless, mesh, 1000, 2, clip as u32);
        let gpu = median(play(&mut crowd, 15).iter().filter_map(|s| s.gpu_ms).collect());
        // One behind the other, before any of them runs: what is recorded does not depend on what moves.
        let recorded = (19..60u32).map(|frame| {
            crowd.set_time(f64::from(frame) / 60.0).expect("a time");
            let start = Instant::now();
            let (recorded, _) = crowd.record(&[]).expect("a recording");
            (recorded, start.elapsed().as_secs_f64() * 1e6)
        });
        let (recorded, times): (Vec<_>, Vec<f64>) = recorded.unzip();
        crowd.submit(recorded).expect("a device that runs them");
        let record = median(times);
        println!("  1,000 heads, {what}: recorded in {record:.1} µs; on the device {gpu:.2} ms, {gpu:.2} µs a head");
    }
    for heads in [100, 300, 1_000, 3_000, 10_000] {
        let steps = play(&mut crowd(headless, mesh, heads, 1, 1), 9);
        let gpu = median(steps.iter().filter_map(|s| s.gpu_ms).collect());
        println!(
            "  {heads} heads, a third change, one slot: {gpu:.2} ms, {:.2} µs a head",
            gpu * 1e3 / f64::from(heads)
        );
    }
}

fn main() {
    let name = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    let device = name.map_or(DeviceChoice::Best, DeviceChoice::Name);
    let headless = Headless::new(&HeadlessDesc::default().device(device)).expect("a Vulkan device");
    let caps = headless.caps();
    println!("{} ({} {})", caps.name, caps.driver, caps.driver_info);
    let mesh = packed(&headless, &HeadDesc::default().vertices(2_700).targets(52).sparsity(0.17));
    planned_on_the_gpu(&headless, &mesh);
}
