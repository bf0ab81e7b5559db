//! Small plots of the last frames.

use super::style::{ACCENT, DIM, FULL, GRID, INK, PLATE};
use egui::{Align2, CornerRadius, FontId, Pos2, Rect, Sense, Stroke, Ui, Vec2, pos2, vec2};

/// Frames in a plot.
pub const FRAMES: usize = 180;

/// A line of values, oldest first, and a value to compare it with.
pub struct Plot<'a> {
    pub title: &'a str,
    pub values: Vec<f64>,
    /// A horizontal line, and its label.
    pub mark: Option<(f64, String)>,
    /// The last value, formatted.
    pub now: String,
}

/// Draws the plot into a space of this size.
pub fn show(ui: &mut Ui, size: Vec2, plot: &Plot<'_>) {
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, CornerRadius::same(6), PLATE);
    let small = FontId::proportional(11.5);
    let inner = rect.shrink2(vec2(10.0, 8.0));
    let now = painter.text(inner.right_top(), Align2::RIGHT_TOP, &plot.now, FontId::proportional(13.0), INK);
    // Clipped before the value, in a narrow window.
    let left = Rect::from_min_max(inner.min, pos2(now.left() - 4.0, inner.bottom()));
    painter.with_clip_rect(left).text(inner.left_top(), Align2::LEFT_TOP, plot.title, small.clone(), DIM);
    let area = Rect::from_min_max(inner.left_top() + vec2(0.0, 22.0), inner.right_bottom());
    let most = plot.values.iter().copied().chain(plot.mark.iter().map(|(value, _)| *value)).fold(0.0, f64::max);
    let scale = if most > 0.0 { most * 1.12 } else { 1.0 };
    let y = |value: f64| area.bottom() - (value / scale) as f32 * area.height();
    painter.hline(area.x_range(), area.bottom(), Stroke::new(1.0, GRID));
    if let Some((value, name)) = &plot.mark {
        painter.hline(area.x_range(), y(*value), Stroke::new(1.2, FULL));
        // Above the line if there is room, else below it.
        let above = y(*value) - area.top() > 14.0;
        let (align, gap) = if above { (Align2::LEFT_BOTTOM, -1.0) } else { (Align2::LEFT_TOP, 2.0) };
        painter.text(pos2(area.left(), y(*value) + gap), align, name, small, FULL);
    }
    let step = area.width() / (FRAMES - 1) as f32;
    let first = FRAMES.saturating_sub(plot.values.len());
    let points: Vec<Pos2> =
        (first..).zip(&plot.values).map(|(i, value)| pos2(area.left() + i as f32 * step, y(*value))).collect();
    painter.line(points, Stroke::new(1.4, ACCENT));
}
