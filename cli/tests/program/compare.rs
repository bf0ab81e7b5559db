//! `bench --compare`: reports of earlier runs, compared; what is no report is refused with a reason.

use crate::cli::{fails, json, links_hold, ok};

/// A bench of a moment.
const BENCH: [&str; 11] =
    ["bench", "--vertices", "200", "--targets", "4", "--paths", "cpu", "--changed", "all", "--quiet", "--frames"];

#[test]
fn reports_are_compared_configuration_by_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for (name, more) in [("a", &["20"][..]), ("b", &["20"]), ("few", &["3", "--formats", "fast"])] {
        ok(&[&BENCH[..], more, &["--report", &at(name)]].concat());
    }
    let [a, b, few] = ["a", "b", "few"].map(|name| at(&format!("{name}/report.json")));
    let dir = at("c");
    let out = json(&["bench", "--compare", &a, &b, &few, "--report", &dir, "--json", "-"]);
    let own: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("c/comparison.json")).unwrap()).unwrap();
    assert_eq!(out, own);
    let [b_to_a, few_to_a] = &out["comparisons"].as_array().unwrap()[..] else { panic!("{out}") };
    let runs = out["reports"][0]["runs"].as_u64().unwrap() as usize;
    let pairs = b_to_a["configurations"].as_array().unwrap();
    assert_eq!((pairs.len(), &b_to_a["only_here"]), (runs, &serde_json::json!([])));
    for pair in pairs {
        assert!(pair["test"] == "ranks" && pair["n"] == serde_json::json!([10, 10]), "{pair}");
        let [low, ratio, high] = ["low", "ratio", "high"].map(|field| pair[field].as_f64().unwrap());
        assert!(low <= ratio && ratio <= high, "{pair}");
    }
    let few = few_to_a["configurations"].as_array().unwrap();
    assert!(!few.is_empty() && few.len() < runs && few.iter().all(|pair| pair["verdict"] == "undecided"), "{few_to_a}");
    assert_eq!(few_to_a["only_in_baseline"].as_array().unwrap().len(), runs - few.len());
    ["a", "c"].iter().for_each(|name| links_hold(&folder.path().join(name)));
    let page = std::fs::read_to_string(folder.path().join("c/index.html")).unwrap();
    assert!(page.contains("href=\"../few/index.html\"") && page.contains("Only in A: "), "{page}");

    // Without a folder the terminal tells.
    let text = ok(&["bench", "--compare", &a, &b, "--no-report"]);
    assert!(text.contains("B / A") && text.contains("B against A: "), "{text}");
    // Twice into one folder; but not over a report.
    ok(&["bench", "--compare", &a, &b, "--report", &dir, "--quiet"]);
    assert!(!folder.path().join("c/ratios-c.svg").exists(), "that of a report that is not compared now");
    let (code, text) = fails(&["bench", "--compare", &a, &b, "--report", &at("a")]);
    assert!(code == 2 && text.contains("holds something else than a comparison"), "{text}");
    let (code, text) = fails(&["bench", "--compare", &a, &b, "--no-report", "--json", &a]);
    assert!(code == 2 && text.contains("would be written over"), "{text}");
}

#[test]
fn what_is_no_report_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    ok(&[&BENCH[..], &["3", "--report", &at("a")]].concat());
    let (a, info, other) = (at("a/report.json"), at("info.json"), at("other.json"));
    ok(&["info", "--vertices", "200", "--targets", "4", "--quiet", "--json", &info]);
    std::fs::write(&other, std::fs::read_to_string(&a).unwrap().replace("\"schema\": 1", "\"schema\": 7")).unwrap();
    for (args, code, words) in [
        (&["--compare", &a, &info][..], 1, "info.json: was written by `deltamorph info`; give a report.json"),
        (&["--compare", &a, &other], 1, "other.json: schema 7, this version reads schema 1"),
        (&["--compare", &a, &at("none.json")], 1, "none.json: cannot read"),
        (&["--compare", &at("a/runs.csv"), &a], 1, "runs.csv: is no JSON"),
        (&["--compare", &a], 2, "2 values"),
        (&["--compare", &a, &a, "--changed", "3"], 2, "--changed"),
        (&["--compare", &a, &a, "--redraw", &a], 2, "--redraw"),
    ] {
        let (found, text) = fails(&[&["bench", "--no-report"], args].concat());
        assert!(found == code && text.contains(words), "{args:?}: {text}");
    }
}
