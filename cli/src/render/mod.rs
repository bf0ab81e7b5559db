//! `render`: pictures of poses, drawn from the crowd's own buffer.

pub mod canvas;
mod clip;
pub mod crowd;
mod easel;
mod heat;
mod names;
pub mod painted;
pub mod scenery;

use crate::args::render::RenderArgs;
use crate::input;
use crate::output::{Failure, Output, With, check_ending};
use crate::runner::{Stage, open};
use deltamorph_headless::DeviceChoice;
use deltamorph_render::Show;
use scenery::{Done, Scenery, Subject};
use serde_json::json;
use std::path::Path;
use std::rc::Rc;

pub fn run(args: &RenderArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    args.run.update.check_single("render").map_err(Failure::Usage)?;
    let one_pose = args.clip.is_none() && args.crowd.is_none();
    if one_pose && args.run.weights.is_some() && args.frame.is_none() {
        return Err(Failure::Usage("--weights: which frame? give --frame N, or --clip OUT for all of them".into()));
    }
    if let Some(path) = args.run.update.paths.iter().find(|path| path.evaluates_in_draws()) {
        let text =
            format!("--path {}: evaluates poses in its own draws, and has none to draw; use blocks", path.name());
        return Err(Failure::Usage(text));
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
    let gpu = open(device, out)?.map(Rc::new).ok_or_else(|| {
        Failure::Failed("drawing needs a Vulkan device, and there is none; on Linux ./with-vulkan installs one".into())
    })?;
    let mut input = input::load(&args.run.input, false, out)?;
    if args.look() == Show::Wrinkles {
        input.add_masks()?;
    }
    if args.run.update.poses.iter().any(|pose| pose.has_integers()) {
        // Poses have to hold the weights of the clip. Its warnings are printed when it is drawn.
        let warnings = input.out.take();
        input::clips(args.run.weights.as_deref(), &args.run.input, &input, &args.set)?;
        input.pose(&args.set)?;
        input.out = warnings;
    }
    let stage = Stage::on(Some(gpu.clone()), &args.run, &input, out)?;
    let mut subject = Subject::new(args.run.input.input.as_deref(), &input)?;
    if args.whole {
        subject.focus.clone_from(&subject.whole);
    }
    let scenery = Scenery { args, input: &input, stage: &stage, gpu: &gpu, subject, out };
    let Done { mut what, size, frames, scale } = match args.crowd {
        None if args.clip.is_some() => clip::draw(&scenery, output)?,
        heads => crowd::draw(&scenery, heads, output)?,
    };
    if let Some(end) = scale {
        let share = f64::from(end) / crate::verify::scale(input.kept.diagonal);
        what += &format!(", colours up to {end:.3e} ({share:.1e} of the diagonal)");
    }
    let file = output.display();
    let setup = stage.describe();
    out.say(format_args!("{file}: {what}, {} × {} pixels, through {setup}", size[0], size[1]));
    let more = json!({
        "schema": 1, "device": gpu.caps().name, "output": output.display().to_string(), "width": size[0],
        "height": size[1], "frames": frames, "scale": scale,
    });
    out.json(&With { fields: stage.setup(), more })
}
