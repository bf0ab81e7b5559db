//! Import of a folder of OBJ files: a neutral mesh, and one file per target.

use super::ObjFile;
use crate::asset::normals::{area_vector, unit_normals};
use crate::asset::{Corner, Faces, Mesh, MorphTarget};
use crate::error::{Error, Result, ensure, listed};
use crate::import::stem;
use crate::io::{has_extension, list};
use crate::math::{diagonal, far_middle, map_all};
use crate::names::composed;
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};

/// Mean way of all vertices, as a part of the diagonal, from which on a target may be remarked on. Expressions move
/// less.
const FAR_FROM: f64 = 0.1;
/// Standard deviation of the ratio of distances on such a target to those on the base, as a part of it, up to which the
/// target is the base elsewhere. Another body, which may be as far, has other proportions.
const DEVIATION: f64 = 0.03;

/// How many times as long as on the base the edges of a target may be altogether, at the same size, if its faces do not
/// say that the order is the same. In a random order they are tens of times as long on a real mesh.
const STRETCH: f64 = 2.0;

/// Coordinates, as a part of the diagonal, from which on single precision would lose 1e-5 of it.
const FAR_OFF: f32 = 128.0;

/// Imports a folder: `neutral.obj`, and one file per target in `targets/*.obj`, in the order of their names.
///
/// Without a folder `targets`, the other files beside the neutral mesh are the targets. Its name may be `neutral` in
/// any case, or be the only one with that word in it, as `_neutral.obj` or `generic_neutral_mesh.obj`; a note says
/// which it is.
///
/// File names ending in `.obj` in any case count; hidden files (a leading dot), folders and other files are ignored.
/// Names are in Unicode's composed form (NFC). Every target has the vertices of `neutral.obj` in the same order. Its
/// faces may come in another order, cut in another way, or not at all, which is a note; its texture coordinates are
/// ignored. Targets of which the whole mesh is far are a note: of another unit or axis, or in another place. Deltas
/// are kept as the files state them; [`pack`](Mesh::pack) drops
/// noise. A folder without targets gives a source without targets, with a note. A target that cannot be read
/// or does not fit is left out, with a note.
///
/// Where coordinates are more than 128 times the diagonal, as on maps, positions are relative to the middle
/// ([`Mesh::origin`]), before they are rounded to single precision.
///
/// Normals are per position. If the corners of a position state several (a hard edge), they are averaged by face area.
/// Base normals are brought to unit length, and normal deltas scaled with them. If the neutral has no normals, or has
/// them in some faces only, the source has none; the normals of a target that lacks any are computed from its surface,
/// by [`pack`](Mesh::pack).
///
/// # Errors
/// [`Error::Io`] for a neutral mesh or folder that cannot be read; [`Error::Input`] for one that is missing or not OBJ
/// (a pipe or device is not opened at all), for two targets of one name, and for several files that may be the neutral
/// mesh. If no target can be used, the first by name is reported.
pub fn import_folder(folder: &Path) -> Result<Mesh> {
    let name = folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into_owned());
    let (neutral_path, paths) = files(folder)?;
    let mut neutral = ObjFile::read(&neutral_path)?;
    let file = neutral_path.file_name().unwrap_or_default().display();
    let mut notes = vec![];
    if !neutral_path.ends_with("neutral.obj") {
        notes.push(format!("the neutral mesh is {file}"));
    }
    let mut origin = Vec3::ZERO;
    let middle = far_middle(neutral.positions.iter().copied());
    if middle.abs().max_element() > FAR_OFF * diagonal(&neutral.positions) {
        origin = middle;
        neutral.positions = ObjFile::read_target(&neutral_path, origin)?.positions;
    }
    notes.extend(neutral.notes.iter().map(|note| format!("{file}: {note}")));
    if paths.is_empty() {
        notes.push(
            "no .obj file in a folder 'targets' or beside the neutral mesh: a base pose without targets".to_owned(),
        );
    }

    let base = base_normals(&neutral, &mut notes);
    let neutral = Neutral { path: neutral_path, file: neutral, base, origin };
    let results = map_all(&paths, (), |(), (name, path)| neutral.target(name, path));
    let (targets, failed): (Vec<_>, Vec<_>) = results.into_iter().partition(Result::is_ok);
    for error in failed.into_iter().filter_map(Result::err) {
        ensure!(!targets.is_empty() && !matches!(error, Error::OutOfMemory { .. }), error);
        notes.push(format!("{error}; left out"));
    }
    let targets: Vec<(MorphTarget, Vec<&str>)> = targets.into_iter().flatten().collect();
    for remark in [OTHER_FACES, FAR, COMPUTED, AVERAGED, IGNORED] {
        let remarked = targets.iter().filter(|(_, remarks)| remarks.contains(&remark));
        let named: Vec<&str> = remarked.map(|(target, _)| target.name.as_str()).collect();
        if !named.is_empty() {
            notes.push(format!("targets {remark}: {}", listed(&named)));
        }
    }

    let Neutral { file, base, .. } = neutral;
    Ok(Mesh {
        name,
        positions: file.positions,
        origin,
        normals: base.map(|b| b.units),
        texcoords: file.texcoords,
        faces: file.faces,
        targets: targets.into_iter().map(|(target, _)| target).collect(),
        notes,
        ..Mesh::default()
    })
}

