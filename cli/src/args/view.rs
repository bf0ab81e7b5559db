//! The options of `view`.

use super::render::{camera, size};
use super::{RunArgs, values};
use clap::Args;
use std::path::PathBuf;

#[derive(Args, Debug)]
pub struct ViewArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Initial weights by name (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_parser = values::settings)]
    pub set: Vec<Vec<(String, f32)>>,
    /// Size of the window in logical pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    pub size: [u32; 2],
    /// Direction from the head to the camera, in degrees: around (0: front, 90: the head's left, 180: back), and up
    #[arg(long, value_name = "YAW,PITCH", default_value = "18,4", value_parser = camera, allow_hyphen_values = true)]
    pub camera: [f32; 2],
    /// Run the commands of a file, then close the window; the commands are listed below
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Write an image of the window as PNG after the script, if any, then close the window
    #[arg(long, value_name = "OUT.png")]
    pub screenshot: Option<PathBuf>,
    /// Load the Vulkan validation layers, and treat their messages as errors
    #[arg(long)]
    pub validation: bool,
}

/// The commands of scripts.
pub const HELP: &str = "\
Commands of scripts, one per line; # starts a comment:
  set NAME WEIGHT           set the weight of a target
  reset                     set all weights to 0
  clip FILE                 load a clip: a CSV file, or an animation of a glTF file as FILE or FILE#NAME
  play | pause              play or pause the clip; each frame drawn advances it by 1/60 s
  scrub FRAME               go to a frame of the clip
  show LOOK                 shaded, wire, normals, heat, motion or blocks
  camera YAW,PITCH | zoom X turn the camera; set the zoom factor
  pan X,Y                   move the picture right and down, as fractions of its width and height
  home                      reset the camera
  panel on|off              show or hide the panel
  frames N                  draw N frames
  resize W H                change the size of the window
  screenshot OUT.png        write the next frame as PNG
  quit                      close the window; the end of the script does so, too";
