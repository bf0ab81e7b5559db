//! One interface to the GPU paths and the cpu path, for every command that updates poses; and the setup of commands
//! that update one instance.

use crate::args::values::{BatchSpec, expand_batches};
use crate::args::{PackArgs, RunArgs};
use crate::input::Input;
use crate::output::{Failure, Output, Result, refuse};
use deltamorph::packed::PoseGrid;
use deltamorph::{
    AnimationDesc, BatchSize, BlockDesc, CpuCrowd, CrowdDesc, DeltaFormat, Error, MorphEngine, PackDesc, PackedLayout,
    PackedMesh, Playback, PoseFormat, Repeat, UpdateDesc, UpdatePath, UpdateStats, WeightClip,
};
pub use deltamorph_headless::Headless as Gpu;
use deltamorph_headless::{DeviceChoice, Draws, HeadlessCrowd, HeadlessDesc, PoseUpload, Step};
use serde_json::{Value, json};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

/// Whether poses are updated on the device, by the first path of `args`.
fn updates(gpu: &Gpu, args: &RunArgs) -> bool {
    match args.update.paths.first() {
        Some(path) => *path != UpdatePath::Cpu,
        None => gpu.caps().check_path(UpdatePath::Blocks).is_ok(),
    }
}

/// Opens the device chosen on the command line. `None`, with a warning, if there is none and none was chosen.
pub fn open(choice: Option<&DeviceChoice>, out: &Output) -> Result<Option<Gpu>> {
    let desc = HeadlessDesc { device: choice.cloned().unwrap_or_default(), ..Default::default() };
    let gpu = if_any(Gpu::new(&desc), choice, out)?;
    if let Some(gpu) = &gpu {
        gpu.engine().set_techniques(&deltamorph_baselines::TECHNIQUES);
    }
    if let Some(caps) = gpu.as_ref().map(Gpu::caps).filter(|caps| caps.is_software()) {
        let name = &caps.name;
        out.warn(format_args!("{name} is a software driver: it runs on the CPU"));
    }
    Ok(gpu)
}

/// Opens the device that draws pictures.
pub fn open_to_draw(choice: Option<&DeviceChoice>, out: &Output) -> Result<Gpu> {
    open(choice, out)?.ok_or_else(|| {
        Failure::Failed("drawing needs a Vulkan device, and there is none; on Linux ./with-vulkan installs one".into())
    })
}

/// `None`, with a warning, if there is no device and none was chosen; other errors are failures.
fn if_any<T>(opened: deltamorph::Result<T>, choice: Option<&DeviceChoice>, out: &Output) -> Result<Option<T>> {
    match opened {
        Err(error @ Error::NoDevice { .. }) if choice.is_none() => {
            out.warn(error);
            Ok(None)
        }
        opened => Ok(Some(opened?)),
    }
}

/// The device for `args`: none for the path `cpu`; optional if no path is named.
fn open_for(args: &RunArgs, choice: Option<&DeviceChoice>, out: &Output) -> Result<Option<Gpu>> {
    match args.update.paths.first() {
        Some(UpdatePath::Cpu) => Ok(None),
        Some(&path) => open(choice, out)?.map(Some).ok_or_else(|| no_device(path).into()),
        None => open(choice, out),
    }
}

fn no_device(path: UpdatePath) -> Error {
    Error::NoDevice {
        what: format!("update path '{}' needs a Vulkan device, and there is none", path.name()),
        remedy: "install a driver (on Linux ./with-vulkan installs lavapipe), or use --path cpu",
    }
}

/// The mesh of `input` in `format`: the packed file's own if it has this format, else packed now.
pub fn packed(
    input: &Input,
    engine: Option<&MorphEngine>,
    format: DeltaFormat,
    args: &PackArgs,
) -> Result<Arc<PackedMesh>> {
    let Some(held) = input.packed.as_ref().filter(|mesh| mesh.layout().format == format) else {
        let desc = engine.map_or(PackDesc::new(format), |engine| engine.pack_desc(format));
        return Ok(Arc::new(PackedMesh::pack(&input.kept, &PackDesc { blocks: args.desc(), ..desc })?));
    };
    // The largest weight applies to poses, independent of packing.
    if (PackArgs { weight_max: None, ..args.clone() }).desc() == BlockDesc::default() {
        return Ok(held.clone());
    }
    refuse(format!(
        "--block-size, --position-error and --normal-error apply to packing, but {} is packed already; leave them out, \
         or give the folder that it was packed from",
        input.origin
    ))
}

