//! The contents of the window: device, instance, panel, and drawing a frame of them.

use super::command::Command;
use super::device::{Device, Messages};
use super::painter::Painter;
use super::panel;
use super::plot::FRAMES;
use super::state::State;
use super::style;
use super::swapchain::Swapchain;
use crate::args::render::Background;
use crate::args::view::ViewArgs;
use crate::output::{Output, Result};
use crate::render::canvas::save;
use crate::render::subject::Subject;
use crate::runner::prepare;
use deltamorph::UpdateStats;
use deltamorph_headless::DeviceChoice;
use deltamorph_render::{Heads, HeadsDesc, Light, Scene, Show, Target};
use egui::{Context, Rect};
use glam::{Mat4, Vec3};
use std::collections::VecDeque;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use winit::dpi::LogicalSize;
use winit::window::Window;

/// Share of the free space left empty at each edge.
const MARGIN: f32 = 0.1;
/// Share of the glow of a written block that remains after each frame.
const AFTERGLOW: f32 = 0.88;

/// Everything created on the device, in the order of dropping. One frame is drawn at a time.
pub struct Stage {
    painter: Painter,
    /// The images of the window, and the one that is drawn into; `None` while the window is minimised.
    canvas: Option<(Swapchain, Target)>,
    heads: Heads,
    /// The largest weight that updates take, either sign.
    weight_max: f32,
    /// Device and update, in words.
    about: String,
    ui: egui_winit::State,
    subject: Subject,
    /// Longest distance that a single target moves a vertex.
    reach: f32,
    /// Recent updates.
    rows: VecDeque<UpdateStats>,
    /// The part of the window that the panel leaves free, in shares of the window.
    free: Rect,
    device: Rc<Device>,
    pub window: Arc<Window>,
}

impl Stage {
    pub fn new(
        window: Arc<Window>,
        state: &State,
        ViewArgs { run, validation, .. }: &ViewArgs,
        choice: Option<&DeviceChoice>,
        is_scripted: bool,
        out: &Output,
    ) -> Result<Self> {
        let device = Rc::new(Device::new(&window, choice, *validation)?);
        let painter = Painter::new(&device)?;
        let mesh = &state.input.kept;
        let subject = Subject::new(&state.input)?;
        let headless = &device.headless;
        let (packed, desc) = prepare(run, &state.input, Some(headless.engine()), out)?;
        let threads = run.update.threads.unwrap_or(0);
        let still = subject.still.as_ref().map(|still| (&still.mesh, &still.parts[..]));
        let heads = HeadsDesc { threads, still, afterglow: AFTERGLOW, ..HeadsDesc::new(desc) };
        // SAFETY: fields drop in order, the target, then the heads, then the device; each frame is waited for.
        let heads = unsafe { Heads::new(headless, mesh, &packed, &subject.parts, &heads) }?;
        // Poses of floats have no grid, and take what the library takes.
        let weight_max = packed.layout().grid(desc.pose, desc.weight_max).map_or(1e6, |grid| grid.weight_max);
        let [path, format, pose] = [desc.path.name(), packed.layout().format.name(), desc.pose.name()];
        let about = format!("{path} {format} {pose} · {}", headless.caps().name);
        let context = Context::default();
        style::apply(&context, is_scripted);
        let (raw, physical, _) = headless.handles();
        // SAFETY: the physical device is the instance's.
        let limits = unsafe { raw.get_physical_device_properties(physical) }.limits;
        let most = Some(limits.max_image_dimension2_d as usize);
        let ui = egui_winit::State::new(context, egui::ViewportId::ROOT, &*window, None, None, most);
        let lengths = mesh.targets.iter().flat_map(|target| &target.positions).map(|delta| delta.length());
        let reach = lengths.fold(mesh.diagonal * 1e-4, f32::max).max(f32::MIN_POSITIVE);
        let free = Rect::ZERO;
        let rows = VecDeque::new();
        let canvas = None;
        let mut this =
            Self { painter, canvas, heads, weight_max, about, ui, subject, reach, rows, free, device, window };
        this.resize()?;
        Ok(this)
    }

    pub fn device_name(&self) -> &str {
        &self.device.headless.caps().name
    }

