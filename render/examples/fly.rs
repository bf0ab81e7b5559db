//! A camera that moves away from 100 heads and back: how levels of detail change the pictures between frames, and the
//! bytes that updates move, as a table and a plot. Run as `./with-vulkan cargo run -p deltamorph-render --example fly
//! [--bytes] [--frames=N] [--vertices=N] [--supersampling=N] [--fade=PIXELS] [--pixels=PIXELS] [FOLDER]`; `--bytes`:
//! without pictures.

#[path = "../tests/common/fly.rs"]
mod fly;

use deltamorph_headless::{Headless, HeadlessDesc};
use fly::{Fly, Frame};
use std::fmt::Write;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let folder = args.iter().find(|arg| !arg.starts_with("--")).map(PathBuf::from);
    let headless = Headless::new(&HeadlessDesc::default())?;
    let mut fly = Fly { draws: !args.contains(&"--bytes".to_owned()), ..Fly::new() };
    let number = |name: &str| -> Option<f32> { args.iter().find_map(|arg| arg.strip_prefix(name)?.parse().ok()) };
    fly.frames = number("--frames=").map_or(fly.frames, |n| n as usize).max(2);
    fly.vertices = number("--vertices=").map_or(fly.vertices, |n| n as usize);
    fly.supersampling = number("--supersampling=").map_or(fly.supersampling, |n| n as u32).max(1);
    fly.lod = fly.lod.fade(number("--fade=").unwrap_or(fly.lod.fade));
    fly.lod = fly.lod.pixels(number("--pixels=").unwrap_or(fly.lod.pixels));
    println!("{fly:?} on {}", headless.caps().name);
    println!("frame  distance  head px   kept  behind  MB lod  MB all  pop  at once  drift");
    let frames = fly.run(&headless, |i, f| {
        let [lod, all] = f.bytes.map(|bytes| bytes as f64 / 1e6);
        println!(
            "{i:5} {:9.2} {:8.1} {:6.2} {:7.2} {lod:7.2} {all:7.2} {:5.2} {:7.1} {:6.2}",
            f.distance, f.head_pixels, f.kept, f.behind, f.pop[0], f.pop[1], f.drift
        );
    })?;
    let most = |of: &dyn Fn(&Frame) -> f32| frames.iter().map(of).fold(0.0, f32::max);
    println!(
        "largest change of a channel because of the level: {:.2} of 255, without fading {:.1}; of the difference {:.2}",
        most(&|f| f.pop[0]),
        most(&|f| f.pop[1]),
        most(&|f| f.drift)
    );
    if let Some(folder) = folder {
        std::fs::write(folder.join("fly.svg"), plot(&frames))?;
    }
    Ok(())
}

/// Plots bytes over the distance, which is logarithmic: grey for all targets, blue with the level of detail; solid for
/// the way out, dashed for the way back.
fn plot(frames: &[Frame]) -> String {
    let (width, height, edge) = (720.0f64, 400.0f64, 60.0f64);
    // The first two frames write all poses.
    let counted = &frames[2.min(frames.len() - 1)..];
    let far = counted.iter().map(|f| f.distance).fold(1.0, f32::max);
    let high = counted.iter().flat_map(|f| f.bytes).max().unwrap_or(1) as f64 / 1e6;
    let x = |distance: f32| edge + (width - 2.0 * edge) * f64::from(distance.ln() / far.ln());
    let y = |megabytes: f64| height - edge - (height - 2.0 * edge) * megabytes / high;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"13\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for megabytes in (0..=high as u32).step_by(2) {
        let (at, label) = (y(f64::from(megabytes)), format!("{megabytes} MB"));
        let _ = writeln!(
            svg,
            "<path d=\"M{edge} {at:.1}H{:.1}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{label}</text>",
            width - edge,
            edge - 6.0,
            at + 4.0
        );
    }
    for distance in [1.0f32, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0].into_iter().filter(|d| *d <= far) {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{distance}</text>",
            x(distance),
            height - edge + 18.0
        );
    }
    let half = counted.len() / 2;
    for (part, dash) in [(&counted[..=half], ""), (&counted[half..], " stroke-dasharray=\"5 4\"")] {
        for (which, colour) in [(1, "#999"), (0, "#1565c0")] {
            let points: Vec<String> =
                part.iter().map(|f| format!("{:.1},{:.1}", x(f.distance), y(f.bytes[which] as f64 / 1e6))).collect();
            let _ = writeln!(
                svg,
                "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"{dash} points=\"{}\"/>",
                points.join(" ")
            );
        }
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"24\" text-anchor=\"middle\">bytes that an update of 100 heads moves: all targets (grey), \
         level of detail (blue); away solid, back dashed</text>",
        width / 2.0
    );
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">distance of the camera, 1: the wall of heads fills the \
         picture</text>\n</svg>",
        width / 2.0,
        height - 16.0
    );
    svg
}
