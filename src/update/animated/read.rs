//! Reads back plans of the GPU.

use super::technique::{Animated, Group};
use crate::abi::worklist::{TILE_WORDS, WIDTHS};
use crate::error::Result;
use ash::vk;
use std::ops::Range;

/// The GPU's plan for a set of instances and a run of blocks, as in memory: see `glsl/plan.comp`.
#[derive(Clone, Debug)]
pub struct PlannedGroup {
    /// First instance of the set, and count.
    pub instances: (u32, u32),
    /// The blocks.
    pub blocks: Range<usize>,
    /// Number of items by width: 1, 2, 4, 8 instances.
    pub counts: [u32; WIDTHS],
    /// Capacity per width in items: the distance between the lists of two widths.
    pub capacity: usize,
    /// The work list: items of all widths, then rows.
    pub words: Vec<u32>,
}

impl Animated {
    /// The last update's plans of the first group; `read` takes buffer, offset and size.
    pub(crate) fn read_plan(
        &self,
        mut read: impl FnMut((vk::Buffer, u64, u64)) -> Result<Vec<u32>>,
    ) -> Result<Vec<PlannedGroup>> {
        let Group { layout, work, control, .. } = &self.groups[0];
        let plan = |list: u32| {
            let ((set, run), (offset, bytes)) = (layout.get(list), layout.place(list));
            let (words, capacity) = (read((work.raw, offset, bytes))?, layout.capacity(list) as usize);
            let mut counts = [0; WIDTHS];
            for (width, count) in (0..).zip(&mut counts) {
                let bytes = 12 * u64::from(layout.push.chunks);
                let arguments = read((control.raw, layout.arguments(list, width, 0), bytes))?;
                let workgroups: u32 = arguments.chunks_exact(3).map(|xyz| xyz[0]).sum();
                // Padding items have no rows.
                let rows = |item: u32| words[(width as usize * capacity + item as usize) * TILE_WORDS + 2];
                let items = 0..workgroups * layout.push.workgroup_items;
                *count = items.end - items.rev().take_while(|item| rows(*item) == 0).count() as u32;
            }
            Ok(PlannedGroup { instances: layout.instances(set), blocks: run.blocks.clone(), counts, capacity, words })
        };
        (0..layout.lists()).map(plan).collect()
    }

    /// The weights of an instance: buffer, offset, size.
    pub(crate) fn weights_of(&self, instance: u32) -> (vk::Buffer, u64, u64) {
        let push = &self.groups[0].layout.push;
        let (first, bytes) = (4 * u64::from(push.weights_at), 4 * u64::from(push.targets));
        (self.state.raw, first + u64::from(instance) * bytes, bytes)
    }
}
