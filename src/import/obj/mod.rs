//! OBJ import and export.

mod folder;
mod read;
mod write;

pub use folder::import_folder;
pub use read::ObjFile;
pub use write::{ObjMesh, write_obj};