/// Instances updated by one path.
pub enum Runner<'a> {
    /// On a device: a crowd, or one per mesh of a scene, all with as many instances; and the clips that it plays, if it
    /// animates them.
    Device(Vec<HeadlessCrowd<'a>>, Option<Playing>),
    /// On the processor; with an upload to the device, if poses are drawn.
    Cpu(Box<CpuCrowd>, Option<Box<PoseUpload<'a>>>),
}

/// Clips that a device plays, a frame per step.
pub struct Playing {
    fps: f32,
    /// The frame of the next step.
    frame: usize,
}

/// Each update is waited for.
fn crowd_desc(update: UpdateDesc, instances: u32) -> CrowdDesc {
    CrowdDesc { instances, frames_in_flight: 1, ..CrowdDesc::new(update) }
}

/// Measurements of a frame.
pub struct Frame {
    pub stats: UpdateStats,
    /// Device time of the update in milliseconds, if measured.
    pub gpu_ms: Option<f64>,
    /// Device time of the draws that follow it, in milliseconds; `None` without draws or timestamps.
    pub draw_ms: Option<f64>,
    /// Time to upload the result from main memory to the device, in milliseconds: the path `cpu`, if it is drawn.
    pub upload_ms: Option<f64>,
    /// From weights to result, draws on a device included, in milliseconds.
    pub cpu_ms: f64,
}

impl<'a> Runner<'a> {
    /// `heads` instances of `mesh` with the description `desc`. The path `cpu` uses `gpu` only to draw.
    pub fn new(
        gpu: Option<&'a Gpu>,
        mesh: &Arc<PackedMesh>,
        desc: UpdateDesc,
        heads: u32,
        threads: usize,
    ) -> deltamorph::Result<Self> {
        if desc.path != UpdatePath::Cpu {
            return Self::scene(gpu, &[(mesh.clone(), desc)], heads);
        }
        let crowd = CpuCrowd::new(mesh.clone(), &CrowdDesc { instances: heads, ..CrowdDesc::new(desc) }, threads)?;
        let upload = gpu.map(|gpu| PoseUpload::new(gpu, crowd.layout(), heads)).transpose()?;
        Ok(Self::Cpu(Box::new(crowd), upload.map(Box::new)))
    }

    /// `heads` instances more of the same mesh, which is not uploaded again; `None` unless it is updated on a device.
    pub fn another(&self, desc: UpdateDesc, heads: u32) -> Option<deltamorph::Result<Self>> {
        let Self::Device(crowds, None) = self else { return None };
        Some(crowds[0].another(&crowd_desc(desc, heads)).map(|crowd| Self::Device(vec![crowd], None)))
    }

    /// A crowd of `heads` instances of each of `parts` on a device, updated in one submission.
    pub fn scene(
        gpu: Option<&'a Gpu>,
        parts: &[(Arc<PackedMesh>, UpdateDesc)],
        heads: u32,
    ) -> deltamorph::Result<Self> {
        let crowd = |(mesh, desc): &(Arc<PackedMesh>, UpdateDesc)| {
            let gpu = gpu.filter(|_| desc.path != UpdatePath::Cpu).ok_or_else(|| no_device(desc.path))?;
            HeadlessCrowd::new(gpu, mesh, &crowd_desc(*desc, heads))
        };
        Ok(Self::Device(parts.iter().map(crowd).collect::<deltamorph::Result<_>>()?, None))
    }

    /// Like [`scene`](Self::scene), animated on the device: the instances of each crowd play its clips in turns, whose
    /// columns are the targets in their order, and each instance is `ahead` frames ahead of the one before it.
    pub fn animated(
        gpu: &'a Gpu,
        parts: &[(Arc<PackedMesh>, UpdateDesc)],
        clips: Vec<Vec<WeightClip>>,
        heads: u32,
        (ahead, repeat): (usize, Repeat),
    ) -> deltamorph::Result<Self> {
        let (mut crowds, fps) = (vec![], clips[0][0].fps);
        for (part, ((mesh, desc), mut clips)) in (0..).zip(parts.iter().zip(clips)) {
            let names: Vec<_> = mesh.layout().targets.iter().map(|target| target.name.clone()).collect();
            clips.iter_mut().for_each(|clip| clip.names.clone_from(&names));
            let animation = AnimationDesc::new(&clips);
            let mut crowd = HeadlessCrowd::animated(gpu, mesh, &crowd_desc(*desc, heads), &animation)?;
            for (head, clip) in (0..heads).zip((0..clips.len() as u32).cycle()) {
                let frames = f64::from(part * heads + head) * ahead as f64;
                crowd.play(head, &Playback { start: -frames / f64::from(fps), repeat, ..Playback::new(clip) })?;
            }
            crowds.push(crowd);
        }
        Ok(Self::Device(crowds, Some(Playing { fps, frame: 0 })))
    }

    /// The next step of clips that the device plays is `frame`.
    pub fn seek(&mut self, frame: usize) {
        if let Self::Device(_, Some(playing)) = self {
            playing.frame = frame;
        }
    }

    /// Updates every instance to `weights[head]`, draws it if there is a device, and waits.
    pub fn step(&mut self, weights: &[impl AsRef<[f32]>], draws: Draws) -> deltamorph::Result<Frame> {
        let Step { update, gpu_ms, draw_ms, cpu_ms } = match self {
            Self::Device(crowds, playing) => {
                let mut weights: Vec<&[f32]> = weights.iter().map(AsRef::as_ref).collect();
                if let Some(Playing { fps, frame }) = playing {
                    crowds.iter_mut().try_for_each(|crowd| crowd.set_time(*frame as f64 / f64::from(*fps)))?;
                    *frame += 1;
                    weights.clear();
                }
                HeadlessCrowd::step_together(crowds, &weights, draws)?
            }
            Self::Cpu(crowd, upload) => {
                let start = Instant::now();
                for (head, weights) in (0..).zip(weights) {
                    crowd.set_weights(head, weights.as_ref())?;
                }
                let stats = crowd.update();
                let cpu_ms = start.elapsed().as_secs_f64() * 1e3;
                let mut frame = Frame { stats, gpu_ms: None, draw_ms: None, upload_ms: None, cpu_ms };
                if let Some(upload) = upload.as_mut().filter(|_| draws.any()) {
                    let poses: Vec<_> =
                        (0..weights.len() as u32).map(|head| crowd.pose(head)).collect::<Result<_, _>>()?;
                    frame.upload_ms = Some(upload.upload(&poses.iter().map(AsRef::as_ref).collect::<Vec<_>>())?);
                    frame.draw_ms = upload.draw(draws)?;
                }
                return Ok(frame);
            }
        };
        Ok(Frame { stats: update.stats, gpu_ms, draw_ms, upload_ms: None, cpu_ms })
    }

    /// The pose of an instance in a group of the mesh, six floats per vertex, in input order.
    pub fn pose(&mut self, head: u32, group: usize) -> deltamorph::Result<Vec<f32>> {
        match self {
            Self::Device(crowds, _) => {
                let instances = crowds[0].crowd().desc().instances;
                crowds[(head / instances) as usize].read_group_pose(head % instances, group)
            }
            Self::Cpu(crowd, _) => Ok(crowd.layout().to_user_order(&crowd.group_pose(head, group)?)),
        }
    }

    /// The weights of the first instance if a device animates it, in units of the grid.
    pub fn played(&mut self) -> deltamorph::Result<Option<Vec<i32>>> {
        if let Self::Device(crowds, Some(_)) = self { crowds[0].read_weights(0).map(Some) } else { Ok(None) }
    }

    /// The next pose of the first instance has no predecessor.
    pub fn reset_history(&mut self) -> deltamorph::Result<()> {
        match self {
            Self::Device(crowds, _) => crowds[0].reset_history(0),
            Self::Cpu(crowd, _) => crowd.reset_history(0),
        }
    }

    /// The integers of the first instance: those of its pose, stored in `format`, or the integer sums of its path;
    /// `None` if all is float32.
    pub fn integers(&mut self, format: PoseFormat) -> deltamorph::Result<Option<Vec<i32>>> {
        if !format.has_integers() {
            return match self {
                Self::Device(crowds, None) => crowds[0].read_sums(0),
                Self::Device(..) | Self::Cpu(..) => Ok(None),
            };
        }
        let stored = match self {
            Self::Device(crowds, _) => crowds[0].read_stored(0, 0)?,
            Self::Cpu(crowd, _) => crowd.stored_pose(0, 0)?.to_vec(),
        };
        Ok(Some(format.integers(&stored)))
    }

    /// Device time of draws of every instance; `None` without a device.
    pub fn draw_ms(&mut self, draws: Draws) -> deltamorph::Result<Option<f64>> {
        match self {
            Self::Device(crowds, _) => crowds.iter().map(|crowd| crowd.draw(draws)).sum(),
            Self::Cpu(..) => Ok(None),
        }
    }
}

/// FNV-1a over the bytes of numbers, least significant first.
pub fn fnv(numbers: &[i32]) -> u64 {
    let bytes = numbers.iter().flat_map(|s| s.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The packed mesh, its update description, and the device.
pub struct Stage {
    gpu: Option<Rc<Gpu>>,
    /// Threads of the path `cpu`; 0: one per core.
    pub threads: usize,
    /// What errors are against, in words.
    pub source: &'static str,
    pub mesh: Arc<PackedMesh>,
    pub desc: UpdateDesc,
}

/// How poses add up: "exact" where sums are of integers, and equal to a full evaluation bit for bit; else "float".
pub fn accumulate(desc: &UpdateDesc) -> &'static str {
    if desc.pose.has_integers() || desc.path == deltamorph_baselines::SCATTER { "exact" } else { "float" }
}

impl Stage {
    /// Sets up the path named, or else `blocks`, or `cpu` without a device.
    pub fn new(args: &RunArgs, input: &Input, device: Option<&DeviceChoice>, out: &Output) -> Result<Self> {
        Self::on(open_for(args, device, out)?.map(Rc::new), args, input, out)
    }

    /// Like [`new`](Self::new), with a device that is already open. The path `cpu` does not use it.
    pub fn on(gpu: Option<Rc<Gpu>>, args: &RunArgs, input: &Input, out: &Output) -> Result<Self> {
        let gpu = gpu.filter(|gpu| updates(gpu, args));
        let (mesh, desc) = prepare(args, input, gpu.as_deref().map(Gpu::engine), out)?;
        let threads = args.update.threads.unwrap_or(0);
        let source = if input.packed.is_some() { "the packed file" } else { "the source" };
        Ok(Self { gpu, threads, source, mesh, desc })
    }

    pub fn runner(&self, desc: UpdateDesc) -> deltamorph::Result<Runner<'_>> {
        Runner::new(self.gpu.as_deref(), &self.mesh, desc, 1, self.threads)
    }

    pub fn device(&self) -> String {
        self.gpu.as_deref().map_or("none".into(), |gpu| gpu.caps().name.clone())
    }

    /// An instance that plays `clip` from its beginning, planned on the device.
    pub fn animated(&self, clip: WeightClip) -> Result<Runner<'_>> {
        let gpu = self.gpu.as_deref().filter(|_| self.desc.path == UpdatePath::Blocks);
        let gpu = gpu.ok_or_else(|| Failure::Usage("--animated needs a Vulkan device and the path blocks".into()))?;
        let parts = [(self.mesh.clone(), self.desc)];
        Ok(Runner::animated(gpu, &parts, vec![vec![clip]], 1, (0, Repeat::Once))?)
    }

    /// The update options, in the JSON of each command. Fields may be added, never renamed. The error budget is in
    /// input units, 0 if nothing is deferred.
    pub fn setup(&self) -> Value {
        let UpdateDesc { path, mode, pose, slots, error_budget, .. } = self.desc;
        json!({
            "path": path.name(), "format": self.mesh.layout().format.name(), "mode": mode.name(),
            "accumulate": accumulate(&self.desc), "pose": pose.name(), "slots": slots, "error_budget": error_budget,
        })
    }

    /// In words: "blocks fast fixed32, 2 slots, on llvmpipe".
    pub fn describe(&self) -> String {
        let UpdateDesc { path, pose, slots, .. } = self.desc;
        let device = if path == UpdatePath::Cpu { "the processor".to_owned() } else { self.device() };
        let format = self.mesh.layout().format.name();
        // Paths that evaluate in draws have no pose buffers.
        let slots = if path.evaluates_in_draws() { String::new() } else { format!(", {slots} slots") };
        let pose = if pose.has_integers() { format!(" {}", pose.name()) } else { String::new() };
        format!("{} {format}{pose}{slots}, on {device}", path.name())
    }
}

