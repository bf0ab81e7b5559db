//! Where meshes and weight clips come from, and where they are written.

#[cfg(feature = "csv")]
pub mod csv;
pub mod obj;
pub mod sample;
