//! The ways to update poses, a folder each: plan, device side and what the CPU needs of them.
//!
//! A way to update is a `Technique`; `make` is the one place that knows which there are. What
//! others published, to compare with, are techniques like any other, in `baselines`.

pub mod animated;
pub mod blocks;
mod check;
pub mod dense;
mod make;
pub(crate) mod technique;

pub(crate) use check::Runner;
pub(crate) use make::technique;

#[cfg(test)]
pub(crate) mod tests;
