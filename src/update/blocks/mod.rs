//! The block formats: only blocks of vertices that a changed target touches are loaded and stored.
//!
//! `state` decides what an update writes of an instance, `plan` what it does for a crowd, and in which dispatches;
//! `tiles` puts several instances together; `technique` and `gpu` carry it out on a device. `shared` is what crowds
//! that are planned on the GPU take over.

mod bound;
mod commit;
pub(crate) mod gpu;
mod list;
mod plan;
pub(crate) mod shared;
mod state;
mod technique;
mod tiles;

pub use list::{ELEMENT_BYTES, Element, ITEM_WORDS, Item, WorkList};
pub(crate) use plan::EXACT_BLOCKS;
pub use plan::{GroupPlanner, Planner};
pub(crate) use state::check_tolerance;
pub(crate) use technique::BlocksTechnique;
pub use tiles::{ROWS, TILE_WORDS, WIDTHS, row_words};
#[cfg(any(test, feature = "internals"))]
pub(crate) use {bound::Scratch, commit::Frame, state::BlockState};
#[cfg(any(test, feature = "internals"))]
pub use {
    list::component_bytes,
    tiles::{ALIGN, TILE, TileBytes, TileItem, Tiles},
};

#[cfg(test)]
mod tests;
