//! Reading INPUT: a folder, or the built-in head.

use crate::args::InputArgs;
use crate::output::{Failure, Output};
use deltamorph::mesh::{MorphMesh, MorphSource, Tolerance, head, obj};
use deltamorph::weights::{WeightClip, csv};
use std::path::{Path, PathBuf};

/// A mesh as its files state it, and what the tolerance keeps of it.
#[derive(Debug)]
pub struct Input {
    /// As the files state it.
    pub source: MorphSource,
    /// Every delta that is not exactly zero: what errors "against the raw files" are measured with.
    pub raw: MorphMesh,
    /// The deltas above the tolerance: what is packed and uploaded.
    pub kept: MorphMesh,
    /// The weight clips in INPUT/weights, by name.
    pub clips: Vec<PathBuf>,
    /// The folder, or "built-in head": for reports.
    pub origin: String,
}

/// Read what `args` name.
///
/// # Errors
/// INPUT is not there, cannot be used, or contradicts another option.
pub fn load(args: &InputArgs, out: &Output) -> Result<Input, Failure> {
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
            let source = read(path);
            spinner.finish_and_clear();
            (source?, clips_in(path)?, path.display().to_string())
        }
    };
    let spinner = out.spinner("computing normals and dropping noise");
    let raw = source.to_mesh(Tolerance::ZERO);
    let kept = raw.and_then(|raw| {
        let tolerance = args.tolerance();
        let kept = if tolerance == Tolerance::ZERO { raw.clone() } else { source.to_mesh(tolerance)? };
        Ok((raw, kept))
    });
    spinner.finish_and_clear();
    let (raw, kept) = kept?;
    for note in source.notes.iter().chain(kept.notes.iter().filter(|n| !source.notes.contains(n))) {
        out.note(note);
    }
    Ok(Input { source, raw, kept, clips, origin })
}

/// A weight clip and, for each of its frames, a weight per target of `mesh`.
///
/// # Errors
/// The file cannot be used, or names a target that the mesh does not have; the message names the file.
pub fn clip(path: &Path, args: &InputArgs, mesh: &MorphMesh) -> Result<(WeightClip, Vec<Vec<f32>>), Failure> {
    let clip = csv::read(path, args.fps_of(path))?;
    let names: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
    let frames = clip.bind(&names).map_err(|e| Failure::Failed(format!("{}: {e}", path.display())))?;
    if frames.is_empty() {
        return Err(Failure::Failed(format!("{}: has no frames; add one row per frame", path.display())));
    }
    Ok((clip, frames))
}

fn read(path: &Path) -> Result<MorphSource, Failure> {
    if path.is_dir() {
        return Ok(obj::import_folder(path)?);
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let refuse = |what: &str, remedy: &str| Failure::Failed(format!("{}: {what}; {remedy}", path.display()));
    Err(match extension.as_str() {
        // A path that is not there fails below, with the system's reason.
        _ if !path.exists() => refuse("no such folder", "give a folder with neutral.obj and targets/*.obj"),
        "glb" | "gltf" => {
            refuse("this version does not read glTF", "export the mesh as a folder with neutral.obj and targets/*.obj")
        }
        "dmorph" => refuse("this version does not read packed meshes", "give the folder that it was packed from"),
        _ => refuse("is a file, not a folder", "give the folder with neutral.obj and targets/*.obj"),
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

    fn message(path: &Path) -> String {
        read(path).expect_err("not readable").to_string()
    }

    #[test]
    fn what_cannot_be_read_comes_with_a_remedy() {
        let dir = tempfile::tempdir().expect("a folder");
        for (name, part) in [("a.glb", "glTF"), ("a.DMORPH", "packed"), ("a.obj", "is a file")] {
            let path = dir.path().join(name);
            std::fs::write(&path, "").expect("written");
            let text = message(&path);
            assert!(text.contains(part) && text.contains("folder"), "{text}");
        }
        assert!(message(&dir.path().join("none")).contains("no such folder"));
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
