//! The user's choices, and the effects of commands on them. Independent of window and device.

use super::command::Command;
use crate::args::view::ViewArgs;
use crate::input::{self, Input};
use crate::output::{Failure, Output, Result};
use deltamorph::BoundClip;
use deltamorph_render::Show;
use std::path::{Path, PathBuf};

/// Seconds that a notice stays.
const STAYS: f64 = 10.0;

/// The mesh, weights, clip, and view.
pub struct State {
    pub input: Input,
    /// Weights of the targets.
    pub values: Vec<f32>,
    pub clip: Option<BoundClip>,
    /// Clips to choose from, and the chosen one.
    pub clips: Vec<PathBuf>,
    pub chosen: Option<PathBuf>,
    /// Whether weights come from the clip; until a slider is moved.
    pub follows: bool,
    pub playing: bool,
    /// Frame of the clip, from 0.
    pub at: f64,
    pub look: Show,
    pub camera: [f32; 2],
    /// The camera at the beginning.
    home: [f32; 2],
    pub zoom: f32,
    pub pan: [f32; 2],
    pub panel: bool,
    /// A text in the window, and the seconds that it stays.
    pub notice: Option<(String, f64)>,
}

impl State {
    pub fn new(args: &ViewArgs, out: &Output) -> Result<Self> {
        let named = args.run.weights.as_deref();
        let input = input::load(&args.run.input, false, out)?;
        let first = named.or(input.clips.first().map(PathBuf::as_path));
        let clip = input.clips(first, &[])?.pop();
        input.pose(&args.set)?; // counts among the largest weights
        let mut clips = input.clips.clone();
        let chosen = named.map(Path::to_path_buf).or_else(|| clips.first().cloned());
        clips.extend(chosen.clone().filter(|chosen| !clips.contains(chosen)));
        let mut values = vec![0.0; input.kept.targets.len()];
        for (target, weight) in input.held(&args.set)? {
            values[target] = weight;
        }
        Ok(Self {
            values,
            input,
            clip,
            clips,
            chosen,
            follows: false,
            playing: false,
            at: 0.0,
            look: Show::Shaded,
            camera: args.camera,
            home: args.camera,
            zoom: 1.0,
            pan: [0.0; 2],
            panel: true,
            notice: None,
        })
    }

    /// Applies a command. After an error nothing has changed.
    pub fn apply(&mut self, command: Command) -> Result<()> {
        match command {
            Command::Set(name, weight) => self.set(&name, weight)?,
            Command::Reset => {
                self.playing = false;
                self.follows = false;
                self.values.fill(0.0);
            }
            Command::Clip(path) => self.take_clip(&path)?,
            Command::Play => {
                self.last_frame()?;
                self.playing = true;
                self.follows = true;
            }
            Command::Pause => self.playing = false,
            Command::Scrub(frame) => {
                self.at = frame.min(self.last_frame()?);
                self.follows = true;
            }
            Command::Show(look) => self.look = look,
            Command::Camera(camera) => self.camera = camera,
            Command::Pan(pan) => self.pan = pan,
            Command::Zoom(zoom) => self.zoom = zoom,
            Command::Home => {
                self.camera = self.home;
                self.zoom = 1.0;
                self.pan = [0.0; 2];
            }
            Command::Panel(on) => self.panel = on,
        }
        Ok(())
    }

    fn last_frame(&self) -> Result<f64> {
        let clip = self.clip.as_ref().ok_or_else(|| {
            let text = "there is no clip; drop a CSV file on the window, or name one with --weights";
            Failure::Usage(text.into())
        })?;
        Ok((clip.frame_count() - 1) as f64)
    }

    pub fn say(&mut self, text: String) {
        self.notice = Some((text, STAYS));
    }

    /// Sets a weight; from now on, weights come from the sliders.
    fn set(&mut self, name: &str, weight: f32) -> Result<()> {
        let target = self.input.kept.target_index(name);
        let unknown = || Failure::Usage(format!("set {name}: {}", self.input.unknown(name)));
        let target = target.ok_or_else(unknown)?;
        self.playing = false;
        self.follows = false;
        self.values[target] = weight;
        Ok(())
    }

    fn take_clip(&mut self, path: &Path) -> Result<()> {
        self.clip = Some(self.input.clip(path, &[])?);
        self.at = 0.0;
        self.follows = true;
        self.chosen = Some(path.to_owned());
        if !self.clips.iter().any(|clip| clip == path) {
            self.clips.push(path.to_owned());
        }
        Ok(())
    }

    /// Advances the clip by this time, in seconds, and the end of a notice.
    pub fn advance(&mut self, seconds: f64) {
        self.notice = self.notice.take().map(|(text, left)| (text, left - seconds)).filter(|(_, left)| *left > 0.0);
        if let Some(clip) = self.clip.as_ref().filter(|_| self.playing) {
            self.at = (self.at + seconds * f64::from(clip.fps)) % clip.frame_count() as f64;
        }
    }

    /// Weights of the targets. Sliders follow the clip.
    pub fn weights(&mut self) -> Result<Vec<f32>> {
        if let Some(clip) = self.clip.as_ref().filter(|_| self.follows) {
            let before = self.at as usize;
            let share = self.at.fract() as f32;
            let from = clip.frame(before)?;
            let to = clip.frame((before + 1).min(clip.frame_count() - 1))?;
            self.values = from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect();
        }
        Ok(self.values.clone())
    }
}
