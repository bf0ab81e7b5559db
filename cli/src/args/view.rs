//! The options of `view`.

use super::render::{camera, size};
use super::{RunArgs, values};
use clap::Args;
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub struct ViewArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Weight clip to play: a CSV file, a glTF file's animation as FILE or FILE#NAME, or INPUT's by its name [default:
    /// the first in INPUT/weights or INPUT, which waits for "play"]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Weights by name to begin with (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_delimiter = ',', value_parser = values::setting)]
    pub set: Vec<(String, f32)>,
    /// Size of the window, in pixels of a screen without scaling
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    pub size: [u32; 2],
    /// Where the camera is, in degrees: around the head (0: in front, 90: at its left, 180: behind), and up
    #[arg(long, value_name = "YAW,PITCH", default_value = "18,4", value_parser = camera, allow_hyphen_values = true)]
    pub camera: [f32; 2],
    /// Number of heads, each a little further in the clip
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = values::whole(1u32, MAX_HEADS))]
    pub heads: u32,
    /// Do what a file says, a command a line, then close the window; the commands are listed below
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Write what the window shows as PNG, behind the script if there is one, then close the window
    #[arg(long, value_name = "OUT.png")]
    pub screenshot: Option<PathBuf>,
    /// Load the Vulkan validation layers; what they say is an error
    #[arg(long)]
    pub validation: bool,
}

/// Heads that a window shows at most.
pub const MAX_HEADS: u32 = 100;

/// The commands of scripts, for people.
pub const HELP: &str = "\
Commands of scripts, one a line; what follows # is a remark:
  set NAME WEIGHT           the weight of a target
  reset | random SEED       all weights 0; a few of them at random
  undo | redo               take back the last change of weights; make it again
  copy                      print the weights as --set takes them
  clip FILE                 take a clip: a CSV file, or a glTF file's animation as FILE or FILE#NAME
  play | pause              play the clip; every frame is a 60th of a second
  scrub FRAME | speed X     go to a frame of the clip; play X times as fast
  path PATH | format FORMAT | pose FORMAT | budget LENGTH
                            update in another way, spelled as the options are
  heads N                   so many heads
  detail all | N% | Npx     keep all targets; a share, the most important ones; or what N pixels take
  show LOOK                 shaded, wire, normals, heat, motion, blocks or wrinkles
  camera YAW,PITCH | zoom X where the camera is, and how near
  pan X,Y                   move the picture to the right and down, in shares of the room for it
  whole on|off              all of the scene, or what targets move (key W)
  focus | home              fill the window with what the active targets move; the camera as at the beginning
  search TEXT | active on|off | twins on|off
                            the panel: what is listed, only active targets, left and right together
  panel on|off | width N    whether it is there, and its width
  help on|off               what keys and mouse do
  drop FILE                 a mesh or a clip, as if it were dropped on the window; what is wrong with it is shown
  dismiss                   put away what is shown of that, which leaves by itself after some seconds
  frames N                  draw N frames
  resize W H                another size of the window
  screenshot OUT.png        write what the next frame shows
  stats OUT.json            write what updates and frames have taken since the last change of what is measured
  quit                      close the window, as the end of the script does";
