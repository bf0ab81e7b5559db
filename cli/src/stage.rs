//! One head, updated as the command line says: what commands that take one path have in common.

use crate::args::run::{RunArgs, Single};
use crate::args::values::{BatchSpec, expand_batches};
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::runner::{self, Gpu, Runner, packed};
use deltamorph::headless::DeviceChoice;
use deltamorph::{Accumulate, BatchSize, DeltaFormat, PackedMesh, UpdateDesc, UpdatePath, WeightClip};
use serde::Serialize;
use std::sync::Arc;

/// The packed mesh and how it is updated.
pub struct Stage {
    gpu: Option<Gpu>,
    threads: usize,
    pub mesh: Arc<PackedMesh>,
    /// How it is updated.
    pub desc: UpdateDesc,
}

/// How poses were updated, in the JSON of each command. Fields may be added, never renamed.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Setup {
    pub path: &'static str,
    pub format: &'static str,
    /// "incremental" or "rebuild".
    pub mode: &'static str,
    /// "float" or "exact".
    pub accumulate: &'static str,
    pub slots: u32,
    /// In input units; 0 where nothing waits.
    pub error_budget: f32,
}

impl Stage {
    /// For a command with the options `single`, on the path named, or else the best that there is: `blocks` where
    /// there is a device, or `cpu`.
    pub fn new(
        single: Single,
        args: &RunArgs,
        input: &Input,
        device: Option<&DeviceChoice>,
        out: &Output,
    ) -> Result<Self, Failure> {
        let gpu = match single.path {
            Some(UpdatePath::Cpu) => None,
            Some(_) => runner::open(device, out)?,
            None => runner::open(device, out)?.filter(|gpu| gpu.caps().check_path(UpdatePath::Blocks).is_ok()),
        };
        let path = single.path.unwrap_or(if gpu.is_some() { UpdatePath::Blocks } else { UpdatePath::Cpu });
        let held = input.packed.as_ref().map(|mesh| mesh.layout().format);
        let format = single.format_on(path, held).map_err(Failure::Usage)?;
        let default = UpdateDesc::new(path, batch_size(args.batch_size, path, gpu.as_ref(), format)?);
        let desc = default
            .mode(single.mode.unwrap_or(default.mode))
            .slots(args.update.slots)
            .accumulate(args.update.sums(single.sums.unwrap_or(default.accumulate)))
            .error_budget(args.update.budget(input.kept.diagonal).map_err(Failure::Usage)?);
        desc.check().map_err(|e| Failure::Usage(e.to_string()))?;
        let mesh = packed(input, gpu.as_ref(), format, &args.update.pack)?;
        let exact = desc.accumulate(Accumulate::Exact);
        let desc = match desc.check_for(mesh.layout()) {
            Ok(()) => desc,
            Err(e) if single.sums.is_none() && exact.check_for(mesh.layout()).is_ok() => {
                out.note(format_args!("{e}; taking exact sums (--drift and --accumulate choose)"));
                exact
            }
            Err(e) => return Err(Failure::Usage(format!("{e}; see --drift, --accumulate and --weight-max"))),
        };
        Ok(Self { gpu, threads: args.update.threads.unwrap_or(0), mesh, desc })
    }

    pub fn runner(&self, desc: UpdateDesc) -> Result<Runner<'_>, Failure> {
        Runner::new(self.gpu.as_ref(), &self.mesh, desc, 1, self.threads)
    }

    pub fn device(&self) -> String {
        self.gpu.as_ref().map_or("none".into(), |gpu| gpu.caps().name.clone())
    }

    /// A head that plays `clip`, planned on the device.
    pub fn animated(&self, clip: &WeightClip) -> Result<Runner<'_>, Failure> {
        Runner::animated(self.gpu.as_ref(), &self.mesh, self.desc, clip)
    }

    pub fn setup(&self) -> Setup {
        Setup {
            path: self.desc.path.name(),
            format: self.mesh.layout().format.name(),
            mode: self.desc.mode.name(),
            accumulate: self.desc.accumulate.name(),
            slots: self.desc.slots,
            error_budget: self.desc.error_budget,
        }
    }

    /// "blocks fast exact, 2 slots, on llvmpipe": for people.
    pub fn describe(&self) -> String {
        let UpdateDesc { path, accumulate, slots, .. } = self.desc;
        let device = if path == UpdatePath::Cpu { "the processor".to_owned() } else { self.device() };
        let format = self.mesh.layout().format.name();
        // Draws that evaluate have no pose buffers.
        let slots = if path.evaluates_in_draws() { String::new() } else { format!(", {slots} slots") };
        format!("{} {format} {}{slots}, on {device}", path.name(), accumulate.name())
    }
}

/// The requested batch size, or the largest that the path allows.
fn batch_size(
    spec: Option<BatchSpec>,
    path: UpdatePath,
    gpu: Option<&Gpu>,
    format: DeltaFormat,
) -> Result<BatchSize, Failure> {
    if let Some(gpu) = gpu {
        gpu.caps().check_path(path)?;
    }
    let max = gpu.and_then(|g| g.caps().batch_max(path, format)).unwrap_or(0);
    let (allowed, _) = expand_batches(&[spec.unwrap_or(BatchSpec::Max)], path, max);
    allowed.last().copied().ok_or_else(|| {
        let all = if path.takes_all_targets() { ", or \"all\"" } else { "" };
        Failure::Usage(format!("--batch-size: path '{}' takes 1 to {max} targets per pass here{all}", path.name()))
    })
}
