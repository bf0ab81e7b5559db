//! The public face of the baselines: an upload of their own, and draws that evaluate.

use crate::engine::crowd::{Crowd, PoseView};
use crate::engine::{GpuMesh, MorphEngine};
use crate::error::{Error, Result};
use crate::gpu::baselines::scatter::Records;
use crate::pack::PackedMesh;
use crate::plan::UpdatePath;
use ash::vk;

impl MorphEngine {
    /// As [`upload`](Self::upload), for crowds on the path `scatter`, which reads records of a vertex and its delta, 16
    /// bytes each, and no blocks: so many bytes and the base pose, whatever [`mesh_bytes`](Self::mesh_bytes) says.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); a format other than `small`; sums that could overflow.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    pub unsafe fn upload_scatter(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        let layout = mesh.layout().clone();
        let index = layout.blocks.clone().filter(|_| UpdatePath::Scatter.formats().contains(&layout.format));
        let Some(index) = index else {
            return Err(Error::invalid(
                format!("update path 'scatter' with {} deltas", layout.format.name()),
                "pack the mesh as small",
            ));
        };
        index.exact()?;
        let Records { words, first } = Records::new(mesh, &index);
        let bytes = (size_of_val(words.as_slice()) as u64).max(16);
        self.check_not_empty(&layout)?;
        for (what, bytes) in [("a pose takes", layout.pose_bytes()), ("the records of 'scatter' take", bytes)] {
            let range = self.device.caps.max_storage_range;
            self.check_limit(&layout, what, (bytes, "bytes", range), "use fewer targets, or split the mesh")?;
        }
        // SAFETY: the caller's obligations.
        unsafe { self.upload_words(cmd, layout, mesh.base(), (&words, bytes), Some(first)) }
    }

    /// Record the draws of a crowd on a direct path, one for each head, each of which evaluates its pose: in a render
    /// pass without attachments, with every primitive discarded. It is what such a path costs, for `bench`; an engine
    /// that wanted to show the result would do the same in its own vertex shader.
    ///
    /// The caller is responsible for: recording it after [`record_update`](Self::record_update), and having at most
    /// `frames_in_flight` frames with draws unfinished, whether weights have changed in them or not: draws read the
    /// weights where the update wrote them. It binds over the graphics pipeline, its set 0, push constants, and
    /// vertex bindings from 0 on.
    ///
    /// # Errors
    /// A crowd that another engine made, or whose path has pose buffers to draw from; no update recorded yet.
    ///
    /// # Safety
    /// As [`record_update`](Self::record_update).
    pub unsafe fn record_draws(&self, cmd: vk::CommandBuffer, crowd: &Crowd) -> Result<()> {
        self.check_direct(crowd)?;
        // SAFETY: the caller's obligations.
        unsafe { crowd.record_draws(cmd) }
    }

    /// Record the draw of one head as [`record_draws`](Self::record_draws) does, and capture the pose that it evaluates:
    /// by transform feedback, or else by stores of the vertex shader, as the device has it. The crowd has room for one
    /// pose. Barriers are recorded as for an update through `feedback` or `vertex-store`.
    ///
    /// # Errors
    /// As [`record_draws`](Self::record_draws); a device that has neither.
    ///
    /// # Safety
    /// As [`record_draws`](Self::record_draws).
    pub unsafe fn record_capture(&self, cmd: vk::CommandBuffer, crowd: &Crowd, instance: u32) -> Result<PoseView> {
        self.check_direct(crowd)?;
        // SAFETY: the caller's obligations.
        unsafe { crowd.record_capture(cmd, instance) }
    }

    fn check_direct(&self, crowd: &Crowd) -> Result<()> {
        let path = crowd.desc().update.path;
        match (crowd.is_on(&self.device), path.evaluates_in_draws()) {
            (false, _) => Err(Error::invalid(
                "the crowd belongs to another MorphEngine",
                "record it with the engine that created it",
            )),
            (true, false) => Err(Error::invalid(
                format!("a draw that evaluates, of a crowd on the path '{}'", path.name()),
                "draw from Crowd::pose: the path has pose buffers",
            )),
            (true, true) => Ok(()),
        }
    }
}
