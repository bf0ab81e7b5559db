//! The user's choices, and the effects of commands on them. Independent of window and device.

use super::command::{Command, Look};
use super::groups::{Group, groups, of_face, twin};
use crate::args::RunArgs;
use crate::args::view::ViewArgs;
use crate::detail::Detail;
use crate::input::{self, Input, Meshes};
use crate::output::{Failure, Output};
use crate::render::joints::Joints;
use crate::render::painted::Still;
use deltamorph::{BoundClip, UpdatePath};
use deltamorph_head::Rng;
use std::path::{Path, PathBuf};

/// Number of weights that `random` sets.
const RANDOM: usize = 6;

/// Seconds that a notice stays; errors are read twice.
const STAYS: f64 = 5.0;
const ERROR_STAYS: f64 = 20.0;
/// Changes of weights that can be taken back.
const UNDONE: usize = 200;
/// Width of the panel at first, in points.
pub const WIDTH: f32 = 332.0;

/// The mesh, weights, clip, update description, and view.
pub struct State {
    /// The mesh, and the options of its updates, as on the command line.
    pub run: RunArgs,
    pub input: Input,
    /// Names of the sliders: targets.
    pub names: Vec<String>,
    pub values: Vec<f32>,
    /// Weights before changes that can be taken back, and before those that were.
    undone: [Vec<Vec<f32>>; 2],
    /// The slider whose changes are undone together.
    pub moving: Option<usize>,
    pub groups: Vec<Group>,
    pub clip: Option<BoundClip>,
    /// Clips to choose from, and the chosen one.
    pub clips: Vec<PathBuf>,
    pub chosen: Option<PathBuf>,
    /// Joints that move the mesh, in the frame of the clip.
    joints: Option<Joints>,
    /// Whether weights come from the clip; until a slider is moved.
    pub follows: bool,
    pub playing: bool,
    /// Frame of the clip, from 0, and playback speed.
    pub at: f64,
    pub speed: f32,
    pub heads: u32,
    pub detail: Detail,
    pub look: Look,
    /// While wrinkles are shown, the mesh without masks; afterwards, the mesh with them.
    unshown: Option<Meshes>,
    pub camera: [f32; 2],
    /// The camera at the beginning.
    home: [f32; 2],
    pub zoom: f32,
    pub pan: [f32; 2],
    /// Whether the camera shows all of the scene, not only what targets move.
    pub whole: bool,
    pub search: String,
    pub only_active: bool,
    pub twins: bool,
    pub panel: bool,
    pub width: f32,
    pub help: bool,
    pub notice: Option<Notice>,
}

/// A text in the window, which leaves by itself.
pub struct Notice {
    pub text: String,
    pub is_error: bool,
    /// Seconds it stays.
    left: f64,
}

/// The window's part in executing a command.
pub enum Effect {
    None,
    /// Recreate the instances: they are packed or updated differently, or their number changed.
    Heads,
    /// Turn the camera's zoom and pan to these vertices.
    Focus(Vec<u32>),
    /// Another mesh: the new state, if instances of it can be created.
    Mesh(Box<State>),
    /// A text for the clipboard.
    Copy(String),
}

impl State {
    pub fn new(args: &ViewArgs, out: &Output) -> Result<Self, Failure> {
        let mut this = Self::read(args.run.clone(), args.weights.as_deref(), out)?;
        (this.heads, this.camera, this.home) = (args.heads, args.camera, args.camera);
        this.input.pose(&args.set)?; // refuses names that there are not
        for (name, weight) in &args.set {
            this.set(name, *weight, false)?;
        }
        this.undone = Default::default();
        Ok(this)
    }

    /// The state of INPUT at rest, with the clip at `named` or its first one.
    fn read(run: RunArgs, named: Option<&Path>, out: &Output) -> Result<Self, Failure> {
        let skins = run.update.paths.first() != Some(&UpdatePath::Cpu);
        let input = input::load_split(&run.input, skins, out)?;
        let joints = if skins { Joints::of(&run.input, &input)? } else { None };
        let first = named.or(input.clips.first().map(PathBuf::as_path));
        let clip = input::clips(first, &run.input, &input, &[])?.pop();
        let mut this = Self::of(run, input, clip, named.map(Path::to_path_buf));
        this.clips.extend(joints.iter().flat_map(Joints::alone));
        this.joints = joints;
        this.play_joints()?;
        Ok(this)
    }

    /// Joints move in the frames of the chosen clip if it is one of theirs.
    fn play_joints(&mut self) -> Result<(), Failure> {
        if let (Some(joints), Some(path)) = (&mut self.joints, &self.chosen) {
            joints.play(&input::named(path, &self.run.input)?);
        }
        Ok(())
    }

