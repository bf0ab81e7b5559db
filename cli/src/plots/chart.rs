//! Line charts.

use super::axis::{Axis, fitting};
use super::canvas::{AXIS, Align, Canvas, Drawn, GRID, INK, MUTED, Marker, PAPER, Type, WIDTH};
use plotters::prelude::{DrawingBackend, RGBColor};

/// Height of a line chart, in points.
pub const HEIGHT: f64 = 440.0;
const LABEL: Type = Type { size: 12.0, color: MUTED, align: Align::Center };
const LEGEND: Type = Type { size: 12.5, color: INK, align: Align::Left };
/// How far "all" stands from the last number, as a part of the plot's width.
const ALL_GAP: f64 = 0.08;

/// Where on the x axis a point stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum X {
    /// At a number.
    Value(f64),
    /// At the marked end: every target in one pass.
    All,
}

/// A point with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub x: X,
    pub y: f64,
    pub error: f64,
}

#[derive(Clone, Debug)]
pub struct Series {
    pub label: String,
    pub color: RGBColor,
    pub marker: Marker,
    /// Its points, ascending in x, `X::All` last.
    pub points: Vec<Point>,
}

/// How the axes of a line chart are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Counts along x; y logarithmic when the values span much.
    Counts,
    /// Counts along x; y starts at 0, whatever the values span: where proportions matter.
    CountsFromZero,
    /// Both logarithmic; a value of 0 stands at the start.
    Log,
}

#[derive(Clone, Debug)]
pub struct LineChart {
    pub title: String,
    pub subtitle: [String; 2],
    pub x_label: String,
    pub y_label: String,
    pub series: Vec<Series>,
    pub axes: Axes,
    /// A value to compare with, drawn across.
    pub reference: Option<f64>,
}

struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: Axis,
    y: Axis,
    /// Where the numbers end: `right`, or before "all".
    numbers_end: f64,
}

impl Frame {
    fn x(&self, x: X) -> f64 {
        match x {
            X::Value(v) => self.left + self.x.at(v) * (self.numbers_end - self.left),
            X::All => self.right - 0.3 * (self.right - self.numbers_end),
        }
    }

    fn y(&self, y: f64) -> f64 {
        self.bottom - self.y.at(y) * (self.bottom - self.top)
    }
}

impl LineChart {
    /// `labels`: what x counts and what y measures.
    pub fn new(title: &str, subtitle: [String; 2], labels: [&str; 2], axes: Axes, series: Vec<Series>) -> Self {
        let [x_label, y_label] = labels.map(str::to_owned);
        Self { title: title.into(), subtitle, x_label, y_label, series, axes, reference: None }
    }

    pub fn draw<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn {
        canvas.fill(PAPER)?;
        canvas.heading(&self.title, &self.subtitle)?;
        let frame = self.frame(canvas)?;
        self.draw_axes(canvas, &frame)?;
        for (i, series) in self.series.iter().enumerate() {
            draw_series(canvas, &frame, series)?;
            let y = frame.top + 8.0 + 22.0 * i as f64;
            let x = frame.right + 22.0;
            canvas.line(&[(x, y), (x + 24.0, y)], series.color, 2.0)?;
            canvas.marker(series.marker, (x + 12.0, y), series.color, false)?;
            canvas.text(&series.label, (x + 32.0, y), LEGEND)?;
        }
        Ok(())
    }

