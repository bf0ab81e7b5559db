//! The panel: shows the state, and turns input into commands.

use super::command::{Command, Look};
use super::measured::Measured;
use super::state::{Notice, State};
use super::style::{ACCENT, DIM, ERROR, INK, PANEL};
use super::{hands, legend, plot, sliders};
use crate::args::values::{BudgetSpec, format_on, name, summary};
use crate::detail::Detail;
use crate::table::{bytes, percent, sig3, thousands};
use clap::ValueEnum;
use deltamorph::import;
use deltamorph::{DeltaFormat, PoseFormat, UpdateDesc, UpdatePath};
use egui::{
    Align, Area, Button, CollapsingHeader, ComboBox, Frame, Key, Layout, Margin, Panel, Rect, Response, RichText,
    ScrollArea, Slider, Ui, style::ScrollAnimation, vec2,
};
use std::path::Path;

/// Budgets to choose from, as fractions of the diagonal.
const BUDGETS: [f32; 5] = [0.0, 1e-5, 1e-4, 5e-4, 2e-3];
/// Least and largest zoom.
pub const ZOOM: [f32; 2] = [0.2, 20.0];
/// A window that is smaller, in points, shows only the instances.
const LEAST: [f32; 2] = [240.0, 180.0];
/// Most of the window that the panel takes.
const SHARE: f32 = 0.62;

/// Facts about the device and the update, for the panel.
pub struct About<'a> {
    pub device: &'a str,
    /// Paths that the device supports.
    pub paths: &'a [UpdatePath],
    pub desc: UpdateDesc,
    pub format: DeltaFormat,
    /// If some targets are left out, the number of all targets, and the fewest and most that an instance keeps.
    pub kept: Option<(usize, [usize; 2])>,
    /// Longest distance that a single target moves a vertex.
    pub reach: f32,
    /// Pixels of an input unit at the nearest point of the first instance.
    pub unit: f32,
}

/// Shows the panel; returns the rest of the window, in points, and the user's commands. The panel is at the left, in an
/// upright window below, and scrolls as a whole.
pub fn show(ui: &mut Ui, state: &State, measured: &Measured, about: &About<'_>) -> (Rect, Vec<Command>) {
    let mut done = vec![];
    hands::keys(ui, state, &mut done);
    let room = ui.available_size();
    let shown = state.panel && room.x >= LEAST[0] && room.y >= LEAST[1];
    let below = room.y > room.x && room.x < 2.0 * state.width;
    let size = state.width.min(SHARE * if below { room.y } else { room.x });
    // Where there is room, plots have a strip of their own.
    let strip = shown && !below && room.x > size + 560.0 && room.y > 3.0 * plot::HEIGHT;
    if shown {
        let panel = if below { Panel::bottom("panel") } else { Panel::left("panel") };
        let frame = Frame::new().fill(PANEL).inner_margin(Margin { left: 14, right: 2, top: 12, bottom: 6 });
        panel.exact_size(size).resizable(false).frame(frame).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink([false; 2]).show(ui, |ui| {
                ui.set_max_width(ui.available_width() - 12.0);
                title(ui, state, about, &mut done);
                ui.add_space(4.0);
                clip(ui, state, &mut done);
                ui.add_space(4.0);
                ways(ui, state, about, &mut done);
                saved(ui, measured);
                looks(ui, state, &mut done);
                ui.add_space(2.0);
                ui.separator();
                sliders::tools(ui, state, &mut done);
                sliders::list(ui, state, &mut done);
                if !strip {
                    let header = CollapsingHeader::new(RichText::new("Measurements").strong().color(INK));
                    header.default_open(true).show_unindented(ui, |ui| plot::all(ui, 2, state, measured, about));
                }
                follow_focus(ui);
            });
        });
    }
    if strip {
        let frame = Frame::new().fill(PANEL).inner_margin(Margin::symmetric(12, 10));
        Panel::bottom("plots").exact_size(plot::HEIGHT + 20.0).resizable(false).frame(frame).show(ui, |ui| {
            plot::all(ui, 4, state, measured, about);
        });
    }
    let free = ui.available_rect_before_wrap();
    hands::camera(ui, free, state, &mut done);
    if shown {
        hands::edge(ui, free, below, size, &mut done);
    } else if free.width() > 60.0 {
        buttons_without_panel(ui, free, &mut done);
    }
    legend::show(ui, free, state, about);
    notice(ui, free, state, &mut done);
    hands::help(ui, state, &mut done);
    (free, done)
}

