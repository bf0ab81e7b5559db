//! What keys and mouse do beside the controls: commands, the camera, the edge of the panel, and a list of it all.

use super::command::Command;
use super::panel::ZOOM;
use super::state::State;
use super::style::{ACCENT, DIM, INK};
use egui::{
    Align, Align2, CursorIcon, Key, Label, Layout, Modifiers, PointerButton, Popup, Rect, RichText, ScrollArea, Sense,
    Ui, Vec2, vec2,
};

/// What [`help`] lists.
const KEYS: [(&str, &str); 17] = [
    ("drag · arrows", "turn"),
    ("shift or right drag · shift arrows", "move the picture"),
    ("wheel · + −", "nearer, further"),
    ("F", "fill the window with what the active targets move, or the face"),
    ("H · double click", "the camera as at the beginning"),
    ("W", "all of the scene, or what targets move"),
    ("space", "play, pause"),
    (", · .", "a frame back, a frame on"),
    ("Ctrl Z · Ctrl Y", "undo, redo changes of weights"),
    ("double click a slider", "its weight 0"),
    ("Ctrl F", "search the targets"),
    ("A", "only active targets"),
    ("P", "hide and show the panel"),
    ("[ · ] · drag its edge", "a narrower, wider panel"),
    ("Ctrl + · Ctrl −", "larger, smaller text"),
    ("Tab, then arrows, space", "reach every control, and change it"),
    ("Esc", "close this, a notice; clear the search, the filter"),
];

/// Points by which keys move the edge, the camera.
const STEP: f32 = 24.0;

