//! What keys and mouse do beside the controls.

use super::command::Command;
use super::state::State;
use egui::{Key, PointerButton, Rect, Sense, Ui, Vec2, vec2};

/// What keys and mouse do, for people.
pub const KEYS: &str = "\
drag, arrows: turn
shift or right drag: move the picture
wheel, + and −: zoom in and out
H, double click: reset the camera
space: play, pause
, and .: previous and next frame
double click a slider: set its weight to 0
P: hide and show the panel";

/// Least and largest zoom.
const ZOOM: [f32; 2] = [0.2, 20.0];
/// Points by which arrows turn the camera.
const STEP: f32 = 24.0;

pub fn keys(ui: &Ui, state: &State, done: &mut Vec<Command>) {
    let context = ui.ctx();
    let pressed = |key| context.input(|input| input.key_pressed(key));
    if context.text_edit_focused() || context.input(|input| input.modifiers.command || input.modifiers.alt) {
        return;
    }
    let mut when = |keys: &[Key], command: Command| done.extend(keys.iter().any(|k| pressed(*k)).then_some(command));
    when(&[Key::P], Command::Panel(!state.panel));
    when(&[Key::H], Command::Home);
    when(&[Key::Plus, Key::Equals], zoomed(state, 1.15));
    when(&[Key::Minus], zoomed(state, 1.0 / 1.15));
    if let Some(clip) = &state.clip {
        let count = clip.frame_count() as f64;
        let at = state.at.floor();
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
    when(&[Key::ArrowLeft], turned(state, vec2(-STEP, 0.0)));
    when(&[Key::ArrowRight], turned(state, vec2(STEP, 0.0)));
    when(&[Key::ArrowUp], turned(state, vec2(0.0, -STEP)));
    when(&[Key::ArrowDown], turned(state, vec2(0.0, STEP)));
}

fn turned(state: &State, way: Vec2) -> Command {
    let [yaw, pitch] = state.camera;
    let yaw = (yaw - 0.4 * way.x + 540.0).rem_euclid(360.0) - 180.0;
    Command::Camera([yaw, (pitch + 0.3 * way.y).clamp(-89.0, 89.0)])
}

fn zoomed(state: &State, times: f32) -> Command {
    Command::Zoom((state.zoom * times).clamp(ZOOM[0], ZOOM[1]))
}

/// Dragging turns the instance, or moves it; the wheel zooms.
pub fn camera(ui: &mut Ui, free: Rect, state: &State, done: &mut Vec<Command>) {
    // Not by the keyboard: arrows turn the camera where no control has it.
    let response = ui.interact(free, ui.id().with("camera"), Sense::CLICK | Sense::DRAG);
    let way = response.drag_delta();
    if way != Vec2::ZERO {
        let shift = ui.input(|input| input.modifiers.shift);
        let turns = response.dragged_by(PointerButton::Primary) && !shift;
        let [right, down] = state.pan;
        let share = way / free.size() / state.zoom;
        let panned = [right + share.x, down + share.y].map(|share| share.clamp(-10.0, 10.0));
        done.push(if turns { turned(state, way) } else { Command::Pan(panned) });
    }
    if response.clicked() {
        ui.memory_mut(|memory| memory.stop_text_input());
    }
    let wheel = if response.hovered() { ui.input(|input| input.smooth_scroll_delta().y) } else { 0.0 };
    if wheel != 0.0 {
        done.push(zoomed(state, (wheel * 0.003).exp()));
    }
    if response.double_clicked() {
        done.push(Command::Home);
    }
}
