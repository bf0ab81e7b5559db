//! Drawing figures with plotters, as SVG and PNG: its axes, labels and grids; the legend outside the data, the "all" at
//! the end of an axis, and the markers are drawn here.

use super::axis::Axis;
use super::{Axes, Bar, Chart, Figure, Look, Point, Series};
use crate::output::{Failure, write_file};
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::f64::consts::TAU;
use std::path::Path;

/// The family that text is set in: the browser's own in SVG, the built-in font in PNG.
const FONT: &str = "sans-serif";
const WIDTH: f64 = 720.0;
/// Height of a line chart.
const HEIGHT: f64 = 440.0;
/// Where the plot begins, below the heading.
const TOP: f64 = 94.0;
/// Height of a bar with its share of the gaps.
const ROW: f64 = 34.0;
/// Space for the labels of an axis and for what it counts.
const LABELS: f64 = 52.0;
const MARGIN: f64 = 22.0;

const INK: RGBColor = RGBColor(0x22, 0x26, 0x2e);
/// Ink of what explains.
const MUTED: RGBColor = RGBColor(0x66, 0x6d, 0x7a);
/// Ink of axes.
const AXIS: RGBColor = RGBColor(0x9a, 0xa1, 0xad);
const GRID: RGBColor = RGBColor(0xe6, 0xe8, 0xec);
const PAPER: RGBColor = WHITE;

type Error<DB> = DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>;

/// Pixels per point in the files: sharp on dense screens.
const SCALE: f64 = 2.0;
/// PNGs are drawn this much larger and averaged: the bitmaps of plotters have no smooth polygons.
const SUPERSAMPLE: u32 = 2;
/// plotters centres text in bitmaps by a height that leaves the descenders out.
const BITMAP_LIFT: f64 = 0.2;

impl Figure {
    /// Write the figure into `dir`, as SVG and as PNG; returns the SVG.
    pub fn write(&self, dir: &Path) -> Result<String, Failure> {
        // The font comes along, so that no machine needs fonts of its own.
        let registered = plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
        registered.map_err(|_| failed("the built-in font is damaged"))?;
        let (size, mut svg) = (size(&self.chart, SCALE), String::new());
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        Sheet { area: &area, scale: SCALE, lift: 0.0 }.draw(self).map_err(failed)?;
        drop(area);
        write_file(&dir.join(format!("{}.svg", self.slug)), &svg)?;

        let large = (size.0 * SUPERSAMPLE, size.1 * SUPERSAMPLE);
        let mut pixels = vec![0u8; large.0 as usize * large.1 as usize * 3];
        let area = BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area();
        let scale = SCALE * f64::from(SUPERSAMPLE);
        Sheet { area: &area, scale, lift: BITMAP_LIFT }.draw(self).map_err(failed)?;
        drop(area);
        let image = image::RgbImage::from_raw(large.0, large.1, pixels);
        let image = image.ok_or_else(|| failed("the picture is too large"))?;
        let png = dir.join(format!("{}.png", self.slug));
        image::imageops::thumbnail(&image, size.0, size.1).save(png).map_err(failed)?;
        Ok(svg)
    }
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("cannot draw the plot: {error}; do without the report (bench: --no-report)"))
}

/// Width and height of a figure with `scale` pixels per point.
fn size(chart: &Chart, scale: f64) -> (u32, u32) {
    let height = match chart {
        Chart::Lines { .. } => HEIGHT,
        Chart::Bars { bars, .. } => TOP + ROW * bars.len() as f64 + 42.0,
    };
    ((WIDTH * scale) as u32, (height * scale) as u32)
}

/// About how wide a text is: browsers set SVG in fonts of theirs.
fn width(text: &str, size: f64) -> f64 {
    0.5 * size * text.chars().count() as f64
}

/// The widest of texts.
fn widest<'a>(texts: impl Iterator<Item = &'a String>) -> f64 {
    texts.map(|text| width(text, 12.5)).fold(0.0, f64::max)
}

/// A surface, measured in points.
struct Sheet<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    /// Pixels per point.
    scale: f64,
    /// How far the area sets text too high, as a part of its size.
    lift: f64,
}

