//! Look-up of targets by name.

use crate::error::{Error, Result, ensure};
use crate::names::composed;
use std::collections::{HashMap, HashSet};
use std::mem::take;

/// Most letters of a name for which a similar one is searched: the time grows as their square.
const NEAR_LETTERS: usize = 64;

/// The targets that each name means and that none before it does; `None` if there is no such target. An error with a
/// name that is there twice, and that of a target.
pub fn meanings<'n>(names: &'n [String], targets: &[&str]) -> Result<Vec<Option<Vec<usize>>>, &'n str> {
    // Reversed, so that the first of several targets of one name is kept.
    let own: HashMap<String, usize> = targets.iter().enumerate().rev().map(|(i, name)| (composed(name), i)).collect();
    let own = |name: &String| own.get(&composed(name)).copied();
    let mut by_key: HashMap<String, Vec<usize>> = HashMap::new();
    targets.iter().enumerate().for_each(|(i, target)| by_key.entry(key(target)).or_default().push(i));
    let mut taken = HashSet::new();
    for name in names {
        ensure!(own(name).is_none_or(|target| taken.insert(target)), name.as_str());
    }
    // Taken out of the map, since whatever means them later finds none left.
    let mut rest = |key: &str| by_key.get_mut(key).map(take);
    let of = |name: &String| {
        if let Some(target) = own(name) {
            return Some(vec![target]);
        }
        let key = Some(key(name)).filter(|key| !key.is_empty())?;
        let mut found = rest(&key).or_else(|| {
            let sides = ["left", "right"].map(|side| rest(&format!("{key}{side}")));
            sides.into_iter().flatten().reduce(|left, right| [left, right].concat())
        })?;
        found.retain(|target| taken.insert(*target));
        Some(found)
    };
    Ok(names.iter().map(of).collect())
}

/// What is the same in all spellings of a name.
fn key(name: &str) -> String {
    let name: &str = &composed(name);
    let is_side = |part: &str| ["l", "r", "left", "right"].iter().any(|side| part.eq_ignore_ascii_case(side));
    // The last part of a path of nodes; neither a side nor a number is one.
    let letters_end = name.rfind(char::is_alphabetic).map_or(0, |at| at + 1);
    let is_part = |part: &str| !is_side(part) && name.len() - part.len() < letters_end;
    let mut parts = name.rmatch_indices(['.', ':', '|', '/']).map(|(at, _)| &name[at + 1..]);
    let last = parts.find(|part| is_part(part)).unwrap_or(name);
    let last = last.strip_prefix("ai_").unwrap_or(last);
    let (before, end) = last.rsplit_once(|c: char| !c.is_alphanumeric()).unwrap_or((last, ""));
    match end {
        "l" | "L" => letters(before) + "left",
        "r" | "R" => letters(before) + "right",
        _ => letters(last),
    }
}

/// What naming schemes have in common: they differ in case and separators.
fn letters(text: &str) -> String {
    text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// An error for a `name` that is not in `known`, the names of targets.
pub fn unknown(what: String, name: &str, known: &[&str]) -> Error {
    let near = closest(name, known).map(|near| format!("use '{near}' if that is meant"));
    Error::invalid(what, near.unwrap_or_else(|| "use a target of the mesh".to_owned()))
}

/// The target nearest to `name` by edit distance, if it is close enough, or one that ends so, behind its nodes. None
/// for long names.
pub fn closest<'a>(name: &str, targets: &[&'a str]) -> Option<&'a str> {
    let wanted = letters(name);
    let length = wanted.chars().count();
    let most = (length / 3).max(2).min(length.checked_sub(1)?);
    let distance = |target: &str| {
        let other = letters(target);
        if length > 3 && other.len() > wanted.len() && other.ends_with(&wanted) {
            return Some(1);
        }
        let longer = other.chars().count();
        // No distance is less than the difference of the lengths.
        let is_near = length.max(longer) <= NEAR_LETTERS && length.abs_diff(longer) <= most;
        is_near.then(|| edits(&wanted, &other)).filter(|distance| *distance <= most)
    };
    let near = targets.iter().filter_map(|target| Some((distance(target)?, *target)));
    near.min_by_key(|(distance, _)| *distance).map(|(_, target)| target)
}

