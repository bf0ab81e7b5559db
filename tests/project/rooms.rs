//! Allowed uses between the rooms of src/, listed below from the bottom up: a room only uses rooms above its own line,
//! so there are no cycles; tests may use anything.

use std::collections::BTreeSet;
use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

/// Each room, and the rooms that it uses.
const ROOMS: &[(&str, &str)] = &[
    ("error", ""),
    ("math", ""),
    ("names", ""),
    ("simd", ""),
    ("io", "error"),
    ("asset", "error math names"),
    ("weights", "error names"),
    ("abi", "error asset"),
    ("pack", "error math names simd io asset weights abi"),
    ("lod", "error math asset weights pack"),
    ("plan", "error math pack"),
    ("crowd", ""),
    ("gpu", "error abi pack plan"),
    ("update", "error asset weights abi pack lod plan gpu"),
    ("cpu", "error simd asset weights abi pack plan crowd update"),
    ("after", "error asset abi pack plan gpu update"),
    ("reference", "math asset pack after"),
    ("import", "error math names io asset weights pack"),
    ("engine", "error asset abi pack plan crowd gpu update after"),
];

/// Collects the sources below a folder, without tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in read_dir(folder).expect("a folder of src/") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy();
        if path.is_dir() && name != "tests" {
            sources(&path, found);
        } else if name.ends_with(".rs") && !name.ends_with("tests.rs") {
            found.push(path);
        }
    }
}

#[test]
fn rooms_use_those_below_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = vec![];
    sources(&src, &mut found);
    found.sort();
    let (mut wrong, mut used) = (vec![], BTreeSet::new());
    for path in found {
        let place = path.strip_prefix(&src).expect("below src/");
        let room = place.iter().next().expect("a room").to_string_lossy().trim_end_matches(".rs").to_owned();
        // The root of the crate and test-only rooms may use anything.
        if ["lib", "testing"].contains(&&*room) {
            continue;
        }
        let Some((_, allowed)) = ROOMS.iter().find(|(name, _)| *name == room) else {
            wrong.push(format!("src/{room}: a new room; give it a line"));
            continue;
        };
        let text = read_to_string(&path).expect("a source");
        for (number, line) in (1..).zip(text.lines().take_while(|line| *line != "mod tests {")) {
            for after in line.split("//").next().unwrap_or_default().split("crate::").skip(1) {
                let name = after.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
                if name != room && !allowed.split(' ').any(|room| room == name) {
                    wrong.push(format!("src/{}:{number}: {room} uses '{name}'", place.display()));
                }
                used.insert((room.clone(), name.to_owned()));
            }
        }
    }
    for (i, (room, allowed)) in ROOMS.iter().enumerate() {
        for name in allowed.split_whitespace() {
            if !ROOMS[..i].iter().any(|(below, _)| *below == name) {
                wrong.push(format!("{room} -> {name}: runs upward"));
            }
            if !used.contains(&(room.to_string(), name.to_owned())) {
                wrong.push(format!("{room} -> {name}: is not there any more; strike it"));
            }
        }
    }
    assert!(wrong.is_empty(), "arrows that the table of this test does not have:\n{}", wrong.join("\n"));
}
