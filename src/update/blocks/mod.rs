//! The block formats: only blocks of vertices that a changed target touches are loaded and stored.
//!
//! `plan` is a crowd, and what the poses of each instance hold; `commit` decides which weights an update applies, and
//! `emit` which blocks it writes, into the list of a `group`. `dispatch` cuts lists into tiles and dispatches;
//! `technique` and `gpu` carry them out on a device, `gpu` also those of crowds that are planned there.

mod commit;
mod dispatch;
mod emit;
#[allow(unsafe_code)]
pub(crate) mod gpu;
mod group;
mod plan;
#[allow(unsafe_code)]
mod technique;

pub use group::WorkList;
pub(crate) use group::check_tolerance;
pub use group::{GroupPlan, Item};
pub(crate) use plan::BlockState;
pub use plan::Planner;
pub(crate) use technique::BlocksTechnique;

#[cfg(test)]
mod tests;
