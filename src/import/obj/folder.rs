//! Import of a folder: `neutral.obj` and `targets/*.obj`.

use super::shading::{Stated, face_areas, stated};
use super::{ObjFile, input};
use crate::asset::normals::{Adjacency, vertex_normals};
use crate::asset::{Corner, Faces, MorphSource, SourceTarget};
use crate::error::{Error, Result};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Import a folder: `neutral.obj` and one file per target in `targets/*.obj`, in the order of their names.
///
/// File names ending in `.obj` in any case count; hidden files (a dot first), folders and other files are ignored.
/// Every target has the vertices of `neutral.obj` in the same order, and faces with the same vertices; the texture
/// coordinates of a target are not looked at. Deltas are taken as the files state them: call
/// [`to_mesh`](MorphSource::to_mesh) to drop noise. A `targets` folder without OBJ files gives a source without
/// targets, with a note.
///
/// Normals are per position. Where the corners of a position state several (a hard edge), they are averaged by
/// face area. Base normals are brought to unit length, and normal deltas scaled with them. A neutral without
/// normals, or with normals in some faces only, has none; a target without has them computed from its surface.
///
/// # Errors
/// A file or folder that is missing, unreadable or not OBJ (a pipe or device is not opened at all); a target that
/// does not fit `neutral.obj`. With several bad targets, the first by name is reported.
pub fn import_folder(folder: &Path) -> Result<MorphSource> {
    let name = folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into_owned());
    let neutral_path = neutral_path(folder)?;
    let paths = target_paths(folder)?;
    let neutral = ObjFile::read(&neutral_path)?;
    let mut notes = Vec::new();
    if paths.is_empty() {
        notes.push("the folder 'targets' has no .obj file: a base pose without targets".to_owned());
    }

    let areas = face_areas(&neutral);
    let base = base_normals(&neutral, &areas, &mut notes);
    let neutral = Neutral { path: neutral_path, file: neutral, areas, base };
    let read = |(name, path): &(String, PathBuf)| neutral.target(name, path);
    #[cfg(feature = "threads")]
    let results: Vec<_> = {
        use rayon::prelude::*;
        paths.par_iter().map(read).collect()
    };
    #[cfg(not(feature = "threads"))]
    let results: Vec<_> = paths.iter().map(read).collect();
    // All results first: whichever thread is faster, the first bad target by name is the one reported.
    let targets = results.into_iter().collect::<Result<Vec<Target>>>()?;

    let Neutral { file, base, .. } = neutral;
    if base.is_some() {
        remark(&mut notes, &targets, |t| t.source.normals.is_none(), "without normals at all corners: computed");
        remark(&mut notes, &targets, |t| t.opens_edges, "with hard edges where neutral.obj has none: averaged by area");
    } else {
        remark(&mut notes, &targets, |t| t.ignored_normals, "with normals, neutral.obj has none: computed for all");
    }
    Ok(MorphSource {
        name,
        positions: file.positions,
        normals: base.map(|b| b.units),
        texcoords: file.texcoords,
        faces: file.faces,
        targets: targets.into_iter().map(|t| t.source).collect(),
        notes,
        ..MorphSource::default()
    })
}

fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let io = |source| Error::Io { path: folder.to_path_buf(), action: "read the folder", source };
    std::fs::read_dir(folder).map_err(io)?.map(|entry| entry.map(|e| e.path()).map_err(io)).collect()
}

/// `neutral.obj`, or else its name in another case.
fn neutral_path(folder: &Path) -> Result<PathBuf> {
    let exact = folder.join("neutral.obj");
    if exact.is_file() {
        return Ok(exact);
    }
    let mut files = list(folder)?;
    files.sort();
    let other = files.into_iter().find(|p| {
        p.is_file() && p.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.eq_ignore_ascii_case("neutral.obj"))
    });
    // A folder or pipe of that name is told as such when it is read.
    other.or_else(|| exact.exists().then_some(exact)).ok_or_else(|| {
        let remedy = "give a folder with neutral.obj and one file per target in targets/";
        input(folder, "", "no file neutral.obj in this folder", remedy)
    })
}

/// Names and paths of the targets, in target order.
fn target_paths(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let targets = folder.join("targets");
    if !targets.is_dir() {
        let remedy = "put one .obj file per target into it (or none, for a base pose without targets)";
        return Err(input(folder, "", "no folder 'targets' in this folder", remedy));
    }
    let mut paths: Vec<(String, PathBuf)> = list(&targets)?
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) && !p.is_dir())
        .filter_map(|p| Some((p.file_stem()?.to_string_lossy().into_owned(), p)))
        .filter(|(name, _)| !name.starts_with('.'))
        .collect();
    paths.sort();
    match paths.windows(2).find(|w| w[0].0 == w[1].0) {
        Some(w) => {
            let what = format!("a second file of the target '{}', beside {}", w[0].0, w[0].1.display());
            Err(input(&w[1].1, "", what, "remove or rename one of them"))
        }
        None => Ok(paths),
    }
}

/// The neutral's normals: as stated, and of unit length.
struct Base {
    stated: Vec<Vec3>,
    /// By what a stated normal is multiplied; its delta as well.
    scales: Vec<f32>,
    units: Vec<Vec3>,
    hard: usize,
}