// Remarks on targets, for the notes.
const OTHER_FACES: &str = "whose faces are not those of neutral.obj, taken by their vertices in the order of the file";
const FAR: &str = "that have the whole mesh elsewhere (of another unit or axis than neutral.obj, or in another place?)";
const COMPUTED: &str = "without normals at all corners, which are computed";
const AVERAGED: &str = "with hard edges where neutral.obj has none, averaged by area";
const IGNORED: &str = "with normals where neutral.obj has none, which are computed for all";

/// The path of the neutral mesh, and names and paths of the targets in target order.
fn files(folder: &Path) -> Result<(PathBuf, Vec<(String, PathBuf)>)> {
    let targets = folder.join("targets");
    let apart = targets.is_dir().then(|| list(&targets)).transpose()?.map(meshes);
    let mut beside = meshes(list(folder)?);
    let says = |name: &str| name.to_lowercase().contains("neutral");
    let is_it = |name: &str| name.eq_ignore_ascii_case("neutral");
    beside.sort_by_key(|(name, _)| (name != "neutral", !is_it(name), !says(name)));
    let names: Vec<&str> = beside.iter().map(|(name, _)| name.as_str()).collect();
    // Names that say more, such as neutral_smile, may be those of targets.
    let is_clear = names.first().is_some_and(|name| is_it(name)) || names.iter().filter(|name| says(name)).count() == 1;
    let found = || if names.is_empty() { "none".to_owned() } else { listed(&names) };
    let what = || format!("no file neutral.obj in this folder; its .obj files: {}", found());
    let remedy = "name the neutral mesh neutral.obj, and put one file per target into targets/ or beside it";
    ensure!(is_clear, Error::input(folder, "", what(), remedy));
    let neutral = beside.remove(0).1;
    let mut targets = apart.unwrap_or(beside);
    targets.sort();
    for two in targets.windows(2) {
        let what = || format!("a second file of the target '{}', beside {}", two[0].0, two[0].1.display());
        ensure!(two[0].0 != two[1].0, Error::input(&two[1].1, "", what(), "remove or rename one of them"));
    }
    Ok((neutral, targets))
}

/// The OBJ files among `paths`, with their names.
fn meshes(paths: Vec<PathBuf>) -> Vec<(String, PathBuf)> {
    let files = paths.into_iter().filter(|path| has_extension(path, "obj") && !path.is_dir());
    let named = files.map(|path| (composed(&stem(&path)), path));
    named.filter(|(name, _)| !name.starts_with('.')).collect()
}

