//! Small plots of the last frames.

use super::measured::{Measured, Row};
use super::panel::{About, called};
use super::state::State;
use super::style::{ACCENT, DIM, FULL, GRID, INK, PLATE};
use crate::table::{bytes, percent, sig3, thousands};
use deltamorph::UpdatePath;
use egui::{Align2, CornerRadius, FontId, Pos2, Rect, Sense, Stroke, Ui, Vec2, pos2, vec2};

/// Frames in a plot.
pub const FRAMES: usize = 180;

/// Height of a plot.
pub const HEIGHT: f32 = 104.0;

/// A line of values, oldest first, and a value to compare it with.
struct Plot {
    title: &'static str,
    about: &'static str,
    values: Vec<f64>,
    /// A horizontal line, and its label.
    mark: Option<(f64, String)>,
    /// The last value, formatted.
    now: String,
}

/// Draws the plot into a space of this size.
fn show(ui: &mut Ui, size: Vec2, plot: &Plot) {
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    called(&response, plot.title).on_hover_text(plot.about);
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

/// Draws all plots in so many columns.
pub fn all(ui: &mut Ui, columns: usize, state: &State, measured: &Measured, about: &About<'_>) {
    let rows: Vec<&Row> = measured.rows.iter().rev().take(FRAMES).collect();
    let line = |value: &dyn Fn(&Row) -> f64| rows.iter().rev().map(|row| value(row)).collect::<Vec<f64>>();
    let on_device = about.desc.path != UpdatePath::Cpu;
    let update = |row: &Row| if on_device { row.sample.update_ms.unwrap_or(0.0) } else { row.sample.cpu_ms };
    let frame = |row: &Row| if on_device { row.sample.frame_ms.unwrap_or(0.0) } else { row.wall_ms };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
    let changed = line(&|row| row.sample.stats.coefficients as f64);
    let moved = line(&|row| row.sample.stats.bytes_moved as f64);
    let updates = line(&update);
    let frames = line(&frame);
    let shares: Vec<f64> =
        updates.iter().zip(&frames).map(|(u, f)| if *f > 0.0 { 100.0 * u / f } else { 0.0 }).collect();
    let full_bytes = measured.full.map(|(b, _)| b as f64);
    let full_ms = measured.full.and_then(|(_, ms)| ms);
    let share = measured.summary(on_device).update_share;
    let plots = [
        Plot {
            title: "targets changed",
            about: "weights that differ from the frame before; only these are updated",
            now: thousands(last(&changed) as usize),
            mark: Some((state.input.kept.targets.len() as f64, "all".into())),
            values: changed,
        },
        Plot {
            title: "bytes moved",
            about: "loaded and stored by the update of a frame; the line: by an update from the base pose in float32",
            now: bytes(last(&moved)),
            mark: full_bytes.map(|full| (full, format!("full evaluation {}", bytes(full)))),
            values: moved,
        },
        Plot {
            title: if on_device { "device time" } else { "CPU time" },
            about: "what the update of a frame takes; the line: an update from the base pose in float32",
            now: format!("{} ms", sig3(last(&updates))),
            mark: full_ms.map(|full| (full, format!("full evaluation {} ms", sig3(full)))),
            values: updates,
        },
        Plot {
            title: "of the frame",
            about: "the update's share of the time of the whole frame: its median, and each frame",
            now: share.map_or("–".into(), percent),
            mark: Some(mean(&frames)).filter(|ms| *ms > 0.0).map(|ms| (5.0, format!("5% of {} ms", sig3(ms)))),
            values: shares,
        },
    ];
    let gap = ui.spacing().item_spacing.x;
    let wide = (ui.available_width() + gap) / columns as f32 - gap;
    for row in plots.chunks(columns) {
        ui.horizontal(|ui| row.iter().for_each(|plot| show(ui, vec2(wide, HEIGHT), plot)));
    }
}
