//! Meshes: as their files state them ([`MorphSource`]), and reduced to what is packed ([`MorphMesh`]).

mod arrays;
mod build;
mod extent;
mod mesh;
pub(crate) mod normals;
mod render;
pub mod streams;
mod triangles;

pub use arrays::{MeshArrays, TargetArrays};
pub use mesh::{Corner, Faces, MorphMesh, MorphSource, MorphTarget, SourceTarget, Tolerance};
pub use render::RenderVertices;
pub(crate) use render::check_welds;
pub use streams::{Measure, Semantic, StreamData, StreamDeltas, StreamPlace};
pub(crate) use triangles::{CUT_ALL, CUT_MOST};
