//! `soak`: any number of frames, random and captured, and how far poses drift from the reference.

use crate::args::SoakArgs;
use crate::input;
use crate::output::{Failure, Output, Result, With};
use crate::runner::{Runner, Stage, fnv};
use crate::table::{sig3, thousands};
use crate::verify::{Checks, REMEDY};
use deltamorph::{BoundClip, UpdateDesc};
use deltamorph_head::Rng;
use deltamorph_headless::{DeviceChoice, Draws};
use serde_json::json;
use std::time::Instant;

pub fn run(args: &SoakArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    let run = &args.run;
    input::check("soak", run, &[], out)?;
    let input = input::load(&run.input, false, out)?;
    let clips = input.clips(run.weights.as_deref(), &[])?;
    let stage = Stage::new(run, &input, device, out)?;
    let origin = input.origin.clone();
    // Only the packed mesh is needed from here on.
    drop(input);
    let start = Instant::now();
    // Positions only: random weights fold some normals to nothing, and angles are then meaningless.
    let mut checks = Checks::new(&stage, None);
    let sums = soak(args, &clips, &mut checks, out)?;
    let seconds = start.elapsed().as_secs_f64();
    let bit_exact = sums.as_ref().map(|sums| sums.right);
    let hash = sums.map(|sums| format!("{:016x}", sums.hash));
    let exact = match (bit_exact, &hash) {
        (Some(true), Some(hash)) => format!("\nsums and poses equal full evaluations bit for bit; hash {hash}"),
        (Some(_), _) => "\nsums or poses DIFFER from full evaluations".to_owned(),
        (None, _) => String::new(),
    };
    let (frames, setup, found) = (thousands(args.frames), stage.describe(), checks.text());
    out.say(format_args!("{frames} frames, {setup}, {} s\n{found}{exact}", sig3(seconds)));
    let clips: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
    // `bit_exact` and the hash are `None` for float sums. The hash is the same on every driver; the seconds include
    // updates and comparisons.
    let more = json!({
        "schema": 1, "frames": args.frames, "bit_exact": bit_exact, "sums_hash": hash, "device": stage.device(),
        "input": origin, "clips": clips, "seed": run.input.seed, "seconds": seconds,
    });
    out.json(&With { fields: checks.record(), more })?;
    if bit_exact == Some(false) {
        let path = stage.desc.path.name();
        return Err(Failure::Failed(format!(
            "integer sums or poses of the path '{path}' differ from a full evaluation; {REMEDY}"
        )));
    }
    checks.verdict(out)
}

/// Integer sums, if there are any: of fixed-point poses, or of `scatter`.
struct Sums {
    /// Whether all compared sums and poses equalled those of full evaluations.
    right: bool,
    /// Hash of the last compared sums, of positions and normals.
    hash: u64,
}

fn soak(args: &SoakArgs, clips: &[BoundClip], checks: &mut Checks<'_>, out: &Output) -> Result<Option<Sums>> {
    let stage = checks.stage;
    let grid = checks.promise.grid;
    let most = grid.map_or(f32::INFINITY, |grid| grid.weight_max);
    let mut script = Script::new(stage.mesh.layout().targets.len(), clips, most, args.run.input.seed);
    let mut runner = stage.runner(stage.desc)?;
    let mut sums = grid.map(|_| Sums { right: true, hash: 0 });
    let (every, bar) = (args.every(), out.bar(args.frames as u64));
    for frame in 0..args.frames {
        let (weights, is_reset) = script.next();
        if is_reset {
            runner.reset_history()?;
        }
        let due = (frame + 1) % every == 0 || frame + 1 == args.frames;
        checks.step(frame, &mut runner, weights, due)?;
        if let Some(sums) = sums.as_mut().filter(|_| due) {
            sums.against_fresh(&mut runner, stage, weights)?;
        }
        bar.inc(1);
    }
    Ok(sums)
}

