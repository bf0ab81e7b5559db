//! Reads INPUT (a folder, a glTF file, a packed file, or the built-in head), and the weight clips of a command.

use crate::args::{InputArgs, RunArgs};
use crate::output::{Failure, Output, Result, refuse};
use deltamorph::import::{Imported, ImportedMesh, csv, gltf};
use deltamorph::internals::diagonal;
use deltamorph::internals::weights::names::{closest, meanings};
use deltamorph::{BlockDesc, BoundClip, KeptMesh, PackDesc, PackedMesh, Semantic, Tolerance, WeightClip, import};
use deltamorph_head as head;
use serde::Serialize;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Frames of the built-in head's clip, as `sample` writes them.
const HEAD_FRAMES: usize = 300;

/// The largest weight of a clip from which on 100 may be meant to be a whole target.
const PERCENT: f32 = 5.0;

/// A mesh, before and after dropping deltas by the tolerance.
#[derive(Default)]
pub struct Input {
    pub args: InputArgs,
    pub name: String,
    /// Every nonzero delta: the reference for errors "against the raw files". Both meshes are recentred.
    pub raw: Arc<KeptMesh>,
    /// The deltas above the tolerance: packed and uploaded.
    pub kept: Arc<KeptMesh>,
    /// The packed mesh of a packed file; `raw` and `kept` are decoded from it.
    pub packed: Option<Arc<PackedMesh>>,
    /// The weight clips in INPUT/weights, by name; of a glTF file its animations of weights, as FILE#NAME.
    pub clips: Vec<PathBuf>,
    /// Yaw of a camera that looks at the face, in degrees.
    pub front: f32,
    /// The folder, or "built-in head": for reports.
    pub origin: String,
    /// Prints warnings about clips.
    pub out: Output,
    /// What reading took, in seconds, and what followed until there was `kept`.
    pub seconds: [f64; 2],
    /// The largest absolute weight of clips and settings that have been read: fixed-point poses have to hold it.
    pub largest: Cell<f32>,
}

/// Facts about a mesh in reports. Fields may be added, never renamed.
#[derive(Clone, Default, Serialize)]
pub struct MeshInfo {
    pub name: String,
    /// A folder, a file, or "built-in head".
    pub origin: String,
    pub vertices: usize,
    pub targets: usize,
    /// A polygon of n corners counts as n − 2.
    pub triangles: usize,
    /// The length that errors and tolerances are fractions of, in input units: the diagonal of the box around the
    /// smallest group of connected parts that targets move.
    pub diagonal: f32,
    /// The diagonal of the box around all vertices of the base pose, in input units.
    pub bounding_box: f32,
    /// Position deltas up to this fraction of the diagonal were dropped.
    pub tolerance: f32,
    /// Normal deltas up to this length were dropped.
    pub tolerance_normal: f32,
    /// Mean fraction of the vertices that a target moves.
    pub moved_mean: f64,
    /// Origin of poses, in input units: the middle of a mesh that is far from 0.
    pub pose_origin: [f32; 3],
}

impl Input {
    /// Adds wrinkle masks to the mesh, if it has none. A packed mesh is packed again, in its format.
    pub fn add_masks(&mut self) -> Result<()> {
        if self.kept.streams.iter().any(|stream| stream.semantic == Semantic::Mask) {
            return Ok(());
        }
        let mut mesh = KeptMesh::clone(&self.kept);
        deltamorph_render::wrinkles::add(&mut mesh);
        if let Some(packed) = &mut self.packed {
            let layout = packed.layout();
            let blocks =
                BlockDesc { size: layout.blocks.as_ref().map(|blocks| blocks.size() as u32), ..Default::default() };
            *packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(layout.format) })?);
        }
        self.kept = Arc::new(mesh);
        Ok(())
    }

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
            bounding_box: diagonal(&mesh.positions),
            tolerance: mesh.tolerance.position,
            tolerance_normal: mesh.tolerance.normal,
            moved_mean: moved as f64 / (mesh.vertex_count() * mesh.targets.len()).max(1) as f64,
            pose_origin: mesh.origin.to_array(),
        }
    }
}

