//! Poses of every path, format and driver, against float64 and each other.

mod bounds;
mod clamps;
mod fixed16;
mod integers;
mod many_targets;
mod readback;
mod real_data;
mod tunings;
