//! The options of `view`.

use super::render::{camera, size};
use super::{RunArgs, values};
use clap::Args;
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub struct ViewArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Weights by name to begin with (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_parser = values::settings)]
    pub set: Vec<Vec<(String, f32)>>,
    /// Size of the window, in pixels of a screen without scaling
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    pub size: [u32; 2],
    /// Position of the camera, in degrees: around the head (0: in front, 90: at its left, 180: behind), and up
    #[arg(long, value_name = "YAW,PITCH", default_value = "18,4", value_parser = camera, allow_hyphen_values = true)]
    pub camera: [f32; 2],
    /// Run the commands in a file, one a line, then close the window; the commands are listed below
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Write the contents of the window as PNG, after the script if there is one, then close the window
    #[arg(long, value_name = "OUT.png")]
    pub screenshot: Option<PathBuf>,
    /// Load the Vulkan validation layers; their messages are errors
    #[arg(long)]
    pub validation: bool,
}

/// The commands of scripts, for people.
pub const HELP: &str = "\
Commands of scripts, one a line; the rest of a line after # is a remark:
  set NAME WEIGHT           set the weight of a target
  reset                     set all weights to 0
  clip FILE                 take a clip: a CSV file, or a glTF file's animation as FILE or FILE#NAME
  play | pause              play the clip; every frame is a 60th of a second
  scrub FRAME               go to a frame of the clip
  show LOOK                 shaded, wire, normals, heat, motion or blocks
  camera YAW,PITCH | zoom X turn the camera; 2 shows the middle half at twice the size
  pan X,Y                   move the picture to the right and down, in shares of the room for it
  home                      the camera as at the beginning
  panel on|off              show or hide the panel
  frames N                  draw N frames
  resize W H                change the size of the window
  screenshot OUT.png        write the next frame
  quit                      close the window, as the end of the script does";
