//! `soak`: any number of frames, random and captured, and how far poses drift from the reference.

mod script;

use crate::args::play::SoakArgs;
use crate::clips;
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::Runner;
use crate::stage::{Setup, Stage};
use crate::table::{sig3, thousands};
use crate::verify::{Found, Promise};
use deltamorph::headless::DeviceChoice;
use deltamorph::reference::{compare, evaluate};
use deltamorph::{Accumulate, PoseError, UpdateDesc};
use script::Script;
use serde::Serialize;
use std::time::Instant;

/// The JSON of `soak`. Fields may be added, never renamed.
#[derive(Debug, Serialize)]
struct Soaked {
    schema: u32,
    frames: usize,
    /// Every sum and pose checked was that of a full evaluation, bit for bit; `None` for float sums.
    bit_exact: Option<bool>,
    /// Largest position error against the float64 reference, in input units, and as a fraction of the diagonal.
    max_error: f64,
    max_error_rel: f64,
    /// The largest bound that the path kept, in input units; 0 where it keeps none.
    bound: f64,
    /// FNV-1a of the final integer sums: the same on every driver; `None` for float sums.
    sums_hash: Option<String>,
    device: String,
    input: String,
    clips: Vec<String>,
    #[serde(flatten)]
    setup: Setup,
    seed: u64,
    checks: usize,
    /// Updates and comparisons together.
    seconds: f64,
}

pub fn run(args: &SoakArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    out.check(&input::files_of(&args.input, args.weights.as_slice()), &[], None)?;
    let input = input::load(&args.input, false, out)?;
    let clips = clips::all(args.weights.as_deref(), &args.input, &input)?;
    let stage = Stage::best("soak", &args.update, args.batch_size, &input, device, out)?;
    let (origin, targets) = (input.origin.clone(), input.kept.targets.len());
    // From here on the packed mesh is enough.
    drop(input);
    let start = Instant::now();
    let mut script = Script::new(targets, &clips, args.input.seed);
    let checks = soak(args, &stage, &mut script, out)?;
    let result = Soaked {
        schema: 1,
        frames: args.frames,
        bit_exact: checks.bit_exact,
        max_error: checks.found.error.position,
        max_error_rel: checks.found.error.position / checks.promise.scale(),
        bound: checks.found.bound,
        sums_hash: checks.hash.map(|hash| format!("{hash:016x}")),
        device: stage.device(),
        input: origin,
        clips: clips.iter().map(|c| c.name.clone()).collect(),
        setup: stage.setup(),
        seed: args.input.seed,
        checks: checks.count,
        seconds: start.elapsed().as_secs_f64(),
    };
    out.say(text(&result, &stage, &checks));
    out.json(&result)?;
    verdict(&stage, &checks)
}

struct Checks {
    promise: Promise,
    count: usize,
    found: Found,
    /// Position error beyond what is allowed at that frame.
    wrong: Option<(usize, f64)>,
    bit_exact: Option<bool>,
    hash: Option<u64>,
}

fn soak(args: &SoakArgs, stage: &Stage, script: &mut Script<'_>, out: &Output) -> Result<Checks, Failure> {
    let mut runner = stage.runner()?;
    let promise = Promise::new(&stage.desc, stage.mesh.layout());
    let exact = stage.desc.accumulate == Accumulate::Exact;
    let mut checks = Checks {
        promise,
        count: 0,
        found: Found::default(),
        wrong: None,
        bit_exact: exact.then_some(true),
        hash: None,
    };
    let (every, bar) = (args.every(), out.bar(args.frames as u64));
    let step = (args.frames / 1000).max(1);
    for frame in 0..args.frames {
        let (weights, cut) = script.next();
        if cut {
            runner.cut(0)?;
        }
        let weights = [weights.to_vec()];
        let bound = f64::from(runner.step(&weights)?.stats.bound);
        checks.found.bound = checks.found.bound.max(bound);
        if (frame + 1) % every == 0 || frame + 1 == args.frames {
            checks.measure(frame, &mut runner, stage, &weights[0], bound)?;
            if exact {
                checks.against_fresh(&mut runner, stage, &weights)?;
            }
        }
        if frame % step == 0 {
            bar.set_position(frame as u64);
        }
    }
    bar.finish_and_clear();
    Ok(checks)
}

