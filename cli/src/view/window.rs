//! The window's events, and the script: both become commands.

use super::command::{Command, Step};
use super::stage::Stage;
use super::state::State;
use crate::args::view::ViewArgs;
use crate::output::{Failure, Output, Result};
use deltamorph_headless::DeviceChoice;
use std::collections::VecDeque;
use std::fmt::Display;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

/// Least time between frames in an interactive window; scripts use it as the time of a frame.
const FRAME: Duration = Duration::from_micros(16_667);
/// Frames drawn after the last event, until glowing blocks have faded and the panel has settled.
const AWAKE: u32 = 60;
/// Longest wait for the window system to resize a window.
const PATIENCE: Duration = Duration::from_secs(20);

/// The failure if the window system opens no window. The last part of winit's errors is the reason; the rest is a place
/// in its source.
fn no_window(error: impl Display) -> Failure {
    let text = error.to_string();
    let why = text.rsplit(": ").next().unwrap_or_default().trim_end_matches('.');
    Failure::Failed(format!("no window can be opened here: {why}; `deltamorph render` draws pictures without one"))
}

/// The program, as winit calls it.
pub struct App<'a> {
    args: &'a ViewArgs,
    choice: Option<&'a DeviceChoice>,
    out: &'a Output,
    state: State,
    script: Option<Script>,
    stage: Option<Stage>,
    failure: Option<Failure>,
    next: Instant,
    awake: u32,
}

/// The rest of a script.
struct Script {
    steps: VecDeque<(usize, Step)>,
    /// Line of the current step.
    line: usize,
    /// Frames to draw first, and a file for the last of them.
    frames: u64,
    screenshot: Option<PathBuf>,
    size: Option<([u32; 2], Instant)>,
}

impl<'a> App<'a> {
    pub fn new(
        args: &'a ViewArgs,
        choice: Option<&'a DeviceChoice>,
        out: &'a Output,
        steps: Option<Vec<(usize, Step)>>,
    ) -> Result<Self> {
        let state = State::new(args, out)?;
        let script = |steps: Vec<_>| Script { steps: steps.into(), line: 0, frames: 0, screenshot: None, size: None };
        let script = steps.map(script);
        let next = Instant::now();
        Ok(Self { args, choice, out, state, script, stage: None, failure: None, next, awake: AWAKE })
    }

    /// Shows the window until it is closed.
    pub fn run(mut self) -> Result<()> {
        let events = EventLoop::new().map_err(no_window)?;
        events.run_app(&mut self).map_err(no_window)?;
        let messages = self.stage.as_ref().map(Stage::messages);
        // Validation layers report objects that outlive the device.
        self.stage = None;
        let said = messages.map(|messages| messages.lock().unwrap_or_else(PoisonError::into_inner).clone());
        let said = said.unwrap_or_default();
        if let (None, Some(first)) = (&self.failure, said.first()) {
            let count = said.len();
            let name = "the validation layers";
            self.failure =
                Some(Failure::Failed(format!("{name} reported {count} messages, the first: {first}; report this")));
        }
        self.failure.map_or(Ok(()), Err)
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.args.size;
        let title = format!("deltamorph – {}", self.state.input.name);
        let attributes = Window::default_attributes().with_title(title);
        let attributes = attributes.with_inner_size(LogicalSize::new(width, height));
        let window = events.create_window(attributes).map_err(no_window)?;
        let window = Arc::new(window);
        let still = self.script.is_some();
        let stage = Stage::new(window, &self.state, self.args, self.choice, still, self.out)?;
        if stage.device_name().contains("llvmpipe") {
            self.out.warn(format_args!("{} is a software driver: frames are slow", stage.device_name()));
        }
        self.stage = Some(stage);
        Ok(())
    }

    /// Applies a command of the user. Errors are shown in the window.
    fn apply(&mut self, command: Command) {
        if let Err(failure) = self.state.apply(command) {
            self.state.say(failure.to_string());
        }
    }