fn base_normals(neutral: &ObjFile, areas: &[f64], notes: &mut Vec<String>) -> Option<Base> {
    let Some(Stated { values, hard }) = stated(neutral, areas) else {
        if neutral.any_normals {
            notes.push("neutral.obj has normals at some corners only: computed for all".to_owned());
        }
        return None;
    };
    if hard > 0 {
        notes.push(format!("{hard} vertices have several normals (hard edges): averaged by face area"));
    }
    // Too short to give a direction: unreferenced, zero in the file, or opposite sides averaged out.
    let vanishes = |n: &Vec3| n.as_dvec3().length() < 1e-6;
    let lost = values.iter().filter(|n| vanishes(n)).count();
    let mut units = if lost > 0 {
        notes.push(format!("{lost} vertices have no normal or a zero one: computed, and constant in all targets"));
        let adjacency = Adjacency::new(&neutral.faces, neutral.positions.len());
        vertex_normals(&adjacency, &neutral.positions)
    } else {
        vec![Vec3::ZERO; values.len()]
    };
    let mut scales = vec![0.0; values.len()];
    for ((n, unit), scale) in values.iter().zip(&mut units).zip(&mut scales).filter(|((n, _), _)| !vanishes(n)) {
        let length = n.as_dvec3().length();
        *unit = (n.as_dvec3() / length).as_vec3();
        *scale = (1.0 / length) as f32;
    }
    Some(Base { stated: values, scales, units, hard })
}

/// The neutral mesh, as the targets need it.
struct Neutral {
    path: PathBuf,
    file: ObjFile,
    areas: Vec<f64>,
    base: Option<Base>,
}

/// A target, and what there is to remark on it.
struct Target {
    source: SourceTarget,
    ignored_normals: bool,
    opens_edges: bool,
}

impl Neutral {
    fn target(&self, name: &str, path: &Path) -> Result<Target> {
        let file = ObjFile::read(path)?;
        let (found, expected) = (file.positions.len(), self.file.positions.len());
        let remedy = "export every target from the neutral mesh, with the same vertices and faces in the same order";
        if found != expected {
            let what = format!("{found} vertices, but {} has {expected}", self.path.display());
            return Err(input(path, "", what, remedy));
        }
        if let Some(difference) = first_difference(&file.faces, &self.file.faces) {
            return Err(input(path, "", format!("{difference} in {}", self.path.display()), remedy));
        }
        let stated = stated(&file, &self.areas);
        let (ignored_normals, opens_edges) = match &self.base {
            Some(base) => (false, stated.as_ref().is_some_and(|s| s.hard > base.hard)),
            None => (stated.is_some(), false),
        };
        let normals = self.base.as_ref().zip(stated).map(|(base, target)| {
            differences(&base.stated, &target.values)
                .map(|(v, delta)| (v, delta * base.scales[v as usize]))
                .filter(|(_, delta)| *delta != Vec3::ZERO)
                .collect()
        });
        let positions = differences(&self.file.positions, &file.positions).collect();
        let source = SourceTarget { name: name.to_owned(), positions, normals, streams: vec![] };
        if let Some((v, _)) = source.positions.iter().find(|(_, d)| !d.is_finite()) {
            let what = format!("vertex {} is too far from its place in the neutral mesh", u64::from(*v) + 1);
            return Err(input(path, "", what, remedy));
        }
        Ok(Target { source, ignored_normals, opens_edges })
    }
}

/// `(index, target − base)` wherever the two differ.
fn differences<'a>(base: &'a [Vec3], target: &'a [Vec3]) -> impl Iterator<Item = (u32, Vec3)> + 'a {
    base.iter().zip(target).enumerate().filter(|(_, (b, t))| b != t).map(|(i, (b, t))| (i as u32, *t - *b))
}

/// Where two face lists differ in sizes or positions, in words that end where "in FILE" can follow.
fn first_difference(found: &Faces, expected: &Faces) -> Option<String> {
    let words = |face: &[Corner]| {
        let mut text: Vec<String> = face.iter().take(8).map(|c| (u64::from(c.position) + 1).to_string()).collect();
        if face.len() > 8 {
            text.push(format!("… ({} corners)", face.len()));
        }
        text.join(" ")
    };
    let same =
        |a: &[Corner], b: &[Corner]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.position == b.position);
    let pair = found.iter().zip(expected.iter()).enumerate().find(|(_, (f, e))| !same(f, e));
    match pair {
        Some((i, (f, e))) => Some(format!("face {} has the vertices {}, but {}", i + 1, words(f), words(e))),
        None if found.sizes.len() != expected.sizes.len() => {
            Some(format!("{} faces, but {}", found.sizes.len(), expected.sizes.len()))
        }
        None => None,
    }
}

/// Add a note on the targets that `which` picks.
fn remark(notes: &mut Vec<String>, targets: &[Target], which: impl Fn(&Target) -> bool, what: &str) {
    let names: Vec<&str> = targets.iter().filter(|t| which(t)).map(|t| t.source.name.as_str()).collect();
    if !names.is_empty() {
        let more = if names.len() > 3 { ", …" } else { "" };
        notes.push(format!("{} targets ({}{more}) {what}", names.len(), names[..names.len().min(3)].join(", ")));
    }
}