impl Sums {
    /// Compares integers, and poses of all groups, with those of an instance that never had other weights.
    fn against_fresh(&mut self, runner: &mut Runner<'_>, stage: &Stage, weights: &[f32]) -> Result<()> {
        if stage.desc.error_budget > 0.0 {
            // An update without changes applies deferred changes.
            runner.step(&[weights], Draws::default())?;
        }
        let mut fresh = stage.runner(UpdateDesc { error_budget: 0.0, ..stage.desc })?;
        fresh.step(&[weights], Draws::default())?;
        let format = stage.desc.pose;
        let bits = |pose: &[f32]| pose.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let sums = runner.integers(format)?;
        self.right &= sums.is_some() && sums == fresh.integers(format)?;
        for group in 0..stage.mesh.groups().len() {
            self.right &= bits(&runner.pose(0, group)?) == bits(&fresh.pose(0, group)?);
        }
        self.hash = sums.as_deref().map_or(0, fnv);
        Ok(())
    }
}

/// Fewest and most frames of a stretch.
const STRETCH: [usize; 2] = [32, 256];
/// Numbers of frames among a hundred random ones.
const NEUTRAL: usize = 4;
const CUTS: usize = 3;
const STILL: usize = 10;
/// Range of random weights, with exaggeration and tracker overshoot.
const WEIGHTS: [f32; 2] = [-0.5, 1.5];

/// Endless frames, determined by a seed.
struct Script<'a> {
    rng: Rng,
    clips: &'a [BoundClip],
    /// Range of random weights.
    range: [f32; 2],
    now: Vec<f32>,
    /// Frames left of this stretch.
    left: usize,
    /// Clip and next frame; `None` in a random stretch.
    place: Option<(usize, usize)>,
}

impl<'a> Script<'a> {
    /// No random weight exceeds `most` in absolute value.
    fn new(targets: usize, clips: &'a [BoundClip], most: f32, seed: u64) -> Self {
        let (rng, range) = (Rng::new(seed, 0x736f_616b), WEIGHTS.map(|weight| weight.clamp(-most, most)));
        // An empty random stretch: captured frames, if any, come first.
        Self { rng, clips, range, now: vec![0.0; targets], left: 0, place: None }
    }

    /// The weights of the next frame, and whether it has no predecessor.
    fn next(&mut self) -> (&[f32], bool) {
        if self.left == 0 {
            self.left = STRETCH[0] + self.rng.below(STRETCH[1] - STRETCH[0]);
            self.place = match self.place {
                None if !self.clips.is_empty() => {
                    let clip = self.rng.below(self.clips.len());
                    Some((clip, self.rng.below(self.clips[clip].frame_count())))
                }
                _ => None,
            };
        }
        self.left -= 1;
        let is_reset = match &mut self.place {
            Some((clip, frame)) => {
                let clip = &self.clips[*clip];
                if let Ok(weights) = clip.frame(*frame) {
                    self.now = weights;
                }
                // Clips repeat: the seam is a jump, as between takes.
                *frame = (*frame + 1) % clip.frame_count();
                false
            }
            None => self.random(),
        };
        (&self.now, is_reset)
    }

    fn random(&mut self) -> bool {
        let targets = self.now.len();
        let dice = self.rng.below(100);
        if dice < NEUTRAL {
            self.now.fill(0.0);
        } else if dice < NEUTRAL + CUTS {
            (0..targets).for_each(|t| self.draw(t));
            return true;
        } else if dice >= NEUTRAL + CUTS + STILL && targets > 0 {
            // The smaller of two random numbers: often a few, seldom all.
            let count = 1 + self.rng.below(targets).min(self.rng.below(targets));
            for _ in 0..count {
                let target = self.rng.below(targets);
                self.draw(target);
            }
        }
        false
    }

    /// Draws a new weight; one in three is 0.
    fn draw(&mut self, target: usize) {
        let rest = self.rng.below(3) == 0;
        self.now[target] =
            if rest { 0.0 } else { self.rng.range(self.range[0], self.range[1]).clamp(self.range[0], self.range[1]) };
    }
}
