//! What a comparison says: on the terminal, and on its page.

use super::comparison::{Comparison, Source};
use super::pairs::{Against, KEY, Key, Pair, Verdict, plain};
use super::significance::ALPHA;
use crate::bench::report::about::device;
use crate::page::{self, document, figures, href, table};
use crate::plots::{Axes, Chart, Drawn, Figure, Look, Point, Series};
use crate::table::{Table, optional, percent, thousands};
use deltamorph::UpdatePath;
use maud::{Markup, html};
use serde_json::Value;
use std::iter::once;
use std::path::{Path, PathBuf};

/// Fields of a key that are numbers; the others are words, and come first in tables.
const NUMBERS: [&str; 7] = ["targets", "batch_size", "changed", "heads", "crowds", "slots", "error_budget"];

/// What no statistics see.
const LIMITS: &str = "whether the program made the difference: what was otherwise during the whole of one run, such \
                      as another program at work or a warmer processor, counts as well. Compare two runs of one \
                      program to learn how far apart they are";

/// Where the files of a report lie, as a page links them: its JSON, and its page where there is one.
pub struct Links {
    json: String,
    page: Option<String>,
}

/// The links from a page in `dir` to the reports.
pub fn links(files: &[PathBuf], dir: &Path) -> Vec<Links> {
    let link = |file: &PathBuf| {
        let page = file.with_file_name("index.html");
        // A report that was saved beside something else's page.
        let own = file.file_name().is_some_and(|name| name == "report.json") && page.is_file();
        Links { json: href(&relative(file, dir)), page: own.then(|| href(&relative(&page, dir))) }
    };
    files.iter().map(link).collect()
}