impl Checks {
    /// Compare the pose with the reference.
    fn measure(
        &mut self,
        frame: usize,
        runner: &mut Runner<'_>,
        stage: &Stage,
        weights: &[f32],
        bound: f64,
    ) -> Result<(), Failure> {
        let PoseError { position, .. } =
            compare(&runner.pose(0)?, &evaluate(&stage.mesh, &self.promise.applied(weights)));
        // Random weights fold normals to nothing here and there, where an angle says little: positions only.
        let found = Found { error: PoseError { position, ..PoseError::default() }, bound, ..Found::default() };
        if !self.promise.kept(&found) && self.wrong.is_none() {
            self.wrong = Some((frame, self.promise.allowed(&found)));
        }
        self.found = self.found.max(found);
        self.count += 1;
        Ok(())
    }

    /// Hold sums and pose to those of a head that never had other weights.
    fn against_fresh(&mut self, runner: &mut Runner<'_>, stage: &Stage, weights: &[Vec<f32>]) -> Result<(), Failure> {
        if stage.desc.error_budget > 0.0 {
            // What waits is settled when the face is still.
            runner.step(weights)?;
        }
        let mut fresh = stage.runner_of(UpdateDesc { error_budget: 0.0, ..stage.desc })?;
        fresh.step(weights)?;
        let (sums, pose) = (runner.sums(0)?, runner.pose(0)?);
        let bits = |pose: &[f32]| pose.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let same = sums.is_some() && sums == fresh.sums(0)? && bits(&pose) == bits(&fresh.pose(0)?);
        self.bit_exact = Some(self.bit_exact == Some(true) && same);
        self.hash = sums.as_deref().map(fnv);
        Ok(())
    }
}

/// FNV-1a over the bytes of `sums`, least significant first.
fn fnv(sums: &[i32]) -> u64 {
    let bytes = sums.iter().flat_map(|s| s.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn verdict(stage: &Stage, checks: &Checks) -> Result<(), Failure> {
    let path = stage.desc.path.name();
    let report = "report this with what `deltamorph devices` prints";
    let relative = |length: f64| length / checks.promise.scale();
    if checks.bit_exact == Some(false) {
        return Err(Failure::Failed(format!(
            "the integer sums or poses through '{path}' are not those of a full evaluation; {report}"
        )));
    }
    if let Some((frame, allowed)) = checks.wrong {
        return Err(Failure::Failed(format!(
            "frame {frame} through '{path}' is off by more than the {:.1e} of the diagonal allowed (the largest error \
             is {:.3e}); {report}",
            relative(allowed),
            relative(checks.found.error.position)
        )));
    }
    match stage.desc.accumulate {
        Accumulate::Float { tolerance } if relative(checks.found.bound) > f64::from(tolerance) * (1.0 + 1e-6) => {
            Err(Failure::Failed(format!(
                "the bound kept through '{path}' came to {:.3e} of the diagonal, {tolerance:.1e} are tolerated; \
                 {report}",
                relative(checks.found.bound)
            )))
        }
        _ => Ok(()),
    }
}

fn text(result: &Soaked, stage: &Stage, checks: &Checks) -> String {
    let bound = match result.bound {
        0.0 => String::new(),
        bound => format!(", at most {} by the bound kept", sig3(bound / checks.promise.scale())),
    };
    let exact = match (result.bit_exact, &result.sums_hash) {
        (Some(true), Some(hash)) => format!("\nsums and poses equal full evaluations bit for bit; hash {hash}"),
        (Some(_), _) => "\nsums or poses are NOT those of full evaluations".to_owned(),
        (None, _) => String::new(),
    };
    format!(
        "{} frames, {}, {} s\nlargest error in {} comparisons, of the diagonal: {}{bound}{exact}",
        thousands(result.frames),
        stage.describe(),
        sig3(result.seconds),
        thousands(result.checks),
        sig3(result.max_error_rel),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_fnv_1a() {
        assert_eq!(fnv(&[]), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv(&[i32::from_le_bytes(*b"foob")]), 0xdd12_0e79_0c25_12af);
    }
}
