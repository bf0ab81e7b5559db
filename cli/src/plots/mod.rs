//! The figures of a report, and how they become SVG and PNG.

mod axis;
mod draw;
mod figure;

pub use figure::*;

use crate::output::{Failure, write_file};
use plotters::prelude::*;
use std::path::Path;

/// Pixels per point in the files: sharp on dense screens.
const SCALE: f64 = 2.0;
/// PNGs are drawn this much larger and averaged: the bitmaps of plotters have no smooth polygons.
const SUPERSAMPLE: u32 = 2;
/// plotters centres text in bitmaps by a height that leaves the descenders out.
const BITMAP_LIFT: f64 = 0.2;

impl Figure {
    pub fn svg(&self) -> Result<String, Failure> {
        register_font()?;
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, self.size()).into_drawing_area();
        draw::figure(self, &area, SCALE, 0.0).map_err(failed)?;
        drop(area);
        Ok(svg)
    }

    /// Write the figure into `dir`, as SVG and as PNG; returns the SVG.
    pub fn write(&self, dir: &Path) -> Result<String, Failure> {
        let svg = self.svg()?;
        write_file(&dir.join(format!("{}.svg", self.slug)), &svg)?;
        let (width, height) = self.size();
        let large = (width * SUPERSAMPLE, height * SUPERSAMPLE);
        let mut pixels = vec![0u8; large.0 as usize * large.1 as usize * 3];
        let area = BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area();
        draw::figure(self, &area, SCALE * f64::from(SUPERSAMPLE), BITMAP_LIFT).map_err(failed)?;
        drop(area);
        let image = image::RgbImage::from_raw(large.0, large.1, pixels);
        let image = image.ok_or_else(|| failed("the picture is too large"))?;
        let png = dir.join(format!("{}.png", self.slug));
        image::imageops::thumbnail(&image, width, height).save(png).map_err(failed)?;
        Ok(svg)
    }

    /// In pixels.
    fn size(&self) -> (u32, u32) {
        let (width, height) = draw::size(&self.chart);
        ((width * SCALE) as u32, (height * SCALE) as u32)
    }
}

/// Make the built-in font known to plotters, so that no machine needs fonts of its own.
fn register_font() -> Result<(), Failure> {
    let registered = plotters::style::register_font(draw::FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    registered.map_err(|_| failed("the built-in font is damaged"))
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("cannot draw the plot: {error}; do without the report (bench: --no-report)"))
}
