//! Records barriers, which are data elsewhere. No other file of the engine calls vkCmdPipelineBarrier.

use crate::plan::schedule::Barrier;
use crate::plan::steps::Scope;
use ash::vk;

/// Records a global memory barrier.
///
/// # Safety
/// `cmd` is in the recording state, on `device`, outside a render pass; the device was created with the
/// extensions whose stages `barrier` names.
pub unsafe fn record(device: &ash::Device, cmd: vk::CommandBuffer, barrier: &Barrier) {
    let Barrier { before, after } = *barrier;
    let memory = vk::MemoryBarrier::default().src_access_mask(accesses(before)).dst_access_mask(accesses(after));
    let flags = vk::DependencyFlags::empty();
    // SAFETY: the caller's obligations.
    unsafe { device.cmd_pipeline_barrier(cmd, stages(before), stages(after), flags, &[memory], &[], &[]) };
}

/// Records the barrier after copies to host memory: makes them visible to the host, and has the stages of `writers`
/// wait before they overwrite the source.
///
/// # Safety
/// See [`record`].
pub unsafe fn record_read_back(device: &ash::Device, cmd: vk::CommandBuffer, writers: Scope) {
    use vk::{AccessFlags as A, PipelineStageFlags as S};
    let before = Scope { stages: S::TRANSFER.as_raw(), accesses: A::TRANSFER_WRITE.as_raw() };
    let after = Scope { stages: writers.stages | S::HOST.as_raw(), accesses: A::HOST_READ.as_raw() };
    // SAFETY: the caller's obligations.
    unsafe { record(device, cmd, &Barrier { before, after }) };
}

fn stages(scope: Scope) -> vk::PipelineStageFlags {
    match scope.stages {
        u32::MAX => vk::PipelineStageFlags::ALL_COMMANDS,
        stages => vk::PipelineStageFlags::from_raw(stages),
    }
}

fn accesses(scope: Scope) -> vk::AccessFlags {
    match scope.accesses {
        u32::MAX => vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE,
        accesses => vk::AccessFlags::from_raw(accesses),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Consumers;
    use crate::plan::steps::{Resource, Use};

    /// The stages and accesses of each consumer in Vulkan.
    #[test]
    fn consumers_have_stages_and_accesses() {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        for (consumer, stage, access) in [
            (Consumers::VERTEX_ATTRIBUTES, Stage::VERTEX_INPUT, Access::VERTEX_ATTRIBUTE_READ),
            (Consumers::VERTEX_SHADERS, Stage::VERTEX_SHADER, Access::SHADER_READ),
            (Consumers::MESH_SHADERS, Stage::TASK_SHADER_EXT | Stage::MESH_SHADER_EXT, Access::SHADER_READ),
            (Consumers::FRAGMENT_SHADERS, Stage::FRAGMENT_SHADER, Access::SHADER_READ),
            (Consumers::COMPUTE_SHADERS, Stage::COMPUTE_SHADER, Access::SHADER_READ),
            (Consumers::RAY_TRACING_SHADERS, Stage::RAY_TRACING_SHADER_KHR, Access::SHADER_READ),
            // Vulkan reads the vertices of a build as shaders do.
            (Consumers::ACCELERATION_STRUCTURES, Stage::ACCELERATION_STRUCTURE_BUILD_KHR, Access::SHADER_READ),
            (Consumers::COPIES, Stage::TRANSFER, Access::TRANSFER_READ),
        ] {
            let scope = consumer.uses(Resource::Poses).map(|used: Use| used.scope()).reduce(|a, b| a | b);
            let scope = scope.expect("a use");
            assert_eq!((stages(scope), accesses(scope)), (stage, access));
        }
        let anything = (Stage::ALL_COMMANDS, Access::MEMORY_READ | Access::MEMORY_WRITE);
        assert_eq!((stages(Scope::ANYTHING), accesses(Scope::ANYTHING)), anything);
    }
}
