//! The decode step: float32 positions of a pose in an output buffer, for ray tracing, picking, or shaders that cannot
//! decode poses.

#![allow(unsafe_code)]

use super::output::Output;
use super::step::{AfterStep, Bound, Job, PoseKernel, TargetContext};
use super::steps::After;
use crate::abi::modules::DECODE;
use crate::abi::push::DecodePush;
use crate::error::Result;
use crate::plan::steps::PostMorphPass;
use ash::vk;

/// Output of float32 positions of an instance; see
/// [`MorphEngine::set_decode_target`](crate::MorphEngine::set_decode_target).
///
/// Vertices are in pose-buffer order, without padding:
/// [`PackedLayout::vertex_count`](crate::PackedLayout::vertex_count) in total.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecodeTarget {
    /// The output buffer, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Bytes per vertex, a multiple of 4; 12 if positions are contiguous.
    pub stride: u32,
    /// Bytes from a position to its normal, a multiple of 4 and at least 12; `None`: no normals. Normals are not
    /// normalised.
    pub normals: Option<u32>,
}

impl DecodeTarget {
    /// Contiguous positions from the start of the buffer.
    pub fn new(buffer: vk::Buffer) -> Self {
        Self { buffer, offset: 0, stride: 12, normals: None }
    }

    fn output(&self) -> Output {
        Output { buffer: self.buffer, offset: self.offset, stride: self.stride, second: self.normals }
    }
}

pub(crate) struct Decode {
    bound: Bound<PoseKernel>,
    push: DecodePush,
}

impl Decode {
    /// Sets the target of an instance.
    ///
    /// # Errors
    /// An invalid target; no memory. Nothing changes then.
    pub fn set(after: &mut After, context: &TargetContext<'_>, target: &DecodeTarget) -> Result<()> {
        let layout = &context.group.mesh.layout;
        let output = target.output();
        if target.normals.is_some() {
            context.check_normals("a decode target")?;
        }
        context.check("decoding")?;
        output.check("a decode target", layout, context.device)?;
        after.set(context, PostMorphPass::Decode, 1, vk::BufferUsageFlags::STORAGE_BUFFER, |lists| {
            let [units, offset] = context.scale();
            let (decoded, decoded_at) = output.range(layout);
            let bound = |frame| [context.poses(), lists.range(u64::from(frame)), decoded];
            let bound: Vec<_> = (0..context.frames).map(bound).collect();
            let push = DecodePush {
                units,
                offset,
                decoded_at,
                stride: target.stride / 4,
                normal_at: target.normals.unwrap_or(0) / 4,
                vertices: layout.vertex_count as u32,
                // The rest is of each dispatch.
                ..Default::default()
            };
            Ok(Self { bound: Bound::new(context, PoseKernel(&DECODE, context.pose()), &bound)?, push })
        })
    }
}

impl AfterStep for Decode {
    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job) {
        let pose_at = self.bound.pose_at(job);
        let push = DecodePush { pose_at, count: job.count, listed: job.is_listed.into(), ..self.push };
        // SAFETY: the caller's obligations; the list was made for this frame.
        unsafe { self.bound.dispatch(cmd, job, job.frame as usize, &push) };
    }
}
