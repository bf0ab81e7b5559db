//! Deltas laid out for the update paths.
