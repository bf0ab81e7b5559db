//! The panel without a window: each control is reached by the mouse and by the keyboard, in windows of all shapes.

use super::*;
use crate::args::{Cli, Command as Program};
use crate::output::Output;
use clap::Parser;
use egui::accesskit::{Node, NodeId, Role};
use egui::{
    Context, Event, Modifiers, MouseWheelUnit, PointerButton, Popup, Pos2, RawInput, TouchPhase, Vec2, pos2, vec2,
};

/// Windows, in points.
const WINDOWS: [[f32; 2]; 3] = [[640.0, 400.0], [1280.0, 800.0], [400.0, 900.0]];

/// How a control is used, and what is chosen.
#[derive(Clone, Copy, Debug)]
enum Use {
    Press,
    Choose(&'static str),
    Slide,
}
use Use::{Choose, Press, Slide};

/// Each control: its name, how it is used, and how the command begins that follows.
const CONTROLS: &[(&str, Use, &str)] = &[
    ("Clip", Choose("second"), "Clip("),
    ("Play", Press, "Play"),
    ("Frame", Slide, "Scrub("),
    ("heat", Press, "Show(Heat)"),
    ("blocks", Press, "Show(Blocks)"),
    ("Reset", Press, "Reset"),
    ("browInnerUp", Slide, "Set(\"browInnerUp\""),
    ("tongueOut", Slide, "Set(\"tongueOut\""),
];

/// A panel, and hands at mouse and keyboard.
struct Hands {
    context: Context,
    state: State,
    size: [f32; 2],
    time: f64,
    nodes: Vec<(NodeId, Node)>,
    focus: NodeId,
    free: Rect,
    done: Vec<Command>,
}

impl Hands {
    fn new(size: [f32; 2], targets: &str) -> Self {
        let out = Output::new(true, None);
        let args = ["deltamorph", "view", "--vertices", "600", "--targets", targets];
        let Program::View(args) = Cli::parse_from(args).command else { unreachable!("it is `view`") };
        let state = State::new(&args, &out).expect("the built-in head");
        let context = Context::default();
        super::super::style::apply(&context, true);
        context.enable_accesskit();
        let (nodes, focus, done) = (vec![], NodeId(0), vec![]);
        let mut this = Self { context, state, size, time: 0.0, nodes, focus, free: Rect::ZERO, done };
        (0..3).for_each(|_| this.frame(vec![], Modifiers::NONE));
        this
    }

    /// A frame with these events, whose commands are done.
    fn frame(&mut self, events: Vec<Event>, modifiers: Modifiers) {
        self.time += 0.1;
        let rect = Rect::from_min_size(Pos2::ZERO, self.size.into());
        let events = [vec![Event::ModifiersChanged(modifiers)], events].concat();
        let input = RawInput { screen_rect: Some(rect), time: Some(self.time), events, ..RawInput::default() };
        let state = &self.state;
        let rows = VecDeque::from([UpdateStats::default(); 3]);
        let mut shown = None;
        let mut output = self.context.run_ui(input, |ui| shown = Some(super::show(ui, state, &rows, "no device")));
        let tree = output.platform_output.accesskit_update.take().expect("nodes");
        output.drop_without_applying_deltas();
        (self.nodes, self.focus) = (tree.nodes, tree.focus);
        let (free, done) = shown.expect("a panel");
        self.free = free;
        for command in done {
            if !matches!(command, Command::Panel(_)) {
                self.state.apply(command.clone()).expect("a command");
            }
            self.done.push(command);
        }
    }

    fn key(&mut self, key: Key) {
        let modifiers = Modifiers::NONE;
        for pressed in [true, false] {
            self.frame(vec![Event::Key { key, physical_key: None, pressed, repeat: false, modifiers }], modifiers);
        }
    }

    /// Where the control of this name is, if it is anywhere.
    fn find(&self, name: &str) -> Option<Rect> {
        let named = |node: &Node| node.label() == Some(name) && !matches!(node.role(), Role::Label);
        let found = self.nodes.iter().find(|(_, node)| named(node))?;
        let bounds = found.1.bounds()?;
        Some(Rect::from_min_max(pos2(bounds.x0 as f32, bounds.y0 as f32), pos2(bounds.x1 as f32, bounds.y1 as f32)))
    }

