//! What a mesh is: as its files state it ([`MorphSource`]), and what is kept of it to be packed ([`MorphMesh`]).

mod build;
mod faces;
mod mesh;
pub(crate) mod normals;
mod source;
pub mod streams;

pub use faces::{Corner, Faces};
pub use mesh::{MorphMesh, MorphTarget, Tolerance};
pub use source::{MorphSource, SourceTarget};
