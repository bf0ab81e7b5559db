//! `soak`: any number of frames, random and captured, and how far poses drift from the reference.

mod script;

use crate::args::run::{Single, SoakArgs};
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::Runner;
use crate::stage::{Setup, Stage};
use crate::table::{sig3, thousands};
use crate::verify::{Checked, Checks, REMEDY};
use deltamorph::Accumulate;
use deltamorph::headless::DeviceChoice;
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
    #[serde(flatten)]
    checked: Checked,
    /// FNV-1a of the final integer sums: the same on every driver; `None` for float sums.
    sums_hash: Option<String>,
    device: String,
    input: String,
    clips: Vec<String>,
    #[serde(flatten)]
    setup: Setup,
    seed: u64,
    /// Updates and comparisons together.
    seconds: f64,
}

pub fn run(args: &SoakArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    let SoakArgs { run, weights, .. } = args;
    let single = Single::new("soak", &run.update).map_err(Failure::Usage)?;
    out.check(&input::files_of(&run.input, weights.as_slice()), &[], None)?;
    let input = input::load(&run.input, false, out)?;
    let clips = input::clips(weights.as_deref(), &run.input, &input)?;
    let stage = Stage::new(single, run, &input, device, out)?;
    let (origin, targets) = (input.origin.clone(), input.kept.targets.len());
    // From here on the packed mesh is enough.
    drop(input);
    let start = Instant::now();
    let mut script = Script::new(targets, &clips, run.input.seed);
    // Random weights fold normals to nothing here and there, where an angle says little: positions only.
    let mut checks = Checks::new(&stage, None, false);
    let sums = soak(args, &stage, &mut script, &mut checks, out)?;
    let result = Soaked {
        schema: 1,
        frames: args.frames,
        bit_exact: sums.as_ref().map(|sums| sums.right),
        checked: checks.record(),
        sums_hash: sums.map(|sums| format!("{:016x}", sums.hash)),
        device: stage.device(),
        input: origin,
        clips: clips.iter().map(|c| c.name.clone()).collect(),
        setup: stage.setup(),
        seed: run.input.seed,
        seconds: start.elapsed().as_secs_f64(),
    };
    let exact = match (result.bit_exact, &result.sums_hash) {
        (Some(true), Some(hash)) => format!("\nsums and poses equal full evaluations bit for bit; hash {hash}"),
        (Some(_), _) => "\nsums or poses are NOT those of full evaluations".to_owned(),
        (None, _) => String::new(),
    };
    let (frames, seconds) = (thousands(result.frames), sig3(result.seconds));
    out.say(format_args!("{frames} frames, {}, {seconds} s\n{}{exact}", stage.describe(), checks.text()));
    out.json(&result)?;
    verdict(&stage, &checks, result.bit_exact)
}

/// The integer sums, where there are any.
struct Sums {
    /// They and the poses were those of full evaluations whenever they were compared.
    right: bool,
    /// Of the last ones compared.
    hash: u64,
}

fn soak(
    args: &SoakArgs,
    stage: &Stage,
    script: &mut Script<'_>,
    checks: &mut Checks<'_>,
    out: &Output,
) -> Result<Option<Sums>, Failure> {
    let mut runner = stage.runner(stage.desc)?;
    let exact = stage.desc.accumulate == Accumulate::Exact;
    let mut sums = exact.then_some(Sums { right: true, hash: 0 });
    let (every, bar) = (args.every(), out.bar(args.frames as u64));
    let step = (args.frames / 1000).max(1);
    for frame in 0..args.frames {
        let (weights, cut) = script.next();
        if cut {
            runner.cut()?;
        }
        let due = (frame + 1) % every == 0 || frame + 1 == args.frames;
        checks.step(frame, &mut runner, weights, due)?;
        if let Some(sums) = sums.as_mut().filter(|_| due) {
            sums.against_fresh(&mut runner, stage, weights)?;
        }
        if frame % step == 0 {
            bar.set_position(frame as u64);
        }
    }
    Ok(sums)
}

impl Sums {
    /// Hold sums and pose to those of a head that never had other weights.
    fn against_fresh(&mut self, runner: &mut Runner<'_>, stage: &Stage, weights: &[f32]) -> Result<(), Failure> {
        if stage.desc.error_budget > 0.0 {
            // What waits is settled when the face is still.
            runner.step(&[weights], 0)?;
        }
        let mut fresh = stage.runner(stage.desc.error_budget(0.0))?;
        fresh.step(&[weights], 0)?;
        let (sums, pose) = (runner.sums()?, runner.pose(0)?);
        let bits = |pose: &[f32]| pose.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        self.right &= sums.is_some() && sums == fresh.sums()? && bits(&pose) == bits(&fresh.pose(0)?);
        self.hash = sums.as_deref().map_or(0, fnv);
        Ok(())
    }
}

/// FNV-1a over the bytes of `sums`, least significant first.
fn fnv(sums: &[i32]) -> u64 {
    let bytes = sums.iter().flat_map(|s| s.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn verdict(stage: &Stage, checks: &Checks<'_>, bit_exact: Option<bool>) -> Result<(), Failure> {
    let path = stage.desc.path.name();
    if bit_exact == Some(false) {
        return Err(Failure::Failed(format!(
            "the integer sums or poses through '{path}' are not those of a full evaluation; {REMEDY}"
        )));
    }
    checks.verdict(path)?;
    let bound = checks.found.bound / checks.promise.scale;
    match stage.desc.accumulate {
        Accumulate::Float { tolerance } if bound > f64::from(tolerance) * (1.0 + 1e-6) => {
            Err(Failure::Failed(format!(
                "the bound kept through '{path}' came to {bound:.3e} of the diagonal, {tolerance:.1e} are tolerated; {REMEDY}"
            )))
        }
        Accumulate::Float { .. } | Accumulate::Exact => Ok(()),
    }
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
