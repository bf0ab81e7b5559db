//! Sliders for the targets.

use super::command::Command;
use super::state::State;
use super::style::{DIM, INK, called};
use egui::{Align, Label, Layout, Rect, RichText, Sense, Slider, SliderClamping, Ui, UiBuilder, vec2};

/// Height of a slider's row, the part of it that is its name, and the width of its number.
const ROW: f32 = 22.0;
const NAME: f32 = 0.43;
const NUMBER: f32 = 54.0;

pub fn list(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    if state.values.is_empty() {
        ui.label(RichText::new("This mesh has no morph targets.").color(DIM));
        return;
    }
    if ui.button("Reset").on_hover_text("all weights 0").clicked() {
        done.push(Command::Reset);
    }
    for target in 0..state.values.len() {
        // Rows that are not in sight are left out: the others keep their ids, and the keyboard its place.
        ui.push_id(target, |ui| row(ui, state, target, done));
    }
}

/// Name, slider and number of a target.
fn row(ui: &mut Ui, state: &State, target: usize, done: &mut Vec<Command>) {
    let full = &state.input.kept.targets[target].name;
    let value = state.values[target];
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::hover());
    // The next ones are there, too, for the keyboard to go to.
    if !ui.is_rect_visible(rect.expand(6.0 * ROW)) {
        return;
    }
    let (left, right) = rect.split_left_right_at_fraction(NAME);
    let within = |rect: Rect| UiBuilder::new().max_rect(rect).layout(Layout::left_to_right(Align::Center));
    ui.scope_builder(within(left), |ui| {
        let colour = if value == 0.0 { DIM } else { INK };
        ui.set_max_width(left.width() - 8.0);
        // Where it is cut off, egui shows all of it under the mouse.
        ui.add(Label::new(RichText::new(full).color(colour)).truncate().selectable(false));
    });
    ui.scope_builder(within(right), |ui| {
        let mut weight = value;
        ui.spacing_mut().slider_width = right.width() - NUMBER;
        let slider = Slider::new(&mut weight, 0.0..=1.0).clamping(SliderClamping::Never).fixed_decimals(2);
        let response = called(&ui.add(slider), full);
        if response.double_clicked() {
            done.push(Command::Set(full.clone(), 0.0));
        } else if response.changed() {
            done.push(Command::Set(full.clone(), weight));
        }
    });
}
