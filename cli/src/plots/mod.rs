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
const SUPERSAMPLE: u32 = 2;

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
        let scale = SCALE * f64::from(SUPERSAMPLE);
        let (width, height) = self.size(SCALE);
        let large = (width * SUPERSAMPLE, height * SUPERSAMPLE);
        let mut pixels = vec![0u8; large.0 as usize * large.1 as usize * 3];
        self.draw(&BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area(), scale, BITMAP_LIFT)?;
        let failed = || PlotError("the picture is too large".into());
        let image = image::RgbImage::from_raw(large.0, large.1, pixels).ok_or_else(failed)?;
        image::imageops::thumbnail(&image, width, height).save(path).map_err(PlotError::new)
    }
}

#[cfg(test)]
mod tests {
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
}
