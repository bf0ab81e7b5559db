//! Drawing figures with plotters: its axes, labels and grids; the legend outside the data, the "all" at the end of an
//! axis, and the markers are drawn here.

use super::axis::Axis;
use super::figure::{Axes, Bar, Chart, Figure, Marker, Point, Series, Unit};
use plotters::coord::Shift;
use plotters::element::{DashedPathElement, Drawable, PointCollection};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::f64::consts::TAU;

/// The family that text is set in: the browser's own in SVG, the built-in font in PNG.
pub const FONT: &str = "sans-serif";
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

/// Width and height of a figure, in points.
pub fn size(chart: &Chart) -> (f64, f64) {
    match chart {
        Chart::Lines { .. } => (WIDTH, HEIGHT),
        Chart::Bars { bars, .. } => (WIDTH, TOP + ROW * bars.len() as f64 + 42.0),
    }
}

/// Draw on `area` with `scale` pixels per point; `lift`: how far it sets text too high, as a part of its size.
pub fn figure<DB: DrawingBackend>(
    figure: &Figure,
    area: &DrawingArea<DB, Shift>,
    scale: f64,
    lift: f64,
) -> Result<(), Error<DB>> {
    let sheet = Sheet { area, scale, lift };
    area.fill(&PAPER)?;
    sheet.text(&figure.title, (MARGIN, 26.0), 19.0, INK, HPos::Left)?;
    for (line, y) in figure.subtitle.iter().zip([48.0, 65.0]) {
        let most = ((WIDTH - 2.0 * MARGIN) / width("x", 12.5)) as usize;
        let cut: String = line.chars().take(most).collect();
        let line = if cut.len() < line.len() { cut + "…" } else { cut };
        sheet.text(&line, (MARGIN, y), 12.5, MUTED, HPos::Left)?;
    }
    match &figure.chart {
        Chart::Lines { labels, axes, reference, series } => sheet.lines(*labels, *axes, *reference, series)?,
        Chart::Bars { unit, bars } => sheet.bars(*unit, bars)?,
    }
    area.present()
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

    fn draw<E>(&self, element: E) -> Result<(), Error<DB>>
    where
        E: Drawable<DB>,
        for<'e> &'e E: PointCollection<'e, (i32, i32)>,
    {
        self.area.draw(&element)
    }

    fn dashed(&self, from: (i32, i32), to: (i32, i32), color: RGBColor, width: f64) -> Result<(), Error<DB>> {
        self.draw(DashedPathElement::new([from, to], self.px(5.0), self.px(4.0), self.pen(color, width)))
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

    fn lines(
        &self,
        labels: [&'static str; 2],
        axes: Axes,
        reference: Option<f64>,
        all: &[Series],
    ) -> Result<(), Error<DB>> {
        let points = || all.iter().flat_map(|series| &series.points);
        // Error bars belong to the data: the axis makes room for them.
        let values = points().flat_map(|p| [low(p), p.y + p.error]).chain(reference);
        let numbers = points().map(|p| p.x);
        let (x, y) = match axes {
            Axes::Counts => (Axis::counts(numbers), Axis::values(values)),
            Axes::CountsFromZero => (Axis::counts(numbers), Axis::from_zero(values.fold(0.0, f64::max))),
            Axes::Log => (Axis::log_of(numbers), Axis::log_of(values)),
        };
        let right = MARGIN + 50.0 + widest(all.iter().map(|series| &series.label));
        let gap = x.gap();
        let chart = self.axes([x, y], labels, MARGIN / 2.0, right)?;
        let place = |x: f64, y: f64| chart.plotting_area().map_coordinate(&(x, y));
        let (across, up) = chart.plotting_area().get_pixel_range();
        if let Some(reference) = reference {
            let (_, y) = place(0.0, reference);
            self.dashed((across.start, y), (across.end, y), AXIS, 1.0)?;
        }
        if let Some(gap) = gap {
            let x = across.start + (across.len() as f64 * gap) as i32;
            self.dashed((x, up.start), (x, up.end), AXIS, 1.0)?;
        }
        for (i, series) in all.iter().enumerate() {
            let at = |p: &Point| place(p.x, p.y);
            let (numbers, beyond): (Vec<Point>, Vec<Point>) = series.points.iter().partition(|p| p.x.is_finite());
            self.draw(PathElement::new(numbers.iter().map(at).collect::<Vec<_>>(), self.pen(series.color, 2.0)))?;
            if let Some(beyond) = beyond.first() {
                // A path without batches: a level to compare the others with.
                let from = numbers.last().map_or((across.start, at(beyond).1), at);
                self.dashed(from, at(beyond), series.color, 1.5)?;
            }
            for p in &series.points {
                let ends = [low(p), p.y + p.error].map(|value| place(p.x, value));
                self.draw(PathElement::new(ends, self.pen(series.color, 1.2)))?;
                self.marker(series, at(p), !p.x.is_finite())?;
            }
            let (left, y) = (WIDTH - right + 12.0, TOP + 8.0 + 22.0 * i as f64);
            let ends = [left, left + 24.0].map(|x| (self.px(x), self.px(y)));
            self.draw(PathElement::new(ends, self.pen(series.color, 2.0)))?;
            self.marker(series, (self.px(left + 12.0), self.px(y)), false)?;
            self.text(&series.label, (left + 32.0, y), 12.5, INK, HPos::Left)?;
        }
        Ok(())
    }

    /// A data point; `ring` marks it as a special one.
    fn marker(&self, series: &Series, (x, y): (i32, i32), ring: bool) -> Result<(), Error<DB>> {
        let (corners, turn, size) = match series.marker {
            Marker::Circle => (24, 0.0, 1.0),
            Marker::Triangle => (3, 0.0, 1.25),
            Marker::Square => (4, 0.5, 1.25),
            Marker::Diamond => (4, 0.0, 1.25),
        };
        let rings = [(6.5, series.color), (4.8, PAPER), (3.4, series.color)];
        for (radius, color) in rings.into_iter().skip(usize::from(!ring)) {
            let corner = |i| {
                let (sin, cos) = (TAU * (f64::from(i) + turn) / f64::from(corners)).sin_cos();
                (x + self.px(size * radius * sin), y - self.px(size * radius * cos))
            };
            self.draw(Polygon::new((0..corners).map(corner).collect::<Vec<_>>(), color))?;
        }
        Ok(())
    }

    fn bars(&self, unit: Unit, bars: &[Bar]) -> Result<(), Error<DB>> {
        let longest = bars.iter().map(|bar| bar.length).fold(0.0, f64::max);
        let x = match unit {
            // A path can beat a floor measured with a copy: the axis grows with it.
            Unit::Share => Axis::shares(longest.max(1.0)),
            Unit::Milliseconds => Axis::from_zero(longest),
        };
        let left = MARGIN + widest(bars.iter().map(|bar| &bar.label)) + 10.0;
        let right = MARGIN + widest(bars.iter().map(|bar| &bar.remark));
        let chart = self.axes([x, Axis::none()], ["", ""], left, right)?;
        for (i, bar) in bars.iter().enumerate() {
            let y = TOP + ROW * (i as f64 + 0.5);
            self.text(&bar.label, (left - 10.0, y), 12.5, INK, HPos::Right)?;
            let [(start, _), (end, _)] = [0.0, bar.length].map(|x| chart.plotting_area().map_coordinate(&(x, 0.0)));
            let [top, bottom] = [y - 10.0, y + 10.0].map(|y| self.px(y));
            self.draw(Rectangle::new([(start, top), (end.max(start + 1), bottom)], bar.color.filled()))?;
            // The remark stands at the end of its bar, on paper, so that the grid does not cross it.
            let at = f64::from(end) / self.scale + 8.0;
            let paper = self.px(at + width(&bar.remark, 12.0));
            self.draw(Rectangle::new([(end + self.px(4.0), top), (paper, bottom)], PAPER.filled()))?;
            self.text(&bar.remark, (at, y), 12.0, MUTED, HPos::Left)?;
        }
        Ok(())
    }
}

/// The lower end of an error bar, which a logarithmic axis can show.
fn low(p: &Point) -> f64 {
    (p.y - p.error).max(p.y / 2.0)
}
