//! What a crowd on the path `blocks` has of its own: work lists, integer sums, and what each block holds.

use super::MeshBuffers;
use super::crowd::CrowdDesc;
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::blocks::{BlockSets, BlocksKernel, BufferRange, GroupBuffers};
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::gpu::shaders::BlocksPush;
use crate::mesh::packed::blocks::{BlockIndex, ExactGrid};
use crate::mesh::packed::{POSE_FLOATS, PackedLayout};
use crate::plan::UpdateStats;
use crate::plan::blocks::{BlockState, ELEMENT_BYTES, ITEM_WORDS, Item, Planner};
use crate::plan::commands::{Command, CommandList};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::ops::Range;
use std::sync::Arc;

/// Poses are named by 16 bits in the work list.
const POSES_MAX: u64 = 1 << 16;
/// Set in an item's first word when it starts from the base pose.
const REBUILT: u32 = 1 << 31;

pub(super) struct Blocks {
    kernel: Arc<BlocksKernel>,
    slots: u32,
    pub(super) planner: Planner,
    pub(super) list: CommandList,
    ring: Ring,
    sums: Option<Buffer>,
    sets: BlockSets,
    /// Instances that one descriptor set reaches.
    group: u32,
    push: BlocksPush,
}

/// Work lists in host-visible memory, one for each frame in flight: items, then elements.
struct Ring {
    buffer: Buffer,
    /// Bytes of a frame's part.
    stride: u64,
    /// Index of the first element's first word.
    elements_at: usize,
}

