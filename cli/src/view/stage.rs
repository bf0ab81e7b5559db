//! The contents of the window: device, instances, panel, and drawing a frame of them.

use super::command::Command;
use super::device::{Device, Messages};
use super::frame::{Drawn, Frames, Wanted};
use super::heads::{Full, Heads};
use super::measured::Measured;
use super::painter::{Painter, Picture};
use super::panel::{self, About};
use super::state::State;
use super::style;
use super::swapchain::{self, Swapchain};
use crate::args::render::{Background, Look};
use crate::output::{Failure, Output};
use crate::render::joints::Joints;
use crate::render::scenery::Subject;
use crate::runner::prepare;
use deltamorph::UpdatePath;
use deltamorph::ash::vk;
use deltamorph_headless::DeviceChoice;
use deltamorph_render::{Camera, Light, Scene};
use egui::Context;
use glam::{Mat4, Vec3};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;
use winit::dpi::LogicalSize;
use winit::window::Window;

/// Paths whose poses can be drawn; the panel offers those that the device supports.
const PATHS: [UpdatePath; 4] = [UpdatePath::Blocks, UpdatePath::Compute, UpdatePath::Feedback, UpdatePath::Cpu];
/// Share of the free space left empty at each edge.
const MARGIN: f32 = 0.1;

/// Everything created on the device, in the order of dropping.
pub struct Stage {
    painter: Painter,
    swapchain: Option<Swapchain>,
    heads: Heads,
    full: Option<Full>,
    frames: Frames,
    ui: egui_winit::State,
    subject: Subject,
    /// Longest distance that a single target moves a vertex.
    reach: f32,
    pub measured: Measured,
    format: vk::SurfaceFormatKHR,
    /// The part of the window that the panel leaves free: left, top, width, height, as shares of the window.
    free: [f32; 4],
    last: Instant,
    /// Whether a weight is larger than updates take.
    held: bool,
    device: Rc<Device>,
    pub window: Arc<Window>,
}

impl Stage {
    pub fn new(
        window: Arc<Window>,
        state: &State,
        choice: Option<&DeviceChoice>,
        validation: bool,
        still: bool,
        out: &Output,
    ) -> Result<Self, Failure> {
        let device = Rc::new(Device::new(&window, choice, validation)?);
        let format = swapchain::format(&device)?;
        let frames = Frames::new(&device, format.format)?;
        let painter = Painter::new(&device, format.format)?;
        let subject = subject(state)?;
        let heads = heads(&device, format, state, &subject, out)?;
        let full = Full::new(&device.headless, &state.input.kept)?;
        let context = Context::default();
        style::apply(&context, still);
        // SAFETY: the physical device is the instance's.
        let limits = unsafe { device.instance().get_physical_device_properties(device.physical()) }.limits;
        let most = Some(limits.max_image_dimension2_d as usize);
        let ui = egui_winit::State::new(context, egui::ViewportId::ROOT, &*window, None, None, most);
        let mut this = Self {
            painter,
            swapchain: None,
            heads,
            full,
            frames,
            ui,
            reach: reach(state),
            subject,
            measured: Measured::default(),
            format,
            free: [0.0, 0.0, 1.0, 1.0],
            last: Instant::now(),
            held: false,
            device,
            window,
        };
        this.resize()?;
        Ok(this)
    }

    pub fn device_name(&self) -> &str {
        &self.device.engine().caps().name
    }

    /// Path, format and poses, in words.
    pub fn setup(&self) -> String {
        let desc = self.heads.desc;
        let [path, format, pose] = [desc.path.name(), self.heads.mesh.layout().format.name(), desc.pose.name()];
        format!("{path} {format} {pose}")
    }

    pub fn on_device(&self) -> bool {
        self.heads.desc.path != UpdatePath::Cpu
    }

    /// Size of the window; `None` if minimised.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.swapchain.as_ref().map(|swapchain| [swapchain.extent.width, swapchain.extent.height])
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
    pub fn resize(&mut self) -> Result<(), Failure> {
        self.frames.finish(&mut self.painter)?;
        self.device.wait_idle();
        let size = self.window.inner_size();
        let old = self.swapchain.take();
        self.swapchain = Swapchain::new(
            &self.device,
            self.format,
            &self.heads.drawn,
            self.painter.pass,
            [size.width, size.height],
            old,
        )?;
        Ok(())
    }

    /// Recreates the instance as the state requires. After an error the old one stays.
    pub fn rebuild(&mut self, state: &State, out: &Output) -> Result<(), Failure> {
        let heads = heads(&self.device, self.format, state, &self.subject, out)?;
        self.frames.finish(&mut self.painter)?;
        self.device.wait_idle();
        // A full evaluation sums masks if the instance has them.
        if heads.mesh.groups().len() != self.heads.mesh.groups().len() {
            self.full = Full::new(&self.device.headless, &state.input.kept)?;
        }
        // Targets of the swapchain belong to the instance: they are dropped first.
        self.swapchain = None;
        self.heads = heads;
        self.frames.take_samples();
        self.measured.clear();
        self.resize()
    }

