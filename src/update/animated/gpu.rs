//! The kernels that sample clips and plan updates: pipelines, sets, dispatches.

use super::steps::AnimatedKernel;
use crate::abi::modules;
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::AnimationPush;
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::pipelines::Objects;
use ash::vk;
use std::sync::Arc;

/// The pipelines; one of each, whatever mesh and crowd are.
pub(crate) struct AnimationKernel {
    objects: Objects,
}

impl Kernel for AnimationKernel {
    type Key = ();

    fn new(device: &Arc<Device>, (): ()) -> Result<Self> {
        let mut objects = Objects::none(device);
        let kernels = [modules::ANIMATE, modules::BUDGET, modules::COMMIT, modules::PLAN, modules::ARGUMENTS];
        objects.add_layout(&[kernels[0].kernel], 0)?;
        for module in kernels {
            let widest = [device.caps.tuning.widest_tile];
            objects.add_compute(module, &[&widest[..module.kernel.constants as usize]])?;
        }
        Ok(Self { objects })
    }

    fn key(&self) {}
}

impl AnimationKernel {
    /// A descriptor set for each group of instances, of its buffers in the order of the bindings.
    pub(crate) fn sets(&self, groups: &[[BufferRange; 4]]) -> Result<Sets> {
        self.objects.sets(groups)
    }

    /// Dispatch a kernel that samples or plans.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`sets`](Self::sets) and lives until the dispatch has run; its buffers hold what `push`
    ///   says.
    /// - There are no more `groups` than the device allows.
    pub(crate) unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        kernel: AnimatedKernel,
        set: vk::DescriptorSet,
        push: &AnimationPush,
        groups: [u32; 2],
    ) {
        let Objects { device, layout, pipelines, .. } = &self.objects;
        let (point, stage) = (vk::PipelineBindPoint::COMPUTE, vk::ShaderStageFlags::COMPUTE);
        // SAFETY: the caller's obligations; the push constants fill the layout's range.
        unsafe {
            device.raw.cmd_bind_pipeline(cmd, point, pipelines[kernel as usize]);
            device.raw.cmd_bind_descriptor_sets(cmd, point, *layout, 0, &[set], &[]);
            device.raw.cmd_push_constants(cmd, *layout, stage, 0, bytemuck::bytes_of(push));
            device.raw.cmd_dispatch(cmd, groups[0], groups[1], 1);
        }
    }

    /// Workgroups of `invocations`, in two dimensions where one does not hold them.
    pub(crate) fn groups(&self, invocations: u64) -> [u32; 2] {
        let groups = invocations.div_ceil(WORKGROUP.into()).max(1);
        let x = groups.min(self.objects.device.caps.max_workgroups.into());
        [x as u32, groups.div_ceil(x) as u32]
    }
}
