//! The options of `render`.

use super::{RunArgs, values};
use clap::builder::TypedValueParser;
use clap::{Args, ValueEnum};
use deltamorph_render::Show;
use std::path::PathBuf;

#[derive(Args, Debug)]
pub struct RenderArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Frame of the weight clip, counted from 0
    #[arg(long, value_name = "N", requires = "weights", conflicts_with_all = ["clip", "crowd"])]
    pub frame: Option<usize>,
    /// Weights by name; they replace those of the clip (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_parser = values::settings)]
    pub set: Vec<Vec<(String, f32)>>,
    /// PNG file to write
    #[arg(short, long, value_name = "OUT.png", required_unless_present = "clip", conflicts_with = "clip")]
    pub output: Option<PathBuf>,
    /// Size in pixels [default: 768x768; crowds: 1280x720; clips: 512x512]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<[u32; 2]>,
    /// Direction from the head to the camera, in degrees: around (0: front, 90: the head's left, 180: back), and up
    #[arg(long, value_name = "YAW,PITCH", default_value = "18,4", value_parser = camera, allow_hyphen_values = true)]
    pub camera: [f32; 2],
    /// Zoom factor; 2 shows the middle half of the picture at twice the size
    #[arg(long, value_name = "X", default_value = "1", value_parser = values::zoom)]
    pub zoom: f32,
    /// Show the whole scene, not only the parts that targets move
    #[arg(long)]
    pub whole: bool,
    /// Background colour, or "none" for transparency
    #[arg(long, value_name = "RRGGBB|none", default_value = "23262d", value_parser = background)]
    pub background: Background,
    /// Draw the whole clip: as an animated PNG (OUT.png, OUT.apng), otherwise as a folder of PNG frames
    #[arg(long, value_name = "OUT", conflicts_with = "crowd")]
    pub clip: Option<PathBuf>,
    /// Draw a crowd of N instances, each at another frame of the clip
    #[arg(long, value_name = "N", value_parser = values::whole(1u32, 1000))]
    pub crowd: Option<u32>,
    /// The same as --show heat
    #[arg(long, value_name = "WHAT", conflicts_with = "show", value_parser = ["distance"])]
    pub heat: Option<String>,
    /// What to show of the surface; motion and blocks: changes since the previous frame, or since the base pose if
    /// there is none
    #[arg(long, value_name = "LOOK", default_value = "shaded")]
    #[arg(value_parser = values::named(&LOOKS, |look| look.1, |look| look.2).map(|look| look.0))]
    pub show: Show,
    /// How the normals of poses are computed
    #[arg(long, value_name = "WHICH", default_value = "summed")]
    pub normals: Normals,
    /// Upper end of the colour scale of --show heat and --show motion, in input units [default: the maximum]
    #[arg(long, value_name = "LENGTH", value_parser = values::positive)]
    pub scale: Option<f32>,
}

impl RenderArgs {
    /// The appearance of the surface.
    pub fn look(&self) -> Show {
        if self.heat.is_some() { Show::Heat } else { self.show }
    }
}

/// Normals of poses.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Normals {
    /// The base normals plus the normal deltas of the targets
    Summed,
    /// Recomputed from the morphed surface (not on the path cpu)
    Recomputed,
}

/// Appearances of a surface, in pictures and, but for the last, in the window: with their names and what they show.
pub const LOOKS: [(Show, &str, &str); 7] = [
    (Show::Shaded, "shaded", "Skin, eyes and teeth, lit"),
    (Show::Wire, "wire", "Edges of the faces"),
    (Show::Normals, "normals", "Normals as colours: x red, y green, z blue"),
    (Show::Heat, "heat", "Distance of each vertex from the base pose: grey, blue, green, yellow, red"),
    (Show::Motion, "motion", "Distance of each vertex from the previous frame, in the same colours"),
    (Show::Blocks, "blocks", "Highlight the blocks of vertices that each update writes"),
    (Show::Wrinkles, "wrinkles", "Wrinkles where the targets compress the skin"),
];

/// The background: red, green and blue in sRGB, or none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background(pub Option<[u8; 3]>);

pub fn size(s: &str) -> Result<[u32; 2], String> {
    let edge = |s: &str| values::whole(16, 16_384)(s).map_err(|e| format!("{e}, twice, as in 768x768"));
    let (width, height) = s.split_once(['x', 'X']).ok_or("give width and height, as in 768x768")?;
    Ok([edge(width)?, edge(height)?])
}

/// Two numbers with a comma between them, up to these absolute values.
pub fn pair(s: &str, most: [f32; 2]) -> Option<[f32; 2]> {
    let (x, y) = s.split_once(',')?;
    let number = |text: &str, most: f32| text.trim().parse().ok().filter(|v: &f32| v.abs() <= most);
    Some([number(x, most[0])?, number(y, most[1])?])
}

pub fn camera(s: &str) -> Result<[f32; 2], String> {
    pair(s, [360.0, 90.0]).ok_or_else(|| "give degrees around (-360 to 360) and up (-90 to 90), as in 30,10".into())
}

fn background(s: &str) -> Result<Background, &'static str> {
    let digits = s.trim().trim_start_matches('#');
    if digits == "none" {
        return Ok(Background(None));
    }
    let parsed = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6 && !digits.starts_with('+'));
    let colour = parsed.ok_or("give six hexadecimal digits, as in 23262d, or \"none\"")?.to_be_bytes();
    Ok(Background(Some([colour[1], colour[2], colour[3]])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_angles_and_colours_are_read() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for bad in ["640", "640x", "x480", "15x480", "640x99999", "-1x4", "640x480x2"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(camera("-30, 10"), Ok([-30.0, 10.0]));
        for bad in ["30", "30,91", "361,0", "a,b", "NaN,0", ""] {
            assert!(camera(bad).is_err(), "{bad}");
        }
        assert_eq!(background("#0102ff"), Ok(Background(Some([1, 2, 255]))));
        assert_eq!(background("none"), Ok(Background(None)));
        for bad in ["red", "12345", "1234567", "+12345", "äöü"] {
            assert!(background(bad).is_err(), "{bad}");
        }
    }
}
