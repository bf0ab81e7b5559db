//! `render`: pictures of poses, drawn from the crowd's own buffer.

pub mod canvas;
mod clip;
mod crowd;
mod easel;
mod names;
mod painted;
pub mod subject;

use crate::args::render::RenderArgs;
use crate::input::{self, Input};
use crate::output::{Failure, Output, Result, With, check_ending, refuse};
use crate::runner::{Stage, open_to_draw};
use crate::verify;
use canvas::save;
use deltamorph::KeptMesh;
use deltamorph::reference::evaluate_unpacked;
use deltamorph_headless::DeviceChoice;
use deltamorph_render::Show;
use easel::Easel;
use glam::Mat4;
use serde_json::json;
use std::path::Path;
use std::rc::Rc;
use subject::Subject;

/// Default sizes in pixels: of one instance, of a crowd, and of a frame of a clip.
const SINGLE: [u32; 2] = [768; 2];
const CROWD: [u32; 2] = [1280, 720];
const CLIP: [u32; 2] = [512; 2];

pub fn run(args: &RenderArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    args.run.update.check_single("render").map_err(Failure::Usage)?;
    let one_pose = args.clip.is_none() && args.crowd.is_none();
    if one_pose && args.run.weights.is_some() && args.frame.is_none() {
        return refuse("--weights: which frame? give --frame N, or --clip OUT for all of them");
    }
    if let Some(path) = args.run.update.paths.iter().find(|path| path.evaluates_in_draws()) {
        let text =
            format!("--path {}: evaluates poses in its own draws, and has none to draw; use blocks", path.name());
        return refuse(text);
    }
    // clap ensures that one of the two is given.
    let output = args.output.as_deref().or(args.clip.as_deref()).unwrap_or(Path::new(""));
    let read = input::files_of(&args.run.input, args.run.weights.as_slice());
    if args.clip.is_some() && !clip::is_one_file(output) {
        out.check(&read, &[], Some(output))?;
    } else {
        out.check(&read, &[output], None)?;
    }
    if args.clip.is_none() && output.extension().is_some() {
        check_ending(output, "a PNG", &["png"])?;
    }
    // The path cpu needs no device, but drawing does.
    let gpu = Rc::new(open_to_draw(device, out)?);
    let mut input = input::load(&args.run.input, false, out)?;
    if args.look() == Show::Wrinkles {
        input.add_masks()?;
    }
    let (poses, fps) = poses(args, &input)?;
    let stage = Stage::on(Some(gpu.clone()), &args.run, &input, out)?;
    let mut subject = Subject::new(&input)?;
    if args.whole {
        subject.focus.clone_from(&subject.whole);
    }
    let size = args.size.unwrap_or(match args.crowd {
        Some(_) => CROWD,
        None if args.clip.is_some() => CLIP,
        None => SINGLE,
    });
    let places = args.crowd.map(|heads| crowd::places(&subject.focus, heads, size));
    let places = places.unwrap_or_else(|| vec![Mat4::IDENTITY]);
    let scale = end_of_scale(args, &input.kept, &poses)?;
    let mut easel = Easel::new(&gpu, args, (&input, &stage, &subject), size, places, scale.unwrap_or(1.0))?;
    let frames = if args.clip.is_some() { poses.len() } else { 1 };
    let mut what = if args.clip.is_some() {
        clip::draw(&mut easel, &poses, (size, fps), output, out)?;
        format!("{frames} frames at {fps} frames per second")
    } else {
        let [now, before] = [0, 1].map(|which| poses.iter().map(|pose| &pose[which][..]).collect::<Vec<_>>());
        if matches!(args.look(), Show::Motion | Show::Blocks) {
            easel.draw(&before)?;
        }
        save(easel.draw(&now)?, output)?;
        match (args.crowd, easel.studio.draws()) {
            (None, _) => format!("{} active of {} targets", now[0].iter().filter(|w| **w != 0.0).count(), now[0].len()),
            (Some(heads), [_, 0]) => format!("a crowd of {heads} instances"),
            (Some(heads), [draws, spared]) => {
                format!("a crowd of {heads} instances, {spared} of {} draws culled", draws + spared)
            }
        }
    };
    if let Some(end) = scale {
        let share = f64::from(end) / verify::scale(input.kept.diagonal);
        what += &format!(", colours up to {end:.3e} ({share:.1e} of the diagonal)");
    }
    let file = output.display();
    let setup = stage.describe();
    out.say(format_args!("{file}: {what}, {} × {} pixels, through {setup}", size[0], size[1]));
    let more = json!({
        "schema": 1, "device": gpu.caps().name, "output": file.to_string(), "width": size[0], "height": size[1],
        "frames": frames, "scale": scale,
    });
    out.json(&With { fields: stage.setup(), more })
}

/// Weights, and those of the frame before.
type Pose = [Vec<f32>; 2];

/// The poses to draw, and the frames per second of their clip: one, a frame or settings alone; those of a crowd, spread
/// over the clip; or all of the clip. Before the first frame and settings alone is the base pose, but for crowds and
/// clips, in which nothing moves first.
fn poses(args: &RenderArgs, input: &Input) -> Result<(Vec<Pose>, f32)> {
    if args.clip.is_none() && args.crowd.is_none() {
        let rest = vec![0.0; input.kept.targets.len()];
        let (Some(path), Some(frame)) = (&args.run.weights, args.frame) else {
            return Ok((vec![[input.pose(&args.set)?, rest]], 0.0));
        };
        let clip = input.clip(path, &args.set)?;
        input::check_frame(path, &clip, frame)?;
        return Ok((vec![[clip.frame(frame)?, if frame > 0 { clip.frame(frame - 1)? } else { rest }]], clip.fps));
    }
    let clip = input.one_clip(args.run.weights.as_deref(), &args.set)?;
    let frames: Vec<Vec<f32>> = clip.frames().collect();
    let count = args.crowd.map_or(frames.len(), |heads| heads as usize);
    let place = |i: usize| i * frames.len() / count;
    let pose = |i: usize| [place(i), place(i).saturating_sub(1)].map(|at| frames[at].clone());
    Ok(((0..count).map(pose).collect(), clip.fps))
}

/// The end of the scale of colours that stand for lengths, in input units: by default, the largest in these poses.
fn end_of_scale(args: &RenderArgs, mesh: &KeptMesh, poses: &[Pose]) -> Result<Option<f32>> {
    let moves = args.look() == Show::Motion;
    if !moves && args.look() != Show::Heat {
        return match args.scale {
            Some(_) => {
                refuse("--scale is the upper end of the colour scale of --show heat or motion; give one of these")
            }
            None => Ok(None),
        };
    }
    let length = |[now, before]: &Pose| {
        let from = if moves { &before[..] } else { &[] };
        verify::farthest(&evaluate_unpacked(mesh, now), &evaluate_unpacked(mesh, from)) as f32
    };
    let end = args.scale.unwrap_or_else(|| poses.iter().map(length).fold(0.0, f32::max));
    // If nothing moves, the scale ends at float32 precision.
    Ok(Some(if end > 0.0 { end } else { mesh.diagonal.max(1.0) * f32::EPSILON }))
}
