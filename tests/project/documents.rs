//! The documents: valid links, numbers of words, columns of lines, and the table of environment variables.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Returns the tracked files, relative to the root of the repository.
fn tracked() -> Vec<PathBuf> {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(ROOT).output().expect("git");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).expect("UTF-8");
    names.split_terminator('\0').map(PathBuf::from).filter(|path| Path::new(ROOT).join(path).exists()).collect()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Returns the tracked files with an extension.
fn with_extension(extension: &str) -> Vec<PathBuf> {
    tracked().into_iter().filter(|path| path.extension().is_some_and(|e| e == extension)).collect()
}

/// Returns the text without fenced code and code spans, in which brackets are not links.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut lines = String::new();
    for line in text.lines() {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        if !fenced && !fence {
            lines += &line.split('`').step_by(2).collect::<Vec<_>>().join("`");
        }
        lines.push('\n');
    }
    lines
}

/// Returns the targets of links, inline (`[text](target)`) or by a definition (`[text]: target`).
fn links(text: &str) -> Vec<String> {
    let prose = prose(text);
    let inline = prose.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '\n']).next());
    let defined = prose.lines().filter(|line| line.starts_with('[')).filter_map(|line| line.split_once("]: "));
    inline.chain(defined.map(|(_, target)| target)).map(str::to_owned).collect()
}

/// Returns the anchors that GitHub gives headings.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut fenced = false;
    let mut anchors = BTreeSet::new();
    for line in text.lines() {
        fenced ^= line.trim_start().starts_with("```");
        let title = line.trim_start_matches('#');
        if fenced || title.len() == line.len() || !title.starts_with(' ') {
            continue;
        }
        let kept = title.trim().to_lowercase().replace(' ', "-");
        anchors.insert(kept.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect());
    }
    anchors
}

/// Returns `base` joined with `relative`, without `.` and `..`.
fn joined(base: &Path, relative: &str) -> PathBuf {
    let mut path = base.to_path_buf();
    for part in Path::new(relative).components() {
        match part {
            Component::ParentDir => assert!(path.pop(), "{relative} of {} leaves the repository", base.display()),
            Component::Normal(name) => path.push(name),
            _ => {}
        }
    }
    path
}

#[test]
fn every_relative_link_leads_to_a_file_and_a_heading() {
    let files = tracked();
    let mut count = 0;
    let mut broken = vec![];
    for document in &with_extension("md") {
        let text = read(document);
        for link in links(&text).iter().filter(|link| !link.contains("://")) {
            count += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => document.clone(),
                _ => joined(document.parent().expect("a folder"), path),
            };
            let is_there = files.iter().any(|file| file.starts_with(&target));
            let has_heading =
                || target.extension().is_none_or(|e| e != "md") || anchors(&read(&target)).contains(anchor);
            if !is_there || !anchor.is_empty() && !has_heading() {
                broken.push(format!("{}: {link}", document.display()));
            }
        }
    }
    assert!(broken.is_empty(), "links that lead nowhere:\n{}", broken.join("\n"));
    assert!(count > 50, "{count} links");
}

#[test]
fn documents_stay_short() {
    let words = |path: &Path| read(path).split_whitespace().count();
    let readme = words(Path::new("README.md"));
    assert!(readme <= 1_650, "README.md has {readme} words; 1,650 are allowed");
    let all: usize = with_extension("md").iter().map(|path| words(path)).sum();
    assert!(all <= 36_000, "all documents together have {all} words; 36,000 are allowed");
}

/// Returns the numbers of the lines of prose: neither tables nor fenced code.
fn prose_lines(text: &str) -> Vec<(usize, &str)> {
    let mut fenced = false;
    let mut is_prose = |line: &str| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence && !line.trim_start().starts_with('|')
    };
    text.lines().enumerate().filter(|(_, line)| is_prose(line)).collect()
}

/// Returns the numbers of the lines that are comments.
fn comment_lines(text: &str) -> Vec<(usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("//")).collect()
}

