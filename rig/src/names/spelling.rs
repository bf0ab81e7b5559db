//! Spellings of names.

use super::table::{TABLE, Vocabulary};

/// A side of the face, from the face's own view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Side {
    Both,
    Left,
    Right,
}

/// The scheme of a name: the row of the table, or the number of an action unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Scheme {
    Arkit(usize),
    Facs(u8),
    /// Row of the table, and index of the ancestry.
    MakeHuman(usize, usize),
    /// The name of another vocabulary, as the table has it.
    Other(Vocabulary, &'static str),
}

/// The meaning of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Name {
    pub scheme: Scheme,
    pub side: Side,
}

/// Prefixes of MakeHuman's units, which exist for each ancestry.
pub(super) const ANCESTRIES: [&str; 4] = ["", "caucasian_", "asian_", "african_"];

const ENDS: [(&str, Side); 8] = [
    ("_left", Side::Left),
    ("_right", Side::Right),
    ("left", Side::Left),
    ("right", Side::Right),
    ("_l", Side::Left),
    ("_r", Side::Right),
    (".l", Side::Left),
    (".r", Side::Right),
];

/// Prefixes and endings of names in OpenXR, and prefixes of visemes.
const STARTS: [&str; 5] = ["xrfaceexpression2", "xrfaceexpression", "xrfaceparameterindices", "viseme", "vrc.v"];
const OPENXR_ENDS: [&str; 2] = ["fb", "android"];

/// Returns the meaning of a name, or of its [last part](parts); `None` if it is not in the table.
pub(super) fn read(name: &str) -> Option<Name> {
    let known = |name: &str| arkit(name).or_else(|| facs(name)).or_else(|| makehuman(name)).or_else(|| other(name));
    known(name).or_else(|| known(parts(name).1))
}

/// Splits a name of Maya or Unreal into the deformer or node, empty if there is none, and the last part:
/// `face_shapes.ai_browDown_L` is `browDown_L`. A side after a dot is no part of its own.
pub(super) fn parts(name: &str) -> (&str, &str) {
    let is_side = |part: &str| ["l", "r", "left", "right"].iter().any(|side| part.eq_ignore_ascii_case(side));
    let mut cuts = name.rmatch_indices(['.', ':', '|', '/']).map(|(at, _)| (&name[..at], &name[at + 1..]));
    let (before, last) = cuts.find(|(_, last)| !is_side(last.trim())).unwrap_or(("", name));
    (before, last.strip_prefix("ai_").unwrap_or(last))
}

fn arkit(name: &str) -> Option<Name> {
    let row = |base: &str| TABLE.iter().position(|row| !base.is_empty() && row.arkit.eq_ignore_ascii_case(base));
    // jawLeft is a shape, not the left side of one.
    if let Some(row) = row(name) {
        return Some(Name { scheme: Scheme::Arkit(row), side: Side::Both });
    }
    let low = name.to_ascii_lowercase();
    ENDS.iter().find_map(|(end, side)| {
        let row = row(low.strip_suffix(end)?)?;
        Some(Name { scheme: Scheme::Arkit(row), side: *side })
    })
}

/// `AU12`, `AU01`, `AU12_L`, `AU12Left`. Case matters: the `AU12_r` of OpenFace is an intensity from 0 to 5 of both
/// sides.
fn facs(name: &str) -> Option<Name> {
    let rest = name.strip_prefix("AU")?;
    let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    if !(1..=2).contains(&digits) {
        return None;
    }
    let number: u8 = rest[..digits].parse().ok()?;
    let side = match &rest[digits..] {
        "" => Side::Both,
        "_L" | "L" | "_Left" | "Left" => Side::Left,
        "_R" | "R" | "_Right" | "Right" => Side::Right,
        _ => return None,
    };
    let known = number > 0 && TABLE.iter().any(|row| row.facs.iter().any(|numbers| numbers.contains(&number)));
    known.then_some(Name { scheme: Scheme::Facs(number), side })
}

fn makehuman(name: &str) -> Option<Name> {
    // The empty prefix always fits, so the others come first.
    let (from, unit) =
        ANCESTRIES.iter().enumerate().rev().find_map(|(i, start)| Some((i, name.strip_prefix(start)?)))?;
    let is = |pattern: &str, side: &str| pattern.replace('*', side) == unit;
    TABLE.iter().enumerate().find_map(|(row, shape)| {
        let (pattern, ..) = shape.makehuman?;
        let side = match pattern.contains('*') {
            false if pattern == unit => Side::Both,
            true if is(pattern, "left") => Side::Left,
            true if is(pattern, "right") => Side::Right,
            true | false => return None,
        };
        Some(Name { scheme: Scheme::MakeHuman(row, from), side })
    })
}

fn other(name: &str) -> Option<Name> {
    let plain = name.chars().filter(|c| !['_', '-', ' '].contains(c)).collect::<String>().to_ascii_lowercase();
    let start = STARTS.iter().find_map(|start| plain.strip_prefix(start));
    let bare = start.map_or(&*plain, |rest| OPENXR_ENDS.iter().find_map(|end| rest.strip_suffix(end)).unwrap_or(rest));
    TABLE.iter().flat_map(|row| row.others).find_map(|other| {
        let pattern = other.name.to_ascii_lowercase();
        let Some((before, after)) = pattern.split_once('*') else {
            return (pattern == bare).then_some(Name { scheme: Scheme::Other(other.of, other.name), side: Side::Both });
        };
        let side = bare.strip_prefix(before)?.strip_suffix(after)?;
        // Unified Expressions have a browLowererLeft that is not the browLowerer_L of OpenXR.
        let side = match (side, other.of) {
            ("", _) => Side::Both,
            ("l", of) if of != Vocabulary::Unified => Side::Left,
            ("r", of) if of != Vocabulary::Unified => Side::Right,
            ("left", of) if of != Vocabulary::OpenXr => Side::Left,
            ("right", of) if of != Vocabulary::OpenXr => Side::Right,
            _ => return None,
        };
        Some(Name { scheme: Scheme::Other(other.of, other.name), side })
    })
}
