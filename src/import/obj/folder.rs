//! Import of a folder: `neutral.obj` and `targets/*.obj`.

use super::ObjFile;
use crate::asset::normals::{area_vector, unit_normals};
use crate::asset::{Corner, Faces, MorphSource, SourceTarget};
use crate::error::{Error, Result};
use crate::io::{has_extension, list};
use crate::math::map_all;
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};

/// Imports a folder: `neutral.obj`, and one file per target in `targets/*.obj`, in the order of their names.
///
/// File names ending in `.obj` in any case count; hidden files (a leading dot), folders and other files are ignored.
/// Every target has the vertices of `neutral.obj` in the same order, and faces with the same vertices; texture
/// coordinates of targets are ignored. Deltas are kept as the files state them; [`to_mesh`](MorphSource::to_mesh) drops
/// noise. A `targets` folder without OBJ files gives a source without targets, with a note.
///
/// Normals are per position. If the corners of a position state several (a hard edge), they are averaged by face area.
/// Base normals are brought to unit length, and normal deltas scaled with them. If the neutral has no normals, or has
/// them in some faces only, the source has none; the normals of a target without them are computed from its surface, by
/// [`to_mesh`](MorphSource::to_mesh).
///
/// # Errors
/// [`Error::Io`] for a file or folder that cannot be read; [`Error::Input`] for one that is missing or not OBJ (a pipe
/// or device is not opened at all), or a target that does not fit `neutral.obj`. With several bad targets, the first by
/// name is reported.
pub fn import_folder(folder: &Path) -> Result<MorphSource> {
    let name = folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into_owned());
    let neutral_path = neutral_path(folder)?;
    let paths = target_paths(folder)?;
    let neutral = ObjFile::read(&neutral_path)?;
    let mut notes = Vec::new();
    if paths.is_empty() {
        notes.push("the folder 'targets' has no .obj file: a base pose without targets".to_owned());
    }

    // Targets are averaged with the same weights, so the delta is the mean of the deltas.
    let areas: Vec<f64> = neutral.faces.iter().map(|face| area_vector(face, &neutral.positions).length()).collect();
    let base = base_normals(&neutral, &areas, &mut notes);
    let neutral = Neutral { path: neutral_path, file: neutral, areas, base };
    // All results first, so that the bad target reported is the first by name, whichever thread is faster.
    let results = map_all(&paths, (), |(), (name, path)| neutral.target(name, path));
    let targets: Vec<(SourceTarget, Option<&str>)> = results.into_iter().collect::<Result<_>>()?;
    for remark in [COMPUTED, AVERAGED, IGNORED] {
        let remarked = targets.iter().filter(|(_, r)| *r == Some(remark));
        let named: Vec<&str> = remarked.map(|(target, _)| target.name.as_str()).collect();
        match &named[..] {
            [] => {}
            [a, b, c, _, ..] => notes.push(format!("{} targets ({a}, {b}, {c}, …) {remark}", named.len())),
            few => notes.push(format!("{} targets ({}) {remark}", few.len(), few.join(", "))),
        }
    }

    let Neutral { file, base, .. } = neutral;
    Ok(MorphSource {
        name,
        positions: file.positions,
        normals: base.map(|b| b.units),
        texcoords: file.texcoords,
        faces: file.faces,
        targets: targets.into_iter().map(|(target, _)| target).collect(),
        notes,
        ..MorphSource::default()
    })
}

// Remarks on targets, for the notes.
const COMPUTED: &str = "without normals at all corners: computed";
const AVERAGED: &str = "with hard edges where neutral.obj has none: averaged by area";
const IGNORED: &str = "with normals, neutral.obj has none: computed for all";

