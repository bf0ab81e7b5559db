//! The panel: shows the state, and turns input into commands.

use super::command::{Command, LOOKS};
use super::state::State;
use super::style::{DIM, ERROR, PANEL, called};
use super::{hands, plot, sliders};
use crate::table::thousands;
use deltamorph::{UpdateStats, import};
use egui::{
    Area, Button, ComboBox, Frame, Key, Margin, Panel, Rect, RichText, ScrollArea, Slider, Ui, style::ScrollAnimation,
};
use std::collections::VecDeque;
use std::path::Path;

/// Width of the panel, in points.
const WIDTH: f32 = 332.0;
/// A window that is smaller, in points, shows only the instance.
const LEAST: [f32; 2] = [240.0, 180.0];
/// Most of the window that the panel takes.
const SHARE: f32 = 0.62;

/// Shows the panel; returns the rest of the window, in points, and the user's commands. It scrolls as a whole.
/// `about` names device and update.
pub fn show(ui: &mut Ui, state: &State, rows: &VecDeque<UpdateStats>, about: &str) -> (Rect, Vec<Command>) {
    let mut done = vec![];
    hands::keys(ui, state, &mut done);
    let room = ui.available_size();
    let shown = state.panel && room.x >= LEAST[0] && room.y >= LEAST[1];
    if shown {
        let frame = Frame::new().fill(PANEL).inner_margin(Margin { left: 14, right: 2, top: 12, bottom: 6 });
        let panel = Panel::left("panel").exact_size(WIDTH.min(SHARE * room.x));
        panel.resizable(false).frame(frame).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink([false; 2]).show(ui, |ui| {
                ui.set_max_width(ui.available_width() - 12.0);
                title(ui, state, about);
                ui.add_space(4.0);
                clip(ui, state, &mut done);
                ui.add_space(4.0);
                looks(ui, state, &mut done);
                plot::all(ui, rows);
                ui.separator();
                sliders::list(ui, state, &mut done);
                follow_focus(ui);
            });
        });
    }
    let free = ui.available_rect_before_wrap();
    hands::camera(ui, free, state, &mut done);
    notice(ui, free, state);
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
    let Some((text, _)) = &state.notice else { return };
    let wide = (free.width() - 60.0).clamp(160.0, 620.0);
    let place = egui::pos2(free.center().x - wide / 2.0, free.top() + 18.0);
    Area::new("notice".into()).fixed_pos(place).show(ui.ctx(), |ui| {
        Frame::window(ui.style()).show(ui, |ui| {
            ui.set_width(wide - 24.0);
            ui.add(egui::Label::new(RichText::new(text).color(ERROR)).wrap());
        });
    });
}

fn title(ui: &mut Ui, state: &State, about: &str) {
    let mesh = &state.input.kept;
    let name = if mesh.name.is_empty() { &state.input.origin } else { &mesh.name };
    ui.add(egui::Label::new(RichText::new(name).heading()).truncate());
    let vertices = thousands(mesh.vertex_count());
    let targets = thousands(mesh.targets.len());
    for text in [&format!("{vertices} vertices · {targets} targets"), about] {
        ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate()).on_hover_text(hands::KEYS);
    }
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
        let combo = combo.show_ui(ui, |ui| {
            for path in &state.clips {
                if ui.selectable_label(state.chosen.as_ref() == Some(path), clip_name(path)).clicked() {
                    done.push(Command::Clip(path.clone()));
                    // The mouse closes it, the keyboard does not.
                    ui.close();
                }
            }
        });
        called(&combo.response, "Clip").on_hover_text("clips of the mesh, and clips dropped here");
    } else {
        ui.add(egui::Label::new(&name).truncate()).on_hover_text(&clip.name);
    }
    ui.horizontal(|ui| {
        let (icon, name, command) =
            if state.playing { ("⏸", "Pause", Command::Pause) } else { ("▶", "Play", Command::Play) };
        let button = ui.add_sized([30.0, 24.0], Button::new(icon)).on_hover_text(format!("{name} (space)"));
        button.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Button, true, name));
        if button.clicked() {
            done.push(command);
        }
        ui.spacing_mut().slider_width = ui.available_width();
        let mut at = state.at;
        let last = (clip.frame_count() - 1) as f64;
        let scrub = ui.add(Slider::new(&mut at, 0.0..=last.max(1.0)).show_value(false));
        if called(&scrub, "Frame").on_hover_text("frame of the clip (, and . step by one)").changed() {
            done.push(Command::Scrub(at));
        }
    });
    let text = format!("frame {} of {}, {} per second", state.at as usize, clip.frame_count(), clip.fps);
    ui.add(egui::Label::new(RichText::new(text).small().color(DIM)).truncate());
}

fn looks(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    ui.add_space(2.0);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.spacing_mut().button_padding.x = 6.0;
        for &(look, name, summary) in LOOKS {
            let label = ui.selectable_label(state.look == look, RichText::new(name).size(12.5));
            if label.on_hover_text(summary).clicked() {
                done.push(Command::Show(look));
            }
        }
    });
}

#[cfg(test)]
mod tests;
