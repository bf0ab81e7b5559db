//! The user's choices, and the effects of commands on them. Independent of window and device.

use super::command::Command;
use crate::args::RunArgs;
use crate::args::render::Look;
use crate::args::view::ViewArgs;
use crate::input::{self, Input, Meshes};
use crate::output::{Failure, Output};
use crate::render::joints::Joints;
use crate::render::painted::Still;
use deltamorph::{BoundClip, UpdatePath};
use std::path::{Path, PathBuf};

/// Seconds that a notice stays; errors are read twice.
const STAYS: f64 = 5.0;
const ERROR_STAYS: f64 = 20.0;

/// The mesh, weights, clip, update description, and view.
pub struct State {
    /// The mesh, and the options of its updates, as on the command line.
    pub run: RunArgs,
    pub input: Input,
    /// Names of the targets.
    pub names: Vec<String>,
    pub values: Vec<f32>,
    pub clip: Option<BoundClip>,
    /// Clips to choose from, and the chosen one.
    pub clips: Vec<PathBuf>,
    pub chosen: Option<PathBuf>,
    /// Joints that move the mesh, in the frame of the clip.
    joints: Option<Joints>,
    /// Whether weights come from the clip; until a slider is moved.
    pub follows: bool,
    pub playing: bool,
    /// Frame of the clip, from 0.
    pub at: f64,
    pub look: Look,
    /// While wrinkles are shown, the mesh without masks; afterwards, the mesh with them.
    unshown: Option<Meshes>,
    pub camera: [f32; 2],
    /// The camera at the beginning.
    home: [f32; 2],
    pub zoom: f32,
    pub pan: [f32; 2],
    pub panel: bool,
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effect {
    None,
    /// Recreate the instance: it is packed or updated differently.
    Heads,
}

impl State {
    pub fn new(args: &ViewArgs, out: &Output) -> Result<Self, Failure> {
        let run = args.run.clone();
        let named = args.weights.as_deref();
        let skins = run.update.paths.first() != Some(&UpdatePath::Cpu);
        let input = input::load_unposed(&run.input, skins, out)?;
        let joints = if skins { Joints::of(&run.input, &input)? } else { None };
        let first = named.or(input.clips.first().map(PathBuf::as_path));
        let clip = input::clips(first, &run.input, &input, &[])?.pop();
        input.pose(&args.set)?; // counts among the largest weights
        let names: Vec<String> = input.targets().into_iter().map(str::to_owned).collect();
        let mut clips = input.clips.clone();
        let chosen = named.map(Path::to_path_buf).or_else(|| clips.first().cloned());
        clips.extend(chosen.clone().filter(|chosen| !clips.contains(chosen)));
        clips.extend(joints.iter().flat_map(Joints::alone));
        let mut values = vec![0.0; names.len()];
        for (target, weight) in input.held(&args.set)? {
            values[target] = weight;
        }
        let mut this = Self {
            run,
            values,
            names,
            input,
            clip,
            clips,
            chosen,
            joints,
            follows: false,
            playing: false,
            at: 0.0,
            look: Look::Shaded,
            unshown: None,
            camera: args.camera,
            home: args.camera,
            zoom: 1.0,
            pan: [0.0; 2],
            panel: true,
            help: false,
            notice: None,
        };
        this.play_joints()?;
        Ok(this)
    }

    /// Joints move in the frames of the chosen clip if it is one of theirs.
    fn play_joints(&mut self) -> Result<(), Failure> {
        if let (Some(joints), Some(path)) = (&mut self.joints, &self.chosen) {
            joints.play(&input::named(path, &self.run.input)?)?;
        }
        Ok(())
    }

