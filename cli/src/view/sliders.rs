//! Sliders for the targets, in groups, and tools for all of them.

use super::command::Command;
use super::groups::{Group, prefixes};
use super::panel::called;
use super::state::State;
use super::style::{DIM, INK};
use egui::{
    Align, Button, CollapsingHeader, FontId, Key, Label, Layout, Modifiers, Rect, RichText, Sense, Slider,
    SliderClamping, TextEdit, TextStyle, Ui, UiBuilder, vec2,
};

/// Height of a slider's row, the part of it that is its name, and the width of its number.
const ROW: f32 = 22.0;
const NAME: f32 = 0.43;
const NUMBER: f32 = 54.0;

/// Search, reset, random, copy, undo and redo, which targets are listed, and whether left and right move together.
pub fn tools(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        let mut search = state.search.clone();
        let wide = ui.available_width() - if search.is_empty() { 0.0 } else { 34.0 };
        let edit = ui.add(TextEdit::singleline(&mut search).hint_text("Search").desired_width(wide));
        if ui.input_mut(|input| input.consume_key(Modifiers::COMMAND, Key::F)) {
            edit.request_focus();
            edit.scroll_to_me(None);
        }
        if called(&edit, "Search").changed() {
            done.push(Command::Search(search));
        }
        if !state.search.is_empty() && called(&ui.button("✖"), "clear the search").clicked() {
            done.push(Command::Search(String::new()));
        }
    });
    ui.horizontal(|ui| {
        let mut active = state.only_active;
        if ui.checkbox(&mut active, "only active").on_hover_text("only targets with a weight (A)").changed() {
            done.push(Command::Active(active));
        }
        let mut twins = state.twins;
        if ui.checkbox(&mut twins, "L = R").on_hover_text("left and right move together").changed() {
            done.push(Command::Twins(twins));
        }
    });
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        ui.spacing_mut().button_padding.x = 2.0;
        // A new seed for each click, without a clock: derived from the current weights.
        let seed = |seed: u64, v: &f32| seed.wrapping_mul(31).wrapping_add(u64::from(v.to_bits()));
        let random = Command::Random(state.values.iter().fold(1, seed));
        let [undo, redo] = state.undoable();
        let buttons = [
            ("Reset", "all weights 0", true, Command::Reset),
            ("Random", "a few targets, some way", true, random),
            ("Copy", "copy as --set, for the other commands", true, Command::Copy),
            ("Undo", "take back a change of weights (Ctrl Z)", undo, Command::Undo),
            ("Redo", "make it again (Ctrl Y)", redo, Command::Redo),
        ];
        let count = buttons.len() as f32;
        let wide = (ui.available_width() - (count - 1.0) * ui.spacing().item_spacing.x) / count;
        for (text, hint, enabled, command) in buttons {
            let sized = |ui: &mut Ui| ui.add_sized([wide, 24.0], Button::new(text)).on_hover_text(hint);
            if ui.add_enabled_ui(enabled, sized).inner.clicked() {
                done.push(command);
            }
        }
    });
}

pub fn list(ui: &mut Ui, state: &State, done: &mut Vec<Command>) {
    let wanted = state.search.to_lowercase();
    let found = |target: &&usize| {
        // The slider that moves stays, also at 0.
        let active = !state.only_active || state.values[**target] != 0.0 || state.moving == Some(**target);
        active && state.names[**target].to_lowercase().contains(&wanted)
    };
    let mut none = true;
    for Group { name, targets } in &state.groups {
        let targets: Vec<usize> = targets.iter().filter(found).copied().collect();
        if targets.is_empty() {
            continue;
        }
        none = false;
        let active = targets.iter().filter(|target| state.values[**target] != 0.0).count();
        let title = if active > 0 { format!("{name}  ·  {active} of {}", targets.len()) } else { (*name).to_owned() };
        let header = CollapsingHeader::new(RichText::new(title).strong().color(INK)).id_salt(name).default_open(true);
        header.show_unindented(ui, |ui| {
            let names: Vec<&str> = targets.iter().map(|target| &*state.names[*target]).collect();
            let mut above = "";
            for ((target, name), prefix) in targets.iter().zip(&names).zip(prefixes(&names)) {
                let (prefix, rest) = name.split_at(prefix);
                if prefix != above {
                    above = prefix;
                    let text = if prefix.is_empty() { "others" } else { prefix };
                    ui.add(Label::new(RichText::new(text).small().color(DIM)).truncate());
                }
                row(ui, state, *target, rest, done);
            }
        });
    }
    if none {
        ui.label(RichText::new(nothing(state)).color(DIM));
    }
}

/// Why no target is listed.
fn nothing(state: &State) -> String {
    match (state.names.is_empty(), &*state.search, state.only_active) {
        (true, ..) => "This mesh has no morph targets.".into(),
        (_, "", _) => "No target is active: all weights are 0.".into(),
        (_, search, true) => format!("No active target has '{search}' in its name."),
        (_, search, false) => format!("No target has '{search}' in its name."),
    }
}

/// Name, slider and number of a target, called `name` here.
fn row(ui: &mut Ui, state: &State, target: usize, name: &str, done: &mut Vec<Command>) {
    let (full, value) = (&state.names[target], state.values[target]);
    let (rect, whole) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::hover());
    // The next ones are there, too, for the keyboard to go to.
    if !ui.is_rect_visible(rect.expand(6.0 * ROW)) {
        return;
    }
    let (left, right) = rect.split_left_right_at_fraction(NAME);
    let within = |rect: Rect| UiBuilder::new().max_rect(rect).layout(Layout::left_to_right(Align::Center));
    ui.scope_builder(within(left), |ui| {
        let colour = if value == 0.0 { DIM } else { INK };
        let name = fitting(ui, name, left.width() - 8.0);
        if name != *full {
            whole.on_hover_text(full);
        }
        ui.add(Label::new(RichText::new(name).color(colour)).extend().selectable(false));
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
        if response.drag_stopped() || response.lost_focus() {
            done.push(Command::Settled);
        }
    });
}

/// The name, or as much of its beginning and end as fits: names differ there.
fn fitting(ui: &Ui, name: &str, wide: f32) -> String {
    let font: FontId = TextStyle::Body.resolve(ui.style());
    let fits = |text: &str| ui.painter().layout_no_wrap(text.to_owned(), font.clone(), INK).size().x <= wide;
    if fits(name) {
        return name.to_owned();
    }
    let letters: Vec<char> = name.chars().collect();
    let short = |kept: usize| {
        let (first, last) = (kept.div_ceil(2), kept / 2);
        letters[..first].iter().chain(&['…']).chain(&letters[letters.len() - last..]).collect::<String>()
    };
    // The most letters that fit.
    let counts: Vec<usize> = (0..letters.len()).collect();
    short(counts.partition_point(|kept| fits(&short(*kept))).saturating_sub(1))
}
