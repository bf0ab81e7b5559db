//! Plots of the last updates: how many targets changed, and how many bytes moved.

use super::style::{ACCENT, DIM, GRID, INK, PLATE, called};
use crate::table::{bytes, thousands};
use deltamorph::UpdateStats;
use egui::{Align2, CornerRadius, FontId, Pos2, Rect, Sense, Stroke, Ui, pos2, vec2};
use std::collections::VecDeque;

/// Frames in a plot.
pub const FRAMES: usize = 180;
/// Height of a plot.
const HEIGHT: f32 = 72.0;

const CHANGED: (&str, &str) =
    ("targets changed", "targets whose weight differs from the previous frame; only these are updated");
const MOVED: (&str, &str) = ("bytes moved", "bytes that the update of a frame loads and stores");

/// Shows both plots.
pub fn all(ui: &mut Ui, rows: &VecDeque<UpdateStats>) {
    show(ui, CHANGED, rows, |stats| stats.coefficients as f64, |changed| thousands(changed as usize));
    show(ui, MOVED, rows, |stats| stats.bytes_moved as f64, bytes);
}

/// Shows one value of each update, the oldest at the left, and the last one in words.
fn show(
    ui: &mut Ui,
    (title, about): (&str, &str),
    rows: &VecDeque<UpdateStats>,
    value: fn(&UpdateStats) -> f64,
    words: impl Fn(f64) -> String,
) {
    let values: Vec<f64> = rows.iter().rev().map(value).collect();
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT), Sense::hover());
    called(&response, title).on_hover_text(about);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, CornerRadius::same(6), PLATE);
    let inner = rect.shrink2(vec2(10.0, 8.0));
    let last = words(values.last().copied().unwrap_or(0.0));
    painter.text(inner.left_top(), Align2::LEFT_TOP, title, FontId::proportional(11.5), DIM);
    painter.text(inner.right_top(), Align2::RIGHT_TOP, last, FontId::proportional(13.0), INK);
    let area = Rect::from_min_max(inner.left_top() + vec2(0.0, 22.0), inner.right_bottom());
    painter.hline(area.x_range(), area.bottom(), Stroke::new(1.0, GRID));
    let most = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let step = area.width() / (FRAMES - 1) as f32;
    let first = FRAMES - values.len();
    let point = |(i, value): (usize, &f64)| {
        pos2(area.left() + i as f32 * step, area.bottom() - (value / most) as f32 * area.height())
    };
    let points: Vec<Pos2> = (first..).zip(&values).map(point).collect();
    painter.line(points, Stroke::new(1.4, ACCENT));
}
