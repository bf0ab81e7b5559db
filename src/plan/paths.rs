//! The update paths: the one list of them.

use crate::pack::{DeltaFormat, PoseFormat};

/// What a path needs of a device.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Needs {
    /// No device, or no more than any has.
    Nothing,
    /// Workgroups as large as the kernels'.
    Workgroups,
    /// VK_EXT_transform_feedback.
    TransformFeedback,
    /// The feature `vertexPipelineStoresAndAtomics`.
    VertexStores,
    /// Blending of colours of four float32.
    FloatBlending,
}

/// How many targets a pass takes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Batch {
    /// Any number.
    Any,
    /// As many as push constants hold, or any number in one pass.
    PushConstants,
    /// As many as there are vertex attributes for.
    Attributes,
}

/// A path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathRow {
    baseline: bool,
    name: &'static str,
    summary: &'static str,
    formats: &'static [DeltaFormat],
    /// The pose formats that it takes.
    poses: &'static [PoseFormat],
    pub(crate) needs: Needs,
    pub(crate) batch: Batch,
    /// It sums integers, which a last pass makes float32 poses of, and has no error budget.
    pub(crate) sums_integers: bool,
    /// It updates all groups of a mesh, not only positions and normals.
    pub(crate) takes_groups: bool,
    /// Its meshes are uploaded in words of their own.
    pub(crate) has_own_upload: bool,
    rebuilds_only: bool,
    evaluates_in_draws: bool,
}

impl PathRow {
    /// Compute passes over dense deltas.
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
        /// Who carries the passes out.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum UpdatePath {
            $($(#[doc = $summary] $(#[doc = $more])* $path,)*)*
        }

        /// By path.
        const ROWS: &[PathRow] =
            &[$($(PathRow { $($fields)*, ..PathRow::$section($name, $summary) }),*),*];

        impl UpdatePath {
            /// Every path.
            pub const ALL: [Self; ROWS.len()] = [$($(Self::$path),*),*];
        }
    };
}

// Paths whose technique is ours, those that take no device, and those of others, which are linked with the feature
// `baselines` only. An item is the documentation of an `UpdatePath`, whose first line the command line shows; its name;
// and the fields of its `PathRow` that are not what its section states. `update::technique` makes the technique.
update_paths! {
    ours {
        /// Vertex passes with transform feedback
        ///
        /// With rasterizer discard (Jones, GPU Pro 5). A pass cannot read the buffer it writes: passes alternate
        /// between two slots.
        Feedback "feedback" { needs: Needs::TransformFeedback, batch: Batch::Attributes };
        /// Compute passes
        ///
        /// The first reads the current slot and writes the next, the rest run in place there.
        Compute "compute" { batch: Batch::PushConstants, poses: &PoseFormat::ALL };
        /// Compute, for the blocks of vertices that a changed target touches, and no others
        ///
        /// One workgroup for each. Takes the block formats. The one to use where there is a GPU.
        Blocks "blocks" { formats: &DeltaFormat::BLOCKS, poses: &PoseFormat::ALL };
    }
    host {
        /// SIMD and threads, without Vulkan
        ///
        /// Takes every format.
        Cpu "cpu" { formats: &DeltaFormat::ALL, poses: &PoseFormat::ALL };
    }
    baselines {
        /// Baseline: the passes of feedback, stored by the vertex shader
        VertexStore "vertex-store" { needs: Needs::VertexStores, batch: Batch::Attributes };
        /// Baseline: a thread per delta, integer atomics, from base every time (O3DE, Unity)
        ///
        /// A last pass makes the pose of the sums.
        Scatter "scatter" {
            formats: &[DeltaFormat::Small], has_own_upload: true, sums_integers: true,
            rebuilds_only: true, takes_groups: false
        };
        /// Baseline: each draw evaluates all active targets (Costigan et al., Bevy, three.js, Filament)
        ///
        /// There is no update: the vertex shader reads the deltas from a storage buffer.
        Direct "direct" {
            needs: Needs::Nothing, evaluates_in_draws: true, rebuilds_only: true, takes_groups: false
        };
        /// Baseline: as direct, the active targets being vertex attributes (Gerdelan)
        DirectAttributes "direct-attributes" {
            needs: Needs::Nothing, evaluates_in_draws: true, rebuilds_only: true, takes_groups: false,
            batch: Batch::Attributes
        };
        /// Baseline: deltas in textures, blended into textures that draws fetch (Galanakis)
        ///
        /// A target is a few rectangles of texels, of float32 or of 16-bit integers. Blending adds weight times delta,
        /// or of what changed the delta weight, to float32 textures of displacements; each draw fetches those of its
        /// vertices.
        Texture "texture" {
            needs: Needs::FloatBlending, has_own_upload: true, evaluates_in_draws: true
        };
    }
}

impl UpdatePath {
    pub(crate) const fn row(self) -> &'static PathRow {
        &ROWS[self as usize]
    }

    /// Whether others published the technique, and it is here to compare with. `bench` runs those that are named.
    pub const fn is_baseline(self) -> bool {
        self.row().baseline
    }

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// What it is, in a line: what the command line's help says of it.
    pub const fn summary(self) -> &'static str {
        self.row().summary
    }

    /// Whether a pass may write the slot it reads: vertex passes may not.
    pub const fn works_in_place(self) -> bool {
        !matches!(self.row().needs, Needs::TransformFeedback | Needs::VertexStores)
    }

    /// Whether an update draws: its queue needs graphics.
    pub(crate) const fn draws_updates(self) -> bool {
        !self.works_in_place() || matches!(self.row().needs, Needs::FloatBlending)
    }

    /// Whether it has no [`UpdateMode::Incremental`](super::UpdateMode): each pose is evaluated from base.
    pub const fn rebuilds_only(self) -> bool {
        self.row().rebuilds_only
    }

    /// Whether there are no pose buffers: every draw evaluates the pose.
    pub const fn evaluates_in_draws(self) -> bool {
        self.row().evaluates_in_draws
    }

    /// Whether it takes [`BatchSize::All`](super::BatchSize::All); vertex attributes hold a limited number of targets.
    pub const fn takes_all_targets(self) -> bool {
        !matches!(self.row().batch, Batch::Attributes)
    }

    /// The delta formats it takes.
    pub const fn formats(self) -> &'static [DeltaFormat] {
        self.row().formats
    }

    /// The pose formats it takes: integers with deltas that are integers.
    pub const fn poses(self) -> &'static [PoseFormat] {
        self.row().poses
    }
}
