//! Reading INPUT: a folder, a glTF file, a packed file, or the built-in head; and the weight clips that a command runs.

use crate::args::InputArgs;
use crate::output::{Failure, Output};
use deltamorph::import::{ImportDesc, Imported, ImportedMesh, csv, sample as head};
use deltamorph::{BoundClip, MorphMesh, PackedMesh, Tolerance, import};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Frames of the built-in head's clip, as `sample` writes them.
const HEAD_FRAMES: usize = 300;

/// A mesh: what its files state, and what the tolerance keeps of it.
#[derive(Debug)]
pub struct Input {
    pub name: String,
    /// Every delta that is not exactly zero: what errors "against the raw files" are measured with.
    pub raw: Arc<MorphMesh>,
    /// The deltas above the tolerance: what is packed and uploaded.
    pub kept: Arc<MorphMesh>,
    /// The mesh of a packed file, as the file has it. The two above are then what it decodes to.
    pub packed: Option<Arc<PackedMesh>>,
    /// The weight clips in INPUT/weights, by name; of a glTF file its animations of weights, as FILE#NAME.
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
}

/// Read what `args` name. Commands that measure nothing against the raw files take no memory for them: where
/// `with_raw` is false, `raw` is what is kept.
pub fn load(args: &InputArgs, with_raw: bool, out: &Output) -> Result<Input, Failure> {
    read(args, with_raw, &ImportDesc::default(), out)
}

/// Read what `args` name for drawing: a vertex has one texture coordinate, but in a packed file, which stays as it is.
pub fn load_split(args: &InputArgs, out: &Output) -> Result<Input, Failure> {
    read(args, false, &ImportDesc::default().split(true), out)
}

fn read(args: &InputArgs, with_raw: bool, desc: &ImportDesc, out: &Output) -> Result<Input, Failure> {
    let origin = args.input.as_ref().map_or("built-in head".into(), |path| path.display().to_string());
    let spinner = out.spinner(format!("reading {origin}"));
    let (mesh, clips) = match &args.input {
        None => {
            let source = head::head(&args.head.desc(args.seed));
            (ImportedMesh::Source(if desc.split { source.split()? } else { source }), vec![])
        }
        Some(path) => import::open(path, desc).map(|Imported { mesh, clips, .. }| (mesh, clips))?,
    };
    let (raw, kept, packed) = match mesh {
        ImportedMesh::Source(source) => {
            let kept = Arc::new(source.to_mesh(args.tolerance())?);
            let same = !with_raw || kept.tolerance == Tolerance::ZERO;
            let raw = if same { kept.clone() } else { Arc::new(source.to_mesh(Tolerance::ZERO)?) };
            (raw, kept, None)
        }
        ImportedMesh::Packed(asset) => {
            let kept = Arc::new(asset.to_mesh()?);
            // What was dropped before packing is not there to be kept, and a packed mesh is taken as it is.
            if ![Tolerance::default(), kept.tolerance].contains(&args.tolerance()) {
                return Err(Failure::Usage(format!(
                    "--tolerance {}: {origin} was packed with a tolerance of {}; leave it out, or give the folder that \
                     it was packed from",
                    args.tolerance, kept.tolerance.position
                )));
            }
            (kept.clone(), kept, Some(Arc::new(asset.mesh)))
        }
    };
    spinner.finish_and_clear();
    kept.notes.iter().for_each(|note| out.note(note));
    if packed.is_some() {
        let what = "errors are against what it holds; those against the raw files cannot be told";
        out.note(format_args!("{origin} is packed: {what}"));
    }
    Ok(Input { name: kept.name.clone(), raw, kept, packed, clips, origin })
}

fn names(mesh: &MorphMesh) -> Vec<&str> {
    mesh.targets.iter().map(|t| t.name.as_str()).collect()
}