/// Reads the input that `args` name. Without `with_raw`, `raw` is `kept`, which saves memory in commands that do not
/// compare with the raw files.
pub fn load(args: &InputArgs, with_raw: bool, out: &Output) -> Result<Input> {
    let origin = args.input.as_ref().map_or("built-in head".into(), |path| path.display().to_string());
    let spinner = out.spinner(format!("reading {origin}"));
    let begun = Instant::now();
    let (mesh, clips, looks_back) = match &args.input {
        None => (ImportedMesh::Source(head::head(&args.head.desc(args.seed))), vec![], false),
        Some(path) if path == Path::new("-") => {
            return refuse("-: only clips can be read from standard input (--weights -); name a folder or file");
        }
        Some(path) => {
            let Imported { mesh, clips, looks_back, .. } = import::open(path)?;
            (mesh, clips, looks_back)
        }
    };
    let read = begun.elapsed().as_secs_f64();
    let mut kept_seconds = 0.0;
    let (raw, kept, packed) = match mesh {
        ImportedMesh::Source(source) => {
            let mesh = |tolerance| -> deltamorph::Result<Arc<KeptMesh>> {
                let mut mesh = source.kept(tolerance)?;
                mesh.recentre();
                Ok(Arc::new(mesh))
            };
            let kept = mesh(args.tolerance())?;
            kept_seconds = begun.elapsed().as_secs_f64() - read;
            let same = !with_raw || kept.tolerance == Tolerance::ZERO;
            let raw = if same { kept.clone() } else { mesh(Tolerance::ZERO)? };
            (raw, kept, None)
        }
        ImportedMesh::Packed(mut packed) => {
            packed.recentre();
            let kept = Arc::new(packed.unpack()?);
            // Deltas dropped before packing are lost, and a packed mesh is used as it is.
            if ![Tolerance::default(), kept.tolerance].contains(&args.tolerance()) {
                return refuse(format!(
                    "--tolerance {}: {origin} was packed with a tolerance of {}; leave it out, or give the folder that \
                     it was packed from",
                    args.tolerance, kept.tolerance.position
                ));
            }
            (kept.clone(), kept, Some(Arc::new(packed)))
        }
    };
    drop(spinner);
    kept.notes.iter().for_each(|note| out.warn(note));
    if packed.is_some() {
        let what = "errors are measured against its content, not against the original files";
        out.warn(format_args!("{origin} is packed: {what}"));
    }
    Ok(Input {
        args: args.clone(),
        name: kept.name.clone(),
        raw,
        kept,
        packed,
        clips,
        front: if looks_back { 180.0 } else { 0.0 },
        origin,
        out: out.clone(),
        seconds: [read, kept_seconds],
        largest: Cell::new(0.0),
    })
}

/// Weights of targets by name, as each `--set` states them.
pub type Settings = [Vec<(String, f32)>];

/// Checks that the clip at `path` has a frame of this number.
pub fn check_frame(path: &Path, clip: &BoundClip, frame: usize) -> Result<()> {
    let count = clip.frame_count();
    if frame < count {
        return Ok(());
    }
    let text = format!("has no frame {frame}; its {count} frames are counted from 0");
    refuse(format!("{}: {text}", path.display()))
}

impl Input {
    /// The clip that `path` names, as FILE#NAME if it is an animation of a glTF file, or in a packed file: the only one
    /// of such a file, or one of INPUT by its name.
    fn named(&self, path: &Path) -> Result<PathBuf> {
        if path == Path::new("-") {
            return Ok("/dev/stdin".into());
        }
        if import::animation_of(path).is_some() {
            return Ok(path.to_path_buf());
        }
        let of = |file: &Path, name: &str| PathBuf::from(format!("{}#{name}", file.display()));
        if path.exists() {
            if import::is_gltf(path) {
                let all = gltf::read(path)?.animations;
                let (joints, weights): (Vec<_>, Vec<_>) = all.iter().partition(|one| one.moves_joints_alone());
                if let ([only], _) | ([], [only]) = (&weights[..], &joints[..]) {
                    return Ok(of(path, &only.name));
                }
            }
            return Ok(path.to_path_buf());
        }
        let of_input = self.args.input.as_ref().map(|input| of(input, &path.display().to_string()));
        Ok(of_input.filter(|clip| import::animation_of(clip).is_some()).unwrap_or_else(|| path.to_path_buf()))
    }

