//! The `cpu` path: the same plans, carried out by threads. Runs without Vulkan.

mod kernel;
mod workers;

use crate::error::{Error, Result};
use crate::mesh::packed::{POSE_FLOATS, PackedMesh};
use crate::plan::commands::{CommandList, PassCommand};
use crate::plan::{Plan, PoseState, Source, UpdateDesc, UpdatePath, UpdateStats};
use crate::weights::delta::check_weights;
use std::sync::Arc;
use workers::Workers;

/// Instances of one mesh whose poses live in main memory.
pub struct CpuCrowd {
    mesh: Arc<PackedMesh>,
    slots: usize,
    states: Vec<PoseState>,
    weights: Vec<Vec<f32>>,
    plans: Vec<Plan>,
    list: CommandList,
    updates: u64,
    /// `[instance × slots + slot]`.
    poses: Vec<Vec<f32>>,
    workers: Workers,
}

impl CpuCrowd {
    /// `instances` heads, all weights 0. `threads` 0 takes one per core; without the `threads` feature the
    /// caller's thread does the work.
    ///
    /// # Errors
    /// As [`UpdateDesc::check`]; a path that isn't [`UpdatePath::Cpu`]; threads that cannot be started.
    pub fn new(mesh: Arc<PackedMesh>, desc: UpdateDesc, instances: usize, threads: usize) -> Result<Self> {
        if desc.path != UpdatePath::Cpu {
            return Err(Error::invalid(
                format!("update path '{}' for a CpuCrowd", desc.path.name()),
                "use UpdatePath::Cpu here, or MorphEngine for the GPU paths",
            ));
        }
        let workers = Workers::new(threads)?;
        let targets = mesh.layout().targets.len();
        let slots = desc.slots as usize;
        Ok(Self {
            states: vec![PoseState::new(desc)?; instances],
            weights: vec![vec![0.0; targets]; instances],
            plans: vec![Plan::default(); instances],
            list: CommandList::new(desc.path),
            updates: 0,
            poses: vec![mesh.base().to_vec(); instances * slots],
            slots,
            mesh,
            workers,
        })
    }

    /// Ask for these weights, one per target in the mesh's order, from the next update on.
    ///
    /// # Errors
    /// An instance out of range; a wrong number of weights; one that is not finite.
    pub fn set_weights(&mut self, instance: usize, weights: &[f32]) -> Result<()> {
        let targets = &self.mesh.layout().targets;
        check_weights(weights, |i| targets.get(i).map(|t| t.name.as_str()), targets.len())?;
        let count = self.weights.len();
        let slot = self.weights.get_mut(instance).ok_or_else(|| {
            Error::invalid(format!("instance {instance} of a crowd of {count}"), "count instances from 0")
        })?;
        slot.copy_from_slice(weights);
        Ok(())
    }

    /// Bring all poses to the weights asked for.
    pub fn update(&mut self) -> UpdateStats {
        self.updates += 1;
        for ((state, weights), plan) in self.states.iter_mut().zip(&self.weights).zip(&mut self.plans) {
            state.plan(weights, self.updates, plan);
        }
        self.list.fill(&self.plans);
        for pass in self.list.passes() {
            let at = pass.instance as usize * self.slots;
            let mut destination = std::mem::take(&mut self.poses[at + pass.destination as usize]);
            let source = match pass.source {
                Source::Base => Some(self.mesh.base()),
                Source::Slot(slot) if slot == pass.destination => None,
                Source::Slot(slot) => Some(self.poses[at + slot as usize].as_slice()),
            };
            self.run(pass, source, &mut destination);
            self.poses[at + pass.destination as usize] = destination;
        }
        UpdateStats::new(self.mesh.layout(), &self.list, &self.plans)
    }

    /// The pose of an instance after the last update: six floats a vertex, with padding.
    ///
    /// # Panics
    /// When `instance` is out of range.
    pub fn pose(&self, instance: usize) -> &[f32] {
        &self.poses[instance * self.slots + self.plans[instance].result as usize]
    }

    /// The pose before the last update, where it is still there; the pose itself when nothing changed.
    ///
    /// # Panics
    /// When `instance` is out of range.
    pub fn previous_pose(&self, instance: usize) -> Option<&[f32]> {
        self.plans[instance].previous.map(|slot| self.poses[instance * self.slots + slot as usize].as_slice())
    }

    fn run(&self, pass: &PassCommand, source: Option<&[f32]>, destination: &mut [f32]) {
        let coefficients = &self.list.coefficients[pass.coefficients.clone()];
        let mesh = &*self.mesh;
        let mut rest = destination;
        for (first, vertices) in mesh.layout().chunks() {
            let (chunk, tail) = rest.split_at_mut(vertices * POSE_FLOATS);
            rest = tail;
            self.workers.for_each_piece(chunk, |at, out| {
                let first = first + at / POSE_FLOATS;
                let source = source.map(|s| &s[first * POSE_FLOATS..][..out.len()]);
                kernel::dense(mesh, coefficients, first, source, out);
            });
        }
    }
}

#[cfg(test)]
mod tests;