    /// Applies a command. After an error nothing has changed.
    pub fn apply(&mut self, command: Command) -> Result<Effect, Failure> {
        let anew = matches!(command, Command::Format(_) | Command::Path(_) | Command::Pose(_));
        let held = self.input.largest.get();
        let is_fixed = self.run.update.poses.iter().any(|pose| pose.has_integers());
        match command {
            Command::Set(name, weight) => {
                self.set(&name, weight)?;
                self.input.largest.set(held.max(weight.abs()));
            }
            Command::Reset => {
                self.playing = false;
                self.follows = false;
                self.values.fill(0.0);
            }
            Command::Clip(path) => self.take_clip(&path)?,
            Command::Play => {
                if self.clip.is_none() {
                    return Err(Failure::Usage(format!(
                        "play: {} has no clip; drop a CSV file on the window, or name one with --weights",
                        self.input.origin
                    )));
                }
                self.playing = true;
                self.follows = true;
            }
            Command::Pause => self.playing = false,
            Command::Scrub(frame) => {
                let Some(clip) = &self.clip else {
                    return Err(Failure::Usage("scrub: there is no clip; name one with --weights".into()));
                };
                self.at = frame.min((clip.frame_count() - 1) as f64);
                self.follows = true;
            }
            Command::Path(path) => {
                // Options that the path does not support get their defaults.
                let takes = |format: &_| path.formats().contains(format);
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
            Command::Show(look) => return self.show(look),
            Command::Camera(camera) => self.camera = camera,
            Command::Pan(pan) => self.pan = pan,
            Command::Zoom(zoom) => self.zoom = zoom,
            Command::Home => {
                self.camera = self.home;
                self.zoom = 1.0;
                self.pan = [0.0; 2];
            }
            Command::Panel(on) => self.panel = on,
            Command::Help(on) => self.help = on,
        }
        // Fixed-point poses that have to hold larger weights are others.
        let outgrown = is_fixed && self.input.largest.get() > held.max(1.0);
        Ok(if anew || outgrown { Effect::Heads } else { Effect::None })
    }

    /// Changes the view of the instance. Wrinkle masks are a stream of the mesh only while they are shown.
    pub fn show(&mut self, look: Look) -> Result<Effect, Failure> {
        if (self.look == Look::Wrinkles) != (look == Look::Wrinkles) {
            let shown = self.input.meshes();
            match self.unshown.take() {
                Some(meshes) => (self.input.kept, self.input.packed) = meshes,
                None => self.input.add_masks()?,
            }
            self.unshown = Some(shown);
            self.look = look;
            return Ok(Effect::Heads);
        }
        let skinned = self.skeleton().is_some();
        self.look = look;
        Ok(if skinned == self.skeleton().is_some() { Effect::None } else { Effect::Heads })
    }

    /// The joints that move the mesh; `None` for looks of targets alone.
    pub fn skeleton(&self) -> Option<&Joints> {
        self.joints.as_ref().filter(|_| !self.look.is_of_targets())
    }

    /// Joints: at rest, unless weights come from the clip.
    pub fn joints(&self) -> Option<Vec<f32>> {
        self.skeleton().map(|joints| joints.at(self.frame()))
    }

    /// Vertices of still parts where joints have them.
    pub fn still(&self, still: Option<&Still>) -> Option<Vec<f32>> {
        self.skeleton()?.still_at(still?, self.frame())
    }

    /// The frame of the clip that is shown; `None` if weights come from elsewhere.
    fn frame(&self) -> Option<f64> {
        self.clip.as_ref().filter(|_| self.follows).map(|_| self.at)
    }

    /// Whether joints are to move the mesh, which stands as it is without them.
    pub fn is_unposed(&self) -> bool {
        self.joints.is_some()
    }

    pub fn say(&mut self, text: String, is_error: bool) {
        let left = if is_error { ERROR_STAYS } else { STAYS };
        self.notice = Some(Notice { text, is_error, left });
    }

    /// Sets a weight; from now on, weights come from the sliders.
    fn set(&mut self, name: &str, weight: f32) -> Result<(), Failure> {
        let target = self.input.kept.target_index(name);
        let unknown = || Failure::Usage(format!("set {name}: {}", self.input.unknown(name)));
        let target = target.ok_or_else(unknown)?;
        self.playing = false;
        self.follows = false;
        self.values[target] = weight;
        Ok(())
    }

    fn take_clip(&mut self, path: &Path) -> Result<(), Failure> {
        self.clip = Some(input::clip(path, &self.run.input, &self.input, &[])?);
        self.at = 0.0;
        self.follows = true;
        self.chosen = Some(path.to_owned());
        if !self.clips.iter().any(|clip| clip == path) {
            self.clips.push(path.to_owned());
        }
        self.play_joints()
    }

    /// Advances the clip by this time, in seconds, and the end of a notice.
    pub fn advance(&mut self, seconds: f64) {
        self.notice = self.notice.take().map(|notice| Notice { left: notice.left - seconds, ..notice });
        self.notice.take_if(|notice| notice.left <= 0.0);
        if let Some(clip) = self.clip.as_ref().filter(|_| self.playing) {
            self.at = (self.at + seconds * f64::from(clip.fps)) % clip.frame_count() as f64;
        }
    }

    /// Weights of the targets. Sliders follow the clip.
    pub fn weights(&mut self) -> Result<Vec<f32>, Failure> {
        if let (Some(clip), Some(at)) = (&self.clip, self.frame()) {
            let before = at as usize;
            let share = at.fract() as f32;
            let from = clip.frame(before)?;
            let to = clip.frame((before + 1).min(clip.frame_count() - 1))?;
            self.values = from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect();
        }
        Ok(self.values.clone())
    }
}