/// The weight clip at `path`, for the targets of `mesh`; at least one frame. Where INPUT is a glTF file and there is no file
/// at `path`, it may be the name of an animation.
pub fn clip(path: &Path, args: &InputArgs, mesh: &MorphMesh) -> Result<BoundClip, Failure> {
    let of_input = args.input.as_ref().map(|input| PathBuf::from(format!("{}#{}", input.display(), path.display())));
    let of_input = of_input.filter(|_| !path.exists() && import::animation_of(path).is_none());
    let path = of_input.as_deref().filter(|named| import::animation_of(named).is_some()).unwrap_or(path);
    let clip = import::open_clip(path, args.fps)?;
    let clip = clip.bind(&names(mesh)).map_err(|e| Failure::Failed(format!("{}: {e}", path.display())))?;
    if clip.frame_count() == 0 {
        return Err(Failure::Failed(format!("{}: has no frames; add one row per frame", path.display())));
    }
    Ok(clip)
}

/// The clip at `named`, or the only one that `input` has.
pub fn one_clip(named: Option<&Path>, args: &InputArgs, input: &Input) -> Result<BoundClip, Failure> {
    if named.is_none() && input.clips.len() > 1 {
        let list = input.clips.iter().map(|c| c.display().to_string()).collect::<Vec<_>>().join(", ");
        let (origin, count) = (&input.origin, input.clips.len());
        return Err(Failure::Usage(format!("{origin} has {count} clips; name one with --weights: {list}")));
    }
    clips(named, args, input)?.pop().ok_or_else(|| {
        let what = format!("{} has no clip (weights/*.csv, or an animation of weights in a glTF file)", input.origin);
        Failure::Usage(format!("{what}; name one with --weights CSV"))
    })
}

/// The clip at `named`, or all that `input` has.
pub fn clips(named: Option<&Path>, args: &InputArgs, input: &Input) -> Result<Vec<BoundClip>, Failure> {
    if named.is_none() && args.input.is_none() {
        let clip = head::head_clip(&args.head.desc(args.seed), HEAD_FRAMES, args.fps.unwrap_or(csv::DEFAULT_FPS));
        // Without a target there is none.
        return if input.kept.targets.is_empty() { Ok(vec![]) } else { Ok(vec![clip.bind(&names(&input.kept))?]) };
    }
    let paths = named.map_or_else(|| input.clips.clone(), |path| vec![path.to_path_buf()]);
    paths.iter().map(|path| clip(path, args, &input.kept)).collect()
}

/// Put `settings`, weights by name, on top of each of `frames`.
pub fn set_weights(settings: &[(String, f32)], mesh: &MorphMesh, frames: &mut [Vec<f32>]) -> Result<(), Failure> {
    for (i, (name, weight)) in settings.iter().enumerate() {
        let refuse = |why: String| Failure::Usage(format!("--set {name}: {why}"));
        if settings[..i].iter().any(|(other, _)| other == name) {
            return Err(refuse("set twice; leave one of them out".into()));
        }
        let at = mesh.target_index(name).ok_or_else(|| {
            let (name, targets) = (&mesh.name, mesh.targets.len());
            refuse(format!("'{name}' has no such target; `deltamorph info` lists the {targets} there are"))
        })?;
        frames.iter_mut().for_each(|weights| weights[at] = *weight);
    }
    Ok(())
}

/// The files that `args` and `others` may have read: none of them is to be written over.
pub fn files_of(args: &InputArgs, others: &[PathBuf]) -> Vec<PathBuf> {
    let file_of = |path: &PathBuf| import::animation_of(path).map_or_else(|| path.clone(), |(file, _)| file);
    let mut read: Vec<PathBuf> = others.iter().map(file_of).collect();
    if let Some(input) = &args.input {
        for folder in [input.clone(), input.join("targets"), input.join("weights")] {
            // A folder that cannot be listed is for the importer to complain about.
            read.extend(std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path()));
        }
        // Buffers of a glTF file lie beside it.
        let beside = import::is_gltf(input).then(|| input.parent()).flatten().into_iter().flat_map(|folder| {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
        });
        read.extend(beside.filter(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bin"))));
        read.push(input.clone());
    }
    read
}
