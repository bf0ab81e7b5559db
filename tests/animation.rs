//! Animation on the GPU: weights, plans, sums and poses against the CPU twin, bit for bit.

#[path = "common/gpu.rs"]
mod gpu;
#[path = "common/scene.rs"]
mod scene;

use deltamorph::animation::{AnimationDesc, KeyFormat, Playback, Repeat};
use deltamorph::engine::CrowdDesc;
use deltamorph::headless::Headless;
use deltamorph::mesh::Tolerance;
use deltamorph::mesh::head::{HeadDesc, head, head_clip};
use deltamorph::mesh::packed::blocks::BlockDesc;
use deltamorph::mesh::packed::{DeltaFormat, PackDesc, PackedMesh};
use deltamorph::plan::{UpdateDesc, UpdateMode};
use deltamorph::weights::WeightClip;
use scene::{Scene, exact};
use std::sync::Arc;

const HEAD: HeadDesc = HeadDesc { vertices: 900, targets: 37, sparsity: 0.15, seed: 3 };

fn packed(format: DeltaFormat, size: u32) -> Arc<PackedMesh> {
    let mesh = head(&HEAD).to_mesh(Tolerance::default()).expect("a mesh");
    let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
    Arc::new(PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(format) }).expect("a mesh that packs"))
}

/// A captured-like clip, a short one in which all weights change, and one that is still.
fn clips() -> Vec<WeightClip> {
    let clip = head_clip(&HEAD, 40, 30.0);
    let noise = |i: usize| ((i as u32).wrapping_mul(0x9E37_79B9) >> 12) as f32 / (1 << 20) as f32 - 0.3;
    let values = |f: &dyn Fn(usize) -> f32, frames: usize| (0..frames * clip.names.len()).map(f).collect();
    let wild = WeightClip { fps: 12.0, values: values(&noise, 5), ..clip.clone() };
    let still = WeightClip { values: values(&|i| if i % 3 == 0 { 0.5 } else { 0.0 }, 1), ..clip.clone() };
    vec![clip, wild, still]
}

fn crowd(instances: u32, update: UpdateDesc) -> CrowdDesc {
    CrowdDesc { instances, update, frames_in_flight: 2 }
}

/// Numbers below `n`, the same everywhere.
fn dice(state: &mut u32, n: u32) -> u32 {
    *state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    (*state >> 16) % n
}

fn some_playback(state: &mut u32, now: f64) -> Playback {
    let speeds = [1.0, 0.5, -1.0, 3.0, 0.0, -0.25];
    Playback {
        clip: dice(state, 3),
        start: now + f64::from(dice(state, 20)) / 10.0 - 1.5,
        speed: speeds[dice(state, 6) as usize],
        repeat: if dice(state, 2) == 0 { Repeat::Loop } else { Repeat::Once },
    }
}

/// Heads that play, are hidden, shown and cut at random.
fn play_around(headless: &Headless, mesh: &Arc<PackedMesh>, desc: CrowdDesc, keys: KeyFormat, frames: u32) {
    let clips = clips();
    let mut scene = Scene::new(headless, mesh, desc, &AnimationDesc { clips: &clips, key_format: keys });
    let mut state = desc.instances * 31 + desc.update.slots;
    for frame in 0..frames {
        let now = f64::from(frame) / 24.0;
        for instance in scene.instances() {
            if dice(&mut state, if frame == 0 { 2 } else { 12 }) == 0 {
                scene.play(instance, some_playback(&mut state, now));
            }
            if dice(&mut state, 8) == 0 {
                scene.hide(instance, !scene.is_hidden(instance));
            }
        }
        scene.step(now);
        if frame % 4 == 3 {
            let shown: Vec<u32> = scene.instances().filter(|&i| !scene.is_hidden(i)).collect();
            shown.iter().step_by(1 + shown.len() / 5).for_each(|&instance| scene.assert_fresh(instance));
        }
    }
}

#[test]
fn the_gpu_plans_as_the_cpu_does() {
    gpu::on_every_device(|headless, _| {
        let formats = [(DeltaFormat::Fast, 64), (DeltaFormat::Small, 32), (DeltaFormat::Small, 128)];
        for (i, instances) in [1, 7, 8, 9, 33].into_iter().enumerate() {
            let (format, size) = formats[i % 3];
            let mesh = packed(format, size);
            for slots in [1, 2, 3] {
                let mode =
                    if (i as u32 + slots).is_multiple_of(4) { UpdateMode::Rebuild } else { UpdateMode::Incremental };
                let keys = if slots == 2 { KeyFormat::Bits16 } else { KeyFormat::Bits32 };
                play_around(headless, &mesh, crowd(instances, UpdateDesc { mode, ..exact(slots) }), keys, 16);
            }
        }
    });
}