    /// Size of the window; `None` if minimised.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.canvas.as_ref().map(|(swapchain, _)| swapchain.size)
    }

    pub fn messages(&self) -> Arc<Messages> {
        self.device.messages()
    }

    /// Pixels of a size stated without the scale of the screen.
    pub fn pixels(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        LogicalSize::new(width, height).to_physical::<u32>(self.window.scale_factor()).into()
    }

    /// Handles an event of the window; returns whether the panel has to be redrawn.
    pub fn event(&mut self, event: &winit::event::WindowEvent) -> bool {
        self.ui.on_window_event(&self.window, event).repaint
    }

    /// Recreates the images at the window's present size.
    pub fn resize(&mut self) -> Result<()> {
        let size = self.window.inner_size();
        self.canvas = None;
        if let Some(swapchain) = Swapchain::new(&self.device, [size.width, size.height])? {
            // SAFETY: as for the heads.
            let target = unsafe { self.heads.target(swapchain.size) }?;
            self.painter.set_target(&target)?;
            self.canvas = Some((swapchain, target));
        }
        Ok(())
    }

    /// Draws a frame, and writes it to `screenshot`. Returns whether it did, the user's commands in the panel, and
    /// whether the panel is animated.
    pub fn draw(&mut self, state: &mut State, screenshot: Option<&Path>) -> Result<(bool, Vec<Command>, bool)> {
        if self.canvas.is_none() {
            self.resize()?;
        }
        if self.canvas.is_none() {
            return Ok((false, vec![], false));
        }
        let (done, moves) = self.panel(state)?;
        let mut weights = state.weights()?;
        self.hold(state, &mut weights);
        let drawn = self.picture(&weights, &self.scene(state), screenshot)?;
        Ok((drawn, done, moves))
    }

    fn picture(&mut self, weights: &[f32], scene: &Scene, screenshot: Option<&Path>) -> Result<bool> {
        let Some((swapchain, target)) = &mut self.canvas else { return Ok(false) };
        let Some(index) = swapchain.acquire()? else {
            return self.resize().map(|()| false);
        };
        let headless = &self.device.headless;
        let background = Background(Some(style::BEHIND)).linear();
        let heads = &mut self.heads;
        // SAFETY: the buffer is recording, runs once, and is waited for before the next frame; each pass leaves the
        // picture ready for what follows. If the commands do not run, the window closes.
        let (stats, panel) = headless.run(|cmd| unsafe {
            let updated = heads.update(headless.engine(), cmd, &[weights])?;
            heads.record(cmd, target, &[Mat4::IDENTITY], scene, background)?;
            let panel = self.painter.record(cmd);
            if screenshot.is_some() {
                target.copy_pixels(cmd);
            }
            swapchain.record(cmd, index, target.image().0);
            Ok((updated.stats, panel))
        })?;
        panel?;
        self.rows.truncate(FRAMES - 1);
        self.rows.push_front(stats);
        if let Some(path) = screenshot {
            save(target.picture()?, path)?;
        }
        if !swapchain.present(index)? {
            self.resize()?;
        }
        Ok(true)
    }

    /// Holds weights at the largest one that updates take, and says so.
    fn hold(&self, state: &mut State, weights: &mut [f32]) {
        let most = self.weight_max;
        if weights.iter().any(|weight| weight.abs() > most) {
            state.say(format!("weights are limited to ±{most} in this pose format: see --weight-max"));
        }
        weights.iter_mut().for_each(|weight| *weight = weight.clamp(-most, most));
    }

    fn panel(&mut self, state: &State) -> Result<(Vec<Command>, bool)> {
        let input = self.ui.take_egui_input(&self.window);
        let context = self.ui.egui_ctx().clone();
        let mut done = vec![];
        let mut free = Rect::ZERO;
        let mut output = context.run_ui(input, |ui| {
            let (rect, commands) = panel::show(ui, state, &self.rows, &self.about);
            free = rect;
            done.extend(commands);
        });
        let whole = context.content_rect().size();
        self.free = Rect::from_min_max((free.min.to_vec2() / whole).to_pos2(), (free.max.to_vec2() / whole).to_pos2());
        self.ui.handle_platform_output(&self.window, std::mem::take(&mut output.platform_output));
        let moves = output.viewport_output.values().any(|view| view.repaint_delay.as_millis() < 100);
        self.painter.take(&context, output)?;
        Ok((done, moves))
    }

    fn scene(&self, state: &State) -> Scene {
        let [width, height] = self.size().unwrap_or([1; 2]).map(|pixels| pixels as f32);
        let zoom = state.zoom;
        // At least a pixel, in windows of any size.
        let free = self.free.size().max(egui::Vec2::splat(1e-3));
        let aspect = (width * free.x / (height * free.y)).max(0.05);
        let mut view = self.subject.view(state.camera, &[Mat4::IDENTITY], aspect, MARGIN);
        // Into the part of the window that the panel leaves free.
        let [right, down] = state.pan.map(|pan| 1.0 + 2.0 * pan * zoom);
        let x = 2.0 * self.free.left() + free.x * right - 1.0;
        let y = 2.0 * self.free.top() + free.y * down - 1.0;
        let to_room = Mat4::from_translation(Vec3::new(x, y, 0.0));
        view.clip = to_room * Mat4::from_scale(Vec3::new(free.x * zoom, free.y * zoom, 1.0)) * view.clip;
        // What moves in a frame is a small part of the way.
        let end = if state.look == Show::Motion { 0.1 * self.reach } else { self.reach };
        Scene { view, light: Light::default(), show: state.look, end }
    }
}