    /// Reads the weight clip at `given`, at least one frame, for the targets, with `settings` applied. If INPUT is a
    /// glTF file and there is no file at `given`, it may be the name of an animation.
    pub fn clip(&self, given: &Path, settings: &Settings) -> Result<BoundClip> {
        let path = &self.named(given)?;
        let clip = import::open_clip(path, self.args.fps).map_err(|error| self.misnamed(given, error))?;
        if clip.frame_count() == 0 {
            return Err(Failure::Failed(format!("{}: has no frames; add one row per frame", path.display())));
        }
        let held = self.held(settings)?;
        let bound = self.bind(&clip, &held).map_err(|e| Failure::Failed(format!("{}: {e}", path.display())))?;
        let warn = |text: &str| self.out.warn(format_args!("clip '{}': {text}", clip.name));
        bound.notes.iter().for_each(|text| warn(text));
        let most = bound.largest();
        if most >= PERCENT {
            warn(&format!("weights up to {most}, but 1 applies a target in full: are they percentages?"));
        }
        Ok(bound)
    }

    /// The clip at `named`, or the only one of INPUT, with `settings` applied.
    pub fn one_clip(&self, named: Option<&Path>, settings: &Settings) -> Result<BoundClip> {
        if named.is_none() && self.clips.len() > 1 {
            let list = self.clip_names();
            let (origin, count) = (&self.origin, self.clips.len());
            return refuse(format!("{origin} has {count} clips; name one with --weights: {list}"));
        }
        self.clips(named, settings)?.pop().ok_or_else(|| {
            let what =
                format!("{} has no clip (weights/*.csv, or an animation of weights in a glTF file)", self.origin);
            Failure::Usage(format!("{what}; name one with --weights CSV"))
        })
    }

    /// The clip at `named`, or all of INPUT, with `settings` applied.
    pub fn clips(&self, named: Option<&Path>, settings: &Settings) -> Result<Vec<BoundClip>> {
        let InputArgs { input, head, seed, fps, .. } = &self.args;
        if named.is_none() && input.is_none() {
            // Without targets there are no clips.
            if self.kept.targets.is_empty() {
                return Ok(vec![]);
            }
            let clip = head::head_clip(&head.desc(*seed), HEAD_FRAMES, fps.unwrap_or(csv::DEFAULT_FPS));
            return Ok(vec![self.bind(&clip, &self.held(settings)?)?]);
        }
        let paths = named.map_or_else(|| self.clips.clone(), |path| vec![path.to_path_buf()]);
        paths.iter().map(|path| self.clip(path, settings)).collect()
    }

    /// Names of the targets.
    pub fn targets(&self) -> Vec<&str> {
        self.kept.targets.iter().map(|target| target.name.as_str()).collect()
    }

    /// Why no target is called `name`, and which one may be meant.
    pub fn unknown(&self, name: &str) -> String {
        let known = self.targets();
        let near = closest(name, &known).map_or_else(String::new, |near| format!("; did you mean '{near}'?"));
        format!("'{}' has no such target; `deltamorph info` lists its {} targets{near}", self.kept.name, known.len())
    }

    /// Weights of the targets with only `settings`.
    pub fn pose(&self, settings: &Settings) -> Result<Vec<f32>> {
        let still = WeightClip { name: "--set".into(), fps: csv::DEFAULT_FPS, ..WeightClip::default() };
        let frames = self.bind(&still, &self.held(settings)?)?.frames().next();
        Ok(frames.unwrap_or_else(|| vec![0.0; self.kept.targets.len()]))
    }

