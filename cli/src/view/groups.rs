//! Groups of targets by the part of a face in their names, and pairs of left and right.

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

/// The part of a face that a target's name speaks of: its place in `PARTS`.
fn part(name: &str) -> usize {
    let name = name.to_lowercase();
    PARTS.iter().position(|(_, words)| words.iter().any(|word| name.contains(word))).unwrap_or(PARTS.len() - 1)
}

/// Whether a target's name speaks of a part of a face.
pub fn of_face(name: &str) -> bool {
    part(name) < PARTS.len() - 1
}

/// Groups with at least one target. Targets are in the order of the mesh, with twins next to each other.
pub fn groups(names: &[String]) -> Vec<Group> {
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

/// The target on the other side of the face: jawLeft of jawRight, brow_L of brow_R.
pub fn twin(names: &[String], target: usize) -> Option<usize> {
    const SIDES: [[&str; 2]; 4] = [["Left", "Right"], ["left", "right"], ["LEFT", "RIGHT"], ["_l_", "_r_"]];
    const ENDS: [[&str; 2]; 4] = [["_L", "_R"], ["_l", "_r"], [".L", ".R"], [".l", ".r"]];
    let name = &names[target];
    let other = |from: &str, to: &str, end: bool| {
        let changed = if end {
            name.strip_suffix(from).map(|stem| format!("{stem}{to}"))
        } else {
            name.rfind(from).map(|at| format!("{}{to}{}", &name[..at], &name[at + from.len()..]))
        };
        changed.and_then(|changed| names.iter().position(|name| *name == changed))
    };
    let both = |sides: &[[&str; 2]], end| {
        sides.iter().find_map(|[left, right]| other(left, right, end).or_else(|| other(right, left, end)))
    };
    both(&SIDES, false).or_else(|| both(&ENDS, true))
}

/// Number of bytes at the beginning of each name that it has in common with its neighbours, up to the end of a word,
/// which lists show once; 0 where these are few or it is short.
pub fn prefixes(names: &[&str]) -> Vec<usize> {
    /// What is worth a line of its own: so many bytes, of so many names.
    const LEAST: usize = 6;
    const NAMES: usize = 3;
    let common = |a: &str, b: &str| {
        let same = a.char_indices().zip(b.chars()).find(|((_, a), b)| a != b).map(|((at, _), _)| at);
        let same = same.unwrap_or(a.len().min(b.len()));
        let word = a[..same].rfind(|c: char| !c.is_alphanumeric());
        word.map_or(0, |at| at + a[at..].chars().next().map_or(0, char::len_utf8))
    };
    let mut found = vec![0; names.len()];
    let mut first = 0;
    while first < names.len() {
        let (mut end, mut prefix) = (first + 1, usize::MAX);
        while let Some(next) = names.get(end) {
            let with_next = common(names[first], next).min(prefix);
            if with_next < LEAST {
                break;
            }
            (end, prefix) = (end + 1, with_next);
        }
        if end - first >= NAMES {
            found[first..end].fill(prefix);
        }
        first = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_share_what_they_begin_with() {
        let names = ["face_shapes.ai_browDown_L", "face_shapes.ai_browDown_R", "face_shapes.ai_browUp", "jawOpen"];
        assert_eq!(prefixes(&names), ["face_shapes.ai_".len(), 15, 15, 0]);
        assert_eq!(prefixes(&["mouth_a", "mouth_b", "mouth_c", "a_b", "a_c", "a_d"]), [6, 6, 6, 0, 0, 0]);
        assert_eq!(prefixes(&["eyeBlink_L", "eyeBlink_R", "jawOpen", "jawOpenWide", "jawOpenMore"]), [0; 5]);
        assert_eq!(prefixes(&["größe-höher", "größe-höhle", "größe-", "größer"]), [8, 8, 8, 0]);
        assert_eq!(prefixes(&[]), [0; 0]);
    }

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
