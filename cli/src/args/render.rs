//! The options of `render`.

use super::{RunArgs, values};
use crate::detail::Detail;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub struct RenderArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Weight clip to take the weights from: a CSV file, a glTF file's animation as FILE or FILE#NAME, or INPUT's by
    /// its name
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Frame of the weight clip, counted from 0
    #[arg(long, value_name = "N", requires = "weights", conflicts_with_all = ["sheet", "clip", "crowd"])]
    pub frame: Option<usize>,
    /// Weights by name, on top of the clip's (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_delimiter = ',', value_parser = values::setting)]
    pub set: Vec<(String, f32)>,
    /// PNG file to write
    #[arg(short, long, value_name = "OUT.png", required_unless_present = "clip", conflicts_with = "clip")]
    pub output: Option<PathBuf>,
    /// Pixels of the picture, of each cell with --sheet [default: 768x768; cells: 224x224; clips: 512x512]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<[u32; 2]>,
    /// Where the camera is, in degrees: around the head (0: in front, 90: at its left, 180: behind), and up
    #[arg(long, value_name = "YAW,PITCH", default_value = "18,4", value_parser = camera, allow_hyphen_values = true)]
    pub camera: [f32; 2],
    /// How near the camera is: at 2 there is a quarter of the picture in twice the size
    #[arg(long, value_name = "X", default_value = "1", value_parser = values::zoom)]
    pub zoom: f32,
    /// Show all of the scene, not only what targets move
    #[arg(long)]
    pub whole: bool,
    /// Where the key light is, in degrees from the camera: to the right, and up; how bright it is [default: 1]
    #[arg(long, value_name = "YAW,PITCH[,STRENGTH]", default_value = "-38,34", value_parser = light)]
    #[arg(allow_hyphen_values = true)]
    pub light: [f32; 3],
    /// What is behind: a colour, or "none" for a picture that can be put on anything
    #[arg(long, value_name = "RRGGBB|none", default_value = "23262d", value_parser = background)]
    pub background: Background,
    /// Contact sheet: every target by itself at weight 1, with its name
    #[arg(long, conflicts_with_all = ["weights", "set", "clip", "crowd"])]
    pub sheet: bool,
    /// The whole clip: an animated PNG (OUT.png, OUT.apng), or else a folder of PNG frames
    #[arg(long, value_name = "OUT", conflicts_with = "crowd")]
    pub clip: Option<PathBuf>,
    /// A crowd of N heads, each with an expression of its own: of the clip, or drawn from --seed
    #[arg(long, value_name = "N", value_parser = values::whole(1u32, 1000))]
    pub crowd: Option<u32>,
    /// Colours for the distance of each vertex from the base pose, or for its error: against a float64 evaluation of
    /// the mesh as it was imported
    #[arg(long, value_name = "WHAT", conflicts_with_all = ["checker", "magnify"])]
    pub heat: Option<Heat>,
    /// What is shown of the surface: its edges, its normals, how fast each vertex moves, what the update changed (both
    /// since the frame before, or since the base pose where there is none), or wrinkles where skin is compressed
    #[arg(long, value_name = "WHAT", conflicts_with_all = ["heat", "checker", "magnify"])]
    pub show: Option<Shown>,
    /// Normals of poses: as updates sum them, or those of the morphed surface, whose joints then stay at rest
    #[arg(long, value_name = "WHICH", default_value = "summed", conflicts_with = "magnify")]
    pub normals: Normals,
    /// Where the colours of --heat and of --show motion end, in input units [default: at the largest value]
    #[arg(long, value_name = "LENGTH", value_parser = values::positive)]
    pub scale: Option<f32>,
    /// How many targets heads keep, in the order of their importance: all, a share as 50%, or as many as it takes for
    /// no vertex to be further off than so many pixels, as 0.5px
    #[arg(long, value_name = "all|N%|Npx", default_value = "all", value_parser = Detail::parse)]
    #[arg(conflicts_with_all = ["sheet", "heat", "magnify"])]
    pub detail: Detail,
    /// A checker of N squares through the texture coordinates, which shows their seams
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "32", conflicts_with = "magnify")]
    #[arg(value_parser = values::whole(1u32, 4096))]
    pub checker: Option<u32>,
    /// Before and after: the mesh as it was imported beside what path and format make of it, at FACTOR times its error
    #[arg(long = "error-x", value_name = "FACTOR", num_args = 0..=1, default_missing_value = "8")]
    #[arg(conflicts_with_all = ["sheet", "clip", "crowd"], value_parser = values::positive)]
    pub magnify: Option<f32>,
}

