//! The bound on what accumulation in float32 may have done to the positions of a block, as a length.
//!
//! With M the largest coordinate that the block can reach, S = Σ|coefficient| · longest delta over the n entries of an
//! update, and ε = 2⁻²³ (a whole unit in the last place, since Vulkan fixes no rounding mode), an update adds
//! √3 · (M·ε + (n + 4)·S·ε): one rounding at pose magnitude, one for each coefficient, product, partial sum and scale.
//! A rebuild sets the bound to that of its own entries.

use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::BlockIndex;

const ULP: f32 = f32::EPSILON;
const SQRT_3: f32 = 1.732_050_8;

/// What rounding may add to a block's positions in one update.
pub(super) fn rounding(magnitude: f32, entries: u32, sum: f32) -> f32 {
    SQRT_3 * ULP * (magnitude + (entries + 4) as f32 * sum)
}

/// What tolerances are fractions of: the diagonal, where there is one.
pub(super) fn length_unit(layout: &PackedLayout) -> f32 {
    if layout.diagonal > 0.0 { layout.diagonal } else { 1.0 }
}

/// Refuse a tolerance that a pose fresh from base exceeds, all weights being 1.
pub(crate) fn check_tolerance(tolerance: f32, layout: &PackedLayout, index: &BlockIndex) -> Result<()> {
    let fresh = (0..index.count()).map(|b| {
        let reach = index.block_reach[b];
        rounding(index.block_base[b] + reach, index.entries(b).len() as u32, reach)
    });
    let least = fresh.fold(0.0, f32::max) / length_unit(layout);
    if least <= tolerance {
        return Ok(());
    }
    Err(Error::invalid(
        format!(
            "a drift of at most {tolerance:.1e} of the diagonal: rounding alone may move a vertex by {least:.1e} when all \
             weights are 1"
        ),
        "allow more drift, or use exact sums (Accumulate::Exact)",
    ))
}