    /// Draws a frame; returns the user's commands in the panel, and whether the panel is animated. Takes `screenshot`
    /// if it is drawn.
    pub fn draw(
        &mut self,
        state: &mut State,
        screenshot: &mut Option<PathBuf>,
    ) -> Result<(Vec<Command>, bool), Failure> {
        if self.swapchain.is_none() {
            self.resize()?;
        }
        let Some(extent) = self.swapchain.as_ref().map(|swapchain| swapchain.extent) else {
            return Ok((vec![], false));
        };
        let (panel, done, moves) = self.panel(state);
        let mut weights = state.weights()?;
        self.hold(state, &mut weights);
        let scene = self.scene(state, extent);
        let wanted = Wanted {
            weights: &weights,
            joints: state.joints(),
            still: state.still(self.subject.still.as_ref()),
            scene: &scene,
            background: Background(Some(style::BEHIND)).linear(),
            panel,
            full: self.full.as_mut().and_then(|full| full.is_due(&weights, state.playing).then_some(full)),
            screenshot,
        };
        let Some(swapchain) = &mut self.swapchain else { return Ok((done, moves)) };
        let drawn = self.frames.draw(&mut self.heads, swapchain, &mut self.painter, wanted)?;
        let wall_ms = self.last.elapsed().as_secs_f64() * 1e3;
        self.last = Instant::now();
        for sample in self.frames.take_samples() {
            self.measured.add(sample, wall_ms);
        }
        if matches!(drawn, Drawn::Outgrown) {
            self.resize()?;
        }
        Ok((done, moves))
    }

    /// Holds weights at the largest one that updates take; the window says so until they are smaller.
    fn hold(&mut self, state: &mut State, weights: &mut [f32]) {
        let most = self.heads.weight_max;
        let held = weights.iter().any(|weight| weight.abs() > most);
        weights.iter_mut().for_each(|weight| *weight = weight.clamp(-most, most));
        if held && !self.held {
            let pose = self.heads.desc.pose.name();
            state.say(
                format!("weights beyond {most} are held there, as far as {pose} poses go: see --weight-max"),
                true,
            );
        }
        if self.held && !held {
            state.notice = None;
        }
        self.held = held;
    }

    /// Waits until all frames have finished, and their files are written.
    pub fn finish(&mut self) -> Result<(), Failure> {
        self.frames.finish(&mut self.painter)?;
        self.frames.take_samples().into_iter().for_each(|sample| self.measured.add(sample, 0.0));
        Ok(())
    }

    fn panel(&mut self, state: &State) -> (Picture, Vec<Command>, bool) {
        let input = self.ui.take_egui_input(&self.window);
        let caps = self.device.engine().caps();
        let paths: Vec<UpdatePath> = PATHS.into_iter().filter(|path| caps.check_path(*path).is_ok()).collect();
        let format = self.heads.mesh.layout().format;
        let about = About { device: &caps.name, paths: &paths, desc: self.heads.desc, format };
        let context = self.ui.egui_ctx().clone();
        let mut done = vec![];
        let mut free = egui::Rect::ZERO;
        let mut output = context.run_ui(input, |ui| {
            let (rect, commands) = panel::show(ui, state, &self.measured, &about);
            free = rect;
            done.extend(commands);
        });
        let whole = context.content_rect();
        if whole.area() > 0.0 && free.area() > 0.0 {
            let share = |at: f32, size: f32| at / size;
            self.free = [
                share(free.left(), whole.width()),
                share(free.top(), whole.height()),
                share(free.width(), whole.width()),
                share(free.height(), whole.height()),
            ];
        }
        self.ui.handle_platform_output(&self.window, std::mem::take(&mut output.platform_output));
        let moves = output.viewport_output.values().any(|view| view.repaint_delay.as_millis() < 100);
        (Picture::new(&context, output), done, moves)
    }

    fn scene(&self, state: &State, extent: vk::Extent2D) -> Scene {
        let [left, top, width, height] = self.free;
        let zoom = state.zoom;
        let aspect = extent.width as f32 * width / (extent.height as f32 * height).max(1.0);
        let camera = Camera { yaw: self.subject.front + state.camera[0], pitch: state.camera[1], ..Camera::default() };
        let mut view = camera.fit(self.subject.focus.iter().copied(), aspect.max(0.05), MARGIN);
        view.reach(self.subject.whole.iter().copied());
        // Into the part of the window that the panel leaves free.
        let middle = [(left, width, state.pan[0]), (top, height, state.pan[1])];
        let [x, y] = middle.map(|(first, size, pan)| 2.0 * first + size * (1.0 + 2.0 * pan * zoom) - 1.0);
        let to_room = Mat4::from_translation(Vec3::new(x, y, 0.0));
        view.clip = to_room * Mat4::from_scale(Vec3::new(width * zoom, height * zoom, 1.0)) * view.clip;
        // What moves in a frame is a small part of the way.
        let end = if state.look == Look::Motion { 0.1 * self.reach } else { self.reach };
        Scene { view, light: Light::default(), show: state.look.show(end) }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.device.wait_idle();
    }
}

fn heads(
    device: &Device,
    format: vk::SurfaceFormatKHR,
    state: &State,
    subject: &Subject,
    out: &Output,
) -> Result<Heads, Failure> {
    let mesh = &state.input.kept;
    let packed = prepare(&state.run, &state.input, Some(device.engine()), out)?;
    let threads = state.run.update.threads.unwrap_or(0);
    let skin = state.skeleton().map(Joints::skin);
    Heads::new(&device.headless, format.format, (mesh, subject), packed, skin, threads)
}

fn subject(state: &State) -> Result<Subject, Failure> {
    let mut subject = Subject::new(state.run.input.input.as_deref(), &state.input, state.is_unposed())?;
    if let Some(joints) = state.skeleton() {
        subject.reach(joints, &state.input.kept, None, true);
    }
    Ok(subject)
}

fn reach(state: &State) -> f32 {
    let mesh = &state.input.kept;
    let furthest = mesh.targets.iter().flat_map(|target| &target.positions).map(|delta| delta.length());
    furthest.fold(mesh.diagonal * 1e-4, f32::max).max(f32::MIN_POSITIVE)
}