/// `file` as seen from `dir`; both are there.
fn relative(file: &Path, dir: &Path) -> String {
    let [file, dir] = [file, dir].map(|path| path.canonicalize().unwrap_or_else(|_| path.into()));
    let common = file.components().zip(dir.components()).take_while(|(a, b)| a == b).count();
    let up = dir.components().skip(common).map(|_| "..".to_owned());
    let down = file.components().skip(common).map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

pub fn text(found: &Comparison) -> String {
    let of = |against: &Against| format!("{}\n\n{}", pairs_table(against), summary(against));
    let reports = found.reports.iter().map(|source| format!("{}: {}", source.name, source.file));
    once(reports.collect::<Vec<_>>().join("\n"))
        .chain(found.comparisons.iter().map(of))
        .chain([format!("What it cannot tell: {LIMITS}.")])
        .collect::<Vec<_>>()
        .join("\n\n")
}

pub fn page(found: &Comparison, links: &[Links], drawn: &[Option<Drawn>]) -> String {
    let title = match &found.comparisons[..] {
        [one] => format!("{} against {}", one.name, one.baseline),
        _ => format!("{} runs against {}", found.comparisons.len(), found.reports[0].name),
    };
    let body = html! {
        header {
            p.kicker { "deltamorph bench · comparison" }
            h1 { (title) }
            (about(found))
            ul.found { @for against in &found.comparisons { li { (summary(against)) } } }
        }
        @for warning in &found.warnings { p.warning { (warning) } }
        section.cards {
            @for (i, (source, links)) in found.reports.iter().zip(links).enumerate() { (card(source, links, i == 0)) }
        }
        @for (against, drawn) in found.comparisons.iter().zip(drawn) {
            section {
                h2 { (against.name) " against " (against.baseline) }
                @if let Some(drawn) = drawn { (figures(std::slice::from_ref(drawn))) }
                @if !against.configurations.is_empty() { (pairs_markup(against)) }
                (only(&against.only_in_baseline, &against.baseline))
                (only(&against.only_here, &against.name))
            }
        }
        section {
            h2 { "How to read it" }
            p.note {
                "Ratio: the median time over that of " (found.reports[0].name) "; 0.5 is half the time. The interval \
                 from low to high holds the true ratio in 95 of 100 such measurements. p: how often a difference at \
                 least as clear would be seen where there is none; corrected after Holm for the number of \
                 configurations. Faster and slower: the corrected p is below " (ALPHA) ". Not significant: no \
                 difference could be shown among so many, which is not to say that there is none."
            }
            p.note {
                "Ranks: the exact test of Wilcoxon, Mann and Whitney on the medians of up to ten rounds of each run, \
                 and the interval of Moses that belongs to it. Standard errors: from the median and the standard \
                 error alone, where a report has no rounds; frames are taken to be independent and normally \
                 distributed, so that such intervals are rather too narrow."
            }
            p.note { "The geometric mean of all ratios tells when everything moved together." }
            p.note {
                "All numbers: " a href="comparison.json" { "comparison.json" } ". deltamorph " (found.version) "."
            }
        }
    };
    document(&format!("{title} · deltamorph bench"), &body)
}

fn about(found: &Comparison) -> Markup {
    let first = &found.reports[0];
    let sentence = format!(
        "Did the time change that it takes to give a face its next expression? Compared are {} runs of a benchmark, \
         which measured the time per frame to move the points (vertices) of “{}” ({} vertices, {} morph targets) in \
         many configurations. A morph target says how far each point moves in one expression; weights mix the targets.",
        found.reports.len(),
        first.input.name,
        thousands(first.input.vertices),
        first.input.targets,
    );
    let name = &first.name;
    page::about(
        &sentence,
        &[
            ("How", vec![format!("{name} comes first; of each other run those configurations that {name} has, too")]),
            ("Where", vec![format!("{name} ran on {}", device(&first.device))]),
            (
                "What was verified",
                vec!["each result, against a full evaluation in float64; wrong ones are not compared".into()],
            ),
            ("What it cannot tell", vec![LIMITS.into()]),
        ],
    )
}

/// "B against A: of 120 configurations 3 are faster, …".
fn summary(against: &Against) -> String {
    let Against { name, baseline, faster, slower, not_significant, undecided, wrong, .. } = against;
    let all = against.configurations.len();
    let [plural, are] = if all == 1 { ["", "is"] } else { ["s", "are"] };
    let mut text = format!(
        "{name} against {baseline}: {} configuration{plural} {are} in both; {faster} faster, {slower} slower, \
         {not_significant} not significantly different",
        thousands(all)
    );
    for (count, what) in [(undecided, "timed too briefly to tell"), (wrong, "wrong")] {
        if *count > 0 {
            text += &format!(", {count} {what}");
        }
    }
    if let Some(mean) = against.ratio_mean {
        let change = percent((mean - 1.0).abs());
        text += &match mean {
            // Too little for three digits.
            mean if (mean - 1.0).abs() < 5e-4 => format!(". On geometric average {name} takes as long"),
            mean if mean < 1.0 => format!(". On geometric average {name} takes {change} less time"),
            _ => format!(". On geometric average {name} takes {change} more time"),
        };
    }
    for (count, name) in [(against.only_in_baseline.len(), baseline), (against.only_here.len(), name)] {
        if count > 0 {
            text += &format!("; {count} only in {name}");
        }
    }
    text + "."
}

fn card(source: &Source, links: &Links, first: bool) -> Markup {
    let mesh = &source.input;
    html! {
        div.card {
            h3 { (source.name) @if first { ", which the others are compared with" } }
            p.value { (source.file) }
            p {
                @if let Some(page) = &links.page { a href=(page) { "its page" } " · " }
                a href=(links.json) { "its numbers" }
            }
            p { (source.created) " · deltamorph " (source.version) }
            p { (device(&source.device)) }
            p {
                (mesh.name) ": " (thousands(mesh.vertices)) " vertices × " (mesh.targets) " targets; " (source.runs)
                " runs"
            }
            p { code { (source.command) } }
        }
    }
}

/// The fields that tell the configurations apart, words first; those that all have the same are left out.
fn told<'a>(keys: impl Iterator<Item = &'a Key> + Clone) -> (Vec<&'static str>, Vec<&'static str>) {
    let differs = |field: &&str| {
        let mut values = keys.clone().map(|key| key.get(*field).unwrap_or(&Value::Null));
        let first = values.next();
        values.any(|value| Some(value) != first)
    };
    let fields = KEY.iter().copied().chain(once("occurrence")).filter(differs);
    fields.partition(|field| !NUMBERS.contains(field) && *field != "occurrence")
}

fn cell(key: &Key, field: &str) -> String {
    plain(key.get(field).unwrap_or(&Value::Null))
}

