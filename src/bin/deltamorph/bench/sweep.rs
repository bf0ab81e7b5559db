//! Runs the configurations: verified, then timed, then verified again.

use super::bandwidth;
use super::record::{Bandwidth, DeviceInfo, InputInfo, Report, RunRecord, Skipped};
use super::stamp;
use super::stats::Stats;
use super::workload::{Clip, Random, Workload};
use crate::args::BenchArgs;
use crate::args::values::{BatchLimit, BatchSpec, FormatChoice, PathChoice, expand_batches, expand_changed};
use crate::info::triangles;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Runner, pack_desc};
use deltamorph::headless::DeviceChoice;
use deltamorph::mesh::packed::{DeltaFormat, PackedMesh};
use deltamorph::plan::{BatchSize, UpdateDesc, UpdatePath, UpdateStats};
use deltamorph::reference::{PoseError, compare, evaluate, evaluate_unpacked};
use deltamorph::weights::csv;
use std::collections::HashMap;
use std::sync::Arc;

/// A result is right when positions are within this fraction of the diagonal …
const POSITION_BOUND: f64 = 3e-6;
/// … and normals within this many degrees of the float64 reference on the deltas kept.
const NORMAL_BOUND_DEGREES: f64 = 0.01;
/// Batch sizes where none are given.
const FULL_SWEEP: [BatchSpec; 2] = [BatchSpec::Range(1, None), BatchSpec::All];
const BRIEF_SWEEP: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Max, BatchSpec::All];
/// Draws that are timed for `draw_ms`.
const DRAWS: usize = 9;

/// Everything but the update path.
struct Setting<'a> {
    workload: &'a dyn Workload,
    /// Targets changed per frame and head, as asked for; `None` for clips.
    changed: Option<usize>,
    heads: u32,
}

struct Config {
    desc: UpdateDesc,
    format: DeltaFormat,
    batch_max: Option<u32>,
}

/// The float64 references of a workload's checkpoints: on the packed deltas, and on the raw files.
#[derive(Default)]
struct References {
    /// By format and the bits of the weights.
    known: HashMap<(DeltaFormat, Vec<u32>), Arc<Reference>>,
}

struct Reference {
    packed: Vec<f64>,
    raw: Vec<f64>,
}

/// Enough for one workload at its checkpoints in every format; more would only take memory.
const REFERENCES_MAX: usize = 64;

impl References {
    fn get(&mut self, mesh: &PackedMesh, input: &Input, weights: &[f32]) -> Arc<Reference> {
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.known.len() >= REFERENCES_MAX && !self.known.contains_key(&key) {
            self.known.clear();
        }
        let make = || {
            let (packed, raw) = (evaluate(mesh, weights), evaluate_unpacked(&input.raw, weights));
            Arc::new(Reference { packed, raw })
        };
        self.known.entry(key).or_insert_with(make).clone()
    }
}

