//! The panel: shows the state, and turns input into commands.

use super::command::Command;
use super::measured::Measured;
use super::state::{Notice, State};
use super::style::{DIM, ERROR, INK, PANEL};
use super::{hands, plot, sliders};
use crate::args::render::Look;
use crate::args::values::{name, summary};
use crate::table::thousands;
use clap::ValueEnum;
use deltamorph::import;
use deltamorph::{DeltaFormat, PoseFormat, UpdateDesc, UpdatePath};
use egui::{
    Area, Button, CollapsingHeader, ComboBox, Frame, Key, Margin, Panel, Rect, Response, RichText, ScrollArea, Slider,
    Ui, style::ScrollAnimation,
};
use std::path::Path;

/// Least and largest zoom.
pub const ZOOM: [f32; 2] = [0.2, 20.0];
/// Width of the panel, in points; its height where it is below the instance.
const WIDTH: f32 = 332.0;
/// A window that is smaller, in points, shows only the instance.
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
}

/// Shows the panel; returns the rest of the window, in points, and the user's commands. The panel is at the left, in an
/// upright window below, and scrolls as a whole.
pub fn show(ui: &mut Ui, state: &State, measured: &Measured, about: &About<'_>) -> (Rect, Vec<Command>) {
    let mut done = vec![];
    hands::keys(ui, state, &mut done);
    let room = ui.available_size();
    let shown = state.panel && room.x >= LEAST[0] && room.y >= LEAST[1];
    let below = room.y > room.x && room.x < 2.0 * WIDTH;
    let size = WIDTH.min(SHARE * if below { room.y } else { room.x });
    // Where there is room, plots have a strip of their own.
    let strip = shown && !below && room.x > size + 560.0 && room.y > 3.0 * plot::HEIGHT;
    if shown {
        let panel = if below { Panel::bottom("panel") } else { Panel::left("panel") };
        let frame = Frame::new().fill(PANEL).inner_margin(Margin { left: 14, right: 2, top: 12, bottom: 6 });
        panel.exact_size(size).resizable(false).frame(frame).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink([false; 2]).show(ui, |ui| {
                ui.set_max_width(ui.available_width() - 12.0);
                title(ui, state, about);
                ui.add_space(4.0);
                clip(ui, state, &mut done);
                ui.add_space(4.0);
                ways(ui, about, &mut done);
                looks(ui, state, &mut done);
                ui.add_space(2.0);
                ui.separator();
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
    notice(ui, free, state);
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

fn notice(ui: &Ui, free: Rect, state: &State) {
    let Some(Notice { text, is_error, .. }) = &state.notice else { return };
    let wide = (free.width() - 60.0).clamp(160.0, 620.0);
    let place = egui::pos2(free.center().x - wide / 2.0, free.top() + 18.0);
    Area::new("notice".into()).fixed_pos(place).show(ui.ctx(), |ui| {
        Frame::window(ui.style()).show(ui, |ui| {
            ui.set_width(wide - 24.0);
            let colour = if *is_error { ERROR } else { INK };
            ui.add(egui::Label::new(RichText::new(text).color(colour)).wrap());
        });
    });
}

fn title(ui: &mut Ui, state: &State, about: &About<'_>) {
    let mesh = &state.input.kept;
    let name = if mesh.name.is_empty() { &state.input.origin } else { &mesh.name };
    ui.add(egui::Label::new(RichText::new(name).heading().color(INK)).truncate());
    let vertices = thousands(mesh.vertex_count());
    let targets = thousands(mesh.targets.len());
    let text = format!("{vertices} vertices · {targets} targets · ?: keys · {}", about.device);
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
        ui.spacing_mut().slider_width = ui.available_width();
        let mut at = state.at;
        let last = (clip.frame_count() - 1) as f64;
        let scrub = ui.add(Slider::new(&mut at, 0.0..=last.max(1.0)).show_value(false));
        if called(&scrub, "Frame").on_hover_text("the frame of the clip (, and . go to the next)").changed() {
            done.push(Command::Scrub(at));
        }
    });
    let fps = f64::from(clip.fps);
    let count = clip.frame_count();
    let [now, end] = [state.at, count as f64].map(|frame| frame / fps);
    let text = format!("frame {} of {count} · {now:.2} of {end:.2} s · {fps} a second", state.at as usize);
    ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate());
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
    name: fn(T) -> &'static str,
    hint: fn(T) -> &'static str,
) -> Option<T> {
    ui.label(RichText::new(title).color(DIM)).on_hover_text(about);
    let combo = ComboBox::from_id_salt(title).width(ui.available_width()).truncate().selected_text(name(now));
    let items = all.iter().map(|&one| (one, name(one).to_owned(), hint(one), one == now));
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

fn ways(ui: &mut Ui, about: &About<'_>, done: &mut Vec<Command>) {
    let UpdateDesc { path, pose, .. } = about.desc;
    let formats = path.formats();
    egui::Grid::new("ways").num_columns(2).min_col_width(62.0).spacing([10.0, 6.0]).show(ui, |ui| {
        let chosen = choice(ui, PATH, path, about.paths, UpdatePath::name, UpdatePath::summary);
        done.extend(chosen.map(Command::Path));
        let chosen = choice(ui, DELTAS, about.format, formats, DeltaFormat::name, DeltaFormat::summary);
        done.extend(chosen.map(Command::Format));
        let chosen = choice(ui, POSES, pose, path.poses(), PoseFormat::name, PoseFormat::summary);
        done.extend(chosen.map(Command::Pose));
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
