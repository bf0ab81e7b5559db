//! Barriers as data to Vulkan's. Nothing else calls vkCmdPipelineBarrier in the engine.

use crate::plan::schedule::Barrier;
use crate::plan::steps::{Access, Scope, Stage};
use ash::vk;

/// Record a global memory barrier.
///
/// # Safety
/// `cmd` is in the recording state, on `device`, outside a render pass; the device was created with the
/// extensions whose stages `barrier` names.
pub(crate) unsafe fn record(device: &ash::Device, cmd: vk::CommandBuffer, barrier: &Barrier) {
    let Barrier { before, after, .. } = *barrier;
    let memory = vk::MemoryBarrier::default().src_access_mask(accesses(before)).dst_access_mask(accesses(after));
    // SAFETY: the caller's obligations.
    unsafe {
        device.cmd_pipeline_barrier(
            cmd,
            stages(before),
            stages(after),
            vk::DependencyFlags::empty(),
            std::slice::from_ref(&memory),
            &[],
            &[],
        );
    }
}

fn stages(scope: Scope) -> vk::PipelineStageFlags {
    [
        (Stage::Transfer, vk::PipelineStageFlags::TRANSFER),
        (Stage::VertexInput, vk::PipelineStageFlags::VERTEX_INPUT),
        (Stage::VertexShader, vk::PipelineStageFlags::VERTEX_SHADER),
        (Stage::TransformFeedback, vk::PipelineStageFlags::TRANSFORM_FEEDBACK_EXT),
        (Stage::Compute, vk::PipelineStageFlags::COMPUTE_SHADER),
        (Stage::Indirect, vk::PipelineStageFlags::DRAW_INDIRECT),
    ]
    .into_iter()
    .filter(|(stage, _)| scope.has_stage(*stage))
    .fold(vk::PipelineStageFlags::empty(), |all, (_, flag)| all | flag)
}

fn accesses(scope: Scope) -> vk::AccessFlags {
    [
        (Access::TransferWrite, vk::AccessFlags::TRANSFER_WRITE),
        (Access::AttributeRead, vk::AccessFlags::VERTEX_ATTRIBUTE_READ),
        (Access::ShaderRead, vk::AccessFlags::SHADER_READ),
        (Access::ShaderWrite, vk::AccessFlags::SHADER_WRITE),
        (Access::FeedbackWrite, vk::AccessFlags::TRANSFORM_FEEDBACK_WRITE_EXT),
        (Access::IndirectRead, vk::AccessFlags::INDIRECT_COMMAND_READ),
        (Access::TransferRead, vk::AccessFlags::TRANSFER_READ),
    ]
    .into_iter()
    .filter(|(access, _)| scope.has_access(*access))
    .fold(vk::AccessFlags::empty(), |all, (_, flag)| all | flag)
}
