//! The instance of a crowd for which a pass is made.

use crate::abi::numbers::PIECE;
use crate::gpu::device::Device;
use crate::gpu::pipelines::Kernels;
use crate::pack::PackedLayout;
use crate::update::technique::PoseGroup;
use std::sync::Arc;

pub(crate) struct TargetContext<'a> {
    pub device: &'a Arc<Device>,
    pub kernels: &'a Kernels,
    /// The groups of the mesh; the first is that of positions and normals.
    pub groups: &'a [PoseGroup],
    pub frames: u32,
    pub instance: u32,
}

impl TargetContext<'_> {
    pub(super) fn layout(&self) -> &PackedLayout {
        &self.groups[0].mesh.layout
    }

    /// Pieces of the mesh.
    pub(super) fn pieces(&self) -> u32 {
        (self.layout().vertex_count as u32).div_ceil(PIECE)
    }
}
