//! The picture of a report: the mesh, and the part of it that one frame of a workload changes.

use super::machine::Machine;
use super::record::Face;
use super::workload::Workload;
use crate::args::render::Background;
use crate::input::Input;
use crate::output::Failure;
use crate::render::canvas::Canvas;
use crate::render::scenery::Subject;
use crate::runner::packed;
use deltamorph::{BatchSize, CpuCrowd, DeltaFormat, UpdateDesc, UpdatePath};
use deltamorph_render::{Camera, Light, Poses, Scene, Show, StoredPose, Studio, StudioDesc};
use glam::Mat4;

/// Pixels of each picture.
const SIZE: [u32; 2] = [400, 440];
const BACKGROUND: Background = Background(Some([0x23, 0x26, 0x2d]));

/// Draws `input` in a frame of `workload` with the median number of changed targets. `None` without a report folder, a
/// device, faces, or any change.
pub fn draw(machine: &Machine<'_>, input: &Input, workload: &Workload) -> Result<Option<Face>, Failure> {
    let (args, mesh) = (machine.args, &input.kept);
    let Some(gpu) = machine.gpu.as_ref().filter(|_| args.folder().is_some() && !mesh.faces.sizes.is_empty()) else {
        return Ok(None);
    };
    let changed = |frame: usize| -> Vec<bool> {
        let (now, before) = (workload.weights(0, frame), workload.weights(0, frame - 1));
        now.iter().zip(&before).map(|(now, before)| now != before).collect()
    };
    let count = |changed: &[bool]| changed.iter().filter(|changed| **changed).count();
    let mut frames: Vec<(usize, usize)> = (1..workload.period()).map(|frame| (count(&changed(frame)), frame)).collect();
    frames.retain(|(count, _)| *count > 0);
    frames.sort_unstable();
    let Some(&(changed_targets, frame)) = frames.get(frames.len() / 2) else { return Ok(None) };
    let (mut now, mut before) = (workload.weights(0, frame), workload.weights(0, frame - 1));
    // Random weights of all targets at once distort the face: unchanged targets are drawn at rest, which changes the
    // same blocks.
    let whole = workload.changed.is_none();
    if !whole {
        before.fill(0.0);
        now.iter_mut().zip(changed(frame)).for_each(|(weight, changed)| *weight *= f32::from(u8::from(changed)));
    }
    let packed = packed(input, Some(gpu.engine()), DeltaFormat::Fast, &args.update.pack)?;
    let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All).slots(1).weight_max(args.update.pack.weight_max);
    let mut crowd = CpuCrowd::new(packed.clone(), update, 1, args.update.threads.unwrap_or(0))?;
    for weights in [&before, &now] {
        crowd.set_weights(0, weights)?;
        crowd.update();
    }
    let (changed, index) = (crowd.changed(0), packed.layout().blocks.clone());
    let Some(index) = index else { return Ok(None) };

    let subject = Subject::new(args.input.input.as_deref(), input);
    let desc = StudioDesc { size: SIZE, heads: 1, in_flight: 2, update, afterglow: 0.0, cull: false };
    let mut studio = Studio::new(gpu, mesh, &packed, &subject.parts, desc)?;
    let camera = Camera { yaw: 18.0, pitch: 4.0, ..Camera::default() };
    let view = camera.fit(subject.focus.iter().copied(), SIZE[0] as f32 / SIZE[1] as f32, 0.08);
    let mut canvas = Canvas::new([2 * SIZE[0], SIZE[1]], BACKGROUND);
    for show in [Show::Shaded, Show::Blocks] {
        let (scene, pose) = (Scene { view, light: Light::default(), show }, crowd.stored_pose(0, 0)?);
        let pose = StoredPose { pose, units: [1.0; 2], changed: &changed, masks: None };
        studio.draw(Poses::Stored(&[pose]), &[Mat4::IDENTITY], &scene, BACKGROUND.linear())?;
    }
    for (i, picture) in (0..).zip(studio.finish()?) {
        canvas.put(&Canvas::from(picture), [i * SIZE[0], 0]);
    }
    Ok(Some(Face {
        workload: workload.name.clone(),
        frame,
        changed: changed_targets,
        whole,
        blocks: changed.len(),
        all_blocks: index.count(),
        block_size: index.size(),
        size: canvas.size,
        png: canvas.png()?,
    }))
}