/// Scrolls to what the keyboard reached.
fn follow_focus(ui: &Ui) {
    let keys = [Key::Tab, Key::ArrowUp, Key::ArrowDown];
    if keys.iter().any(|key| ui.input(|input| input.key_pressed(*key)))
        && let Some(focused) = ui.memory(|memory| memory.focused()).and_then(|id| ui.ctx().read_response(id))
        && focused.layer_id == ui.layer_id()
    {
        // At once: keys come faster than it glides.
        ui.scroll_to_rect_animation(focused.rect.expand(24.0), None, ScrollAnimation::none());
    }
}

/// A small button without a plate, with a name that is read out.
fn icon(ui: &mut Ui, icon: &str, name: &str) -> Response {
    let button = ui.add(Button::new(RichText::new(icon).color(DIM)).frame(false)).on_hover_text(name);
    button.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Button, true, name));
    button
}

fn help_button(ui: &mut Ui, done: &mut Vec<Command>) {
    if icon(ui, "?", "keys and mouse (?)").clicked() {
        done.push(Command::Help(true));
    }
}

/// The way back to the panel.
fn buttons_without_panel(ui: &Ui, free: Rect, done: &mut Vec<Command>) {
    Area::new("back".into()).fixed_pos(free.left_top() + vec2(8.0, 8.0)).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            if icon(ui, "☰", "show the panel (P)").clicked() {
                done.push(Command::Panel(true));
            }
            help_button(ui, done);
        });
    });
}

