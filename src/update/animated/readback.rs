//! Where weights and plans are, for `headless` to read back.

use super::technique::{Animated, Group};
use crate::update::blocks::WIDTHS;
use ash::vk;

impl Animated {
    /// Work lists, arguments, and where those of each group of instances are: of the first group of the mesh.
    pub(crate) fn plan_buffers(&self) -> (vk::Buffer, vk::Buffer, Vec<PlanPlace>) {
        let Group { layout, work, control, .. } = &self.groups[0];
        let place = |group| PlanPlace {
            instances: layout.get(group),
            capacity: layout.push.capacity as usize,
            list: (u64::from(group) * layout.stride, layout.stride),
            arguments: std::array::from_fn(|width| (layout.arguments(group, width, 0), layout.push.chunks)),
        };
        (work.raw, control.raw, (0..layout.count()).map(place).collect())
    }

    /// The weights of an instance: buffer, offset, size.
    pub(crate) fn weights_of(&self, instance: u32) -> (vk::Buffer, u64, u64) {
        let push = &self.groups[0].layout.push;
        let (first, bytes) = (4 * u64::from(push.weights_at), 4 * u64::from(push.targets));
        (self.state.raw, first + u64::from(instance) * bytes, bytes)
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
