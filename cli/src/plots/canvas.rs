//! A thin layer over plotters: shapes in points of the figure, whatever the pixels are.
//!
//! Charts are drawn by hand rather than with plotters' chart builder, which has no place for a legend outside
//! the data and no axis with an "all" at its end.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::sync::OnceLock;

/// Width of every figure, in points.
pub const WIDTH: f64 = 720.0;
/// The family the text is set in: the browser's own in SVG, the built-in font in PNG.
const FONT: &str = "sans-serif";

pub const INK: RGBColor = RGBColor(0x22, 0x26, 0x2e);
/// Ink of what explains.
pub const MUTED: RGBColor = RGBColor(0x66, 0x6d, 0x7a);
/// Ink of axes.
pub const AXIS: RGBColor = RGBColor(0x9a, 0xa1, 0xad);
/// Ink of the grid.
pub const GRID: RGBColor = RGBColor(0xe6, 0xe8, 0xec);
pub const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);

/// Why a figure could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the plot: {0}; do without the report (bench: --no-report)")]
pub struct PlotError(pub String);

impl PlotError {
    /// From any error of plotters.
    pub fn new(error: impl std::fmt::Display) -> Self {
        Self(error.to_string())
    }
}

/// What can go wrong while drawing.
pub type Drawn<T = ()> = Result<T, PlotError>;

/// Make the built-in font known to plotters, so that no machine needs fonts of its own.
pub fn register_font() -> Drawn {
    static DONE: OnceLock<bool> = OnceLock::new();
    let register =
        || plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT).is_ok();
    if *DONE.get_or_init(register) { Ok(()) } else { Err(PlotError("the built-in font is damaged".into())) }
}

/// Where a text stands relative to its point.
#[derive(Clone, Copy, Debug)]
pub enum Align {
    /// To the right of it.
    Left,
    Center,
    /// To the left of it.
    Right,
}

/// How a text is set. Texts are always centred on their point vertically.
#[derive(Clone, Copy, Debug)]
pub struct Type {
    pub size: f64,
    pub color: RGBColor,
    /// Where it stands.
    pub align: Align,
}

/// Shape of a data point, so that series differ without colour too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    Circle,
    Triangle,
    Square,
    Diamond,
}

/// A surface to draw on.
pub struct Canvas<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    /// Pixels per point.
    scale: f64,
    /// How far the bitmap backend sets text too high, as a part of its size.
    lift: f64,
}

impl<'a, DB: DrawingBackend> Canvas<'a, DB> {
    /// Draw on `area` with `scale` pixels per point; `lift`: how far it sets text too high, as a part of its size.
    pub fn new(area: &'a DrawingArea<DB, Shift>, scale: f64, lift: f64) -> Self {
        Self { area, scale, lift }
    }