fn notice(ui: &Ui, free: Rect, state: &State, done: &mut Vec<Command>) {
    let Some(Notice { text, is_error, .. }) = &state.notice else { return };
    let wide = (free.width() - 60.0).clamp(160.0, 620.0);
    let place = egui::pos2(free.center().x - wide / 2.0, free.top() + 18.0);
    Area::new("notice".into()).fixed_pos(place).show(ui.ctx(), |ui| {
        Frame::window(ui.style()).show(ui, |ui| {
            ui.set_width(wide - 24.0);
            ui.horizontal_top(|ui| {
                ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
                    if icon(ui, "✖", "close (Esc)").clicked() {
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

fn title(ui: &mut Ui, state: &State, about: &About<'_>, done: &mut Vec<Command>) {
    let mesh = &state.input.kept;
    let name = if mesh.name.is_empty() { &state.input.origin } else { &mesh.name };
    ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
        if icon(ui, "✖", "hide the panel (P)").clicked() {
            done.push(Command::Panel(false));
        }
        help_button(ui, done);
        ui.with_layout(Layout::left_to_right(Align::Min), |ui| {
            ui.add(egui::Label::new(RichText::new(name).heading().color(INK)).truncate());
        });
    });
    let (vertices, targets) = (thousands(mesh.vertex_count()), thousands(mesh.targets.len()));
    let text = format!("{vertices} vertices · {targets} targets · {}", about.device);
    ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate());
}

/// How a clip is called: its animation, or its file without the end.
fn clip_name(path: &Path) -> String {
    let file = path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into());
    import::animation_of(path).map_or(file, |(_, name)| name.to_string())
}

fn clip(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    let Some(clip) = &state.clip else {
        ui.label(RichText::new("No clip: drop a CSV file here, or use --weights").small().color(DIM));
        return;
    };
    let name = state.chosen.as_deref().map_or_else(|| clip.name.clone(), clip_name);
    if state.clips.len() > 1 {
        let combo = ComboBox::from_id_salt("clips").width(ui.available_width()).truncate().selected_text(&name);
        let clips = state.clips.iter().map(|path| (path, clip_name(path), "", state.chosen.as_ref() == Some(path)));
        let about = ("Clip", "the clip: those of the mesh, and those that were dropped here");
        done.extend(pick(ui, combo, about, clips).map(|path| Command::Clip(path.clone())));
    } else {
        ui.add(egui::Label::new(RichText::new(&name).color(INK)).truncate()).on_hover_text(&clip.name);
    }
    ui.horizontal(|ui| {
        let (icon, name, command) = match state.playing {
            true => ("⏸", "Pause", Command::Pause),
            false => ("▶", "Play", Command::Play),
        };
        let button = ui.add_sized([30.0, 24.0], Button::new(icon)).on_hover_text(format!("{name} (space)"));
        button.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Button, true, name));
        if button.clicked() {
            done.push(command);
        }
        ui.spacing_mut().slider_width = ui.available_width() - 78.0;
        let (mut at, last) = (state.at, (clip.frame_count() - 1) as f64);
        let scrub = ui.add(Slider::new(&mut at, 0.0..=last.max(1.0)).show_value(false));
        if called(&scrub, "Frame").on_hover_text("the frame of the clip (, and . go to the next)").changed() {
            done.push(Command::Scrub(at));
        }
        ui.spacing_mut().combo_width = 62.0;
        let combo = ComboBox::from_id_salt("speed").selected_text(format!("{}×", state.speed));
        let speeds =
            [0.1, 0.25, 0.5, 1.0, 2.0, 4.0].map(|speed| (speed, format!("{speed}×"), "", speed == state.speed));
        done.extend(pick(ui, combo, ("Speed", "how fast the clip plays"), speeds).map(Command::Speed));
    });
    let (fps, count) = (f64::from(clip.fps), clip.frame_count());
    let [now, end] = [state.at, count as f64].map(|frame| frame / fps);
    let text = format!("frame {} of {count} · {now:.2} of {end:.2} s · {fps} a second", state.at as usize);
    ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate());
}

/// What the error budget saves.
fn saved(ui: &mut Ui, measured: &Measured) {
    let Some([with, without]) = measured.budget(plot::FRAMES).filter(|[_, without]| *without > 0.0) else { return };
    let (saved, [with, without]) = (percent(1.0 - with / without), [with, without].map(bytes));
    let text = format!("the budget saves {saved}: {with} a frame, {without} without");
    let about = "bytes that an update of one instance moves, on the path cpu; means of the frames in the plots";
    ui.label(RichText::new(text).small().color(ACCENT)).on_hover_text(about);
}

/// Names a control for those who cannot see what is beside it, and for tests.
pub fn called(response: &Response, name: &str) -> Response {
    response.ctx.accesskit_node_builder(response.id, |node| node.set_label(name));
    response.clone()
}

/// A list to choose from, with its name and what it is about: each item with its text, a hint, and whether it is chosen
/// now. Returns what the user has chosen.
fn pick<T>(
    ui: &mut Ui,
    combo: ComboBox,
    (name, about): (&str, &str),
    items: impl IntoIterator<Item = (T, String, &'static str, bool)>,
) -> Option<T> {
    let mut chosen = None;
    let combo = combo.show_ui(ui, |ui| {
        for (item, text, hint, is_chosen) in items {
            let label = ui.selectable_label(is_chosen, text);
            let label = if hint.is_empty() { label } else { label.on_hover_text(hint) };
            if label.clicked() {
                chosen = Some(item);
                // The mouse closes it, the keyboard does not, and goes on from here.
                ui.close();
            }
        }
    });
    let response = called(&combo.response, name).on_hover_text(about);
    if chosen.is_some() && !ui.input(|input| input.pointer.any_click()) {
        response.request_focus();
    }
    chosen
}

/// A choice in a row of the grid: its name and what it is about.
fn choice<T: Copy + PartialEq>(
    ui: &mut Ui,
    (title, about): (&str, &str),
    now: T,
    all: &[T],
    name: impl Fn(T) -> String,
    hint: impl Fn(T) -> &'static str,
) -> Option<T> {
    ui.label(RichText::new(title).color(DIM)).on_hover_text(about);
    let combo = ComboBox::from_id_salt(title).width(ui.available_width()).truncate().selected_text(name(now));
    let items = all.iter().map(|&one| (one, name(one), hint(one), one == now));
    let chosen = pick(ui, combo, (title, about), items);
    ui.end_row();
    chosen.filter(|one| *one != now)
}

const PATH: (&str, &str) = ("Path", "who updates the poses: kernels on the device, or the processor");
const DELTAS: (&str, &str) =
    ("Deltas", "how the targets are packed: fewer bits move fewer bytes, within the error that is stated");
const POSES: (&str, &str) = (
    "Poses",
    "how poses are stored: as floats, or as integers, which add up without drift and may take half the bytes",
);
const BUDGET: (&str, &str) = (
    "Budget",
    "error budget: changes of weights too small to move a vertex this far wait, so that trembling costs nothing",
);
const HEADS: (&str, &str) = ("Heads", "instances of the mesh, each a little further in the clip");
const DETAIL: (&str, &str) =
    ("Detail", "level of detail: how many targets an instance keeps, the most important ones first");

fn ways(ui: &mut Ui, state: &State, about: &About<'_>, done: &mut Vec<Command>) {
    let UpdateDesc { path, pose, error_budget, .. } = about.desc;
    let formats: Vec<DeltaFormat> = DeltaFormat::ALL.into_iter().filter(|f| format_on(path, *f) == Some(*f)).collect();
    let diagonal = state.input.kept.diagonal;
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-3 * a.max(b);
    let budget = BUDGETS.into_iter().find(|b| near(b * diagonal, error_budget)).unwrap_or(error_budget / diagonal);
    // Half a pixel from where the camera is, in steps, so that it does not change with every movement.
    let half = 2f32.powf((0.5 / (about.unit * diagonal)).log2().round());
    let budget_name = |b: f32| match b {
        0.0 => "none".to_owned(),
        b => {
            let from_here = if near(b, half) { "half a pixel from here: " } else { "" };
            let share = if BUDGETS.contains(&b) { format!("{b:e}") } else { sig3(f64::from(b)) };
            format!("{from_here}{share} of the diagonal")
        }
    };
    let budgets: Vec<f32> = BUDGETS.into_iter().chain(half.is_finite().then_some(half)).collect();
    egui::Grid::new("ways").num_columns(2).min_col_width(62.0).spacing([10.0, 6.0]).show(ui, |ui| {
        let chosen = choice(ui, PATH, path, about.paths, |p| p.name().into(), UpdatePath::summary);
        done.extend(chosen.map(Command::Path));
        let chosen = choice(ui, DELTAS, about.format, &formats, |f| f.name().into(), DeltaFormat::summary);
        done.extend(chosen.map(Command::Format));
        let chosen = choice(ui, POSES, pose, path.poses(), |p| p.name().into(), PoseFormat::summary);
        done.extend(chosen.map(Command::Pose));
        let hint = |_| "they wait until they add up to this";
        let chosen = choice(ui, BUDGET, budget, &budgets, budget_name, hint);
        done.extend(chosen.map(|b| Command::Budget(BudgetSpec::Diagonal(b))));
        let chosen = choice(ui, HEADS, state.heads, &[1, 2, 5, 12, 40], |n| n.to_string(), |_| "heads in the window");
        done.extend(chosen.map(Command::Heads));
        let hint = |detail| match detail {
            Detail::Pixels(_) => "targets come and go with the camera, fading",
            Detail::All | Detail::Share(_) => "the most important targets stay",
        };
        let name = |detail: Detail| match about.kept.filter(|_| detail == state.detail) {
            Some((all, [_, most])) => format!("{detail} ({most} of {all})"),
            None => detail.to_string(),
        };
        done.extend(choice(ui, DETAIL, state.detail, &Detail::ALL, name, hint).map(Command::Detail));
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

#[cfg(test)]
mod tests;