    fn clip_names(&self) -> String {
        let name = |clip: &PathBuf| match import::animation_of(clip) {
            Some((_, name)) => format!("'{name}'"),
            None => format!("'{}'", clip.display()),
        };
        self.clips.iter().map(name).collect::<Vec<_>>().join(", ")
    }

    /// The failure to read a clip: a bad argument if it names neither a file nor one of its animations.
    fn misnamed(&self, given: &Path, error: deltamorph::Error) -> Failure {
        if given.exists() || import::animation_of(given).is_some() {
            return error.into();
        }
        let clips = self.clip_names();
        let clips = if clips.is_empty() { clips } else { format!("; clips of {}: {clips}", self.origin) };
        Failure::Usage(format!("{error}{clips}"))
    }

    /// What was read; without it a warning says why.
    pub fn unless_bad<T>(&self, clip: Result<T, impl Into<Failure>>) -> Option<T> {
        let warn = |why: Failure| self.out.warn(format_args!("{why}; skipped"));
        clip.map_err(Into::into).map_err(warn).ok()
    }

    /// Binds a clip to the targets, of which some are `held` at other weights.
    fn bind(&self, clip: &WeightClip, held: &[(usize, f32)]) -> deltamorph::Result<BoundClip> {
        let mut bound = clip.bind_holding(&self.targets(), held)?;
        if self.args.normalise {
            bound.normalise();
        }
        self.largest.set(self.largest.get().max(bound.largest()));
        Ok(bound)
    }

    /// The targets that `settings` mean, by the rules for columns of clips, with their weights.
    pub fn held(&self, settings: &Settings) -> Result<Vec<(usize, f32)>> {
        let known = self.targets();
        let refuse = |name: &str, why: String| Failure::Usage(format!("--set {name}: {why}"));
        let twice = |name: &str| refuse(name, "set twice; leave out one of them".into());
        let (names, weights): (Vec<String>, Vec<f32>) = settings.iter().flatten().cloned().unzip();
        let mut held = vec![];
        for ((meant, name), weight) in meanings(&names, &known).map_err(twice)?.into_iter().zip(&names).zip(weights) {
            let meant = meant.ok_or_else(|| refuse(name, self.unknown(name)))?;
            if meant.is_empty() {
                return Err(twice(name));
            }
            held.extend(meant.into_iter().map(|target| (target, weight)));
        }
        Ok(held)
    }
}

/// Frames of clips that stand for all of them.
const FRAMES: usize = 8;

/// Up to [`FRAMES`] frames in which targets move, spread evenly over `clips`.
pub fn spread(clips: &[BoundClip]) -> Vec<Vec<f32>> {
    let all: Vec<Vec<f32>> =
        clips.iter().flat_map(BoundClip::frames).filter(|frame| frame.iter().any(|weight| *weight != 0.0)).collect();
    let count = FRAMES.min(all.len());
    (0..count).map(|i| all[(2 * i + 1) * all.len() / (2 * count)].clone()).collect()
}

/// Checks the options of `command`, and that what it writes can be written, before it works.
pub fn check(command: &str, run: &RunArgs, outputs: &[&Path], out: &Output) -> Result<()> {
    run.update.check_single(command).map_err(Failure::Usage)?;
    out.check(&files_of(&run.input, run.weights.as_slice()), outputs, None)
}

/// The files that `args` and `others` may have read, which must not be overwritten.
pub fn files_of(args: &InputArgs, others: &[PathBuf]) -> Vec<PathBuf> {
    let file_of = |path: &PathBuf| import::animation_of(path).map_or_else(|| path.clone(), |(file, _)| file);
    let mut read: Vec<PathBuf> = others.iter().map(file_of).collect();
    if let Some(input) = &args.input {
        for folder in [input.clone(), input.join("targets"), input.join("weights")] {
            // The importer reports folders that cannot be listed.
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
