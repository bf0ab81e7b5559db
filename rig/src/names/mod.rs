//! Names of shapes: those of ARKit, with the spellings of Face Cap, ICT-FaceKit and Live Link Face; action units of
//! FACS; expression units of MakeHuman; face tracking of OpenXR and MHR; Unified Expressions; visemes; VRM presets.
//! [`retarget`] lets a clip with one kind of names play on a mesh with another.

mod spelling;
mod table;
#[cfg(test)]
mod tests;

use deltamorph::{Result, WeightClip};
use spelling::{Name, Scheme, Side, parts, read};
use std::collections::{HashMap, HashSet};
use table::TABLE;

/// The result of [`retarget`]: a clip in the mesh's own names.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Retargeted {
    /// The clip. Its columns are those that name a target, and the targets that the others drive.
    pub clip: WeightClip,
    /// The columns that name no target, in their order, each with the targets that it drives and their factors. The
    /// list is empty if the mesh has no target for the meaning of the column.
    pub columns: Vec<(String, Vec<(String, f32)>)>,
}

impl Retargeted {
    /// Returns the number of columns that drive targets of other names.
    pub fn mapped(&self) -> usize {
        self.columns.iter().filter(|(_, targets)| !targets.is_empty()).count()
    }

    /// Iterates over the columns for which the mesh has no target.
    pub fn lost(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().filter(|(_, targets)| targets.is_empty()).map(|(name, _)| name.as_str())
    }
}

/// Converts a clip for a mesh whose targets (or a rig whose controls) are called `targets`, such as a captured clip of
/// ARKit's 52 shapes for a mesh with other names.
///
/// A column that names a target is kept. The others are looked up in one table:
///
/// - ARKit: `eyeBlinkLeft`, `eyeBlink_L` (Face Cap, ICT-FaceKit), `EyeBlinkLeft` (Live Link Face); case does not
///   matter;
/// - FACS: `AU12`, `AU1`, `AU01`, with `_L`, `_R`, `L`, `R`, `Left` or `Right` for one side. Intensities go from 0 to
///   1;
/// - MakeHuman: `eye-left-closure`, also with its prefixes `caucasian_`, `asian_` and `african_`;
/// - OpenXR: `XR_FACE_EXPRESSION_JAW_DROP_FB`, `XR_FACE_PARAMETER_INDICES_JAW_DROP_ANDROID`, `JAW_DROP`; Meta's MHR:
///   `jawDrop`; Unified Expressions (VRCFaceTracking): `MouthCornerPullLeft`;
/// - visemes of Oculus: `PP`, `viseme_PP`, `vrc.v_pp`; presets of VRM 0 and VRM 1: `A`, `Blink_L`, `Joy`, `aa`,
///   `blinkLeft`, `happy`.
///
/// Of names of Maya and Unreal the last part counts, for columns and for targets: `face_shapes.ai_browDown_L`,
/// `blendShape1.eyeBlink_L`, `rig:jawOpen`. If parts of several nodes have one name, all of them are driven.
///
/// A shape of both sides drives the targets of both. If a mesh has one target for both sides, each side gives it half
/// of its weight. A shape drives the targets of the same ARKit meaning; without one, an action unit; without one, a
/// unit of MakeHuman, of the first ancestry that the mesh has; without one, the targets of one of the other lists. A
/// viseme for which the mesh has no target drives a mixture of ARKit shapes. If several columns drive one target, their weights add
/// up. A target that has a column of its name is driven by no other.
///
/// A column that neither names a target nor is in the table stays in the clip; [`WeightClip::bind`] refuses it by name.
///
/// # Errors
/// [`Error::Invalid`](deltamorph::Error::Invalid) for two columns of one name, a weight that is not finite, or an incomplete
/// row, as in [`WeightClip::bind`].
///
/// ```
/// use deltamorph::WeightClip;
/// use deltamorph_rig::names;
///
/// let clip = WeightClip {
///     names: vec!["browInnerUp".into(), "tongueOut".into()],
///     fps: 30.0,
///     values: vec![0.5, 1.0],
///     ..WeightClip::default()
/// };
/// let there = names::retarget(&clip, &["browInnerUp_L", "browInnerUp_R"])?;
/// assert_eq!(there.clip.names, ["browInnerUp_L", "browInnerUp_R"]);
/// assert_eq!(there.clip.values, [0.5, 0.5]);
/// assert_eq!(there.lost().collect::<Vec<_>>(), ["tongueOut"]);
/// # Ok::<(), deltamorph::Error>(())
/// ```
pub fn retarget(clip: &WeightClip, targets: &[&str]) -> Result<Retargeted> {
    clip.check()?;
    let stated: HashSet<&str> = clip.names.iter().map(String::as_str).collect();
    let own: HashSet<&str> = targets.iter().copied().filter(|target| stated.contains(target)).collect();
    let known = Targets::new(targets);
    // The columns of the result: each has its name, and columns of the clip with factors.
    let mut made: Vec<(&str, Vec<(usize, f32)>)> = vec![];
    let mut columns = vec![];
    for (index, name) in clip.names.iter().enumerate() {
        let found = if own.contains(name.as_str()) { None } else { known.of(name) };
        let Some(found) = found else {
            made.push((name, vec![(index, 1.0)]));
            continue;
        };
        let found: Vec<(&str, f32)> = found.into_iter().filter(|(target, _)| !own.contains(target)).collect();
        for &(target, factor) in &found {
            match made.iter_mut().find(|(name, _)| *name == target) {
                Some((_, parts)) => parts.push((index, factor)),
                None => made.push((target, vec![(index, factor)])),
            }
        }
        columns.push((name.clone(), found.into_iter().map(|(target, factor)| (target.to_owned(), factor)).collect()));
    }
    let rows = clip.values.chunks_exact(clip.names.len().max(1));
    let value = |row: &[f32], parts: &[(usize, f32)]| parts.iter().map(|(i, factor)| row[*i] * factor).sum();
    let values = rows.flat_map(|row| made.iter().map(move |(_, parts)| value(row, parts))).collect();
    let names = made.iter().map(|(name, _)| (*name).to_owned()).collect();
    Ok(Retargeted { clip: WeightClip { names, values, ..clip.clone() }, columns })
}