impl<DB: DrawingBackend> Sheet<'_, DB> {
    fn draw(&self, figure: &Figure) -> Result<(), Error<DB>> {
        self.area.fill(&PAPER)?;
        self.text(&figure.title, (MARGIN, 26.0), 19.0, INK, HPos::Left)?;
        for (line, y) in figure.subtitle.iter().zip([48.0, 65.0]) {
            let most = ((WIDTH - 2.0 * MARGIN) / width("x", 12.5)) as usize;
            let cut: String = line.chars().take(most).collect();
            let line = if cut.len() < line.len() { cut + "…" } else { cut };
            self.text(&line, (MARGIN, y), 12.5, MUTED, HPos::Left)?;
        }
        match &figure.chart {
            Chart::Lines { labels, axes, series } => self.lines(*labels, *axes, series)?,
            Chart::Bars { least, bars } => self.bars(*least, bars)?,
        }
        self.area.present()
    }

    fn px(&self, points: f64) -> i32 {
        (points * self.scale).round() as i32
    }

    fn pen(&self, color: RGBColor, width: f64) -> ShapeStyle {
        color.stroke_width(self.px(width).max(1) as u32)
    }

    fn style(&self, size: f64, color: RGBColor) -> TextStyle<'static> {
        // plotters sizes a font by its line height, 1.24 of what everyone else calls its size.
        (FONT, size * 1.24 * self.scale).into_font().color(&color)
    }

    /// A line of text, centred on `at` vertically.
    fn text(&self, text: &str, at: (f64, f64), size: f64, color: RGBColor, side: HPos) -> Result<(), Error<DB>> {
        let style = self.style(size, color).pos(Pos::new(side, VPos::Center));
        self.area.draw_text(text, &style, (self.px(at.0), self.px(at.1 + self.lift * size)))
    }

    /// Draw axes with their labels, and a grid across the one that values are read from.
    fn axes(
        &self,
        [x, y]: [Axis; 2],
        labels: [&str; 2],
        left: f64,
        right: f64,
    ) -> Result<ChartContext<'_, DB, Cartesian2d<Axis, Axis>>, Error<DB>> {
        let bars = labels[1].is_empty();
        let mut chart = ChartBuilder::on(self.area)
            .margin_top(self.px(TOP))
            .margin_right(self.px(right))
            .margin_bottom(self.px(10.0))
            .margin_left(self.px(left))
            .x_label_area_size(self.px(if bars { 32.0 } else { LABELS }))
            .y_label_area_size(self.px(if bars { 0.0 } else { LABELS }))
            .build_cartesian_2d(x.clone(), y.clone())?;
        let mut mesh = chart.configure_mesh();
        mesh.bold_line_style(self.pen(GRID, 1.0)).light_line_style(TRANSPARENT).axis_style(self.pen(AXIS, 1.0));
        mesh.label_style(self.style(12.0, MUTED)).axis_desc_style(self.style(12.0, MUTED));
        mesh.y_label_offset(self.px(12.0 * self.lift))
            .set_all_tick_mark_size(self.px(4.0))
            .x_desc(labels[0])
            .y_desc(labels[1]);
        if bars {
            mesh.disable_y_mesh()
        } else {
            mesh.disable_x_mesh()
        };
        mesh.x_label_formatter(&|tick| x.label(*tick)).y_label_formatter(&|tick| y.label(*tick)).draw()?;
        Ok(chart)
    }

    fn lines(&self, labels: [&'static str; 2], axes: Axes, all: &[Series]) -> Result<(), Error<DB>> {
        let points = || all.iter().flat_map(|series| &series.points);
        // Error bars belong to the data: the axis makes room for them.
        let values = points().flat_map(|p| [low(p), p.y + p.error]);
        let numbers = points().map(|p| p.x);
        let (x, y) = match axes {
            Axes::Counts => (Axis::counts(numbers), Axis::values(values)),
            Axes::CountsFromZero => (Axis::counts(numbers), Axis::from_zero(values.fold(0.0, f64::max))),
            Axes::Values => (Axis::values(numbers), Axis::values(values)),
        };
        let right = MARGIN + 50.0 + widest(all.iter().map(|series| &series.label));
        let chart = self.axes([x, y], labels, MARGIN / 2.0, right)?;
        let place = |x: f64, y: f64| chart.plotting_area().map_coordinate(&(x, y));
        let start = chart.plotting_area().get_pixel_range().0.start;
        for (i, series) in all.iter().enumerate() {
            let (color, at) = (series.look.color(), |p: &Point| place(p.x, p.y));
            let (numbers, beyond): (Vec<Point>, Vec<Point>) = series.points.iter().partition(|p| p.x.is_finite());
            self.area.draw(&PathElement::new(numbers.iter().map(at).collect::<Vec<_>>(), self.pen(color, 2.0)))?;
            if let Some(beyond) = beyond.first() {
                // A path without batches: a level to compare the others with.
                let ends = [numbers.last().map_or((start, at(beyond).1), at), at(beyond)];
                self.area.draw(&DashedPathElement::new(ends, self.px(5.0), self.px(4.0), self.pen(color, 1.5)))?;
            }
            for p in &series.points {
                let ends = [low(p), p.y + p.error].map(|value| place(p.x, value));
                self.area.draw(&PathElement::new(ends, self.pen(color, 1.2)))?;
                self.marker(series.look, at(p))?;
            }
            let (left, y) = (WIDTH - right + 12.0, TOP + 8.0 + 22.0 * i as f64);
            let ends = [left, left + 24.0].map(|x| (self.px(x), self.px(y)));
            self.area.draw(&PathElement::new(ends, self.pen(color, 2.0)))?;
            self.marker(series.look, (self.px(left + 12.0), self.px(y)))?;
            self.text(&series.label, (left + 32.0, y), 12.5, INK, HPos::Left)?;
        }
        Ok(())
    }

    fn marker(&self, look: Look, (x, y): (i32, i32)) -> Result<(), Error<DB>> {
        let (corners, turn) = look.marker();
        let corner = |i| {
            let (sin, cos) = (TAU * (i as f64 + turn) / corners as f64).sin_cos();
            (x + self.px(4.6 * sin), y - self.px(4.6 * cos))
        };
        self.area.draw(&Polygon::new((0..corners).map(corner).collect::<Vec<_>>(), look.color()))
    }

    fn bars(&self, least: f64, bars: &[Bar]) -> Result<(), Error<DB>> {
        let x = Axis::from_zero(bars.iter().map(|bar| bar.length).fold(least, f64::max));
        let left = MARGIN + widest(bars.iter().map(|bar| &bar.label)) + 10.0;
        let right = MARGIN + widest(bars.iter().map(|bar| &bar.remark));
        let chart = self.axes([x, Axis::from_zero(1.0)], ["", ""], left, right)?;
        for (i, bar) in bars.iter().enumerate() {
            let y = TOP + ROW * (i as f64 + 0.5);
            self.text(&bar.label, (left - 10.0, y), 12.5, INK, HPos::Right)?;
            let [start, end] = [0.0, bar.length].map(|x| chart.plotting_area().map_coordinate(&(x, 0.0)).0);
            let [top, bottom] = [y - 10.0, y + 10.0].map(|y| self.px(y));
            self.area.draw(&Rectangle::new([(start, top), (end.max(start + 1), bottom)], bar.look.color().filled()))?;
            // The remark stands at the end of its bar, on paper, so that the grid does not cross it.
            let at = f64::from(end) / self.scale + 8.0;
            let paper = self.px(at + width(&bar.remark, 12.0));
            self.area.draw(&Rectangle::new([(end + self.px(4.0), top), (paper, bottom)], PAPER.filled()))?;
            self.text(&bar.remark, (at, y), 12.0, MUTED, HPos::Left)?;
        }
        Ok(())
    }
}

/// The lower end of an error bar, which a logarithmic axis can show.
fn low(p: &Point) -> f64 {
    (p.y - p.error).max(p.y / 2.0)
}
