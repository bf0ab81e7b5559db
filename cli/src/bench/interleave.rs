//! Several configurations measured in turn, so that changes of the machine's speed affect all of them.

use super::configs::Config;
use super::machine::Machine;
use super::record::{RunRecord, Skipped};
use super::subject::Subject;
use super::trial::Trial;
use super::workload::{Setting, Workload};
use crate::output::Result;
use crate::progress::Progress;
use crate::runner::{Runner, reaching};
use deltamorph::{Error, PackedMesh, Repeat, UpdatePath};
use std::sync::Arc;
use std::time::Duration;

/// The time and the number of rounds of a configuration.
#[derive(Clone, Copy)]
pub struct Schedule {
    /// Frames of each configuration.
    pub frames: usize,
    /// Rounds that they are divided into.
    pub rounds: usize,
    /// Time for each configuration; at least three frames are timed, regardless of the limit.
    pub limit: Duration,
}

/// Fewest frames that are timed.
const LEAST_FRAMES: usize = 3;

impl Schedule {
    fn share(&self) -> Duration {
        self.limit / self.rounds as u32
    }

    /// Frames per round of which the slowest configuration, at `slowest` a frame, has time for.
    fn frames_together(&self, slowest: Duration) -> usize {
        let most = self.frames.div_ceil(self.rounds);
        let fit = (self.share().as_secs_f64() / slowest.as_secs_f64()) as usize;
        fit.clamp(1, most)
    }
}

/// A trial, or why it was refused.
type Running<'a> = Result<Trial<'a>, String>;

/// Times `running` in turns, a step of `bar` for each round. Wrong or refused trials drop out. The frames of a clip
/// differ: all run the same ones, spread over it. Of other workloads each runs as many as it can.
fn run(running: &mut [Running<'_>], clip: bool, schedule: &Schedule, bar: &Progress) -> deltamorph::Result<()> {
    let mut slowest = Duration::ZERO;
    each(running, |trial| {
        slowest = slowest.max(trial.warm_up(schedule.share())?);
        Ok(())
    })?;
    for round in 0..schedule.rounds {
        each(running, |trial| {
            let (timed, spent) = trial.timed();
            if clip {
                trial.jump(round, schedule.rounds)?;
                trial.round(schedule.frames_together(slowest), None)
            } else if timed < LEAST_FRAMES || spent < schedule.limit {
                trial.round(schedule.frames.div_ceil(schedule.rounds), Some(schedule.share()))
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

/// Measures `configs` in turns, and those that lack memory after the others; returns them in their order. `bar` has a
/// step for each of them, which is verified first, and for each round.
pub fn interleave(
    machine: &Machine<'_>,
    subject: &mut Subject,
    configs: &[Config],
    setting: &Setting<'_>,
    schedule: &Schedule,
    bar: &Progress,
) -> Result<Vec<Outcome>> {
    let mut running: Vec<Running<'_>> = vec![];
    for config in configs {
        let trial = begin(machine, subject, config, setting, &running)?;
        running.push(trial);
        bar.inc(1);
    }
    let begun: Vec<bool> = running.iter().map(Result::is_ok).collect();
    run(&mut running, setting.first().changed.is_none(), schedule, bar)?;
    let mut outcomes: Vec<Outcome> = vec![];
    for (trial, config) in running.into_iter().zip(configs) {
        outcomes.push(match trial {
            Ok(trial) => Ok(trial.finish(subject)?),
            Err(reason) => Err(Skipped { what: config.to_string(), reason }),
        });
    }
    // The others have freed their memory: there may be room for the rest.
    if begun.contains(&true) {
        for (place, config) in configs.iter().enumerate().filter(|(place, _)| !begun[*place]) {
            let alone = std::slice::from_ref(config);
            let outcome = interleave(machine, subject, alone, setting, schedule, bar)?.remove(0);
            outcomes[place] = outcome.map(|record| RunRecord { alone: true, ..record });
        }
    }
    Ok(outcomes)
}

/// A verified trial, or the reason why there is none. Those that run already have meshes to share.
fn begin<'a>(
    machine: &'a Machine<'_>,
    subject: &mut Subject,
    config: &'a Config,
    setting: &'a Setting<'_>,
    running: &[Running<'a>],
) -> Result<Running<'a>> {
    let meshes = subject.meshes(machine, config.format)?;
    // The path `cpu` needs a device only to draw.
    let gpu = machine.gpu.as_ref().filter(|_| setting.passes > 0 || config.desc.path != UpdatePath::Cpu);
    let reach = |(mesh, workload): (&Arc<PackedMesh>, &Workload)| {
        (mesh.clone(), reaching(config.desc, workload.largest(), mesh.layout()))
    };
    let parts: Vec<_> = meshes.iter().zip(setting.workloads).map(reach).collect();
    let runner = match (&parts[..], gpu) {
        (_, Some(gpu)) if config.animated => {
            let each = setting.each();
            let clips = (0..).zip(setting.workloads).map(|(part, own)| own.as_clips(part * each..(part + 1) * each));
            Runner::animated(gpu, &parts, clips.collect(), each, (setting.first().ahead(), Repeat::Loop))
        }
        ([(mesh, desc)], _) => {
            let shared = running.iter().flatten().find_map(|trial| trial.runner_for(config));
            let threads = machine.args.update.threads.unwrap_or(0);
            let another = shared.and_then(|runner| runner.another(*desc, setting.updated()));
            another.unwrap_or_else(|| Runner::new(gpu, mesh, *desc, setting.updated(), threads))
        }
        (_, gpu) => Runner::scene(gpu, &parts, setting.each()),
    };
    match too_large(runner)? {
        Ok(runner) => Ok(refusal(Trial::begin(machine, (config, setting), subject, parts, runner))?),
        Err(reason) => Ok(Err(reason)),
    }
}

/// Like [`refusal`], for failures at allocation: if memory is short, smaller candidates may fit.
fn too_large<T>(result: deltamorph::Result<T>) -> deltamorph::Result<Result<T, String>> {
    match result {
        Err(e @ Error::OutOfMemory { .. }) => Ok(Err(e.to_string())),
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
        let schedule = Schedule { frames: 100, rounds: 10, limit: seconds(5.0) };
        assert_eq!(schedule.share(), seconds(0.5));
        let frames = [0.0, 0.001, 0.1, 0.25, 20.0].map(|slowest| schedule.frames_together(seconds(slowest)));
        assert_eq!(frames, [10, 10, 5, 2, 1]);
    }
}
