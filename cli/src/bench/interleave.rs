//! Several configurations measured in turn, so that changes of the machine's speed affect all of them.

use super::machine::Machine;
use super::record::{RunRecord, Skipped};
use super::subject::Subject;
use super::trial::{Candidate, Trial};
use super::workload::Workload;
use crate::output::Failure;
use crate::progress::Progress;
use crate::runner::{Runner, reaching};
use deltamorph::{Error, ErrorKind, PackedMesh, UpdatePath};
use std::sync::Arc;
use std::time::Duration;

/// The time and the number of rounds of a configuration.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Frames of each configuration.
    pub frames: usize,
    /// Rounds that they are divided into.
    pub rounds: usize,
    /// Time for each configuration; at least three frames are timed, regardless of the limit.
    pub limit: Duration,
    pub common: Common,
}

/// Matching of frames among interleaved configurations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Common {
    /// Each runs one frame after the other, as many as it can.
    Nothing,
    /// The same frames, spread over the workload, for workloads whose frames differ.
    Frames,
    /// The same time per frame: faster configurations wait for the slowest. A frame after a pause takes longer: the
    /// machine cools down, caches fill with other data, cores go to sleep.
    FrameRate,
}

/// Fewest frames that are timed.
const LEAST_FRAMES: usize = 3;

impl Schedule {
    fn share(&self) -> Duration {
        self.limit / self.rounds as u32
    }

    /// Frames per round if every frame has to take as long as the slowest configuration's, `slowest`.
    fn frames_together(&self, slowest: Duration) -> usize {
        let most = self.frames.div_ceil(self.rounds);
        let fit = (self.share().as_secs_f64() / slowest.as_secs_f64()) as usize;
        fit.clamp(1, most)
    }
}

/// A trial, or why it was refused.
type Running<'a> = Result<Trial<'a>, String>;

