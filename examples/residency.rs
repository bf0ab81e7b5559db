//! The shapes of a head under a limit of device memory: those that a scene needs come, those that were needed longest
//! ago go.
//!
//!     cargo run --example residency [PART OF A DEVICE'S NAME]
//!
//! 104 shapes share room for a third of their deltas. Scenes of eight frames use six of them each; a swap that they need
//! is recorded into the command buffer of the update that follows. Every pose is read back and compared with the float64
//! reference. What a host brings itself (device, queue, fences) is `headless` here; `examples/minimal.rs` has all of it.

use deltamorph::reference::{compare, evaluate};
use deltamorph::{CrowdDesc, DeltaFormat, GpuMesh, PackedMesh, PoseError, TargetSwap, Tolerance, UpdateDesc};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};

const FRAMES: usize = 160;
const TARGETS: usize = 104;

/// The weights of a frame: shapes of its scene rise and fall.
fn weights(frame: usize) -> Vec<f32> {
    let (scene, phase) = (frame / 8, (frame % 8) as f32 / 8.0);
    let mut weights = vec![0.0; TARGETS];
    for shape in 0..6 {
        weights[(scene * 17 + shape * 5) % TARGETS] = (phase * std::f32::consts::PI).sin() + 0.01;
    }
    weights
}

/// When each shape was needed last, in frames counted from 1: what the host decides by.
struct Shapes {
    needed: Vec<usize>,
}

impl Shapes {
    /// What `frame` needs and is not on the device, and what may go for it.
    fn swap(&mut self, mesh: &PackedMesh, gpu: &GpuMesh, weights: &[f32], frame: usize) -> (Vec<usize>, Vec<usize>) {
        let needed = (0..weights.len()).filter(|&target| weights[target] != 0.0);
        let load: Vec<usize> = needed.clone().filter(|&target| !gpu.is_resident(target)).collect();
        let wanted: u64 = load.iter().map(|&target| mesh.target_bytes(target)).sum();
        let mut free = gpu.residency().map_or(0, |residency| residency.free());
        // Poses of the frame before hold what it needed: that cannot go yet.
        let idle =
            |&target: &usize| gpu.is_resident(target) && weights[target] == 0.0 && self.needed[target] + 1 < frame;
        let mut unload: Vec<usize> = (0..weights.len()).filter(idle).collect();
        unload.sort_by_key(|&target| self.needed[target]);
        let enough = unload.iter().position(|&target| {
            let is_enough = free >= wanted;
            free += mesh.target_bytes(target);
            is_enough
        });
        unload.truncate(enough.unwrap_or(unload.len()));
        needed.for_each(|target| self.needed[target] = frame);
        (load, unload)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let device = std::env::args().nth(1).map_or(DeviceChoice::Best, DeviceChoice::Name);
    let headless = Headless::new(&HeadlessDesc::default().device(device))?;
    let engine = headless.engine();
    let source = head(&HeadDesc::default().vertices(5_000).targets(TARGETS));
    let mesh = PackedMesh::pack(&source.to_mesh(Tolerance::default())?, &engine.pack_desc(DeltaFormat::Small))?;
    let all: u64 = (0..TARGETS).map(|target| mesh.target_bytes(target)).sum();

    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so in all that follows.
    let mut uploaded = headless.run(|cmd| unsafe { engine.upload_resident(cmd, &mesh, all / 3) })?;
    // SAFETY: the upload has run.
    unsafe { uploaded.release_staging() };
    let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks()))?;
    let mut readback = engine.readback();
    let mut shapes = Shapes { needed: vec![0; TARGETS] };
    let (mut worst, mut swaps, mut copied, mut most) = (PoseError::default(), 0, 0, 0);
    for frame in 1..=FRAMES {
        let weights = weights(frame);
        let (load, unload) = shapes.swap(&mesh, &uploaded, &weights, frame);
        let copies = headless.run(|cmd| {
            let swap = TargetSwap::default().load(&load).unload(&unload);
            // SAFETY: as above. A host that does not wait keeps what is returned until its fence says that it has run.
            let copies = unsafe { engine.record_swap(cmd, &mut uploaded, &mesh, &swap) }?;
            crowd.set_weights(0, &weights)?; // of a shape that is away it would be refused
            // SAFETY: as above.
            unsafe {
                let _update = engine.record_update(cmd, &mut crowd)?;
                readback.record(cmd, &crowd, &[0])?;
            }
            Ok(copies)
        })?;
        swaps += usize::from(copies.bytes() > 0);
        copied += copies.bytes();
        most = uploaded.residency().map_or(0, |residency| residency.used).max(most);
        // SAFETY: `run` has waited.
        for pose in unsafe { readback.poses() }? {
            worst = worst.max(compare(&pose.vertices, &evaluate(&mesh, &weights)));
        }
    }
    let error = worst.position / f64::from(mesh.layout().diagonal);
    println!(
        "{}: {FRAMES} frames, {most} of {all} bytes of deltas on the device, {swaps} swaps of {copied} bytes in all, within \
         {error:.1e} of the diagonal",
        engine.caps().name,
    );
    if error <= 1e-5 && most <= all / 3 { Ok(()) } else { Err("the poses differ from the reference".into()) }
}
