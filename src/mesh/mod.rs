//! Older names of [`asset`](crate::asset) and [`import`](crate::import).

pub use crate::asset::*;
pub use crate::import::{obj, sample as head};