    fn drag(&mut self, button: PointerButton, modifiers: Modifiers, from: Pos2, way: Vec2) {
        let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
        self.frame(vec![Event::PointerMoved(from)], modifiers);
        self.frame(vec![press(from, true)], modifiers);
        let to = from + way;
        if way != Vec2::ZERO {
            self.frame(vec![Event::PointerMoved(from + way / 2.0)], modifiers);
            self.frame(vec![Event::PointerMoved(to)], modifiers);
        }
        self.frame(vec![press(to, false)], modifiers);
        self.frame(vec![], modifiers);
    }

    fn click(&mut self, at: Pos2) {
        self.drag(PointerButton::Primary, Modifiers::NONE, at, Vec2::ZERO);
    }

    fn wheel(&mut self, at: Pos2, way: f32) {
        let unit = MouseWheelUnit::Point;
        let delta = vec2(0.0, way);
        let phase = TouchPhase::Move;
        let modifiers = Modifiers::NONE;
        self.frame(vec![Event::PointerMoved(at), Event::MouseWheel { unit, delta, phase, modifiers }], modifiers);
        (0..12).for_each(|_| self.frame(vec![], Modifiers::NONE));
    }

    /// Where the part of the window is that the panel has.
    fn panel(&self) -> Rect {
        Rect::from_min_max(Pos2::ZERO, pos2(self.free.left(), self.size[1]))
    }

    /// Scrolls to a control, and says where it is.
    fn scroll_to(&mut self, name: &str) -> Pos2 {
        for _ in 0..60 {
            let panel = self.panel().shrink(12.0);
            let way = match self.find(name) {
                Some(rect) if panel.y_range().contains(rect.center().y) => return rect.center(),
                Some(rect) if rect.center().y < panel.top() => 120.0,
                _ => -120.0,
            };
            self.wheel(panel.center(), way);
        }
        panic!("{name} is not to be found in {:?}", self.size);
    }

    fn by_mouse(&mut self, name: &str, how: Use) {
        let at = self.scroll_to(name);
        match how {
            Press => self.click(at),
            Choose(one) => {
                self.click(at);
                let at = self.find(one).unwrap_or_else(|| panic!("{name} has no {one}")).center();
                self.click(at);
            }
            Slide => self.drag(PointerButton::Primary, Modifiers::NONE, at, vec2(20.0, 0.0)),
        }
    }

    /// Goes on by Tab to the control of this name.
    fn tab_to(&mut self, name: &str) {
        for _ in 0..400 {
            self.key(Key::Tab);
            let focus = self.focus;
            let reached = self.nodes.iter().any(|(id, node)| *id == focus && node.label() == Some(name));
            if reached {
                return;
            }
        }
        panic!("Tab does not reach {name} in {:?}", self.size);
    }