/// Run everything that `args` ask for.
///
/// # Errors
/// The input or a clip cannot be used; an option asks for what the mesh does not have; a device that fails.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, out)?;
    let threads = args.update.threads.unwrap_or(0);
    let gpu = Gpu::open(device, out)?;
    let counts = expand_changed(&args.changed, input.kept.targets.len()).map_err(Failure::Usage)?;
    let clips = clips(args, &input)?;
    let (full, skipped) = configurations(args, gpu.as_ref(), &FULL_SWEEP);
    let (brief, _) = configurations(args, gpu.as_ref(), &BRIEF_SWEEP);

    let randoms: Vec<(usize, Random)> =
        counts.iter().map(|&n| (n, Random::new(input.kept.targets.len(), n, args.input.seed))).collect();
    let mut settings = vec![];
    for &heads in &args.heads {
        settings.extend(randoms.iter().map(|(n, w)| Setting { workload: w, changed: Some(*n), heads }));
        settings.extend(clips.iter().map(|w| Setting { workload: w, changed: None, heads }));
    }

    let spinner = out.spinner("measuring memory bandwidth");
    let largest = (input.kept.vertex_count() * input.kept.targets.len() * DeltaFormat::Float32.stride()) as u64;
    let cpu = bandwidth::measure(largest, threads);
    let device_bandwidth = match &gpu {
        Some(gpu) => gpu.headless.bandwidth(&gpu.engine, largest.max(1 << 20))?,
        None => None,
    };
    spinner.finish_and_clear();
    let bandwidth = Bandwidth {
        cpu_read_gb_s: cpu.map(|b| b.0),
        cpu_copy_gb_s: cpu.map(|b| b.1),
        device_copy_gb_s: device_bandwidth.map(|b| b.copy),
        device_read_gb_s: device_bandwidth.map(|b| b.read),
    };

    // Every batch size where most changes; elsewhere a few, for the plot against changed targets.
    let configs = |setting: &Setting<'_>| match setting.changed {
        Some(n) if Some(&n) != counts.last() => &brief,
        _ => &full,
    };
    let bar = out.bar(settings.iter().map(|s| configs(s).len() as u64).sum());
    let mut meshes: HashMap<DeltaFormat, Arc<PackedMesh>> = HashMap::new();
    let mut references = References::default();
    let mut runs = vec![];
    for setting in &settings {
        for config in configs(setting) {
            bar.set_message(format!(
                "{} {} batch {}, {}, {} changed",
                config.desc.path.name(),
                config.format.name(),
                config.desc.batch,
                setting.workload.name(),
                setting.changed.map_or("its".into(), |n| n.to_string())
            ));
            let mesh = match meshes.get(&config.format) {
                Some(mesh) => mesh.clone(),
                None => {
                    let mesh = Arc::new(PackedMesh::pack(&input.kept, &pack_desc(gpu.as_ref(), config.format))?);
                    meshes.insert(config.format, mesh.clone());
                    mesh
                }
            };
            let context = Context { args, input: &input, gpu: gpu.as_ref(), threads, bandwidth };
            runs.push(context.measure(setting, config, &mesh, &mut references)?);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let moved: usize = input.kept.targets.iter().map(|t| t.vertices.len()).sum();
    Ok(Report {
        schema: 1,
        version: env!("CARGO_PKG_VERSION").into(),
        created: stamp::now(),
        command: stamp::command_line(),
        device: device_info(gpu.as_ref(), threads),
        input: InputInfo {
            name: input.kept.name.clone(),
            origin: input.origin.clone(),
            vertices: input.kept.vertex_count(),
            targets: input.kept.targets.len(),
            triangles: triangles(&input.kept),
            diagonal: input.kept.diagonal,
            tolerance: input.kept.tolerance.position,
            moved_mean: moved as f64 / (input.kept.vertex_count() * input.kept.targets.len()).max(1) as f64,
        },
        bandwidth,
        runs,
        skipped,
    })
}

/// The clips given with `--weights`; without any, those of the input.
fn clips(args: &BenchArgs, input: &Input) -> Result<Vec<Clip>, Failure> {
    let names: Vec<&str> = input.kept.targets.iter().map(|t| t.name.as_str()).collect();
    let paths = if args.weights.is_empty() { &input.clips } else { &args.weights };
    let mut clips = vec![];
    for path in paths {
        let clip = Clip::new(&csv::read(path, args.input.fps_of(path))?, &names)?;
        if clip.len() == 0 {
            return Err(Failure::Failed(format!("{}: has no frame to replay; leave it out", path.display())));
        }
        clips.push(clip);
    }
    Ok(clips)
}

/// What can run, and what was asked for and cannot, with the reason.
fn configurations(args: &BenchArgs, gpu: Option<&Gpu>, sweep: &[BatchSpec]) -> (Vec<Config>, Vec<Skipped>) {
    let all = [PathChoice::Feedback, PathChoice::Compute, PathChoice::Cpu];
    let formats = [FormatChoice::Float32, FormatChoice::Snorm16];
    let paths = if args.update.paths.is_empty() { &all[..] } else { &args.update.paths };
    let formats = if args.update.formats.is_empty() { &formats[..] } else { &args.update.formats };
    let sizes = if args.batch_sizes.is_empty() { sweep } else { &args.batch_sizes };
    let (mut configs, mut skipped) = (vec![], vec![]);
    for path in paths.iter().map(|p| p.update_path()) {
        let available = match (path, gpu) {
            (UpdatePath::Cpu, _) => Ok(()),
            (_, Some(gpu)) => gpu.caps().check_path(path).map_err(|e| e.to_string()),
            (_, None) => Err("there is no Vulkan device; the path 'cpu' takes its place".into()),
        };
        if let Err(reason) = available {
            skipped.push(Skipped { what: path.name().into(), reason });
            continue;
        }
        for format in formats.iter().map(|f| f.delta_format()) {
            let batch_max = gpu.and_then(|g| g.caps().batch_max(path, format)).filter(|_| path != UpdatePath::Cpu);
            let limit = BatchLimit { max: batch_max.unwrap_or(0), all: path != UpdatePath::Feedback };
            let (batches, refused) = expand_batches(sizes, limit);
            for batch in batches {
                let desc = UpdateDesc { path, batch, mode: args.update.mode.update_mode(), slots: args.update.slots };
                match desc.check() {
                    Ok(()) => configs.push(Config { desc, format, batch_max }),
                    Err(e) => {
                        skipped.push(Skipped { what: format!("{} batch {batch}", path.name()), reason: e.to_string() })
                    }
                }
            }
            // `all` is in the default list; that feedback has no such thing is no news.
            let named = |b: &&BatchSize| **b != BatchSize::All && !args.batch_sizes.is_empty();
            let refused: Vec<String> = refused.iter().filter(named).map(ToString::to_string).collect();
            if !refused.is_empty() {
                skipped.push(Skipped {
                    what: format!("{} {} batch {}", path.name(), format.name(), refused.join(", ")),
                    reason: format!("the device allows at most {} targets per pass", limit.max),
                });
            }
        }
    }
    (configs, skipped)
}

struct Context<'a> {
    args: &'a BenchArgs,
    input: &'a Input,
    gpu: Option<&'a Gpu>,
    threads: usize,
    bandwidth: Bandwidth,
}