fn pairs_table(against: &Against) -> Table {
    let pairs = &against.configurations;
    let (mut words, numbers) = told(pairs.iter().map(|pair| &pair.key));
    if words.is_empty() {
        words.push("path");
    }
    let own = [&against.baseline, &against.name].map(|name| format!("{name} ms"));
    let headings = ["low", "high", "p", "corrected", "n", "time of", "test"];
    let ratio = format!("{} / {}", against.name, against.baseline);
    let name = format!("{} is", against.name);
    let measures = own.iter().chain(once(&ratio)).map(String::as_str);
    let headings: Vec<&str> = once(name.as_str())
        .chain(words.iter().chain(&numbers).copied())
        .map(|heading| match heading {
            "mesh" => "input",
            "batch_size" => "batch",
            other => other,
        })
        .chain(measures)
        .chain(headings)
        .collect();
    let mut table = Table::new(&headings, 1 + words.len());
    for pair in pairs {
        let keys = words.iter().chain(&numbers).map(|field| cell(&pair.key, field));
        let measures = [pair.baseline_ms, pair.ms, pair.ratio, pair.low, pair.high, pair.p, pair.p_corrected];
        let n = if pair.n[0] == pair.n[1] { pair.n[0].to_string() } else { format!("{}, {}", pair.n[0], pair.n[1]) };
        let rest = [n, pair.time.into(), pair.test.unwrap_or("–").into()];
        table.row(once(pair.verdict.word().to_owned()).chain(keys).chain(measures.map(optional)).chain(rest));
    }
    table
}

fn pairs_markup(against: &Against) -> Markup {
    let pairs = &against.configurations;
    let common = common(&pairs[0].key, told(pairs.iter().map(|pair| &pair.key)));
    html! {
        (table(&format!("{} against {}", against.name, against.baseline), &pairs_table(against), |row| {
            let class = match pairs[row].verdict {
                Verdict::Faster => Some("best"),
                Verdict::Slower => Some("slower"),
                Verdict::Wrong => Some("wrong"),
                Verdict::NotSignificant | Verdict::Undecided => None,
            };
            (class, pairs[row].problem.as_deref())
        }))
        @if !common.is_empty() { p.note { "The same in all: " (common) "." } }
    }
}

/// What all configurations have in common, with `one` of them.
fn common(one: &Key, (words, numbers): (Vec<&str>, Vec<&str>)) -> String {
    let telling = |field: &&str| !(words.contains(field) || numbers.contains(field)) && one[*field] != "";
    KEY.into_iter().filter(telling).map(|field| format!("{field} {}", cell(one, field))).collect::<Vec<_>>().join(", ")
}

/// Configurations that `name` alone has.
fn only(keys: &[Key], name: &str) -> Markup {
    let (words, numbers) = told(keys.iter());
    let fields: Vec<&str> = match words.len() + numbers.len() {
        0 => vec!["path", "format", "batch_size"],
        _ => words.iter().chain(&numbers).copied().collect(),
    };
    let words_of =
        |key: &Key| fields.iter().map(|field| format!("{field} {}", cell(key, field))).collect::<Vec<_>>().join(", ");
    html! {
        @if !keys.is_empty() {
            details {
                summary { "Only in " (name) ": " (thousands(keys.len())) }
                ul {
                    @for key in keys {
                        li { (words_of(key)) }
                    }
                }
            }
        }
    }
}

/// Every ratio with its interval, in order; a line for each path.
pub fn figure(against: &Against) -> Option<Figure> {
    let mut sorted: Vec<(&Pair, f64)> =
        against.configurations.iter().filter_map(|pair| Some((pair, pair.ratio?))).collect();
    sorted.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let mut series: Vec<Series> = vec![];
    for (pair, y) in &sorted {
        let path = cell(&pair.key, "path");
        let hue = UpdatePath::ALL.iter().position(|known| known.name() == path).unwrap_or(UpdatePath::ALL.len());
        let at = series.iter().position(|line| line.label == path).unwrap_or(series.len());
        if at == series.len() {
            series.push(Series { label: path, look: Look::new(hue, at), points: vec![] });
        }
        let points = &mut series[at].points;
        let x = points.len() as f64 + 1.0;
        points.push(Point { x, y: *y, low: pair.low.unwrap_or(*y), high: pair.high.unwrap_or(*y) });
    }
    let most = series.iter().map(|line| line.points.len()).max().filter(|most| *most > 1)?;
    let even = |x| Point::new(x, 1.0, 0.0);
    series.push(Series {
        label: format!("as fast as {}", against.baseline),
        look: Look::PLAIN,
        points: [1.0, most as f64].map(even).into(),
    });
    Some(Figure {
        slug: format!("ratios-{}", against.name.to_ascii_lowercase()),
        caption: format!(
            "A mark for each configuration of a path, from the one that gained most to the one that lost most; bars \
             are 95% confidence intervals. Below 1, {} is faster.",
            against.name
        ),
        title: format!("Time in {} over time in {}", against.name, against.baseline),
        subtitle: [summary(against), String::new()],
        chart: Chart::Lines { labels: ["configurations of the path", "ratio of medians"], axes: Axes::Ratios, series },
    })
}
