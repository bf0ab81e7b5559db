//! Sliders for the targets, in groups, and tools for all of them.

use super::command::Command;
use super::groups::Group;
use super::state::State;
use super::style::{DIM, INK};
use egui::{
    Align, Button, CollapsingHeader, Label, Layout, Rect, RichText, Sense, Slider, SliderClamping, TextEdit, Ui,
    UiBuilder, vec2,
};

/// Height of a slider's row, and the width of its name.
const ROW: f32 = 22.0;
const NAME: f32 = 132.0;

/// Search, reset, random, copy, and whether left and right targets move together.
pub fn tools(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let mut search = state.search.clone();
        let edit = TextEdit::singleline(&mut search).hint_text("Search").desired_width(ui.available_width() - 74.0);
        if ui.add(edit).changed() {
            done.push(Command::Search(search));
        }
        let mut twins = state.twins;
        if ui.checkbox(&mut twins, "L = R").on_hover_text("left and right move together").changed() {
            done.push(Command::Twins(twins));
        }
    });
    ui.horizontal(|ui| {
        let wide = (ui.available_width() - 2.0 * ui.spacing().item_spacing.x) / 3.0;
        let mut button = |text, hint| ui.add_sized([wide, 24.0], Button::new(text)).on_hover_text(hint).clicked();
        if button("Reset", "all weights 0") {
            done.push(Command::Reset);
        }
        if button("Random", "a few targets, some way") {
            // A new seed for each click, without a clock: derived from the current weights.
            let seed =
                state.values.iter().fold(1u64, |seed, v| seed.wrapping_mul(31).wrapping_add(u64::from(v.to_bits())));
            done.push(Command::Random(seed));
        }
        if button("Copy", "copy as --set, for the other commands") {
            done.push(Command::Copy);
        }
    });
}

pub fn list(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    let wanted = state.search.to_lowercase();
    let found = |target: &&usize| state.names[**target].to_lowercase().contains(&wanted);
    for Group { name, targets } in &state.groups {
        let targets: Vec<usize> = targets.iter().filter(found).copied().collect();
        if targets.is_empty() {
            continue;
        }
        let active = targets.iter().filter(|target| state.values[**target] != 0.0).count();
        let title = if active > 0 { format!("{name}  ·  {active} of {}", targets.len()) } else { (*name).to_owned() };
        let header = CollapsingHeader::new(RichText::new(title).strong().color(INK)).id_salt(name).default_open(true);
        header.show_unindented(ui, |ui| targets.iter().for_each(|target| row(ui, state, *target, done)));
    }
}

/// Name, slider and number of a target.
fn row(ui: &mut Ui, state: &State, target: usize, done: &mut Vec<Command>) {
    let (name, value) = (&state.names[target], state.values[target]);
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::hover());
    if !ui.is_rect_visible(rect) {
        return;
    }
    let (left, right) = rect.split_left_right_at_x(rect.left() + NAME);
    let within = |rect: Rect| UiBuilder::new().max_rect(rect).layout(Layout::left_to_right(Align::Center));
    ui.scope_builder(within(left), |ui| {
        let colour = if value == 0.0 { DIM } else { INK };
        ui.add(Label::new(RichText::new(name).color(colour)).truncate());
    });
    ui.scope_builder(within(right), |ui| {
        let mut weight = value;
        ui.spacing_mut().slider_width = right.width() - 54.0;
        let slider = Slider::new(&mut weight, 0.0..=1.0).clamping(SliderClamping::Never).fixed_decimals(2);
        let response = ui.add(slider);
        if response.changed() {
            done.push(Command::Set(name.clone(), weight));
        } else if response.double_clicked() {
            done.push(Command::Set(name.clone(), 0.0));
        }
    });
}
