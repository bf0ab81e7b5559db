//! The figures of a report, and how they become SVG and PNG.

pub mod axis;
pub mod bars;
pub mod canvas;
pub mod chart;

use crate::output::{Failure, write_file};
use bars::BarChart;
use canvas::{Canvas, Drawn, PlotError, WIDTH, register_font};
use chart::{HEIGHT, LineChart};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Pixels per point in the files: sharp on dense screens.
const SCALE: f64 = 2.0;
/// PNGs are drawn this much larger and averaged: plotters' bitmaps have no smooth polygons.
const SUPERSAMPLE: usize = 2;

/// plotters centres bitmap text by a height that leaves the descenders out.
const BITMAP_LIFT: f64 = 0.2;

#[derive(Clone, Debug)]
pub struct Figure {
    /// File name without extension.
    pub slug: String,
    /// What a reader should know.
    pub caption: String,
    pub chart: Chart,
}

#[derive(Clone, Debug)]
pub enum Chart {
    Lines(LineChart),
    Bars(BarChart),
}

impl Figure {
    pub fn title(&self) -> &str {
        match &self.chart {
            Chart::Lines(c) => &c.title,
            Chart::Bars(c) => &c.title,
        }
    }

    fn size(&self, scale: f64) -> (u32, u32) {
        let height = match &self.chart {
            Chart::Lines(_) => HEIGHT,
            Chart::Bars(c) => c.height(),
        };
        ((WIDTH * scale) as u32, (height * scale) as u32)
    }

    fn draw<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>, scale: f64, lift: f64) -> Drawn {
        let canvas = Canvas::new(area, scale, lift);
        match &self.chart {
            Chart::Lines(c) => c.draw(&canvas)?,
            Chart::Bars(c) => c.draw(&canvas)?,
        }
        area.present().map_err(PlotError::new)
    }

    pub fn svg(&self) -> Drawn<String> {
        register_font()?;
        let mut svg = String::new();
        self.draw(&SVGBackend::with_string(&mut svg, self.size(SCALE)).into_drawing_area(), SCALE, 0.0)?;
        Ok(svg)
    }

    /// Write the figure into `dir`, as SVG and as PNG; returns the SVG.
    pub fn write(&self, dir: &Path) -> Result<String, Failure> {
        let failed = |e| Failure::failed(&e);
        let svg = self.svg().map_err(failed)?;
        write_file(&dir.join(format!("{}.svg", self.slug)), &svg)?;
        self.write_png(&dir.join(format!("{}.png", self.slug))).map_err(failed)?;
        Ok(svg)
    }

    pub fn write_png(&self, path: &Path) -> Drawn {
        register_font()?;
        let scale = SCALE * SUPERSAMPLE as f64;
        let (width, height) = self.size(SCALE);
        let large = (width * SUPERSAMPLE as u32, height * SUPERSAMPLE as u32);
        let mut pixels = vec![0u8; large.0 as usize * large.1 as usize * 3];
        self.draw(&BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area(), scale, BITMAP_LIFT)?;
        let small = average(&pixels, large.0 as usize);
        let mut png = BitMapBackend::new(path, (width, height));
        png.blit_bitmap((0, 0), (width, height), &small).map_err(PlotError::new)?;
        png.present().map_err(PlotError::new)
    }
}

/// Average squares of [`SUPERSAMPLE`]² pixels of an RGB image.
fn average(pixels: &[u8], width: usize) -> Vec<u8> {
    let n = SUPERSAMPLE;
    let mut small = Vec::with_capacity(pixels.len() / (n * n));
    for rows in pixels.chunks_exact(width * 3 * n) {
        for x in 0..width / n {
            for channel in 0..3 {
                let at = |i: usize| (i / n * width + x * n + i % n) * 3 + channel;
                let sum: u32 = (0..n * n).map(|i| u32::from(rows[at(i)])).sum();
                small.push((sum / (n * n) as u32) as u8);
            }
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{select, synthetic};

    #[test]
    fn every_figure_becomes_svg_and_png() {
        let dir = tempfile::tempdir().expect("a folder");
        let figures = select::figures(&synthetic::report());
        for figure in &figures {
            let svg = figure.svg().expect("drawn");
            assert!(svg.contains("<svg") && svg.contains("</svg>") && svg.contains("sans-serif"), "{}", figure.slug);
            let path = dir.path().join("a.png");
            figure.write_png(&path).expect("written");
            assert_eq!(std::fs::read(&path).expect("read")[..4], *b"\x89PNG");
        }
    }

    #[test]
    fn pixels_are_averaged() {
        let white_and_black = [255u8, 255, 255, 0, 0, 0, 255, 255, 255, 0, 0, 0];
        assert_eq!(average(&white_and_black, 2), [127, 127, 127]);
    }
}
