//! Older names of [`asset`](crate::asset), [`import`](crate::import) and [`math`](crate::math).

pub use crate::asset::*;
pub use crate::import::{obj, sample as head};
pub use crate::math::diagonal;
