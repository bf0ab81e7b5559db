//! The techniques that others published, each a path of its own, to be compared with ours: a file per technique.

pub(crate) mod attributes;
pub(crate) mod direct;
pub(crate) mod scatter;
pub(crate) mod vertex_store;

use super::device::Device;
use crate::error::{Error, Result};
use crate::pack::DeltaFormat;
use crate::plan::{BatchSize, UpdateDesc, UpdatePath};
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