/// Returns the path of `neutral.obj`, or of the same name in another case.
fn neutral_path(folder: &Path) -> Result<PathBuf> {
    let exact = folder.join("neutral.obj");
    if exact.is_file() {
        return Ok(exact);
    }
    let is_neutral = |p: &PathBuf| p.file_name().is_some_and(|n| n.eq_ignore_ascii_case("neutral.obj"));
    // A folder or pipe of that name is refused by the read.
    list(folder)?.into_iter().filter(is_neutral).min_by_key(|p| (!p.is_file(), *p != exact)).ok_or_else(|| {
        let remedy = "give a folder with neutral.obj and one file per target in targets/";
        Error::input(folder, "", "no file neutral.obj in this folder", remedy)
    })
}

/// Returns the names and paths of the targets, in target order.
fn target_paths(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let targets = folder.join("targets");
    if !targets.is_dir() {
        let remedy = "put one .obj file per target into it (or none, for a base pose without targets)";
        return Err(Error::input(folder, "", "no folder 'targets' in this folder", remedy));
    }
    let mut paths: Vec<(String, PathBuf)> = list(&targets)?
        .into_iter()
        .filter(|p| has_extension(p, "obj") && !p.is_dir())
        .filter_map(|p| Some((p.file_stem()?.to_string_lossy().into_owned(), p)))
        .filter(|(name, _)| !name.starts_with('.'))
        .collect();
    paths.sort();
    if let Some(w) = paths.windows(2).find(|w| w[0].0 == w[1].0) {
        let what = format!("a second file of the target '{}', beside {}", w[0].0, w[0].1.display());
        return Err(Error::input(&w[1].1, "", what, "remove or rename one of them"));
    }
    Ok(paths)
}

/// Returns the normals per position that `file` states, and the number of positions at hard edges; `None` if its faces
/// have no normals, or not at all corners.
///
/// If all corners of a position agree, it has their normal as stated; at a hard edge, their area-weighted mean. A
/// position that no face names has the `vn` line of its own number if there are as many `vn` as `v` lines, otherwise
/// zero.
fn stated_normals(file: &ObjFile, areas: &[f64]) -> Option<(Vec<Vec3>, usize)> {
    let count = file.positions.len();
    let one_each = file.normals.len() == count;
    // A point cloud has normals if it has one for each point.
    let corners = match &file.corner_normals {
        Some(corners) => corners.as_slice(),
        None if file.faces.sizes.is_empty() && one_each => &[],
        None => return None,
    };

    let mut values = if one_each { file.normals.clone() } else { vec![Vec3::ZERO; count] };
    let mut named = vec![false; count];
    let mut hard = vec![false; count];
    for (corner, &n) in file.faces.corners.iter().zip(corners) {
        let v = corner.position as usize;
        let normal = file.normals[n as usize];
        match std::mem::replace(&mut named[v], true) {
            true => hard[v] |= values[v] != normal,
            false => values[v] = normal,
        }
    }
    if hard.contains(&true) {
        let mut sums = vec![(DVec3::ZERO, 0.0); count];
        let areas = file.faces.sizes.iter().zip(areas).flat_map(|(&n, &area)| std::iter::repeat_n(area, n as usize));
        for ((corner, &n), area) in file.faces.corners.iter().zip(corners).zip(areas) {
            let (sum, weight) = &mut sums[corner.position as usize];
            *sum += file.normals[n as usize].as_dvec3() * area;
            *weight += area;
        }
        // Faces without area do not count; if all are such, the first normal is kept.
        for (v, (sum, weight)) in sums.into_iter().enumerate().filter(|(v, (_, weight))| hard[*v] && *weight > 0.0) {
            values[v] = (sum / weight).as_vec3();
        }
    }
    Some((values, hard.into_iter().filter(|hard| *hard).count()))
}

/// The neutral's normals: as stated, and at unit length.
struct Base {
    stated: Vec<Vec3>,
    /// Number of positions at hard edges.
    hard: usize,
    /// Factor by which each stated normal is multiplied, and its deltas.
    scales: Vec<f32>,
    units: Vec<Vec3>,
}

