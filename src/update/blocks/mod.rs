//! Path `blocks`: loads and stores only the blocks that a changed target touches.
//!
//! `plan` is a crowd and the state of its instances' poses. `commit` decides which weights an update applies, `emit`
//! which blocks it writes into the list of a `group`. `dispatch` cuts lists into tiles and dispatches; `technique` and
//! `gpu` execute them on a device (`gpu` also for crowds planned on the GPU).

mod commit;
mod dispatch;
mod emit;
#[allow(unsafe_code)]
pub(crate) mod gpu;
mod group;
mod plan;
#[allow(unsafe_code)]
mod technique;

pub use group::{GroupPlan, Item, WorkList};
pub use plan::{BlockState, Planner};
pub use technique::BlocksTechnique;

#[cfg(test)]
mod tests;
