//! What a crowd on the path `blocks` has of its own: work lists, integer sums, and what each block holds.

use super::MeshBuffers;
use super::crowd::CrowdDesc;
use crate::abi::push::BlocksPush;
use crate::abi::worklist::{self, POSES_MAX};
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::blocks::{BlocksDispatch, BlocksKernel, GroupBuffers};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::pack::{POSE_FLOATS, PackedLayout};
use crate::plan::UpdateStats;
use crate::plan::blocks::{BlockState, ELEMENT_BYTES, ITEM_WORDS, Item, Planner, TILE, TILE_WORDS, TileBytes, Tiles};
use crate::plan::commands::{Command, CommandList};
use crate::plan::heads::Heads;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::ops::Range;
use std::sync::Arc;

pub(super) struct Blocks {
    kernel: Arc<BlocksKernel>,
    slots: u32,
    pub(super) planner: Planner,
    pub(super) list: CommandList,
    /// For kernels that take several instances at once.
    tiles: Option<Tiles>,
    ring: Ring,
    sums: Option<Buffer>,
    dispatches: Vec<BlocksDispatch>,
    /// For each frame in flight, one for each group of instances.
    sets: Sets,
    /// Instances that one descriptor set reaches.
    group: u32,
    push: BlocksPush,
}

/// Work lists in host-visible memory, one for each frame in flight: items, then elements (or tiles, then rows).
struct Ring {
    buffer: Buffer,
    /// Bytes of a frame's part.
    stride: u64,
    /// Index of the first element's first word.
    elements_at: usize,
}

/// How kernels load a work list: from a storage buffer, or as texels.
pub(super) const LIST_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw() | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw(),
);

/// The integer sums of all instances: stored as a storage buffer, loaded as one or as texels.
pub(super) fn sums_buffer(device: &Arc<Device>, bytes: u64) -> Result<Buffer> {
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER
        | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER
        | vk::BufferUsageFlags::TRANSFER_SRC;
    let location = MemoryLocation::GpuOnly;
    Buffer::new(device, &BufferDesc { name: "deltamorph integer sums", bytes, usage, location })
}

/// Sizes of a work list of items and elements: words before the elements, and bytes in all.
fn item_list_size(index: &BlockIndex, instances: u32) -> (u64, u64) {
    let item = (ITEM_WORDS + POSE_FLOATS * index.mask_words()) as u64;
    let elements = u64::from(instances) * (index.entry_count() * ELEMENT_BYTES) as u64;
    list_size(u64::from(instances) * index.count() as u64 * item, elements)
}

/// The same of tiles and rows.
fn tile_list_size(index: &BlockIndex, instances: u32) -> (u64, u64) {
    let tiles = u64::from(instances) * index.count() as u64;
    list_size(tiles * TILE_WORDS as u64, 4 * Tiles::words_max(index, instances as usize) as u64)
}

/// Instances of a group of which there are `most` at most: whole tiles, where there is more than one group.
pub(super) fn whole_tiles(most: u64, instances: u32) -> u32 {
    match most.min(instances.into()) as u32 {
        size if size < instances && size > TILE as u32 => size - size % TILE as u32,
        size => size,
    }
}

fn list_size(item_words: u64, element_bytes: u64) -> (u64, u64) {
    (item_words, (4 * item_words + element_bytes).max(16).next_multiple_of(256))
}

