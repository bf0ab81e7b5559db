//! The contents of the window: device, instances, panel, and drawing a frame of them.

use super::command::Look;
use super::device::{Device, Messages};
use super::frame::{Drawn, Frames, Wanted};
use super::heads::{Full, Heads};
use super::measured::Measured;
use super::painter::{Painter, Picture};
use super::panel::{self, About, ZOOM};
use super::state::State;
use super::swapchain::{self, Swapchain};
use super::{command::Command, legend, style};
use crate::args::render::Background;
use crate::detail::{self, Ball, Detail, Kept};
use crate::output::{Failure, Output};
use crate::render::crowd::places;
use crate::render::joints::Joints;
use crate::render::scenery::{Subject, bounds};
use crate::runner::prepare;
use deltamorph::UpdatePath;
use deltamorph::ash::vk;
use deltamorph_headless::DeviceChoice;
use deltamorph_render::{Camera, Light, Scene, Show, View};
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
    /// Levels of detail, created when targets are first left out.
    kept: Option<Kept>,
    frames: Frames,
    ui: egui_winit::State,
    subject: Subject,
    /// Bounding sphere of an instance in the base pose.
    ball: Ball,
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
        let heads = heads(&device, &frames, format, state, &subject, out)?;
        let full = Full::new(&device, frames.pool, &state.input.kept)?;
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
            kept: None,
            frames,
            ui,
            reach: reach(state),
            ball: Ball::around(&subject.focus),
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
        &self.device.engine.caps().name
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

    pub fn copy(&self, text: String) {
        self.ui.egui_ctx().copy_text(text);
    }

    /// Recreates the images at the window's present size.
    pub fn resize(&mut self) -> Result<(), Failure> {
        self.frames.finish(&mut self.painter)?;
        self.device.wait_idle();
        let (size, heads) = (self.window.inner_size(), self.heads.places.len() as u32);
        let (renderer, old) = (&self.heads.renderer, self.swapchain.take());
        let size = [size.width, size.height];
        self.swapchain = Swapchain::new(&self.device, self.format, renderer, self.painter.pass, size, heads, old)?;
        Ok(())
    }

    /// Recreates the instances as the state requires. After an error the old ones stay.
    pub fn rebuild(&mut self, state: &State, other_mesh: bool, out: &Output) -> Result<(), Failure> {
        let subject = other_mesh.then(|| subject(state)).transpose()?;
        let heads =
            heads(&self.device, &self.frames, self.format, state, subject.as_ref().unwrap_or(&self.subject), out)?;
        // A full evaluation sums masks if the instances have them.
        let other_streams = heads.mesh.groups().len() != self.heads.mesh.groups().len();
        let full = (other_mesh || other_streams).then(|| Full::new(&self.device, self.frames.pool, &state.input.kept));
        let full = full.transpose()?;
        self.frames.finish(&mut self.painter)?;
        self.device.wait_idle();
        // Targets of the swapchain belong to the renderer: they are dropped first.
        self.swapchain = None;
        self.heads = heads;
        if let Some(full) = full {
            self.full = full;
        }
        if let Some(subject) = subject {
            self.ball = Ball::around(&subject.focus);
            (self.subject, self.kept) = (subject, None);
        }
        self.reach = reach(state);
        self.frames.take_samples();
        self.measured.clear(!other_mesh);
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
        let (panel, done, moves) = self.panel(state, extent);
        let mut weights = state.weights()?;
        let joints = state.joints();
        let still = state.still(self.subject.still.as_ref());
        self.hold(state, &mut weights);
        let scene = self.scene(state, extent);
        let moves = moves | self.leave_out(state, &scene, extent, &mut weights)?;
        let wanted = Wanted {
            weights: &weights,
            joints: &joints,
            still: &still,
            scene: &scene,
            background: Background(Some(style::BEHIND)).linear(),
            panel,
            full: self.full.as_mut().and_then(|full| full.is_due(&weights[0], state.playing).then_some(full)),
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

    /// Holds weights at the largest one that updates take; the window says so once.
    fn hold(&mut self, state: &mut State, weights: &mut [Vec<f32>]) {
        let most = self.heads.weight_max;
        let beyond = weights.iter_mut().flatten().filter(|weight| weight.abs() > most);
        let held = beyond.map(|weight| *weight = weight.clamp(-most, most)).count() > 0;
        if held && !self.held {
            let pose = self.heads.desc.pose.name();
            state.say(
                format!("weights beyond {most} are held there, as far as {pose} poses go: see --weight-max"),
                true,
            );
        }
        self.held = held;
    }

    /// Waits until all frames have finished, and their files are written.
    pub fn finish(&mut self) -> Result<(), Failure> {
        self.frames.finish(&mut self.painter)?;
        self.frames.take_samples().into_iter().for_each(|sample| self.measured.add(sample, 0.0));
        Ok(())
    }

    fn panel(&mut self, state: &State, extent: vk::Extent2D) -> (Picture, Vec<Command>, bool) {
        let input = self.ui.take_egui_input(&self.window);
        let caps = self.device.engine.caps();
        let paths: Vec<UpdatePath> = PATHS.into_iter().filter(|path| caps.check_path(*path).is_ok()).collect();
        let format = self.heads.mesh.layout().format;
        let kept = self.kept.as_ref().filter(|_| state.detail != Detail::All).map(Kept::of_all);
        let (device, desc, reach) = (&*caps.name, self.heads.desc, self.reach);
        let camera = self.camera(state, &self.all(state, extent), extent);
        let unit = self.ball.pixels_per_unit(&camera, &Mat4::IDENTITY);
        let about = About { device, paths: &paths, desc, format, kept, reach, unit };
        let (context, mut done, mut free) = (self.ui.egui_ctx().clone(), vec![], egui::Rect::ZERO);
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

    /// Removes the weights of targets that an instance leaves out; returns whether targets are still fading.
    fn leave_out(
        &mut self,
        state: &State,
        scene: &Scene,
        extent: vk::Extent2D,
        weights: &mut [Vec<f32>],
    ) -> Result<bool, Failure> {
        if state.detail == Detail::All && self.kept.is_none() {
            return Ok(false);
        }
        let camera = self.camera(state, &scene.view, extent);
        let kept = match &mut self.kept {
            Some(kept) => kept,
            none @ None => none.insert(Kept::new(&state.input.kept, &self.subject.focus)?),
        };
        let unit = |place: &Mat4| kept.unit(&camera, place);
        let units: Vec<f32> = self.heads.places.iter().map(unit).collect();
        kept.apply(state.detail, &units, weights)?;
        Ok(kept.fades())
    }

    /// A view of all instances, from where the camera is.
    fn all(&self, state: &State, extent: vk::Extent2D) -> View {
        let [_, _, width, height] = self.free;
        let aspect = extent.width as f32 * width / (extent.height as f32 * height).max(1.0);
        let camera = Camera { yaw: state.camera[0], pitch: state.camera[1], ..Camera::default() };
        let shown = if state.whole { &self.subject.whole } else { &self.subject.focus };
        let everywhere = |points: &'_ [Vec3]| -> Vec<Vec3> {
            self.heads.places.iter().flat_map(|place| points.iter().map(|p| place.transform_point3(*p))).collect()
        };
        let mut view = camera.fit(everywhere(shown).into_iter(), aspect.max(0.05), MARGIN);
        if !state.whole {
            view.reach(everywhere(&self.subject.whole).into_iter());
        }
        view
    }

    /// Zoom and pan that fill the room with these vertices of the first instance.
    pub fn focus(&self, state: &State, vertices: &[u32]) -> (f32, [f32; 2]) {
        let Some(swapchain) = self.swapchain.as_ref().filter(|_| !vertices.is_empty()) else { return (1.0, [0.0; 2]) };
        let to_clip = self.all(state, swapchain.extent).clip * self.heads.places[0];
        let positions = &state.input.kept.positions;
        let (low, high) = bounds(vertices.iter().map(|&v| to_clip.project_point3(positions[v as usize])));
        let (size, middle) = ((high - low).truncate().max_element(), (low + high).truncate() / 2.0);
        let zoom = (2.0 * (1.0 - 2.0 * MARGIN) / size.max(f32::MIN_POSITIVE)).clamp(ZOOM[0], ZOOM[1]);
        (zoom, (-middle / 2.0).to_array())
    }

    /// A camera of levels of detail for a view.
    fn camera(&self, state: &State, view: &View, extent: vk::Extent2D) -> detail::Camera {
        let height = extent.height as f32 * self.free[3] * state.zoom;
        detail::Camera { eye: view.eye, height, angle: Camera::default().angle.to_radians() }
    }

    fn scene(&self, state: &State, extent: vk::Extent2D) -> Scene {
        let [left, top, width, height] = self.free;
        let ([right, down], zoom) = (state.pan, state.zoom);
        let mut view = self.all(state, extent);
        // Into the part of the window that the panel leaves free.
        let middle = [(left, width, right), (top, height, down)];
        let [x, y] = middle.map(|(first, size, pan)| 2.0 * first + size * (1.0 + 2.0 * pan * zoom) - 1.0);
        let middle = Vec3::new(x, y, 0.0);
        let size = Vec3::new(width * zoom, height * zoom, 1.0);
        view.clip = Mat4::from_translation(middle) * Mat4::from_scale(size) * view.clip;
        let show = match state.look {
            Look::Shaded => Show::Shaded,
            Look::Wire => Show::Wire,
            Look::Normals => Show::Normals,
            Look::Heat => Show::Distance(self.reach),
            Look::Motion => Show::Motion(legend::motion_end(self.reach)),
            Look::Blocks => Show::Blocks,
            Look::Wrinkles => Show::Wrinkles,
        };
        Scene { view, light: Light::default(), show }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.device.wait_idle();
    }
}

fn heads(
    device: &Device,
    frames: &Frames,
    format: vk::SurfaceFormatKHR,
    state: &State,
    subject: &Subject,
    out: &Output,
) -> Result<Heads, Failure> {
    let mesh = &state.input.kept;
    let (packed, desc) = prepare(&state.run, &state.input, Some(&device.engine), out)?;
    let places = match state.heads {
        1 => vec![Mat4::IDENTITY],
        heads if state.whole => places(&subject.whole, heads, [1280, 860]),
        heads => places(&subject.focus, heads, [1280, 860]),
    };
    let threads = state.run.update.threads.unwrap_or(0);
    let skin = state.skeleton().map(Joints::skin);
    Heads::new(device, frames.pool, format.format, (mesh, subject), (packed, desc, skin), threads, places)
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
