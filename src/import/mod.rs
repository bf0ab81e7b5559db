//! Where meshes and weight clips come from, and where they are written.
//!
//! To add an importer: a module here, and a branch in [`open`].

#[cfg(feature = "csv")]
pub mod csv;
pub mod obj;
pub mod sample;

use crate::asset::MorphSource;
use crate::error::{Error, Result};
use crate::io::{has_extension, list};
use crate::pack::file::Asset;
use crate::setters::setters;
use crate::weights::WeightClip;
use std::path::{Path, PathBuf};

/// How to import.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ImportDesc {
    /// Give vertices one texture coordinate each ([`MorphSource::split`]). A packed file stays as it is.
    pub split: bool,
}

setters!(ImportDesc { split: bool });

/// What was found.
#[derive(Debug)]
#[non_exhaustive]
pub struct Imported {
    /// The mesh.
    pub mesh: ImportedMesh,
    /// Weight clips that belong to it, by name: read them with [`open_clip`].
    pub clips: Vec<PathBuf>,
}

/// A mesh to pack, or one that is.
#[derive(Debug)]
pub enum ImportedMesh {
    /// As its files state it.
    Source(MorphSource),
    /// Packed before.
    Packed(Asset),
}

/// Open a mesh and what belongs to it: a folder with `neutral.obj`, `targets/*.obj` and `weights/*.csv`, or a packed file
/// (`*.dmorph`).
///
/// # Errors
/// There is nothing at `path`, or nothing that can be used; the message names the file, the place and the remedy.
pub fn open(path: &Path, desc: &ImportDesc) -> Result<Imported> {
    let refuse = |what: &str| {
        let remedy =
            "give a folder with neutral.obj and targets/*.obj, or a file written by `deltamorph pack` (*.dmorph)";
        Err(Error::input(path, "", what, remedy))
    };
    let mut imported = if path.is_dir() {
        open_folder(path)?
    } else if !path.exists() {
        return refuse("no such file or folder");
    } else if has_extension(path, "dmorph") {
        Imported { mesh: ImportedMesh::Packed(Asset::read(path)?), clips: vec![] }
    } else {
        return refuse("a file of a kind that is not read");
    };
    if let (ImportedMesh::Source(source), true) = (&mut imported.mesh, desc.split) {
        *source = source.split()?;
    }
    Ok(imported)
}

/// Read a weight clip. `fps` is its frame rate; `None` takes the one that the file states, or its name, or else 30.
///
/// # Errors
/// The file cannot be used, or the library was built without the feature that reads it.
pub fn open_clip(path: &Path, fps: Option<f32>) -> Result<WeightClip> {
    #[cfg(feature = "csv")]
    return csv::read(path, fps);
    #[cfg(not(feature = "csv"))]
    Err(Error::input(path, "", format!("no weight clips are read (fps {fps:?})"), "build with the feature 'csv'"))
}

fn open_folder(path: &Path) -> Result<Imported> {
    let mesh = ImportedMesh::Source(obj::import_folder(path)?);
    let weights = path.join("weights");
    let mut clips = if weights.is_dir() { list(&weights)? } else { vec![] };
    clips.retain(|path| has_extension(path, "csv") && path.is_file());
    Ok(Imported { mesh, clips })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_comes_with_its_clips_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let weights = dir.path().join("weights");
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 2/2 1/1 3/1\n";
        std::fs::create_dir(dir.path().join("targets")).unwrap();
        std::fs::write(dir.path().join("neutral.obj"), triangle).unwrap();
        let found = |desc: ImportDesc| match open(dir.path(), &desc).unwrap() {
            Imported { mesh: ImportedMesh::Source(source), clips } => (source.positions.len(), clips),
            Imported { mesh: ImportedMesh::Packed(_), .. } => panic!("nothing is packed"),
        };
        assert_eq!(found(ImportDesc::default()), (3, vec![]));
        std::fs::create_dir(&weights).unwrap();
        for name in ["b.csv", "a.CSV", "notes.txt"] {
            std::fs::write(weights.join(name), "").unwrap();
        }
        let clips = vec![weights.join("a.CSV"), weights.join("b.csv")];
        assert_eq!(found(ImportDesc::default().split(true)), (4, clips));
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_a_remedy() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.DMORPH", "a.glb"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        for (name, parts) in [
            ("a.DMORPH", ["a.DMORPH: does not begin as a packed mesh does"; 2]),
            ("a.glb", ["a.glb: a file of a kind", "neutral.obj and targets/*.obj, or a file"]),
            ("none", ["none: no such file or folder", "(*.dmorph)"]),
        ] {
            let text = open(&dir.path().join(name), &ImportDesc::default()).unwrap_err().to_string();
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        }
    }
}