/// The targets of a mesh by the meaning of their names, and by the last part of those that have several.
struct Targets<'a> {
    known: HashMap<Name, Vec<&'a str>>,
    by_part: HashMap<&'a str, Vec<&'a str>>,
}

/// A row of the table, and the side of it.
type Shape = (usize, Side);

impl<'a> Targets<'a> {
    fn new(targets: &[&'a str]) -> Self {
        let mut this = Self { known: HashMap::new(), by_part: HashMap::new() };
        for target in targets {
            let (before, last) = parts(target);
            this.by_part.entry(last).or_default().push(target);
            if let Some(name) = read(target) {
                let same = this.known.entry(name).or_default();
                // Of one node, the first target of a meaning.
                if same.iter().all(|other| parts(other).0 != before) {
                    same.push(target);
                }
            }
        }
        this
    }

    /// Returns the targets that a column drives, with factors; `None` if nothing is known of its name.
    fn of(&self, column: &str) -> Option<Vec<(&'a str, f32)>> {
        if let Some(same) = self.by_part.get(parts(column).1) {
            return Some(same.iter().map(|target| (*target, 1.0)).collect());
        }
        let mut all: Vec<(&'a str, f32)> = vec![];
        for ((row, side), factor) in shapes(read(column)?) {
            let mut found = self.targets((row, side));
            if found.is_empty() {
                let parts = TABLE[row]
                    .made_of
                    .iter()
                    .filter_map(|(arkit, share, _)| Some((TABLE.iter().position(|row| row.arkit == *arkit)?, *share)));
                let parts = parts.map(|(part, share)| (self.targets((part, side)), share));
                found = parts.flat_map(|(found, share)| found.into_iter().map(move |(t, f)| (t, f * share))).collect();
            }
            for (target, share) in found {
                // FACS has one unit for both lips that roll in: of several shapes that lead to one target, one counts.
                match all.iter_mut().find(|(name, _)| *name == target) {
                    Some((_, sum)) => *sum = sum.max(share * factor),
                    None => all.push((target, share * factor)),
                }
            }
        }
        Some(all)
    }

    fn targets(&self, (row, side): Shape) -> Vec<(&'a str, f32)> {
        let arkit = self.sides(Scheme::Arkit(row), side);
        if !arkit.is_empty() {
            return arkit;
        }
        let facs = TABLE[row].facs.iter().map(|numbers| self.units(*numbers, side, TABLE[row].sided));
        if let Some(found) = facs.into_iter().find(|found| !found.is_empty()) {
            return found;
        }
        let factor = TABLE[row].makehuman.map_or(0.0, |(_, to, _)| to);
        let units = (0..spelling::ANCESTRIES.len()).map(|from| self.sides(Scheme::MakeHuman(row, from), side));
        if let Some(found) = units.into_iter().find(|found| !found.is_empty()) {
            return found.into_iter().map(|(target, share)| (target, share * factor)).collect();
        }
        let found = self.others((row, side));
        if !found.is_empty() {
            return found;
        }
        let arkit = TABLE[row].arkit;
        let parts = TABLE.iter().enumerate().flat_map(|(i, row)| row.made_of.iter().map(move |part| (i, part)));
        let parts = parts.filter(|(_, (of, _, to))| *of == arkit && *to > 0.0);
        let found = parts.map(|(i, (_, _, to))| (self.others((i, side)), *to));
        found.flat_map(|(found, to)| found.into_iter().map(move |(target, share)| (target, share * to))).collect()
    }

    /// Returns the targets of the first of the other vocabularies that the mesh has for a row.
    fn others(&self, (row, side): Shape) -> Vec<(&'a str, f32)> {
        let mut of = None;
        let mut all = vec![];
        for other in TABLE[row].others.iter() {
            let fits = other.side.is_none_or(|fixed| side == fixed || side == Side::Both);
            if fits && of.is_none_or(|of| of == other.of) {
                let side = if other.name.contains('*') { side } else { Side::Both };
                let found = self.sides(Scheme::Other(other.of, other.name), side);
                of = of.or((!found.is_empty()).then_some(other.of));
                all.extend(found);
            }
        }
        all
    }

    /// Returns the action units for a shape; the two sides may have different ones.
    fn units(&self, [left, right]: [u8; 2], side: Side, sided: bool) -> Vec<(&'a str, f32)> {
        match (left == right, side) {
            (true, _) => {
                // Two shapes with one unit in common (lips that roll in) give half of it each.
                let shared = TABLE.iter().filter(|row| row.facs.contains(&[left, right])).count() as f32;
                let found = self.sides(Scheme::Facs(left), side).into_iter();
                found.map(|(target, share)| (target, share / shared)).collect()
            }
            (false, Side::Left) => self.sides(Scheme::Facs(left), side),
            (false, Side::Right) => self.sides(Scheme::Facs(right), side),
            // The jaw moves to one side at a time: half of each side would be no movement.
            (false, Side::Both) if !sided => {
                let (number, side) = if left == 0 { (right, Side::Right) } else { (left, Side::Left) };
                self.at(Scheme::Facs(number), side).map(|target| (target, 1.0)).collect()
            }
            (false, Side::Both) => [(left, Side::Left), (right, Side::Right)]
                .into_iter()
                .flat_map(|(number, side)| self.sides(Scheme::Facs(number), side))
                .collect(),
        }
    }

    /// Returns the targets of `scheme` for one or both sides.
    fn sides(&self, scheme: Scheme, side: Side) -> Vec<(&'a str, f32)> {
        let whole: Vec<_> = self.at(scheme, side).map(|target| (target, 1.0)).collect();
        if !whole.is_empty() {
            return whole;
        }
        match side {
            Side::Both => {
                [Side::Left, Side::Right].into_iter().flat_map(|s| self.at(scheme, s)).map(|t| (t, 1.0)).collect()
            }
            Side::Left | Side::Right => self.at(scheme, Side::Both).map(|target| (target, 0.5)).collect(),
        }
    }

    fn at(&self, scheme: Scheme, side: Side) -> impl Iterator<Item = &'a str> {
        self.known.get(&Name { scheme, side }).into_iter().flatten().copied()
    }
}

/// Returns the shapes of ARKit that a name stands for, with factors.
fn shapes(name: Name) -> Vec<(Shape, f32)> {
    match name.scheme {
        Scheme::Arkit(row) => vec![((row, name.side), 1.0)],
        Scheme::MakeHuman(row, _) => vec![((row, name.side), TABLE[row].makehuman.map_or(0.0, |(_, _, from)| from))],
        Scheme::Other(of, other) => {
            let rows = TABLE.iter().enumerate().flat_map(|(i, row)| row.others.iter().map(move |other| (i, other)));
            let rows = rows.filter(|(_, found)| (found.of, found.name) == (of, other));
            rows.map(|(i, found)| ((i, found.side.unwrap_or(name.side)), 1.0)).collect()
        }
        Scheme::Facs(number) => {
            TABLE.iter().enumerate().flat_map(|(i, row)| meant(number, name.side, i, row)).collect()
        }
    }
}

/// Returns the shape that the action unit `number` stands for in a row, with its factor.
fn meant(number: u8, side: Side, index: usize, row: &table::Row) -> Option<(Shape, f32)> {
    let [left, right] = row.facs.iter().fold([false; 2], |[l, r], n| [l || n[0] == number, r || n[1] == number]);
    let side = match (left, right, side) {
        (true, true, _) => side,
        (true, false, Side::Left | Side::Both) if row.sided => Side::Left,
        (false, true, Side::Right | Side::Both) if row.sided => Side::Right,
        (true, false, Side::Left) | (false, true, Side::Right) => Side::Both,
        (true, false, _) | (false, _, _) => return None,
    };
    Some(((index, side), 1.0))
}