pub fn keys(ui: &Ui, state: &State, done: &mut Vec<Command>) {
    let context = ui.ctx();
    if context.input(|input| input.key_pressed(Key::Escape)) && !Popup::is_any_open(context) {
        done.extend(closed(state));
    }
    if context.text_edit_focused() {
        return;
    }
    let with = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
    if with(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || with(Modifiers::COMMAND, Key::Y) {
        done.push(Command::Redo);
    }
    if with(Modifiers::COMMAND, Key::Z) {
        done.push(Command::Undo);
    }
    if context.input(|input| input.modifiers.command || input.modifiers.alt) {
        return;
    }
    let pressed = |key| context.input(|input| input.key_pressed(key));
    let mut when = |keys: &[Key], command: Command| done.extend(keys.iter().any(|k| pressed(*k)).then_some(command));
    when(&[Key::P], Command::Panel(!state.panel));
    when(&[Key::F], Command::Focus);
    when(&[Key::H], Command::Home);
    when(&[Key::W], Command::Whole(!state.whole));
    when(&[Key::A], Command::Active(!state.only_active));
    when(&[Key::Questionmark, Key::F1], Command::Help(!state.help));
    when(&[Key::OpenBracket], Command::Width((state.width - STEP).max(180.0)));
    when(&[Key::CloseBracket], Command::Width((state.width + STEP).min(1200.0)));
    when(&[Key::Plus, Key::Equals], zoomed(state, 1.15));
    when(&[Key::Minus], zoomed(state, 1.0 / 1.15));
    if let Some(clip) = &state.clip {
        let (count, at) = (clip.frame_count() as f64, state.at.floor());
        when(&[Key::Comma], Command::Scrub((at + count - 1.0) % count));
        when(&[Key::Period], Command::Scrub((at + 1.0) % count));
    }
    // These belong to the control that the keyboard has reached, if any.
    if context.memory(|memory| memory.focused().is_some()) {
        return;
    }
    if state.clip.is_some() {
        when(&[Key::Space], if state.playing { Command::Pause } else { Command::Play });
    }
    let arrows = [(Key::ArrowLeft, [-1.0, 0.0]), (Key::ArrowRight, [1.0, 0.0])];
    let arrows = arrows.into_iter().chain([(Key::ArrowUp, [0.0, -1.0]), (Key::ArrowDown, [0.0, 1.0])]);
    let moves = context.input(|input| input.modifiers.shift);
    for (_, [x, y]) in arrows.filter(|(key, _)| pressed(*key)) {
        let way = STEP * vec2(x, y);
        done.push(if moves { panned(state, way / 600.0) } else { turned(state, way) });
    }
}

/// What Escape closes.
fn closed(state: &State) -> Option<Command> {
    let ways = [
        (state.help, Command::Help(false)),
        (state.notice.is_some(), Command::Dismiss),
        (!state.search.is_empty(), Command::Search(String::new())),
        (state.only_active, Command::Active(false)),
    ];
    ways.into_iter().find(|(open, _)| *open).map(|(_, command)| command)
}

fn turned(state: &State, way: Vec2) -> Command {
    let [yaw, pitch] = state.camera;
    let yaw = (yaw - 0.4 * way.x + 540.0).rem_euclid(360.0) - 180.0;
    Command::Camera([yaw, (pitch + 0.3 * way.y).clamp(-89.0, 89.0)])
}

/// `way`: in shares of the room.
fn panned(state: &State, way: Vec2) -> Command {
    let [right, down] = state.pan;
    Command::Pan([right + way.x / state.zoom, down + way.y / state.zoom].map(|share| share.clamp(-10.0, 10.0)))
}

fn zoomed(state: &State, times: f32) -> Command {
    Command::Zoom((state.zoom * times).clamp(ZOOM[0], ZOOM[1]))
}

/// Dragging turns the instances, or moves them; the wheel zooms to what is under the pointer.
pub fn camera(ui: &mut Ui, free: Rect, state: &State, done: &mut Vec<Command>) {
    // Not by the keyboard: arrows turn the camera where no control has it.
    let response = ui.interact(free, ui.id().with("camera"), Sense::CLICK | Sense::DRAG);
    let (way, shift) = (response.drag_delta(), ui.input(|input| input.modifiers.shift));
    if way != Vec2::ZERO {
        let turns = response.dragged_by(PointerButton::Primary) && !shift;
        done.push(if turns { turned(state, way) } else { panned(state, way / free.size()) });
    }
    if response.clicked() {
        ui.memory_mut(|memory| memory.stop_text_input());
    }
    let wheel = if response.hovered() { ui.input(|input| input.smooth_scroll_delta().y) } else { 0.0 };
    if let (Command::Zoom(zoom), Some(pointer)) = (zoomed(state, (wheel * 0.003).exp()), response.hover_pos())
        && zoom != state.zoom
    {
        let at = (pointer - free.center()) / free.size() * (1.0 / zoom - 1.0 / state.zoom);
        done.extend([Command::Zoom(zoom), Command::Pan([state.pan[0] + at.x, state.pan[1] + at.y])]);
    }
    if response.double_clicked() {
        done.push(Command::Home);
    }
}

/// The edge between instances and panel, which has this size, to be dragged.
pub fn edge(ui: &Ui, free: Rect, below: bool, size: f32, done: &mut Vec<Command>) {
    let across = if below { vec2(0.0, 4.0) } else { vec2(4.0, 0.0) };
    let (first, last) =
        if below { (free.left_bottom(), free.right_bottom()) } else { (free.left_top(), free.left_bottom()) };
    let edge = ui.interact(Rect::from_min_max(first - across, last + across), ui.id().with("edge"), Sense::DRAG);
    let edge =
        edge.on_hover_and_drag_cursor(if below { CursorIcon::ResizeVertical } else { CursorIcon::ResizeHorizontal });
    if edge.hovered() || edge.dragged() {
        ui.painter().line_segment([first, last], egui::Stroke::new(2.0, ACCENT));
    }
    let way = if below { -edge.drag_delta().y } else { edge.drag_delta().x };
    if way != 0.0 {
        done.push(Command::Width((size + way).clamp(180.0, 1200.0)));
    }
}

/// What keys and mouse do.
pub fn help(ui: &Ui, state: &State, done: &mut Vec<Command>) {
    if !state.help {
        return;
    }
    let (room, mut open) = (ui.ctx().content_rect(), true);
    let wide = (room.width() - 72.0).min(560.0);
    let window = egui::Window::new("Keys and mouse").open(&mut open).collapsible(false).resizable(false);
    let window = window.default_height(room.height());
    window.pivot(Align2::CENTER_CENTER).fixed_pos(room.center()).show(ui.ctx(), |ui| {
        ScrollArea::vertical().max_height(room.height() - 110.0).show(ui, |ui| {
            for (keys, what) in KEYS {
                ui.horizontal_top(|ui| {
                    for (text, colour, share) in [(keys, INK, 0.42), (what, DIM, 0.54)] {
                        let size = vec2(share * wide, 0.0);
                        ui.allocate_ui_with_layout(size, Layout::top_down(Align::Min), |ui| {
                            ui.set_width(size.x);
                            ui.add(Label::new(RichText::new(text).color(colour)).wrap());
                        });
                    }
                });
            }
        });
    });
    if !open {
        done.push(Command::Help(false));
    }
}
