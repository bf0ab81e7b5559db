//! What figures show.

use plotters::prelude::RGBColor;

#[derive(Clone, Debug)]
pub struct Figure {
    /// File name without extension.
    pub slug: String,
    /// What a reader should know.
    pub caption: String,
    pub title: String,
    /// What is constant.
    pub subtitle: [String; 2],
    pub chart: Chart,
}

#[derive(Clone, Debug)]
pub enum Chart {
    Lines {
        /// What x counts and what y measures.
        labels: [&'static str; 2],
        axes: Axes,
        /// A value to compare with, drawn across.
        reference: Option<f64>,
        series: Vec<Series>,
    },
    /// Horizontal bars from 0.
    Bars { unit: Unit, bars: Vec<Bar> },
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
pub struct Series {
    pub label: String,
    pub color: RGBColor,
    pub marker: Marker,
    /// Ascending in x.
    pub points: Vec<Point>,
}

/// A point with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// A number, or [`ALL`].
    pub x: f64,
    pub y: f64,
    pub error: f64,
}

/// The place after all numbers on the x axis: every target in one pass.
pub const ALL: f64 = f64::INFINITY;

/// Shape of a data point, so that series differ without colour too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    Circle,
    Triangle,
    Square,
    Diamond,
}

#[derive(Clone, Debug)]
pub struct Bar {
    pub label: String,
    /// What is written at its end.
    pub remark: String,
    pub length: f64,
    pub color: RGBColor,
}

/// What the lengths of bars are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Shares: the axis ends at 100 % or later.
    Share,
    Milliseconds,
}