    fn by_keyboard(&mut self, name: &str, how: Use) {
        self.tab_to(name);
        match how {
            Press => self.key(Key::Space),
            Choose(one) => {
                self.key(Key::Space);
                self.tab_to(one);
                self.key(Key::Space);
                assert!(!Popup::is_any_open(&self.context), "{name} is closed again");
            }
            Slide => self.key(Key::ArrowRight),
        }
    }
}

/// Writes clips, so that there is a choice.
fn clips() -> (tempfile::TempDir, Vec<std::path::PathBuf>) {
    let folder = tempfile::tempdir().expect("a folder");
    let clips = ["first.csv", "second.csv"].map(|name| folder.path().join(name));
    clips.iter().for_each(|clip| std::fs::write(clip, "jawOpen\n0\n1\n0.5\n").expect("a clip"));
    (folder, clips.into())
}

#[test]
fn each_control_is_reached_by_mouse_and_by_keyboard_in_windows_of_all_shapes() {
    let (_folder, clips) = clips();
    for (size, reach) in
        WINDOWS.into_iter().flat_map(|size| [(size, Hands::by_mouse as fn(&mut _, &_, _)), (size, Hands::by_keyboard)])
    {
        let mut hands = Hands::new(size, "52");
        let panel = hands.panel();
        assert!(hands.free.area() > 0.3 * size[0] * size[1] && panel.area() > 1e4, "{size:?}: {panel}");
        hands.state.clips.clone_from(&clips);
        for (name, how, says) in CONTROLS {
            hands.done.clear();
            reach(&mut hands, name, *how);
            let done = hands.done.iter().any(|command| format!("{command:?}").starts_with(says));
            assert!(done, "{name} in {size:?}: {:?}", hands.done);
            let inside = |rect: Rect| panel.left() - 1.0 <= rect.left() && rect.right() <= panel.right() + 1.0;
            assert!(hands.find(name).is_none_or(inside), "{name} in {size:?} is wider than {panel}");
            hands.state.playing = false;
        }
    }
    // Too small for anything but the face.
    assert_eq!(Hands::new([200.0, 150.0], "52").free.size(), vec2(200.0, 150.0));
}

#[test]
fn keys_do_what_the_list_says() {
    let (_folder, clips) = clips();
    let mut hands = Hands::new([1280.0, 800.0], "52");
    hands.state.apply(Command::Clip(clips[0].clone())).expect("a clip");
    for (key, says) in [
        (Key::Space, "Play"),
        (Key::Space, "Pause"),
        (Key::Comma, "Scrub(2.0)"),
        (Key::Period, "Scrub(0.0)"),
        (Key::ArrowLeft, "Camera("),
        (Key::ArrowUp, "Camera("),
        (Key::Plus, "Zoom(1.15"),
        (Key::Minus, "Zoom("),
        (Key::H, "Home"),
        (Key::P, "Panel(false)"),
    ] {
        hands.done.clear();
        hands.key(key);
        let done: Vec<String> = hands.done.iter().map(|command| format!("{command:?}")).collect();
        assert!(done.len() == 1 && done[0].starts_with(says), "{key:?}: {done:?}, not {says}");
    }
    // Escape closes an open list, and nothing else.
    hands.state.clips = clips;
    hands.tab_to("Clip");
    hands.key(Key::Space);
    assert!(Popup::is_any_open(&hands.context));
    hands.done.clear();
    hands.key(Key::Escape);
    assert!(!Popup::is_any_open(&hands.context) && hands.done.is_empty(), "{:?}", hands.done);
}

#[test]
fn the_mouse_turns_moves_and_zooms() {
    let mut hands = Hands::new([1280.0, 800.0], "4");
    let middle = hands.free.center();
    let way = vec2(40.0, 20.0);
    hands.drag(PointerButton::Primary, Modifiers::NONE, middle, way);
    assert!(hands.state.camera != [18.0, 4.0] && hands.state.pan == [0.0; 2], "{:?}", hands.state.pan);
    for (button, modifiers) in [
        (PointerButton::Primary, Modifiers::SHIFT),
        (PointerButton::Secondary, Modifiers::NONE),
        (PointerButton::Middle, Modifiers::NONE),
    ] {
        let camera = hands.state.camera;
        hands.state.pan = [0.0; 2];
        hands.drag(button, modifiers, middle, way);
        let Vec2 { x, y } = way / hands.free.size();
        let [right, down] = hands.state.pan;
        assert!((right - x).abs() < 1e-4 && (down - y).abs() < 1e-4 && hands.state.camera == camera);
    }
    hands.wheel(middle, 100.0);
    assert!(hands.state.zoom > 1.1, "{}", hands.state.zoom);
}

#[test]
fn notices_leave_by_themselves() {
    let mut hands = Hands::new([640.0, 400.0], "4");
    hands.state.say("words".into());
    (1..10).for_each(|_| hands.state.advance(1.0));
    assert!(hands.state.notice.is_some());
    hands.frame(vec![], Modifiers::NONE);
    hands.state.advance(1.0);
    assert!(hands.state.notice.is_none());
}
