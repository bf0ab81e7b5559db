//! `apply`: one pose, updated by the chosen path, written as OBJ in the input's vertex order.

use crate::args::ApplyArgs;
use crate::input::{self, Input};
use crate::output::{Output, Result, With, check_ending, refuse};
use crate::runner::Stage;
use crate::verify::Checks;
use deltamorph::import::is_gltf;
use deltamorph::import::obj::{ObjMesh, write_obj};
use deltamorph::internals::write_replacing;
use deltamorph::reference::SHORTEST_NORMAL;
use deltamorph::{KeptMesh, POSE_FLOATS};
use deltamorph_headless::DeviceChoice;
use glam::{Vec2, Vec3};
use serde_json::json;
use std::io::Write;
use std::path::Path;

pub fn run(args: &ApplyArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    let ApplyArgs { run, output, .. } = args;
    if args.frame.is_none() && (run.weights.is_some() || args.set.is_empty()) {
        return refuse("nothing to apply; give --weights CSV --frame N, or --set NAME=WEIGHT");
    }
    input::check("apply", run, &[output], out)?;
    if output.extension().is_some() {
        check_ending(output, "an OBJ file", &["obj"])?;
    }
    let input = input::load(&run.input, true, out)?;
    let frames = frames(args, &input)?;

    let stage = Stage::new(run, &input, device, out)?;
    let mut runner = stage.runner(stage.desc)?;
    let mut checks = Checks::new(&stage, Some(input.raw.clone()));
    let mut passes = 0;
    for (number, weights) in frames.iter().enumerate() {
        let (step, _) = checks.step(number, &mut runner, weights, number + 1 == frames.len())?;
        passes += step.stats.passes;
    }
    checks.verdict(out)?;
    let pose = runner.pose(0, 0)?;
    // `frames` ensures at least one frame.
    let weights = frames.last().map_or(&[][..], Vec::as_slice);
    write(output, &input.kept, run.input.input.as_deref().is_some_and(is_gltf), &pose)?;
    let active = weights.iter().filter(|w| **w != 0.0).count();
    let (file, targets, setup) = (output.display(), weights.len(), stage.describe());
    let found = checks.text();
    out.say(format_args!("{file}: {active} active of {targets} targets, {passes} passes through {setup}\n{found}"));
    let more = json!({
        "schema": 1, "device": stage.device(), "batch_size": stage.desc.batch.to_string(), "frames": frames.len(),
        "passes": passes, "active": active, "output": output.display().to_string(),
    });
    out.json(&With { fields: checks.record(), more })
}

/// The weights of one or more frames to step through, with `--set` on top of each.
fn frames(args: &ApplyArgs, input: &Input) -> Result<Vec<Vec<f32>>> {
    match (&args.run.weights, args.frame) {
        (Some(path), Some(last)) => {
            let all = input.clip(path, &args.set)?;
            let first = args.from_frame.unwrap_or(last);
            [first, last].into_iter().try_for_each(|frame| input::check_frame(path, &all, frame))?;
            // Backwards is allowed, too: a delta weight may be negative.
            let frames = (first.min(last)..=first.max(last)).map(|f| all.frame(f));
            let mut frames = frames.collect::<deltamorph::Result<Vec<_>>>()?;
            if first > last {
                frames.reverse();
            }
            Ok(frames)
        }
        _ => Ok(vec![input.pose(&args.set)?]),
    }
}

/// Writes the pose in the input's coordinates and vertex order, with normalised normals. OBJ texture coordinates go
/// up; `down`: those of the mesh go down, and are flipped.
fn write(path: &Path, mesh: &KeptMesh, down: bool, pose: &[f32]) -> Result<()> {
    let vertices = pose.chunks_exact(POSE_FLOATS).take(mesh.vertex_count());
    let normals: Vec<Vec3> = vertices
        .clone()
        .zip(&mesh.normals)
        .map(|(v, base)| {
            let normal = Vec3::from_slice(&v[3..]);
            if f64::from(normal.length()) < SHORTEST_NORMAL { *base } else { normal.normalize() }
        })
        .collect();
    let up = |t: &Vec2| if down { Vec2::new(t.x, 1.0 - t.y) } else { *t };
    let texcoords: Vec<Vec2> = mesh.texcoords.iter().map(up).collect();
    let rest = ObjMesh { positions: &[], normals: &normals, texcoords: &texcoords, faces: &mesh.faces };
    // In single precision, unless that would lose the shape of a mesh far off.
    let lost = |x: f64| (x - f64::from(x as f32)).abs() > 1e-6 * f64::from(mesh.diagonal);
    let number = |x: f64| if lost(x) { x.to_string() } else { (x as f32).to_string() };
    Ok(write_replacing(path, |out| {
        for v in vertices {
            let absolute = Vec3::from_slice(&v[..3]).as_dvec3() + mesh.origin.as_dvec3();
            writeln!(out, "v {}", absolute.to_array().map(number).join(" "))?;
        }
        write_obj(out, rest)
    })?)
}
