//! Pixels: pictures side by side, text, and PNG files.

use crate::args::render::Background;
use crate::output::{Failure, write_file};
use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use deltamorph_render::Picture;
use deltamorph_render::srgb::{decoded, encoded};
use std::path::Path;

/// Horizontal alignment of text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    Left,
    Middle,
}

/// A picture in sRGB with straight alpha, like PNG.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    pub size: [u32; 2],
    rgba: Vec<u8>,
}

impl Background {
    /// Linear, for the renderer.
    pub fn linear(self) -> [f32; 4] {
        let Some(colour) = self.0 else { return [0.0; 4] };
        let [r, g, b] = colour.map(decoded);
        [r, g, b, 1.0]
    }

    fn pixel(self) -> [u8; 4] {
        self.0.map_or([0; 4], |[r, g, b]| [r, g, b, 255])
    }

    /// A readable ink on this background.
    pub fn ink(self) -> [u8; 3] {
        let bright = |[r, g, b]: [u8; 3]| 3 * u32::from(r) + 6 * u32::from(g) + u32::from(b) > 1300;
        // Without a background: a grey that is readable on black and on white.
        self.0.map_or([0x80; 3], |colour| if bright(colour) { [0x22, 0x26, 0x2e] } else { [0xd6, 0xda, 0xe2] })
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
    pub fn new(size: [u32; 2], background: Background) -> Self {
        Self { size, rgba: background.pixel().repeat(size[0] as usize * size[1] as usize) }
    }

    pub fn rgba(&self) -> &[u8] {
        &self.rgba
    }

    fn at(&mut self, x: i64, y: i64) -> Option<&mut [u8]> {
        let [width, height] = self.size.map(i64::from);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside.then(|| &mut self.rgba[((y * width + x) * 4) as usize..][..4])
    }

    /// Copies a picture to this position, clipped to the canvas.
    pub fn put(&mut self, picture: &Self, [left, top]: [u32; 2]) {
        for (y, row) in (0..).zip(picture.rgba.chunks_exact(picture.size[0] as usize * 4)) {
            for (x, pixel) in (0..).zip(row.chunks_exact(4)) {
                if let Some(place) = self.at(i64::from(left) + x, i64::from(top) + y) {
                    place.copy_from_slice(pixel);
                }
            }
        }
    }

    pub fn fill(&mut self, [left, top]: [u32; 2], [width, height]: [u32; 2], colour: [u8; 3]) {
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (left + x, top + y))) {
            if let Some(place) = self.at(x.into(), y.into()) {
                place.copy_from_slice(&[colour[0], colour[1], colour[2], 255]);
            }
        }
    }

    /// Writes a line of text, `size` pixels high, aligned at `x`, with its baseline at `y`. Text wider than `most` is
    /// set smaller, down to half the size, and then cut off.
    pub fn text(&mut self, text: &str, (x, y): (f32, f32), size: f32, ink: [u8; 3], align: Align, most: f32) {
        let Ok(font) = FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT) else { return };
        let width = |text: &str, size: f32| {
            let font = font.as_scaled(PxScale::from(size));
            text.chars().map(|c| font.h_advance(font.glyph_id(c))).sum::<f32>()
        };
        let size = size * (most / width(text, size)).clamp(0.5, 1.0);
        let mut text = text.to_owned();
        if width(&text, size) > most + 0.5 {
            while !text.is_empty() && width(&text, size) + width("…", size) > most {
                text.pop();
            }
            text.push('…');
        }
        let mut x = x - width(&text, size)
            * match align {
                Align::Left => 0.0,
                Align::Middle => 0.5,
            };
        let scaled = font.as_scaled(PxScale::from(size));
        for c in text.chars() {
            let id = scaled.glyph_id(c);
            let glyph = Glyph { id, scale: PxScale::from(size), position: point(x, y) };
            x += scaled.h_advance(id);
            let Some(outline) = scaled.outline_glyph(glyph) else { continue };
            let bounds = outline.px_bounds();
            outline.draw(|dx, dy, share| {
                let place = (bounds.min.x as i64 + i64::from(dx), bounds.min.y as i64 + i64::from(dy));
                if let Some(pixel) = self.at(place.0, place.1) {
                    blend(pixel, ink, share.clamp(0.0, 1.0));
                }
            });
        }
    }

    pub fn png(&self) -> Result<Vec<u8>, Failure> {
        let mut file = vec![];
        let mut encoder = encoder(&mut file, self.size);
        encoder.set_compression(png::Compression::Default);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&self.rgba));
        written.map_err(|e| Failure::Failed(format!("a picture cannot be encoded: {e}")))?;
        Ok(file)
    }

    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        write_file(path, self.png()?)
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

/// Blends ink over a pixel.
fn blend(pixel: &mut [u8], ink: [u8; 3], share: f32) {
    let behind = f32::from(pixel[3]) / 255.0;
    let opacity = share + behind * (1.0 - share);
    if opacity > 0.0 {
        for (c, ink) in pixel.iter_mut().zip(ink) {
            let mixed = decoded(ink) * share + decoded(*c) * behind * (1.0 - share);
            *c = encoded(mixed / opacity);
        }
        pixel[3] = (opacity * 255.0).round() as u8;
    }
}