/// What verification found.
#[derive(Clone, Copy, Default)]
struct Found {
    error: PoseError,
    raw: PoseError,
}

impl Context<'_> {
    fn measure(
        &self,
        setting: &Setting<'_>,
        config: &Config,
        mesh: &Arc<PackedMesh>,
        references: &mut References,
    ) -> Result<RunRecord, Failure> {
        let mut runner = Runner::new(self.gpu, mesh, config.desc, setting.heads, self.threads)?;
        let weights = |frame: usize| -> Vec<Vec<f32>> {
            (0..setting.heads).map(|h| setting.workload.weights(h, frame)).collect()
        };
        let mut found = Found::default();
        let checkpoints = setting.workload.checkpoints();
        let mut frame = 0;
        for &checkpoint in &checkpoints {
            while frame <= checkpoint {
                runner.step(&weights(frame))?;
                frame += 1;
            }
            self.verify(&mut runner, mesh, &weights(checkpoint), references, &mut found)?;
        }

        let mut record = self.blank(setting, config);
        if self.right(&found) {
            frame %= setting.workload.period();
            for _ in 0..self.args.warmup {
                runner.step(&weights(frame))?;
                frame += 1;
            }
            self.time(&mut runner, setting, frame, &weights, &mut record)?;
            let last = frame + self.args.frames - 1;
            self.verify(&mut runner, mesh, &weights(last), references, &mut found)?;
            let mut draws = vec![];
            for _ in 0..DRAWS {
                draws.extend(runner.draw_ms()?);
            }
            record.draw_ms = Stats::of(&draws).map(|s| s.median);
        }
        let diagonal = self.scale();
        record.max_error = Some(found.error.position);
        record.max_error_rel = Some(found.error.position / diagonal);
        record.normal_error_deg = Some(found.error.normal_degrees);
        record.raw_error_rel = Some(found.raw.position / diagonal);
        record.verified = self.right(&found);
        if !record.verified {
            (record.gpu_ms, record.cpu_ms, record.floor_fraction) = (None, None, None);
            record.problem = Some(format!(
                "positions are off by {:.3e} of the diagonal ({POSITION_BOUND:.0e} allowed), normals by {:.4}° \
                 ({NORMAL_BOUND_DEGREES}° allowed)",
                found.error.position / diagonal,
                found.error.normal_degrees
            ));
        }
        Ok(record)
    }

    /// Errors are stated relative to this.
    fn scale(&self) -> f64 {
        // A single point has no diagonal; its errors stay absolute.
        match self.input.kept.diagonal {
            d if d > 0.0 => f64::from(d),
            _ => 1.0,
        }
    }

    fn right(&self, found: &Found) -> bool {
        found.error.within(POSITION_BOUND * self.scale(), NORMAL_BOUND_DEGREES)
    }

    /// Compare the first and the last head with the reference.
    fn verify(
        &self,
        runner: &mut Runner<'_>,
        mesh: &PackedMesh,
        weights: &[Vec<f32>],
        references: &mut References,
        found: &mut Found,
    ) -> Result<(), Failure> {
        let last = weights.len() - 1;
        for head in if last == 0 { vec![0] } else { vec![0, last] } {
            let pose = runner.pose(head as u32)?;
            let reference = references.get(mesh, self.input, &weights[head]);
            found.error = found.error.max(compare(&pose, &reference.packed));
            found.raw = found.raw.max(compare(&pose, &reference.raw));
        }
        Ok(())
    }

    fn time(
        &self,
        runner: &mut Runner<'_>,
        setting: &Setting<'_>,
        start: usize,
        weights: &dyn Fn(usize) -> Vec<Vec<f32>>,
        record: &mut RunRecord,
    ) -> Result<(), Failure> {
        let frames = self.args.frames;
        let (mut gpu, mut cpu, mut sum) = (vec![], vec![], UpdateStats::default());
        let (mut changed, mut active) = (0, 0);
        let mut before = weights((start + setting.workload.period() - 1) % setting.workload.period());
        for frame in start..start + frames {
            let now = weights(frame);
            let step = runner.step(&now)?;
            gpu.extend(step.gpu_ms);
            cpu.push(step.cpu_ms);
            sum.coefficients += step.stats.coefficients;
            sum.passes += step.stats.passes;
            sum.bytes_moved += step.stats.bytes_moved;
            sum.bytes_floor += step.stats.bytes_floor;
            for (a, b) in before.iter().flatten().zip(now.iter().flatten()) {
                changed += usize::from(a != b);
                active += usize::from(*b != 0.0);
            }
            before = now;
        }
        let mean = |total: f64| total / frames as f64;
        record.changed = setting.changed.map_or(mean(changed as f64) / f64::from(setting.heads), |n| n as f64);
        record.active = mean(active as f64) / f64::from(setting.heads);
        record.coefficients = mean(sum.coefficients as f64);
        record.passes = mean(sum.passes as f64);
        record.bytes_moved = mean(sum.bytes_moved as f64);
        record.bytes_floor = mean(sum.bytes_floor as f64);
        record.gpu_ms = Stats::of(&gpu);
        record.cpu_ms = Stats::of(&cpu);
        let b = self.bandwidth;
        let ceiling = match record.path.as_str() {
            "cpu" => b.cpu_read_gb_s,
            _ => b.device_read_gb_s.into_iter().chain(b.device_copy_gb_s).reduce(f64::max),
        };
        // Means: in a clip the frames differ, and the bytes are their mean.
        let seconds = record.time().map(|t| t.mean * 1e-3).filter(|t| *t > 0.0);
        let pose = (self.input.kept.vertex_count() * deltamorph::mesh::packed::POSE_STRIDE) as f64;
        let written = pose * f64::from(setting.heads) * if record.passes > 0.0 { 1.0 } else { 0.0 };
        let to_read = (record.bytes_floor - written).max(0.0);
        record.floor_fraction = ceiling.zip(seconds).map(|(gb_s, s)| to_read / (gb_s * 1e9) / s);
        Ok(())
    }

    fn blank(&self, setting: &Setting<'_>, config: &Config) -> RunRecord {
        RunRecord {
            path: config.desc.path.name().into(),
            mode: config.desc.mode.name().into(),
            batch_size: config.desc.batch,
            batch_max: config.batch_max,
            workload: setting.workload.name().into(),
            changed: setting.changed.unwrap_or(0) as f64,
            coefficients: 0.0,
            active: 0.0,
            heads: setting.heads,
            shared: false,
            accumulate: "float".into(),
            format: config.format.name().into(),
            slots: config.desc.slots,
            passes: 0.0,
            bytes_moved: 0.0,
            bytes_floor: 0.0,
            gpu_ms: None,
            cpu_ms: None,
            draw_ms: None,
            floor_fraction: None,
            max_error: None,
            max_error_rel: None,
            normal_error_deg: None,
            raw_error_rel: None,
            verified: false,
            problem: None,
        }
    }
}

fn device_info(gpu: Option<&Gpu>, threads: usize) -> DeviceInfo {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu = DeviceInfo {
        name: "none".into(),
        kind: "none".into(),
        cpu: stamp::processor(),
        threads: if threads == 0 { cores } else { threads },
        ..DeviceInfo::default()
    };
    let Some(caps) = gpu.map(Gpu::caps) else { return cpu };
    let (major, minor, patch) = caps.api_version;
    let index = deltamorph::headless::Headless::devices().ok().and_then(|all| {
        all.iter().position(|c| (&c.name, &c.driver, &c.driver_info) == (&caps.name, &caps.driver, &caps.driver_info))
    });
    DeviceInfo {
        name: caps.name.clone(),
        kind: caps.kind.into(),
        driver: caps.driver.clone(),
        driver_info: caps.driver_info.clone(),
        api_version: format!("{major}.{minor}.{patch}"),
        index,
        ..cpu
    }
}