/// Sizes of a work list: words before the elements, and bytes in all.
fn list_size(index: &BlockIndex, instances: u32) -> (u64, u64) {
    let item = 4 * (ITEM_WORDS + POSE_FLOATS * index.mask_words()) as u64;
    let items = u64::from(instances) * index.count() as u64 * item;
    let elements = u64::from(instances) * (index.entry_count() * ELEMENT_BYTES) as u64;
    (items / 4, (items + elements).max(16).next_multiple_of(256))
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
        if kernel.is_straight() {
            state.write_whole_blocks();
        }
        let exact = state.exact();
        let (range, pose) = (device.caps.max_storage_range, layout.pose_bytes());
        let slots = desc.update.slots;
        let per_instance = pose * u64::from(slots);
        let group = (range / per_instance).min(POSES_MAX / u64::from(slots)).min(desc.instances.into()) as u32;
        let too_much = |what: &str, bytes: u64, most: u64, remedy: &str| {
            let text =
                format!("{what} of mesh '{}' take {bytes} bytes, {} allows {most}", layout.name, device.caps.name);
            Err(Error::invalid(text, remedy))
        };
        if group == 0 {
            return too_much("the slots of one instance", per_instance, range, "use fewer slots, or split the mesh");
        }
        let (elements_at, stride) = list_size(index, desc.instances);
        if stride > range {
            let what = format!("the work lists of {} instances", desc.instances);
            return too_much(&what, stride, range, "make several crowds");
        }
        let bytes = stride.saturating_mul(desc.frames_in_flight.into());
        if bytes > u32::MAX.into() {
            let what = format!("the work lists of {} frames in flight", desc.frames_in_flight);
            return too_much(&what, bytes, u32::MAX.into(), "use fewer frames in flight, or several crowds");
        }
        let buffer = |name, bytes, location| {
            let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_SRC;
            Buffer::new(device, &BufferDesc { name, bytes, usage, location })
        };
        let mut ring = buffer("deltamorph work lists", bytes, MemoryLocation::CpuToGpu)?;
        ring.mapped()?;
        let sums = match exact {
            Some(_) => {
                let bytes = pose * u64::from(desc.instances);
                Some(buffer("deltamorph integer sums", bytes, MemoryLocation::GpuOnly)?)
            }
            None => None,
        };
        let groups: Vec<GroupBuffers> = (0..desc.instances)
            .step_by(group as usize)
            .map(|first| {
                let count = u64::from(group.min(desc.instances - first));
                let part = |buffer: &Buffer, each: u64| BufferRange {
                    buffer: buffer.raw,
                    offset: u64::from(first) * each,
                    size: count * each,
                };
                GroupBuffers {
                    asset: BufferRange { buffer: mesh.deltas.raw, offset: 0, size: asset_bytes(layout) },
                    list: BufferRange { buffer: ring.raw, offset: 0, size: stride },
                    poses: part(poses, per_instance),
                    sums: sums.as_ref().map(|sums| part(sums, pose)),
                }
            })
            .collect();
        let sets = BlockSets::new(&kernel, &groups)?;
        let step = exact.map_or(1.0, |grid| grid.weight_step());
        let [position, normal] = index.steps();
        let push = BlocksPush {
            first_item: 0,
            elements_at: elements_at as u32,
            deltas_at: index.deltas_at() as u32,
            base_at: (asset_bytes(layout) / 4 - pose / 4) as u32,
            pose_floats: (pose / 4) as u32,
            slots,
            position_unit: position * step,
            normal_unit: normal * step,
        };
        Ok(Self {
            kernel,
            slots,
            planner: Planner::new(index, state, desc.instances as usize),
            list: CommandList::new(desc.update.path),
            ring: Ring { buffer: ring, stride, elements_at: elements_at as usize },
            sums,
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

    pub(super) fn plan(&mut self, weights: &[Vec<f32>], update: u64) -> UpdateStats {
        let stats = self.planner.plan(weights, update);
        self.list.fill_blocks(&self.planner.list.items, self.sums.is_some());
        stats
    }

    /// Write the planned commands.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&mut self, device: &Device, cmd: vk::CommandBuffer, frame: u64) -> Result<()> {
        if self.list.commands.is_empty() {
            return Ok(());
        }
        self.write_list(frame)?;
        let list = (frame * self.ring.stride) as u32;
        let item_words = ITEM_WORDS + POSE_FLOATS * self.planner.index.mask_words();
        // Instances of one group that no barrier parts go into one dispatch, or two.
        let mut pending: Option<(u32, Range<usize>)> = None;
        let flush = |pending: &mut Option<(u32, Range<usize>)>| {
            if let Some((group, items)) = pending.take() {
                let set = self.sets.get(group as usize);
                let items = self.places(items);
                // SAFETY: the caller's obligations; set and list were written for this mesh and crowd.
                unsafe { self.kernel.record(cmd, set, list, items, item_words, self.push) };
            }
        };
        for command in &self.list.commands {
            match command {
                Command::Barrier(hazard) => {
                    flush(&mut pending);
                    // SAFETY: the caller's obligations.
                    unsafe { barriers::record(&device.raw, cmd, *hazard) };
                }
                Command::Blocks(blocks) => {
                    let group = blocks.instance / self.group;
                    match &mut pending {
                        Some((g, items)) if *g == group && items.end == blocks.items.start => {
                            items.end = blocks.items.end;
                        }
                        _ => {
                            flush(&mut pending);
                            pending = Some((group, blocks.items.clone()));
                        }
                    }
                }
                Command::Pass(_) | Command::Scatter(_) => {}
            }
        }
        flush(&mut pending);
        Ok(())
    }

    /// Where the items of a range are in the list: those that are not apart come first.
    fn places(&self, items: Range<usize>) -> [Range<usize>; 2] {
        let straight = self.kernel.is_straight();
        let apart = |items: &[Item]| items.iter().filter(|item| is_apart(item, straight)).count();
        let all = &self.planner.list.items;
        let (before, within) = (apart(&all[..items.start]), apart(&all[items.clone()]));
        let first = all.len() - apart(all) + before;
        [items.start - before..items.end - before - within, first..first + within]
    }

    /// Write this frame's work list; the update that used this part of the ring last has finished by contract.
    fn write_list(&mut self, frame: u64) -> Result<()> {
        let mask_words = POSE_FLOATS * self.planner.index.mask_words();
        let (at, size) = ((frame * self.ring.stride) as usize, self.ring.stride as usize);
        let words: &mut [u32] = bytemuck::cast_slice_mut(&mut self.ring.buffer.mapped()?[at..at + size]);
        let (items, elements) = words.split_at_mut(self.ring.elements_at);
        let (work, straight) = (&self.planner.list, self.kernel.is_straight());
        let mut places = [0, work.items.iter().filter(|item| !is_apart(item, straight)).count()];
        for (item, masks) in work.items.iter().zip(work.masks.chunks_exact(mask_words)) {
            let place = &mut places[usize::from(is_apart(item, straight))];
            let out = &mut items[*place * (ITEM_WORDS + mask_words)..][..ITEM_WORDS + mask_words];
            *place += 1;
            out[..ITEM_WORDS].copy_from_slice(&item_words(item, self.group, self.slots));
            out[ITEM_WORDS..].copy_from_slice(masks);
            let (first, count) = (2 * item.first as usize, 2 * item.count as usize);
            let listed: &[u32] = bytemuck::cast_slice(work.elements_of(item));
            elements[first..first + count].copy_from_slice(listed);
        }
        Ok(())
    }
}

/// Whether an item lies in the second part of the list.
fn is_apart(item: &Item, straight: bool) -> bool {
    straight && item.source.is_none()
}

/// An item as `blocks.comp` reads it.
fn item_words(item: &Item, group: u32, slots: u32) -> [u32; ITEM_WORDS] {
    let pose = |slot: u32| item.instance % group * slots + slot;
    let source = pose(item.source.unwrap_or(item.destination));
    let rebuilt = if item.source.is_none() { REBUILT } else { 0 };
    [item.block | rebuilt, source | pose(item.destination) << 16, item.first, item.count]
}

/// Bytes of the buffer that holds headers, deltas and base pose.
pub(super) fn asset_bytes(layout: &PackedLayout) -> u64 {
    layout.index_bytes() + layout.delta_bytes() + layout.pose_bytes()
}
