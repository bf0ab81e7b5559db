//! Meshes: as their files state them ([`Mesh`]), and reduced to what is packed ([`KeptMesh`]).

mod arrays;
mod build;
mod extent;
mod mesh;
pub(crate) mod normals;
mod render;
pub mod streams;
mod triangles;

pub use arrays::{MeshArrays, TargetArrays};
pub use mesh::{Corner, Faces, KeptMesh, KeptTarget, Mesh, MorphTarget, Tolerance};
pub use render::RenderVertices;
pub(crate) use render::check_welds;
pub use streams::{Measure, Semantic, StreamData, StreamDeltas, StreamPlace};
pub(crate) use triangles::{CUT_ALL, CUT_MOST};
