//! Reads back plans of the GPU.

use deltamorph::internals::abi::push::AnimationPush;
use deltamorph::internals::abi::worklist::{TILE_WORDS, WIDTHS};
use deltamorph_headless::HeadlessCrowd;
use std::ops::Range;

/// The GPU's plan for a set of instances and a run of blocks, as in memory: see `glsl/plan.glsl`.
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

/// The last update's plans of the first group.
pub fn read_plan(crowd: &mut HeadlessCrowd<'_>) -> Vec<PlannedGroup> {
    let lists = crowd.crowd().animated().expect("a crowd that plays clips").groups[0].layout.lists();
    (0..lists).map(|list| read_list(crowd, list)).collect()
}

fn read_list(crowd: &mut HeadlessCrowd<'_>, list: u32) -> PlannedGroup {
    let group = &crowd.crowd().animated().expect("a crowd that plays clips").groups[0];
    let layout = &group.layout;
    let AnimationPush { chunks, workgroup_items, .. } = layout.push;
    let (set, run) = layout.get(list);
    let instances = layout.instances(set);
    let blocks = run.blocks.clone();
    let capacity = layout.capacity(list) as usize;
    let (offset, bytes) = layout.place(list);
    let work = (group.work.raw, offset, bytes);
    let arguments: [_; WIDTHS] = std::array::from_fn(|width| {
        (group.control.raw, layout.arguments(list, width as u32, 0), 12 * u64::from(chunks))
    });
    let words: Vec<u32> = crowd.read(work).expect("a work list");
    let mut counts = [0; WIDTHS];
    for (width, count) in counts.iter_mut().enumerate() {
        let arguments: Vec<u32> = crowd.read(arguments[width]).expect("arguments");
        let workgroups: u32 = arguments.chunks_exact(3).map(|xyz| xyz[0]).sum();
        // Padding items have no rows.
        let rows = |item: u32| words[(width * capacity + item as usize) * TILE_WORDS + 2];
        let items = 0..workgroups * workgroup_items;
        *count = items.end - items.rev().take_while(|item| rows(*item) == 0).count() as u32;
    }
    PlannedGroup { instances, blocks, counts, capacity, words }
}