/// What the colours of a heat map stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Heat {
    /// How far a vertex is from where the base pose has it
    Distance,
    /// How far path and format have it from where it should be
    Error,
}

/// Normals of poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Normals {
    /// The base normal and what each target adds to it, which is right for each by itself
    Summed,
    /// Those of the morphed surface, on the paths of the device
    Recomputed,
}

/// What is shown of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Shown {
    /// The edges of faces
    Wire,
    /// Normals as colours: x red, y green, z blue
    Normals,
    /// How far each vertex has come since the frame before
    Motion,
    /// The blocks that the update changed glow; in a clip they go out over the next frames
    Blocks,
    /// Wrinkles where the targets compress the skin
    Wrinkles,
}

impl Shown {
    /// Whether it depends on the previous pose.
    pub fn is_of_changes(self) -> bool {
        matches!(self, Self::Motion | Self::Blocks)
    }
}

/// The background: red, green and blue in sRGB, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background(pub Option<[u8; 3]>);

pub fn size(s: &str) -> Result<[u32; 2], String> {
    let edge = |s: &str| values::whole(16, 16_384)(s).map_err(|e| format!("{e}, twice, as in 768x768"));
    let (width, height) = s.split_once(['x', 'X']).ok_or("give width and height, as in 768x768")?;
    Ok([edge(width)?, edge(height)?])
}

fn degrees(s: &str, most: f32) -> Option<f32> {
    s.trim().parse::<f32>().ok().filter(|v| v.abs() <= most)
}

pub fn camera(s: &str) -> Result<[f32; 2], String> {
    let parsed = s.split_once(',').and_then(|(yaw, pitch)| Some([degrees(yaw, 360.0)?, degrees(pitch, 90.0)?]));
    parsed.ok_or_else(|| "give degrees around (-360 to 360) and up (-90 to 90), as in 30,10".into())
}

fn light(s: &str) -> Result<[f32; 3], String> {
    let parts: Vec<&str> = s.split(',').collect();
    let parsed = match parts[..] {
        [yaw, pitch] => degrees(yaw, 360.0).zip(degrees(pitch, 90.0)).map(|(yaw, pitch)| [yaw, pitch, 1.0]),
        [yaw, pitch, strength] => camera(&[yaw, pitch].join(","))
            .ok()
            .zip(strength.trim().parse().ok().filter(|v: &f32| (0.0..=10.0).contains(v)))
            .map(|([yaw, pitch], strength)| [yaw, pitch, strength]),
        _ => None,
    };
    parsed.ok_or_else(|| "give degrees to the right and up, and a strength from 0 to 10 if any, as in -38,34,1".into())
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
        assert_eq!((light("10,20"), light("10,20,0.5")), (Ok([10.0, 20.0, 1.0]), Ok([10.0, 20.0, 0.5])));
        assert!(light("10").is_err() && light("1,2,3,4").is_err() && light("1,2,-1").is_err());
        assert_eq!(background("#0102ff"), Ok(Background(Some([1, 2, 255]))));
        assert_eq!(background("none"), Ok(Background(None)));
        for bad in ["red", "12345", "1234567", "+12345", "äöü"] {
            assert!(background(bad).is_err(), "{bad}");
        }
    }
}