/// Times `running`, interleaved, a step of `bar` for each round. Wrong or refused trials drop out.
fn run(running: &mut [Running<'_>], schedule: &Schedule, bar: &Progress) -> deltamorph::Result<()> {
    let mut slowest = Duration::ZERO;
    each(running, |trial| {
        slowest = slowest.max(trial.warm_up(Some(schedule.share()))?);
        Ok(())
    })?;
    let least = if schedule.common == Common::FrameRate { slowest } else { Duration::ZERO };
    for round in 0..schedule.rounds {
        each(running, |trial| {
            let (timed, spent) = trial.timed();
            if schedule.common == Common::Frames {
                trial.jump(round, schedule.rounds)?;
            }
            if schedule.common != Common::Nothing {
                trial.round(schedule.frames_together(slowest), None, least)
            } else if timed < LEAST_FRAMES || spent < schedule.limit {
                trial.round(schedule.frames.div_ceil(schedule.rounds), Some(schedule.share()), least)
            } else {
                Ok(())
            }
        })?;
        bar.inc(1);
    }
    Ok(())
}

/// Runs `act` on each trial that has not dropped out.
fn each(
    running: &mut [Running<'_>],
    mut act: impl FnMut(&mut Trial<'_>) -> deltamorph::Result<()>,
) -> deltamorph::Result<()> {
    for place in running {
        if let Ok(trial) = place
            && trial.is_right()
            && let Err(reason) = refusal(act(trial))?
        {
            *place = Err(reason);
        }
    }
    Ok(())
}

/// Distinguishes refusals of a path (unsupported weights, for example) from failures of the device.
fn refusal<T>(result: deltamorph::Result<T>) -> deltamorph::Result<Result<T, String>> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(e @ (Error::Invalid { .. } | Error::Unsupported { .. })) => Ok(Err(e.to_string())),
        Err(e) => Err(e),
    }
}

pub type Outcome = Result<RunRecord, Skipped>;

/// Measures `candidates` interleaved, and those that lack memory after the others; returns them in their order. `bar`
/// has a step for each of them, which is verified first, and for each round.
pub fn interleave(
    machine: &Machine<'_>,
    subject: &mut Subject,
    candidates: &[Candidate<'_>],
    schedule: &Schedule,
    bar: &Progress,
) -> Result<Vec<Outcome>, Failure> {
    let mut running: Vec<Running<'_>> = vec![];
    for candidate in candidates {
        let trial = begin(machine, subject, candidate, &running)?;
        running.push(trial);
        bar.inc(1);
    }
    let begun: Vec<bool> = running.iter().map(Result::is_ok).collect();
    run(&mut running, schedule, bar)?;
    let mut outcomes: Vec<Outcome> = vec![];
    for (trial, candidate) in running.into_iter().zip(candidates) {
        outcomes.push(match trial {
            Ok(trial) => Ok(trial.finish(subject)?),
            Err(reason) => Err(Skipped { what: candidate.what.clone(), reason }),
        });
    }
    // The others have freed their memory: there may be room for the rest.
    if begun.contains(&true) {
        for (place, candidate) in candidates.iter().enumerate().filter(|(place, _)| !begun[*place]) {
            let outcome = interleave(machine, subject, std::slice::from_ref(candidate), schedule, bar)?.remove(0);
            outcomes[place] = outcome.map(|record| RunRecord { alone: true, ..record });
        }
    }
    Ok(outcomes)
}

/// A verified trial, or the reason why there is none. Those that run already have meshes to share.
fn begin<'a>(
    machine: &'a Machine<'_>,
    subject: &mut Subject,
    candidate: &'a Candidate<'_>,
    running: &[Running<'a>],
) -> Result<Running<'a>, Failure> {
    let Candidate { config, setting, .. } = candidate;
    let meshes = subject.meshes(machine, config.format)?;
    // The path `cpu` needs a device only to draw.
    let gpu = machine.gpu.as_ref().filter(|_| setting.passes > 0 || config.desc.path != UpdatePath::Cpu);
    let reach = |(mesh, workload): (&Arc<PackedMesh>, &Workload)| {
        (mesh.clone(), reaching(config.desc, workload.largest(), mesh.layout()))
    };
    let parts: Vec<_> = meshes.iter().zip(setting.workloads()).map(reach).collect();
    let runner = match (&parts[..], config.separate, gpu) {
        (_, _, Some(gpu)) if config.animated => {
            let clips: Vec<_> = setting.workloads().map(Workload::as_clip).collect();
            Runner::animated(gpu, &parts, &clips, setting.each(), setting.workload.ahead())
        }
        ([(mesh, desc)], true, Some(gpu)) => Runner::crowds(gpu, mesh, *desc, 1, setting.updated() as usize),
        ([(mesh, desc)], ..) => {
            let shared = running.iter().flatten().find_map(|trial| trial.runner_for(config));
            let threads = machine.args.update.threads.unwrap_or(0);
            let another = shared.and_then(|runner| runner.another(*desc, setting.updated()));
            another.unwrap_or_else(|| Runner::new(gpu, mesh, *desc, setting.updated(), threads))
        }
        (_, _, gpu) => Runner::scene(gpu, &parts, setting.each()),
    };
    match too_large(runner)? {
        Ok(runner) => Ok(refusal(Trial::begin(machine, candidate, subject, parts, runner))?),
        Err(reason) => Ok(Err(reason)),
    }
}

/// Like [`refusal`], for failures at allocation: if memory is short, smaller candidates may fit.
fn too_large<T>(result: deltamorph::Result<T>) -> deltamorph::Result<Result<T, String>> {
    match result {
        Err(e) if e.kind() == ErrorKind::OutOfMemory => Ok(Err(e.to_string())),
        other => refusal(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::ash::vk;

    #[test]
    fn too_little_memory_leaves_a_configuration_out_and_a_lost_device_ends_the_run() {
        let made = |result| too_large::<()>(Err(Error::vulkan("vkQueueSubmit")(result)));
        assert!(made(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY).is_ok_and(|skipped| skipped.is_err()));
        for fatal in [vk::Result::ERROR_DEVICE_LOST, vk::Result::ERROR_INITIALIZATION_FAILED] {
            assert!(made(fatal).is_err_and(|e| e.to_string().contains("vkQueueSubmit")), "{fatal:?}");
        }
        let invalid = || Error::Invalid { what: "weights".into(), remedy: "others".into() };
        assert!(too_large::<()>(Err(invalid())).is_ok_and(|skipped| skipped.is_err()));
        assert!(too_large(Ok(())).is_ok_and(|run| run.is_ok()));
    }

    #[test]
    fn the_slowest_sets_the_pace() {
        let seconds = Duration::from_secs_f64;
        let schedule = Schedule { frames: 100, rounds: 10, limit: seconds(5.0), common: Common::Frames };
        assert_eq!(schedule.share(), seconds(0.5));
        let frames = [0.0, 0.001, 0.1, 0.25, 20.0].map(|slowest| schedule.frames_together(seconds(slowest)));
        assert_eq!(frames, [10, 10, 5, 2, 1]);
    }
}