    fn frame<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn<Frame> {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let numbers: Vec<f64> = points().filter_map(|p| if let X::Value(v) = p.x { Some(v) } else { None }).collect();
        // Error bars belong to the data: the axis makes room for them.
        let values = points().flat_map(|p| [(p.y - p.error).max(p.y / 2.0), p.y + p.error]).chain(self.reference);
        let (x, y) = match self.axes {
            Axes::Counts => (Axis::counts(numbers), Axis::values(values)),
            Axes::CountsFromZero => (Axis::counts(numbers), Axis::from_zero(values.fold(0.0, f64::max))),
            Axes::Log => (Axis::log_of(numbers), Axis::log_of(values)),
        };
        let mut legend = 0.0f64;
        for series in &self.series {
            legend = legend.max(canvas.text_width(&series.label, LEGEND.size)?);
        }
        let mut labels = 0.0f64;
        for &tick in &y.ticks {
            labels = labels.max(canvas.text_width(&Axis::label(tick), LABEL.size)?);
        }
        let (left, right) = ((labels + 43.0).max(70.0), WIDTH - 22.0 - 32.0 - legend - 18.0);
        let all = points().any(|p| p.x == X::All);
        Ok(Frame {
            left,
            right,
            top: 96.0,
            bottom: HEIGHT - 62.0,
            x,
            y,
            numbers_end: if all { right - ALL_GAP * (right - left) } else { right },
        })
    }

    fn draw_axes<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>, f: &Frame) -> Drawn {
        for &tick in &f.y.ticks {
            canvas.line(&[(f.left, f.y(tick)), (f.right, f.y(tick))], GRID, 1.0)?;
            let label = Type { align: Align::Right, ..LABEL };
            canvas.text(&Axis::label(tick), (f.left - 9.0, f.y(tick)), label)?;
        }
        let mut ticks: Vec<(f64, String)> =
            f.x.ticks.iter().map(|&tick| (f.x(X::Value(tick)), Axis::label(tick))).collect();
        if f.numbers_end < f.right {
            let gap = 0.75 * f.numbers_end + 0.25 * f.right;
            canvas.dashed((gap, f.top), (gap, f.bottom), AXIS, 1.0)?;
            ticks.push((f.x(X::All), "all".into()));
        }
        let widths = ticks.iter().map(|(_, label)| canvas.text_width(label, LABEL.size)).collect::<Drawn<Vec<_>>>()?;
        let places: Vec<(f64, f64)> = ticks.iter().zip(widths).map(|((x, _), width)| (*x, width)).collect();
        for ((x, label), fits) in ticks.iter().zip(fitting(&places)) {
            canvas.line(&[(*x, f.bottom), (*x, f.bottom + 5.0)], AXIS, 1.0)?;
            if fits {
                canvas.text(label, (*x, f.bottom + 16.0), LABEL)?;
            }
        }
        if let Some(reference) = self.reference {
            canvas.dashed((f.left, f.y(reference)), (f.right, f.y(reference)), AXIS, 1.0)?;
        }
        canvas.line(&[(f.left, f.bottom), (f.right, f.bottom)], AXIS, 1.0)?;
        canvas.text(&self.x_label, (0.5 * (f.left + f.right), HEIGHT - 22.0), LABEL)?;
        canvas.text_up(&self.y_label, (22.0, 0.5 * (f.top + f.bottom)), LABEL)
    }
}

fn draw_series<DB: DrawingBackend>(canvas: &Canvas<'_, DB>, f: &Frame, series: &Series) -> Drawn {
    let at = |p: &Point| (f.x(p.x), f.y(p.y));
    let (numbers, all): (Vec<Point>, Vec<Point>) = series.points.iter().partition(|p| p.x != X::All);
    if numbers.len() > 1 {
        canvas.line(&numbers.iter().map(at).collect::<Vec<_>>(), series.color, 2.0)?;
    }
    match (numbers.last(), all.first()) {
        (Some(last), Some(all)) => canvas.dashed(at(last), at(all), series.color, 1.5)?,
        // A path without batches: a level to compare the others with.
        (None, Some(all)) => canvas.dashed((f.left, f.y(all.y)), at(all), series.color, 1.5)?,
        _ => {}
    }
    for p in &series.points {
        let (x, lo, hi) = (f.x(p.x), f.y((p.y - p.error).max(p.y / 2.0)), f.y(p.y + p.error));
        if p.error > 0.0 {
            canvas.line(&[(x, lo), (x, hi)], series.color, 1.2)?;
            for y in [lo, hi] {
                canvas.line(&[(x - 4.0, y), (x + 4.0, y)], series.color, 1.2)?;
            }
        }
        canvas.marker(series.marker, at(p), series.color, p.x == X::All)?;
    }
    Ok(())
}
