//! OBJ import and export (through tobj).
use super::MorphSource;
use crate::error::{Error, Result};
use std::path::Path;

/// Import a folder: `neutral.obj` and one file per target in `targets/*.obj`.
pub fn import_folder(folder: &Path) -> Result<MorphSource> {
    let _ = folder;
    Err(Error::invalid("not written yet", ""))
}
