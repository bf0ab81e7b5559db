//! One interface to the GPU paths and the cpu path, for every command that updates poses.

use crate::args::PackArgs;
use crate::input::Input;
use crate::output::{Failure, Output};
pub use deltamorph::headless::Headless as Gpu;
use deltamorph::headless::{DeviceChoice, HeadlessCrowd, HeadlessDesc, PoseUpload, Step};
use deltamorph::{
    AnimatedCrowd, AnimationDesc, BlockDesc, CpuCrowd, CrowdDesc, DeltaFormat, DeviceCaps, PackDesc, PackedMesh,
    Playback, Repeat, UpdateDesc, UpdatePath, UpdateStats, WeightClip,
};
use std::sync::Arc;
use std::time::Instant;

/// Set up the device chosen on the command line. `None`, with a note, where there is none and none was chosen.
pub fn open(choice: Option<&DeviceChoice>, out: &Output) -> Result<Option<Gpu>, Failure> {
    let desc = HeadlessDesc::default().device(choice.cloned().unwrap_or_default());
    match Gpu::new(&desc) {
        Ok(gpu) => {
            let DeviceCaps { name, .. } = gpu.caps();
            if gpu.caps().is_software() {
                out.note(format_args!("{name} is a software driver: without a GPU the path 'cpu' is the one to use"));
            }
            Ok(Some(gpu))
        }
        Err(error) if choice.is_none() => {
            out.note(error);
            Ok(None)
        }
        Err(error) => Err(error.into()),
    }
}

/// The mesh of `input` in `format`: as a packed file has it where it is the file's, else packed now.
pub fn packed(
    input: &Input,
    gpu: Option<&Gpu>,
    format: DeltaFormat,
    args: &PackArgs,
) -> Result<Arc<PackedMesh>, Failure> {
    match &input.packed {
        Some(mesh) if mesh.layout().format == format => match args.desc() == BlockDesc::default() {
            true => Ok(mesh.clone()),
            false => Err(Failure::Usage(format!(
                "--block-size, --position-error, --normal-error and --weight-max say how to pack, but {} is packed \
                 already; leave them out, or give the folder that it was packed from",
                input.origin
            ))),
        },
        _ => {
            let desc = gpu.map_or(PackDesc::new(format), |gpu| gpu.engine().pack_desc(format));
            Ok(Arc::new(PackedMesh::pack(&input.kept, &desc.blocks(args.desc()))?))
        }
    }
}

