//! Groups of targets by the part of a face in their names, with twins next to each other.

use crate::lod::twins::twin;

/// Parts of a face in the order listed, and words in the names of their targets.
const PARTS: [(&str, &[&str]); 7] = [
    ("Brows", &["brow"]),
    ("Eyes", &["eye", "blink", "lid", "look", "pupil", "gaze"]),
    ("Jaw", &["jaw", "chin"]),
    ("Tongue", &["tongue"]),
    ("Cheeks and nose", &["cheek", "nose", "sneer", "nostril"]),
    ("Mouth", &["mouth", "lip", "smile", "frown", "dimple", "pucker", "funnel", "teeth", "viseme"]),
    ("Others", &[]),
];

/// A group of targets, by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    pub name: &'static str,
    pub targets: Vec<usize>,
}

/// Groups with at least one target. Targets are in the order of the mesh, with twins next to each other.
pub fn groups(names: &[String]) -> Vec<Group> {
    let part = |name: &String| {
        let name = name.to_lowercase();
        PARTS.iter().position(|(_, words)| words.iter().any(|word| name.contains(word))).unwrap_or(PARTS.len() - 1)
    };
    let mut groups: Vec<Group> = PARTS.iter().map(|(name, _)| Group { name, targets: vec![] }).collect();
    let mut listed = vec![false; names.len()];
    for (i, name) in names.iter().enumerate() {
        for target in [Some(i), twin(names, i)].into_iter().flatten() {
            if !std::mem::replace(&mut listed[target], true) {
                groups[part(name)].targets.push(target);
            }
        }
    }
    groups.retain(|group| !group.targets.is_empty());
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn twins_find_each_other() {
        let names =
            named(&["eyeBlinkLeft", "jawOpen", "eyeBlinkRight", "brow_up_L", "brow_up_R", "mouthLeft", "x.r", "_L"]);
        let twins: Vec<_> = (0..names.len()).map(|i| twin(&names, i)).collect();
        assert_eq!(twins, [Some(2), None, Some(0), Some(4), Some(3), None, None, None]);
    }

    #[test]
    fn every_target_is_in_one_group_beside_its_twin() {
        let names =
            named(&["mouthSmileLeft", "eyeBlinkLeft", "phoneme", "mouthSmileRight", "BrowDown", "eyeBlinkRight"]);
        let groups = groups(&names);
        let listed = |name: &str| groups.iter().find(|group| group.name == name).map(|group| group.targets.clone());
        assert_eq!((listed("Mouth"), listed("Eyes")), (Some(vec![0, 3]), Some(vec![1, 5])));
        assert_eq!((listed("Brows"), listed("Others"), listed("Jaw")), (Some(vec![4]), Some(vec![2]), None));
    }
}
