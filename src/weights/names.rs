//! Look-up of targets by name.

use crate::error::Error;

/// An error for a `name` that is not in `known`; `of` says what the names are: targets of a mesh, or controls.
pub fn unknown(what: String, name: &str, of: &str, known: &[&str]) -> Error {
    Error::invalid(
        what,
        match closest(name, known) {
            Some(near) => format!("use '{near}' if that is meant"),
            None => format!("use a {of}"),
        },
    )
}

/// The target nearest to `name` by edit distance, if it is close enough.
pub fn closest<'a>(name: &str, targets: &[&'a str]) -> Option<&'a str> {
    // Naming schemes differ in case and separators.
    let plain = |s: &str| s.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect::<Vec<_>>();
    let wanted = plain(name);
    let (distance, target) = targets.iter().map(|t| (distance(&wanted, &plain(t)), *t)).min_by_key(|(d, _)| *d)?;
    (distance <= (wanted.len() / 3).max(2) && distance < wanted.len().max(1)).then_some(target)
}

fn distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
