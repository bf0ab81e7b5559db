//! The blocks of a group on a device, planned by host or GPU: kernels for items or tiles of a work list, descriptor
//! sets and push constants.

use super::dispatch::Dispatching;
use crate::abi::modules::{BLOCKS, CROWD, CROWD_TEXELS, Module};
use crate::abi::push::BlocksPush;
use crate::abi::worklist::{ITEMS_MAX, POSES_MAX, TILE, WIDTHS};
use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::parts::AssetPart;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::gpu::statistics::MemoryKind;
use crate::pack::POSE_FLOATS;
use crate::pack::vertex::PlaceConstants;
use crate::update::technique::{Context, Poses};
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// A work list is loaded from a storage buffer or as texels.
pub(crate) const LIST_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw() | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw(),
);

/// Instances per descriptor set, at most `most`, limited by the storage range and the 16-bit pose numbers. Whole tiles,
/// if there are several sets.
///
/// # Errors
/// Not even one instance fits.
pub(crate) fn set_size(context: &Context<'_>, most: u64) -> Result<u32> {
    let (poses, range) = (context.poses, context.caps().max_storage_range);
    let each = poses.range_bytes(1) - poses.lead;
    context.check_range("the slots of one instance", poses.range_bytes(1), "use fewer slots, or split the mesh")?;
    let instances = context.desc.instances;
    Ok(
        match ((range - poses.lead) / each).min(POSES_MAX / u64::from(poses.slots)).min(most).min(instances.into())
            as u32
        {
            size if size < instances && size > TILE as u32 => size - size % TILE as u32,
            size => size,
        },
    )
}

pub(crate) struct Workgroup {
    /// Processes tiles of instances.
    tiles: bool,
    /// Loads asset and work list as texels.
    texels: bool,
    lanes: u32,
    pub(crate) items: u32,
}

/// The workgroup of the kernels of a crowd of `instances`.
///
/// # Errors
/// A mesh in a dense format.
pub(crate) fn workgroup(context: &Context<'_>, instances: u32) -> Result<Workgroup> {
    let (index, caps) = (context.layout().index()?, context.caps());
    // Tiles have at least one row, of some entry; masks are for float32 poses only.
    let (entries, size) = (index.entry_count() > 0, index.size() as u32);
    // Texel kernels access engine-owned poses; a host's buffer may lack the usage.
    let bound_as_texels = context.poses.usage.contains(vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER);
    let texels = entries && bound_as_texels && caps.takes_texels(context.layout().format);
    let integers = context.desc.update.pose.has_integers();
    let tiles = entries && (texels || instances > 1 || !caps.tuning.masks) || integers;
    let items = if tiles && !texels { (caps.tuning.lanes / size).clamp(1, ITEMS_MAX) } else { 1 };
    // With texels, an invocation processes eight vertices, or four of a block of 32.
    Ok(Workgroup { tiles, texels, lanes: if texels { (size / 8).max(8) } else { size * items }, items })
}

/// Key of the pipeline of a module and block size; two pipelines if tiles that start from the base pose differ.
#[derive(Clone, Copy, PartialEq)]
struct BlocksKey {
    module: &'static Module,
    size: u32,
    lanes: u32,
    width: u32,
    few_registers: bool,
    /// Rounds sums, and not products.
    rounds_sums: bool,
    /// Component offsets in host vertices.
    places: Option<PlaceConstants>,
}

impl PipelineKey for BlocksKey {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { module, size, lanes, width, few_registers, rounds_sums, places } = self;
        objects.add_layout(&[module.kernel], 0)?;
        let sums = 2 * u32::from(rounds_sums);
        let own = [0, 1].map(|rebuilt| [lanes, size, 1 << width, rebuilt + sums, few_registers.into()]);
        let count = module.kernel.constants as usize;
        // Kernels of items with masks have no width and none of these constants.
        let own = if count > 2 { &own[..] } else { &own[..1] };
        let places = places.as_ref().map_or(&[][..], |places| places);
        let constants: Vec<Vec<u32>> = own.iter().map(|own| [&own[..count], places].concat()).collect();
        objects.add_compute(module, &constants.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }
}

/// The kernels of a crowd: one for single items, or one per tile width.
pub(crate) struct BlocksKernels {
    pub(super) how: Dispatching,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
}