fn base_normals(neutral: &ObjFile, areas: &[f64], notes: &mut Vec<String>) -> Option<Base> {
    let Some((stated, hard)) = stated_normals(neutral, areas) else {
        if neutral.any_normals {
            notes.push("neutral.obj has normals at some corners only: computed for all".to_owned());
        }
        return None;
    };
    if hard > 0 {
        notes.push(format!("{hard} vertices have several normals (hard edges): averaged by face area"));
    }
    let (units, scales, lost) = unit_normals(&stated, &neutral.faces, &neutral.positions);
    if lost > 0 {
        notes.push(format!("{lost} vertices have no normal or a zero one: computed, and constant in all targets"));
    }
    Some(Base { stated, hard, scales, units })
}

/// The data of the neutral mesh that targets need.
struct Neutral {
    path: PathBuf,
    file: ObjFile,
    areas: Vec<f64>,
    base: Option<Base>,
}

impl Neutral {
    /// Reads a target. Returns it, and a remark on it if there is one.
    fn target(&self, name: &str, path: &Path) -> Result<(SourceTarget, Option<&'static str>)> {
        let file = ObjFile::read(path)?;
        const REMEDY: &str =
            "export every target from the neutral mesh, with the same vertices and faces in the same order";
        let refuse = |what: String| Err(Error::input(path, "", what, REMEDY));
        let found = file.positions.len();
        let expected = self.file.positions.len();
        if found != expected {
            return refuse(format!("{found} vertices, but {} has {expected}", self.path.display()));
        }
        if let Some(difference) = first_difference(&file.faces, &self.file.faces) {
            return refuse(format!("{difference} in {}", self.path.display()));
        }
        let positions: Vec<(u32, Vec3)> = differences(&self.file.positions, &file.positions).collect();
        if let Some((v, _)) = positions.iter().find(|(_, d)| !d.is_finite()) {
            return refuse(format!("vertex {} is too far from its position in the neutral mesh", u64::from(*v) + 1));
        }
        let stated = stated_normals(&file, &self.areas);
        let remark = match (&self.base, &stated) {
            (Some(_), None) => Some(COMPUTED),
            (Some(base), Some((_, hard))) => (*hard > base.hard).then_some(AVERAGED),
            (None, Some(_)) => Some(IGNORED),
            (None, None) => None,
        };
        let normals = self.base.as_ref().zip(stated).map(|(base, (stated, _))| {
            differences(&base.stated, &stated)
                .map(|(v, delta)| (v, delta * base.scales[v as usize]))
                .filter(|(_, delta)| *delta != Vec3::ZERO)
                .collect()
        });
        Ok((SourceTarget { name: name.to_owned(), positions, normals, streams: vec![] }, remark))
    }
}

/// Iterates over `(index, target − base)` wherever the two differ.
fn differences<'a>(base: &'a [Vec3], target: &'a [Vec3]) -> impl Iterator<Item = (u32, Vec3)> + 'a {
    base.iter().zip(target).enumerate().filter(|(_, (b, t))| b != t).map(|(i, (b, t))| (i as u32, *t - *b))
}

/// Describes the first difference of two face lists in sizes or positions, as text to be followed by "in FILE".
fn first_difference(found: &Faces, expected: &Faces) -> Option<String> {
    fn vertices(face: &[Corner]) -> impl Iterator<Item = u64> {
        face.iter().map(|c| u64::from(c.position) + 1)
    }
    let words = |face: &[Corner]| {
        let mut text: Vec<String> = vertices(face).take(8).map(|v| v.to_string()).collect();
        if face.len() > 8 {
            text.push(format!("… ({} corners)", face.len()));
        }
        text.join(" ")
    };
    for (i, (f, e)) in found.iter().zip(expected.iter()).enumerate() {
        if !vertices(f).eq(vertices(e)) {
            return Some(format!("face {} has the vertices {}, but {}", i + 1, words(f), words(e)));
        }
    }
    let found = found.sizes.len();
    let expected = expected.sizes.len();
    (found != expected).then(|| format!("{found} faces, but {expected}"))
}
