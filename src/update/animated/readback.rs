//! Where weights and plans are, for `headless` to read back.

use super::technique::{Animated, Group};
use crate::update::blocks::WIDTHS;
use ash::vk;

impl Animated {
    /// Work lists, arguments, and where those of each group of instances are: of the first group of the mesh.
    pub(crate) fn plan_buffers(&self) -> (vk::Buffer, vk::Buffer, Vec<PlanPlace>) {
        let groups = &self.layout().of_groups[0].groups;
        let place = |group| PlanPlace {
            instances: groups.get(group),
            capacity: groups.capacity as usize,
            list: (u64::from(group) * groups.stride, groups.stride),
            arguments: std::array::from_fn(|width| (groups.arguments(group, width, 0), groups.chunks)),
        };
        let Group { work, control, .. } = &self.groups[0];
        (work.raw, control.raw, (0..groups.count()).map(place).collect())
    }

    /// The weights of an instance: buffer, offset, size.
    pub(crate) fn weights_of(&self, instance: u32) -> (vk::Buffer, u64, u64) {
        let (offset, size) = self.layout().weights_of(instance);
        (self.state.raw, offset, size)
    }
}

/// Where a group's plan is.
pub(crate) struct PlanPlace {
    pub(crate) instances: (u32, u32),
    pub(crate) capacity: usize,
    /// Offset and bytes.
    pub(crate) list: (u64, u64),
    /// Of each width: the offset of the first dispatch's arguments, and how many dispatches there are.
    pub(crate) arguments: [(u64, u32); WIDTHS],
}
