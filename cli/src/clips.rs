//! Which weight clips a command runs: those named, those that lie beside the mesh, or the built-in head's own.

use crate::args::InputArgs;
use crate::input::{self, Input};
use crate::output::Failure;
use deltamorph::BoundClip;
use deltamorph::import::{csv, sample};
use std::path::Path;

/// Frames of the built-in head's clip, as `sample` writes them.
const HEAD_FRAMES: usize = 300;

/// The clip at `named`, or the only one that `input` has.
pub fn the_one(named: Option<&Path>, args: &InputArgs, input: &Input) -> Result<BoundClip, Failure> {
    if named.is_none() && input.clips.len() > 1 {
        let list: Vec<String> = input.clips.iter().map(|c| c.display().to_string()).collect();
        return Err(Failure::Usage(format!(
            "{} has {} clips; name one with --weights: {}",
            input.origin,
            list.len(),
            list.join(", ")
        )));
    }
    all(named, args, input)?.pop().ok_or_else(|| {
        Failure::Usage(format!("{} has no clip in weights/*.csv; name one with --weights CSV", input.origin))
    })
}

/// The clip at `named`, or all that `input` has.
pub fn all(named: Option<&Path>, args: &InputArgs, input: &Input) -> Result<Vec<BoundClip>, Failure> {
    if named.is_none() && args.input.is_none() {
        return Ok(built_in(args, input)?.into_iter().collect());
    }
    let paths = named.map_or_else(|| input.clips.clone(), |path| vec![path.to_path_buf()]);
    paths.iter().map(|path| input::clip(path, args, &input.kept)).collect()
}

/// The clip of the built-in head; without a target there is none.
fn built_in(args: &InputArgs, input: &Input) -> Result<Option<BoundClip>, Failure> {
    if input.kept.targets.is_empty() {
        return Ok(None);
    }
    let clip = sample::head_clip(&args.head.desc(args.seed), HEAD_FRAMES, args.fps.unwrap_or(csv::DEFAULT_FPS));
    let names: Vec<&str> = input.kept.targets.iter().map(|t| t.name.as_str()).collect();
    Ok(Some(clip.bind(&names)?))
}
