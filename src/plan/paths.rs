//! The update paths of the library, and what is known of paths from outside.

use crate::pack::{DeltaFormat, PoseFormat};

/// Device requirements of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Needs {
    /// None beyond core Vulkan, or no device at all.
    Nothing,
    /// Workgroups of the kernels' size.
    Workgroups,
    /// VK_EXT_transform_feedback.
    TransformFeedback,
    /// The feature `vertexPipelineStoresAndAtomics`.
    VertexStores,
    /// Blending of RGBA float32 colours.
    FloatBlending,
}

/// Limit on the targets of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Batch {
    /// None.
    Any,
    /// As many as push constants hold; unlimited if all go in one pass.
    PushConstants,
    /// As many as there are vertex attributes.
    Attributes,
}

/// What the library has to know of an update path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PathRow {
    /// The name used on the command line and in reports.
    pub name: &'static str,
    /// One-line description.
    pub summary: &'static str,
    /// The delta formats it supports.
    pub formats: &'static [DeltaFormat],
    /// The pose formats it supports.
    pub poses: &'static [PoseFormat],
    /// Requirements of the device.
    pub needs: Needs,
    /// Limit on the targets of a pass.
    pub batch: Batch,
    /// Sums integers and converts them to float32 poses in a last pass; no error budget.
    pub sums_integers: bool,
    /// Updates all groups of a mesh, not only positions and normals.
    pub takes_groups: bool,
    /// Uploads meshes in an encoding of its own.
    pub has_own_upload: bool,
    /// Evaluates each pose from base: [`UpdateMode::Incremental`](super::UpdateMode) is not supported.
    pub rebuilds_only: bool,
    /// Every draw evaluates the pose, without pose buffers.
    pub evaluates_in_draws: bool,
}

impl PathRow {
    /// Compute passes over dense deltas.
    pub const fn new(name: &'static str, summary: &'static str) -> Self {
        Self {
            name,
            summary,
            formats: &DeltaFormat::DENSE,
            poses: &[PoseFormat::Float32],
            needs: Needs::Workgroups,
            batch: Batch::Any,
            sums_integers: false,
            takes_groups: true,
            has_own_upload: false,
            rebuilds_only: false,
            evaluates_in_draws: false,
        }
    }
}

/// How poses are updated: the technique and where it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum UpdatePath {
    /// Vertex passes with transform feedback and rasterizer discard (Jones, GPU Pro 5). A pass cannot read the buffer
    /// it writes, so passes alternate between two slots.
    Feedback,
    /// Compute passes. The first pass reads the current slot and writes the next; the others run in place.
    Compute,
    /// Compute, only for the blocks of vertices that changed targets affect: one workgroup per block. Takes block
    /// formats. The default choice on a GPU.
    Blocks,
    /// SIMD and threads, without Vulkan ([`CpuCrowd`](crate::CpuCrowd)). Takes every delta format; fixed-point poses
    /// with block formats only.
    Cpu,
    /// A technique from outside the library, such as a published one to compare with.
    #[doc(hidden)]
    Baseline(&'static PathRow),
}

impl UpdatePath {
    /// Every path of the library.
    pub const ALL: [Self; 4] = [Self::Feedback, Self::Compute, Self::Blocks, Self::Cpu];

    pub(crate) const fn row(self) -> &'static PathRow {
        match self {
            Self::Feedback => {
                const {
                    &PathRow {
                        needs: Needs::TransformFeedback,
                        batch: Batch::Attributes,
                        ..PathRow::new("feedback", "Vertex passes with transform feedback")
                    }
                }
            }
            Self::Compute => {
                const { &PathRow { batch: Batch::PushConstants, ..PathRow::new("compute", "Compute passes") } }
            }
            Self::Blocks => {
                const {
                    &PathRow {
                        formats: &DeltaFormat::BLOCKS,
                        poses: &PoseFormat::ALL,
                        ..PathRow::new("blocks", "Compute, only for the blocks of vertices that changed targets affect")
                    }
                }
            }
            Self::Cpu => {
                const {
                    &PathRow {
                        formats: &DeltaFormat::ALL,
                        poses: &PoseFormat::ALL,
                        needs: Needs::Nothing,
                        ..PathRow::new("cpu", "SIMD and threads, without Vulkan")
                    }
                }
            }
            Self::Baseline(row) => row,
        }
    }

    /// Whether it is a technique from outside the library. `bench` runs these only when named.
    #[doc(hidden)]
    pub const fn is_baseline(self) -> bool {
        matches!(self, Self::Baseline(_))
    }

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// One-line description, shown in the command line's help.
    #[doc(hidden)]
    pub const fn summary(self) -> &'static str {
        self.row().summary
    }

    /// Whether a pass may read and write the same slot; vertex passes may not.
    #[doc(hidden)]
    pub const fn works_in_place(self) -> bool {
        !matches!(self.row().needs, Needs::TransformFeedback | Needs::VertexStores)
    }

    /// Whether an update draws, so that its queue needs graphics.
    pub(crate) const fn draws_updates(self) -> bool {
        !self.works_in_place() || matches!(self.row().needs, Needs::FloatBlending)
    }

    /// Whether every draw evaluates the pose, without pose buffers.
    #[doc(hidden)]
    pub const fn evaluates_in_draws(self) -> bool {
        self.row().evaluates_in_draws
    }

    /// Whether it supports [`BatchSize::All`](super::BatchSize::All).
    #[doc(hidden)]
    pub const fn takes_all_targets(self) -> bool {
        !matches!(self.row().batch, Batch::Attributes)
    }

    /// The delta formats it supports.
    pub const fn formats(self) -> &'static [DeltaFormat] {
        self.row().formats
    }

    /// The pose formats it supports; fixed-point ones only with deltas in blocks.
    pub const fn poses(self) -> &'static [PoseFormat] {
        self.row().poses
    }
}
