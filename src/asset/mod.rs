//! What a mesh is: as its files state it ([`MorphSource`]), and what is kept of it to be packed ([`MorphMesh`]).

mod arrays;
mod build;
mod check;
mod faces;
mod mesh;
pub(crate) mod normals;
mod render;
mod source;
pub mod streams;

pub use arrays::{MeshArrays, TargetArrays};
pub use faces::{Corner, Faces};
pub use mesh::{MorphMesh, MorphTarget, Tolerance};
pub use render::RenderVertices;
pub use source::{MorphSource, SourceTarget};
pub use streams::{Semantic, StreamData, StreamDeltas};
