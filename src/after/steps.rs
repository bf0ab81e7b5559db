//! A crowd's targets of post-morph passes, and the planning of the passes.

use super::context::TargetContext;
use super::normals::GpuNormals;
use super::output::{OutputTarget, OutputView, Part};
use super::pass::{Pass, Reads};
use super::pieces::Pieces;
use crate::abi::numbers::PIECE;
use crate::asset::streams::Semantic;
use crate::error::{Error, Result, ensure, refuse};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::memory::Ring;
use crate::plan::earlier::Earlier;
use crate::plan::instances::{Instances, OutputChange};
use crate::plan::steps::{Owner, PostMorphPass, Resource, Source, Steps, Use, Work};
use crate::update::technique::{Technique, UpdateId};
use ash::vk;
use std::ops::Range;

/// The target of a pass for an instance, and the state of its output.
struct Target {
    kind: PostMorphPass,
    instance: u32,
    /// At least one.
    passes: Vec<Pass>,
    /// Ring of lists of changed pieces, for the kernels.
    lists: Ring,
    /// Changed pieces of the pose, and the pieces to write for them.
    moved: Pieces,
    changed: Pieces,
    /// With double-buffered output: pieces that are stale in the buffer to be written next.
    other_stale: Option<Pieces>,
    /// The output buffer written last by an update that was not discarded.
    output: usize,
    earlier: Earlier<usize>,
    /// The output buffer with the contents before the update planned last.
    previous: Option<usize>,
    /// The next update resets the history; the last update that did.
    is_reset: bool,
    reset_by: u64,
    /// Some of the buffer's contents are unknown.
    is_stale: bool,
    /// The last update that wrote the buffer; 0: none, or it was discarded.
    written_by: u64,
    /// Joints were set since the last update.
    is_moved: bool,
    /// The instance was removed: nothing is written.
    is_removed: bool,
    /// Source slot and number of pieces of the update planned last.
    planned: Option<(u32, u32)>,
    is_listed: bool,
}

#[derive(Default)]
pub(crate) struct After {
    targets: Vec<Target>,
    /// The vertices of the mesh in the order of poses, once a target needs them.
    order: Option<Ring>,
    /// Scratch memory.
    changed: Vec<Range<u32>>,
}

impl After {
    /// Sets the target for the pose of an instance.
    ///
    /// # Errors
    /// An invalid target or skin; no memory. Nothing changes then.
    pub fn set_output(&mut self, context: &TargetContext<'_>, target: &OutputTarget<'_>) -> Result<()> {
        self.set(context, PostMorphPass::Output, "an output target", target, Reads::of_output(target, context)?)
    }

