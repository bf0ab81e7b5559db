//! Where meshes and weight clips come from, and where they are written.
//!
//! [`open`] tries a list of importers. To add one: a module here, and a row in the list.

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

/// What reads one kind of file or folder.
struct Importer {
    /// What to give, for messages.
    gives: &'static str,
    takes: fn(&Path) -> bool,
    open: fn(&Path) -> Result<Imported>,
}

const IMPORTERS: [Importer; 2] = [
    Importer { gives: "a folder with neutral.obj and targets/*.obj", takes: Path::is_dir, open: open_folder },
    Importer {
        gives: "a file written by `deltamorph pack` (*.dmorph)",
        takes: |path| has_extension(path, "dmorph"),
        open: open_packed,
    },
];

/// Open a mesh and what belongs to it: a folder with `neutral.obj`, `targets/*.obj` and `weights/*.csv`, or a packed file
/// (`*.dmorph`).
///
/// # Errors
/// There is nothing at `path`, or nothing that can be used; the message names the file, the place and the remedy.
pub fn open(path: &Path, desc: &ImportDesc) -> Result<Imported> {
    let refuse = |what: &str| {
        let remedy = format!("give {}", IMPORTERS.each_ref().map(|i| i.gives).join(", or "));
        Err(Error::input(path, "", what, &remedy))
    };
    if !path.exists() {
        return refuse("no such file or folder");
    }
    let Some(importer) = IMPORTERS.iter().find(|importer| (importer.takes)(path)) else {
        return refuse("a file of a kind that is not read");
    };
    let mut imported = (importer.open)(path)?;
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
    Ok(Imported { mesh, clips: clips_in(&path.join("weights"))? })
}

fn open_packed(path: &Path) -> Result<Imported> {
    Ok(Imported { mesh: ImportedMesh::Packed(Asset::read(path)?), clips: vec![] })
}

/// The CSV files in a folder, by name; none where there is no folder.
fn clips_in(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(vec![]);
    }
    let mut clips = list(folder)?;
    clips.retain(|path| has_extension(path, "csv") && path.is_file());
    Ok(clips)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::Tolerance;
    use crate::pack::{DeltaFormat, PackDesc};

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 2/2 1/1 3/1\n";

    fn message(path: &Path) -> String {
        open(path, &ImportDesc::default()).unwrap_err().to_string()
    }

    #[test]
    fn a_folder_comes_with_its_clips_in_order() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("targets")).unwrap();
        std::fs::write(dir.path().join("neutral.obj"), TRIANGLE).unwrap();
        let count = |desc: &ImportDesc| match open(dir.path(), desc).unwrap() {
            Imported { mesh: ImportedMesh::Source(source), clips } => (source.positions.len(), clips),
            Imported { mesh: ImportedMesh::Packed(_), .. } => panic!("nothing is packed"),
        };
        assert_eq!(count(&ImportDesc::default()), (3, vec![]));
        assert_eq!(count(&ImportDesc::default().split(true)).0, 4);
        let weights = dir.path().join("weights");
        std::fs::create_dir(&weights).unwrap();
        for name in ["b.csv", "a.CSV", "notes.txt"] {
            std::fs::write(weights.join(name), "").unwrap();
        }
        assert_eq!(count(&ImportDesc::default()).1, [weights.join("a.CSV"), weights.join("b.csv")]);
    }

    #[test]
    fn a_packed_file_is_known_by_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.DMORPH");
        std::fs::write(&path, "").unwrap();
        assert!(message(&path).contains("a.DMORPH: does not begin as a packed mesh does"), "{}", message(&path));
        let mesh = sample::head(&sample::HeadDesc { vertices: 99, ..Default::default() }).to_mesh(Tolerance::ZERO);
        let asset = Asset::pack(&mesh.unwrap(), &PackDesc::new(DeltaFormat::Small)).unwrap();
        asset.write(&path).unwrap();
        match open(&path, &ImportDesc::default()).unwrap().mesh {
            ImportedMesh::Packed(read) => assert_eq!(read, asset),
            ImportedMesh::Source(_) => panic!("it is packed"),
        }
    }

    #[test]
    fn what_cannot_be_opened_comes_with_a_remedy() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.glb"), "").unwrap();
        for (name, part) in [("a.glb", "a.glb: a file of a kind"), ("none", "none: no such file or folder")] {
            let text = message(&dir.path().join(name));
            assert!(text.contains(part) && text.contains("neutral.obj") && text.contains("*.dmorph"), "{text}");
        }
    }
}