impl Blocks {
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        index: &Arc<BlockIndex>,
        kernel: Arc<BlocksKernel>,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
        let layout = &mesh.layout;
        let mut state = BlockState::new(desc.update, layout, index)?;
        if kernel.is_tiled() {
            state.write_whole_blocks();
        }
        let exact = state.exact();
        let (range, pose) = (device.caps.max_storage_range, layout.pose_bytes());
        let slots = desc.update.slots;
        let per_instance = pose * u64::from(slots);
        let group = whole_tiles((range / per_instance).min(POSES_MAX / u64::from(slots)), desc.instances);
        let too_much = |what: &str, bytes: u64, most: u64, remedy: &str| {
            let text =
                format!("{what} of mesh '{}' take {bytes} bytes, {} allows {most}", layout.name, device.caps.name);
            Err(Error::invalid(text, remedy))
        };
        if group == 0 {
            return too_much("the slots of one instance", per_instance, range, "use fewer slots, or split the mesh");
        }
        let (elements_at, stride) = match kernel.is_tiled() {
            true => tile_list_size(index, desc.instances),
            false => item_list_size(index, desc.instances),
        };
        if stride > range {
            let what = format!("the work lists of {} instances", desc.instances);
            return too_much(&what, stride, range, "make several crowds");
        }
        // Where rebuilt instances have pipelines of their own.
        let tiles =
            kernel.is_tiled().then(|| Tiles::new(index, desc.instances as usize, exact.is_none(), kernel.device()));
        let mut ring = Buffer::new(
            device,
            &BufferDesc {
                name: "deltamorph work lists",
                bytes: stride.saturating_mul(desc.frames_in_flight.into()),
                usage: LIST_USAGE,
                location: MemoryLocation::CpuToGpu,
            },
        )?;
        ring.mapped()?;
        let sums = match exact {
            Some(_) => Some(sums_buffer(device, pose * u64::from(desc.instances))?),
            None => None,
        };
        let lists = (0..u64::from(desc.frames_in_flight)).map(|frame| frame * stride);
        let firsts = (0..desc.instances).step_by(group as usize);
        let groups: Vec<GroupBuffers> = lists
            .flat_map(|list| firsts.clone().map(move |first| (list, first)))
            .map(|(list, first)| {
                let count = u64::from(group.min(desc.instances - first));
                let part = |buffer: &Buffer, each: u64| BufferRange {
                    buffer: buffer.raw,
                    offset: u64::from(first) * each,
                    size: count * each,
                };
                GroupBuffers {
                    asset: BufferRange { buffer: mesh.deltas.raw, offset: 0, size: asset_bytes(layout) },
                    list: BufferRange { buffer: ring.raw, offset: list, size: stride },
                    poses: part(poses, per_instance),
                    sums: sums.as_ref().map(|sums| part(sums, pose)),
                }
            })
            .collect();
        let sets = kernel.sets(&groups)?;
        let push = BlocksPush { elements_at: elements_at as u32, ..blocks_push(layout, index, slots, exact) };
        Ok(Self {
            kernel,
            slots,
            planner: Planner::new(index, state, desc.instances as usize),
            list: CommandList::new(desc.update.path),
            tiles,
            ring: Ring { buffer: ring, stride, elements_at: elements_at as usize },
            sums,
            dispatches: vec![],
            sets,
            group,
            push,
        })
    }

    pub(super) fn exact(&self) -> Option<ExactGrid> {
        self.planner.exact()
    }

    /// The integer sums of an instance: buffer and offset.
    #[cfg(feature = "headless")]
    pub(super) fn sums(&self, instance: u32, pose_bytes: u64) -> Option<(vk::Buffer, u64)> {
        self.sums.as_ref().map(|sums| (sums.raw, u64::from(instance) * pose_bytes))
    }

    pub(super) fn plan(&mut self, heads: &Heads, update: u64) -> UpdateStats {
        let mut stats = self.planner.plan(heads, update);
        if self.tiles.is_some() {
            // Instances share what tiles load: counted where they are made.
            (stats.bytes_moved, stats.bytes_floor) = (0, 0);
        }
        self.list.fill_blocks(&self.planner.list.items, self.sums.is_some());
        stats
    }

    /// Write the planned commands. Returns the bytes of deltas, lists and poses that tiles load and store, which the
    /// planner does not know.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&mut self, device: &Device, cmd: vk::CommandBuffer, frame: u64) -> Result<TileBytes> {
        let mut written = Written { frame, items: 0, elements: self.ring.elements_at, bytes: TileBytes::default() };
        // Instances of one group that no barrier parts go into the same dispatches.
        let mut pending: Option<(u32, Range<usize>)> = None;
        for i in 0..self.list.commands.len() {
            let next = match &self.list.commands[i] {
                Command::Blocks(blocks) => Some((blocks.instance / self.group, blocks.items.clone())),
                Command::Barrier(_) | Command::Pass(_) | Command::Scatter(_) | Command::Animated(_) => None,
            };
            match (&mut pending, next) {
                (Some((group, items)), Some((g, more))) if *group == g && items.end == more.start => {
                    items.end = more.end;
                    continue;
                }
                (_, next) => {
                    if let Some((group, items)) = std::mem::replace(&mut pending, next) {
                        // SAFETY: the caller's obligations.
                        unsafe { self.dispatch(cmd, group, items, &mut written) }?;
                    }
                }
            }
            if let Command::Barrier(hazard) = &self.list.commands[i] {
                // SAFETY: the caller's obligations.
                unsafe { barriers::record(&device.raw, cmd, *hazard) };
            }
        }
        Ok(written.bytes)
    }

    /// Dispatch items of one group. All that is dispatched is followed by a barrier, so that none is left over.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn dispatch(
        &mut self,
        cmd: vk::CommandBuffer,
        group: u32,
        items: Range<usize>,
        written: &mut Written,
    ) -> Result<()> {
        self.dispatches.clear();
        match self.tiles {
            Some(_) => self.write_tiles(items, written)?,
            None => self.write_items(items, written)?,
        }
        let groups = self.planner.states.len().div_ceil(self.group as usize);
        let set = self.sets.get(written.frame as usize * groups + group as usize);
        // SAFETY: the caller's obligations; set and list were written for this mesh and crowd.
        unsafe { self.kernel.record(cmd, set, &self.dispatches, self.push) };
        Ok(())
    }

    /// Write items and their elements to this frame's list; the update that used this part of the ring last has finished
    /// by contract.
    fn write_items(&mut self, range: Range<usize>, written: &mut Written) -> Result<()> {
        let (work, mask_words) = (&self.planner.list, POSE_FLOATS * self.planner.index.mask_words());
        let item_size = ITEM_WORDS + mask_words;
        let elements_at = self.ring.elements_at;
        let (items, elements) = self.ring.words(written.frame)?.split_at_mut(elements_at);
        let outs = items[written.items..].chunks_exact_mut(item_size);
        let masks = work.masks[range.start * mask_words..].chunks_exact(mask_words);
        self.dispatches.push(BlocksDispatch {
            pipeline: 0,
            items: range.len(),
            first_word: written.items,
            item_words: item_size,
        });
        written.items += range.len() * item_size;
        for ((item, masks), out) in work.items[range].iter().zip(masks).zip(outs) {
            let poses = poses(item, self.group, self.slots);
            let words = worklist::item(item.block, item.source.is_none(), poses, item.first, item.count);
            out[..ITEM_WORDS].copy_from_slice(&words);
            out[ITEM_WORDS..].copy_from_slice(masks);
            let (first, count) = (2 * item.first as usize, 2 * item.count as usize);
            let listed: &[u32] = bytemuck::cast_slice(work.elements_of(item));
            elements[first..first + count].copy_from_slice(listed);
        }
        Ok(())
    }

    /// The same of tiles and their rows.
    fn write_tiles(&mut self, range: Range<usize>, written: &mut Written) -> Result<()> {
        let (Some(tiles), planner) = (&mut self.tiles, &self.planner) else { return Ok(()) };
        tiles.clear();
        tiles.fill(&planner.index, &planner.list, range);
        written.bytes += tiles.bytes(&planner.index, self.sums.is_some());
        let words = self.ring.words(written.frame)?;
        let first_row = written.elements;
        words[first_row..first_row + tiles.rows.len()].copy_from_slice(&tiles.rows);
        written.elements += tiles.rows.len();
        for (apart, widths) in tiles.items.iter().enumerate() {
            for (width, tiles) in widths.iter().enumerate().filter(|(_, tiles)| !tiles.is_empty()) {
                self.dispatches.push(BlocksDispatch {
                    pipeline: self.kernel.pipeline_of(apart, width),
                    items: tiles.len(),
                    first_word: written.items,
                    item_words: TILE_WORDS,
                });
                for (tile, out) in tiles.iter().zip(words[written.items..].chunks_exact_mut(TILE_WORDS)) {
                    let head = [tile.block, first_row as u32 + tile.first, tile.count, tile.rebuilt];
                    let items = tile.items.iter().take(1 << width).map(|&i| &planner.list.items[i as usize]);
                    worklist::write_tile(out, head, items.map(|item| poses(item, self.group, self.slots)));
                }
                written.items += tiles.len() * TILE_WORDS;
            }
        }
        Ok(())
    }
}
impl Ring {
    /// A frame's part.
    fn words(&mut self, frame: u64) -> Result<&mut [u32]> {
        let (at, size) = ((frame * self.stride) as usize, self.stride as usize);
        Ok(bytemuck::cast_slice_mut(&mut self.buffer.mapped()?[at..at + size]))
    }
}