    /// The state of a mesh at rest. `named`: the clip, if it is none of the input's.
    fn of(run: RunArgs, input: Input, clip: Option<BoundClip>, named: Option<PathBuf>) -> Self {
        let names: Vec<String> = input.targets().into_iter().map(str::to_owned).collect();
        let mut clips = input.clips.clone();
        let chosen = named.or_else(|| clips.first().cloned());
        clips.extend(chosen.clone().filter(|chosen| !clips.contains(chosen)));
        Self {
            run,
            values: vec![0.0; names.len()],
            undone: Default::default(),
            moving: None,
            groups: groups(&names),
            names,
            input,
            clip,
            clips,
            chosen,
            joints: None,
            follows: false,
            playing: false,
            at: 0.0,
            speed: 1.0,
            heads: 1,
            detail: Detail::All,
            look: Look::Shaded,
            unshown: None,
            camera: [0.0; 2],
            home: [0.0; 2],
            zoom: 1.0,
            pan: [0.0; 2],
            whole: false,
            search: String::new(),
            only_active: false,
            twins: true,
            panel: true,
            width: WIDTH,
            help: false,
            notice: None,
        }
    }

    /// Applies a command. After an error nothing has changed.
    pub fn apply(&mut self, command: Command, out: &Output) -> Result<Effect, Failure> {
        use Command::{Budget, Format, Heads, Path, Pose};
        let anew = matches!(command, Budget(_) | Format(_) | Heads(_) | Path(_) | Pose(_));
        let (held, is_fixed) = (self.input.largest.get(), self.run.update.poses.iter().any(|pose| pose.has_integers()));
        match command {
            Command::Set(name, weight) => {
                self.set(&name, weight, self.twins)?;
                self.input.largest.set(self.input.largest.get().max(weight.abs()));
            }
            Command::Settled => self.moving = None,
            Command::Undo => self.take_back(0),
            Command::Redo => self.take_back(1),
            Command::Reset => {
                self.changes(None);
                self.values.fill(0.0);
            }
            Command::Random(seed) => {
                self.changes(None);
                self.values.fill(0.0);
                let mut rng = Rng::new(seed, 0);
                for _ in 0..RANDOM.min(self.names.len()) {
                    let (target, weight) = (rng.below(self.names.len()), 0.2 + 0.7 * rng.unit());
                    self.put(target, weight, self.twins);
                }
            }
            Command::Copy => return Ok(Effect::Copy(self.settings())),
            Command::Clip(path) => self.take_clip(&path)?,
            Command::Play => {
                if self.clip.is_none() {
                    return Err(Failure::Usage(format!(
                        "play: {} has no clip; drop a CSV file on the window, or name one with --weights",
                        self.input.origin
                    )));
                }
                (self.playing, self.follows) = (true, true);
            }
            Command::Pause => self.playing = false,
            Command::Scrub(frame) => {
                let Some(clip) = &self.clip else {
                    return Err(Failure::Usage("scrub: there is no clip; name one with --weights".into()));
                };
                self.at = frame.min((clip.frame_count() - 1) as f64);
                self.follows = true;
            }
            Command::Speed(speed) => self.speed = speed,
            Command::Path(path) => {
                // Options that the path does not support get their defaults.
                let takes = |format: &_| crate::args::values::format_on(path, *format).is_some();
                self.run.update.formats.retain(takes);
                self.run.update.poses.retain(|pose| path.poses().contains(pose));
                self.run.update.paths = vec![path];
                if path == UpdatePath::Cpu && self.joints.is_some() {
                    let text = "the path 'cpu' skins nothing: joints move on the paths of the device";
                    self.say(text.into(), false);
                }
            }
            Command::Format(format) => self.run.update.formats = vec![format],
            Command::Pose(pose) => {
                self.run.update.poses = vec![pose];
                self.run.update.accumulate.clear();
            }
            Command::Budget(budget) => self.run.update.error_budget = Some(budget),
            Command::Heads(heads) => self.heads = heads,
            Command::Detail(detail) => self.detail = detail,
            Command::Show(look) => return self.show(look),
            Command::Camera(camera) => self.camera = camera,
            Command::Pan(pan) => self.pan = pan,
            Command::Focus => return Ok(Effect::Focus(self.in_focus())),
            Command::Home => (self.camera, self.zoom, self.pan) = (self.home, 1.0, [0.0; 2]),
            Command::Zoom(zoom) => self.zoom = zoom,
            Command::Whole(on) => {
                self.whole = on;
                // Several stand further apart.
                return Ok(if self.heads > 1 { Effect::Heads } else { Effect::None });
            }
            Command::Search(text) => self.search = text,
            Command::Active(on) => self.only_active = on,
            Command::Twins(on) => self.twins = on,
            Command::Panel(on) => self.panel = on,
            Command::Width(width) => self.width = width,
            Command::Help(on) => self.help = on,
            Command::Dismiss => self.notice = None,
            Command::Drop(path) => return Ok(self.take(path, out)),
        }
        // Fixed-point poses that have to hold larger weights are others.
        let outgrown = is_fixed && self.input.largest.get() > held.max(1.0);
        Ok(if anew || outgrown { Effect::Heads } else { Effect::None })
    }

