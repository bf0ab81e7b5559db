//! The panel: shows the state, and turns input into commands.

use super::command::{Command, Look};
use super::measured::{Measured, Row};
use super::plot::{self, Plot};
use super::sliders;
use super::state::State;
use super::style::{DIM, ERROR, INK, PANEL, WIDTH};
use crate::args::values::{BudgetSpec, format_on, name, summary};
use crate::detail::Detail;
use crate::table::{bytes, percent, sig3, thousands};
use clap::ValueEnum;
use deltamorph::{DeltaFormat, PoseFormat, UpdateDesc, UpdatePath};
use egui::{
    Align, Button, ComboBox, Frame, Key, Layout, Margin, Panel, Rect, RichText, ScrollArea, Sense, Slider, Ui, vec2,
};

/// Budgets to choose from, as fractions of the diagonal.
const BUDGETS: [f32; 5] = [0.0, 1e-5, 1e-4, 5e-4, 2e-3];
/// Height of the plots.
const PLOTS: f32 = 104.0;

/// Facts about the device and the update, for the panel.
pub struct About<'a> {
    pub device: &'a str,
    /// Paths that the device supports.
    pub paths: &'a [UpdatePath],
    pub desc: UpdateDesc,
    pub format: DeltaFormat,
    /// If some targets are left out, the number of all targets, and the fewest and most that an instance keeps.
    pub kept: Option<(usize, [usize; 2])>,
}

/// Shows the panel; returns the rest of the window, in points, and the user's commands.
pub fn show(ui: &mut Ui, state: &State, measured: &Measured, about: &About<'_>) -> (Rect, Vec<Command>) {
    let mut done = vec![];
    keys(ui, state, &mut done);
    let room = ui.available_size();
    // A small window shows only the instances.
    if state.panel && room.x > WIDTH + 120.0 {
        let frame = Frame::new().fill(PANEL).inner_margin(Margin::symmetric(14, 12));
        Panel::left("panel").exact_size(WIDTH).resizable(false).frame(frame).show(ui, |ui| {
            title(ui, state, about);
            ui.add_space(4.0);
            clip(ui, state, &mut done);
            ui.add_space(4.0);
            ways(ui, state, about, &mut done);
            looks(ui, state, &mut done);
            ui.add_space(2.0);
            ui.separator();
            sliders::tools(ui, state, &mut done);
            ScrollArea::vertical().auto_shrink([false; 2]).show(ui, |ui| sliders::list(ui, state, &mut done));
        });
    }
    if state.panel && room.x > WIDTH + 360.0 && room.y > 3.0 * PLOTS {
        let frame = Frame::new().fill(PANEL).inner_margin(Margin::symmetric(12, 10));
        Panel::bottom("plots").exact_size(PLOTS + 20.0).resizable(false).frame(frame).show(ui, |ui| {
            ui.horizontal(|ui| plots(ui, state, measured, about));
        });
    }
    let free = ui.available_rect_before_wrap();
    orbit(ui, free, state, &mut done);
    notice(ui, free, state, &mut done);
    (free, done)
}

fn keys(ui: &Ui, state: &State, done: &mut Vec<Command>) {
    if ui.ctx().egui_wants_keyboard_input() {
        return;
    }
    let pressed = |key| ui.input(|input| input.key_pressed(key));
    if pressed(Key::Space) && state.clip.is_some() {
        done.push(if state.playing { Command::Pause } else { Command::Play });
    }
    if pressed(Key::Tab) {
        done.push(Command::Panel(!state.panel));
    }
}

/// Dragging turns the instances; the wheel zooms.
fn orbit(ui: &mut Ui, free: Rect, state: &State, done: &mut Vec<Command>) {
    let response = ui.allocate_rect(free, Sense::click_and_drag());
    let (moved, [yaw, pitch]) = (response.drag_delta(), state.camera);
    if moved != vec2(0.0, 0.0) {
        let turned = (yaw - 0.4 * moved.x + 540.0).rem_euclid(360.0) - 180.0;
        done.push(Command::Camera([turned, (pitch + 0.3 * moved.y).clamp(-89.0, 89.0)]));
    }
    let wheel = if response.hovered() { ui.input(|input| input.smooth_scroll_delta().y) } else { 0.0 };
    if wheel != 0.0 {
        done.push(Command::Zoom((state.zoom * (wheel * 0.003).exp()).clamp(0.2, 20.0)));
    }
    if response.double_clicked() {
        done.extend([Command::Camera([0.0, 0.0]), Command::Zoom(1.0)]);
    }
}

