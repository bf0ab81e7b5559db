//! Packed meshes, and older names of [`asset`](crate::asset) and [`import`](crate::import).

pub mod packed;

pub use crate::asset::*;
pub use crate::import::{obj, sample as head};
pub use crate::math::diagonal;