/// How far this update's list is written, in words, and what it moves.
struct Written {
    frame: u64,
    items: usize,
    elements: usize,
    bytes: TileBytes,
}

/// Source and destination of an item, as numbers of poses in a group of instances.
fn poses(item: &Item, group: u32, slots: u32) -> u32 {
    let pose = |slot: u32| item.instance % group * slots + slot;
    worklist::poses(pose(item.source.unwrap_or(item.destination)), pose(item.destination))
}

/// What kernels of blocks are told of a mesh and its poses.
pub(super) fn blocks_push(
    layout: &PackedLayout,
    index: &BlockIndex,
    slots: u32,
    exact: Option<ExactGrid>,
) -> BlocksPush {
    let step = exact.map_or(1.0, |grid| grid.weight_step());
    let ([position, normal], pose) = (index.steps(), layout.pose_bytes());
    BlocksPush {
        first_item: 0,
        elements_at: 0,
        deltas_at: index.deltas_at() as u32,
        base_at: (asset_bytes(layout) / 4 - pose / 4) as u32,
        pose_floats: (pose / 4) as u32,
        slots,
        position_unit: position * step,
        normal_unit: normal * step,
    }
}

/// Bytes of the buffer that holds headers, deltas and base pose.
pub(super) fn asset_bytes(layout: &PackedLayout) -> u64 {
    layout.index_bytes() + layout.delta_bytes() + layout.pose_bytes()
}
