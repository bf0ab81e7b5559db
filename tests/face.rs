//! The public names of the crate: what is at its root, held against a list that is checked in.

use std::collections::BTreeSet;
use std::path::Path;

/// Types, constants and functions at the root, at most.
const MOST: usize = 90;

/// What the statements `pub use …;` and `pub mod …;` of lib.rs name, but for what the feature `internals` opens.
fn names(lib: &str) -> BTreeSet<String> {
    let (mut names, mut hidden) = (BTreeSet::new(), false);
    let mut lines = lib.lines().take_while(|line| !line.starts_with("pub mod internals"));
    while let Some(line) = lines.next() {
        hidden |= line.contains("feature = \"internals\"") && !line.contains("not(");
        let Some(statement) = line.strip_prefix("pub ") else {
            hidden &= line.starts_with("#[");
            continue;
        };
        let mut statement = statement.to_owned();
        while !statement.contains(';') {
            statement += lines.next().expect("the end of a statement");
        }
        if std::mem::take(&mut hidden) {
            continue;
        }
        assert!(!statement.contains('*'), "a glob hides what it names: {statement}");
        let list = statement.rsplit_once('{').or(statement.rsplit_once("::")).or(statement.rsplit_once(' '));
        let list = list.expect("a statement").1;
        names.extend(
            list.split(',').map(|name| name.trim_matches([' ', '}', ';']).to_owned()).filter(|n| !n.is_empty()),
        );
    }
    names
}

#[test]
fn the_names_at_the_root_are_those_of_the_list() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lib = std::fs::read_to_string(root.join("src/lib.rs")).expect("src/lib.rs");
    let found: String = names(&lib).into_iter().map(|name| name + "\n").collect();
    let path = root.join("tests/face.txt");
    if std::env::var_os("UPDATE_FACE").is_some() {
        std::fs::write(&path, &found).expect("tests/face.txt can be written");
    }
    let listed = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        found, listed,
        "the public names differ from tests/face.txt; if that is meant: UPDATE_FACE=1 cargo test --test face"
    );
    let count = found.lines().count();
    assert!(count <= MOST, "{count} names at the root, {MOST} at most");
}

#[test]
fn names_are_found_in_every_form() {
    let lib = "mod a;\npub mod b;\n#[cfg(feature = \"internals\")]\n#[doc(hidden)]\npub mod c;\npub use a::{\n    D, E,\n    \
               F,\n};\npub use a::g::h;\npub use {i, j};\npub mod internals {\n    pub use a::K;\n";
    assert_eq!(names(lib).into_iter().collect::<Vec<_>>(), ["D", "E", "F", "b", "h", "i", "j"]);
}
