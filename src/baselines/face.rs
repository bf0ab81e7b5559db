//! The public face of the baselines: an upload of their own, and draws that evaluate.

use super::draws::{Capture, Draw};
use super::scatter::records;
use super::{AttributesTechnique, DirectTechnique, TextureTechnique};
use crate::engine::{Crowd, GpuMesh, MorphEngine, PoseView};
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::mesh::MeshBuffers;
use crate::pack::{PackedLayout, PackedMesh};
use crate::plan::UpdatePath;
use crate::plan::schedule::Entry;
use ash::vk;

impl MorphEngine {
    /// As [`upload`](Self::upload), for crowds on the path `scatter`, which reads records of a vertex and its delta, 16
    /// bytes each, and no blocks: so many bytes and the base pose, whatever [`mesh_bytes`](Self::mesh_bytes) says.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); a format other than `small`; sums that could overflow; streams beside positions and
    /// normals.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    pub unsafe fn upload_scatter(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        UpdatePath::Scatter.check_groups(mesh.groups().len(), mesh.layout())?;
        let layout = mesh.layout();
        UpdatePath::Scatter.check_format(layout.format)?;
        let (words, first) = records(mesh, layout.index()?);
        self.check_not_empty(layout)?;
        self.check_storage(layout, "the records of 'scatter' take", &words)?;
        let buffers = MeshBuffers::new(&self.device, layout.clone(), mesh.base(), &words, first)?;
        // SAFETY: the caller's obligations.
        Ok(unsafe { self.upload_groups(cmd, vec![buffers]) })
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
        let draws = self.draws(crowd, 0)?;
        crowd.shown().try_for_each(|instance| crowd.slots_of(instance).map(|_| ()))?;
        // SAFETY: the caller's obligations.
        unsafe { draws.record(cmd, &mut crowd.shown(), false) };
        Ok(())
    }

    /// Record the draw of one head as [`record_draws`](Self::record_draws) does, and capture the pose that it
    /// evaluates: by transform feedback, or else by stores of the vertex shader, as the device has it. The crowd has
    /// room for one pose. Barriers are recorded as for an update through `feedback` or `vertex-store`.
    ///
    /// # Errors
    /// As [`record_draws`](Self::record_draws); a device that has neither.
    ///
    /// # Safety
    /// As [`record_draws`](Self::record_draws).
    pub unsafe fn record_capture(&self, cmd: vk::CommandBuffer, crowd: &Crowd, instance: u32) -> Result<PoseView> {
        // SAFETY: the caller's obligations.
        unsafe { self.record_capture_of(cmd, crowd, instance, 0) }
    }

    /// [`record_capture`](Self::record_capture) of a [group](PackedMesh::groups) of the mesh.
    ///
    /// # Safety
    /// As there.
    pub(crate) unsafe fn record_capture_of(
        &self,
        cmd: vk::CommandBuffer,
        crowd: &Crowd,
        instance: u32,
        group: usize,
    ) -> Result<PoseView> {
        let draws = self.draws(crowd, group)?;
        crowd.slots_of(instance)?;
        for entry in Capture::of(&self.device, crowd.desc().update.path)?.schedule().entries {
            // SAFETY: the caller's obligations; the device has what it captures with.
            unsafe {
                match entry {
                    Entry::Barrier(barrier) => barriers::record(&self.device.raw, cmd, &barrier),
                    Entry::Work { .. } => draws.record(cmd, &mut [instance].into_iter(), true),
                }
            }
        }
        Ok(crowd.view(0, 0, group))
    }

    /// Refuse a pose, or `words` of a technique's own, that a descriptor does not cover.
    pub(super) fn check_storage(&self, layout: &PackedLayout, what: &str, words: &[u32]) -> Result<()> {
        let bytes = size_of_val(words) as u64;
        [("a pose takes", layout.base_bytes()), (what, bytes)].into_iter().try_for_each(|(what, bytes)| {
            let (what, range) = (format!("mesh '{}': {what}", layout.name), self.device.caps.max_storage_range);
            self.device.caps.check_limit(&what, (bytes, "bytes", range), "use fewer targets, or split the mesh")
        })
    }

    fn draws<'a>(&self, crowd: &'a Crowd, group: usize) -> Result<&'a dyn Draw> {
        crowd.check_device(&self.device)?;
        let direct = crowd.technique_as::<DirectTechnique>().map(|direct| &direct.draws as &dyn Draw);
        let attributes = || crowd.technique_as::<AttributesTechnique>().map(|attributes| &attributes.draws as _);
        let texture = || {
            let texture = crowd.technique_as::<TextureTechnique>();
            texture.and_then(|texture| texture.draws(group)).map(|draws| draws as _)
        };
        direct.or_else(attributes).or_else(texture).ok_or_else(|| {
            Error::invalid(
                format!("a draw that evaluates, of a crowd on the path '{}'", crowd.desc().update.path.name()),
                "draw from Crowd::pose: the path has pose buffers",
            )
        })
    }
}