    /// Sets the target for the normals of an instance.
    ///
    /// # Errors
    /// An invalid target or surface; no memory. Nothing changes then.
    pub fn set_normals(
        &mut self,
        context: &TargetContext<'_>,
        (normals, target): (&GpuNormals, &OutputTarget<'_>),
    ) -> Result<()> {
        let is_normals = matches!(target.streams, [stream] if stream.semantic == Semantic::Normal);
        let fits = is_normals && target.joints.is_none();
        let remedy = "name Semantic::Normal as its only stream, and no joints";
        ensure!(fits, "a normals target with other streams or with joints", remedy);
        self.set(context, PostMorphPass::Normals, "a normals target", target, Reads::of_normals(normals, context)?)
    }

    fn set(
        &mut self,
        context: &TargetContext<'_>,
        kind: PostMorphPass,
        what: &str,
        target: &OutputTarget<'_>,
        (reads, reads_at): (Reads, u32),
    ) -> Result<()> {
        let parts = Part::of(what, target.streams, context)?;
        context.check(what, &parts, &reads)?;
        let TargetContext { instance, frames, .. } = *context;
        let changed = Pieces::none(context.pieces());
        let list_bytes = Ring::part_bytes(4 * u64::from(changed.count()));
        let usage = vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER;
        let lists = Ring::new(context.device, "deltamorph changed pieces", list_bytes, frames, usage)?;
        let other_stale = (parts[0].outputs() == 2).then(|| changed.clone());
        let order = if target.pose_order { None } else { self.order(context)? };
        let passes = parts.into_iter().map(|part| {
            // Only positions and normals are skinned.
            let reads = if part.group == 0 { reads.clone() } else { Reads::Nothing };
            Pass::new(context, part, &lists, order, (reads, reads_at))
        });
        let passes = passes.collect::<Result<_>>()?;
        self.unset(kind, instance);
        self.targets.push(Target {
            kind,
            instance,
            passes,
            lists,
            other_stale,
            moved: changed.clone(),
            changed,
            output: 0,
            earlier: Earlier::new(frames),
            previous: None,
            is_reset: false,
            reset_by: 0,
            is_stale: true,
            written_by: 0,
            is_moved: false,
            is_removed: false,
            planned: None,
            is_listed: false,
        });
        Ok(())
    }

    /// The vertices of the mesh in the order of poses, on the device; `None` if the orders are the same.
    ///
    /// # Errors
    /// A mesh of more vertices than a texel buffer holds; no memory.
    fn order(&mut self, context: &TargetContext<'_>) -> Result<Option<BufferRange>> {
        let Some(blocks) = &context.layout().blocks else { return Ok(None) };
        let order = blocks.order();
        let bytes = 4 * order.len() as u64;
        let caps = &context.device.caps;
        let texels = (order.len() as u64, "texels", caps.max_texels.into());
        let what = format!("an output of mesh '{}' in the order of the mesh takes", context.layout().name);
        caps.check_limit(&what, texels, "use the order of poses, or split the mesh")?;
        if self.order.is_none() {
            let usage = vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER;
            let mut made = Ring::new(context.device, "deltamorph vertex order", Ring::part_bytes(bytes), 1, usage)?;
            made.words(0)?[..order.len()].copy_from_slice(order);
            self.order = Some(made);
        }
        Ok(self.order.as_ref().map(|ring| BufferRange { size: bytes, ..ring.range(0) }))
    }

    pub fn unset(&mut self, kind: PostMorphPass, instance: u32) {
        self.targets.retain(|target| (target.kind, target.instance) != (kind, instance));
    }

    pub fn outputs(&self) -> impl Iterator<Item = Resource> {
        PostMorphPass::ALL
            .into_iter()
            .filter(|kind| self.targets.iter().any(|target| target.kind == *kind))
            .map(PostMorphPass::output)
    }

    fn of(&mut self, instance: u32) -> impl Iterator<Item = &mut Target> {
        self.targets.iter_mut().filter(move |target| target.instance == instance)
    }

    /// Sets the offset of an instance's joints, which moved.
    ///
    /// # Errors
    /// An instance that is not skinned; an invalid offset.
    pub fn set_joints(&mut self, instance: u32, offset: u64) -> Result<()> {
        for target in self.of(instance).filter(|target| !target.is_removed) {
            let set = target.passes.iter_mut().filter_map(|pass| pass.set_joints(offset));
            if !set.collect::<Result<Vec<()>>>()?.is_empty() {
                target.is_moved = true;
                return Ok(());
            }
        }
        refuse(format!("instance {instance} is not skinned"), "set an output target with joints")
    }

    /// Locations of an instance's output.
    ///
    /// # Errors
    /// An instance without a target, or without output so far.
    pub fn output(&self, instance: u32) -> Result<OutputView> {
        let mut of_kind = self.targets.iter().filter(|target| target.kind == PostMorphPass::Output);
        let found = of_kind.find(|target| target.instance == instance && target.written_by > 0 && !target.is_removed);
        let none = || {
            let text = format!("instance {instance} has no output");
            Error::invalid(text, "set an output target, and record an update")
        };
        let Target { passes, output, previous, .. } = found.ok_or_else(none)?;
        let at = |output: usize| passes[0].part.place(output);
        Ok(OutputView { current: at(*output), previous: previous.map(at) })
    }

    /// Takes a change of the outputs of an instance. Buffers of a removed one stay alive for earlier updates; the host
    /// may have reused those of one that was hidden.
    pub fn change(&mut self, instance: u32, change: OutputChange) {
        self.of(instance).for_each(|target| match change {
            OutputChange::Reset => target.is_reset = true,
            OutputChange::Renewed => target.is_stale = true,
            OutputChange::Removed => target.is_removed = true,
        });
    }

    pub fn discard_from(&mut self, first: u64) {
        for target in &mut self.targets {
            if let Some(before) = target.earlier.discard_from(first) {
                target.output = before;
            }
            if target.written_by >= first {
                (target.is_stale, target.written_by) = (true, 0);
            }
            target.is_reset |= target.reset_by >= first;
        }
    }

    /// Appends the passes that bring the targets to the update planned by `technique`; none if nothing changed.
    /// `wrote`: uses of the last update that wrote poses, which may be an earlier one.
    ///
    /// # Errors
    /// Lists that are not mapped.
    pub fn plan(
        &mut self,
        technique: &mut dyn Technique,
        instances: &Instances,
        id: UpdateId,
        wrote: &[&'static [Use]],
        steps: &mut Steps,
    ) -> Result<()> {
        let Self { targets, changed, .. } = self;
        for target in targets.iter_mut() {
            (target.planned, target.previous) = (None, Some(target.output));
            let instance = target.instance as usize;
            if target.is_removed || !instances.is_shown(instance) {
                continue;
            }
            let Some((slot, _)) = technique.slots_of(instances, instance) else { continue };
            changed.clear();
            for pass in &target.passes {
                technique.state().changed(instances, id.update, target.instance, pass.part.group, changed);
            }
            target.plan(changed, slot, id)?;
        }
        // If no pose changes: steps without works, for barriers after the earlier update.
        let mut earlier = if steps.is_empty() { wrote } else { &[] };
        for kind in PostMorphPass::ALL {
            let of_kind = targets.iter().filter(|t| t.kind == kind);
            let planned = || of_kind.clone().filter_map(|target| Some((target, target.planned?)));
            if planned().next().is_none() {
                continue;
            }
            std::mem::take(&mut earlier).iter().for_each(|uses| steps.step(uses));
            steps.step(kind.uses());
            for (&Target { instance, output, ref passes, .. }, (slot, count)) in planned() {
                for (kernel, pass) in (0..).zip(passes) {
                    let owner = Owner::Pass(kind);
                    let group = pass.part.group as u32;
                    let source = Source::Slot(slot);
                    let destination = output as u32;
                    steps.push(Work { owner, kernel, group, instance, source, destination, items: 0..count });
                }
            }
        }
        Ok(())
    }

    /// Records a work of a pass.
    ///
    /// # Safety
    /// See [`Pass::record`].
    #[allow(unsafe_code)]
    pub unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, kind: PostMorphPass, work: &Work) {
        let target = self.targets.iter().find(|t| (t.kind, t.instance) == (kind, work.instance));
        if let Some((target, pass)) = target.and_then(|target| Some((target, target.passes.get(work.kernel as usize)?)))
        {
            // SAFETY: the caller's obligations.
            unsafe { pass.record(cmd, frame, work, target.is_listed) };
        }
    }
}

impl Target {
    /// Plans the pieces of these vertices, or all if the output is stale.
    fn plan(&mut self, changed: &[Range<u32>], slot: u32, id: UpdateId) -> Result<()> {
        let all = self.changed.count();
        self.moved.clear();
        self.changed.clear();
        changed.iter().for_each(|range| self.moved.add(range.start / PIECE..range.end.div_ceil(PIECE)));
        self.passes[0].reads.spread(&self.moved, &mut self.changed);
        if std::mem::take(&mut self.is_moved) || self.is_stale {
            self.changed.add(0..all);
        }
        let is_reset = std::mem::take(&mut self.is_reset);
        if is_reset {
            self.reset_by = id.update;
        }
        if self.changed.len() == 0 {
            return Ok(());
        }
        let before = self.output;
        self.earlier.push(id.update, before);
        if let Some(other_stale) = &mut self.other_stale {
            self.output = 1 - self.output;
            // The other buffer is now stale in what changes now.
            std::mem::swap(other_stale, &mut self.changed);
            self.changed.add_all(other_stale);
        }
        self.previous = match (is_reset || self.is_stale, before != self.output) {
            (true, _) => Some(self.output),
            (false, is_kept) => is_kept.then_some(before),
        };
        let count = self.changed.len();
        (self.is_stale, self.written_by) = (false, id.update);
        self.is_listed = count < all;
        if self.is_listed {
            let list = self.lists.words(id.frame)?;
            self.changed.iter().zip(list).for_each(|(piece, word)| *word = piece);
        }
        self.planned = Some((slot, count));
        Ok(())
    }
}
