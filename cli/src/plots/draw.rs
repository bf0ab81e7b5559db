//! Draws figures with plotters, as SVG and PNG. Axes, labels and grids are its own; the legend outside the data, the
//! "all" at the end of an axis, and the markers are drawn here.

use super::axis::Axis;
use super::plan::{BAR, DATA, ENTRY, GAP, LEADING, MARGIN, Plan, SAMPLE, TEXT, TICKS, TITLE, width};
use super::{Axes, Bar, Chart, Figure, Look, Point, Series};
use crate::output::{Failure, write_file};
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::f64::consts::TAU;
use std::path::Path;

/// Font family of text: in SVG the browser's own, in PNG the built-in font.
const FONT: &str = "sans-serif";
/// Widths in points: of a column of a wide page, and of a phone.
const WIDE: f64 = 640.0;
const NARROW: f64 = 360.0;
/// Space for the labels and the name of the vertical axis.
const LABELS: f64 = 52.0;

const INK: RGBColor = RGBColor(0x22, 0x26, 0x2e);
/// Ink of explanations.
const MUTED: RGBColor = RGBColor(0x66, 0x6d, 0x7a);
/// Ink of axes.
const AXIS: RGBColor = RGBColor(0x9a, 0xa1, 0xad);
const GRID: RGBColor = RGBColor(0xe6, 0xe8, 0xec);
const PAPER: RGBColor = WHITE;

type Error<DB> = DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>;

/// Pixels per point in the files: sharp on dense screens.
const SCALE: f64 = 2.0;
/// PNGs are drawn this much larger and averaged: plotters does not antialias polygons in bitmaps.
const SUPERSAMPLE: u32 = 2;
/// In bitmaps, plotters centres text by a height without descenders.
const BITMAP_LIFT: f64 = 0.2;

/// A drawn figure, as SVG for wide and for narrow pages.
pub struct Drawn {
    pub figure: Figure,
    pub wide: String,
    pub narrow: String,
}

impl Figure {
    /// Draws the figure, and writes it into `dir` as SVG and as PNG, both wide.
    pub fn write(self, dir: &Path) -> Result<Drawn, Failure> {
        register_font()?;
        let [wide, narrow] = [WIDE, NARROW].map(|width| self.svg(width));
        let wide = wide?;
        write_file(&dir.join(format!("{}.svg", self.slug)), &wide)?;

        let plan = Plan::new(&self, WIDE);
        let [size, large] = [1, SUPERSAMPLE].map(|more| plan.size(SCALE * f64::from(more)));
        let mut pixels = vec![0u8; large.0 as usize * large.1 as usize * 3];
        let area = BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area();
        let scale = SCALE * f64::from(SUPERSAMPLE);
        Sheet { area: &area, scale, lift: BITMAP_LIFT, plan }.draw(&self).map_err(failed)?;
        drop(area);
        let image = image::RgbImage::from_raw(large.0, large.1, pixels);
        let image = image.ok_or_else(|| failed("the picture is too large"))?;
        let png = dir.join(format!("{}.png", self.slug));
        image::imageops::thumbnail(&image, size.0, size.1).save(png).map_err(failed)?;
        Ok(Drawn { wide, narrow: narrow?, figure: self })
    }

    /// Draws the figure, and writes it as SVG, wide.
    pub fn save_svg(&self, path: &Path) -> Result<(), Failure> {
        register_font()?;
        write_file(path, self.svg(WIDE)?)
    }

    /// The figure as SVG, `width` points wide.
    fn svg(&self, width: f64) -> Result<String, Failure> {
        let (plan, mut svg) = (Plan::new(self, width), String::new());
        let area = SVGBackend::with_string(&mut svg, plan.size(SCALE)).into_drawing_area();
        Sheet { area: &area, scale: SCALE, lift: 0.0, plan }.draw(self).map_err(failed)?;
        drop(area);
        Ok(svg)
    }
}