    /// Changes the view of the instances. Wrinkle masks are a stream of the mesh only while they are shown.
    pub fn show(&mut self, look: Look) -> Result<Effect, Failure> {
        if (self.look == Look::Wrinkles) != (look == Look::Wrinkles) {
            let shown = self.input.meshes();
            match self.unshown.take() {
                Some(meshes) => (self.input.kept, self.input.packed) = meshes,
                None => self.input.add_masks()?,
            }
            (self.unshown, self.look) = (Some(shown), look);
            return Ok(Effect::Heads);
        }
        let skinned = self.skeleton().is_some();
        self.look = look;
        Ok(if skinned == self.skeleton().is_some() { Effect::None } else { Effect::Heads })
    }

    /// The joints that move the mesh; `None` for looks of targets alone.
    pub fn skeleton(&self) -> Option<&Joints> {
        self.joints.as_ref().filter(|_| !matches!(self.look, Look::Heat | Look::Motion | Look::Wrinkles))
    }

    /// Joints of each instance: at rest, unless weights come from the clip.
    pub fn joints(&self) -> Vec<Vec<f32>> {
        let Some(joints) = self.skeleton() else { return vec![] };
        self.frames().map(|frame| joints.at(frame)).collect()
    }

    /// Vertices of still parts of each instance, where joints have them.
    pub fn still(&self, still: Option<&Still>) -> Vec<Vec<f32>> {
        let (Some(joints), Some(still)) = (self.skeleton(), still) else { return vec![] };
        self.frames().filter_map(|frame| joints.still_at(still, frame)).collect()
    }

    /// The frame of the clip that each instance shows; `None` if weights come from elsewhere.
    fn frames(&self) -> impl Iterator<Item = Option<f64>> {
        let clip = self.clip.as_ref().filter(|_| self.follows);
        (0..self.heads as usize).map(move |head| clip.map(|clip| self.frame(clip, head)))
    }

    /// Whether joints are to move the mesh, which stands as it is without them.
    pub fn is_unposed(&self) -> bool {
        self.joints.is_some()
    }

    /// The frame of the clip that an instance shows.
    fn frame(&self, clip: &BoundClip, head: usize) -> f64 {
        let count = clip.frame_count();
        (self.at + (head * count) as f64 / f64::from(self.heads)) % count as f64
    }

    pub fn say(&mut self, text: String, is_error: bool) {
        let left = if is_error { ERROR_STAYS } else { STAYS };
        self.notice = Some(Notice { text, is_error, left });
    }

    /// From now on, weights come from the sliders, and those there are can be had again. `slider`: the one that moves.
    fn changes(&mut self, slider: Option<usize>) {
        (self.playing, self.follows) = (false, false);
        if slider.is_none() || self.moving != slider {
            let [before, after] = &mut self.undone;
            before.push(self.values.clone());
            before.drain(..before.len().saturating_sub(UNDONE));
            after.clear();
        }
        self.moving = slider;
    }

    /// Takes a change of weights back; with 1, takes that back.
    fn take_back(&mut self, from: usize) {
        self.moving = None;
        if let Some(values) = self.undone[from].pop() {
            (self.playing, self.follows) = (false, false);
            let now = std::mem::replace(&mut self.values, values);
            self.undone[1 - from].push(now);
        }
    }

    /// Whether there is something to undo and to redo.
    pub fn undoable(&self) -> [bool; 2] {
        self.undone.each_ref().map(|list| !list.is_empty())
    }

