//! Reading INPUT: a folder, a packed file, or the built-in head.

use crate::args::InputArgs;
use crate::output::{Failure, Output};
use deltamorph::mesh::{MorphMesh, MorphSource, Tolerance, head, obj};
use deltamorph::pack::PackedMesh;
use deltamorph::pack::file::Asset;
use deltamorph::weights::{WeightClip, csv};
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
            if is_packed(path) && path.is_file() {
                let input = Asset::read(path).map_err(Failure::from).and_then(|asset| Input::of_asset(asset, path));
                spinner.finish_and_clear();
                let input = input?;
                refuse_tolerance(args, input.kept.tolerance, path)?;
                out.note(format_args!(
                    "{} is packed: errors are against what it holds; those against the raw files cannot be told",
                    path.display()
                ));
                return Ok(input);
            }
            let source = read(path);
            spinner.finish_and_clear();
            (source?, clips_in(path)?, path.display().to_string())
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

/// A weight clip and, for each of its frames, a weight per target of `mesh`.
pub fn clip(path: &Path, args: &InputArgs, mesh: &MorphMesh) -> Result<(WeightClip, Vec<Vec<f32>>), Failure> {
    let clip = csv::read(path, args.fps_of(path))?;
    let names: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
    let frames = clip.bind(&names).map_err(|e| Failure::Failed(format!("{}: {e}", path.display())))?;
    if frames.is_empty() {
        return Err(Failure::Failed(format!("{}: has no frames; add one row per frame", path.display())));
    }
    Ok((clip, frames))
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

/// Whether `path` is called as a packed file is.
pub fn is_packed(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dmorph"))
}

/// What was dropped before packing is not there to be kept, and a packed mesh is taken as it is.
fn refuse_tolerance(args: &InputArgs, held: Tolerance, path: &Path) -> Result<(), Failure> {
    let asked = args.tolerance();
    if asked == Tolerance::default() || asked == held {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "--tolerance {}: {} was packed with a tolerance of {}; leave it out, or give the folder that it was packed from",
        asked.position,
        path.display(),
        held.position
    )))
}

fn read(path: &Path) -> Result<MorphSource, Failure> {
    if path.is_dir() {
        return Ok(obj::import_folder(path)?);
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let refuse = |what: &str, remedy: &str| Failure::Failed(format!("{}: {what}; {remedy}", path.display()));
    Err(match extension.as_str() {
        // A path that is not there fails below, with the system's reason.
        "dmorph" if !path.exists() => refuse("no such file", "give a file written by `deltamorph pack`"),
        _ if !path.exists() => refuse("no such folder", "give a folder with neutral.obj and targets/*.obj"),
        "glb" | "gltf" => {
            refuse("this version does not read glTF", "export the mesh as a folder with neutral.obj and targets/*.obj")
        }
        "dmorph" => refuse("is no regular file", "give a file written by `deltamorph pack`"),
        _ => refuse(
            "is a file, not a folder",
            "give the folder with neutral.obj and targets/*.obj, or a file written by `deltamorph pack` (*.dmorph)",
        ),
    })
}

/// The CSV files in `folder`/weights, by name.
fn clips_in(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let weights = folder.join("weights");
    if !weights.is_dir() {
        return Ok(Vec::new());
    }
    let unreadable = |e| Failure::io(&weights, "read", e);
    let mut clips = Vec::new();
    for entry in std::fs::read_dir(&weights).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) && path.is_file() {
            clips.push(path);
        }
    }
    clips.sort();
    Ok(clips)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::pack::{DeltaFormat, PackDesc};

    fn message(path: &Path) -> String {
        read(path).expect_err("not readable").to_string()
    }

    #[test]
    fn what_cannot_be_read_comes_with_a_remedy() {
        let dir = tempfile::tempdir().expect("a folder");
        for (name, part) in [("a.glb", "glTF"), ("a.obj", "is a file")] {
            let path = dir.path().join(name);
            std::fs::write(&path, "").expect("written");
            let text = message(&path);
            assert!(text.contains(part) && text.contains("folder"), "{text}");
        }
        assert!(message(&dir.path().join("none")).contains("no such folder"));
        assert!(message(&dir.path().join("none.dmorph")).contains("no such file; give a file written by `deltamorph"));
    }

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

    #[test]
    fn clips_are_found_in_order() {
        let dir = tempfile::tempdir().expect("a folder");
        assert!(clips_in(dir.path()).expect("none").is_empty());
        let weights = dir.path().join("weights");
        std::fs::create_dir(&weights).expect("created");
        for name in ["b.csv", "a.CSV", "notes.txt"] {
            std::fs::write(weights.join(name), "").expect("written");
        }
        let clips = clips_in(dir.path()).expect("two");
        assert_eq!(clips, [weights.join("a.CSV"), weights.join("b.csv")]);
    }
}