impl BlocksKernels {
    /// Kernels for crowds of `instances`, of which a descriptor set reaches `group`.
    ///
    /// # Errors
    /// No kernel for the formats; Vulkan errors.
    pub(crate) fn new(context: &Context<'_>, instances: u32, group: u32) -> Result<Self> {
        let (format, pose, tuning) = (context.layout().format, context.desc.update.pose, context.caps().tuning);
        let Workgroup { tiles, texels, lanes, items } = workgroup(context, instances)?;
        let kernel = match (tiles, texels) {
            (false, _) => &BLOCKS,
            (true, false) => &CROWD,
            (true, true) => &CROWD_TEXELS,
        };
        let widths = if tiles { instances.clamp(1, tuning.widest_tile).ilog2() + 1 } else { 0 };
        let (module, size) = (kernel.module(format.row(), pose.row(), 0)?, context.layout().index()?.size() as u32);
        let (few_registers, places) = (tuning.few_registers, context.poses.place_constants());
        let rounds_sums = pose.row().rounds_sums;
        let key = |width| BlocksKey { module, size, lanes, width, few_registers, rounds_sums, places };
        let kernel = |width| context.kernels.get(key(width));
        let how = Dispatching { group, widths, tuning, most: context.caps().max_workgroups, items, texels };
        Ok(Self { how, kernels: (0..widths.max(1)).map(kernel).collect::<Result<_>>()? })
    }
}

/// Contents of a descriptor set.
pub(crate) struct Bound {
    /// Index of the asset part.
    pub(crate) part: usize,
    pub(crate) list: BufferRange,
    /// First instance, and count.
    pub(crate) instances: (u32, u32),
}

pub(crate) struct GroupBlocks {
    pub(crate) how: Dispatching,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
    pub(super) poses: Poses,
    /// For a mesh without entries: one that moves nothing, for the row that tiles need.
    _no_entry: Option<Buffer>,
    sets: Sets,
    pushes: Vec<BlocksPush>,
}

impl GroupBlocks {
    /// `elements_at`: first word of elements or rows in work lists.
    pub(crate) fn new(
        context: &Context<'_>,
        BlocksKernels { how, kernels }: BlocksKernels,
        bound: &[Bound],
        elements_at: usize,
    ) -> Result<Self> {
        let (poses, index) = (context.poses, context.layout().index()?);
        let [position, normal] = index.steps();
        let [position_dropped, normal_dropped] = poses.grid.map_or([0; TRIPLES], |grid| grid.dropped);
        let push = |part: &AssetPart| {
            let [headers_at, deltas_at, base_at] = part.origins;
            BlocksPush {
                first_item: 0,
                elements_at: elements_at as u32,
                headers_at,
                deltas_at,
                base_at,
                pose_floats: poses.numbers(),
                position_unit: position,
                normal_unit: normal,
                position_dropped,
                normal_dropped,
            }
        };
        // Zeros, as many words as the largest entry has.
        let no_entry = || {
            let (bytes, usage) = (index.size() * POSE_FLOATS * size_of::<f32>(), vk::BufferUsageFlags::STORAGE_BUFFER);
            let mut buffer =
                Buffer::new(context.device, "deltamorph no entry", bytes as u64, usage, MemoryKind::Lists)?;
            buffer.mapped()?.fill(0);
            Ok::<_, Error>(buffer)
        };
        let no_entry = (how.widths > 0 && index.entry_count() == 0).then(no_entry).transpose()?;
        let parts = &context.mesh.parts;
        let ranges = |&Bound { part, list, instances: (first, count) }: &Bound| {
            let asset = match &no_entry {
                Some(entry) => BufferRange::new(entry.raw, 0, vk::WHOLE_SIZE),
                None => parts[part].range(context.mesh.deltas.raw),
            };
            // With texels, poses are bound twice, for stores and loads.
            let poses = std::iter::repeat_n(poses.range(first, count), if how.texels { 2 } else { 1 });
            [asset, list].into_iter().chain(poses).collect::<Vec<_>>()
        };
        let sets = kernels[0].objects.sets(&bound.iter().map(ranges).collect::<Vec<_>>())?;
        let pushes = bound.iter().map(|bound| push(&parts[bound.part])).collect();
        Ok(Self { how, kernels, poses, _no_entry: no_entry, sets, pushes })
    }

    /// Records a dispatch of kernel `kernel` (log2 width; plus [`WIDTHS`] for tiles that start from the base pose) with
    /// set `set`, for the items from word `first_item` of its work list on.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - The group, its mesh and its poses live until the dispatch has finished. The list is complete by then, and
    ///   names only existing slots, and blocks and entries of the part.
    /// - `workgroups` is within the device limit.
    pub(crate) unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        set: usize,
        kernel: usize,
        first_item: u32,
        workgroups: Workgroups,
    ) {
        let (width, rebuilt) = (kernel % WIDTHS, kernel / WIDTHS);
        let (set, push) = (self.sets.get(set), BlocksPush { first_item, ..self.pushes[set] });
        // SAFETY: the caller's obligations; the layout of the set is the same for all kernels of a module, and the push
        // constants fill its range.
        unsafe { self.kernels[width].objects.dispatch(cmd, rebuilt, (set, &[]), bytes_of(&push), workgroups) };
    }
}
