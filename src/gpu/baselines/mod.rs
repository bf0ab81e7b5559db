//! The techniques that others published, each a path of its own, to be compared with ours: a file per technique.

pub(crate) mod attributes;
pub(crate) mod direct;
pub(crate) mod scatter;
pub(crate) mod vertex_store;

use super::device::Device;
use super::failed;
use crate::error::{Error, Result};
use crate::mesh::packed::DeltaFormat;
use crate::plan::{BatchSize, UpdateDesc, UpdatePath};
use ash::vk;
use attributes::Attributes;
use direct::Direct;
use scatter::Scatter;
use std::sync::Arc;
use vertex_store::VertexStore;

/// The pipelines of a baseline.
#[derive(Clone)]
pub(crate) enum Baseline {
    VertexStore(Arc<VertexStore>),
    Scatter(Arc<Scatter>),
    Direct(Arc<Direct>),
    Attributes(Arc<Attributes>),
}

impl Baseline {
    pub(crate) fn new(device: &Arc<Device>, desc: &UpdateDesc, format: DeltaFormat) -> Result<Self> {
        Ok(match (desc.path, desc.batch) {
            (UpdatePath::VertexStore, BatchSize::Targets(b)) => {
                Self::VertexStore(Arc::new(VertexStore::new(device, format, b)?))
            }
            (UpdatePath::DirectAttributes, BatchSize::Targets(b)) => {
                Self::Attributes(Arc::new(Attributes::new(device, format, b)?))
            }
            (UpdatePath::Scatter, _) => Self::Scatter(Arc::new(Scatter::new(device)?)),
            (UpdatePath::Direct, _) => Self::Direct(Arc::new(Direct::new(device, format)?)),
            (path, batch) => {
                return Err(Error::invalid(
                    format!("update path '{}' with batch size {batch} on a device", path.name()),
                    "use CpuCrowd for the path 'cpu'",
                ));
            }
        })
    }

    pub(crate) fn serves(&self, desc: &UpdateDesc, format: DeltaFormat) -> bool {
        match self {
            Self::VertexStore(k) => desc.path == UpdatePath::VertexStore && k.serves(format, desc.batch),
            Self::Attributes(k) => desc.path == UpdatePath::DirectAttributes && k.serves(format, desc.batch),
            Self::Scatter(_) => desc.path == UpdatePath::Scatter,
            Self::Direct(k) => desc.path == UpdatePath::Direct && k.serves(format),
        }
    }
}

/// The refusal to capture a pose that only draws evaluate, on a device that cannot.
fn no_capture(device: &Device, path: UpdatePath) -> Error {
    Error::Unsupported {
        path: path.name(),
        device: device.caps.name.clone(),
        reason: "its draws evaluate the pose, and to capture it the device needs VK_EXT_transform_feedback or the \
                 feature vertexPipelineStoresAndAtomics, enabled"
            .into(),
        remedy: "draw it, or use a path with pose buffers, such as 'compute'".into(),
    }
}

/// A storage buffer in a set.
#[derive(Clone, Copy)]
pub(crate) struct Bound {
    pub(crate) ty: vk::DescriptorType,
    pub(crate) buffer: vk::Buffer,
    pub(crate) offset: u64,
    pub(crate) size: u64,
}

impl Bound {
    pub(crate) fn new(buffer: vk::Buffer, offset: u64, size: u64) -> Self {
        Self { ty: vk::DescriptorType::STORAGE_BUFFER, buffer, offset, size }
    }

    /// Where it starts is said when the set is bound.
    pub(crate) fn dynamic(buffer: vk::Buffer, size: u64) -> Self {
        Self { ty: vk::DescriptorType::STORAGE_BUFFER_DYNAMIC, ..Self::new(buffer, 0, size) }
    }
}

/// Descriptor sets of one layout, destroyed together.
pub(crate) struct Sets {
    device: Arc<Device>,
    pool: vk::DescriptorPool,
    sets: Vec<vk::DescriptorSet>,
}

impl Sets {
    /// A set for each list of buffers, bound at 0, 1, …; all lists have the types of the first.
    pub(crate) fn new(device: &Arc<Device>, layout: vk::DescriptorSetLayout, bound: &[Vec<Bound>]) -> Result<Self> {
        let types = [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::STORAGE_BUFFER_DYNAMIC];
        let count = |ty| bound.iter().flatten().filter(|b| b.ty == ty).count() as u32;
        let sizes: Vec<_> = types
            .into_iter()
            .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count(ty) })
            .filter(|size| size.descriptor_count > 0)
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(bound.len() as u32).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool =
            unsafe { device.raw.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        let mut sets = Self { device: device.clone(), pool, sets: vec![] };
        let layouts = vec![layout; bound.len()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are ours; the pool has room for as many.
        sets.sets =
            unsafe { device.raw.allocate_descriptor_sets(&info) }.map_err(failed("vkAllocateDescriptorSets"))?;
        for (bound, set) in bound.iter().zip(&sets.sets) {
            let infos: Vec<[vk::DescriptorBufferInfo; 1]> = bound
                .iter()
                .map(|b| [vk::DescriptorBufferInfo { buffer: b.buffer, offset: b.offset, range: b.size }])
                .collect();
            let writes: Vec<_> = infos
                .iter()
                .zip(bound)
                .enumerate()
                .map(|(binding, (info, b))| {
                    vk::WriteDescriptorSet::default()
                        .dst_set(*set)
                        .dst_binding(binding as u32)
                        .descriptor_type(b.ty)
                        .buffer_info(info)
                })
                .collect();
            // SAFETY: the set is not in use yet; buffers and ranges are the crowd's and the mesh's own.
            unsafe { device.raw.update_descriptor_sets(&writes, &[]) };
        }
        Ok(sets)
    }

    pub(crate) fn get(&self, set: usize) -> vk::DescriptorSet {
        self.sets[set]
    }
}

impl Drop for Sets {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, with its sets, when the crowd is no longer in use by the device.
        unsafe { self.device.raw.destroy_descriptor_pool(self.pool, None) };
    }
}
