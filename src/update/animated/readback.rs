//! Weights and plans of the GPU, read back by `headless`.

use super::technique::{Animated, Group};
use crate::error::Result;
use crate::update::blocks::WIDTHS;
use ash::vk;

/// What the GPU planned for a group of instances, as it lies in memory: see `glsl/plan.comp`.
#[doc(hidden)]
#[derive(Clone, Debug)]
pub struct PlannedGroup {
    /// First instance of the group, and how many it has.
    pub instances: (u32, u32),
    /// Items of each width: 1, 2, 4, 8 instances.
    pub counts: [u32; WIDTHS],
    /// Items of a width that there is room for: where the next width's begin.
    pub capacity: usize,
    /// The work list: items of all widths, then rows.
    pub words: Vec<u32>,
}

impl Animated {
    /// What the last update planned for the first group of the mesh, by `read`, which takes buffer, offset and size.
    pub(crate) fn read_plan(
        &self,
        mut read: impl FnMut((vk::Buffer, u64, u64)) -> Result<Vec<u32>>,
    ) -> Result<Vec<PlannedGroup>> {
        let Group { layout, work, control, .. } = &self.groups[0];
        let plan = |group: u32| {
            let mut counts = [0; WIDTHS];
            for (width, count) in counts.iter_mut().enumerate() {
                let bytes = 12 * u64::from(layout.push.chunks);
                let arguments = read((control.raw, layout.arguments(group, width, 0), bytes))?;
                *count = arguments.chunks_exact(3).map(|xyz| xyz[0]).sum();
            }
            let words = read((work.raw, u64::from(group) * layout.stride, layout.stride))?;
            Ok(PlannedGroup { instances: layout.get(group), counts, capacity: layout.push.capacity as usize, words })
        };
        (0..layout.count()).map(plan).collect()
    }

    /// The weights of an instance: buffer, offset, size.
    pub(crate) fn weights_of(&self, instance: u32) -> (vk::Buffer, u64, u64) {
        let push = &self.groups[0].layout.push;
        let (first, bytes) = (4 * u64::from(push.weights_at), 4 * u64::from(push.targets));
        (self.state.raw, first + u64::from(instance) * bytes, bytes)
    }
}
