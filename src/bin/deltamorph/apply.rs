//! `apply`: one pose, through the path named, written as OBJ in the input's vertex order.

use crate::args::ApplyArgs;
use crate::args::values::{BatchLimit, expand_batches};
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Runner, pack_desc};
use deltamorph::headless::DeviceChoice;
use deltamorph::mesh::MorphMesh;
use deltamorph::mesh::obj::{ObjMesh, write_obj};
use deltamorph::mesh::packed::{POSE_FLOATS, PackedMesh};
use deltamorph::plan::{BatchSize, UpdateDesc, UpdatePath};
use deltamorph::reference::{SHORTEST_NORMAL, compare, evaluate};
use deltamorph::weights::csv;
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

#[derive(Serialize)]
struct Applied {
    schema: u32,
    device: String,
    path: &'static str,
    format: &'static str,
    batch_size: String,
    frames: usize,
    passes: usize,
    active: usize,
    /// Against the float64 reference, in input units, and as a fraction of the diagonal.
    max_error: f64,
    max_error_rel: f64,
    output: String,
}

/// Run the command.
///
/// # Errors
/// The input, clip or path cannot be used; the result is wrong; the file cannot be written.
pub fn run(args: &ApplyArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    let path = args.path().map_err(Failure::Usage)?.update_path();
    let format = args.format().map_err(Failure::Usage)?.delta_format();
    let input = input::load(&args.input, out)?;
    let frames = frames(args, &input.kept)?;

    let gpu = if path == UpdatePath::Cpu { None } else { Gpu::open(device, out)? };
    let mesh = Arc::new(PackedMesh::pack(&input.kept, &pack_desc(gpu.as_ref(), format))?);
    let batch = batch(args, path, gpu.as_ref(), format)?;
    let desc = UpdateDesc { path, batch, mode: args.update.mode.update_mode(), slots: args.update.slots };
    desc.check().map_err(|e| Failure::Usage(e.to_string()))?;
    let mut runner = Runner::new(gpu.as_ref(), &mesh, desc, 1, args.update.threads.unwrap_or(0))?;
    let mut passes = 0;
    for weights in &frames {
        passes += runner.step(std::slice::from_ref(weights))?.stats.passes;
    }
    let pose = runner.pose(0)?;
    // There is at least one frame: `frames` sees to it.
    let weights = frames.last().map_or(&[][..], Vec::as_slice);
    let error = compare(&pose, &evaluate(&mesh, weights));
    let diagonal = f64::from(input.kept.diagonal);
    let relative = if diagonal > 0.0 { error.position / diagonal } else { error.position };
    if !error.within(1e-5 * diagonal.max(f64::MIN_POSITIVE), 0.1) && error.position != 0.0 {
        return Err(Failure::Failed(format!(
            "the pose through '{}' is off by {relative:.3e} of the diagonal; nothing was written; use --path cpu, \
             and report this with `deltamorph devices`",
            path.name()
        )));
    }
    write(args, &input.kept, &pose)?;
    let device = gpu.as_ref().map_or("none".into(), |g| g.caps().name.clone());
    out.say(format_args!(
        "{}: {} active of {} targets, {passes} passes on {} ({}), {relative:.1e} of the diagonal off the float64 reference",
        args.output.display(),
        weights.iter().filter(|w| **w != 0.0).count(),
        weights.len(),
        path.name(),
        if path == UpdatePath::Cpu { "the processor" } else { &device },
    ));
    out.json(&Applied {
        schema: 1,
        device,
        path: path.name(),
        format: format.name(),
        batch_size: batch.to_string(),
        frames: frames.len(),
        passes,
        active: weights.iter().filter(|w| **w != 0.0).count(),
        max_error: error.position,
        max_error_rel: relative,
        output: args.output.display().to_string(),
    })
}

/// The weights to step through, one or more frames, `--set` on top of each.
fn frames(args: &ApplyArgs, mesh: &MorphMesh) -> Result<Vec<Vec<f32>>, Failure> {
    let names: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
    let mut frames = match (&args.weights, args.frame) {
        (Some(path), Some(last)) => {
            let clip = csv::read(path, args.input.fps_of(path))?;
            let all = clip.bind(&names)?;
            let first = args.from_frame.unwrap_or(last);
            let count = all.len();
            if let Some(beyond) = [first, last].into_iter().find(|f| *f >= count) {
                return Err(Failure::Usage(format!(
                    "{}: has {count} frames, counted from 0; there is no frame {beyond}",
                    path.display()
                )));
            }
            // Backwards is fine, too: a delta weight may be negative.
            let order: Vec<usize> =
                if first <= last { (first..=last).collect() } else { (last..=first).rev().collect() };
            order.into_iter().map(|f| all[f].clone()).collect()
        }
        _ => vec![vec![0.0; names.len()]],
    };
    for setting in &args.set {
        let at = mesh.target_index(&setting.name).ok_or_else(|| {
            Failure::Usage(format!(
                "--set {}: no such target; `deltamorph info` lists the {} there are",
                setting.name,
                names.len()
            ))
        })?;
        frames.iter_mut().for_each(|weights| weights[at] = setting.weight);
    }
    Ok(frames)
}

fn batch(
    args: &ApplyArgs,
    path: UpdatePath,
    gpu: Option<&Gpu>,
    format: deltamorph::mesh::packed::DeltaFormat,
) -> Result<BatchSize, Failure> {
    if let Some(gpu) = gpu {
        gpu.caps().check_path(path)?;
    }
    let max = gpu.and_then(|g| g.caps().batch_max(path, format)).unwrap_or(0);
    let limit = BatchLimit { max, all: path != UpdatePath::Feedback };
    let spec = args.batch_size.unwrap_or(crate::args::values::BatchSpec::Max);
    let (allowed, _) = expand_batches(&[spec], limit);
    allowed.last().copied().ok_or_else(|| {
        let all = if limit.all { ", or \"all\"" } else { "" };
        Failure::Usage(format!("--batch-size: path '{}' takes 1 to {max} targets per pass here{all}", path.name()))
    })
}

/// Write the pose: nine digits, the input's vertex order, normals normalised.
fn write(args: &ApplyArgs, mesh: &MorphMesh, pose: &[f32]) -> Result<(), Failure> {
    let vertices = pose.chunks_exact(POSE_FLOATS).take(mesh.vertex_count());
    let positions: Vec<Vec3> = vertices.clone().map(|v| Vec3::from_slice(&v[..3])).collect();
    let normals: Vec<Vec3> = vertices
        .zip(&mesh.normals)
        .map(|(v, base)| {
            let normal = Vec3::from_slice(&v[3..]);
            if f64::from(normal.length()) < SHORTEST_NORMAL { *base } else { normal.normalize() }
        })
        .collect();
    let shape = ObjMesh { positions: &positions, normals: &normals, texcoords: &mesh.texcoords, faces: &mesh.faces };
    Ok(write_obj(&args.output, shape)?)
}
