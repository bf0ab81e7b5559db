//! Pixels, and PNG files of them.

use crate::args::render::Background;
use crate::output::{Failure, Result, write_file};
use deltamorph_render::Picture;
use deltamorph_render::srgb::{decoded, encoded};
use std::path::Path;

impl Background {
    /// Linear, for the renderer.
    pub fn linear(self) -> [f32; 4] {
        let Some(colour) = self.0 else { return [0.0; 4] };
        let [r, g, b] = colour.map(decoded);
        [r, g, b, 1.0]
    }
}

/// The picture with straight alpha, like PNG: its colours are not multiplied by the opacity.
pub fn straight(mut picture: Picture) -> Picture {
    for pixel in picture.rgba.chunks_exact_mut(4).filter(|pixel| !matches!(pixel[3], 0 | 255)) {
        let opacity = f32::from(pixel[3]) / 255.0;
        pixel[..3].iter_mut().for_each(|c| *c = encoded(decoded(*c) / opacity));
    }
    picture
}

/// Writes a picture as PNG.
pub fn save(picture: Picture, path: &Path) -> Result<()> {
    let mut file = vec![];
    let mut encoder = encoder(&mut file, picture.size);
    encoder.set_compression(png::Compression::Default);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&straight(picture).rgba));
    written.map_err(|e| Failure::Failed(format!("a picture cannot be encoded: {e}")))?;
    write_file(path, file)
}

/// A PNG encoder for 8-bit RGBA in sRGB.
pub fn encoder<W: std::io::Write>(out: W, [width, height]: [u32; 2]) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder
}
