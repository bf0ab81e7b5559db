//! A Vulkan layer that makes one call fail, with an error that the specification allows for it, and counts what is
//! alive on each device.
//!
//! - `DELTAMORPH_FAIL=CALL:N:ERROR`: the failing call. `vkCreateFence:2:-1` is the second call of `vkCreateFence`,
//!   which returns VK_ERROR_OUT_OF_HOST_MEMORY; with `*` as the call, the Nth of all calls that may return this error.
//! - `DELTAMORPH_FAIL_LOG=FILE`: the log of events, including each call, with a number for its call site. Without it
//!   everything but the calls goes to stderr.
//!
//! Tests that link this crate choose with [`arm`], for a [`device`] that needs no layer.
//!
//! A lost device stays lost until it is destroyed; its work is waited for first. If a wait fails for lack of memory,
//! the work goes on, as on any driver. Calls that need no instance never fail: layers do not see them.

mod calls;
mod control;
mod layer;
mod state;
pub mod sweep;

pub use control::{Counts, arm, counts, device, enable};
