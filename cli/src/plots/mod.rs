//! The figures of a report: their contents.

mod axis;
mod draw;
mod plan;

pub use draw::Drawn;

use plotters::prelude::RGBColor;

#[derive(Clone, Debug)]
pub struct Figure {
    /// File name without extension.
    pub slug: String,
    /// An explanation for readers.
    pub caption: String,
    pub title: String,
    /// Constants of the measurements.
    pub subtitle: [String; 2],
    pub chart: Chart,
}

#[derive(Clone, Debug)]
pub enum Chart {
    Lines {
        /// Names of the x axis and the y axis.
        labels: [&'static str; 2],
        axes: Axes,
        series: Vec<Series>,
    },
    /// Horizontal bars from 0; the axis reaches at least to `least`.
    Bars { least: f64, bars: Vec<Bar> },
}

/// Types of the axes of a line chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Counts along x; y is logarithmic if the values span a large ratio.
    Counts,
    /// Counts along x; y starts at 0 for any values, to show proportions.
    CountsFromZero,
    /// Measures; both axes are logarithmic if the values span a large ratio.
    Values,
}

#[derive(Clone, Debug)]
pub struct Series {
    pub label: String,
    pub look: Look,
    /// Ascending in x.
    pub points: Vec<Point>,
}

/// A point with its error bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// A number, or [`ALL`].
    pub x: f64,
    pub y: f64,
    pub low: f64,
    pub high: f64,
}

impl Point {
    /// With the same error in both directions; downwards at most half of `y`, for logarithmic axes.
    pub fn new(x: f64, y: f64, error: f64) -> Self {
        Self { x, y, low: (y - error).max(y / 2.0), high: y + error }
    }
}

/// Position after all numbers on the x axis: every target in one pass.
pub const ALL: f64 = f64::INFINITY;

#[derive(Clone, Debug)]
pub struct Bar {
    pub label: String,
    /// Text at its end.
    pub remark: String,
    pub length: f64,
    pub look: Look,
}

/// Colour and marker. Series differ in the marker too, so that they can be told apart without colour.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    hue: usize,
    variant: usize,
}

/// Hues that colour-blind people can tell apart (after Okabe and Ito).
const HUES: [u32; 9] = [0x005f9e, 0xc44e00, 0xa84b86, 0x007a5a, 0x5b4bb0, 0x4a4f59, 0x8c6a00, 0x007f86, 0xa12a2a];

impl Look {
    /// For series that others are compared with.
    pub const PLAIN: Self = Self { hue: 5, variant: 1 };

    /// The `variant` of a hue: eight of them differ in shade or marker.
    pub fn new(hue: usize, variant: usize) -> Self {
        Self { hue: hue % HUES.len(), variant: variant % 8 }
    }

    /// Dark, or light for every other variant.
    pub fn color(self) -> RGBColor {
        let light = (self.variant + self.variant / 4) % 2 == 1;
        let [_, r, g, b] = HUES[self.hue].to_be_bytes();
        let [r, g, b] = [r, g, b].map(|c| if light { 255 - (255 - c) / 2 } else { c });
        RGBColor(r, g, b)
    }

    /// Corners of the marker, and its rotation as a share of the angle between two: circle, triangle, square, diamond.
    pub fn marker(self) -> (usize, f64) {
        [(24, 0.0), (3, 0.0), (4, 0.5), (4, 0.0)][self.variant % 4]
    }
}
