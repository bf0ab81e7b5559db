//! Dependencies of a program that links the library, compared with docs/dependencies.md: a person reviews new crates
//! and versions before they are listed there.

use std::collections::BTreeMap;
use std::process::Command;

/// Features for engines; the project's tools are not among them.
const FEATURES: &str = "obj,csv,gltf,threads,baselines";
/// Most crates without features.
const MOST: usize = 18;
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
    let args = "tree --package deltamorph --edges normal,build --no-default-features --prefix none --features";
    let tree = cargo(&args.split(' ').chain([features]).collect::<Vec<_>>());
    let pairs = tree.lines().filter_map(|line| line.split_once(" v"));
    let pairs =
        pairs.map(|(name, rest)| (name.to_owned(), rest.split([' ', '\n']).next().unwrap_or_default().to_owned()));
    pairs.filter(|(name, _)| name != "deltamorph").collect()
}

#[test]
fn every_crate_that_an_engine_links_was_looked_at() {
    let (all, always) = (crates(FEATURES), crates(""));
    assert!((10..=MOST).contains(&always.len()) && all.len() > always.len(), "{always:?}, {all:?}");
    let listed = PAGE.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| crate "));
    let listed: Vec<&str> = listed.collect();
    let mut wrong = vec![];
    for (name, version) in &all {
        let when = if always.contains_key(name) { "always" } else { "a feature" };
        let line = format!("| {name} | {version} | {when} |");
        let found = listed.iter().find(|listed| listed.starts_with(&format!("| {name} |")));
        // Licence, what runs in a build, lines with `unsafe`, maintainer and purpose.
        let is_filled = |listed: &&&str| {
            let rest = listed.strip_prefix(&line).unwrap_or_default();
            rest.split('|').filter(|cell| !cell.trim().is_empty()).count() == 5
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
