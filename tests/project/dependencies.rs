//! Dependencies of a program that links the library, compared with docs/dependencies.md: a person reviews new crates
//! and versions before they are listed there.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Features for engines; the project's tools are not among them.
const FEATURES: &str = "csv,gltf,threads,baselines";
const PAGE: &str = include_str!("../../docs/dependencies.md");

fn cargo(args: &[&str]) -> String {
    let mut cargo = Command::new(env!("CARGO"));
    let output =
        cargo.args(args).arg("--locked").current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo starts");
    assert!(output.status.success(), "cargo {args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Returns name and version of each crate that is built for the library with `features`, except itself.
fn crates(features: &str) -> BTreeMap<String, String> {
    let tree = cargo(&[
        "tree",
        "--package",
        "deltamorph",
        "--edges",
        "normal,build",
        "--features",
        features,
        "--prefix",
        "none",
    ]);
    let pairs = tree.lines().filter_map(|line| line.split_once(" v"));
    let pairs =
        pairs.map(|(name, rest)| (name.to_owned(), rest.split([' ', '\n']).next().unwrap_or_default().to_owned()));
    pairs.filter(|(name, _)| name != "deltamorph").collect()
}

/// Counts the lines of sources with the word `unsafe`, outside comments.
fn unsafe_lines(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("an entry").path());
    let count = |path: &Path| -> usize {
        let text = std::fs::read_to_string(path).expect("a source");
        let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
        lines
            .filter(|line| line.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|word| word == "unsafe"))
            .count()
    };
    entries
        .map(|path| match (path.is_dir(), path.extension().is_some_and(|e| e == "rs")) {
            (true, _) => unsafe_lines(&path),
            (false, true) => count(&path),
            (false, false) => 0,
        })
        .sum()
}

/// Returns the computed columns of a crate, which begin its line of the table.
fn line(name: &str, version: &str, always: bool, packages: &[Value]) -> String {
    let package = packages.iter().find(|package| package["name"] == name && package["version"] == version);
    let package = package.expect("a package of the tree");
    let kinds: Vec<&str> =
        package["targets"].as_array().into_iter().flatten().filter_map(|target| target["kind"][0].as_str()).collect();
    let runs = [("custom-build", "build script"), ("proc-macro", "proc macro")];
    let runs: Vec<&str> = runs.iter().filter(|(kind, _)| kinds.contains(kind)).map(|(_, name)| *name).collect();
    let folder = Path::new(package["manifest_path"].as_str().expect("a path")).parent().expect("a folder").join("src");
    let licence = package["license"].as_str().expect("a licence").replace('/', " OR ");
    let (when, runs) =
        (if always { "always" } else { "a feature" }, if runs.is_empty() { "-".into() } else { runs.join(", ") });
    format!("| {name} | {version} | {when} | {licence} | {runs} | {} |", unsafe_lines(&folder))
}

#[test]
fn every_crate_that_an_engine_links_was_looked_at() {
    let version = cargo(&["-vV"]);
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).expect("a host");
    let metadata = cargo(&["metadata", "--format-version", "1", "--filter-platform", host]);
    let metadata: Value = serde_json::from_str(&metadata).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let (all, always) = (crates(FEATURES), crates(""));
    assert!(always.len() > 15 && all.len() > always.len(), "{all:?}");
    let listed = PAGE.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| crate "));
    let listed: Vec<&str> = listed.collect();
    let mut wrong = vec![];
    for (name, version) in &all {
        let line = line(name, version, always.contains_key(name), packages);
        let found = listed.iter().find(|listed| listed.starts_with(&format!("| {name} |")));
        // Two more columns: maintainer and purpose.
        let is_filled = |listed: &&&str| {
            let rest = listed.strip_prefix(&line).unwrap_or_default();
            rest.split('|').filter(|cell| !cell.trim().is_empty()).count() == 2
        };
        if found.filter(is_filled).is_none() {
            wrong.push(line);
        }
    }
    let gone = listed.iter().filter(|line| !all.contains_key(line.split(' ').nth(1).unwrap_or_default()));
    let gone: Vec<&&str> = gone.collect();
    assert!(
        wrong.is_empty() && gone.is_empty(),
        "docs/dependencies.md: look at what changed in these crates, then have lines that begin so, and say who keeps each, and \
         what it is for:\n{}\nand without these:\n{gone:?}",
        wrong.join("\n")
    );
}
