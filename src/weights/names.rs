//! Look-up of targets by name.

use super::WeightClip;
use crate::error::Error;
use std::collections::{HashMap, HashSet};
use strsim::levenshtein;
use unicode_normalization::UnicodeNormalization;

impl WeightClip {
    /// Renames columns to those of `targets` that they mean; returns the clip, and the columns that mean none, which it
    /// does not have.
    ///
    /// A column that names a target keeps its name. Any other means the targets of the same name but for Unicode form,
    /// case and separators, the side (`_L` or `.L` for `Left`), and what stands before it: a node, as in
    /// `face.jawOpen`, and Maya's `ai_`. A column without a side means the targets of both sides, if none has its own
    /// name. Each target takes the first column that means it.
    ///
    /// ```
    /// use deltamorph::WeightClip;
    ///
    /// let names = ["face.ai_browDown_L", "mouth-smile", "tongueOut"].map(String::from).to_vec();
    /// let clip = WeightClip { names, fps: 30.0, values: vec![0.25, 0.5, 1.0], ..WeightClip::default() };
    /// let (clip, lost) = clip.renamed(&["browDownLeft", "mouthSmile_L", "mouthSmile_R"]);
    /// assert_eq!(clip.names, ["browDownLeft", "mouthSmile_L", "mouthSmile_R"]);
    /// assert_eq!(clip.values, [0.25, 0.5, 0.5]);
    /// assert_eq!(lost, ["tongueOut"]);
    /// ```
    pub fn renamed(&self, targets: &[&str]) -> (Self, Vec<String>) {
        let known: HashSet<&str> = targets.iter().copied().collect();
        let own = self.names.iter().map(String::as_str).filter(|name| known.contains(name));
        let mut taken: HashSet<&str> = own.collect();
        let mut by_key: HashMap<String, Vec<&str>> = HashMap::new();
        targets.iter().for_each(|target| by_key.entry(key(target)).or_default().push(target));
        // The name of each column of the result, and the column that it has its weights from.
        let mut columns: Vec<(&str, usize)> = vec![];
        let mut lost = vec![];
        for (index, name) in self.names.iter().enumerate() {
            if known.contains(name.as_str()) {
                columns.push((name, index));
                continue;
            }
            let found = meant(name, &by_key);
            if found.is_empty() {
                lost.push(name.clone());
            }
            columns.extend(found.into_iter().filter(|target| taken.insert(target)).map(|target| (target, index)));
        }
        let rows = self.values.chunks(self.names.len().max(1));
        // An incomplete row stays incomplete, for `bind` to refuse.
        let values = rows.flat_map(|row| columns.iter().filter_map(|(_, index)| row.get(*index).copied())).collect();
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        (Self { names, values, ..self.clone() }, lost)
    }
}

/// The targets that a column means.
fn meant<'a>(column: &str, targets: &HashMap<String, Vec<&'a str>>) -> Vec<&'a str> {
    let column = key(column);
    if column.is_empty() {
        return vec![];
    }
    let called = |side: &str| targets.get(&format!("{column}{side}")).cloned().unwrap_or_default();
    let same = called("");
    if !same.is_empty() {
        return same;
    }
    ["left", "right"].into_iter().flat_map(called).collect()
}

/// What is the same in all spellings of a name.
fn key(name: &str) -> String {
    let name: &str = &name.nfc().collect::<String>();
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

/// The target nearest to `name` by edit distance, if it is close enough, or one that ends so, behind its nodes.
pub fn closest<'a>(name: &str, targets: &[&'a str]) -> Option<&'a str> {
    let wanted = letters(name);
    let length = wanted.chars().count();
    let far = |target: &str| match letters(target) {
        longer if length > 3 && longer.len() > wanted.len() && longer.ends_with(&wanted) => 1,
        other => levenshtein(&wanted, &other),
    };
    let (distance, target) = targets.iter().map(|target| (far(target), *target)).min_by_key(|(d, _)| *d)?;
    (distance <= (length / 3).max(2) && distance < length.max(1)).then_some(target)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Renames a clip of one row; returns names with weights, and what was lost.
    fn renamed(columns: &[(&str, f32)], targets: &[&str]) -> (Vec<(String, f32)>, Vec<String>) {
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        let values = columns.iter().map(|(_, weight)| *weight).collect();
        let (clip, lost) = WeightClip { names, values, ..WeightClip::default() }.renamed(targets);
        (clip.names.into_iter().zip(clip.values).collect(), lost)
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
                let (found, lost) = renamed(&[(column, 0.5)], &["browDownRight", "browDown", target]);
                assert_eq!((found, lost), (vec![(target.to_owned(), 0.5)], vec![]), "{column} for {target}");
            }
        }
    }

    #[test]
    fn a_column_drives_both_sides_and_each_node_of_its_name() {
        let both = [("browInnerUp_L".to_owned(), 0.5), ("browInnerUp_R".to_owned(), 0.5)];
        assert_eq!(renamed(&[("browInnerUp", 0.5)], &["browInnerUp_L", "browInnerUp_R"]).0, both);
        let nodes = ["head.jawOpen", "teeth.jawOpen"];
        let all = nodes.map(|node| (node.to_owned(), 1.0));
        assert_eq!(renamed(&[("jawOpen", 1.0)], &nodes).0, all);
        assert_eq!(renamed(&[("teeth.jawOpen", 1.0)], &nodes).0, all[1..]);
    }

    #[test]
    fn a_target_takes_one_column_its_own_first() {
        let own = vec![("jawOpen".to_owned(), 1.0)];
        assert_eq!(renamed(&[("JawOpen", 0.5), ("jawOpen", 1.0)], &["jawOpen"]), (own.clone(), vec![]));
        assert_eq!(renamed(&[("JawOpen", 1.0), ("jaw_open", 0.5)], &["jawOpen"]).0, own);
    }

    #[test]
    fn what_means_no_target_is_named() {
        // A number after a dot is no name of its own.
        let columns = [("smile.001", 1.0), ("", 1.0), ("_", 1.0), ("tongueOut", 1.0)];
        let lost = columns.map(|(name, _)| name.to_owned());
        assert_eq!(renamed(&columns, &["frown.001", "..", "left"]), (vec![], lost.to_vec()));
    }
}