/// The packed mesh and the update description of one instance. The path is the one named, or else `blocks` with an
/// `engine`, `cpu` without. The format is the one named, that of the packed file, or the path's default.
pub fn prepare(
    args: &RunArgs,
    input: &Input,
    engine: Option<&MorphEngine>,
    out: &Output,
) -> Result<(Arc<PackedMesh>, UpdateDesc)> {
    let update = &args.update;
    let (named, pose) = (update.paths.first().copied(), update.poses.first().copied());
    let path = named.unwrap_or(if engine.is_some() { UpdatePath::Blocks } else { UpdatePath::Cpu });
    let fits = |format: &DeltaFormat| path.formats().contains(format);
    let held = input.packed.as_ref().map(|mesh| mesh.layout().format);
    // Fixed-point poses are sums of deltas in blocks.
    let holds = |format: &DeltaFormat| pose.is_none_or(|pose| pose.takes(*format));
    let defaults = [DeltaFormat::Fast, DeltaFormat::Float32, DeltaFormat::Small, DeltaFormat::Snorm16];
    let mut defaults = held.into_iter().chain(defaults.into_iter().filter(holds));
    let format = update.formats.first().copied().or_else(|| defaults.find(fits)).filter(fits);
    let format = format.ok_or_else(|| {
        let names: Vec<&str> = path.formats().iter().map(|format| format.name()).collect();
        Failure::Usage(format!("--format: the path '{}' supports {}", path.name(), names.join(" or ")))
    })?;
    let default = UpdateDesc::new(path, batch_size(args.batch_size, path, engine, format)?);
    let desc = UpdateDesc {
        mode: update.modes.first().copied().unwrap_or(default.mode),
        slots: update.slots,
        pose: pose.unwrap_or(default.pose),
        tolerance: update.drift,
        weight_max: update.pack.weight_max,
        error_budget: update.budget(input.kept.diagonal),
        ..default
    };
    desc.check().map_err(|e| Failure::Usage(e.to_string()))?;
    let mesh = packed(input, engine, format, &update.pack)?;
    let (narrow, largest) = (desc, input.largest.get());
    let desc = reaching(narrow, largest, mesh.layout());
    if let (Ok(Some(before)), Ok(Some(after))) = (narrow.grid(mesh.layout()), desc.grid(mesh.layout()))
        && before.weight_max < after.weight_max
    {
        let (pose, by) = (desc.pose.name(), after.units[0] / before.units[0]);
        let steps = if by == 1.0 { String::new() } else { format!(", with steps {by} times as large") };
        out.warn(format_args!("weights up to {largest}: the range of {pose} poses is extended to them{steps}"));
    }
    desc.check_for(mesh.layout()).map_err(|e| Failure::Usage(format!("{e}; see --pose and --weight-max")))?;
    Ok((mesh, desc))
}