    fn px(&self, (x, y): (f64, f64)) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }

    fn pen(&self, color: RGBColor, width: f64) -> ShapeStyle {
        color.stroke_width((width * self.scale).round().max(1.0) as u32)
    }

    pub fn fill(&self, color: RGBColor) -> Drawn {
        self.area.fill(&color).map_err(PlotError::new)
    }

    pub fn line(&self, points: &[(f64, f64)], color: RGBColor, width: f64) -> Drawn {
        let points: Vec<_> = points.iter().map(|&p| self.px(p)).collect();
        self.area.draw(&PathElement::new(points, self.pen(color, width))).map_err(PlotError::new)
    }

    pub fn dashed(&self, from: (f64, f64), to: (f64, f64), color: RGBColor, width: f64) -> Drawn {
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let at = |d: f64| (from.0 + (to.0 - from.0) * d / length, from.1 + (to.1 - from.1) * d / length);
        let mut starts = (0..).map(|i| f64::from(i) * 9.0).take_while(|start| *start < length);
        starts.try_for_each(|start| self.line(&[at(start), at((start + 5.0).min(length))], color, width))
    }

    pub fn rect(&self, a: (f64, f64), b: (f64, f64), color: RGBColor) -> Drawn {
        self.area.draw(&Rectangle::new([self.px(a), self.px(b)], color.filled())).map_err(PlotError::new)
    }

    /// A data point; `ring` marks it as a special one.
    pub fn marker(&self, shape: Marker, (x, y): (f64, f64), color: RGBColor, ring: bool) -> Drawn {
        if ring {
            self.shape(shape, (x, y), 6.5, color)?;
            self.shape(shape, (x, y), 4.7, PAPER)?;
            return self.shape(shape, (x, y), 3.0, color);
        }
        self.shape(shape, (x, y), 4.6, PAPER)?;
        self.shape(shape, (x, y), 3.5, color)
    }

    fn shape(&self, shape: Marker, (x, y): (f64, f64), r: f64, color: RGBColor) -> Drawn {
        let corners: &[(f64, f64)] = match shape {
            Marker::Circle => {
                let circle = Circle::new(self.px((x, y)), (r * self.scale).round() as i32, color.filled());
                return self.area.draw(&circle).map_err(PlotError::new);
            }
            Marker::Triangle => &[(0.0, -1.25), (1.1, 0.75), (-1.1, 0.75)],
            Marker::Square => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            Marker::Diamond => &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
        };
        let points: Vec<_> = corners.iter().map(|c| self.px((x + c.0 * r, y + c.1 * r))).collect();
        self.area.draw(&Polygon::new(points, color.filled())).map_err(PlotError::new)
    }

    fn style(&self, text: Type) -> TextStyle<'static> {
        let h = match text.align {
            Align::Left => HPos::Left,
            Align::Center => HPos::Center,
            Align::Right => HPos::Right,
        };
        // plotters sizes a font by its line height, 1.24 of what everyone else calls its size.
        let font = (FONT, text.size * 1.24 * self.scale).into_font();
        TextStyle { font, color: text.color.to_backend_color(), pos: Pos::new(h, VPos::Center) }
    }

    pub fn text(&self, text: &str, (x, y): (f64, f64), set: Type) -> Drawn {
        let at = (x, y + self.lift * set.size);
        self.area.draw(&Text::new(text.to_owned(), self.px(at), self.style(set))).map_err(PlotError::new)
    }

    /// A line of text that runs upwards, centred on its point.
    pub fn text_up(&self, text: &str, (x, y): (f64, f64), set: Type) -> Drawn {
        let at = (x + self.lift * set.size, y);
        let style = self.style(Type { align: Align::Center, ..set }).transform(FontTransform::Rotate270);
        self.area.draw(&Text::new(text.to_owned(), self.px(at), style)).map_err(PlotError::new)
    }

    /// The heading of a figure: a title, and two lines of what was constant, cut where the figure ends.
    pub fn heading(&self, title: &str, subtitle: &[String; 2]) -> Drawn {
        let left = |size, color| Type { size, color, align: Align::Left };
        self.text(title, (24.0, 26.0), left(19.0, INK))?;
        for (line, y) in subtitle.iter().zip([48.0, 65.0]) {
            let mut line = line.clone();
            while self.text_width(&line, 12.5)? > WIDTH - 40.0 {
                let shorter = line.chars().count().saturating_sub(2);
                line = line.chars().take(shorter).chain(['…']).collect();
            }
            self.text(&line, (24.0, y), left(12.5, MUTED))?;
        }
        Ok(())
    }

    /// Width of a line of text, in points.
    pub fn text_width(&self, text: &str, size: f64) -> Drawn<f64> {
        let style = self.style(Type { size, color: INK, align: Align::Left });
        let (w, _) = self.area.estimate_text_size(text, &style).map_err(PlotError::new)?;
        // Browsers set SVG in a font of theirs, most of which run wider.
        Ok(f64::from(w) / self.scale * 1.08)
    }
}
