//! The block formats: only blocks of vertices that a changed target touches are loaded and stored.
//!
//! `state` is what the poses of an instance hold; `commit` decides which weights an update applies, and `emit` which
//! blocks it writes, into the list of a `group`. `plan` does that for a crowd; `tiles` puts several instances together;
//! `dispatch` cuts lists into dispatches; `technique` and `gpu` carry them out on a device, `gpu` also those of crowds that
//! are planned there.

mod bound;
mod commit;
mod dispatch;
mod emit;
pub(crate) mod gpu;
mod group;
mod list;
mod plan;
mod state;
mod technique;
mod tiles;

pub(crate) use bound::check_tolerance;
pub use list::{ELEMENT_BYTES, Element, ITEM_WORDS, Item, WorkList};
pub use plan::Planner;
#[cfg(any(test, feature = "internals"))]
pub(crate) use state::BlockState;
pub(crate) use technique::BlocksTechnique;
pub use tiles::{ROWS, TILE_WORDS, WIDTHS, row_words};
#[cfg(any(test, feature = "internals"))]
pub use {
    group::GroupPlan,
    tiles::{ALIGN, TILE, Tiles},
};

#[cfg(test)]
mod tests;