/// Registers the built-in font, so that no machine needs its own.
fn register_font() -> Result<(), Failure> {
    let registered = plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    registered.map_err(|_| failed("the built-in font is damaged"))
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("cannot draw the plot: {error}; do without it (bench: --no-report, lod: no --plot)"))
}

/// A surface, measured in points.
struct Sheet<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    /// Pixels per point.
    scale: f64,
    /// Offset by which the backend sets text too high, as a fraction of the text size.
    lift: f64,
    plan: Plan,
}

impl<DB: DrawingBackend> Sheet<'_, DB> {
    fn draw(&self, figure: &Figure) -> Result<(), Error<DB>> {
        self.area.fill(&PAPER)?;
        let mut y = MARGIN;
        for (lines, size, color) in [(&self.plan.title, TITLE, INK), (&self.plan.subtitle, TEXT, MUTED)] {
            for line in lines {
                self.text(line, (MARGIN, y + LEADING / 2.0 * size), size, color, HPos::Left)?;
                y += LEADING * size;
            }
        }
        match &figure.chart {
            Chart::Lines { labels, axes, series } => self.lines(labels[1], *axes, series)?,
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
        // plotters sizes a font by its line height, 1.24 times the usual size.
        (FONT, size * 1.24 * self.scale).into_font().color(&color)
    }

    /// Writes a line of text, vertically centred on `at`.
    fn text(&self, text: &str, at: (f64, f64), size: f64, color: RGBColor, side: HPos) -> Result<(), Error<DB>> {
        let style = self.style(size, color).pos(Pos::new(side, VPos::Center));
        self.area.draw_text(text, &style, (self.px(at.0), self.px(at.1 + self.lift * size)))
    }

    /// Draws axes with their labels between `left` and the right margin, down to `height` below the heading, and a grid
    /// for one axis: y if it has a name, else x.
    fn axes(
        &self,
        [x, y]: [Axis; 2],
        name: &str,
        left: f64,
        right: f64,
        height: f64,
    ) -> Result<ChartContext<'_, DB, Cartesian2d<Axis, Axis>>, Error<DB>> {
        let bars = name.is_empty();
        let labels = if bars { 0.0 } else { LABELS };
        let x = x.fitting(self.plan.width - left - labels - right);
        let mut chart = ChartBuilder::on(self.area)
            .margin_top(self.px(self.plan.top))
            .margin_right(self.px(right))
            .margin_bottom(self.px(self.plan.height - self.plan.top - height - TICKS))
            .margin_left(self.px(left))
            .x_label_area_size(self.px(TICKS))
            .y_label_area_size(self.px(labels))
            .build_cartesian_2d(x.clone(), y.clone())?;
        let mut mesh = chart.configure_mesh();
        mesh.bold_line_style(self.pen(GRID, 1.0)).light_line_style(TRANSPARENT).axis_style(self.pen(AXIS, 1.0));
        mesh.label_style(self.style(TEXT, MUTED)).axis_desc_style(self.style(TEXT, MUTED));
        mesh.y_label_offset(self.px(TEXT * self.lift)).set_all_tick_mark_size(self.px(4.0)).y_desc(name);
        if bars {
            mesh.disable_y_mesh()
        } else {
            mesh.disable_x_mesh()
        };
        mesh.x_label_formatter(&|tick| x.label(*tick)).y_label_formatter(&|tick| y.label(*tick)).draw()?;
        Ok(chart)
    }

    fn lines(&self, name: &str, axes: Axes, all: &[Series]) -> Result<(), Error<DB>> {
        let [x, y] = Axis::of_lines(axes, all);
        let chart = self.axes([x, y.clone()], &y.named(name), MARGIN / 2.0, MARGIN + 4.0, DATA)?;
        let place = |x: f64, y: f64| chart.plotting_area().map_coordinate(&(x, y));
        let start = chart.plotting_area().get_pixel_range().0.start;
        for series in all {
            let (color, at) = (series.look.color(), |p: &Point| place(p.x, p.y));
            let (numbers, beyond): (Vec<Point>, Vec<Point>) = series.points.iter().partition(|p| p.x.is_finite());
            self.area.draw(&PathElement::new(numbers.iter().map(at).collect::<Vec<_>>(), self.pen(color, 2.0)))?;
            if let Some(beyond) = beyond.first() {
                // A path without batches: a horizontal line to compare the others with.
                let ends = [numbers.last().map_or((start, at(beyond).1), at), at(beyond)];
                self.area.draw(&DashedPathElement::new(ends, self.px(5.0), self.px(4.0), self.pen(color, 1.5)))?;
            }
            for p in &series.points {
                let ends = [p.low, p.high].map(|value| place(p.x, y.within(value)));
                self.area.draw(&PathElement::new(ends, self.pen(color, 1.2)))?;
                self.marker(series.look, at(p))?;
            }
        }
        // The name of x, then the legend, in as many columns as fit.
        let (plan, mut down) = (&self.plan, self.plan.top + DATA + TICKS);
        for line in &plan.counted {
            down += LEADING * TEXT;
            self.text(line, (plan.width / 2.0, down - LEADING / 2.0 * TEXT), TEXT, MUTED, HPos::Center)?;
        }
        for (i, series) in all.iter().enumerate() {
            let (column, row) = (i % plan.columns, i / plan.columns);
            let left = MARGIN + column as f64 * (plan.width - 2.0 * MARGIN) / plan.columns as f64;
            let y = down + GAP + ENTRY * (row as f64 + 0.5);
            let ends = [left, left + 24.0].map(|x| (self.px(x), self.px(y)));
            self.area.draw(&PathElement::new(ends, self.pen(series.look.color(), 2.0)))?;
            self.marker(series.look, (self.px(left + 12.0), self.px(y)))?;
            self.text(&series.label, (left + SAMPLE, y), TEXT, INK, HPos::Left)?;
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
        let (plan, row) = (&self.plan, self.plan.row);
        let x = Axis::from_zero(bars.iter().map(|bar| bar.length).fold(least, f64::max));
        let (left, right) = plan.beside.unwrap_or((MARGIN, MARGIN + 4.0));
        let chart = self.axes([x, Axis::from_zero(1.0)], "", left, right, row * bars.len() as f64)?;
        for (i, bar) in bars.iter().enumerate() {
            // If its text is not beside it, the bar is at the bottom of its row.
            let y = plan.top + row * (i as f64 + 1.0) - (GAP + BAR) / 2.0;
            let [start, end] = [0.0, bar.length].map(|x| chart.plotting_area().map_coordinate(&(x, 0.0)).0);
            let [top, bottom] = [y - BAR / 2.0, y + BAR / 2.0].map(|y| self.px(y));
            self.area.draw(&Rectangle::new([(start, top), (end.max(start + 1), bottom)], bar.look.color().filled()))?;
            // A background for text, so that the grid does not cross it.
            let paper = |x: f64, y: f64, text: &str| {
                let [x, end] = [x - 3.0, x + width(text, TEXT) + 3.0].map(|x| self.px(x));
                let corners = [(x, self.px(y - 8.0)), (end, self.px(y + 8.0))];
                self.area.draw(&Rectangle::new(corners, PAPER.filled()))
            };
            if plan.beside.is_some() {
                self.text(&bar.label, (left - 10.0, y), TEXT, INK, HPos::Right)?;
                let at = f64::from(end) / self.scale + 8.0;
                paper(at, y, &bar.remark)?;
                self.text(&bar.remark, (at, y), TEXT, MUTED, HPos::Left)?;
                continue;
            }
            let above = y - BAR / 2.0 - LEADING * TEXT / 2.0;
            for (text, y, color) in [(&bar.label, above - LEADING * TEXT, INK), (&bar.remark, above, MUTED)] {
                paper(left + 4.0, y, text)?;
                self.text(text, (left + 4.0, y), TEXT, color, HPos::Left)?;
            }
        }
        Ok(())
    }
}