#[test]
fn prose_and_comments_have_at_most_120_columns() {
    type Lines = fn(&str) -> Vec<(usize, &str)>;
    let mut wide = vec![];
    for (extension, lines) in [("md", prose_lines as Lines), ("rs", comment_lines as Lines)] {
        let files = with_extension(extension);
        assert!(files.len() > 20, "{} .{extension} files", files.len());
        for path in files {
            let text = read(&path);
            let is_wide = |(_, line): &(usize, &str)| line.chars().count() > 120;
            wide.extend(lines(&text).into_iter().filter(is_wide).map(|(i, _)| format!("{}:{}", path.display(), i + 1)));
        }
    }
    assert!(wide.is_empty(), "lines of more than 120 columns:\n{}", wide.join("\n"));
}

/// Returns the project's environment variables named in `text`.
fn variables(text: &str) -> BTreeSet<&str> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let ours = |word: &&str| ["UPDATE_", "DELTAMORPH_"].iter().any(|p| word.len() > p.len() && word.starts_with(p));
    words.filter(ours).filter(|word| word.bytes().all(|b| b.is_ascii_uppercase() || b == b'_')).collect()
}

#[test]
fn contributing_names_every_environment_variable_and_no_other() {
    let contributing = read(Path::new("CONTRIBUTING.md"));
    let rows: String = contributing.lines().filter(|line| line.starts_with("| `")).collect();
    let is_source = |path: &PathBuf| path.extension().is_none_or(|e| e != "md") && !path.ends_with(file!());
    let sources = tracked().into_iter().filter(is_source);
    let sources: Vec<_> = sources.filter_map(|path| std::fs::read_to_string(Path::new(ROOT).join(path)).ok()).collect();
    let mut used: BTreeSet<_> = sources.iter().flat_map(|text| variables(text)).collect();
    assert!(used.remove("DELTAMORPH_H"), "the include guard of deltamorph.h");
    assert_eq!(variables(&rows), used);
}

/// Returns the cells of the rows of tables in `text`, by the first cell.
fn rows(text: &str) -> Vec<(String, Vec<String>)> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"));
    let cells = lines.map(|line| line.split(" | ").map(str::to_owned));
    let named = cells.filter_map(|mut row| Some((row.next()?, row.collect::<Vec<_>>())));
    named.filter(|(_, cells)| !cells.is_empty()).collect()
}

/// What README says of a platform is in docs/platforms.md, which `.ci/deep` enters results in.
#[test]
fn readme_says_of_platforms_what_ran() {
    let (readme, results) = (read(Path::new("README.md")), rows(&read(Path::new("docs/platforms.md"))));
    let columns = &results.iter().find(|(name, _)| name == "platform").expect("a table").1;
    let section = readme.split("## Platforms\n").nth(1).and_then(|rest| rest.split("## ").next()).expect("a section");
    // What has to be there for each word, and what must not.
    let words = [
        ("tests run", &["unit tests", "updates", "hashes"][..], &[][..]),
        ("every test runs", &["unit tests", "updates", "hashes", "C example"], &[]),
        ("program, C library and tests run", &["unit tests", "updates", "hashes", "C example"], &[]),
        ("compiled and linked", &["compiled", "linked"], &[]),
        ("compiled", &["compiled"], &[]),
        ("runs", &["hashes"], &[]),
        ("nothing has run", &[], &["unit tests", "updates", "hashes", "C example"]),
    ];
    let said = rows(section);
    assert!(said.len() >= 5, "{said:?}");
    for (name, says) in said {
        let platform: Vec<&str> = name.split([',', ' ']).filter(|word| !word.is_empty()).collect();
        let is_it = |row: &str| row.starts_with(platform[0]) && (!name.contains("ARM") || row.contains("ARM64"));
        let of_platform: Vec<_> = results.iter().filter(|(row, _)| is_it(row)).collect();
        let has = |column: &str| {
            let at = columns.iter().position(|found| found == column).expect("a column");
            of_platform.iter().any(|(_, cells)| cells[at] != "–")
        };
        let claims: Vec<_> = words.iter().filter(|(words, ..)| says[0].contains(words)).collect();
        assert!(!claims.is_empty(), "README says of {name}: {}", says[0]);
        for (words, there, not_there) in claims {
            let fits = there.iter().all(|column| has(column)) && !not_there.iter().any(|column| has(column));
            assert!(fits, "README says '{words}' of {name}, docs/platforms.md has {of_platform:?}");
        }
    }
}
