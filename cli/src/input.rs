//! Reading INPUT: a folder, a packed file, or the built-in head.

use crate::args::InputArgs;
use crate::output::{Failure, Output};
use deltamorph::import::{ImportDesc, Imported, ImportedMesh, sample as head};
use deltamorph::{Asset, BoundClip, MorphMesh, PackedMesh, Tolerance, import};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A mesh: what its files state, and what the tolerance keeps of it.
#[derive(Debug)]
pub struct Input {
    /// Its name in reports.
    pub name: String,
    /// Every delta that is not exactly zero: what errors "against the raw files" are measured with.
    pub raw: Arc<MorphMesh>,
    /// The deltas above the tolerance: what is packed and uploaded.
    pub kept: Arc<MorphMesh>,
    /// The mesh of a packed file, as the file has it. The two above are then what it decodes to.
    pub packed: Option<Arc<PackedMesh>>,
    /// The weight clips in INPUT/weights, by name.
    pub clips: Vec<PathBuf>,
    /// The folder, or "built-in head": for reports.
    pub origin: String,
}

/// What reports say about a mesh. Fields may be added, never renamed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MeshInfo {
    pub name: String,
    /// A folder, a file, or "built-in head".
    pub origin: String,
    pub vertices: usize,
    pub targets: usize,
    /// Polygons are cut into fans.
    pub triangles: usize,
    /// Length of the bounding-box diagonal, in input units.
    pub diagonal: f32,
    /// Position deltas up to this fraction of the diagonal were dropped.
    pub tolerance: f32,
    /// Normal deltas up to this length were dropped.
    #[serde(default)]
    pub tolerance_normal: f32,
    /// Mean fraction of the vertices that a target moves.
    pub moved_mean: f64,
}

impl Input {
    pub fn info(&self) -> MeshInfo {
        let mesh = &self.kept;
        let moved: usize = mesh.targets.iter().map(|t| t.vertices.len()).sum();
        MeshInfo {
            name: self.name.clone(),
            origin: self.origin.clone(),
            vertices: mesh.vertex_count(),
            targets: mesh.targets.len(),
            triangles: mesh.faces.sizes.iter().map(|&n| (n as usize).saturating_sub(2)).sum(),
            diagonal: mesh.diagonal,
            tolerance: mesh.tolerance.position,
            tolerance_normal: mesh.tolerance.normal,
            moved_mean: moved as f64 / (mesh.vertex_count() * mesh.targets.len()).max(1) as f64,
        }
    }

    /// A packed file; the raw files that it came from are not there any more.
    fn of_asset(asset: Asset, path: &Path) -> Result<Self, Failure> {
        let kept = Arc::new(asset.to_mesh()?);
        Ok(Self {
            name: kept.name.clone(),
            raw: kept.clone(),
            kept,
            packed: Some(Arc::new(asset.mesh)),
            clips: Vec::new(),
            origin: path.display().to_string(),
        })
    }
}