fn notice(ui: &Ui, free: Rect, state: &State, done: &mut Vec<Command>) {
    let Some((text, is_error)) = &state.notice else { return };
    let wide = (free.width() - 60.0).clamp(160.0, 620.0);
    let place = egui::pos2(free.center().x - wide / 2.0, free.top() + 18.0);
    egui::Area::new("notice".into()).fixed_pos(place).show(ui.ctx(), |ui| {
        Frame::window(ui.style()).show(ui, |ui| {
            ui.set_width(wide - 24.0);
            ui.horizontal_top(|ui| {
                ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
                    if ui.add(Button::new("✖").frame(false)).clicked() {
                        done.push(Command::Dismiss);
                    }
                    ui.with_layout(Layout::left_to_right(Align::Min), |ui| {
                        ui.set_max_width(ui.available_width());
                        let colour = if *is_error { ERROR } else { INK };
                        ui.add(egui::Label::new(RichText::new(text).color(colour)).wrap());
                    });
                });
            });
        });
    });
}

fn title(ui: &mut Ui, state: &State, about: &About<'_>) {
    let mesh = &state.input.kept;
    let name = if mesh.name.is_empty() { &state.input.origin } else { &mesh.name };
    ui.add(egui::Label::new(RichText::new(name).heading().color(INK)).truncate());
    let (vertices, targets) = (thousands(mesh.vertex_count()), thousands(mesh.targets.len()));
    let text = format!("{vertices} vertices · {targets} targets · {}", about.device);
    ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate());
}

fn clip(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    let Some(clip) = &state.clip else {
        ui.label(RichText::new("No clip: drop a CSV file here, or use --weights").small().color(DIM));
        return;
    };
    ui.horizontal(|ui| {
        let (icon, command) = if state.playing { ("⏸", Command::Pause) } else { ("▶", Command::Play) };
        if ui.add_sized([30.0, 24.0], Button::new(icon)).on_hover_text("space").clicked() {
            done.push(command);
        }
        ui.spacing_mut().slider_width = ui.available_width() - 78.0;
        let (mut at, last) = (state.at, (clip.frame_count() - 1) as f64);
        let scrub = ui.add(Slider::new(&mut at, 0.0..=last.max(1.0)).show_value(false));
        if scrub.on_hover_text(&clip.name).changed() {
            done.push(Command::Scrub(at));
        }
        ui.spacing_mut().combo_width = 62.0;
        ComboBox::from_id_salt("speed").selected_text(format!("{}×", state.speed)).show_ui(ui, |ui| {
            for speed in [0.1, 0.25, 0.5, 1.0, 2.0, 4.0] {
                if ui.selectable_label(state.speed == speed, format!("{speed}×")).clicked() {
                    done.push(Command::Speed(speed));
                }
            }
        });
    });
}

/// A choice in a row of the grid.
fn choice<T: Copy + PartialEq>(
    ui: &mut Ui,
    title: &str,
    now: T,
    all: &[T],
    name: impl Fn(T) -> String,
    hint: impl Fn(T) -> &'static str,
) -> Option<T> {
    ui.label(RichText::new(title).color(DIM));
    let mut chosen = None;
    ComboBox::from_id_salt(title).width(ui.available_width()).selected_text(name(now)).show_ui(ui, |ui| {
        for &one in all {
            if ui.selectable_label(one == now, name(one)).on_hover_text(hint(one)).clicked() {
                chosen = Some(one);
            }
        }
    });
    ui.end_row();
    chosen.filter(|one| *one != now)
}

