//! The list of update paths.

use crate::pack::{DeltaFormat, PoseFormat};

/// Device requirements of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Needs {
    /// None beyond core Vulkan, or no device at all.
    Nothing,
    /// Workgroups of the kernels' size.
    Workgroups,
    TransformFeedback,
    /// The feature `vertexPipelineStoresAndAtomics`.
    VertexStores,
    /// Blending of RGBA float32 colours.
    FloatBlending,
}

/// Limit on the targets of a pass.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Batch {
    /// None.
    Any,
    /// As many as push constants hold; unlimited if all go in one pass.
    PushConstants,
    /// As many as there are vertex attributes.
    Attributes,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct PathRow {
    baseline: bool,
    name: &'static str,
    summary: &'static str,
    formats: &'static [DeltaFormat],
    poses: &'static [PoseFormat],
    pub needs: Needs,
    pub batch: Batch,
    /// Sums integers and converts them to float32 poses in a last pass; no error budget.
    pub sums_integers: bool,
    /// Updates all groups of a mesh, not only positions and normals.
    pub takes_groups: bool,
    /// Uploads meshes in an encoding of its own.
    pub has_own_upload: bool,
    /// Evaluates each pose from base: [`UpdateMode::Incremental`](super::UpdateMode) is not supported.
    pub rebuilds_only: bool,
    evaluates_in_draws: bool,
}

impl PathRow {
    /// Defaults: compute passes over dense deltas.
    const fn ours(name: &'static str, summary: &'static str) -> Self {
        Self {
            baseline: false,
            name,
            summary: summary.trim_ascii(),
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

    const fn host(name: &'static str, summary: &'static str) -> Self {
        Self { needs: Needs::Nothing, ..Self::ours(name, summary) }
    }

    const fn baselines(name: &'static str, summary: &'static str) -> Self {
        Self { baseline: true, ..Self::ours(name, summary) }
    }
}

macro_rules! update_paths {
    ($($section:ident { $(
        #[doc = $summary:literal] $(#[doc = $more:literal])*
        $path:ident $name:literal { $($fields:tt)* };
    )* })*) => {
        /// How poses are updated: the technique and where it runs.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum UpdatePath {
            $($(#[doc = $summary] $(#[doc = $more])* $path,)*)*
        }

        /// Indexed by path.
        const ROWS: &[PathRow] =
            &[$($(PathRow { $($fields)*, ..PathRow::$section($name, $summary) }),*),*];

        impl UpdatePath {
            /// Every path.
            pub const ALL: [Self; ROWS.len()] = [$($(Self::$path),*),*];
        }
    };
}

// `ours`: the library's own techniques. `host`: no device. `baselines`: published techniques to compare with, linked
// only with the feature `baselines`. The first doc line of an item is its summary in the command line's help; then come
// its name and the `PathRow` fields that differ from its section's defaults. `update::technique` constructs the
// technique.
update_paths! {
    ours {
        /// Vertex passes with transform feedback
        ///
        /// Uses rasterizer discard (Jones, GPU Pro 5). A pass cannot read the buffer it writes, so passes alternate
        /// between two slots.
        Feedback "feedback" { needs: Needs::TransformFeedback, batch: Batch::Attributes };
        /// Compute passes
        ///
        /// The first pass reads the current slot and writes the next; the others run in place.
        Compute "compute" { batch: Batch::PushConstants };
        /// Compute, only for the blocks of vertices that changed targets affect
        ///
        /// One workgroup per block. Takes block formats. The default choice on a GPU.
        Blocks "blocks" { formats: &DeltaFormat::BLOCKS, poses: &PoseFormat::ALL };
    }
    host {
        /// SIMD and threads, without Vulkan
        ///
        /// Takes every delta format; fixed-point poses with block formats only.
        Cpu "cpu" { formats: &DeltaFormat::ALL, poses: &PoseFormat::ALL };
    }
    baselines {
        /// Baseline: like feedback, but the vertex shader stores the pose
        VertexStore "vertex-store" { needs: Needs::VertexStores, batch: Batch::Attributes };
        /// Baseline: one thread per delta, integer atomics, always from the base pose (O3DE, Unity)
        ///
        /// A last pass converts the sums to poses.
        Scatter "scatter" {
            formats: &[DeltaFormat::Small], has_own_upload: true, sums_integers: true,
            rebuilds_only: true, takes_groups: false
        };
        /// Baseline: each draw evaluates all active targets (Costigan et al., Bevy, three.js, Filament)
        ///
        /// No update is recorded: the vertex shader reads deltas from a storage buffer.
        Direct "direct" {
            needs: Needs::Nothing, evaluates_in_draws: true, rebuilds_only: true, takes_groups: false
        };
        /// Baseline: like direct, with the active targets as vertex attributes (Gerdelan)
        DirectAttributes "direct-attributes" {
            needs: Needs::Nothing, evaluates_in_draws: true, rebuilds_only: true, takes_groups: false,
            batch: Batch::Attributes
        };
        /// Baseline: deltas in textures, blended into displacement textures that draws fetch (Galanakis)
        ///
        /// A target is a few rectangles of float32 or 16-bit integer texels. Each is blended, scaled by the weight or
        /// delta weight, into float32 displacement textures, which draws fetch.
        Texture "texture" {
            needs: Needs::FloatBlending, has_own_upload: true, evaluates_in_draws: true
        };
    }
}

impl UpdatePath {
    pub(crate) const fn row(self) -> &'static PathRow {
        &ROWS[self as usize]
    }

    /// Whether it is a published technique, included for comparison. `bench` runs baselines only when named.
    #[doc(hidden)]
    pub const fn is_baseline(self) -> bool {
        self.row().baseline
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
