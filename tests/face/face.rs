//! `cargo test -p deltamorph-face`: the public items of the crate with the features covered by versions
//! (docs/versions.md), each with its signature, compared with tests/face.txt, which shows the changes of a version.
//!
//! A person decides whether a change breaks hosts. The list does not show behaviour, default values, sizes, `Send`,
//! `Sync` and other traits that the compiler derives, nor items hidden from rustdoc.
#![cfg(test)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

const FEATURES: &str = "csv,gltf,threads,baselines";

/// Returns a line per item; `None` if the compiler differs from the one whose item description is known.
fn face() -> Option<&'static str> {
    static FACE: OnceLock<Option<String>> = OnceLock::new();
    FACE.get_or_init(describe).as_deref()
}

fn describe() -> Option<String> {
    let compiler = Command::new("rustc").arg("--version").output().expect("rustc starts").stdout;
    let workspace = include_str!("../../Cargo.toml").split("[workspace.package]").nth(1).expect("what packages share");
    let version = workspace.split("rust-version = \"").nth(1).and_then(|rest| rest.split('"').next());
    let known = format!("rustc {}.", version.expect("a version"));
    if !compiler.starts_with(known.as_bytes()) {
        eprintln!("LEFT OUT: rustdoc describes items in a format of its own in each version, and this is not {known}*");
        return None;
    }
    let dir = tempfile::tempdir().expect("a folder");
    // The description is unstable: only rustdoc gets the flag, so that nothing is rebuilt.
    let rustdoc = dir.path().join("rustdoc");
    std::fs::write(&rustdoc, "#!/bin/sh\nRUSTC_BOOTSTRAP=1 exec rustdoc \"$@\"\n").expect("a script");
    std::fs::set_permissions(&rustdoc, PermissionsExt::from_mode(0o755)).expect("a script");
    let test = std::env::current_exe().expect("a path to this test");
    let target = test.ancestors().nth(3).expect("the target folder");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["rustdoc", "--locked", "--package", "deltamorph", "--lib", "--features", FEATURES, "--target-dir"]);
    cargo.arg(target).args(["--", "-Z", "unstable-options", "--output-format", "json"]);
    cargo.env("RUSTDOC", rustdoc).env_remove("RUSTDOCFLAGS").current_dir(env!("CARGO_MANIFEST_DIR"));
    let output = cargo.output().expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let items = public_api::Builder::from_rustdoc_json(target.join("doc/deltamorph.json"))
        .omit_blanket_impls(true)
        .omit_auto_trait_impls(true)
        .omit_auto_derived_impls(true)
        .build();
    Some(items.expect("items").items().map(|item| format!("{item}\n")).collect())
}

#[test]
fn items_are_those_of_the_list() {
    let Some(found) = face() else { return };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../face.txt");
    if std::env::var_os("UPDATE_FACE").is_some() {
        std::fs::write(&path, found).expect("tests/face.txt can be written");
    }
    let listed = std::fs::read_to_string(&path).unwrap_or_default();
    let lines_beyond = |a: &str, b: &str, mark: &str| -> String {
        a.lines().filter(|line| !b.lines().any(|other| other == *line)).map(|line| format!("{mark} {line}\n")).collect()
    };
    let changes = lines_beyond(&listed, found, "-") + &lines_beyond(found, &listed, "+");
    assert!(
        found == listed,
        "public items differ from tests/face.txt; if that is meant: UPDATE_FACE=1 cargo test -p deltamorph-face, and CHANGELOG.md \
         says what hosts have to change\n{changes}"
    );
}

/// The Rust items in the README of the C API exist.
#[test]
fn the_readme_of_the_c_api_names_what_there_is() {
    let Some(found) = face() else { return };
    let readme = include_str!("../../capi/README.md");
    let table = readme.split("| Rust | In C |").nth(1).expect("a table").lines();
    let rows = table.filter_map(|line| line.strip_prefix("| ")?.split(" | ").next());
    let names: Vec<&str> = rows.flat_map(|row| row.split('`').skip(1).step_by(2)).collect();
    assert!(names.len() > 20, "{names:?}");
    for name in names {
        let has = found.match_indices(name).any(|(at, _)| {
            let ends = |c: Option<char>| c.is_none_or(|c| !(c.is_alphanumeric() || c == '_'));
            ends(found[..at].chars().next_back()) && ends(found[at + name.len()..].chars().next())
        });
        assert!(has, "capi/README.md names `{name}`, which Rust does not have");
    }
}
