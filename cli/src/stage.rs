//! One head, updated as the command line says: what commands that take one path have in common.

use crate::args::values::{BatchLimit, BatchSpec, expand_batches};
use crate::args::{Single, UpdateArgs};
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Runner, packed};
use deltamorph::headless::DeviceChoice;
use deltamorph::{Accumulate, BatchSize, DeltaFormat, PackedLayout, PackedMesh, UpdateDesc, UpdatePath, WeightClip};
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
    /// For the command called `command`, on the path that it was given, or else the best that there is: `blocks` where
    /// there is a device, or `cpu`.
    pub fn best(
        command: &str,
        update: &UpdateArgs,
        batch: Option<BatchSpec>,
        input: &Input,
        device: Option<&DeviceChoice>,
        out: &Output,
    ) -> Result<Self, Failure> {
        let single = |path| update.single(command, path).map_err(Failure::Usage);
        if !update.paths.is_empty() {
            let single = single(UpdatePath::Cpu)?;
            let gpu = if single.path == UpdatePath::Cpu { None } else { Gpu::open(device, out)? };
            return Self::on(gpu, single, update, batch, input, out);
        }
        let gpu = Gpu::open(device, out)?.filter(|gpu| gpu.caps().check_path(UpdatePath::Blocks).is_ok());
        let path = if gpu.is_some() { UpdatePath::Blocks } else { UpdatePath::Cpu };
        Self::on(gpu, single(path)?, update, batch, input, out)
    }

    fn on(
        gpu: Option<Gpu>,
        single: Single,
        update: &UpdateArgs,
        batch: Option<BatchSpec>,
        input: &Input,
        out: &Output,
    ) -> Result<Self, Failure> {
        let held = input.packed.as_ref().map(|mesh| mesh.layout().format);
        let format = single.delta_format(held).map_err(Failure::Usage)?;
        let desc = UpdateDesc {
            mode: single.mode,
            slots: update.slots,
            accumulate: single.accumulate,
            error_budget: update.budget(input.kept.diagonal).map_err(Failure::Usage)?,
            ..UpdateDesc::new(single.path, batch_size(batch, single.path, gpu.as_ref(), format)?)
        };
        desc.check().map_err(|e| Failure::Usage(e.to_string()))?;
        let mesh = packed(input, gpu.as_ref(), format, &update.pack)?;
        let desc = with_sums_that_fit(desc, update, mesh.layout(), out)?;
        Ok(Self { gpu, threads: update.threads.unwrap_or(0), mesh, desc })
    }

    pub fn runner(&self) -> Result<Runner<'_>, Failure> {
        self.runner_of(self.desc)
    }

    pub fn runner_of(&self, desc: UpdateDesc) -> Result<Runner<'_>, Failure> {
        Runner::new(self.gpu.as_ref(), &self.mesh, desc, 1, self.threads)
    }

    pub fn device(&self) -> String {
        self.gpu.as_ref().map_or("none".into(), |gpu| gpu.caps().name.clone())
    }

    /// A head that plays `clip`, planned on the device.
    pub fn animated(&self, clip: &WeightClip) -> Result<Runner<'_>, Failure> {
        match &self.gpu {
            Some(gpu) if self.desc.path == UpdatePath::Blocks => Runner::animated(gpu, &self.mesh, self.desc, clip),
            _ => {
                Err(Failure::Usage("--animated plans on a Vulkan device, on the path blocks, and there is none".into()))
            }
        }
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

/// `desc`, with exact sums where float sums would drift too far and nobody has asked for them.
fn with_sums_that_fit(
    desc: UpdateDesc,
    update: &UpdateArgs,
    layout: &PackedLayout,
    out: &Output,
) -> Result<UpdateDesc, Failure> {
    let exact = UpdateDesc { accumulate: Accumulate::Exact, ..desc };
    match desc.check_for(layout) {
        Ok(()) => Ok(desc),
        Err(e) if update.accumulate.is_empty() && exact.check_for(layout).is_ok() => {
            out.note(format_args!("{e}; taking exact sums (--drift and --accumulate choose)"));
            Ok(exact)
        }
        Err(e) => Err(Failure::Usage(format!("{e}; see --drift, --accumulate and --weight-max"))),
    }
}

/// The one batch size asked for, or the largest that the path allows.
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
    let limit = BatchLimit { max, all: path.takes_all_targets() };
    let (allowed, _) = expand_batches(&[spec.unwrap_or(BatchSpec::Max)], limit);
    allowed.last().copied().ok_or_else(|| {
        let all = if limit.all { ", or \"all\"" } else { "" };
        Failure::Usage(format!("--batch-size: path '{}' takes 1 to {max} targets per pass here{all}", path.name()))
    })
}