fn ways(ui: &mut Ui, state: &State, about: &About<'_>, done: &mut Vec<Command>) {
    let UpdateDesc { path, pose, error_budget, .. } = about.desc;
    let formats: Vec<DeltaFormat> = DeltaFormat::ALL.into_iter().filter(|f| format_on(path, *f) == Some(*f)).collect();
    let diagonal = state.input.kept.diagonal;
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-3 * a.max(b);
    let budget = BUDGETS.into_iter().find(|b| near(b * diagonal, error_budget)).unwrap_or(error_budget / diagonal);
    let budget_name = |b: f32| if b == 0.0 { "none".to_owned() } else { format!("{b:e} of the diagonal") };
    egui::Grid::new("ways").num_columns(2).min_col_width(62.0).spacing([10.0, 6.0]).show(ui, |ui| {
        let chosen = choice(ui, "Path", path, about.paths, |p| p.name().into(), UpdatePath::summary);
        done.extend(chosen.map(Command::Path));
        let chosen = choice(ui, "Deltas", about.format, &formats, |f| f.name().into(), DeltaFormat::summary);
        done.extend(chosen.map(Command::Format));
        let chosen = choice(ui, "Poses", pose, path.poses(), |p| p.name().into(), PoseFormat::summary);
        done.extend(chosen.map(Command::Pose));
        let hint = |_| "changes too small to move a vertex this far wait";
        let chosen = choice(ui, "Budget", budget, &BUDGETS, budget_name, hint);
        done.extend(chosen.map(|b| Command::Budget(BudgetSpec::Diagonal(b))));
        let chosen = choice(ui, "Heads", state.heads, &[1, 2, 5, 12, 40], |n| n.to_string(), |_| "heads in the window");
        done.extend(chosen.map(Command::Heads));
        let hint = |detail| match detail {
            Detail::Pixels(_) => "targets come and go with the camera, fading",
            Detail::All | Detail::Share(_) => "the most important targets stay",
        };
        let name = |detail: Detail| match about.kept.filter(|_| detail == state.detail) {
            Some((all, [_, most])) => format!("{detail} ({most} of {all})"),
            None => detail.to_string(),
        };
        done.extend(choice(ui, "Detail", state.detail, &Detail::ALL, name, hint).map(Command::Detail));
    });
}

fn looks(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    ui.add_space(2.0);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.spacing_mut().button_padding.x = 6.0;
        for &look in Look::value_variants() {
            let label = ui.selectable_label(state.look == look, RichText::new(name(look)).size(12.5));
            if label.on_hover_text(summary(look)).clicked() {
                done.push(Command::Show(look));
            }
        }
    });
}

fn plots(ui: &mut Ui, state: &State, measured: &Measured, about: &About<'_>) {
    let rows: Vec<&Row> = measured.rows.iter().rev().take(plot::FRAMES).collect();
    let line = |value: &dyn Fn(&Row) -> f64| rows.iter().rev().map(|row| value(row)).collect::<Vec<f64>>();
    let (on_device, heads) = (about.desc.path != UpdatePath::Cpu, f64::from(state.heads));
    let update = |row: &Row| if on_device { row.sample.update_ms.unwrap_or(0.0) } else { row.sample.cpu_ms };
    let frame = |row: &Row| if on_device { row.sample.frame_ms.unwrap_or(0.0) } else { row.wall_ms };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
    let (changed, moved) =
        (line(&|row| row.sample.stats.coefficients as f64), line(&|row| row.sample.stats.bytes_moved as f64));
    let (updates, frames) = (line(&update), line(&frame));
    let shares: Vec<f64> =
        updates.iter().zip(&frames).map(|(u, f)| if *f > 0.0 { 100.0 * u / f } else { 0.0 }).collect();
    let full_bytes = measured.full.map(|(b, _)| b as f64 * heads);
    let full_ms = measured.full.and_then(|(_, ms)| ms).map(|ms| ms * heads);
    let share = measured.summary(on_device).update_share;
    let plots = [
        Plot {
            title: "targets changed",
            now: thousands(last(&changed) as usize),
            mark: Some(((state.input.kept.targets.len() as f64) * heads, "all".into())),
            values: changed,
        },
        Plot {
            title: "bytes moved",
            now: bytes(last(&moved)),
            mark: full_bytes.map(|full| (full, format!("full evaluation {}", bytes(full)))),
            values: moved,
        },
        Plot {
            title: if on_device { "device time" } else { "CPU time" },
            now: format!("{} ms", sig3(last(&updates))),
            mark: full_ms.map(|full| (full, format!("full evaluation {} ms", sig3(full)))),
            values: updates,
        },
        Plot {
            title: "of the frame",
            now: share.map_or("–".into(), percent),
            mark: Some((5.0, format!("5% of {} ms", sig3(mean(&frames))))),
            values: shares,
        },
    ];
    let count = plots.len() as f32;
    let wide = (ui.available_width() - (count - 1.0) * ui.spacing().item_spacing.x) / count;
    plots.iter().for_each(|plot| plot::show(ui, vec2(wide, PLOTS), plot));
}
