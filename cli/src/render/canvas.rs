//! Pixels, and PNG files of them.

use crate::args::render::Background;
use crate::output::{Failure, write_file};
use deltamorph_render::Picture;
use deltamorph_render::srgb::{decoded, encoded};
use std::path::Path;

/// A picture in sRGB with straight alpha, like PNG.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    size: [u32; 2],
    rgba: Vec<u8>,
}

impl Background {
    /// Linear, for the renderer.
    pub fn linear(self) -> [f32; 4] {
        let Some(colour) = self.0 else { return [0.0; 4] };
        let [r, g, b] = colour.map(decoded);
        [r, g, b, 1.0]
    }
}

impl From<Picture> for Canvas {
    fn from(Picture { size, mut rgba }: Picture) -> Self {
        for pixel in rgba.chunks_exact_mut(4).filter(|pixel| !matches!(pixel[3], 0 | 255)) {
            let opacity = f32::from(pixel[3]) / 255.0;
            pixel[..3].iter_mut().for_each(|c| *c = encoded(decoded(*c) / opacity));
        }
        Self { size, rgba }
    }
}

impl Canvas {
    pub fn rgba(&self) -> &[u8] {
        &self.rgba
    }

    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = vec![];
        let mut encoder = encoder(&mut file, self.size);
        encoder.set_compression(png::Compression::Default);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&self.rgba));
        written.map_err(|e| Failure::Failed(format!("a picture cannot be encoded: {e}")))?;
        write_file(path, file)
    }
}

/// A PNG encoder for 8-bit RGBA in sRGB.
pub fn encoder<W: std::io::Write>(out: W, [width, height]: [u32; 2]) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder
}
