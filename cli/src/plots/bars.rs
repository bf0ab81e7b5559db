//! Bar charts.

use super::axis::{Axis, fitting};
use super::canvas::{AXIS, Align, Canvas, Drawn, GRID, INK, MUTED, PAPER, Type, WIDTH};
use crate::table::percent;
use plotters::prelude::{DrawingBackend, RGBColor};

const ROW: f64 = 34.0;
const TOP: f64 = 94.0;

#[derive(Clone, Debug)]
pub struct Bar {
    pub label: String,
    /// What is written behind it.
    pub remark: String,
    pub length: f64,
    pub color: RGBColor,
}

/// What lengths are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Shares: the axis goes from 0 to 100 %.
    Share,
    /// Milliseconds: the axis goes from 0 as far as they do.
    Milliseconds,
}

/// Horizontal bars from 0.
#[derive(Clone, Debug)]
pub struct BarChart {
    pub title: String,
    pub subtitle: [String; 2],
    /// What their lengths are.
    pub unit: Unit,
    pub bars: Vec<Bar>,
}

impl BarChart {
    /// Height of the figure, in points.
    pub fn height(&self) -> f64 {
        TOP + ROW * self.bars.len() as f64 + 42.0
    }

    pub fn draw<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn {
        let left_aligned = |size, color| Type { size, color, align: Align::Left };
        canvas.fill(PAPER)?;
        canvas.heading(&self.title, &self.subtitle)?;

        let (mut labels, mut remarks) = (0.0f64, 0.0f64);
        for bar in &self.bars {
            labels = labels.max(canvas.text_width(&bar.label, 12.5)?);
            remarks = remarks.max(canvas.text_width(&bar.remark, 12.0)?);
        }
        let longest = self.bars.iter().map(|b| b.length).fold(0.0, f64::max);
        let (ticks, end): (Vec<(f64, String)>, f64) = match self.unit {
            // A path can beat a floor measured with a copy: the axis grows with it.
            Unit::Share => ((0..=4).map(|i| (f64::from(i) / 4.0, format!("{} %", 25 * i))).collect(), longest.max(1.0)),
            Unit::Milliseconds => {
                let axis = Axis::from_zero(longest);
                (axis.ticks.iter().map(|&t| (t, Axis::label(t))).collect(), axis.hi)
            }
        };
        let (left, right) = (24.0 + labels + 12.0, WIDTH - 24.0 - remarks - 10.0);
        let x = |length: f64| left + (right - left) * length / end;
        let bottom = TOP + ROW * self.bars.len() as f64;
        let mark = Type { size: 12.0, color: MUTED, align: Align::Center };
        let widths = ticks.iter().map(|(_, label)| canvas.text_width(label, mark.size)).collect::<Drawn<Vec<_>>>()?;
        let places: Vec<(f64, f64)> = ticks.iter().zip(widths).map(|((t, _), width)| (x(*t), width)).collect();
        let fits = fitting(&places);
        for ((tick, label), fits) in ticks.iter().zip(fits) {
            let full = self.unit == Unit::Share && *tick == 1.0;
            canvas.line(&[(x(*tick), TOP - 4.0), (x(*tick), bottom)], if full { AXIS } else { GRID }, 1.0)?;
            if fits {
                canvas.text(label, (x(*tick), bottom + 16.0), mark)?;
            }
        }
        for (i, bar) in self.bars.iter().enumerate() {
            let y = TOP + ROW * (i as f64 + 0.5);
            let label = Type { size: 12.5, color: INK, align: Align::Right };
            canvas.text(&bar.label, (left - 12.0, y), label)?;
            canvas.rect((left, y - 10.0), (x(bar.length).max(left + 1.0), y + 10.0), bar.color)?;
            let at = (x(bar.length) + 8.0, y);
            // The remark stands right behind its bar, on paper, so that the grid does not cross it.
            let width = canvas.text_width(&bar.remark, 12.0)?;
            canvas.rect((at.0 - 3.0, y - 8.0), (at.0 + width, y + 8.0), PAPER)?;
            canvas.text(&bar.remark, at, left_aligned(12.0, MUTED))?;
        }
        canvas.line(&[(left, TOP - 4.0), (left, bottom)], AXIS, 1.0)
    }
}

/// The remark behind a bar: its share and what it took.
pub fn remark(share: f64, ms: f64, batch: Option<&str>) -> String {
    let batch = batch.map(|b| format!(" · {b}")).unwrap_or_default();
    format!("{} · {} ms{batch}", percent(share), crate::table::sig3(ms))
}