    /// Vertices that the active targets move a good part of their way; at rest, those that targets of the face do.
    fn in_focus(&self) -> Vec<u32> {
        let mesh = &self.input.kept;
        let names = || mesh.targets.iter().map(|target| target.name.as_str());
        let settings: Vec<_> = self.names.iter().cloned().zip(self.values.iter().copied()).collect();
        let pose = self.input.pose(&settings).unwrap_or_default();
        let ways = [
            pose.iter().map(|weight| *weight != 0.0).collect(),
            names().map(of_face).collect(),
            vec![true; mesh.targets.len()],
        ];
        let wanted = ways.into_iter().find(|wanted: &Vec<bool>| wanted.contains(&true)).unwrap_or_default();
        let mut vertices = vec![];
        for (target, _) in mesh.targets.iter().zip(wanted).filter(|(_, wanted)| *wanted) {
            let furthest = target.positions.iter().map(|d| d.length_squared()).fold(0.0, f32::max);
            let moved = target.vertices.iter().zip(&target.positions);
            vertices.extend(moved.filter(|(_, d)| d.length_squared() > 0.1 * furthest).map(|(v, _)| *v));
        }
        vertices
    }

    fn set(&mut self, name: &str, weight: f32, twins: bool) -> Result<(), Failure> {
        let target = self.names.iter().position(|other| other == name);
        let unknown = || Failure::Usage(format!("set {name}: {}", self.input.unknown(name)));
        let target = target.ok_or_else(unknown)?;
        self.changes(Some(target));
        self.put(target, weight, twins);
        Ok(())
    }

    fn put(&mut self, target: usize, weight: f32, twins: bool) {
        self.values[target] = weight;
        if let Some(twin) = twin(&self.names, target).filter(|_| twins) {
            self.values[twin] = weight;
        }
    }

    fn take_clip(&mut self, path: &Path) -> Result<(), Failure> {
        self.clip = Some(input::clip(path, &self.run.input, &self.input, &[])?);
        (self.at, self.follows, self.chosen) = (0.0, true, Some(path.to_owned()));
        if !self.clips.iter().any(|clip| clip == path) {
            self.clips.push(path.to_owned());
        }
        self.play_joints()
    }

    /// Opens a dropped file or folder. If it cannot be read, the window says so, and nothing changes.
    fn take(&mut self, path: PathBuf, out: &Output) -> Effect {
        let name = path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into());
        let mut run = self.run.clone();
        run.input.input = Some(path.clone());
        run.input.head = Default::default();
        run.update.formats.clear();
        let is_clip = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("csv"));
        let taken = if is_clip {
            self.take_clip(&path).map(|()| Effect::None)
        } else {
            Self::read(run, None, out).and_then(|at_rest| {
                let Self { heads, detail, look, camera, home, whole, speed, twins, panel, width, .. } = *self;
                let mut other = Self { heads, detail, camera, home, whole, speed, twins, panel, width, ..at_rest };
                other.say(format!("{name} is here"), false);
                other.show(look)?;
                Ok(Effect::Mesh(Box::new(other)))
            })
        };
        match taken {
            Ok(effect) => {
                self.say(format!("{name} is here"), false);
                effect
            }
            Err(failure) => {
                self.say(failure.to_string(), true);
                Effect::None
            }
        }
    }

    /// Advances the clip by this time, in seconds, and the end of a notice.
    pub fn advance(&mut self, seconds: f64) {
        self.notice = self.notice.take().map(|notice| Notice { left: notice.left - seconds, ..notice });
        self.notice.take_if(|notice| notice.left <= 0.0);
        if let Some(clip) = self.clip.as_ref().filter(|_| self.playing) {
            self.at = (self.at + seconds * f64::from(clip.fps * self.speed)) % clip.frame_count() as f64;
        }
    }

    /// Weights of the targets, for each instance: each starts a little later in the clip.
    pub fn weights(&mut self) -> Result<Vec<Vec<f32>>, Failure> {
        let heads = self.heads as usize;
        let Some(clip) = self.clip.as_ref().filter(|_| self.follows) else {
            return Ok(vec![self.values.clone(); heads]);
        };
        let count = clip.frame_count();
        let frame = |head: usize| {
            let at = self.frame(clip, head);
            let (before, share) = (at as usize, at.fract() as f32);
            let (from, to) = (clip.frame(before)?, clip.frame((before + 1).min(count - 1))?);
            Ok(from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect::<Vec<f32>>())
        };
        let weights = (0..heads).map(frame).collect::<deltamorph::Result<Vec<_>>>()?;
        // Sliders follow the clip.
        self.values.clone_from(&weights[0]);
        Ok(weights)
    }

    /// The weights, as `--set` takes them.
    pub fn settings(&self) -> String {
        let set = self.names.iter().zip(&self.values).filter(|(_, value)| **value != 0.0);
        let set: Vec<String> = set.map(|(name, value)| format!("{name}={}", (value * 1e4).round() / 1e4)).collect();
        format!("--set {}", set.join(","))
    }
}