    /// Executes steps of the script until one needs a frame; returns whether anything is left to do.
    fn steps(&mut self) -> Result<bool> {
        loop {
            let (Some(script), Some(stage)) = (&mut self.script, &mut self.stage) else { return Ok(true) };
            if let Some((size, since)) = script.size {
                if stage.size() != Some(stage.pixels(size)) {
                    if since.elapsed() > PATIENCE {
                        let [width, height] = size;
                        return Err(Failure::Failed(format!(
                            "resize {width} {height}: the window got another size; use one that fits the \
                             screen"
                        )));
                    }
                    return Ok(true);
                }
                script.size = None;
            }
            if script.frames > 0 {
                return Ok(true);
            }
            let Some((line, step)) = script.steps.pop_front() else { return Ok(false) };
            script.line = line;
            match step {
                Step::Quit => return Ok(false),
                Step::Frames(frames) => script.frames = frames,
                // One frame to settle the panel, and one to save.
                Step::Screenshot(path) => (script.frames, script.screenshot) = (2, Some(path)),
                Step::Resize([width, height]) => {
                    script.size = Some(([width, height], Instant::now()));
                    let _ = stage.window.request_inner_size(LogicalSize::new(width, height));
                }
                Step::Do(command) => self.state.apply(command)?,
            }
        }
    }

    fn frame(&mut self) -> Result<bool> {
        if !self.steps()? {
            return Ok(false);
        }
        let Some(stage) = &mut self.stage else { return Ok(true) };
        if let Some(script) = &mut self.script {
            script.frames = script.frames.saturating_sub(1);
        }
        let last = self.script.as_mut().filter(|script| script.frames == 0);
        let screenshot = last.and_then(|script| script.screenshot.take());
        let (drawn, done, moves) = stage.draw(&mut self.state, screenshot.as_deref())?;
        // If the window was just resized, nothing was drawn: the next frame is saved.
        if let Some(script) = self.script.as_mut().filter(|_| !drawn && screenshot.is_some()) {
            (script.frames, script.screenshot) = (1, screenshot);
        }
        self.state.advance(FRAME.as_secs_f64());
        let still = done.is_empty() && !self.state.playing && !moves && self.state.notice.is_none();
        self.awake = if still { self.awake.saturating_sub(1) } else { AWAKE };
        done.into_iter().for_each(|command| self.apply(command));
        Ok(true)
    }

    /// Closes the window after an error, which in a script names the line.
    fn keep(&mut self, events: &ActiveEventLoop, result: Result<bool>) {
        match result {
            Ok(true) => {}
            Ok(false) => events.exit(),
            Err(failure) => {
                let line = self.script.as_ref().map(|script| script.line).filter(|line| *line > 0);
                let place = line.zip(self.args.script.as_ref());
                let place = place.map_or_else(String::new, |(line, file)| format!("{}, line {line}: ", file.display()));
                self.failure.get_or_insert(match failure {
                    Failure::Usage(text) => Failure::Usage(format!("{place}{text}")),
                    Failure::Failed(text) => Failure::Failed(format!("{place}{text}")),
                });
                events.exit();
            }
        }
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.stage.is_none() {
            let opened = self.open(events).map(|()| true);
            self.keep(events, opened);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(stage) = &mut self.stage else { return };
        if stage.event(&event) {
            self.awake = AWAKE;
        }
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) => {
                self.awake = AWAKE;
                let resized = stage.resize().map(|()| true);
                self.keep(events, resized);
            }
            WindowEvent::DroppedFile(path) => {
                self.awake = AWAKE;
                self.apply(Command::Clip(path));
            }
            WindowEvent::RedrawRequested if !events.exiting() => {
                let drawn = self.frame();
                self.keep(events, drawn);
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(stage) = self.stage.as_ref().filter(|_| !events.exiting()) else { return };
        let now = Instant::now();
        if self.script.is_some() {
            events.set_control_flow(ControlFlow::Poll);
        } else if self.awake == 0 || stage.size().is_none() {
            events.set_control_flow(ControlFlow::Wait);
            return;
        } else if now < self.next {
            events.set_control_flow(ControlFlow::WaitUntil(self.next));
            return;
        }
        self.next = now + FRAME;
        stage.window.request_redraw();
    }
}
