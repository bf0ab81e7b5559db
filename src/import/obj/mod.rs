//! OBJ import and export.
//!
//! [tobj](https://docs.rs/tobj) parses the text. `scan` checks every statement first, since tobj has no line numbers,
//! takes NaN for a number and reads an index of 0 as missing; `parse` makes it keep the vertices of the file, all of them
//! and in their order.

mod folder;
mod parse;
mod scan;
mod shading;
mod write;

pub use folder::import_folder;
pub use write::{ObjMesh, write_obj, write_obj_to};

use crate::asset::Faces;
use glam::{Vec2, Vec3};

/// One OBJ file, in the file's own order.
#[derive(Clone, Debug, Default)]
pub struct ObjFile {
    /// The `v` lines.
    pub positions: Vec<Vec3>,
    /// The `vt` lines; a third coordinate is ignored.
    pub texcoords: Vec<Vec2>,
    /// The `vn` lines, as stated.
    pub normals: Vec<Vec3>,
    /// The `f` lines, in file order whatever object, group or material they belong to.
    pub faces: Faces,
    /// Index into `normals` of every corner of `faces`; `None` unless every corner names one.
    pub corner_normals: Option<Vec<u32>>,
    /// Whether some corners of the faces name a normal (so that `corner_normals: None` means a mixture).
    pub any_normals: bool,
}
