//! The device side of recomputed normals.

use super::NormalsDesc;
use super::fans::{Fans, Spread};
use crate::abi::modules::NORMALS;
use crate::abi::push::NormalsPush;
use crate::after::attached::Attached;
use crate::after::output::Output;
use crate::after::pieces::Pieces;
use crate::after::step::{AfterStep, Bound, Job, PoseKernel, TargetContext};
use crate::after::steps::After;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::mesh::Upload;
use crate::pack::PackedMesh;
use crate::plan::steps::PostMorphPass;
use ash::vk;
use std::sync::Arc;

/// The surface of a mesh on the device; see [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals).
/// Targets keep its buffers alive.
pub struct GpuNormals {
    surface: Arc<Surface>,
    staging: Option<Upload>,
}

/// Shared by targets.
struct Surface {
    attached: Arc<Attached>,
    spread: Spread,
}

impl GpuNormals {
    /// Records the upload.
    ///
    /// # Safety
    /// See [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals).
    pub(crate) unsafe fn upload(
        device: &Arc<Device>,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &NormalsDesc<'_>,
    ) -> Result<Self> {
        let check = |words| Attached::check_size(device, mesh, "surface", mesh.base().len() as u64 + words);
        let Fans { words, spread } = Fans::new(desc, mesh.layout(), check)?;
        // SAFETY: the caller's obligations.
        let (attached, upload) = unsafe { Attached::upload(device, cmd, mesh, "surface", (mesh.base(), &words)) }?;
        Ok(Self { surface: Arc::new(Surface { attached, spread }), staging: Some(upload) })
    }

    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals) requires that.
    pub fn release_staging(&mut self) {
        self.staging = None;
    }
}

/// Output of an instance's recomputed normals; see
/// [`MorphEngine::set_normals_target`](crate::MorphEngine::set_normals_target).
///
/// Vertices are in pose-buffer order, without padding. Normals may be interleaved with decoded positions in one buffer
/// ([`DecodeTarget`](crate::after::DecodeTarget) without normals).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NormalsTarget {
    /// The output buffer, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's normal, a multiple of 4.
    pub offset: u64,
    /// Bytes per vertex, a multiple of 4 and at least 12.
    pub stride: u32,
}

impl NormalsTarget {
    /// Contiguous normals of 12 bytes from the start of the buffer.
    pub fn new(buffer: vk::Buffer) -> Self {
        Self { buffer, offset: 0, stride: 12 }
    }
}

pub(crate) struct Recomputed {
    bound: Bound<PoseKernel>,
    push: NormalsPush,
    surface: Arc<Surface>,
}

impl Recomputed {
    /// Sets the target of an instance.
    ///
    /// # Errors
    /// An invalid target or surface; no memory. Nothing changes then.
    pub fn set(
        after: &mut After,
        context: &TargetContext<'_>,
        (GpuNormals { surface, .. }, target): (&GpuNormals, &NormalsTarget),
    ) -> Result<()> {
        let NormalsTarget { buffer, offset, stride } = *target;
        let layout = &context.group.mesh.layout;
        surface.attached.check("a surface", context.device, layout)?;
        let output = Output { buffer, offset, stride, second: None };
        context.check("normals of")?;
        output.check("a normals target", layout, context.device)?;
        after.set(context, PostMorphPass::Normals, 1, vk::BufferUsageFlags::STORAGE_BUFFER, |lists| {
            let (range, normals_at) = output.range(layout);
            let bound = |frame| [context.poses(), surface.attached.range(), lists.range(u64::from(frame)), range];
            let bound: Vec<_> = (0..context.frames).map(bound).collect();
            let [units, offset] = context.scale();
            let push = NormalsPush {
                units,
                offset,
                fans_at: surface.attached.words_at(),
                normals_at,
                stride: stride / 4,
                vertices: layout.vertex_count as u32,
                // The rest is of each dispatch.
                ..Default::default()
            };
            let bound = Bound::new(context, PoseKernel(&NORMALS, context.pose()), &bound)?;
            Ok(Self { bound, push, surface: surface.clone() })
        })
    }
}

impl AfterStep for Recomputed {
    fn spread(&self, changed: &Pieces, written: &mut Pieces) {
        self.surface.spread.of(changed, written);
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job) {
        let pose_at = self.bound.pose_at(job);
        let push = NormalsPush { pose_at, count: job.count, listed: job.is_listed.into(), ..self.push };
        // SAFETY: the caller's obligations; the list was made for this frame.
        unsafe { self.bound.dispatch(cmd, job, job.frame as usize, &push) };
    }
}