/// How many letters of a word are changed, added or left out to make it the other one.
fn edits(from: &str, to: &str) -> usize {
    // For each beginning of `to`, those from the beginning of `from` so far.
    let mut row: Vec<usize> = (0..=to.chars().count()).collect();
    for (i, letter) in from.chars().enumerate() {
        let mut before = std::mem::replace(&mut row[0], i + 1);
        for (j, other) in to.chars().enumerate() {
            let changed = before + usize::from(letter != other);
            before = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(before + 1);
        }
    }
    row[row.len() - 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::WeightClip;

    /// The weights of targets that a clip of one row moves, and the notes on it.
    fn moved(columns: &[(&str, f32)], targets: &[&str]) -> (Vec<(String, f32)>, String) {
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        let values = columns.iter().map(|(_, weight)| *weight).collect();
        let bound = match (WeightClip { names, values, ..WeightClip::default() }).bind(targets) {
            Ok(bound) => bound,
            Err(error) => return (vec![], error.to_string()),
        };
        let weights = targets.iter().map(|name| (*name).to_owned()).zip(bound.frame(0).unwrap());
        (weights.filter(|(_, weight)| *weight != 0.0).collect(), bound.notes.join("; "))
    }

    #[test]
    fn one_name_in_many_spellings() {
        for column in [
            "browDownLeft",
            "BrowDownLeft",
            "browDown_L",
            "browDown.l",
            "brow-down-left",
            "brow_down_L",
            "face.ai_browDown_L",
            "Armature|face:browDown.L",
            "blendShape1.browDownLeft",
        ] {
            for target in ["browDownLeft", "browDown_L", "face_shapes.ai_browDown_L", "BROW DOWN LEFT"] {
                let (found, notes) = moved(&[(column, 0.5)], &["browDownRight", "browDown", target]);
                assert_eq!((found, notes.as_str()), (vec![(target.to_owned(), 0.5)], ""), "{column} for {target}");
            }
        }
    }

    #[test]
    fn a_column_drives_both_sides_and_each_node_of_its_name() {
        let both = [("browInnerUp_L".to_owned(), 0.5), ("browInnerUp_R".to_owned(), 0.5)];
        let (found, notes) = moved(&[("browInnerUp", 0.5)], &["browInnerUp_L", "browInnerUp_R"]);
        assert_eq!(
            (&found[..], notes.as_str()),
            (&both[..], "columns that move several targets at once: 'browInnerUp'")
        );
        let nodes = ["head.jawOpen", "teeth.jawOpen"];
        let all = nodes.map(|node| (node.to_owned(), 1.0));
        assert_eq!(moved(&[("jawOpen", 1.0)], &nodes).0, all);
        assert_eq!(moved(&[("teeth.jawOpen", 1.0)], &nodes).0, all[1..]);
    }

    #[test]
    fn a_target_takes_one_column_its_own_first() {
        let own = vec![("jawOpen".to_owned(), 1.0)];
        for (columns, left_out) in
            [([("JawOpen", 0.5), ("jawOpen", 1.0)], "JawOpen"), ([("JawOpen", 1.0), ("jaw_open", 0.5)], "jaw_open")]
        {
            let note = format!("left out, as other columns move their targets: '{left_out}'");
            assert_eq!(moved(&columns, &["jawOpen"]), (own.clone(), note));
        }
        // Two of a name, of a target and of none.
        let twice = [("jawOpen", 1.0), ("time", 0.0), ("time", 0.0)];
        assert_eq!(moved(&twice, &["jawOpen"]).0, own);
        let (_, error) = moved(&[("jawOpen", 1.0), ("jawOpen", 0.5)], &["jawOpen"]);
        assert!(error.contains("two columns are called 'jawOpen'"), "{error}");
    }

    #[test]
    fn what_means_no_target_is_named() {
        // A number after a dot is no name of its own.
        let columns = [("smile.001", 1.0), ("", 1.0), ("_", 1.0), ("tongueOut", 1.0), ("a", 1.0)];
        let (found, notes) = moved(&columns, &["frown.001", "..", "left", "a"]);
        assert_eq!(
            (found.len(), notes.as_str()),
            (1, "1 of 5 columns move targets; left out, as no target is called so: 'smile.001', '', '_', 'tongueOut'")
        );
        assert!(
            moved(&columns[..4], &["frown.001"]).1.contains("none of its columns ('smile.001', '', '_', 'tongueOut')")
        );
    }

    #[test]
    fn products_of_counts_are_neither_held_nor_walked() {
        let names: Vec<String> = (0..2000).map(|i| format!("n{i}.jaw")).collect();
        let targets: Vec<&str> = names.iter().map(String::as_str).collect();
        let clip = WeightClip { names: vec!["jaw".into()], values: vec![0.5; 20_000], ..WeightClip::default() };
        let mut bound = crate::BoundClip::default();
        let took = allocation_counter::measure(|| bound = clip.bind(&targets).unwrap());
        assert!(took.bytes_max < 2 << 20, "{} bytes", took.bytes_max);
        assert_eq!((bound.column_count(), bound.frame(19_999).unwrap()), (2000, vec![0.5; 2000]));
        // Long names are not compared: minutes, if they were.
        let long = "a".repeat(1 << 20);
        assert_eq!(closest(&long, &[&("b".to_owned() + &long[1..])]), None);
        assert_eq!(closest("jawOpne", &["jawOpen", &long]), Some("jawOpen"));
        for (from, to, count) in
            [("", "", 0), ("", "äb", 2), ("kitten", "sitting", 3), ("flaw", "lawn", 2), ("é", "é", 0)]
        {
            assert_eq!((edits(from, to), edits(to, from)), (count, count), "{from} {to}");
        }
    }
}