/// Read what `args` name. Commands that measure nothing against the raw files take no memory for them: where
/// `with_raw` is false, `raw` is what is kept.
pub fn load(args: &InputArgs, with_raw: bool, out: &Output) -> Result<Input, Failure> {
    let (source, clips, origin) = match &args.input {
        None => {
            let desc = args.head.desc(args.seed);
            let spinner = out.spinner("building the head");
            let source = head::head(&desc);
            spinner.finish_and_clear();
            (source, Vec::new(), "built-in head".to_owned())
        }
        Some(path) => {
            if let Some(option) = args.head.given() {
                return Err(Failure::Usage(format!(
                    "{option} sizes the built-in head, but INPUT is {}; leave out one of the two",
                    path.display()
                )));
            }
            let spinner = out.spinner(format!("reading {}", path.display()));
            let imported = import::open(path, &ImportDesc::default());
            spinner.finish_and_clear();
            let Imported { mesh, clips, .. } = imported?;
            match mesh {
                ImportedMesh::Source(source) => (source, clips, path.display().to_string()),
                ImportedMesh::Packed(asset) => {
                    let input = Input::of_asset(asset, path)?;
                    refuse_tolerance(args, input.kept.tolerance, path)?;
                    out.note(format_args!(
                        "{} is packed: errors are against what it holds; those against the raw files cannot be told",
                        path.display()
                    ));
                    return Ok(input);
                }
            }
        }
    };
    let spinner = out.spinner("computing normals and dropping noise");
    let meshes = || -> deltamorph::Result<_> {
        let kept = Arc::new(source.to_mesh(args.tolerance())?);
        let same = !with_raw || kept.tolerance == Tolerance::ZERO;
        let raw = if same { kept.clone() } else { Arc::new(source.to_mesh(Tolerance::ZERO)?) };
        Ok((raw, kept))
    };
    let meshes = meshes();
    spinner.finish_and_clear();
    let (raw, kept) = meshes?;
    for note in source.notes.iter().chain(kept.notes.iter().filter(|n| !source.notes.contains(n))) {
        out.note(note);
    }
    Ok(Input { name: kept.name.clone(), raw, kept, packed: None, clips, origin })
}

/// The weight clip at `path`, for the targets of `mesh`; at least one frame.
pub fn clip(path: &Path, args: &InputArgs, mesh: &MorphMesh) -> Result<BoundClip, Failure> {
    let clip = import::open_clip(path, args.fps)?;
    let names: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
    let clip = clip.bind(&names).map_err(|e| Failure::Failed(format!("{}: {e}", path.display())))?;
    if clip.frame_count() == 0 {
        return Err(Failure::Failed(format!("{}: has no frames; add one row per frame", path.display())));
    }
    Ok(clip)
}

/// The files that `args` and `others` may have read: none of them is to be written over.
pub fn files_of(args: &InputArgs, others: &[PathBuf]) -> Vec<PathBuf> {
    let mut read = others.to_vec();
    if let Some(input) = &args.input {
        for folder in [input.clone(), input.join("targets"), input.join("weights")] {
            // A folder that cannot be listed is for the importer to complain about.
            read.extend(std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path()));
        }
        read.push(input.clone());
    }
    read
}

/// What was dropped before packing is not there to be kept, and a packed mesh is taken as it is.
fn refuse_tolerance(args: &InputArgs, held: Tolerance, path: &Path) -> Result<(), Failure> {
    let asked = args.tolerance();
    if asked == Tolerance::default() || asked == held {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "--tolerance {}: {} was packed with a tolerance of {}; leave it out, or give the folder that it was \
         packed from",
        asked.position,
        path.display(),
        held.position
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::{DeltaFormat, PackDesc};

    #[test]
    fn packed_files_are_read_and_named_in_errors() {
        let dir = tempfile::tempdir().expect("a folder");
        let (out, path) = (Output::new(&Default::default()), dir.path().join("a.DMORPH"));
        let args = |tolerance| InputArgs {
            input: Some(path.clone()),
            head: Default::default(),
            tolerance,
            fps: None,
            seed: 1,
        };
        std::fs::write(&path, "").expect("written");
        let text = load(&args(1e-6), true, &out).expect_err("empty").to_string();
        assert!(text.contains("a.DMORPH: does not begin as a packed mesh does; give a file written by"), "{text}");

        let source = head::head(&head::HeadDesc { vertices: 300, targets: 5, ..Default::default() });
        let mesh = source.to_mesh(Tolerance::default()).expect("the head");
        let asset = Asset::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("packed");
        asset.write(&path).expect("written");
        let input = load(&args(1e-6), true, &out).expect("read");
        assert_eq!(input.packed.as_deref(), Some(&asset.mesh));
        assert_eq!((input.kept.positions.len(), input.raw.targets.len()), (300, 5));
        assert_eq!(input.kept.faces, mesh.faces);
        let text = load(&args(1e-3), true, &out).expect_err("another tolerance").to_string();
        assert!(text.contains("was packed with a tolerance of 0.000001"), "{text}");
    }
}