/// Returns the normals per position that `file` states, and the number of positions at hard edges; `None` if its faces
/// have no normals, or not at all corners.
///
/// If all corners of a position agree, it has their normal as stated; at a hard edge, their mean, weighted by the areas
/// of faces of the positions `base`: the delta is then the mean of the deltas. A position that no face names has the
/// `vn` line of its own number if there are as many `vn` as `v` lines, otherwise zero.
fn stated_normals(file: &ObjFile, base: &[Vec3]) -> Option<(Vec<Vec3>, usize)> {
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
    let corners = file.faces.corners.iter().zip(corners).map(|(c, &n)| (c.position as usize, file.normals[n as usize]));
    // Corners without a normal do not count.
    for (v, normal) in corners.clone().filter(|(_, normal)| *normal != Vec3::ZERO) {
        if std::mem::replace(&mut named[v], true) { hard[v] |= values[v] != normal } else { values[v] = normal }
    }
    if hard.contains(&true) {
        let mut sums = vec![(DVec3::ZERO, 0.0); count];
        let faces = file.faces.iter().map(|face| (face.len(), area_vector(face, base).length()));
        let areas = faces.flat_map(|(size, area)| std::iter::repeat_n(area, size));
        for ((v, normal), area) in corners.zip(areas).filter(|((_, normal), _)| *normal != Vec3::ZERO) {
            let (sum, weight) = &mut sums[v];
            *sum += normal.as_dvec3() * area;
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

fn base_normals(neutral: &ObjFile, notes: &mut Vec<String>) -> Option<Base> {
    let Some((stated, hard)) = stated_normals(neutral, &neutral.positions) else {
        if neutral.any_normals {
            notes.push("neutral.obj has normals at some corners only: computed for all".to_owned());
        }
        return None;
    };
    if hard > 0 {
        notes.push(format!("vertices with several normals (hard edges), averaged by face area: {hard}"));
    }
    let (units, scales, lost) = unit_normals(&stated, &neutral.faces, &neutral.positions);
    if lost > 0 {
        notes.push(format!("vertices with no normal or a zero one, computed and constant in all targets: {lost}"));
    }
    Some(Base { stated, hard, scales, units })
}

/// The data of the neutral mesh that targets need.
struct Neutral {
    path: PathBuf,
    file: ObjFile,
    base: Option<Base>,
    origin: Vec3,
}

impl Neutral {
    /// Reads a target. Returns it, and the remarks on it.
    fn target(&self, name: &str, path: &Path) -> Result<(MorphTarget, Vec<&'static str>)> {
        let file = ObjFile::read_target(path, self.origin)?;
        let base = &self.file.positions;
        const REMEDY: &str = "export every target from the neutral mesh, with the same vertices in the same order";
        let refuse = |what: String| Error::input(path, "", what, REMEDY);
        let found = file.positions.len();
        let neutral = self.path.display();
        ensure!(found == base.len(), refuse(format!("{found} vertices, but {neutral} has {}", base.len())));
        let mut remarks = vec![];
        let named = |faces: &Faces| faces.corners.iter().map(|corner| corner.position).collect::<Vec<_>>();
        if file.faces.sizes != self.file.faces.sizes || named(&file.faces) != named(&self.file.faces) {
            // Edges of the neutral mesh on the target, and its own on the neutral mesh.
            let there = stretch(&self.file.faces, base, &file.positions);
            let back = stretch(&file.faces, &file.positions, base);
            // What has no edges counts for nothing.
            let times = there.max(back).max(0.0);
            let what =
                || format!("its vertices are in another order: edges are {times:.1} times as long as in {neutral}");
            ensure!(times <= STRETCH, refuse(what()));
            remarks.push(OTHER_FACES);
        }
        let positions: Vec<(u32, Vec3)> = differences(base, &file.positions).collect();
        for (v, delta) in &positions {
            let what = || format!("vertex {} is too far from its position in the neutral mesh", u64::from(*v) + 1);
            ensure!(delta.is_finite(), refuse(what()));
        }
        let way: f64 = positions.iter().map(|(_, delta)| delta.as_dvec3().length()).sum();
        if way > FAR_FROM * f64::from(diagonal(base)) * base.len() as f64 && is_alike(base, &file.positions) {
            remarks.push(FAR);
        }
        let mut normals = None;
        // A normal that only the target lacks has to be computed, and its delta is from a computed one.
        let has = |(base, normal): (&Vec3, &Vec3)| *base == Vec3::ZERO || *normal != Vec3::ZERO;
        match (&self.base, stated_normals(&file, base)) {
            (None, None) => {}
            (None, Some(_)) => remarks.push(IGNORED),
            (Some(base), Some((stated, hard))) if base.stated.iter().zip(&stated).all(has) => {
                if hard > base.hard {
                    remarks.push(AVERAGED);
                }
                let scaled = differences(&base.stated, &stated).map(|(v, d)| (v, d * base.scales[v as usize]));
                normals = Some(scaled.filter(|(_, delta)| *delta != Vec3::ZERO).collect());
            }
            (Some(_), _) => remarks.push(COMPUTED),
        }
        Ok((MorphTarget { name: name.to_owned(), positions, normals, streams: vec![] }, remarks))
    }
}

/// Iterates over `(index, target − base)` wherever the two differ.
fn differences<'a>(base: &'a [Vec3], target: &'a [Vec3]) -> impl Iterator<Item = (u32, Vec3)> + 'a {
    base.iter().zip(target).enumerate().filter(|(_, (b, t))| b != t).map(|(i, (b, t))| (i as u32, *t - *b))
}

/// Whether two poses are in one shape, which may be moved, turned, mirrored and of another unit: distances between
/// vertices are in one ratio. A person may be half as tall as another, but there are no such units.
fn is_alike(from: &[Vec3], to: &[Vec3]) -> bool {
    let mut sums = DVec3::ZERO;
    for i in 0..from.len() {
        // In all directions, near and far: a prime number mixes them up.
        let j = i.wrapping_mul(7919) % from.len();
        let [a, b] = [from, to].map(|pose| f64::from(pose[i].distance(pose[j])));
        sums += DVec3::new(a * a, a * b, b * b);
    }
    let grown = (0.05..0.69).contains(&(sums.y / sums.x).ln().abs());
    !grown && sums.y * sums.y > (1.0 - DEVIATION * DEVIATION) * sums.x * sums.z
}

/// How many times as long the edges of `faces` are on `to` as on `from`, altogether, each as a part of the diagonal.
fn stretch(faces: &Faces, from: &[Vec3], to: &[Vec3]) -> f64 {
    let edges = |positions: &[Vec3]| -> f64 {
        let at = |corner: &Corner| positions[corner.position as usize].as_dvec3();
        let around = |face: &[Corner]| {
            face.iter().zip(face.iter().cycle().skip(1)).map(|(a, b)| at(a).distance(at(b))).sum::<f64>()
        };
        faces.iter().map(around).sum::<f64>() / f64::from(diagonal(positions))
    };
    edges(to) / edges(from)
}
