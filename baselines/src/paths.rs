//! The update paths that this package adds to those of the library.

use crate::plan::{Batch, Needs, PathRow};
use deltamorph::{DeltaFormat, UpdatePath};

/// Evaluated in each draw, from positions and normals alone.
const fn direct(name: &'static str, summary: &'static str) -> PathRow {
    PathRow {
        needs: Needs::Nothing,
        evaluates_in_draws: true,
        rebuilds_only: true,
        takes_groups: false,
        ..PathRow::new(name, summary)
    }
}

/// Like `feedback`, but the vertex shader stores the pose.
pub const VERTEX_STORE: UpdatePath = UpdatePath::Baseline(&PathRow {
    needs: Needs::VertexStores,
    batch: Batch::Attributes,
    ..PathRow::new("vertex-store", "Baseline: like feedback, but the vertex shader stores the pose")
});

/// One thread per delta; a last pass converts the integer sums to poses.
pub const SCATTER: UpdatePath = UpdatePath::Baseline(&PathRow {
    formats: &[DeltaFormat::Small],
    has_own_upload: true,
    sums_integers: true,
    rebuilds_only: true,
    takes_groups: false,
    ..PathRow::new(
        "scatter",
        "Baseline: one thread per delta, integer atomics, always from the base pose (O3DE, Unity)",
    )
});

/// No update is recorded: the vertex shader reads deltas from a storage buffer.
pub const DIRECT: UpdatePath = UpdatePath::Baseline(&direct(
    "direct",
    "Baseline: each draw evaluates all active targets (Costigan et al., Bevy, three.js, Filament)",
));

/// Like [`DIRECT`], with the active targets as vertex attributes.
pub const DIRECT_ATTRIBUTES: UpdatePath = UpdatePath::Baseline(&PathRow {
    batch: Batch::Attributes,
    ..direct("direct-attributes", "Baseline: like direct, with the active targets as vertex attributes (Gerdelan)")
});

/// A target is a few rectangles of float32 or 16-bit integer texels. Each is blended, scaled by the weight or delta
/// weight, into float32 displacement textures, which draws fetch.
pub const TEXTURE: UpdatePath = UpdatePath::Baseline(&PathRow {
    needs: Needs::FloatBlending,
    has_own_upload: true,
    evaluates_in_draws: true,
    ..PathRow::new(
        "texture",
        "Baseline: deltas in textures, blended into displacement textures that draws fetch (Galanakis)",
    )
});

/// The library's paths and these.
pub const PATHS: [UpdatePath; 9] = {
    let [feedback, compute, blocks, cpu] = UpdatePath::ALL;
    [feedback, compute, blocks, cpu, VERTEX_STORE, SCATTER, DIRECT, DIRECT_ATTRIBUTES, TEXTURE]
};
