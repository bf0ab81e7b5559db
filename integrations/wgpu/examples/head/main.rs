//! A head drawn by wgpu and morphed by deltamorph, without a window.
//!
//!     cargo run --example head [PART OF AN ADAPTER'S NAME]
//!
//! Plays part of a clip in each pose format. The last pose is compared with the float64 reference, and its picture with
//! one drawn from the reference's vertices; `head.png` is the picture of `fixed16`, the format with half the bytes.
//! `play.rs` is the part about morphing; `scene.rs` is what any host has.

mod play;
mod scene;

use deltamorph::PoseFormat;
use play::{Played, difference, play};
use scene::{EDGE, Host, Result};

fn main() -> Result<()> {
    let wanted = std::env::args().nth(1).unwrap_or_default();
    let adapters = Host::adapters(&wanted, wgpu::InstanceFlags::default());
    let adapter = adapters.first().ok_or("no such Vulkan adapter")?;
    let (host, name) = (Host::new(adapter)?, adapter.get_info().name);
    for format in PoseFormat::ALL {
        let Played { error, picture, reference } = play(&host, format, 43_788, 30..43)?;
        println!(
            "{name}, {}: the pose is within {:.1e} of the diagonal and {:.3}°; {:.4}% of the pixels differ by more than 2 of 255",
            format.name(),
            error.position,
            error.normal_degrees,
            100.0 * difference(&picture, &reference),
        );
        if format == PoseFormat::Fixed16 {
            let mut png = png::Encoder::new(std::fs::File::create("head.png")?, EDGE, EDGE);
            png.set_color(png::ColorType::Rgba);
            png.write_header()?.write_image_data(&picture)?;
        }
    }
    Ok(())
}