/// Weights in fewer bits are too coarse, if poses that hold smaller weights have more.
const WEIGHT_BITS: u32 = 14;

/// `desc` with poses that hold weights up to `largest`, unless it states what they hold; and no more than 1 or that,
/// where holding more would make the steps of weights coarse.
pub fn reaching(desc: UpdateDesc, largest: f32, layout: &PackedLayout) -> UpdateDesc {
    let fitted = UpdateDesc { weight_max: Some(largest.max(1.0)), ..desc };
    let suffices = |grid: &PoseGrid| largest <= grid.weight_max && grid.weight_bits >= WEIGHT_BITS;
    let default = desc.grid(layout).ok().flatten().filter(suffices);
    match fitted.grid(layout) {
        Ok(Some(_)) if desc.weight_max.is_none() && default.is_none() => fitted,
        _ => desc,
    }
}

/// The batch size for `spec` on `path`.
fn batch_size(
    spec: BatchSpec,
    path: UpdatePath,
    engine: Option<&MorphEngine>,
    format: DeltaFormat,
) -> Result<BatchSize> {
    if let Some(engine) = engine {
        engine.caps().check_path(path)?;
    }
    let max = engine.and_then(|e| e.caps().batch_max(path, format)).unwrap_or(0);
    let (allowed, _) = expand_batches(&[spec], path, max);
    allowed.last().copied().ok_or_else(|| {
        let all = if path.takes_all_targets() { ", or \"all\"" } else { "" };
        Failure::Usage(format!(
            "--batch-size: the path '{}' supports 1 to {max} targets per pass here{all}",
            path.name()
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::ash::vk;

    #[test]
    fn only_that_there_is_no_device_leads_to_the_path_cpu() {
        let out = Output::new(true, None);
        let opened = |error, choice| if_any::<()>(Err(error), choice, &out);
        assert!(matches!(opened(no_device(UpdatePath::Blocks), None), Ok(None)));
        let chosen = DeviceChoice::Index(0);
        assert!(opened(no_device(UpdatePath::Blocks), Some(&chosen)).is_err(), "one was chosen");
        for (call, result) in [
            ("vkCreateInstance", vk::Result::ERROR_OUT_OF_HOST_MEMORY),
            ("vkEnumeratePhysicalDevices", vk::Result::ERROR_INITIALIZATION_FAILED),
            ("vkCreateDevice", vk::Result::ERROR_DEVICE_LOST),
            ("vkCreateQueryPool", vk::Result::ERROR_OUT_OF_DEVICE_MEMORY),
        ] {
            let failure = opened(Error::vulkan(call)(result), None).expect_err("it cannot be set up");
            assert!(matches!(&failure, Failure::Failed(text) if text.contains(call)), "{failure}");
        }
    }
}