/// Heads that are updated by one path.
pub enum Runner<'a> {
    /// On a device: a crowd, or one for each head.
    Gpu(Vec<HeadlessCrowd<'a>>),
    /// On a device, which plays a clip.
    Animated { crowd: Box<HeadlessCrowd<'a, AnimatedCrowd>>, fps: f32, frames: u32 },
    /// On the processor; with a way to the device, where poses are to be drawn there.
    Cpu(Box<CpuCrowd>, Option<Box<PoseUpload<'a>>>),
}

/// What a frame took.
pub struct Frame {
    /// Coefficients, passes, bytes.
    pub stats: UpdateStats,
    /// Device time of the update in milliseconds, where there is one.
    pub gpu_ms: Option<f64>,
    /// Device time of the draws that follow it, in milliseconds; `None` without draws or timestamps.
    pub draw_ms: Option<f64>,
    /// From a result in main memory to the device, in milliseconds: the path `cpu`, where it is drawn.
    pub upload_ms: Option<f64>,
    /// From weights to result, draws on a device included, in milliseconds.
    pub cpu_ms: f64,
}

impl<'a> Runner<'a> {
    /// `heads` instances of `mesh`, updated as `desc` says. On the path `cpu`, a `gpu` is where poses are drawn.
    pub fn new(
        gpu: Option<&'a Gpu>,
        mesh: &Arc<PackedMesh>,
        desc: UpdateDesc,
        heads: u32,
        threads: usize,
    ) -> Result<Self, Failure> {
        match (desc.path, gpu) {
            (UpdatePath::Cpu, gpu) => {
                let crowd = CpuCrowd::new(mesh.clone(), desc, heads as usize, threads)?;
                let upload = gpu.map(|gpu| PoseUpload::new(gpu, crowd.layout(), heads)).transpose()?;
                Ok(Self::Cpu(Box::new(crowd), upload.map(Box::new)))
            }
            (_, Some(gpu)) => Self::crowds(gpu, mesh, desc, heads, 1),
            (path, None) => Err(Failure::Failed(format!(
                "update path '{}' needs a Vulkan device and there is none; use --path cpu",
                path.name()
            ))),
        }
    }

    /// `count` crowds (≥ 1) of `heads` each on a device, updated in one submission.
    pub fn crowds(
        gpu: &'a Gpu,
        mesh: &Arc<PackedMesh>,
        desc: UpdateDesc,
        heads: u32,
        count: usize,
    ) -> Result<Self, Failure> {
        // One update at a time is recorded and waited for.
        let desc = CrowdDesc::new(desc).instances(heads).frames_in_flight(1);
        let mut crowds = vec![HeadlessCrowd::new(gpu, mesh, &desc)?];
        for _ in 1..count {
            crowds.push(crowds[0].another(&desc)?);
        }
        Ok(Self::Gpu(crowds))
    }

    /// A head that plays `clip` from its beginning, a frame each step, planned on the device.
    pub fn animated(
        gpu: Option<&'a Gpu>,
        mesh: &Arc<PackedMesh>,
        update: UpdateDesc,
        clip: &WeightClip,
    ) -> Result<Self, Failure> {
        let gpu = gpu.filter(|_| update.path == UpdatePath::Blocks).ok_or_else(|| {
            Failure::Usage("--animated plans on a Vulkan device, on the path blocks, and there is none".into())
        })?;
        let desc = CrowdDesc::new(update).frames_in_flight(1);
        let clips = AnimationDesc::new(std::slice::from_ref(clip));
        let mut crowd = HeadlessCrowd::animated(gpu, mesh, &desc, &clips)?;
        crowd.play(0, &Playback::new(0).repeat(Repeat::Once))?;
        Ok(Self::Animated { crowd: Box::new(crowd), fps: clip.fps, frames: 0 })
    }

    /// Update every head to `weights[head]`, draw it `copies` times where there is a device, and wait.
    pub fn step(&mut self, weights: &[impl AsRef<[f32]>], copies: u32) -> deltamorph::Result<Frame> {
        let Step { update, gpu_ms, draw_ms, cpu_ms } = match self {
            Self::Gpu(crowds) => {
                let weights: Vec<&[f32]> = weights.iter().map(AsRef::as_ref).collect();
                HeadlessCrowd::step_together(crowds, &weights, copies)?
            }
            Self::Animated { crowd, fps, frames } => {
                crowd.set_time(f64::from(*frames) / f64::from(*fps))?;
                *frames += 1;
                HeadlessCrowd::step_together(std::slice::from_mut(&mut **crowd), &[], copies)?
            }
            Self::Cpu(crowd, upload) => {
                let start = Instant::now();
                for (head, weights) in weights.iter().enumerate() {
                    crowd.set_weights(head, weights.as_ref())?;
                }
                let stats = crowd.update();
                let cpu_ms = start.elapsed().as_secs_f64() * 1e3;
                let mut frame = Frame { stats, gpu_ms: None, draw_ms: None, upload_ms: None, cpu_ms };
                if let Some(upload) = upload.as_mut().filter(|_| copies > 0) {
                    let poses: Vec<&[f32]> =
                        (0..weights.len()).map(|head| crowd.pose(head)).collect::<Result<_, _>>()?;
                    frame.upload_ms = Some(upload.upload(&poses)?.cpu_ms);
                    let draws: Vec<Option<f64>> = (0..copies).map(|_| upload.draw()).collect::<Result<_, _>>()?;
                    frame.draw_ms = draws.into_iter().sum();
                }
                return Ok(frame);
            }
        };
        Ok(Frame { stats: update.stats, gpu_ms, draw_ms, upload_ms: None, cpu_ms })
    }

    /// The pose of a head, six floats a vertex, in the user's order.
    pub fn pose(&mut self, head: u32) -> deltamorph::Result<Vec<f32>> {
        match self {
            Self::Gpu(crowds) => {
                let instances = crowds[0].crowd().desc().instances;
                crowds[(head / instances) as usize].read_pose(head % instances)
            }
            Self::Animated { crowd, .. } => crowd.read_pose(head),
            Self::Cpu(crowd, _) => Ok(crowd.layout().to_user_order(crowd.pose(head as usize)?)),
        }
    }

    /// The weights that a device has chosen for the first head, where it animates.
    pub fn played(&mut self, mesh: &PackedMesh) -> Result<Option<Vec<f32>>, Failure> {
        let (Self::Animated { crowd, .. }, Some(blocks)) = (self, &mesh.layout().blocks) else { return Ok(None) };
        let step = blocks.exact()?.weight_step();
        Ok(Some(crowd.read_weights(0)?.into_iter().map(|steps| steps as f32 * step).collect()))
    }

    /// The next pose of the first head has no predecessor.
    pub fn cut(&mut self) -> deltamorph::Result<()> {
        match self {
            Self::Gpu(crowds) => crowds[0].cut(0),
            Self::Animated { crowd, .. } => crowd.cut(0),
            Self::Cpu(crowd, _) => crowd.cut(0),
        }
    }

    /// The integer sums of the first head; `None` unless it accumulates exactly.
    pub fn sums(&mut self) -> deltamorph::Result<Option<Vec<i32>>> {
        match self {
            Self::Gpu(crowds) => crowds[0].read_sums(0),
            Self::Animated { crowd, .. } => crowd.read_sums(0),
            Self::Cpu(crowd, _) => Ok(crowd.sums(0)?.map(<[i32]>::to_vec)),
        }
    }

    /// Device time of `copies` draws of every head; `None` without a device.
    pub fn draw_ms(&mut self, copies: u32) -> deltamorph::Result<Option<f64>> {
        match self {
            Self::Gpu(crowds) => {
                let each: Vec<Option<f64>> = crowds.iter().map(|crowd| crowd.draw(copies)).collect::<Result<_, _>>()?;
                Ok(each.into_iter().sum())
            }
            Self::Animated { crowd, .. } => crowd.draw(copies),
            Self::Cpu(..) => Ok(None),
        }
    }
}
